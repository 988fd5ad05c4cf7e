"""The order of the checks in guidance, and its memory."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from closed_loop import CAMERA, EYE_M, PITCH_RAD, box, depth_image, route_along

from navcore.angles import relative_angle, world_angle
from navcore.follower.direction import widest_direction
from navcore.follower.look import LOOK_ROUND_AFTER_S, LOOK_ROUND_FOR_S
from navcore.geometry import Transform, world_from_camera_at
from navcore.guide import guide
from navcore.obstacle.corridor import candidate_directions
from navcore.obstacle.memory import ObstacleMemory, remember, with_memory
from navcore.obstacle.polar_grid import MAX_RANGE_M
from navcore.obstacle.scan import scan
from navcore.settings import Settings
from navcore.types import (
    Action,
    BearingState,
    Guidance,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Reason,
    SonarReading,
    SonarState,
    TurnKind,
)

SETTINGS = Settings()
ROUTE = route_along((0, 0), (12, 0))
FREE = (box(-20, -20, 20, -15),)


def at(x_m: float, y_m: float = 0.0, heading_deg: float = 0.0, stamp_s: float = 0.0, quality: str = "localized"):
    camera = world_from_camera_at((x_m, y_m, EYE_M), math.radians(heading_deg), PITCH_RAD)
    return Localization(stamp_s, LocalizationQuality(quality), None if quality == "lost" else camera)


def seen(located: Localization, *solids) -> ObstacleScan:
    assert located.world_from_camera is not None
    return scan(
        depth_image((*FREE, *solids), located.world_from_camera), CAMERA, located.world_from_camera, SETTINGS.obstacle
    )


def decide(located: Localization, found: ObstacleScan, before: Guidance | None = None, **changes) -> Guidance:
    sonar = changes.pop("sonar", SonarReading(located.stamp_s, SonarState.NO_ECHO))
    route, settings = changes.pop("route", ROUTE), changes.pop("settings", SETTINGS)
    return guide(located.stamp_s, located, route, found, sonar, before, settings, **changes)


def test_a_free_way_is_walked_straight_on():
    here = at(2.0)
    result = decide(here, seen(here))
    assert (result.action, result.reason) == (Action.WALK, Reason.OK)
    assert result.direction == pytest.approx(0.0)
    assert result.trace.rule
    assert result.trace.remaining_m == pytest.approx(10.0, abs=0.11)


def test_paused_and_no_route_come_before_everything():
    here = at(2.0)
    assert decide(here, seen(here), paused=True).reason is Reason.PAUSED
    assert decide(here, seen(here), route=None).reason is Reason.NO_ROUTE
    assert decide(here, seen(here), route=None, paused=True).reason is Reason.PAUSED


def test_a_lost_pose_stops_and_an_uncertain_one_carries_on_for_a_short_time():
    here = at(2.0)
    found = seen(here)
    assert decide(at(2.0, quality="lost"), found).reason is Reason.POSE_LOST
    result = None
    for tenth in range(45):
        result = decide(at(2.0, stamp_s=tenth / 10, quality="uncertain"), found, result)
        within = tenth / 10 <= SETTINGS.localization.uncertain_hold_s
        assert (result.action is Action.WALK) == within
    assert result is not None
    assert result.reason is Reason.POSE_LOST
    actions = []
    for tenth in range(50, 53):
        result = decide(at(2.0, stamp_s=tenth / 10), found, result)
        actions.append(result.action)
    assert actions == [Action.STOP, Action.STOP, Action.WALK], "no stop and go with every frame"


def test_after_a_lost_pose_an_uncertain_one_is_not_enough():
    here = at(2.0)
    found = seen(here)
    result = decide(at(2.0, stamp_s=0.1, quality="lost"), found, decide(here, found))
    for tenth in range(2, 20):
        result = decide(at(2.0, stamp_s=tenth / 10, quality="uncertain"), found, result)
        assert (result.action, result.reason) == (Action.STOP, Reason.POSE_LOST)
    for tenth in range(20, 23):
        result = decide(at(2.0, stamp_s=tenth / 10), found, result)
    assert result.action is Action.WALK


def test_a_moment_of_loss_does_not_renew_the_time_for_which_an_uncertain_pose_is_followed():
    here = at(2.0)
    found, result = seen(here), None
    for tenth in range(60):
        quality = "lost" if tenth % 7 == 6 else "uncertain"
        result = decide(at(2.0, stamp_s=tenth / 10, quality=quality), found, result)
    assert result is not None
    assert result.trace.uncertain_since_s == 0.0
    assert result.reason is Reason.POSE_LOST


def test_a_pose_that_is_no_number_is_lost():
    here = at(2.0)
    assert here.world_from_camera is not None
    matrix = here.world_from_camera.matrix.copy()
    matrix[0, 3] = np.nan
    assert decide(replace(here, world_from_camera=Transform(matrix)), seen(here)).reason is Reason.POSE_LOST


def test_arrival_is_final_for_this_route():
    arrived = decide(at(11.5), seen(at(11.5)))
    assert (arrived.action, arrived.reason) == (Action.STOP, Reason.ARRIVED)
    drifted = at(10.5, stamp_s=0.1)
    assert decide(drifted, seen(drifted), arrived).reason is Reason.ARRIVED
    assert decide(drifted, seen(drifted), arrived, route_version=1).action is Action.WALK


def test_who_faces_away_is_turned_on_the_spot_even_before_a_wall():
    here = at(2.0, heading_deg=170)
    result = decide(here, seen(here, box(1.0, -2, 1.5, 2)))
    assert result.action is Action.TURN
    assert math.degrees(result.direction or 0.0) == pytest.approx(-170, abs=1.0)


def test_turns_to_the_other_side_are_counted_until_a_step_is_told():
    result, counts = decide(at(2.0, 0.0, 60.0), seen(at(2.0, 0.0, 60.0))), []
    for tenth, heading_deg in enumerate((50.0, -50.0, -60.0, 50.0, 0.0, 0.0)):
        here = at(2.0, 0.0, heading_deg, tenth / 10)
        result = decide(here, seen(here), result)
        counts.append((result.action, result.trace.reversals_count))
    turns = [(Action.TURN, count) for count in (0, 1, 1, 2)]
    assert counts == [*turns, (Action.WALK, 0), (Action.WALK, 0)]


def test_who_stands_with_their_back_to_the_way_is_not_turned_to_and_fro():
    """Somebody who talks to somebody behind them sways: to which side they would turn changes, and means nothing."""
    result = None
    for tenth in range(200):
        heading_deg = 180.0 + 45.0 * math.sin(tenth / 4.0)
        here = at(2.0, 0.0, heading_deg, tenth / 10)
        result = decide(here, seen(here), result)
        assert result.action is Action.TURN
        assert result.trace.reversals_count == 0


def test_one_frame_stops_and_three_are_needed_to_leave():
    here = at(2.0)
    blocked, free = seen(here, box(2.6, -3, 3.0, 3)), seen(here)
    walking = decide(here, free)
    stopped = decide(at(2.0, stamp_s=0.1), blocked, walking)
    assert (stopped.action, stopped.reason) == (Action.STOP, Reason.OBSTACLE_DEPTH)
    result, actions = stopped, []
    for frame in range(3):
        result = decide(at(2.0, stamp_s=0.2 + frame / 10), free, result)
        actions.append(result.action)
    assert actions == [Action.STOP, Action.STOP, Action.WALK]


def test_invalid_depth_stops():
    here = at(2.0)
    nothing = scan(np.full((120, 160), np.nan, np.float32), CAMERA, here.world_from_camera, SETTINGS.obstacle)
    assert decide(here, nothing).reason is Reason.DEPTH_INVALID
    broken = replace(seen(here), valid_fraction=math.nan)
    assert decide(here, broken).reason is Reason.DEPTH_INVALID


def test_a_drop_stops_and_says_so():
    here = at(2.0)
    assert here.world_from_camera is not None
    depth = depth_image(FREE, here.world_from_camera)
    # The floor ends two metres ahead, one step (0.25 m) down.
    lower = depth_image(FREE, world_from_camera_at((2.0, 0.0, EYE_M + 0.25), 0.0, PITCH_RAD))
    rows = np.arange(CAMERA.height_px)
    depression = PITCH_RAD + np.arctan2(rows - CAMERA.cy_px, CAMERA.fy_px)
    beyond = np.tan(np.maximum(depression, 1e-3)) < EYE_M / 2.0
    depth[beyond] = lower[beyond]
    found = scan(depth, CAMERA, here.world_from_camera, SETTINGS.obstacle)
    assert found.nearest_ahead_m == pytest.approx(2.0, abs=0.25)
    assert decide(here, found).reason is Reason.DROP_AHEAD


def test_glass_is_heard_not_seen():
    here = at(2.0)
    found = seen(here)
    glass = SonarReading(0.0, SonarState.OK, 1.5)
    assert decide(here, found, sonar=glass).reason is Reason.OBSTACLE_SONAR
    assert decide(here, found, sonar=SonarReading(-1.0, SonarState.OK, 1.5)).action is Action.WALK, "a stale echo"
    assert decide(here, found, sonar=None).action is Action.WALK


def test_guidance_is_a_pure_function():
    here = at(3.0, 0.4, 12.0)
    found = seen(here, box(5, -0.3, 5.5, 0.3))
    assert decide(here, found) == decide(here, found)


def test_the_memory_of_another_route_is_dropped():
    here = at(2.0)
    first = decide(here, seen(here), route_version=1)
    stale = replace(first, trace=replace(first.trace, closest_index=119))
    assert decide(here, seen(here), stale, route_version=2).trace.closest_index == 20
    assert decide(here, seen(here), stale, route_version=1).trace.closest_index != 20


def test_how_somebody_walks_is_remembered_when_the_route_changes():
    """At 1.0 m/s, and a wall 1.6 m ahead, in the frame in which another route is planned."""
    before, here = walking_at(1.0)
    found = seen(here, box(3.6, -3, 3.8, 3))
    same, other = (decide(here, found, before, route_version=version) for version in (0, 1))
    assert other.trace.speed_m_s == same.trace.speed_m_s > 0.9
    assert other.trace.fastest_m_s == same.trace.fastest_m_s
    assert other.trace.stop_m == same.trace.stop_m
    assert same.action is other.action is not Action.WALK


def test_who_gains_speed_has_room_to_stop_from_the_speed_that_they_have_and_not_from_the_one_that_is_measured():
    x_m, speed_m_s, result, gains_m_s2 = 1.0, 0.0, None, 0.6
    reaction_s, usual_m_s = SETTINGS.obstacle.slow_reaction_s, 0.85
    for tenth in range(14):
        here = at(x_m, stamp_s=tenth / 10)
        result = decide(here, seen(here), result)
        assert result.action is Action.WALK
        if tenth > 2:
            gains_s = min(reaction_s, (usual_m_s - speed_m_s) / gains_m_s2)
            then_m_s = speed_m_s + gains_m_s2 * gains_s
            goes_m = (speed_m_s + then_m_s) / 2.0 * gains_s + then_m_s * (reaction_s - gains_s) + then_m_s**2 / 2.4
            assert result.trace.stop_m is not None
            assert result.trace.stop_m >= 0.25 + goes_m - 0.03, f"at {speed_m_s:.2f} m/s"
        gained_m_s = min(usual_m_s, speed_m_s + 0.1 * gains_m_s2)
        x_m, speed_m_s = x_m + 0.1 * (speed_m_s + gained_m_s) / 2.0, gained_m_s


def test_who_is_found_again_goes_on_along_their_own_leg():
    out_and_back = route_along((0, 0), (10, 0), (10, 0.8), (0, 0.8))
    here = at(3.0, 0.3)
    walking = decide(here, seen(here), route=out_and_back)
    assert walking.trace.closest_index == 30
    lost = decide(at(3.0, quality="lost", stamp_s=0.1), seen(here), walking, route=out_and_back)
    assert (lost.trace.closest_index, lost.trace.lost_index) == (None, 30)
    lost = decide(at(3.0, quality="lost", stamp_s=0.2), seen(here), lost, route=out_and_back)
    assert lost.trace.lost_index == 30
    found = decide(at(3.2, 0.45, stamp_s=0.3), seen(here), lost, route=out_and_back)
    assert (found.trace.closest_index, found.trace.lost_index) == (32, None)


def test_who_is_lost_for_long_is_turned_round_once_on_the_spot_and_never_sent_on():
    walking = decide(at(3.0), seen(at(3.0)))
    before, actions = walking, []
    for tenth in range(1, 600):
        lost = at(3.0, quality="lost", stamp_s=tenth / 10)
        before = decide(lost, seen(at(3.0)), before)
        assert before.reason is Reason.POSE_LOST
        actions.append(before.action)
    assert set(actions) == {Action.STOP, Action.TURN}
    turned = [k / 10 for k, action in enumerate(actions) if action is Action.TURN]
    assert turned[0] == pytest.approx(LOOK_ROUND_AFTER_S, abs=0.2)
    assert turned[-1] - turned[0] == pytest.approx(LOOK_ROUND_FOR_S, abs=0.3)
    assert len(turned) == round(10 * (turned[-1] - turned[0])) + 1, "without a break"


def test_who_is_found_while_looking_round_is_led_on_only_after_several_frames():
    walking = decide(at(3.0), seen(at(3.0)))
    before = walking
    for tenth in range(1, 80):
        lost = at(3.0, quality="lost", stamp_s=tenth / 10)
        before = decide(lost, seen(at(3.0)), before)
    assert before.action is Action.TURN
    actions = []
    for tenth in range(80, 84):
        here = at(3.0, stamp_s=tenth / 10)
        before = decide(here, seen(here), before)
        actions.append(before.action)
    assert Action.WALK not in actions[:2]
    assert actions[-1] is Action.WALK


def test_a_destination_behind_is_a_turn_around_by_one_side():
    before, sides = None, set()
    for tenth, sway_deg in enumerate((178, 181, 179, 183, 177, 182)):
        here = at(6.0, heading_deg=sway_deg, stamp_s=tenth / 10)
        before = decide(here, seen(here), before)
        assert (before.action, before.trace.turn) == (Action.TURN, TurnKind.AROUND)
        assert "turn around" in before.trace.rule
        sides.add((before.direction or 0.0) > 0)
    assert len(sides) == 1


def test_who_starts_before_a_wall_is_turned_to_the_route_and_not_stopped():
    here = at(2.0, heading_deg=90)
    result = decide(here, seen(here, box(-5, 0.5, 20, 1.0)), sonar=SonarReading(0.0, SonarState.OK, 0.5))
    assert (result.action, result.trace.turn) == (Action.TURN, TurnKind.ALONG)
    assert math.degrees(result.direction or 0.0) == pytest.approx(-90, abs=1.0)


# ------------------------------------------------------------------------------------- what the walker makes of it
def walking_at(speed_m_s: float, *solids, until_x_m: float = 2.0) -> tuple[Guidance, Localization]:
    """Walk along the route at a speed, seeing nothing, up to a place."""
    result, step_m = None, 0.1 * speed_m_s
    count = 12
    for k in range(count):
        here = at(until_x_m - (count - k) * step_m, stamp_s=k / 10)
        result = decide(here, seen(here), result)
    assert result is not None
    return result, at(until_x_m, stamp_s=count / 10)


def test_who_walks_fast_is_stopped_farther_away():
    wall = box(3.4, -0.6, 3.8, 0.6)
    wide = SETTINGS.changed({"obstacle.clearance_m": 1.0, "obstacle.narrow_clearance_m": 0.85})
    answers = []
    for speed_m_s in (0.4, 1.3):
        before, here = walking_at(speed_m_s, until_x_m=2.0)
        sonar = SonarReading(here.stamp_s, SonarState.NO_ECHO)
        answers.append(guide(here.stamp_s, here, ROUTE, seen(here, wall), sonar, before, wide).action)
    assert answers[0] is Action.WALK
    assert answers[1] is not Action.WALK, "1.3 m/s need 0.7 s and 0.7 m: not 1.4 m less what the estimate lags"


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("policy", ["paper", "road_centred"])
def test_round_something_ahead_leads_only_a_direction_that_is_heard(side: float, policy: str):
    """Its edge is just in the way: 5° beside it would be free, but sounds like straight ahead, which is not."""
    here = at(2.0)
    low, high = sorted((side * 0.2, side * 1.0))
    settings = SETTINGS.changed({"follower.policy": policy})
    sonar = SonarReading(0.0, SonarState.NO_ECHO)
    result = guide(0.0, here, ROUTE, seen(here, box(4.2, low, 4.6, high)), sonar, None, settings)
    assert result.action is Action.WALK
    assert result.direction is not None
    assert math.degrees(-side * result.direction) > SETTINGS.cues.straight_within_deg


def test_what_sounds_like_straight_ahead_passes_the_gate_as_straight_ahead():
    """9° are outside the ultrasonic field; but nobody hears them, and glass is straight ahead."""
    here = at(2.0, heading_deg=-9.0)
    road = SETTINGS.changed({"follower.policy": "road_centred"})
    glass = SonarReading(0.0, SonarState.OK, 1.2)
    result = guide(0.0, here, ROUTE, seen(here), glass, None, road)
    assert (result.action, result.reason) == (Action.STOP, Reason.OBSTACLE_SONAR)


def test_a_turn_round_something_is_left_after_several_free_frames_as_well():
    here = at(2.0)
    beside = seen(here, box(2.75, 0.1, 3.2, 1.5))
    aside = decide(here, beside)
    assert (aside.action, aside.trace.turn) == (Action.TURN, TurnKind.ASIDE)
    result, actions = aside, []
    for tenth in range(1, 4):
        result = decide(at(2.0, stamp_s=tenth / 10), seen(here), result)
        actions.append(result.action)
    assert actions == [Action.TURN, Action.TURN, Action.WALK]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_turn_to_a_free_direction_is_made_to_its_end_though_the_direction_comes_and_goes(side: float):
    """Told to turn, to stop and to turn with every tremble of the pose, somebody stood for good beside a box."""
    low, high = sorted((side * 0.1, side * 1.5))
    aside = decide(at(2.0), seen(at(2.0), box(2.75, low, 3.2, high)))
    assert (aside.action, aside.trace.turn) == (Action.TURN, TurnKind.ASIDE)
    assert aside.direction is not None
    turned_deg, nothing_free = math.degrees(aside.direction), box(2.75, -3.0, 3.2, 3.0)
    half_way, done = (at(2.0, heading_deg=share * turned_deg, stamp_s=0.1) for share in (0.5, 0.95))
    goes_on = decide(half_way, seen(half_way, nothing_free), aside)
    assert (goes_on.action, goes_on.trace.turn) == (Action.TURN, TurnKind.ASIDE)
    assert math.degrees(goes_on.direction or 0.0) == pytest.approx(0.5 * turned_deg)
    ended = decide(done, seen(done, nothing_free), goes_on)
    assert ended.trace.turn is not TurnKind.ASIDE
    assert ended.action is not Action.WALK
    beside_the_road = at(2.0, -0.8 * side, stamp_s=0.1)
    elsewhere = decide(beside_the_road, seen(beside_the_road, nothing_free), aside)
    assert elsewhere.trace.turn is TurnKind.ALONG, "the road leads to the other side by now"


def test_nobody_who_still_walks_is_led_where_less_than_the_clearance_is_free():
    """In a corridor whose end is near to the side, only somebody who stands may begin to walk with less than δ."""
    before, here = walking_at(0.8)
    by_paper = SETTINGS.changed({"follower.policy": "paper"})
    nook = (box(3.9, -0.15, 4.2, 2.0), box(4.3, -2.0, 4.5, 0.0))
    result, began_s = before, None
    for tenth in range(60):
        now = replace(here, stamp_s=here.stamp_s + tenth / 10)
        result = decide(now, seen(now, *nook), result, settings=by_paper)
        if result.action is Action.WALK and (result.trace.required_m or 0.0) < 2.0:
            began_s = tenth / 10
            break
    assert began_s is None or began_s >= 1.0


def test_who_stays_lost_is_turned_once_round_and_never_sent_on():
    here = at(2.0)
    result, actions = decide(here, seen(here)), []
    for tenth in range(1, 900):
        result = decide(at(2.0, stamp_s=tenth / 10, quality="lost"), seen(here), result)
        actions.append((tenth / 10, result.action))
        assert result.reason is Reason.POSE_LOST
    turned_s = [stamp_s for stamp_s, action in actions if action is Action.TURN]
    assert all(action is not Action.WALK for _, action in actions)
    assert turned_s[0] == pytest.approx(4.1, abs=0.11), "most are found again at once"
    assert turned_s[-1] - turned_s[0] == pytest.approx(40.0, abs=0.3)
    assert actions[-1][1] is Action.STOP


@pytest.mark.parametrize("lost_s", [1.0, 4.5])
@pytest.mark.parametrize("headings_deg", [(0.0,) * 20, (90.0, 60.0, 30.0, *(0.0,) * 17)])
def test_one_sure_frame_after_a_loss_is_not_enough_to_walk_on_by_unsure_ones(
    lost_s: float, headings_deg: tuple[float, ...]
):
    result, stamp_s = decide(at(2.0), seen(at(2.0))), 0.0
    while stamp_s < lost_s:
        stamp_s += 0.1
        result = decide(at(2.0, stamp_s=stamp_s, quality="lost"), seen(at(2.0)), result)
    for number, heading_deg in enumerate(headings_deg):
        stamp_s += 0.1
        here = at(2.0, 0.0, heading_deg, stamp_s=stamp_s, quality="localized" if number == 0 else "uncertain")
        result = decide(here, seen(here), result)
        assert result.action is not Action.WALK


def test_who_is_unsure_of_the_place_is_not_led_beside_the_road():
    """A box on the road, and room to pass it: known for sure, a line leads round; else δ must be free."""
    scene = (box(-1, 0.95, 8, 1.15), box(-1, -1.35, 8, -1.15), box(3.9, -0.3, 4.3, 0.3))
    sure, unsure = at(2.0), at(2.0, quality="uncertain")
    assert decide(sure, seen(sure, *scene)).trace.offset_m != 0.0
    assert decide(unsure, seen(unsure, *scene)).trace.offset_m == 0.0


def test_no_direction_is_walked_that_leaves_less_than_the_way_to_stop():
    before, here = walking_at(1.1)
    scene = (box(-1, 0.95, 8, 1.15), box(-1, -1.35, 8, -1.15), box(3.9, -0.3, 4.3, 0.3))
    result = decide(here, seen(here, *scene), before)
    if result.action is Action.WALK:
        walked = min(result.trace.candidates, key=lambda each: abs(each.angle - result.direction))
        assert walked.clearance_m > 1.1 * SETTINGS.obstacle.slow_reaction_s + 1.1**2 / 2.4


@pytest.mark.parametrize(("slow_s", "stops"), [(0.9, True), (0.3, False)])
def test_who_walks_has_room_to_stop_even_where_they_react_slowly(slow_s: float, stops: bool):
    """At 0.8 m/s a wall 1.28 m ahead: enough for somebody who reacts at once, too little for one who does not."""
    settings = SETTINGS.changed({
        "obstacle.slow_reaction_s": slow_s, "obstacle.clearance_m": 1.0, "obstacle.narrow_clearance_m": 0.85,
    })  # fmt: skip
    before, here = walking_at(0.8)
    result = decide(here, seen(here, box(3.28, -3, 3.4, 3)), before, settings=settings)
    assert (result.action is not Action.WALK) == stops


def test_who_has_just_begun_to_walk_is_stopped_as_one_who_is_still_gaining_speed():
    """At 0.4 m/s, told to walk a moment ago: before they react they are faster, and need more room than they show."""
    settings = SETTINGS.changed({"obstacle.clearance_m": 1.0, "obstacle.narrow_clearance_m": 0.85})
    before, here = walking_at(0.4)
    found = seen(here, box(3.06, -3, 3.2, 3))
    assert decide(here, found, before, settings=settings).action is not Action.WALK
    told_to_stand = replace(before, action=Action.STOP, direction=None, reason=Reason.PAUSED)
    assert decide(here, found, told_to_stand, settings=settings).action is Action.WALK


def test_who_gains_speed_may_gain_what_they_have_walked_before():
    """At 0.7 m/s, and a wall 1.38 m ahead: enough for most, too little for one who has walked 1.05 m/s today."""
    settings = SETTINGS.changed({"obstacle.clearance_m": 1.0, "obstacle.narrow_clearance_m": 0.85})
    before, here = walking_at(0.7)
    found = seen(here, box(3.38, -3, 3.5, 3))
    assert decide(here, found, before, settings=settings).action is Action.WALK
    fast = replace(before, trace=replace(before.trace, fastest_m_s=1.05))
    assert decide(here, found, fast, settings=settings).action is not Action.WALK


def test_the_fastest_walk_is_remembered_and_a_jump_of_the_pose_is_none():
    before, here = walking_at(1.0)
    walked = decide(here, seen(here), before)
    assert walked.trace.fastest_m_s == pytest.approx(walked.trace.speed_m_s)
    stands = at(here.pose.x_m, stamp_s=here.stamp_s + 3.0)
    assert decide(stands, seen(stands), walked).trace.fastest_m_s == pytest.approx(walked.trace.fastest_m_s)
    before, jumped = walking_at(3.0)
    assert decide(jumped, seen(jumped), before).trace.fastest_m_s <= 1.3


def test_who_lost_their_place_while_turning_turns_the_other_way():
    """Facing back along the road beside a wall: the pose goes where the wall fills the view, and holds otherwise."""
    away = decide(at(2.0, 0.0, 200.0), seen(at(2.0, 0.0, 200.0)))
    assert away.action is Action.TURN
    assert away.direction is not None
    lost = decide(at(2.0, quality="lost", stamp_s=0.1), seen(at(2.0)), away)
    found = lost
    for number in range(5):
        here = at(2.0, 0.0, 200.0, stamp_s=0.2 + 0.1 * number)
        found = decide(here, seen(here), found)
    assert found.action is Action.TURN
    assert found.direction is not None
    assert found.direction * away.direction < 0.0
    ahead = at(2.0, stamp_s=2.0)
    walks = decide(ahead, seen(ahead), found)
    assert walks.action is Action.WALK
    assert walks.trace.lost_towards is None


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("found_deg", [0.0, 15.0, 40.0, 60.0])
def test_a_turn_to_the_route_goes_on_by_the_side_on_which_the_place_was_not_lost(side: float, found_deg: float):
    """A stretch of wall that the map does not know lies at 210°, and 20° to each side of it; the route leads to 0°.

    Whoever was told to stop turns on a little: they are found before that stretch, or beyond it.
    """
    begun = decide(at(2.0, 0.0, side * 190.0), seen(at(2.0, 0.0, side * 190.0)))
    assert begun.action is Action.TURN
    lost = decide(at(2.0, quality="lost", stamp_s=0.1), seen(at(2.0)), begun)
    began = 1.0 if begun.direction > 0.0 else -1.0
    found = lost
    for number in range(5):
        here = at(2.0, 0.0, side * 190.0 + began * found_deg, stamp_s=0.2 + 0.1 * number)
        found = decide(here, seen(here), found)
    assert found.action is Action.TURN
    assert found.direction * began > 0.0 if found_deg > 10.0 else found.direction * began < 0.0


def test_the_first_steps_of_who_stands_lead_where_they_are_free():
    """A corner of a box ahead, 1.5 m away: the way beside it is turned to before the first step, not while walking."""
    here = at(2.0, stamp_s=5.0)
    scene = (box(-1, 1.3, 9, 1.5), box(-1, -1.5, 9, -1.3), box(3.5, -1.3, 3.9, -0.3))
    stood = replace(decide(at(2.0), seen(at(2.0)), paused=True), stamp_s=4.9)
    result = decide(here, seen(here, *scene), stood)
    assert result.trace.nearest_ahead_m == pytest.approx(1.5, abs=0.1)
    assert result.action is Action.TURN
    faced = min(result.trace.candidates, key=lambda each: abs(each.angle - result.direction))
    assert faced.clearance_m > 1.6


def test_the_first_steps_of_who_stands_keep_away_from_what_is_just_beside_them():
    """A chair 1.5 m ahead, a little beside a person's width: first steps that go astray would lead into it."""
    here = at(2.0, stamp_s=5.0)
    stood = replace(decide(at(2.0), seen(at(2.0)), paused=True), stamp_s=4.9)
    walls = (box(-1, 2.3, 9, 2.5), box(-1, -2.5, 9, -2.3))
    for side in (1.0, -1.0):
        chair = box(3.5, min(0.38 * side, 0.88 * side), 4.0, max(0.38 * side, 0.88 * side))
        result = decide(here, seen(here, *walls, chair), stood)
        assert (result.trace.nearest_ahead_m or 9.0) > 1.7, "a person's width is free straight ahead"
        assert result.direction is not None
        assert result.direction * side < math.radians(-4.0)
        walking = decide(here, seen(here, *walls, chair), decide(here, seen(here, *walls)))
        assert walking.action is Action.WALK, "whoever walks already has passed worse"
    narrow = (box(-1, 0.4, 9, 0.6), box(-1, -0.6, 9, -0.4))
    assert decide(here, seen(here, *narrow), stood).action is Action.WALK, "a corridor that is no wider is walked"


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_first_steps_where_little_is_free_keep_away_from_what_is_just_beside_them(side: float):
    """Ways beside a box are as free as the one nearest to the route, and leave room for a step astray."""
    here, edge_m, end_m = at(2.0, stamp_s=5.0), 0.58 * side, 0.8
    box_beside = box(2.2, min(edge_m, 1.2 * side), 2.0 + end_m, max(edge_m, 1.2 * side))
    found = seen(here, box_beside, box(4.3, -4, 4.5, 4))
    stood = replace(decide(at(2.0), seen(at(2.0)), paused=True), stamp_s=4.9)
    stood = replace(stood, trace=replace(stood.trace, stopped_since_s=1.0))
    result = stood
    for tenth in range(4):
        route = route_along((2, 0), (12, 6 * side))
        result = decide(replace(here, stamp_s=5.0 + tenth / 10), found, result, route=route)
        assert result.trace.required_m == pytest.approx(SETTINGS.obstacle.narrow_clearance_m), "little is free"
        assert result.action is Action.WALK
        assert result.direction is not None
        passed_m = abs(edge_m * math.cos(result.direction) - end_m * math.sin(result.direction))
        assert passed_m > SETTINGS.obstacle.person_width_m / 2.0 + 0.08, f"told {tenth + 1} times"


