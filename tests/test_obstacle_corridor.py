"""Whether a person fits: corridors of their width among things at known places, and what nobody has seen."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore.obstacle.corridor import candidate_directions, clearance_ahead_m
from navcore.settings import ObstacleSettings
from navcore.types import BearingState, CandidateDirection

Place = tuple[float, float]
IMAGE_DEG = np.arange(-30.0, 30.0) + 0.5
"""The bearings of an image, from right to left."""
OBSTACLE = ObstacleSettings()
MAX_M = 6.0
FREE, UNKNOWN = BearingState.FREE, BearingState.UNKNOWN


def polar(*places_m: Place) -> tuple[np.ndarray, np.ndarray]:
    """Bearings and distances of places (along, aside) before the walker."""
    table = np.array(places_m, dtype=float).reshape(-1, 2)
    return np.arctan2(table[:, 1], table[:, 0]), np.hypot(table[:, 0], table[:, 1])


def fan(
    *places_m: Place,
    unknown_deg: tuple[float, ...] = (),
    image_deg: np.ndarray = IMAGE_DEG,
    unseen: tuple[Place, ...] = (),
    chosen: ObstacleSettings = OBSTACLE,
) -> dict[int, CandidateDirection]:
    """D by the degree, among things at places (along, aside), in an image that shows nothing in some bearings."""
    state = np.full(len(image_deg), FREE, dtype=np.int8)
    nearest_m = np.full(len(image_deg), np.inf)
    dark = np.isin(image_deg, unknown_deg)
    state[dark], nearest_m[dark] = UNKNOWN, np.nan
    # Things are as exactly where they are as what is remembered is, and in the image nevertheless.
    bearing, distance = (np.concatenate(both) for both in zip(polar(*places_m), polar(*unseen), strict=True))
    found = candidate_directions(np.radians(image_deg), nearest_m, state, chosen, MAX_M, (bearing, distance))
    assert [each.angle for each in found] == sorted(each.angle for each in found)
    return {round(math.degrees(each.angle)): each for each in found}


# ----------------------------------------------------------------------------------------------- straight ahead
@pytest.mark.parametrize(
    ("places_m", "clear_m"),
    [
        ((), 6.0),
        (((2.0, 0.0),), 2.0),
        (((2.0, 0.34),), 2.0),
        (((2.0, -0.34),), 2.0),
        (((2.0, 0.36),), 6.0),
        (((2.0, -0.36),), 6.0),
        (((2.0, 0.0), (1.5, 0.2), (1.0, 0.4)), 1.5),
        (((7.0, 0.0),), 6.0),
        (((-1.0, 0.1),), 6.0),  # what is behind is not ahead
        (((0.01, 0.2),), 0.01),
    ],
)
def test_how_far_straight_ahead_is_free(places_m: tuple[Place, ...], clear_m: float):
    assert clearance_ahead_m(*polar(*places_m), 0.7, MAX_M) == pytest.approx(clear_m)


def test_a_person_fits_between_things_as_far_apart_as_they_are_wide():
    bearing, distance = np.array([math.pi / 6, -math.pi / 6]), np.array([2.0, 2.0])
    aside_m = float((distance * np.sin(bearing))[0])
    assert clearance_ahead_m(bearing, distance, 2 * aside_m, MAX_M) == MAX_M
    assert clearance_ahead_m(bearing, distance, 2 * aside_m + 1e-9, MAX_M) == pytest.approx(math.sqrt(3.0))


def test_a_direction_leads_between_things_as_far_apart_as_a_person_is_wide():
    bearing, distance = np.array([-math.pi / 6, math.pi / 6]), np.array([1.0, 1.0])
    aside_m = float(np.sin(bearing)[1])
    image = np.radians(IMAGE_DEG), np.full(len(IMAGE_DEG), np.inf), np.full(len(IMAGE_DEG), FREE, dtype=np.int8)
    for wider_m, clear_m in ((0.0, MAX_M), (1e-9, math.cos(math.pi / 6))):
        chosen = ObstacleSettings(person_width_m=2 * aside_m + wider_m)
        (ahead,) = (
            each for each in candidate_directions(*image, chosen, MAX_M, (bearing, distance)) if each.angle == 0.0
        )
        assert ahead.clearance_m == pytest.approx(clear_m)


@pytest.mark.parametrize("nearest_m", [math.inf, math.nan])
def test_what_is_free_or_unknown_is_nowhere(nearest_m: float):
    assert clearance_ahead_m(np.zeros(1), np.array([nearest_m]), 0.7, MAX_M) == MAX_M


# ------------------------------------------------------------------------------------------------------------ D
def test_where_nothing_is_all_is_walkable_but_the_edges_of_the_image():
    """The window of a person's width at δ is 13° wide; of it a third may be beside the image."""
    found = fan()
    assert list(found) == list(range(-27, 28, 3))
    assert {each.clearance_m for each in found.values()} == {MAX_M}
    assert {each.free_width_m for each in found.values()} == {3.0}


