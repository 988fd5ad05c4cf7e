"""Places named by walking along the road: laws over many starts and distances, and the road's ends."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.errors import InputError, PlanningError
from navcore.planning.road_network import RoadNetwork
from navcore.planning.road_walk import place_along, place_towards


def line(*corners: tuple[float, float]) -> np.ndarray:
    """Points every 0.1 m from corner to corner."""
    parts = [np.linspace(a, b, round(math.dist(a, b) / 0.1) + 1) for a, b in itertools.pairwise(corners)]
    return np.vstack(parts)


CORRIDORS = RoadNetwork.from_roads([line((0.0, 0.0), (20.0, 0.0)), line((10.0, 0.0), (10.0, 8.0))])


@given(start=st.floats(0.0, 20.0), target=st.floats(0.0, 20.0), share=st.floats(0.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_walking_so_far_towards_a_place_ends_that_far_from_the_start_and_nearer_to_the_place(
    start: float, target: float, share: float
) -> None:
    one, other = CORRIDORS.nearest(start, 0.0), CORRIDORS.nearest(target, 0.0)
    way_m = CORRIDORS.shortest_piece(one, other).length_m
    there = CORRIDORS.nearest(*place_towards(CORRIDORS, one, other, share * way_m))
    assert there.distance_m == pytest.approx(0.0, abs=1e-6)
    assert CORRIDORS.shortest_piece(one, there).length_m == pytest.approx(share * way_m, abs=0.05)
    assert CORRIDORS.shortest_piece(there, other).length_m == pytest.approx((1.0 - share) * way_m, abs=0.05)


@given(start=st.floats(1.0, 8.0), distance_m=st.floats(0.01, 11.0))
@settings(max_examples=60, deadline=None)
def test_walking_away_from_a_place_goes_straight_on_past_a_junction(start: float, distance_m: float) -> None:
    hall, beginning = CORRIDORS.nearest(start, 0.0), CORRIDORS.nearest(0.0, 0.0)
    x_m, y_m = place_towards(CORRIDORS, hall, beginning, -distance_m)
    # Where corridors meet, their joined centre lines sway a little.
    assert (x_m, y_m) == (pytest.approx(start + distance_m, abs=0.2), pytest.approx(0.0, abs=0.2))


def test_there_is_no_place_beyond_the_end_of_the_road() -> None:
    hall, bar = CORRIDORS.nearest(3.0, 0.0), CORRIDORS.nearest(5.0, 0.0)
    with pytest.raises(InputError, match=r"2\.00 m there"):
        place_towards(CORRIDORS, hall, bar, 2.5)
    with pytest.raises(InputError, match=r"3\.00 m there"):
        place_towards(CORRIDORS, hall, bar, -3.5)
    with pytest.raises(InputError, match="finite"):
        place_towards(CORRIDORS, hall, bar, math.nan)
    with pytest.raises(InputError, match=r"4\.00 m there"):
        place_along(line((0.0, 0.0), (4.0, 0.0)), 4.1)
    with pytest.raises(InputError, match="negative"):
        place_along(line((0.0, 0.0), (4.0, 0.0)), -0.1)


def test_roads_that_do_not_meet_are_said_to_be_apart() -> None:
    apart = RoadNetwork.from_roads([line((0.0, 0.0), (4.0, 0.0)), line((0.0, 9.0), (4.0, 9.0))])
    one, other = apart.nearest(1.0, 0.0), apart.nearest(1.0, 9.0)
    with pytest.raises(PlanningError, match="does not join"):
        place_towards(apart, one, other, 1.0)