def hiding(found: ObstacleScan, from_deg: float, to_deg: float) -> ObstacleScan:
    """A scan in which some bearings show nothing: dark, or glass."""
    bearing_deg = np.degrees(found.bearing_rad)
    hidden = (bearing_deg >= from_deg) & (bearing_deg <= to_deg)
    nearest_m = np.where(hidden, np.nan, found.nearest_m)
    state = np.where(hidden, BearingState.UNKNOWN, found.state).astype(np.int8)
    candidates = candidate_directions(found.bearing_rad, nearest_m, state, SETTINGS.obstacle, MAX_RANGE_M)
    return replace(found, nearest_m=nearest_m, state=state, candidates=candidates)


def seen_beside_deg(found: ObstacleScan, direction: float) -> float:
    """How far beside a direction, as it is walked, everything has been seen; 20° is enough."""
    walked_rad = 0.0 if abs(direction) <= math.radians(SETTINGS.cues.straight_within_deg) else direction
    hidden_deg = np.degrees(found.bearing_rad[np.isnan(found.nearest_m)] - walked_rad)
    return min(20.0, *np.abs(hidden_deg))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("dark_from_deg", range(2, 29, 2))
def test_room_for_first_steps_is_not_looked_for_beside_what_nobody_has_seen(side: float, dark_from_deg: int):
    """A box beside the way, and on its other side the picture is dark: unknown is never clear."""
    here, edge_m = at(2.0, stamp_s=5.0), 0.45 * side
    stood = replace(decide(at(2.0), seen(at(2.0)), paused=True), stamp_s=4.9)
    stood = replace(stood, trace=replace(stood.trace, stopped_since_s=1.0))
    box_beside = box(2.6, min(edge_m, 1.4 * side), 3.0, max(edge_m, 1.4 * side))
    all_seen, route = seen(here, box_beside, box(3.5, -4, 3.7, 4)), route_along((2, 0), (12, 4 * side))
    bright = decide(here, all_seen, stood, route=route)
    assert bright.direction is not None
    assert bright.direction * side < 0.0, "where all is seen, the way with more room is taken"
    dark = hiding(all_seen, *sorted((-side * dark_from_deg, -side * (dark_from_deg + 6.0))))
    result = decide(here, dark, stood, route=route)
    among = tuple(each for each in result.trace.candidates if each.angle in result.trace.among)
    if result.trace.optimal is None or result.trace.expected is None:
        return
    freest = widest_direction(among, result.trace.expected, world_angle(0.0))
    assert freest is not None
    assert seen_beside_deg(dark, result.trace.optimal) >= seen_beside_deg(dark, freest.angle) - 1e-6


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_was_told_is_not_kept_where_it_sounds_like_straight_on_to_something_near(side: float):
    """The edge of a box 1.25 m ahead: 8° beside it is free, and is walked straight ahead."""
    here, edge_m = at(2.0, stamp_s=5.0), 0.25 * side
    box_ahead = box(3.25, min(-edge_m, -0.8 * side), 3.4, max(-edge_m, -0.8 * side))
    found, route = seen(here, box_ahead, box(4.3, -4, 4.5, 4)), route_along((2, 0), (12, -2.7 * side))
    walked = decide(at(2.0, stamp_s=4.9), seen(at(2.0)), None)
    told = replace(walked, direction=relative_angle(math.radians(8.0 * side)))
    told = replace(told, trace=replace(told.trace, required_m=SETTINGS.obstacle.narrow_clearance_m))
    for tenth in range(3):
        told = decide(replace(here, stamp_s=5.0 + tenth / 10), found, told, route=route)
        assert told.trace.nearest_ahead_m == pytest.approx(1.25, abs=0.05)
        assert told.trace.required_m == pytest.approx(SETTINGS.obstacle.narrow_clearance_m)
        assert told.direction is not None
        assert abs(told.direction) > math.radians(SETTINGS.cues.straight_within_deg)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_first_steps_keep_away_from_what_begins_half_a_metre_ahead(side: float):
    here, edge_m = at(2.0, stamp_s=5.0), 0.4 * side
    box_beside = box(2.2, min(edge_m, 1.2 * side), 2.57, max(edge_m, 1.2 * side))
    stood = replace(decide(at(2.0), seen(at(2.0)), paused=True), stamp_s=4.9)
    stood = replace(stood, trace=replace(stood.trace, stopped_since_s=1.0))
    found, route = seen(here, box_beside, box(4.3, -4, 4.5, 4)), route_along((2, 0), (12, 2 * side))
    result = decide(here, found, stood, route=route)
    assert result.direction is not None
    assert result.direction * side < math.radians(-SETTINGS.cues.straight_within_deg)


