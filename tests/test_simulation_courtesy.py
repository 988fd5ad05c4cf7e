"""Simulated people who see give way to the walker, as far as there is room."""

from __future__ import annotations

import math

import pytest

from device_agent.simulation.courtesy import Courtesy, Seen, beside_path, given_way
from device_agent.simulation.obstacles import walking_person
from device_agent.simulation.renderer import Placement

DT_S = 0.02


def met(walker_at, *, room_m: float = 5.0, seconds: float = 8.0):
    """Somebody who walks from (6, 0) along −x at 1 m/s, and the walker; return where they were, moment by moment."""
    courtesy, trail = Courtesy(), []
    for k in range(round(seconds / DT_S)):
        now_s = k * DT_S
        on_path = Placement(6.0 - (now_s - courtesy.waited_s), 0.0, math.pi)
        placement = beside_path(on_path, courtesy)
        walker = walker_at(now_s)
        courtesy = given_way(courtesy, placement, Seen(*walker), lambda _x, y: abs(y) <= room_m, DT_S)
        trail.append((placement.x_m, placement.y_m, *walker))
    return trail, courtesy


@pytest.mark.parametrize("y_m", [-0.3, 0.3])
def test_they_step_aside_to_the_other_side_and_pass(y_m: float) -> None:
    trail, courtesy = met(lambda t: (0.8 * t, y_m))
    assert min(math.hypot(x - wx, y - wy) for x, y, wx, wy in trail) > 0.6
    assert max((y for _, y, _, _ in trail), key=abs) * y_m < 0.0
    assert trail[-1][0] < trail[-1][2], "they have passed each other"
    assert math.hypot(*courtesy.aside_m) < 0.5, "and go back to their path"


def test_where_there_is_no_room_they_stop_before_the_walker_and_go_back_after_a_while() -> None:
    trail, _ = met(lambda t: (min(0.8 * t, 1.5), 0.0), room_m=0.1, seconds=12.0)
    assert min(math.hypot(x - wx, y - wy) for x, y, wx, wy in trail) > 0.8
    stopped = min(x for x, *_ in trail)
    assert sum(x < stopped + 0.01 for x, *_ in trail) * DT_S >= 4.0
    assert max(x for x, *_ in trail[-200:]) > stopped + 0.9


def test_nobody_goes_back_into_the_walker_who_stands_where_they_came_from() -> None:
    """They have just turned round at the end of their path, at (0, 0): the walker is on the way that they came."""
    courtesy, walker, room = Courtesy(standing_s=3.9), Seen(0.5, 0.5, 0.0, 0.3), 0.0
    for k in range(200):
        since_s = 0.01 + k * DT_S - courtesy.waited_s
        here, back = (Placement(abs(at_s), 0.0, math.pi if at_s < 0.0 else 0.0) for at_s in (since_s, since_s - DT_S))
        courtesy = given_way(courtesy, here, walker, lambda _x, _y: False, DT_S, back=back)
        room = max(room, here.x_m)
    assert courtesy.standing_s > 4.0 + 3.0, "longer than they would go back for"
    assert room < 0.05


def test_nobody_steps_aside_along_the_walkers_way() -> None:
    """They face across the walker's way, and stand beside it: that leaves more room than to keep step."""
    courtesy, nearest_m = Courtesy(), math.inf
    for k in range(150):
        placement = beside_path(Placement(0.0, 0.0, math.pi), courtesy)
        assert placement is not None
        seen = Seen(-0.75 + 0.15 * k * DT_S, -0.5 + 0.82 * k * DT_S, 0.15, 0.82)
        courtesy = given_way(courtesy, placement, seen, lambda _x, _y: True, DT_S)
        nearest_m = min(nearest_m, math.hypot(placement.x_m - seen.x_m, placement.y_m - seen.y_m))
    assert nearest_m > 0.6


def test_who_is_far_away_or_behind_is_not_given_way() -> None:
    for walker in ((-5.0, 0.0), (9.0, 0.0)):
        trail, courtesy = met(lambda _t, at=walker: at, seconds=3.0)
        assert courtesy == Courtesy()
        assert trail[-1][0] == pytest.approx(3.0, abs=0.05)


def test_who_has_walked_their_way_stands_for_a_while_before_they_come_back() -> None:
    mover = walking_person(((0.0, 0.0), (4.0, 0.0)), 1.0, start_s=2.0, pause_s=5.0)
    places = {t: mover.placement_at(float(t)).x_m for t in (0, 2, 4, 6, 8, 10.9, 12, 15, 19, 20, 21)}
    assert places == pytest.approx(
        {0: 0.0, 2: 0.0, 4: 2.0, 6: 4.0, 8: 4.0, 10.9: 4.0, 12: 3.0, 15: 0.0, 19: 0.0, 20: 0.0, 21: 1.0}
    )


