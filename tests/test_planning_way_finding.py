"""Way finding: the shortest route on the road's own geometry, or a sentence that says why there is none."""

from __future__ import annotations

import itertools
import math

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.errors import PlanningError
from navcore.planning import edits
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.way_finding import WayFinder, find_route


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
        ({}, (1, 0), "lone", "No edge leads to LONE"),
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