@pytest.mark.parametrize("policy", ["paper", "road_centred"])
def test_who_turns_to_where_little_is_free_is_not_turned_back_and_on_again(policy: str):
    """Between two boxes the freest directions change with the heading: who turns as they are told begins to walk."""
    scene = (box(3.0, -0.2, 3.3, 0.2), box(2.9, 0.95, 3.6, 2.2), box(4.3, -4, 4.5, 4))
    route, settings = route_along((2, 0), (10, 2.5)), SETTINGS.changed({"follower.policy": policy})
    result = replace(decide(at(2.0), seen(at(2.0)), paused=True), stamp_s=4.9)
    heading_deg, turned_deg = 0.0, []
    for tenth in range(80):
        here = at(2.0, 0.0, heading_deg, 5.0 + tenth / 10)
        result = decide(here, seen(here, *scene), result, route=route, settings=settings)
        if result.action is Action.WALK:
            break
        turn_deg = math.degrees(result.direction or 0.0)
        step_deg = max(-4.0, min(4.0, turn_deg)) if abs(turn_deg) > 3.0 else 0.0
        heading_deg += step_deg
        turned_deg.append(step_deg)
    changes = sum(one * two < 0.0 for one, two in itertools.pairwise(turned_deg))
    assert changes <= 2, turned_deg
    assert result.action is Action.WALK