@pytest.mark.parametrize("speed_m_s", [0.6, 0.9])
@pytest.mark.parametrize("gap_m", [1.0, 1.6, 2.2])
def test_nobody_steps_into_the_walkers_way_right_before_them(speed_m_s: float, gap_m: float) -> None:
    """Somebody comes from the side, along +y; the walker goes along +x and would be there at the same time."""
    courtesy, nearest_m, walker_x = Courtesy(), math.inf, -gap_m
    for k in range(400):
        placement = beside_path(Placement(0.0, -1.2 + 0.9 * (k * DT_S - courtesy.waited_s), math.pi / 2), courtesy)
        assert placement is not None
        walker_x += speed_m_s * DT_S
        seen = Seen(walker_x, 0.0, speed_m_s, 0.0)
        courtesy = given_way(courtesy, placement, seen, lambda _x, _y: True, DT_S)
        nearest_m = min(nearest_m, math.hypot(placement.x_m - walker_x, placement.y_m))
    assert nearest_m > 0.6
    assert placement.y_m > 1.0, "afterwards they go on"


def test_who_is_in_the_lane_stands_before_somebody_who_comes_at_a_slant() -> None:
    """The walker comes towards them at 0.9 m/s and crosses their way: to go on would leave no room."""
    angle_rad = math.radians(22.0)
    vx_m_s, vy_m_s = 0.9 * math.cos(angle_rad), 0.9 * math.sin(angle_rad)
    courtesy, nearest_m = Courtesy(), math.inf
    for k in range(100):
        placement = beside_path(Placement(3.0 - (k * DT_S - courtesy.waited_s), 0.7, math.pi), courtesy)
        assert placement is not None
        seen = Seen(vx_m_s * k * DT_S, vy_m_s * k * DT_S, vx_m_s, vy_m_s)
        courtesy = given_way(courtesy, placement, seen, lambda _x, _y: False, DT_S)
        nearest_m = min(nearest_m, math.hypot(placement.x_m - seen.x_m, placement.y_m - seen.y_m))
    assert courtesy.waited_s > 0.5
    assert nearest_m > 0.3


@pytest.mark.parametrize("walker_m_s", [0.5, 0.9])
def test_who_is_before_the_walker_walks_faster_where_the_walker_comes_too_near_from_the_side(walker_m_s: float) -> None:
    """Both go along −x, side by side, and the walker comes nearer at a slant; there is no room to step aside."""
    vx_m_s, vy_m_s = -walker_m_s * math.cos(0.6), -walker_m_s * math.sin(0.6)
    courtesy, nearest_m = Courtesy(unseen_s=1.0), math.inf  # the walker has just been passed
    for k in range(150):
        placement = beside_path(Placement(-0.1 - 0.9 * (k * DT_S - courtesy.waited_s), 0.0, math.pi), courtesy)
        assert placement is not None
        seen = Seen(vx_m_s * k * DT_S, 0.75 + vy_m_s * k * DT_S, vx_m_s, vy_m_s)
        courtesy = given_way(courtesy, placement, seen, lambda _x, _y: False, DT_S)
        nearest_m = min(nearest_m, math.hypot(placement.x_m - seen.x_m, placement.y_m - seen.y_m))
    assert nearest_m > 0.6, "body to body"
    assert courtesy.waited_s < 0.0


@pytest.mark.parametrize(("unseen_s", "hurries"), [(1.0, True), (10.0, False), (math.inf, False)])
def test_who_has_not_just_seen_the_walker_does_not_know_that_they_come_from_behind(
    unseen_s: float, hurries: bool
) -> None:
    behind = Seen(0.6, 0.6, -0.9, -0.6)
    before = Courtesy(unseen_s=unseen_s)
    courtesy = given_way(before, Placement(0.0, 0.0, math.pi), behind, lambda _x, _y: False, DT_S)
    assert (courtesy.waited_s < 0.0) == hurries


def test_who_sees_the_walker_beside_them_knows_of_them_for_a_while() -> None:
    here, beside, behind = Placement(0.0, 0.0, math.pi), Seen(0.0, 1.0, 0.0, 0.0), Seen(0.6, 0.6, 0.0, 0.0)
    courtesy = given_way(Courtesy(), here, beside, lambda _x, _y: False, DT_S)
    assert courtesy.unseen_s == 0.0
    for _ in range(5):
        courtesy = given_way(courtesy, here, behind, lambda _x, _y: False, DT_S)
    assert courtesy.unseen_s == pytest.approx(5 * DT_S)


@pytest.mark.parametrize(
    ("walker", "walks"),
    [
        pytest.param(Seen(0.3, 0.6, 0.9, 0.0), True, id="they part"),
        pytest.param(Seen(1.1, 0.0, -1.1, 0.0), True, id="the walker is right behind them, and faster"),
        pytest.param(Seen(0.1, 0.65, -0.5, -0.3), False, id="they stand at the end of their path"),
        pytest.param(Seen(0.0, 0.75, -1.05, -0.45), True, id="the walker crosses before them: to stand is better"),
        pytest.param(Seen(0.1, 0.65, 0.0, 0.0), True, id="the walker stands"),
    ],
)
def test_nobody_hurries_where_it_gains_no_room(walker: Seen, walks: bool) -> None:
    """Somebody at (0, 0) on their way along −x, whom the walker has behind them or right beside them."""
    before = Courtesy(unseen_s=0.5)
    courtesy = given_way(before, Placement(0.0, 0.0, math.pi), walker, lambda _x, _y: False, DT_S, walks=walks)
    assert courtesy.waited_s >= 0.0