@pytest.mark.parametrize(("first_deg", "last_deg", "from_deg", "to_deg"), [(-10, 30, -6, 27), (-30, 10, -27, 6)])
def test_an_image_that_looks_aside_gives_directions_there(first_deg: int, last_deg: int, from_deg: int, to_deg: int):
    assert list(fan(image_deg=np.arange(first_deg, last_deg) + 0.5)) == list(range(from_deg, to_deg + 1, 3))


@pytest.mark.parametrize(("step_deg", "most_deg"), [(3.0, 27), (5.0, 25), (10.0, 20)])
def test_directions_are_a_few_degrees_apart(step_deg: float, most_deg: int):
    found = fan(chosen=ObstacleSettings(candidate_step_deg=step_deg))
    assert list(found) == list(range(-most_deg, most_deg + 1, int(step_deg)))


@pytest.mark.parametrize(
    ("image_deg", "walkable_deg"),
    [
        ((), ()),
        ((0.0,), ()),  # one bearing is not wide enough to see a person's way
        ((-1.0, 1.0), ()),
        ((-7.0, 7.0), (-6, -3, 3, 6)),  # so coarse that one bearing is a window
        ((-5.0, 5.0), (0,)),
    ],
)
def test_an_image_of_few_bearings(image_deg: tuple[float, ...], walkable_deg: tuple[int, ...]):
    found = fan(image_deg=np.array(image_deg))
    if image_deg == (-5.0, 5.0):
        assert 0 in found
    else:
        assert tuple(found) == walkable_deg


@pytest.mark.parametrize(("stop_m", "is_walkable"), [(0.8, True), (0.999, True), (1.0, False), (1.5, False)])
def test_what_is_free_no_farther_than_the_stop_distance_is_not_walkable(stop_m: float, is_walkable: bool):
    found = fan((1.0, 0.0), chosen=ObstacleSettings(stop_distance_m=stop_m))
    assert (0 in found) is is_walkable
    assert is_walkable is False or found[0].clearance_m == 1.0


def test_beside_something_there_is_a_way():
    found = fan((2.0, 0.0))
    assert {angle for angle, each in found.items() if each.clearance_m < MAX_M} == set(range(-9, 10, 3))
    assert found[9].clearance_m == pytest.approx(2.0 * math.cos(math.radians(9)))
    narrow = fan((2.0, 0.0), chosen=ObstacleSettings(person_width_m=0.5))
    assert {angle for angle, each in narrow.items() if each.clearance_m < MAX_M} == set(range(-6, 7, 3))


def test_something_a_step_aside_closes_the_directions_that_pass_it():
    post = (0.9, 0.75)
    found = fan(post)
    closed = {angle for angle in range(-27, 28, 3) if angle not in found}
    assert closed == {angle for angle in range(-27, 28, 3) if _hits_within(post, angle, 0.8)}
    assert {angle for angle, each in found.items() if each.clearance_m < MAX_M} | closed == {
        angle for angle in range(-27, 28, 3) if _hits_within(post, angle, 9.0)
    }
    aside_rad = math.atan2(0.75, 0.9) + math.radians(27)
    assert found[-27].free_width_m == pytest.approx(1.5 + math.hypot(*post) * math.sin(aside_rad))
    assert found[0].free_width_m == pytest.approx(1.5 + 0.75)


@pytest.mark.parametrize("state", [BearingState.OBSTACLE, BearingState.DROP, BearingState.HEARD])
def test_what_is_remembered_beside_the_image_counts_as_what_is_seen(state: BearingState):
    bearing, nearest_m = np.radians(IMAGE_DEG), np.full(len(IMAGE_DEG), np.inf)
    shown, at = nearest_m.copy(), 40
    shown[at] = 2.0
    states = np.full(len(IMAGE_DEG), FREE, dtype=np.int8)
    states[at] = state
    in_image = candidate_directions(bearing, shown, states, OBSTACLE, MAX_M)
    remembered = (bearing[at : at + 1], np.array([2.0]))
    assert candidate_directions(bearing, nearest_m, states, OBSTACLE, MAX_M, remembered) == in_image
    assert min(each.clearance_m for each in in_image) < 2.0


def _hits_within(place: Place, angle_deg: float, until_m: float) -> bool:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return 0.0 < c * place[0] + s * place[1] <= until_m and abs(c * place[1] - s * place[0]) < 0.35