@pytest.mark.parametrize(("from_deg", "to_deg"), [(-7.0, 7.0), (-9.0, 5.0), (-5.0, 9.0)])
def test_who_stands_before_the_unknown_takes_no_first_step_straight_ahead(from_deg: float, to_deg: float):
    """What is dark or of glass straight ahead: a direction beside it is turned to, and none that sounds straight."""
    here = at(2.0, stamp_s=5.0)
    stood = replace(decide(at(2.0), seen(at(2.0)), paused=True), stamp_s=4.9)
    free = seen(here)
    hidden = (free.bearing_rad > math.radians(from_deg)) & (free.bearing_rad < math.radians(to_deg))
    nearest_m, state = free.nearest_m.copy(), free.state.copy()
    nearest_m[hidden], state[hidden] = math.nan, BearingState.UNKNOWN
    candidates = candidate_directions(free.bearing_rad, nearest_m, state, SETTINGS.obstacle, MAX_RANGE_M)
    unknown = replace(free, nearest_m=nearest_m, state=state, candidates=candidates)
    result = decide(here, unknown, stood)
    assert result.action is not Action.WALK
    if result.direction is not None:
        assert abs(result.direction) > math.radians(SETTINGS.cues.straight_within_deg)


def test_a_destination_before_a_wall_is_led_to():
    """0.45 m from a wall: whoever has arrived is stopped before it, so no margin is asked for beyond it."""
    route = route_along((0, 0), (8, 0))
    for x_m in np.arange(5.0, 6.9, 0.2):
        here = at(float(x_m))
        found = seen(here, box(8.45, -3, 8.6, 3), box(-1, 0.9, 9, 1.0), box(-1, -1.0, 9, -0.9))
        assert decide(here, found, route=route).action is Action.WALK, x_m


