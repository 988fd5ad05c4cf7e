"""A PoI-graph on a road that has changed: places stay, edges follow the road, what was set stays set."""

from __future__ import annotations

import numpy as np
import pytest

from navcore.planning.edits import add_poi, delete_edge, edge_between, propose_edges, set_edge, validate
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_change import Carried, carried_over
from navcore.planning.road_network import RoadNetwork
from navcore.recording import Mark
from navcore.tagging import places_to_add

CORRIDOR = np.array([[0.0, 0.0], [20.0, 0.0]])
BRANCH = np.array([[10.0, 0.0], [10.0, 8.0]])
SWAYING = CORRIDOR + np.array([0.0, 0.15])


@pytest.fixture(scope="module")
def corridor() -> RoadNetwork:
    return RoadNetwork.from_roads([CORRIDOR])


@pytest.fixture(scope="module")
def with_branch() -> RoadNetwork:
    return RoadNetwork.from_roads([CORRIDOR, SWAYING, BRANCH])


@pytest.fixture(scope="module")
def graph(corridor: RoadNetwork) -> PoiGraph:
    """Hall at one end, bar at the other; the way between costs double and is one-way."""
    graph = add_poi(PoiGraph(), corridor, name="Hall", kind="hall", x_m=0.5, y_m=0.0)
    graph = add_poi(graph, corridor, name="Bar", kind="bar", x_m=19.5, y_m=0.0, spoken_name="the bar")
    graph = add_poi(graph, corridor, name="Kiosk", kind="other", x_m=3.0, y_m=9.0, on_road=False)
    return set_edge(propose_edges(graph, corridor), "e1", one_way=True, cost_multiplier=2.0)


def carried_with(graph: PoiGraph, known: RoadNetwork, network: RoadNetwork, *marks: Mark) -> Carried:
    stamps = np.arange(9.0)
    walked = np.column_stack([np.full(9, 10.0), np.arange(9.0)])
    added = places_to_add(graph, marks, stamps, walked, known, network)
    return carried_over(graph, added, {}, known, network)


def test_the_same_road_changes_nothing_but_the_version(graph: PoiGraph, corridor: RoadNetwork) -> None:
    carried = carried_over(graph, {}, {}, corridor, corridor)
    assert carried.graph.pois == graph.pois
    assert carried.graph.version == graph.version + 1
    assert carried.graph.edges["e1"].length_m == pytest.approx(19.0, abs=0.1)
    assert (carried.off_road, carried.lost_edges) == ((), ())
    validate(carried.graph)


def test_a_new_junction_divides_an_edge_whose_parts_inherit(
    graph: PoiGraph, corridor: RoadNetwork, with_branch: RoadNetwork
) -> None:
    carried = carried_with(graph, corridor, with_branch, Mark(8.0, "room", "Room 7"))
    after = carried.graph
    validate(after)
    (junction,) = (poi.id for poi in after.pois.values() if poi.kind == "junction")
    for a, b in (("hall", junction), (junction, "bar")):
        part = edge_between(after, a, b)
        assert part is not None
        assert (part.a, part.b, part.one_way, part.cost_multiplier) == (a, b, True, 2.0)
    fresh = edge_between(after, junction, "room-7")
    assert fresh is not None
    assert (fresh.one_way, fresh.cost_multiplier) == (False, 1.0)
    assert edge_between(after, "hall", "bar") is None
    assert carried.lost_edges == ()


def test_places_follow_the_road_and_keep_what_was_set(
    graph: PoiGraph, corridor: RoadNetwork, with_branch: RoadNetwork
) -> None:
    after = carried_with(graph, corridor, with_branch).graph
    assert after.pois["bar"].spoken_name == "the bar"
    assert not after.pois["kiosk"].on_road
    for key in ("hall", "bar"):
        poi = after.pois[key]
        assert with_branch.nearest(poi.x_m, poi.y_m).distance_m < 1e-6
        assert np.hypot(poi.x_m - graph.pois[key].x_m, poi.y_m - graph.pois[key].y_m) < 0.3


def test_a_place_moves_with_the_map_under_it(graph: PoiGraph, corridor: RoadNetwork) -> None:
    carried = carried_over(graph, {}, {"bar": (18.0, 0.1), "kiosk": (3.5, 9.5)}, corridor, corridor)
    assert carried.graph.pois["bar"].x_m == pytest.approx(18.0, abs=0.01)
    assert carried.graph.pois["bar"].y_m == pytest.approx(0.0, abs=0.01)
    assert (carried.graph.pois["kiosk"].x_m, carried.graph.pois["kiosk"].y_m) == (3.5, 9.5)
    validate(carried.graph)


def test_where_no_road_leads_any_more_a_place_stands_free(graph: PoiGraph, corridor: RoadNetwork) -> None:
    shorter = RoadNetwork.from_roads([CORRIDOR / 2])
    carried = carried_over(graph, {}, {}, corridor, shorter)
    assert carried.off_road == ("bar",)
    assert carried.lost_edges == ("e1",)
    assert not carried.graph.edges
    validate(carried.graph)
    nowhere = carried_over(graph, {}, {}, corridor, RoadNetwork.from_roads([]))
    assert set(nowhere.off_road) == {"hall", "bar"}
    assert not nowhere.graph.edges


def test_what_was_deleted_stays_deleted(graph: PoiGraph, corridor: RoadNetwork) -> None:
    without = delete_edge(graph, "e1")
    assert not carried_over(without, {}, {}, corridor, corridor).graph.edges


def test_a_road_that_did_not_lead_there_before_is_proposed(corridor: RoadNetwork) -> None:
    near, far = np.array([[0.0, 0.0], [7.0, 0.0]]), np.array([[13.0, 0.0], [20.0, 0.0]])
    halves = RoadNetwork.from_roads([near, far])
    graph = add_poi(PoiGraph(), halves, name="Hall", kind="hall", x_m=0.5, y_m=0.0)
    graph = add_poi(graph, halves, name="Bar", kind="bar", x_m=19.5, y_m=0.0)
    after = carried_over(graph, {}, {}, halves, corridor).graph
    edge = edge_between(after, "hall", "bar")
    assert edge is not None
    assert edge.length_m == pytest.approx(19.0, abs=0.1)


def test_a_place_named_again_is_the_same_place(
    graph: PoiGraph, corridor: RoadNetwork, with_branch: RoadNetwork
) -> None:
    once = carried_with(graph, corridor, with_branch, Mark(8.0, "room", "Room 7")).graph
    again = carried_with(once, with_branch, with_branch, Mark(7.0, "room", "Room 7"), Mark(3.0, "room", "Room 7"))
    assert [poi.name for poi in again.graph.pois.values()].count("Room 7") == 2
    validate(again.graph)


def test_a_junction_that_was_deleted_does_not_come_back(
    graph: PoiGraph, corridor: RoadNetwork, with_branch: RoadNetwork
) -> None:
    del corridor
    assert places_to_add(graph, (), np.zeros(0), np.zeros((0, 3)), with_branch, with_branch) == {}
