"""Recorded walks become one road: no rungs, no zig-zag, junctions kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.errors import InputError, PlanningError
from navcore.planning.road_network import RoadNetwork


def walked(corners: list[tuple[float, float]], aside_m: float = 0.0, sway_m: float = 0.03) -> np.ndarray:
    """A recorded walk along corners, that far to the left of them, with the sway of a gait."""
    points, length_m = [], 0.0
    for a, b in zip(np.array(corners[:-1]), np.array(corners[1:]), strict=True):
        leg_m = float(np.hypot(*(b - a)))
        along = np.arange(0.0, leg_m, 0.05)
        direction = (b - a) / leg_m
        left = np.array([-direction[1], direction[0]])
        sway = aside_m + sway_m * np.sin((length_m + along) * 9.0)
        points.append(a + along[:, None] * direction + sway[:, None] * left)
        length_m += leg_m
    return np.vstack(points)


CORRIDOR = [(0.0, 0.0), (12.0, 0.0), (12.0, 8.0)]
CROSSING = [(6.0, -5.0), (6.0, 5.0)]


def junctions(network: RoadNetwork) -> np.ndarray:
    degree = np.bincount(network.segments.ravel(), minlength=len(network.vertices_m))
    return network.vertices_m[degree > 2]


def dead_ends(network: RoadNetwork) -> np.ndarray:
    degree = np.bincount(network.segments.ravel(), minlength=len(network.vertices_m))
    return network.vertices_m[degree == 1]


@pytest.mark.parametrize("aside_m", [0.0, 0.1, 0.2, 0.25])
def test_a_corridor_walked_both_ways_is_one_road(aside_m: float):
    there, back = walked(CORRIDOR, aside_m), walked(CORRIDOR[::-1], aside_m)
    network = RoadNetwork.from_roads([there, back])
    assert network.component_count() == 1
    assert len(junctions(network)) == 0
    assert len(dead_ends(network)) == 2
    assert network.length_m == pytest.approx(20.0, abs=0.8)
    steps = np.diff(network.polylines()[0], axis=0)
    bends = np.abs(np.angle(np.exp(1j * np.diff(np.arctan2(steps[:, 1], steps[:, 0])))))
    assert np.degrees(bends[3:-3].max()) < 25.0, "no zig-zag: a corner is a curve of several points"


def test_a_crossing_is_one_junction_and_joins_the_roads():
    network = RoadNetwork.from_roads([walked(CORRIDOR), walked(CORRIDOR[::-1], 0.2), walked(CROSSING, 0.1)])
    assert network.component_count() == 1
    meeting = junctions(network)
    assert len(meeting)
    assert np.hypot(*(meeting - (6.0, 0.0)).T).max() < 0.5
    assert len(dead_ends(network)) == 4


def test_a_loop_stays_a_loop():
    loop = [(0.0, 0.0), (8.0, 0.0), (8.0, 6.0), (0.0, 6.0), (0.0, 0.0)]
    network = RoadNetwork.from_roads([walked(loop), walked(loop, 0.2)])
    assert network.component_count() == 1
    assert len(dead_ends(network)) == 0
    assert network.length_m == pytest.approx(27.2, abs=1.5), (
        "both walks keep left of the centre line, and corners are rounded"
    )


def test_corridors_farther_apart_than_the_merge_distance_stay_apart():
    network = RoadNetwork.from_roads([walked([(0, 0), (10, 0)]), walked([(0, 1.5), (10, 1.5)])])
    assert network.component_count() == 2
    with pytest.raises(PlanningError, match="does not join"):
        network.shortest_piece(network.nearest(5, 0), network.nearest(5, 1.5))


def test_the_order_and_direction_of_the_walks_do_not_matter():
    walks = [walked(CORRIDOR), walked(CROSSING, 0.1), walked(CORRIDOR[::-1], 0.2)]
    one = RoadNetwork.from_roads(walks)
    other = RoadNetwork.from_roads([walk[::-1] for walk in walks[::-1]])
    assert one.length_m == pytest.approx(other.length_m, abs=0.02)


@settings(max_examples=40, deadline=None)
@given(st.floats(-3, 15), st.floats(-7, 10), st.floats(-3, 15), st.floats(-7, 10))
def test_nearest_and_shortest_piece_agree_with_brute_force(ax: float, ay: float, bx: float, by: float):
    network = _network()
    a, b = network.nearest(ax, ay), network.nearest(bx, by)
    for point, x, y in ((a, ax, ay), (b, bx, by)):
        ends = network.vertices_m[network.segments]
        fractions = np.linspace(0, 1, 21)[:, None, None]
        dense = (ends[:, 0] + fractions * (ends[:, 1] - ends[:, 0])).reshape(-1, 2)
        assert point.distance_m <= np.hypot(*(dense - (x, y)).T).min() + 1e-9
        assert point.distance_m == pytest.approx(math.dist(point.xy_m, (x, y)), abs=1e-9)
    there, back = network.shortest_piece(a, b), network.shortest_piece(b, a)
    assert there.length_m == pytest.approx(back.length_m, abs=1e-6)
    assert there.length_m >= math.dist(a.xy_m, b.xy_m) - 1e-9
    assert tuple(there.path_m[0]) == pytest.approx(a.xy_m)
    assert tuple(there.path_m[-1]) == pytest.approx(b.xy_m)
    assert np.hypot(*np.diff(there.path_m, axis=0).T).max() < 0.12 or len(there.path_m) == 2


_NETWORKS: list[RoadNetwork] = []


def _network() -> RoadNetwork:
    if not _NETWORKS:
        _NETWORKS.append(RoadNetwork.from_roads([walked(CORRIDOR), walked(CORRIDOR[::-1], 0.2), walked(CROSSING)]))
    return _NETWORKS[0]


def test_bad_roads_are_refused_and_no_road_is_said():
    with pytest.raises(InputError, match="coordinates"):
        RoadNetwork.from_roads([np.zeros((3, 4))])
    with pytest.raises(InputError, match="not a number"):
        RoadNetwork.from_roads([np.array([[0.0, math.nan], [1.0, 1.0]])])
    empty = RoadNetwork.from_roads([])
    assert empty.is_empty
    with pytest.raises(PlanningError, match="no virtual blind road"):
        empty.nearest(0, 0)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(-20, 30), st.floats(-20, 30)), max_size=12))
def test_many_places_at_once_are_as_far_from_the_road_as_each_alone(places: list[tuple[float, float]]) -> None:
    network = RoadNetwork.from_roads([walked(CORRIDOR), walked(CROSSING)])
    far = network.distances_m(np.array(places).reshape(-1, 2))
    assert far.tolist() == pytest.approx([network.nearest(x, y).distance_m for x, y in places], abs=1e-9)
    nothing = RoadNetwork.from_roads([])
    assert np.isinf(nothing.distances_m(np.array(places).reshape(-1, 2))).all()