def test_a_wanted_way_whose_beginning_is_not_known_is_a_lost_pose():
    here = at(2.0, quality="lost")
    result = decide(here, seen(at(2.0)), route=None, wanted=True)
    assert (result.action, result.reason) == (Action.STOP, Reason.POSE_LOST)
    assert decide(here, seen(at(2.0)), route=None).reason is Reason.NO_ROUTE


@pytest.mark.parametrize("is_taken_away", [True, False])
def test_who_stood_before_something_low_for_minutes_is_led_on_only_once_they_stepped_back_and_looked(
    is_taken_away: bool,
):
    low = tuple(box(3.0, left_m, 3.4, left_m + 1.0, 0.3) for left_m in range(-3, 3))
    places_m = [*np.arange(0.0, 2.3, 0.1), *[2.2] * 300, *np.arange(2.1, 0.65, -0.1), *[0.7] * 10]
    stands, steps_back = 23, 323
    memory, before, heading_deg = ObstacleMemory(), None, 0.0
    actions: list[Action] = []
    for k, x_m in enumerate(places_m):
        # Ten minutes of standing, two seconds from one look to the next; every turn is made.
        located = at(float(x_m), heading_deg=heading_deg, stamp_s=0.1 * k if k < stands else 2.0 * k)
        is_there, pose = not is_taken_away or k < stands + 10, located.pose
        assert pose is not None
        found = seen(located, *low if is_there else ())
        memory = remember(memory, found, pose, located.stamp_s)
        before = decide(located, with_memory(found, memory, pose, SETTINGS.obstacle), before)
        actions.append(before.action)
        heading_deg += math.degrees(before.direction or 0.0) if before.action is Action.TURN else 0.0
    assert Action.WALK not in actions[stands:steps_back]
    assert before is not None
    assert (before.trace.nearest_ahead_m is None) is is_taken_away
    assert actions[-1] is Action.WALK, "it is gone, or far enough ahead to walk up to and be led round"


