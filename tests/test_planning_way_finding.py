"""Way finding: the shortest route on the road's own geometry, or a sentence that says why there is none."""

from __future__ import annotations

import itertools
import math

import msgspec
import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.angles import world_angle
from navcore.errors import PlanningError
from navcore.planning import edits
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.shortest_path import Source, Ways
from navcore.planning.way_finding import Blockage, WayFinder, find_route


def graph_of(places: dict[str, tuple[float, float]], edges: list[tuple[str, str]], **changes) -> PoiGraph:
    """A graph with straight edges, named a-b."""
    pois = {key: Poi(key, key.upper(), "other", *xy) for key, xy in places.items()}
    made = {
        f"{a}-{b}": Edge(f"{a}-{b}", a, b, (places[a], places[b]), math.dist(places[a], places[b])) for a, b in edges
    }
    graph = PoiGraph(1, pois, made)
    for edge_id, change in changes.items():
        graph = edits.set_edge(graph, edge_id.replace("_", "-"), **change)
    return graph


SQUARE = {"a": (0.0, 0.0), "b": (10.0, 0.0), "c": (10.0, 6.0), "d": (0.0, 6.0)}
RING = [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a")]


def names(route) -> list[str]:
    return [stop.poi_id for stop in route.stops]


def test_a_start_in_the_middle_of_an_edge_goes_whichever_way_is_shorter():
    graph = graph_of(SQUARE, RING)
    assert names(find_route(graph, 2.0, 0.5, "c")) == ["a", "d", "c"] or find_route(graph, 2.0, 0.5, "c").length_m == 14
    route = find_route(graph, 6.0, 0.5, "c")
    assert names(route) == ["b", "c"]
    assert route.length_m == pytest.approx(10.0, abs=0.02)
    assert route.points_m[0] == pytest.approx((6.0, 0.0))
    assert route.points_m[-1] == pytest.approx((10.0, 6.0))
    assert np.hypot(*np.diff(route.points_m, axis=0).T).max() <= 0.1 + 1e-9
    assert route.stops[0].distance_m == pytest.approx(4.0, abs=0.02)


def test_one_way_closed_and_cost_are_respected():
    one_way = graph_of(SQUARE, RING, a_b={"one_way": True})
    assert names(find_route(one_way, 0.0, 0.0, "b")) == ["b"]
    assert names(find_route(one_way, 10.0, 0.0, "a")) == ["c", "d", "a"]
    assert names(find_route(one_way, 1.0, 0.0, "a")) == ["b", "c", "d", "a"], "no turning round in a one-way"
    closed = graph_of(SQUARE, RING, a_b={"closed": True})
    assert names(find_route(closed, 0.0, 0.0, "b")) == ["d", "c", "b"]
    dear = graph_of(SQUARE, RING, a_b={"cost_multiplier": 3.0})
    assert names(find_route(dear, 0.0, 0.0, "b")) == ["d", "c", "b"]


def test_the_destination_itself_is_a_route_of_one_point():
    route = find_route(graph_of(SQUARE, RING), 10.0, 0.0, "b")
    assert len(route.points_m) == 1
    assert route.length_m == 0.0
    assert names(route) == ["b"]


LINE = {"a": (0.0, 0.0), "b": (10.0, 0.0), "c": (20.0, 0.0), "lone": (5.0, 50.0), "x": (0.0, 90.0), "y": (9.0, 90.0)}
ROADS = [("a", "b"), ("b", "c"), ("x", "y")]


@pytest.mark.parametrize(
    ("changes", "place", "goal", "words"),
    [
        ({}, (1, 0), "nowhere", "no place 'nowhere'"),
        ({}, (1, 0), "lone", "No way leads to LONE"),
        ({}, (1, 9), "b", "9.0 m away"),
        ({}, (math.nan, 0), "b", "not known"),
        ({}, (1, 0), "y", "No road joins"),
        ({"b_c": {"closed": True}}, (1, 0), "c", "between B and C is closed"),
        ({"b_c": {"one_way": True}}, (19, 0), "a", "one-way"),
    ],
)
def test_unreachable_says_why(changes: dict, place: tuple[float, float], goal: str, words: str):
    with pytest.raises(PlanningError, match=words):
        find_route(graph_of(LINE, ROADS, **changes), *place, goal)


def test_the_route_is_as_long_as_the_road_not_as_the_straight_line():
    curve = tuple((10 * math.cos(t), 10 * math.sin(t)) for t in np.linspace(0, math.pi, 200))
    length_m = sum(math.dist(p, q) for p, q in itertools.pairwise(curve))
    pois = {"a": Poi("a", "A", "other", *curve[0]), "b": Poi("b", "B", "other", *curve[-1])}
    route = find_route(PoiGraph(1, pois, {"e": Edge("e", "a", "b", curve, length_m)}), *curve[0], "b")
    assert route.length_m == pytest.approx(10 * math.pi, rel=0.002)
    assert np.hypot(*route.points_m.T) == pytest.approx(np.full(len(route.points_m), 10.0), abs=0.01)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_it_is_the_shortest_of_all(seed: int):
    rng = np.random.default_rng(seed)
    places = {f"p{i}": (float(x), float(y)) for i, (x, y) in enumerate(rng.uniform(0, 30, (9, 2)))}
    pairs = [pair for pair in itertools.combinations(places, 2) if rng.random() < 0.35]
    if not any("p0" in pair for pair in pairs) or not any("p8" in pair for pair in pairs):
        return
    graph = graph_of(places, pairs)
    plain = nx.Graph()
    plain.add_weighted_edges_from((e.a, e.b, e.length_m) for e in graph.edges.values())
    if not nx.has_path(plain, "p0", "p8"):
        with pytest.raises(PlanningError):
            find_route(graph, *places["p0"], "p8")
        return
    route = find_route(graph, *places["p0"], "p8")
    shortest_m = nx.dijkstra_path_length(plain, "p0", "p8")
    assert route.length_m <= shortest_m + 1e-6, "corners are cut by the even spacing, never lengthened"
    assert route.length_m >= shortest_m - 0.1 * 9


def test_a_kept_way_finder_gives_the_same_as_a_fresh_one():
    graph = graph_of(SQUARE, RING)
    finder = WayFinder(graph)
    for x_m, goal in ((1.0, "c"), (9.0, "d"), (3.0, "b")):
        assert np.array_equal(finder.route_to(goal, x_m, 0.0).points_m, find_route(graph, x_m, 0.0, goal).points_m)


def test_a_junction_without_a_spoken_name_is_passed_in_silence_unless_it_is_the_goal():
    path = ((0.0, 0.0), (10.0, 0.0))
    pois = {
        "a": Poi("a", "A", "room", 0.0, 0.0),
        "j": Poi("j", "Junction 1", "junction", 10.0, 0.0),
        "k": Poi("k", "K", "junction", 20.0, 0.0, spoken_name="the fountain"),
        "b": Poi("b", "B", "junction", 30.0, 0.0),
    }
    edges = {
        name: Edge(name, name[0], name[1], tuple((x + 10.0 * i, y) for x, y in path), 10.0)
        for i, name in enumerate(("aj", "jk", "kb"))
    }
    stops = find_route(PoiGraph(1, pois, edges), 1.0, 0.0, "b").stops
    assert [(stop.poi_id, stop.is_silent) for stop in stops] == [("j", True), ("k", False), ("b", False)]


# ------------------------------------------------------------------------------------------- the route's own edges
def test_a_route_knows_the_edges_it_runs_along():
    graph = graph_of(SQUARE, RING)
    route = find_route(graph, 6.0, 0.5, "d")
    assert [piece.edge_id for piece in route.pieces] == ["a-b", "d-a"]
    route = find_route(graph, 6.0, 0.5, "c")
    assert [piece.edge_id for piece in route.pieces] == ["a-b", "b-c"]
    for distance_m in np.linspace(0.0, route.length_m, 23):
        edge_id, arc_m = route.on_edge(float(distance_m)) or ("", math.nan)
        edge = graph.edges[edge_id]
        (x0, y0), (x1, y1) = edge.path_m
        share = arc_m / edge.length_m
        here = route.points_m[int(np.argmin(np.abs(route.arc_length_m - distance_m)))]
        assert here == pytest.approx((x0 + share * (x1 - x0), y0 + share * (y1 - y0)), abs=0.06)


def test_the_pieces_join_without_a_gap_and_backwards_pieces_count_down():
    route = find_route(graph_of(SQUARE, RING), 9.0, 5.0, "a")
    assert route.pieces[0].start_m == 0.0
    assert route.pieces[-1].end_m == pytest.approx(route.length_m)
    for before, after in itertools.pairwise(route.pieces):
        assert before.end_m == after.start_m
    assert all(
        piece.end_m - piece.start_m == pytest.approx(abs(piece.edge_end_m - piece.edge_start_m), abs=0.1)
        for piece in route.pieces
    )
    backwards = find_route(graph_of(SQUARE, [("a", "b")]), 4.0, 0.0, "a").pieces[0]
    assert (backwards.edge_start_m, backwards.edge_end_m) == pytest.approx((4.0, 0.0))


# ------------------------------------------------------------------------------------------------ what blocks a way
@pytest.mark.parametrize(
    ("side", "mirrored"), [("none", "none"), ("left", "right"), ("right", "left"), ("both", "both")]
)
def test_what_asks_for_caution_is_on_the_side_as_the_way_passes_it(side: str, mirrored: str):
    graph = graph_of(SQUARE, RING)
    edge = msgspec.structs.replace(graph.edges["a-b"], caution_side=side, width_m=0.8)
    graph = PoiGraph(1, graph.pois, graph.edges | {"a-b": edge})

    def found(x_m: float, y_m: float, goal: str) -> list[tuple[str, str, float | None]]:
        return [(each.edge_id, each.caution_side, each.width_m) for each in find_route(graph, x_m, y_m, goal).pieces]

    assert found(0.0, 0.0, "c") == [("a-b", side, 0.8), ("b-c", "none", None)]
    assert found(10.0, 4.0, "a") == [("b-c", "none", None), ("a-b", mirrored, 0.8)]
    assert found(6.0, 0.0, "c")[0] == ("a-b", side, 0.8), "begun on it, onwards"
    assert found(4.0, 0.0, "d")[0] == ("a-b", mirrored, 0.8), "begun on it, and back"


def test_a_blocked_place_is_gone_round_from_either_side_of_it():
    finder = WayFinder(graph_of(SQUARE, RING))
    at = Blockage("a-b", 5.0)
    assert names(finder.route_to("b", 2.0, 0.0)) == ["b"]
    assert names(finder.route_to("b", 2.0, 0.0, blockages=[at])) == ["a", "d", "c", "b"]
    assert names(finder.route_to("b", 7.0, 0.0, blockages=[at])) == ["b"], "it lies behind the walker"
    assert names(finder.route_to("a", 7.0, 0.0, blockages=[at])) == ["b", "c", "d", "a"]
    assert names(finder.route_to("c", 0.0, 6.0, blockages=[at])) == ["c"]


def test_where_everything_is_blocked_it_says_so():
    finder = WayFinder(graph_of(SQUARE, RING))
    both = [Blockage("a-b", 5.0), Blockage("c-d", 3.0)]
    with pytest.raises(PlanningError, match="B cannot be reached: the way there is blocked"):
        finder.route_to("b", 2.0, 0.0, blockages=both)
    closed = WayFinder(graph_of(SQUARE, RING, c_d={"closed": True}))
    with pytest.raises(PlanningError, match="blocked"):
        closed.route_to("b", 2.0, 0.0, blockages=both[:1])


# ----------------------------------------------------------------------------------------- which road is the walker's
LEGS = {"a": (0.0, 0.0), "b": (20.0, 0.0), "c": (20.0, 0.8), "d": (0.0, 0.8), "e": (10.0, -9.0), "f": (10.0, 9.0)}


def test_a_leg_beside_is_not_taken_for_the_walkers_own():
    graph = graph_of(LEGS, [("a", "b"), ("c", "d"), ("b", "c")])
    finder = WayFinder(graph)
    assert names(finder.route_to("b", 5.0, 0.45)) == ["c", "b"], "the other leg is nearer by a hand"
    assert names(finder.route_to("b", 5.0, 0.45, on_edge="a-b")) == ["b"]
    assert names(finder.route_to("b", 5.0, 0.9, on_edge="a-b")) == ["c", "b"], "far from their own, near the other"


def test_of_two_one_way_legs_theirs_is_the_one_along_the_heading():
    changes = {"a_b": {"one_way": True}, "c_d": {"one_way": True}}
    finder = WayFinder(graph_of(LEGS, [("a", "b"), ("c", "d"), ("b", "c"), ("a", "d")], **changes))
    east, west = world_angle(0.0), world_angle(math.pi)
    assert names(finder.route_to("b", 5.0, 0.45, heading=east)) == ["b"]
    assert names(finder.route_to("d", 5.0, 0.35, heading=west)) == ["d"]


def test_a_road_that_is_crossed_is_not_the_walkers_own():
    places = {"w": (-10.0, 0.0), "x": (0.0, 0.0), "o": (10.0, 0.0), "n": (0.0, 10.0), "s": (0.0, -10.0)}
    finder = WayFinder(graph_of(places, [("w", "x"), ("x", "o"), ("n", "x"), ("x", "s")]))
    route = finder.route_to("o", -0.5, 0.6, heading=world_angle(0.0))
    assert route.points_m[0] == pytest.approx((-0.5, 0.0)), "walking east, a little north of the road to the east"
    route = finder.route_to("s", -0.5, 0.6, heading=world_angle(-math.pi / 2))
    assert route.points_m[0] == pytest.approx((0.0, 0.6))


def test_an_unlikely_road_is_taken_where_the_likely_one_leads_nowhere():
    finder = WayFinder(graph_of(LEGS, [("a", "b"), ("c", "d")]))
    assert names(finder.route_to("d", 5.0, 0.3, on_edge="a-b")) == ["d"]


# ---------------------------------------------------------------------------------------------------- the search
def test_of_two_roads_between_the_same_places_the_cheaper_one_is_taken():
    pois = {"a": Poi("a", "A", "other", 0.0, 0.0), "b": Poi("b", "B", "other", 10.0, 0.0)}
    long = Edge("long", "a", "b", ((0.0, 0.0), (5.0, 5.0), (10.0, 0.0)), 2 * math.hypot(5, 5))
    short = Edge("short", "a", "b", ((0.0, 0.0), (10.0, 0.0)), 10.0)
    graph = PoiGraph(1, pois, {"long": long, "short": short})
    assert find_route(graph, 0.0, 0.0, "b").length_m == pytest.approx(10.0)
    shut = edits.set_edge(graph, "short", closed=True)
    assert [piece.edge_id for piece in find_route(shut, 0.0, 0.0, "b").pieces] == ["long"]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_the_search_finds_the_cheapest_way_from_the_best_of_its_sources(seed: int):
    rng = np.random.default_rng(seed)
    places = {f"p{i}": (float(x), float(y)) for i, (x, y) in enumerate(rng.uniform(0, 100, (60, 2)))}
    pairs = [pair for pair in itertools.combinations(places, 2) if rng.random() < 0.06]
    graph = graph_of(places, pairs)
    for edge_id in graph.edges:
        kind = rng.integers(4)
        change = ({"one_way": True}, {"closed": True}, {"cost_multiplier": float(rng.uniform(1, 4))}, {})[kind]
        graph = edits.set_edge(graph, edge_id, **change)
    truth = nx.DiGraph()
    truth.add_nodes_from(places)
    for edge in graph.edges.values():
        if not edge.closed:
            truth.add_edge(edge.a, edge.b, cost=edge.length_m * edge.cost_multiplier)
            if not edge.one_way:
                truth.add_edge(edge.b, edge.a, cost=edge.length_m * edge.cost_multiplier)
    ways = Ways.of(graph)
    sources = [Source("p1", 3.0), Source("p2", 7.0)]
    for goal in ("p0", "p2", "p30", "p59"):
        costs = [
            source.cost_m + nx.dijkstra_path_length(truth, source.poi_id, goal, "cost")
            for source in sources
            if nx.has_path(truth, source.poi_id, goal)
        ]
        way = ways.cheapest(sources, goal, ways.usable())
        assert (way is None) == (not costs)
        if way is not None:
            assert way.cost_m == pytest.approx(min(costs))
            assert way.poi_ids[0] == sources[way.source].poi_id
            assert way.poi_ids[-1] == goal
            walked = sum(truth.edges[pair]["cost"] for pair in itertools.pairwise(way.poi_ids))
            assert sources[way.source].cost_m + walked == pytest.approx(way.cost_m)
