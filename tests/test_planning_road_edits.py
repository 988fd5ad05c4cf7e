"""Editing the road: places and edges stay on it, and what would take it from under them is refused by name."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.errors import InputError
from navcore.planning import edits, road_edits
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.planning.road_edits import network_of, recorded_roads
from navcore.planning.road_network import RoadNetwork

CORRIDOR = np.column_stack([np.linspace(0, 20, 201), np.zeros(201), np.full(201, 1.6)])
BRANCH = np.column_stack([np.full(81, 8.0), np.linspace(0, 8, 81)])
FAR = np.column_stack([np.linspace(21.5, 26, 46), np.zeros(46)])
ROADS = recorded_roads([CORRIDOR, BRANCH, FAR])


def graph_with(*places: tuple[str, float, float]) -> PoiGraph:
    graph = PoiGraph(roads=ROADS)
    for name, x_m, y_m in places:
        graph = edits.add_poi(graph, network_of(ROADS), name=name, kind="other", x_m=x_m, y_m=y_m)
    return graph


def joined(*places: tuple[str, float, float]) -> PoiGraph:
    return edits.propose_edges(graph_with(*places), network_of(ROADS))


def length_m(graph: PoiGraph, road_id: str) -> float:
    line = np.array(graph.roads[road_id].points_m)
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def test_recorded_walks_become_roads_in_the_plane() -> None:
    assert list(ROADS) == ["r1", "r2", "r3"]
    assert ROADS["r1"].points_m[:2] == ((0.0, 0.0), (0.1, 0.0))
    assert {road.origin for road in ROADS.values()} == {"recorded"}
    assert recorded_roads([CORRIDOR[:1]]) == {}


def test_a_drawn_line_begins_on_the_road_that_is_near_and_is_known_as_drawn() -> None:
    graph = road_edits.draw_road(graph_with(("Hall", 2, 0)), [(14.0, 0.3), (14.0, 4.0), (8.3, 4.0)])
    road = graph.roads["r4"]
    assert road.origin == "drawn"
    assert road.points_m == ((14.0, 0.0), (14.0, 4.0), (8.0, 4.0))
    network = network_of(graph.roads)
    way = network.shortest_piece(network.nearest(14.0, 4.0), network.nearest(8.0, 6.0))
    assert way.length_m == pytest.approx(8.0, abs=0.3), "one can go on from the drawn line along the branch"


def test_a_line_never_takes_the_identifier_of_another_whatever_an_import_has_called_them() -> None:
    far = ((0.0, 20.0), (5.0, 20.0))
    graph = PoiGraph(roads={key: msgspec.structs.replace(ROADS["r1"], id=key) for key in ("r999999999", "r1000000001")})
    for count in (3, 4):
        graph = road_edits.draw_road(graph, far)
        assert len(graph.roads) == count
    assert graph.roads["r1000000001"].points_m == ROADS["r1"].points_m
    numbers = dict.fromkeys(("e999999999", "e1000000000"), Edge("", "a", "b", (), 0.0))
    assert edits.free_edge_id(numbers) not in numbers


def test_a_place_can_stand_on_a_drawn_line_and_be_joined_over_it() -> None:
    graph = road_edits.draw_road(graph_with(("Hall", 2, 0)), [(20.0, 0.0), (21.5, 0.0)])
    network = network_of(graph.roads)
    graph = edits.add_poi(graph, network, name="End", kind="room", x_m=26, y_m=0)
    graph = edits.add_edge(graph, network, "hall", "end")
    assert graph.edges["e1"].length_m == pytest.approx(24.0, abs=0.1)


def test_trimming_keeps_what_lies_between_two_places() -> None:
    graph = road_edits.trim_road(joined(("A", 2, 0), ("C", 12, 0)), "r1", (15.0, 0.4), (1.0, -0.2))
    assert length_m(graph, "r1") == pytest.approx(14.0, abs=0.01)
    assert graph.roads["r1"].points_m[0] == (1.0, 0.0)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda g: road_edits.trim_road(g, "r1", (0, 0), (9, 0)), "C stands on that piece of road"),
        (lambda g: road_edits.trim_road(g, "r1", (3, 0), (3.1, 0)), "would be left"),
        (lambda g: road_edits.delete_road(g, "r2"), "B stands on that piece"),
        (lambda g: road_edits.delete_road(g, "r9"), "no road"),
        (lambda g: road_edits.split_road(g, "r1", (20.0, 0.0)), "not cut at its end"),
        (lambda g: road_edits.join_roads(g, "r1", "r1"), "two different roads"),
        (lambda g: road_edits.join_roads(g, "r2", "r3"), "draw the piece between"),
        (lambda g: road_edits.smooth_road(g, "r1", 9.0), "smoothed over"),
        (lambda g: road_edits.draw_road(g, [(0.0, 0.0), (0.0, 0.1)]), "longer line"),
        (lambda g: road_edits.draw_road(g, [(0.0, 0.0), (math.nan, 0.1)]), "points in metres"),
        (lambda g: road_edits.draw_road(g, [(float(i), 9.0) for i in range(5001)]), "in pieces"),
        (lambda g: road_edits.draw_road(g, [(0.0, 0.0), (90_000.0, 0.0)] * 2500), "too long for a road"),
        (lambda g: road_edits.draw_road(g, [(9_000.0, 9_000.0), (9_003.0, 9_000.0)]), "site of its own"),
    ],
)
def test_what_is_refused_says_why_and_what_to_do(edit, words: str) -> None:
    graph = joined(("A", 2, 0), ("B", 8, 6), ("C", 12, 0))
    before = msgspec.json.encode(graph)
    with pytest.raises(InputError, match=words):
        edit(graph)
    assert msgspec.json.encode(graph) == before


def test_roads_do_not_grow_without_end_but_what_is_there_already_can_be_edited() -> None:
    walk = np.array([[0.0, 0.0], [300.0, 0.0]])
    graph = PoiGraph(roads=recorded_roads([walk] * 134))
    with pytest.raises(InputError, match=r"All roads together would be 40\.3 km"):
        road_edits.draw_road(graph, [(0.0, -10.0), (100.0, -10.0)])
    cut = road_edits.trim_road(graph, "r1", (0.0, 0.0), (240.0, 0.0))
    assert length_m(cut, "r1") == pytest.approx(240.0)


def test_a_long_walk_can_be_trimmed_and_smoothed_though_nobody_may_draw_as_much_at_once() -> None:
    swaying = np.column_stack([np.arange(0.0, 2200.0, 0.4), np.tile([0.0, 0.1], 2750)])
    graph = road_edits.smooth_road(PoiGraph(roads=recorded_roads([swaying])), "r1")
    cut = road_edits.trim_road(graph, "r1", (0.0, 0.0), (2100.0, 0.0))
    assert length_m(cut, "r1") == pytest.approx(2100.0, abs=10.0)


def test_a_connection_that_would_go_another_way_is_not_led_there_in_silence() -> None:
    graph = road_edits.draw_road(joined(("A", 2, 0), ("C", 18, 0)), [(1.0, 0.0), (1.0, 9.0), (19.0, 9.0), (19.0, 0.0)])
    assert graph.edges["e1"].length_m == pytest.approx(16.0, abs=0.1), "the shorter way stays"
    for end in ((4.0, 0.0), (16.0, 0.0)):
        graph = road_edits.split_road(graph, list(graph.roads)[-1] if end[0] > 4 else "r1", end)
    middle = next(key for key, road in graph.roads.items() if road.points_m[0] == (4.0, 0.0))
    with pytest.raises(InputError, match="A and C are joined along that piece of road"):
        road_edits.delete_road(graph, middle)


def test_a_connection_stays_on_its_way_where_a_shorter_one_was_drawn_meanwhile() -> None:
    x_m = np.linspace(0, 10, 101)
    walk = [np.array([[0.0, 0.0], [0.0, 6.0]]), np.column_stack([x_m, 6 + 0.2 * np.sin(3 * x_m)]), [[10.0, 0.0]]]
    graph = PoiGraph(roads=recorded_roads([np.vstack(walk)]))
    network = network_of(graph.roads)
    for name, place_m in (("A", 0.0), ("B", 10.0)):
        graph = edits.add_poi(graph, network, name=name, kind="room", x_m=place_m, y_m=1.0)
    graph = edits.set_edge(edits.add_edge(graph, network, "a", "b"), "e1", caution_side="left", width_m=1.2)
    graph = road_edits.draw_road(graph, [(0.0, 1.0), (10.0, 1.0)])
    smooth = road_edits.smooth_road(graph, "r1", 1.0)
    edits.validate(smooth)
    assert smooth.edges["e1"].path_m != graph.edges["e1"].path_m
    assert smooth.edges["e1"].length_m == pytest.approx(20.0, abs=0.5)
    assert max(y_m for _, y_m in smooth.edges["e1"].path_m) > 5.9
    with pytest.raises(InputError, match="A and B are joined along that piece of road"):
        road_edits.trim_road(graph, "r1", (0.0, 0.0), (0.0, 3.0))


def test_what_no_road_carried_is_left_alone_by_an_edit_of_another_road() -> None:
    graph = joined(("A", 2, 0), ("B", 8, 6), ("C", 12, 0))
    e1 = graph.edges["e1"]
    aside = (e1.path_m[0], (4.0, 4.0), e1.path_m[-1])
    aside_m = math.dist(*aside[:2]) + math.dist(*aside[1:])
    imported = msgspec.structs.replace(
        graph,
        pois={**graph.pois, "d": Poi("d", "D", "room", 4.0, 30.0)},
        edges={**graph.edges, "e1": msgspec.structs.replace(e1, path_m=aside, length_m=aside_m)},
    )
    edits.validate(imported)
    changed = road_edits.delete_road(imported, "r3")
    assert changed.pois["d"] == imported.pois["d"]
    assert changed.edges["e1"] == imported.edges["e1"]


def test_only_what_a_change_takes_the_road_from_is_named() -> None:
    graph = joined(("A", 2, 0), ("B", 8, 6), ("C", 12, 0))
    off = msgspec.structs.replace(graph, pois={**graph.pois, "d": Poi("d", "D", "room", 4.0, 30.0)})
    shorter = {key: road for key, road in ROADS.items() if key != "r2"}
    whole, cut = network_of(ROADS), network_of(shorter)
    ab = edits.edge_between(graph, "a", "b")
    assert ab is not None

    def named(before: PoiGraph, after: PoiGraph, network: RoadNetwork, pois: list[str], edges: list[str]) -> str | None:
        return road_edits.newly_without_road(before, after, whole, network, pois, edges)

    assert road_edits.without_road(off, whole, off.pois, off.edges) == "D"
    assert named(off, off, whole, list(off.pois), list(off.edges)) is None, "it was off the road before"
    assert named(off, off, cut, list(off.pois), []) == "B"
    assert named(off, off, cut, ["d"], [ab.id]) in ("A – B", "B – A")
    assert named(graph, off, whole, ["d"], []) == "D", "it comes back without a road"
    assert named(off, graph, cut, ["d"], []) is None, "it goes"
    free = msgspec.structs.replace(off, pois={**off.pois, "d": msgspec.structs.replace(off.pois["d"], on_road=False)})
    assert named(off, free, cut, ["d"], []) is None, "it need not lie on one"
    assert named(free, off, whole, ["d"], []) == "D"


def test_a_road_that_is_cut_and_joined_is_the_road_it_was() -> None:
    graph = graph_with(("A", 2, 0))
    cut = road_edits.split_road(graph, "r1", (5.0, 0.5))
    assert length_m(cut, "r1") == pytest.approx(5.0, abs=0.01)
    assert length_m(cut, "r4") == pytest.approx(15.0, abs=0.01)
    whole = road_edits.join_roads(cut, "r4", "r1")
    assert length_m(whole, "r4") == pytest.approx(20.0, abs=0.01)
    assert "r1" not in whole.roads


def test_joining_closes_a_gap_and_leads_over_it() -> None:
    graph = road_edits.join_roads(graph_with(("A", 2, 0), ("B", 24, 0)), "r3", "r1")
    assert length_m(graph, "r3") == pytest.approx(26.0, abs=0.01)
    assert edits.add_edge(graph, network_of(graph.roads), "a", "b").edges["e1"].length_m == pytest.approx(22, abs=0.1)


def test_smoothing_takes_the_sway_out_and_leaves_the_ends() -> None:
    x = np.linspace(0, 20, 201)
    swaying = recorded_roads([np.column_stack([x, 0.2 * np.sin(2 * np.pi * x / 1.2)])])
    graph = road_edits.smooth_road(PoiGraph(roads=swaying), "r1", 1.2)
    line = np.array(graph.roads["r1"].points_m)
    assert np.abs(line[10:-10, 1]).max() < 0.05
    assert graph.roads["r1"].points_m[0] == swaying["r1"].points_m[0]
    assert graph.roads["r1"].points_m[-1] == swaying["r1"].points_m[-1]


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["draw", "trim", "smooth", "split", "join", "delete"]),
            st.sampled_from(["r1", "r2", "r3", "r4", "r5"]),
            st.sampled_from(["r1", "r2", "r3", "r4", "r5"]),
            st.tuples(st.floats(-3, 28), st.floats(-3, 10)),
            st.tuples(st.floats(-3, 28), st.floats(-3, 10)),
        ),
        max_size=6,
    )
)
def test_whatever_is_done_to_the_roads_nothing_on_them_is_lost(steps) -> None:
    graph = joined(("A", 2, 0), ("B", 8, 6), ("C", 12, 0))
    pois, edges = graph.pois.keys(), graph.edges.keys()
    for what, one, other, start, end in steps:
        try:
            match what:
                case "draw":
                    graph = road_edits.draw_road(graph, [start, end])
                case "trim":
                    graph = road_edits.trim_road(graph, one, start, end)
                case "smooth":
                    graph = road_edits.smooth_road(graph, one)
                case "split":
                    graph = road_edits.split_road(graph, one, start)
                case "join":
                    graph = road_edits.join_roads(graph, one, other)
                case _:
                    graph = road_edits.delete_road(graph, one)
        except InputError:
            continue
        edits.validate(graph)
        network = network_of(graph.roads)
        assert (graph.pois.keys(), graph.edges.keys()) == (pois, edges)
        assert all(network.nearest(p.x_m, p.y_m).distance_m < 1e-6 for p in graph.pois.values())
        for edge in graph.edges.values():
            assert max(network.nearest(*point).distance_m for point in edge.path_m) < 0.06


# ------------------------------------------------------------------------------------- places and edges, new edits
def test_merging_two_places_leads_their_edges_to_the_one_that_stays() -> None:
    graph = joined(("A", 2, 0), ("B", 8, 6), ("C", 12, 0), ("C again", 13, 0))
    graph = edits.set_edge(graph, edits.edge_between(graph, "a", "c").id, closed=True)  # type: ignore[union-attr]
    merged = edits.merge_pois(graph, network_of(ROADS), "c-again", "c")
    edits.validate(merged)
    assert "c" not in merged.pois
    pairs = {frozenset((edge.a, edge.b)) for edge in merged.edges.values()}
    assert frozenset(("a", "c-again")) in pairs
    assert edits.edge_between(merged, "a", "c-again").closed  # type: ignore[union-attr]
    with pytest.raises(InputError, match="two different places"):
        edits.merge_pois(graph, network_of(ROADS), "a", "a")


@pytest.mark.parametrize(
    ("setting", "what"),
    [
        ({"closed": True}, "being closed"),
        ({"one_way": True}, "the direction"),
        ({"caution_side": "left"}, "the side of caution"),
    ],
)
def test_merging_loses_nothing_that_keeps_a_walker_from_harm(setting: dict, what: str) -> None:
    network = network_of(ROADS)
    graph = edits.add_edge(graph_with(("A", 2, 0), ("C", 12, 0), ("C again", 13, 0)), network, "c", "a")
    graph = edits.add_edge(graph, network, "a", "c-again")
    differing = edits.set_edge(graph, "e1", **setting)
    with pytest.raises(InputError, match=f"C again and C are both joined to A, .* in {what}: make them alike"):
        edits.merge_pois(differing, network, "c-again", "c")
    same = edits.set_edge(differing, "e2", **setting)
    # The two lead opposite ways, so that the same words mean opposite directions and sides; being closed has none.
    if "closed" not in setting:
        with pytest.raises(InputError, match=what):
            edits.merge_pois(same, network, "c-again", "c")
        same = edits.set_edge(differing, "e2", **setting, turned=True)
    merged = edits.merge_pois(same, network, "c-again", "c")
    assert list(merged.edges) == ["e2"]


@pytest.mark.parametrize("setting", [{"closed": True}, {"one_way": True}, {"caution_side": "left"}])
def test_merging_does_not_lead_others_along_a_closed_piece_as_an_open_one(setting: dict) -> None:
    network = network_of(ROADS)
    graph = edits.add_edge(graph_with(("A", 2, 0), ("C", 12, 0), ("D", 18, 0)), network, "a", "c")
    graph = edits.set_edge(graph, "e1", **setting)
    assert edits.merge_pois(graph, network, "a", "c").edges == {}
    graph = edits.add_edge(graph, network, "c", "d")
    with pytest.raises(InputError, match="The connection of A and C is closed, one-way or has a side of caution"):
        edits.merge_pois(graph, network, "a", "c")
    open_again = edits.set_edge(graph, "e1", closed=False, one_way=False, caution_side="none")
    assert list(edits.merge_pois(open_again, network, "a", "c").edges) == ["e2"]


def test_a_place_on_an_edge_makes_two_edges_that_are_walked_alike() -> None:
    graph = joined(("A", 2, 0), ("C", 12, 0))
    graph = edits.set_edge(graph, "e1", one_way=True, width_m=0.9, caution_side="left", cost_multiplier=3.0)
    split = edits.split_edge(graph, network_of(ROADS), "e1", 5.0, 0.7, name="Door", kind="door")
    edits.validate(split)
    assert split.version == graph.version + 1
    first, second = split.edges["e1"], split.edges["e2"]
    assert (first.a, first.b, second.a, second.b) == ("a", "door", "door", "c")
    assert first.length_m + second.length_m == pytest.approx(graph.edges["e1"].length_m)
    for edge in (first, second):
        assert (edge.one_way, edge.width_m, edge.caution_side, edge.cost_multiplier) == (True, 0.9, "left", 3.0)
    with pytest.raises(InputError, match="at this end"):
        edits.split_edge(graph, network_of(ROADS), "e1", 2.0, 0.0, name="Door", kind="door")


def test_an_edge_that_is_turned_leads_the_other_way_and_its_danger_stays_where_it_is() -> None:
    graph = edits.set_edge(joined(("A", 2, 0), ("C", 12, 0)), "e1", one_way=True, caution_side="left", width_m=1.5)
    turned = edits.set_edge(graph, "e1", turned=True, width_m=0.0)
    edits.validate(turned)
    edge = turned.edges["e1"]
    assert (edge.a, edge.b, edge.one_way, edge.caution_side, edge.width_m) == ("c", "a", True, "right", None)
    assert edge.path_m == graph.edges["e1"].path_m[::-1]
    for bad in ({"width_m": 0.1}, {"width_m": math.inf}, {"caution_side": "above"}):
        with pytest.raises(InputError):
            edits.set_edge(graph, "e1", **bad)