# ------------------------------------------------------------------------------------------------ who cut a corner
INTO_DOOR = route_along((0.6, -3), (0.6, 1.1), (-4, 1.1))
"""Along a wall at −0.5 m, and round a corner through the door in it."""


def led_by_paper(
    start: tuple[float, float, float], *walls, route=INTO_DOOR, until_15_s=(), before=(0.5, 0.6, 90.0)
) -> list[Guidance]:
    """Lead somebody who does at once what they are told, from a place (x, y, heading in degrees), for a minute.

    ``before`` is where they were: they have just passed the corner, as the policy ``paper`` counts it.
    """
    settings = SETTINGS.changed({"follower.policy": "paper"})
    (x_m, y_m, heading_deg), memory = start, ObstacleMemory()
    corner = at(*before)
    told = [decide(corner, seen(corner), route=route, settings=settings)]
    while len(told) < 600 and told[-1].reason is not Reason.ARRIVED:
        here = at(x_m, y_m, heading_deg, len(told) / 10)
        assert here.pose is not None
        found = seen(here, *walls, *(until_15_s if here.stamp_s < 15.0 else ()))
        memory = remember(memory, found, here.pose, here.stamp_s)
        found = with_memory(found, memory, here.pose, SETTINGS.obstacle)
        told.append(decide(here, found, told[-1], route=route, settings=settings))
        if told[-1].direction is not None:
            most_deg, step_m = (6.0, 0.0) if told[-1].action is Action.TURN else (3.0, 0.06)
            heading_deg += max(-most_deg, min(most_deg, math.degrees(told[-1].direction)))
            x_m += step_m * math.cos(math.radians(heading_deg))
            y_m += step_m * math.sin(math.radians(heading_deg))
    return told


