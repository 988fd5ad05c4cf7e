"""Lines drawn by hand: they meet the recorded road, and never move it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.planning import edits, road_edits
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_edits import network_of, recorded_roads
from navcore.planning.road_network import RoadNetwork

CORRIDOR = np.column_stack([np.linspace(0, 20, 201), 0.1 * np.sin(np.linspace(0, 20, 201))])
BRANCH = np.column_stack([np.full(81, 8.0), np.linspace(0, 8, 81)])
RECORDED = RoadNetwork.from_roads([CORRIDOR, BRANCH])


def with_lines(*lines: list[tuple[float, float]]) -> RoadNetwork:
    return RoadNetwork.from_roads([CORRIDOR, BRANCH], drawn_m=[np.array(line) for line in lines])


def way_m(network: RoadNetwork, start: tuple[float, float], end: tuple[float, float]) -> float:
    return network.shortest_piece(network.nearest(*start), network.nearest(*end)).length_m


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(st.tuples(st.floats(-4, 24), st.floats(-4, 12)), min_size=2, max_size=5), max_size=4))
def test_whatever_is_drawn_the_recorded_road_stays_where_it_is_and_in_one_piece(lines) -> None:
    network = RoadNetwork.from_roads([CORRIDOR, BRANCH], drawn_m=[np.array(line, dtype=float) for line in lines])
    for x, y in RECORDED.vertices_m.tolist():
        assert network.nearest(x, y).distance_m < 1e-6
    assert way_m(network, (0.0, 0.0), (8.0, 8.0)) <= way_m(RECORDED, (0.0, 0.0), (8.0, 8.0)) + 1e-6
    joined = all(
        min(RECORDED.nearest(*map(float, point)).distance_m for point in line) < 0.5 and len(line) > 1 for line in lines
    )
    if joined and lines:
        assert network.component_count() <= 1 + len(lines)


def test_a_line_between_two_roads_can_be_walked_at_both_ends() -> None:
    network = with_lines([(14.0, 0.3), (14.0, 6.0), (8.2, 6.0)])
    assert network.component_count() == 1
    assert way_m(network, (14.0, 3.0), (8.0, 6.0)) == pytest.approx(9.0, abs=0.15)
    assert way_m(network, (14.0, 3.0), (16.0, 0.0)) == pytest.approx(5.0, abs=0.25)


def test_a_line_across_a_road_is_a_crossing() -> None:
    network = with_lines([(4.0, -4.0), (4.0, 4.0)])
    assert network.component_count() == 1
    assert way_m(network, (4.0, -4.0), (4.0, 4.0)) == pytest.approx(8.0, abs=0.1)
    assert way_m(network, (4.0, 4.0), (6.0, 0.0)) == pytest.approx(6.0, abs=0.2)


def test_what_is_drawn_along_a_road_is_that_road() -> None:
    assert with_lines([(1.0, 0.2), (15.0, 0.3)]).length_m == pytest.approx(RECORDED.length_m, abs=0.01)
    twice = with_lines([(14.0, 0.0), (14.0, 6.0)], [(14.1, 0.0), (14.1, 6.0)])
    assert twice.length_m == pytest.approx(with_lines([(14.0, 0.0), (14.0, 6.0)]).length_m, abs=0.05)


def test_a_line_far_from_every_road_is_a_road_of_its_own_and_the_first_one_as_well() -> None:
    assert with_lines([(0.0, 20.0), (5.0, 20.0)]).component_count() == 2
    alone = RoadNetwork.from_roads([], drawn_m=[np.array([(0.0, 0.0), (3.0, 4.0)])])
    assert alone.length_m == pytest.approx(5.0)


def test_drawing_moves_no_place_and_deleting_leaves_everything_as_it_was() -> None:
    graph = PoiGraph(roads=recorded_roads([CORRIDOR, BRANCH]))
    for name, x_m, y_m in (("A", 2.0, 0.0), ("B", 8.0, 7.9), ("C", 19.9, 0.0)):
        graph = edits.add_poi(graph, network_of(graph.roads), name=name, kind="room", x_m=x_m, y_m=y_m)
    graph = edits.propose_edges(graph, network_of(graph.roads))
    drawn = road_edits.draw_road(graph, [(8.0, 7.9), (19.9, 0.0)])
    assert (drawn.pois, drawn.edges) == (graph.pois, graph.edges)
    left = road_edits.delete_road(drawn, "r3")
    assert (left.pois, left.edges, left.roads) == (graph.pois, graph.edges, graph.roads)
    network = network_of(drawn.roads)
    assert way_m(network, (8.0, 7.9), (19.9, 0.0)) == pytest.approx(math.dist((8.0, 7.9), (19.9, 0.0)), abs=0.3)