@pytest.mark.parametrize(
    ("unknown", "is_walkable"), [(0, True), (1, True), (3, True), (4, False), (7, False), (13, False)]
)
def test_where_a_third_of_a_persons_window_was_not_seen_nobody_walks(unknown: int, is_walkable: bool):
    """About 0° there are 14 bearings within 6.7°, of which 13 are asked for."""
    window = [each for each in IMAGE_DEG if abs(each) <= math.degrees(math.asin(0.35 / 3.0))]
    assert len(window) == 14
    found = fan(unknown_deg=tuple(window[: unknown + 1]))
    assert (0 in found) is is_walkable


@pytest.mark.parametrize(("dark", "is_walkable"), [(0, True), (4, True), (5, False)])
def test_just_a_third_may_be_dark_and_the_window_has_its_edges(dark: int, is_walkable: bool):
    """Of 11 bearings 10 are asked for, and 7 of them must show something."""
    half_rad = math.asin(OBSTACLE.person_width_m / 2 / OBSTACLE.clearance_m)
    bearing = np.arange(-10, 11) * (2 * half_rad / 10.5)
    state = np.full(len(bearing), FREE, dtype=np.int8)
    state[8 : 8 + dark] = UNKNOWN
    nearest_m = np.where(state == UNKNOWN, np.nan, np.inf)
    found = candidate_directions(bearing, nearest_m, state, OBSTACLE, MAX_M)
    assert (0.0 in [each.angle for each in found]) is is_walkable
    edges = np.array([-half_rad, half_rad])
    coarse = candidate_directions(edges, np.full(2, np.inf), np.full(2, FREE, dtype=np.int8), OBSTACLE, MAX_M)
    assert 0.0 in [each.angle for each in coarse]


def test_a_wider_person_and_a_nearer_delta_need_a_wider_window():
    dark = tuple(each for each in IMAGE_DEG if each > 10.0)
    for chosen in (OBSTACLE, ObstacleSettings(person_width_m=1.2), ObstacleSettings(clearance_m=1.0)):
        half_deg = math.degrees(math.asin(chosen.person_width_m / 2 / chosen.clearance_m))
        asked = 0.7 * int(2 * half_deg)
        seen = {a: sum(abs(each - a) <= half_deg for each in IMAGE_DEG if each < 10.0) for a in range(-27, 28, 3)}
        assert set(fan(unknown_deg=dark, chosen=chosen)) == {a for a, count in seen.items() if count >= asked}


@pytest.mark.parametrize(
    ("places_m", "width_m"),
    [
        (((1.0, 0.5), (1.0, -0.6)), 1.1),
        (((1.0, 0.5),), 2.0),
        (((1.0, -0.6),), 2.1),
        (((2.9, 0.5),), 2.0),
        (((3.1, 0.5),), 3.0),  # beyond δ
        (((2.0, 0.0), (2.5, 0.5)), 3.0),  # beyond what is free
        (((2.0, 0.0), (1.5, 0.5)), 2.0),
        (((1.0, 2.0),), 3.0),  # farther aside than anybody needs
        (((-0.5, 0.5),), 3.0),  # passed
    ],
)
def test_how_wide_the_way_is_as_far_as_it_is_free(places_m: tuple[Place, ...], width_m: float):
    assert fan(*places_m)[0].free_width_m == pytest.approx(width_m)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0.3, 6.0), st.floats(-1.4, 1.4)), max_size=8), st.booleans())
def test_in_the_corridor_of_a_direction_nothing_is_nearer_than_it_says(places_m: list[Place], mirrored: bool):
    places_m = [(x, -y if mirrored else y) for x, y in places_m]
    found = fan(*places_m)
    for angle_deg, each in found.items():
        c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
        inside = [c * x + s * y for x, y in places_m if abs(c * y - s * x) < 0.35 - 1e-9 and c * x + s * y > 0.0]
        assert each.clearance_m <= min([*inside, MAX_M]) + 1e-9
        assert OBSTACLE.stop_distance_m < each.clearance_m <= MAX_M
        assert OBSTACLE.person_width_m - 1e-9 <= each.free_width_m <= 3.0
    closed = set(range(-27, 28, 3)) - set(found)
    assert all(any(_hits_within(each, angle, 0.8 + 1e-9) for each in places_m) for angle in closed)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.3, 6.0), st.floats(0.001, 1.4), st.sampled_from([1, -1])), max_size=8),
    st.sets(st.sampled_from(IMAGE_DEG.tolist())),
)
def test_directions_mirror_with_what_is_there(places: list[tuple[float, float, int]], unknown: set[float]):
    one = fan(*((x, side * y) for x, y, side in places), unknown_deg=tuple(unknown))
    other = fan(*((x, -side * y) for x, y, side in places), unknown_deg=tuple(-each for each in unknown))
    assert {-angle for angle in one} == set(other)
    for angle, each in one.items():
        assert other[-angle].clearance_m == pytest.approx(each.clearance_m)
        assert other[-angle].free_width_m == pytest.approx(each.free_width_m)