def test_who_was_turned_along_a_wall_to_where_it_is_free_walks_there_before_they_are_turned_to_the_wall_again():
    """The sub-goal lies behind the wall, the door farther on: they were turned to and fro before it for good."""
    told = led_by_paper((0.0, 0.2, 97.0), box(-0.55, -4, -0.45, 0.35), box(-0.55, 1.9, -0.45, 5))
    assert told[-1].reason is Reason.ARRIVED
    begun = [k for k, (one, next_) in enumerate(itertools.pairwise(told)) if one.action is not next_.action]
    assert len(begun) < 12, "nobody is told one thing and at once another"


def test_who_stands_beside_the_road_and_finds_nothing_that_leads_on_is_led_to_the_road_first():
    """The door is as narrow as a person, and in none of the directions that were looked in."""
    door = route_along((0.6, -3), (0.6, 0.9), (-4, 0.9))
    walls = box(-0.55, -4, -0.45, 0.45), box(-0.55, 1.4, -0.45, 4)
    told = led_by_paper((0.17, 0.38, 66.0), *walls, route=door)
    assert told[-1].reason is Reason.ARRIVED
    rejoining = [each for each in told if each.trace.rejoins]
    assert rejoining
    assert all((each.trace.deviation_m or 0.0) > 0.2 for each in rejoining), "who is on the road is led along it"
    assert not told[-1].trace.rejoins


def test_who_cannot_come_to_the_road_goes_on_when_what_was_before_them_has_gone():
    """Beside a carton on the road they stand before somebody: the road is closed, the way on is so for a while."""
    carton, person = box(1.6, -0.3, 3.4, 0.3, 1.0), box(3.2, -1.4, 3.5, -0.4, 1.7)
    told = led_by_paper((2.2, -0.9, 0.0), carton, route=ROUTE, until_15_s=(person,), before=(1.0, -0.9, 0.0))
    assert any(each.trace.rejoins for each in told)
    assert told[-1].reason is Reason.ARRIVED


def test_nobody_is_led_farther_from_the_road_round_something_once_they_have_left_it():
    """A walker was led round a carton into a hall, by one free direction after the other, until their place was lost.

    The paper takes all of D: of two that are free, the one nearest to θ_exp may lead away from the road.
    """
    settings = SETTINGS.changed({"follower.policy": "paper"})
    for y_m, heading_deg, action in ((-0.5, -45.0, Action.WALK), (-1.6, -30.0, Action.TURN)):
        here = at(2.0, y_m, heading_deg)
        before = decide(here, seen(here), settings=settings)
        aside = replace(before.trace, turn=TurnKind.ASIDE, optimal=relative_angle(0.0), free_frame_count=9)
        before = replace(before, action=Action.TURN, direction=relative_angle(0.0), trace=aside)
        assert decide(at(2.0, y_m, heading_deg, 0.1), seen(here), before, settings=settings).action is action
    for y_m, most_deg in ((-0.5, 90.0), (-1.6, 40.0)):
        here = at(2.0, y_m)
        among = decide(here, seen(here), settings=settings).trace.among
        expected_rad = math.atan2(-y_m, 3.0)
        farthest_deg = max(abs(math.degrees(expected_rad - each)) for each in among)
        assert min(most_deg, 41.0) - 4.0 < farthest_deg < most_deg


@pytest.mark.parametrize("style", ["degrees", "clock"])
def test_nobody_begins_to_walk_by_words_that_mean_what_is_not_free(style: str):
    """24° to the left it is free; one o'clock is 30°, and leads to a box. Who faces the way hears *move forward*."""
    settings = SETTINGS.changed({"cues.direction_style": style})
    here = at(2.0, 0.0, -24.0)
    scene = (box(4.3, 0.42, 4.9, 1.4),)
    stood = replace(decide(here, seen(here), paused=True), stamp_s=-0.1)
    result = decide(here, seen(here, *scene), stood, settings=settings)
    assert result.action is (Action.WALK if style == "degrees" else Action.TURN)
    assert result.direction is not None
    assert math.degrees(result.direction) == pytest.approx(24.0, abs=6.0)
    walking = decide(here, seen(here), stood, settings=settings)
    assert walking.action is Action.WALK
    goes_on = at(2.0, 0.0, -24.0, stamp_s=0.1)
    assert decide(goes_on, seen(goes_on, *scene), walking, settings=settings).action is Action.WALK, "tones are exact"
