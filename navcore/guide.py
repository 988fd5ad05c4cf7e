"""One cycle of guidance: the paper's Fig. 7, from a pose, a route and a scan to a direction (section IV-C).

A pure function of frozen values; its only memory is the guidance of the frame before. ::

    paused? no route? pose lost?         -> stop (who stays lost is turned to look round)
    Eqs. 1, 2   closest point, sub-goal  -> arrived? stop
    Eq. 3       expected direction       -> far to the side? turn on the spot
                beside the road, and nothing found that leads on? the road itself is where to go first
    depth invalid? near drop, obstacle?  -> stop (or turn aside, which needs no free space)
    Eq. 4       optimal direction of D   -> none? turn to look there, else stop
    Eq. 5       ultrasonic gate          -> closed? stop
    three free frames after a stop       -> walk
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from navcore.angles import RelativeAngle, WorldAngle, in_world, relative_angle, relative_to, wrap_rad
from navcore.cues.directions import told_move_deg
from navcore.follower.aim import Aim, aim, to_road
from navcore.follower.corner_ahead import corner_ahead
from navcore.follower.direction import (
    between_candidates,
    needs_correction,
    optimal_direction,
    required_clearance_m,
    walkable,
    widest_direction,
)
from navcore.follower.gate import current_reading, echo_distance_m, walking_direction
from navcore.follower.look import (
    LOOK_AFTER_S,
    LOOK_ROUND,
    LOOK_ROUND_AFTER_S,
    LOOK_ROUND_FOR_S,
    SIDES,
    look_target,
)
from navcore.follower.road_centred import SPEED_MEMORY_S, stopping_distance_m, walking_velocity_m_s
from navcore.follower.sub_goal import has_arrived
from navcore.follower.turning import turn_to_route
from navcore.obstacle.corridor import clearance_ahead_m
from navcore.obstacle.polar_grid import MAX_RANGE_M
from navcore.settings import Settings
from navcore.types import (
    Action,
    BearingState,
    CandidateDirection,
    DecisionTrace,
    Guidance,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Pose2D,
    Reason,
    Route,
    Rule,
    SonarReading,
    TurnKind,
)

_LEFT_SLOWLY = frozenset(
    {
        Reason.OBSTACLE_DEPTH, Reason.OBSTACLE_SONAR, Reason.DROP_AHEAD, Reason.NO_CANDIDATE, Reason.DEPTH_INVALID,
        Reason.POSE_LOST,
    }
)  # fmt: skip
"""Stops that the walker leaves only after several free frames."""
_FOUND_NOTHING = frozenset({Reason.OBSTACLE_DEPTH, Reason.DROP_AHEAD, Reason.NO_CANDIDATE})
_TO_THE_ROUTE = frozenset({TurnKind.ALONG, TurnKind.AROUND})
_ROUND_SOMETHING = frozenset({TurnKind.ASIDE, TurnKind.LOOK})
_STANDS_AFTER_S = 1.0
"""Who was told not to walk on has heard it and stands so long after: reaction, then braking."""
_BODY_M = 0.25
"""From the camera to the front of the body."""
_BACK_ENDS_M = 0.3
"""So near to the end of a few steps back the walker is stopped: they were to be led on before."""
_USUAL_SPEED_M_S, _GAINS_M_S2 = 0.85, 0.6
"""Blind pedestrians walk at 0.6 to 1.1 m/s (D. Clark-Carter et al., Ergonomics 29, 1986), two or three steps after
they have begun."""
_FASTEST_M_S = 1.3
"""Faster than this nobody has walked who is guided: the pose has jumped."""
_FIRST_STEPS_M = 1.6
"""So far somebody who begins to walk may come, straight on, before a correction, and then a stop, has its effect."""
_ASTRAY_M = 0.2
"""The first steps are the least straight: wider than a person's corridor must be free for them, where it can be."""
_BESIDE_M, _REMEMBERED_BESIDE_M = 0.3, 0.6
"""What is no farther ahead than this is beside the walker already: in the image; and what is only remembered."""
_AS_FREE_M = 0.1
"""A direction that is free for so much less than another is as free."""
_FIRST_TURN_RAD = math.radians(20.0)
"""No farther aside is looked for a way on which the first steps are free."""
_HIDDEN_BESIDE_RAD = math.radians(20.0)
"""What nobody has seen is beside the first steps up to here: a person's corridor, and what they go astray, at 1 m."""
_FACED_RAD, _FACED_ROUGHLY_RAD = math.radians(9.0), math.radians(20.0)
_BESIDE_MARGIN_M = 0.3
"""Free space beyond the point of a line round something."""
_LOST_FARTHER_RAD = math.radians(10.0)
"""Who loses their place in a turn loses it up to so far beyond where they knew it last."""
_ON_ROAD_M, _ELSEWHERE_M = 0.2, 2.0
"""Who was led back to the road is on it from here; so far from where that began they may be led back again."""
_FARTHEST_ASIDE_RAD = math.radians(40.0)
"""A free direction that is farther than this from the expected one leads somewhere else (road-centred, or off the
road)."""
_TOWARDS_RAD = math.radians(15.0)
_MAX_DETOUR_RAD = math.radians(75.0)
"""Somebody who is led round something may head this far from the expected direction before they are turned back."""


@dataclass(frozen=True, slots=True)
class _Why:
    """The check that decides, and its result in a few words."""

    rule: Rule
    words: str

    def then(self, words: str) -> _Why:
        """Return it with what follows from it."""
        return _Why(self.rule, f"{self.words}: {words}")


@dataclass(frozen=True, slots=True)
class _Cycle:
    """What every step of one cycle may look at."""

    stamp_s: float
    scan: ObstacleScan
    sonar: SonarReading
    previous: Guidance | None
    """What was decided in the frame before, on the same route."""
    settings: Settings
    route_version: int
    walked: Guidance | None
    """What was decided in the frame before, on whatever route: how somebody moves is theirs, not the route's."""

    def stop(self, reason: Reason, trace: DecisionTrace, why: _Why) -> Guidance:
        return self.result(Action.STOP, None, reason, trace, why)

    def turn(self, kind: TurnKind, direction: RelativeAngle, trace: DecisionTrace, why: _Why) -> Guidance:
        reason = Reason.OFF_ROAD if _is_off_road(trace, self.settings) else Reason.OK
        trace = replace(trace, turn=kind, reversals_count=trace.reversals_count + self._reverses(kind, direction))
        return self.result(Action.TURN, direction, reason, trace, why)

    def _reverses(self, kind: TurnKind, direction: RelativeAngle) -> bool:
        """Whether a turn is to the other side than the one that was told in the frame before, on a known pose.

        Turns around do not count: to which side what lies behind is nearer changes with every sway.
        """
        before = self.previous
        if before is None or before.direction is None or before.reason is Reason.POSE_LOST:
            return False
        around = TurnKind.AROUND in (kind, before.trace.turn) or abs(before.direction) + abs(direction) > math.pi
        return before.action is Action.TURN and not around and before.direction * direction < 0.0

    def turn_along(self, error: RelativeAngle, trace: DecisionTrace, why: _Why) -> Guidance:
        """Turn to where the route leads: a U-turn where that is behind, and then always round the same side."""
        before = None if self.previous is None or self.previous.trace.turn not in _TO_THE_ROUTE else self.previous
        lost = None
        if trace.lost_towards is not None and trace.heading is not None:
            lost = relative_to(trace.lost_towards, trace.heading)
        kind, side = turn_to_route(
            error, None if before is None else before.trace.turn, None if before is None else before.direction, lost
        )  # fmt: skip
        if kind is TurnKind.AROUND:
            why = replace(why, words=f"the route leads behind: turn around ({why.words})")
        return self.turn(kind, side, replace(trace, optimal=None), why)

    def walk(self, direction: RelativeAngle, trace: DecisionTrace, why: _Why) -> Guidance:
        reason = Reason.OFF_ROAD if _is_off_road(trace, self.settings) else Reason.OK
        return self.result(Action.WALK, direction, reason, trace, why)

    def result(
        self, action: Action, direction: RelativeAngle | None, reason: Reason, trace: DecisionTrace, why: _Why
    ) -> Guidance:
        trace = replace(trace, rule=why.words, decided=why.rule)
        return Guidance(self.stamp_s, action, direction, reason, trace, self.route_version)


def guide(
    stamp_s: float,
    localization: Localization,
    route: Route | None,
    scan: ObstacleScan,
    sonar: SonarReading | None,
    previous: Guidance | None,
    settings: Settings,
    *,
    paused: bool = False,
    wanted: bool = False,
    route_version: int = 0,
) -> Guidance:
    """Return what the walker is to do now, and everything that led to it.

    Args:
        stamp_s: capture time of the frame that ``localization`` and ``scan`` come from, seconds.
        localization: the pose; a LOST one stops, an UNCERTAIN one carries on for a short time only.
        route: the paper's W; None where no destination is set or no way leads there.
        scan: the depth image, reduced to bearings and candidate directions D.
        sonar: the latest reading of the rangefinder; None where there is none.
        previous: the guidance of the frame before; None at the start.
        settings: all thresholds.
        paused: guidance is held.
        wanted: a destination is wanted, so that the lack of a route means only that its beginning is not known yet.
        route_version: changes with the route; what was remembered about another one is dropped, but for how the
            walker moves.
    """
    cycle = _Cycle(
        stamp_s, scan, current_reading(sonar, stamp_s, settings.gate),
        previous if previous is not None and previous.route_version == route_version else None, settings, route_version,
        previous,
    )  # fmt: skip
    trace = _sensed(cycle, localization)
    if paused:
        return cycle.stop(Reason.PAUSED, _remembered(cycle, trace), _Why(Rule.PAUSED, "guidance is paused"))
    if route is None and wanted:
        return _lost(cycle, trace, _Why(Rule.START_UNKNOWN, "where the way begins is not known yet"))
    if route is None:
        why = _Why(Rule.NO_ROUTE, "no destination is set, or no way leads there")
        return cycle.stop(Reason.NO_ROUTE, trace, why)
    pose = localization.pose
    if pose is None or localization.quality is LocalizationQuality.LOST or not _is_finite(pose):
        return _lost(cycle, trace, _Why(Rule.POSE_LOST, "the pose is lost"))
    uncertain = localization.quality is LocalizationQuality.UNCERTAIN
    if uncertain and trace.sure_count is not None:
        return _lost(cycle, trace, _Why(Rule.NOT_SURE_AGAIN, "the pose was lost and is not certain again"))
    if trace.uncertain_since_s is not None and (
        stamp_s - trace.uncertain_since_s > settings.localization.uncertain_hold_s
    ):
        return _lost(cycle, trace, _Why(Rule.UNCERTAIN_TOO_LONG, "the pose has been uncertain for too long"))
    return _follow(cycle, route, pose, trace)


def _follow(cycle: _Cycle, route: Route, pose: Pose2D, trace: DecisionTrace) -> Guidance:
    """Eqs. 1–3, and what needs no free space."""
    follower, before = cycle.settings.follower, cycle.previous
    if before is not None and before.reason is Reason.ARRIVED:
        remembered = replace(trace, sub_goal=before.trace.sub_goal)
        return cycle.stop(Reason.ARRIVED, remembered, _Why(Rule.ARRIVED_BEFORE, "arrived before"))
    # Who is not sure where they are is not led beside the road.
    known = cycle.scan if trace.uncertain_since_s is None else None
    there = aim(route, pose, trace.speed_m_s, None if before is None else before.trace, known, cycle.settings)
    rejoins = _rejoins(cycle, pose) and there.deviation_m > _ON_ROAD_M
    if rejoins:
        there = to_road(there, route, pose)
        begins = before is None or not before.trace.rejoins
        trace = replace(trace, rejoined_from=(pose.x_m, pose.y_m) if begins else trace.rejoined_from)
    left_m = route.length_m - float(route.arc_length_m[there.closest_index])
    trace = replace(
        trace, expected=there.expected, sub_goal=there.goal, closest_index=there.closest_index,
        deviation_m=there.deviation_m, offset_m=there.offset_m, rejoins=rejoins,
        remaining_m=left_m if route.leads_to_destination else None,
        corner=corner_ahead(route, there.closest_index, there.goal, trace.speed_m_s, follower),
    )  # fmt: skip
    if not route.leads_to_destination and left_m < _BACK_ENDS_M:
        why = _Why(Rule.NO_ROUTE, "the steps back end here, and no way on has been planned yet")
        return cycle.stop(Reason.NO_CANDIDATE, trace, why)
    if route.leads_to_destination and has_arrived(there.goal, pose, follower):
        why = _Why(Rule.ARRIVED, f"case 3: nearer than {follower.arrival_distance_m:g} m")
        return cycle.stop(Reason.ARRIVED, trace, why)
    error = relative_to(there.expected, pose.heading)
    look = None if before is None else before.trace.look_target
    if look is not None and abs(relative_to(look, pose.heading)) > math.radians(follower.turn_settled_deg / 2):
        looking = replace(trace, look_target=look)
        why = _Why(Rule.LOOKS_ASIDE, "look aside for a way round")
        return cycle.turn(TurnKind.LOOK, relative_to(look, pose.heading), looking, why)
    if _must_turn(cycle, error, _is_off_road(trace, cycle.settings)):
        why = _Why(Rule.FAR_ASIDE, "the expected direction is far to the side: turn on the spot")
        return cycle.turn_along(error, trace, why)
    return _choose(cycle, pose, there, trace)


def _rejoins(cycle: _Cycle, pose: Pose2D) -> bool:
    """Whether the walker is to be led to the road first: where they stand beside it, nothing was found that leads on.

    Who cut a corner stands before the wall beside a door: in none of the directions that were looked in is the door.
    From one place it is tried once: what stands on the road itself is not passed by coming back to it.
    """
    before = cycle.previous
    if before is None:
        return False
    trace = before.trace
    if trace.rejoins:
        # Who is stopped on the way there is not kept standing before it: what blocked the way on may have gone.
        return before.action is not Action.STOP
    stands = before.action is Action.STOP and before.reason in _FOUND_NOTHING and trace.free_frame_count == 0
    found_nothing = stands and trace.look_count >= SIDES and trace.offset_m == 0.0
    is_beside = (trace.deviation_m or 0.0) > cycle.settings.obstacle.person_width_m / 2.0
    return found_nothing and is_beside and not _is_near(trace.rejoined_from, pose)


def _is_near(place: tuple[float, float] | None, pose: Pose2D) -> bool:
    return place is not None and math.dist(place, (pose.x_m, pose.y_m)) < _ELSEWHERE_M


def _choose(cycle: _Cycle, pose: Pose2D, there: Aim, trace: DecisionTrace) -> Guidance:
    """Depth checks, Eq. 4, Eq. 5."""
    settings, scan = cycle.settings, cycle.scan
    if not scan.valid_fraction >= settings.obstacle.min_valid_fraction:
        why = _Why(Rule.DEPTH_INVALID, f"only {scan.valid_fraction:.0%} of the depth image is valid")
        return cycle.stop(Reason.DEPTH_INVALID, trace, why)
    error = relative_to(there.expected, pose.heading)
    chosen = _optimal(cycle, pose.heading, there)
    best, required_m = chosen.best, chosen.required_m
    is_narrow = required_m == _narrow_m(cycle) and there.offset_m == 0.0
    narrows = best is not None and is_narrow and not _may_be_narrow(cycle, trace)
    trace = replace(
        trace, required_m=required_m, optimal=None if best is None else best.angle,
        among=tuple(each.angle for each in chosen.among),
        goes_round=_goes_round(cycle) and abs(error) > math.radians(settings.follower.turn_angle_deg),
    )  # fmt: skip
    # Who walks fast needs more than the stop distance to come to a stand.
    stop_m = max(settings.obstacle.stop_distance_m, _room_to_stop_m(cycle, trace))
    gate_m = required_clearance_m(there.reach_m, settings.obstacle, settings.gate.clearance_m)
    gate_m = min(gate_m, max(required_m, stop_m))
    trace = replace(trace, stop_m=stop_m, gate_m=gate_m)
    if trace.nearest_ahead_m is not None and trace.nearest_ahead_m < stop_m:
        reason = _blocking_reason(cycle, 0.0)
        return _before_obstacle(cycle, error, trace, reason, _Why(Rule.NEAR_AHEAD, "nearer than the stop distance"))
    if trace.sonar_m is not None and trace.sonar_m < stop_m:
        return _before_echo(cycle, error, trace, _Why(Rule.ECHO_NEAR, "echo nearer than the stop distance"))
    if best is None or narrows or best.clearance_m < stop_m:
        reason = _blocking_reason(cycle, error)
        why = _Why(Rule.NOTHING_FREE, f"D is empty: nothing is free for {trace.required_m:.1f} m")
        return _before_obstacle(cycle, error, trace, reason, why)
    direction = walking_direction(best.angle, cycle.sonar, gate_m, settings.gate)
    if direction is None or (_sounds_straight(cycle, direction) and not _is_open_ahead(cycle, gate_m)):
        return _before_echo(cycle, error, trace, _Why(Rule.GATE_CLOSED, f"Eq. 5: echo nearer than {gate_m:.1f} m"))
    if _should_turn_first(cycle, direction, trace):
        why = _Why(Rule.TURN_FIRST, "something is near ahead: turn before the first step")
        return cycle.turn(TurnKind.ASIDE, direction, trace, why)
    if _stands(cycle) and not _is_free_as_told(cycle, direction, chosen.among):
        why = _Why(Rule.TURN_FIRST, "what its words mean is not free: turn before the first step")
        return cycle.turn(TurnKind.ASIDE, direction, trace, why)
    return _leave_stop(cycle, direction, trace, chosen.why)


def _should_turn_first(cycle: _Cycle, direction: RelativeAngle, trace: DecisionTrace) -> bool:
    """Whether somebody who stands must face the free direction before they move.

    The first steps are made before a turn while walking has had its effect: they lead straight on.
    """
    near = trace.nearest_ahead_m is not None and trace.nearest_ahead_m < _FIRST_STEPS_M
    near = near or not _is_ahead_known(cycle)
    # Clock face and sides name no angle that is finer.
    faced_rad = _FACED_RAD if cycle.settings.cues.direction_style == "degrees" else _FACED_ROUGHLY_RAD
    return _stands(cycle) and near and abs(direction) > faced_rad


def _is_free_as_told(cycle: _Cycle, direction: RelativeAngle, among: tuple[CandidateDirection, ...]) -> bool:
    """Whether that may be walked, too, which the words for a direction mean: a clock knows twelve, sides know nine.

    Who walks already is steered by tones, which are exact.
    """
    cues = cycle.settings.cues
    told_rad = math.radians(told_move_deg(direction, cues.straight_within_deg, cues.direction_style))
    near_rad = math.radians(cycle.settings.obstacle.candidate_step_deg)
    if _sounds_straight(cycle, direction) or abs(told_rad - direction) <= near_rad:
        return True
    return any(abs(each.angle - told_rad) <= near_rad for each in among)


def _first_steps_m(cycle: _Cycle, direction: RelativeAngle) -> float:
    """Return how far the first steps in a direction are free, with room for those that go astray.

    What is beside the walker already is passed by the first of them.
    """
    scan, width_m = cycle.scan, cycle.settings.obstacle.person_width_m + _ASTRAY_M
    # A direction that sounds like straight ahead is walked straight ahead.
    walked_rad = 0.0 if _sounds_straight(cycle, direction) else direction
    bearing_rad = np.concatenate([scan.bearing_rad, scan.unseen_rad]) - walked_rad
    range_m = np.concatenate([scan.nearest_m, scan.unseen_m])
    beside_m = np.repeat([_BESIDE_M, _REMEMBERED_BESIDE_M], [len(scan.bearing_rad), len(scan.unseen_rad)])
    ahead = range_m * np.cos(bearing_rad) > beside_m
    return clearance_ahead_m(bearing_rad[ahead], range_m[ahead], width_m, MAX_RANGE_M)


def _as_seen(
    cycle: _Cycle, best: CandidateDirection, among: tuple[CandidateDirection, ...]
) -> tuple[CandidateDirection, ...]:
    """Return those of the directions next to the best one that lead no nearer to what nobody has seen than it does."""
    beside = (each for each in among if abs(wrap_rad(each.angle - best.angle)) <= _FIRST_TURN_RAD)
    least_rad = _seen_beside_rad(cycle, best.angle) - 1e-6
    return tuple(each for each in beside if _seen_beside_rad(cycle, each.angle) >= least_rad)


def _seen_beside_rad(cycle: _Cycle, direction: RelativeAngle) -> float:
    """Return how far beside a direction, as it is walked, everything has been seen; what is farther aside is passed."""
    hidden_rad = cycle.scan.bearing_rad[np.isnan(cycle.scan.nearest_m)]
    walked_rad = 0.0 if _sounds_straight(cycle, direction) else direction
    return float(np.abs(hidden_rad - walked_rad).min(initial=_HIDDEN_BESIDE_RAD))


def _stands(cycle: _Cycle) -> bool:
    return cycle.previous is not None and cycle.previous.action is not Action.WALK


def _room_to_stop_m(cycle: _Cycle, trace: DecisionTrace) -> float:
    """Return how much room in front is needed to be stopped now, by somebody who is slow to react.

    Who has been told to walk may still be gaining speed until they react, up to their own; and have gained some since
    the moment that their measured speed is of.
    """
    slow_s, speed_m_s, gains_s = cycle.settings.obstacle.slow_reaction_s, trace.speed_m_s, 0.0
    if cycle.walked is not None and cycle.walked.action is Action.WALK:
        usual_m_s = max(_USUAL_SPEED_M_S, trace.fastest_m_s, speed_m_s)
        speed_m_s = min(speed_m_s + _GAINS_M_S2 * SPEED_MEMORY_S, usual_m_s)
        gains_s = min(slow_s, (usual_m_s - speed_m_s) / _GAINS_M_S2)
    then_m_s = speed_m_s + _GAINS_M_S2 * gains_s
    return _BODY_M + stopping_distance_m(then_m_s, slow_s) - (then_m_s - speed_m_s) / 2.0 * gains_s


@dataclass(frozen=True, slots=True)
class _Choice:
    """What Eq. 4 came to."""

    best: CandidateDirection | None
    """θ_opt."""
    required_m: float
    """The clearance that was asked for."""
    among: tuple[CandidateDirection, ...]
    why: _Why


def _optimal(cycle: _Cycle, heading: WorldAngle, there: Aim) -> _Choice:
    """Return θ_opt, the clearance that was asked for, what it was chosen from, and the rule.

    Where nothing is free for δ, the paper stops. So does this, with a turn on the spot to where most is free; somebody
    who stands may then begin again with less than δ: in a corridor as wide as two people there is no direction round
    an obstacle that is free for 2 m.
    """
    settings, error = cycle.settings, relative_to(there.expected, heading)
    required_m = required_clearance_m(there.reach_m, settings.obstacle, settings.obstacle.clearance_m)
    if there.offset_m != 0.0:
        # The line round what is in the way is known to be free farther than its first, slanting piece.
        required_m = min(required_m, _narrow_m(cycle), there.reach_m + _BESIDE_MARGIN_M)
        required_m = max(required_m, settings.obstacle.stop_distance_m)
    free, heard = (
        _towards(cycle, error, there, walkable(each, required_m))
        for each in (_directions(cycle), _as_heard(cycle, _directions(cycle)))
    )
    last = _last_direction(cycle, heading)
    best = optimal_direction(heard or free, there.expected, heading, there.deviation_m, settings.follower, last)
    if best is not None and _stands(cycle):
        # Who begins to walk is in step before they can be steered: better where the first steps are free as well.
        near = walkable(_as_seen(cycle, best, heard), max(required_m, _FIRST_STEPS_M))
        roomy = tuple(each for each in near if _first_steps_m(cycle, each.angle) >= _FIRST_STEPS_M + _BODY_M)
        first = optimal_direction(roomy or near, there.expected, heading, there.deviation_m, settings.follower, last)
        best = best if first is None else first
    narrow_m = _narrow_m(cycle)
    if best is None and narrow_m < required_m:
        narrow = _towards(cycle, error, there, walkable(_directions(cycle), narrow_m))
        best = _with_room(cycle, widest_direction(narrow, there.expected, heading), narrow, last)
        words = f"nothing is free for {required_m:.1f} m: the direction that is free farthest"
        return _Choice(best, narrow_m, narrow, _Why(Rule.TO_WIDEST, words))
    if best is not None and settings.follower.policy == "road_centred":
        best = between_candidates(best, error, math.radians(settings.obstacle.candidate_step_deg))
    why = _Why(Rule.TO_STRAIGHT, "Eq. 4: nearest to straight ahead")
    if needs_correction(there.deviation_m, error, settings.follower):
        why = _Why(Rule.TO_EXPECTED, "Eq. 4: nearest to the expected direction")
    return _Choice(best, required_m, heard or free, why)


def _with_room(
    cycle: _Cycle,
    best: CandidateDirection | None,
    among: tuple[CandidateDirection, ...],
    last: RelativeAngle | None,
) -> CandidateDirection | None:
    """Return one of the directions next to the best one that are as free: the one of the frame before, where it is.

    Somebody who stands is led only where first steps that go astray are free too; where they nowhere are, to the best.
    What was told then is kept while it is as free: led to the best again in the first step, they would come to the
    edge of what is free after all.
    """
    if best is None:
        return None
    free_m = best.clearance_m - _AS_FREE_M
    as_free = walkable(_as_heard(cycle, _as_seen(cycle, best, among)), free_m)
    if _stands(cycle):
        needed_m = min(free_m, _FIRST_STEPS_M + _BODY_M)
        as_free = tuple(each for each in as_free if _first_steps_m(cycle, each.angle) >= needed_m)
    step_rad = math.radians(cycle.settings.obstacle.candidate_step_deg)
    kept = tuple(each for each in as_free if last is not None and abs(wrap_rad(each.angle - last)) <= step_rad)
    near_rad = last if kept and last is not None else best.angle
    return min(kept or as_free, key=lambda each: abs(wrap_rad(each.angle - near_rad)), default=best)


def _towards(
    cycle: _Cycle, error: RelativeAngle, there: Aim, candidates: tuple[CandidateDirection, ...]
) -> tuple[CandidateDirection, ...]:
    """Return those of D that lead where the walker is to go; on the road, the policy ``paper`` takes all of them."""
    follower = cycle.settings.follower
    if follower.policy == "paper" and there.deviation_m <= follower.off_road_distance_m:
        return candidates
    return tuple(each for each in candidates if abs(wrap_rad(error - each.angle)) <= _FARTHEST_ASIDE_RAD)


def _as_heard(cycle: _Cycle, directions: tuple[CandidateDirection, ...]) -> tuple[CandidateDirection, ...]:
    """Return directions as they are walked: what sounds like straight ahead is free no farther than straight ahead."""
    ahead_m = cycle.scan.nearest_ahead_m
    if ahead_m is None:
        return directions
    return tuple(
        replace(each, clearance_m=min(each.clearance_m, ahead_m)) if _sounds_straight(cycle, each.angle) else each
        for each in directions
    )


def _directions(cycle: _Cycle) -> tuple[CandidateDirection, ...]:
    """Return D; without what sounds like straight ahead where nobody has seen what is there."""
    if _is_ahead_known(cycle):
        return cycle.scan.candidates
    return tuple(each for each in cycle.scan.candidates if not _sounds_straight(cycle, each.angle))


def _is_ahead_known(cycle: _Cycle) -> bool:
    """Whether it has been seen what is straight ahead: it is one of the directions D, or closed by something near."""
    obstacle, ahead_m = cycle.settings.obstacle, cycle.scan.nearest_ahead_m
    near_rad = math.radians(obstacle.candidate_step_deg / 2.0) + 1e-6
    is_closed = ahead_m is not None and ahead_m <= obstacle.stop_distance_m
    return is_closed or any(abs(each.angle) <= near_rad for each in cycle.scan.candidates)


def _sounds_straight(cycle: _Cycle, direction: RelativeAngle) -> bool:
    """Whether the walker hears a direction as straight ahead."""
    return abs(direction) <= math.radians(cycle.settings.cues.straight_within_deg)


def _narrow_m(cycle: _Cycle) -> float:
    return max(cycle.settings.obstacle.narrow_clearance_m, cycle.settings.obstacle.stop_distance_m)


def _may_be_narrow(cycle: _Cycle, trace: DecisionTrace) -> bool:
    """Whether the walker may walk where less than δ is free: they began so, or they stand."""
    before = cycle.previous
    if trace.uncertain_since_s is not None:
        # Who does not know where they are has no business in narrow places.
        return False
    if before is None:
        return True
    if before.action is Action.WALK:
        return (before.trace.required_m or 0.0) <= _narrow_m(cycle)
    return trace.stopped_since_s is not None and cycle.stamp_s - trace.stopped_since_s >= _STANDS_AFTER_S


def _goes_round(cycle: _Cycle) -> bool:
    """Whether the frame before led aside, round something: on the spot, then on foot, or with less than δ."""
    before = cycle.previous
    if before is None or before.action is Action.STOP or before.trace.optimal is None:
        return False
    is_narrow = (before.trace.required_m or math.inf) <= _narrow_m(cycle)
    return before.action is Action.TURN or is_narrow or before.trace.goes_round


def _before_obstacle(cycle: _Cycle, error: RelativeAngle, trace: DecisionTrace, reason: Reason, why: _Why) -> Guidance:
    """No step forward. Turn on the spot to where a way is, or may be; stop where neither is so."""
    settings, before, heading = cycle.settings, cycle.previous, trace.heading
    if trace.optimal is not None and abs(trace.optimal) > math.radians(settings.obstacle.candidate_step_deg / 2):
        return cycle.turn(TurnKind.ASIDE, trace.optimal, trace, why.then("turn to the free direction"))
    begun = _begun_aside(cycle, error, heading)
    if begun is not None:
        going_on = replace(trace, optimal=begun)
        return cycle.turn(TurnKind.ASIDE, begun, going_on, why.then("the turn to the free direction goes on"))
    last_look = None if before is None else before.trace.look_target
    waits = trace.stopped_since_s is None or cycle.stamp_s - trace.stopped_since_s < LOOK_AFTER_S
    faces = abs(error) <= _look_threshold_rad(cycle)
    may_look = trace.look_count < SIDES and (last_look is not None or (faces and not waits))
    if may_look and trace.expected is not None and heading is not None:
        target = look_target(trace.expected, cycle.scan, last_look, error, trace.look_count)
        looking = replace(trace, optimal=None, look_target=target, look_count=trace.look_count + 1)
        return cycle.turn(TurnKind.LOOK, relative_to(target, heading), looking, why.then("look aside for a way round"))
    if not faces:
        return cycle.turn_along(error, trace, why.then("turn to look where the route leads"))
    return cycle.stop(reason, trace, why)


def _begun_aside(cycle: _Cycle, error: RelativeAngle, heading: WorldAngle | None) -> RelativeAngle | None:
    """Return what is left of a turn to a free direction that was told in the frame before.

    At the edge of what is free the direction comes and goes with every tremble of the pose. Who is told to stop, and to
    turn, and to stop, does neither; turning on the spot needs no free space, and when it is done it is looked again. It
    is left where it leads somewhere else by now.
    """
    before = cycle.previous
    if before is None or heading is None or before.trace.turn is not TurnKind.ASIDE:
        return None
    begun = _last_direction(cycle, heading)
    if begun is None or abs(begun) <= _FACED_RAD or abs(wrap_rad(error - begun)) > _FARTHEST_ASIDE_RAD:
        return None
    return begun


def _before_echo(cycle: _Cycle, error: RelativeAngle, trace: DecisionTrace, why: _Why) -> Guidance:
    """The rangefinder hears only what is in front, and not how wide it is: turn to where the route leads, or stop."""
    if abs(error) > _look_threshold_rad(cycle):
        return cycle.turn_along(error, trace, why.then("turn to look where the route leads"))
    if trace.optimal is not None and not _sounds_straight(cycle, trace.optimal):
        return cycle.turn(TurnKind.ASIDE, trace.optimal, trace, why.then("turn to the free direction"))
    return cycle.stop(Reason.OBSTACLE_SONAR, trace, why)


def _is_open_ahead(cycle: _Cycle, gate_m: float) -> bool:
    return walking_direction(relative_angle(0.0), cycle.sonar, gate_m, cycle.settings.gate) is not None


def _leave_stop(cycle: _Cycle, direction: RelativeAngle, trace: DecisionTrace, why: _Why) -> Guidance:
    """One frame suffices to stop; leaving a stop, or a turn before something in the way, takes several."""
    before = cycle.previous
    stopped = before is not None and before.action is Action.STOP and before.reason in _LEFT_SLOWLY
    if before is not None and (stopped or before.trace.turn in _ROUND_SOMETHING):
        needed = cycle.settings.obstacle.leave_frames_count
        count = before.trace.free_frame_count + 1
        if count < needed:
            waiting = replace(trace, free_frame_count=count)
            waits = _Why(Rule.FREE_FRAMES, f"free for {count} of {needed} frames since the stop")
            if stopped:
                return cycle.stop(before.reason, waiting, waits)
            return cycle.turn(TurnKind.ASIDE, direction, waiting, waits)
    going = replace(trace, stopped_since_s=None, look_count=0, reversals_count=0, lost_towards=None)
    return cycle.walk(direction, going, why)


def _must_turn(cycle: _Cycle, error: RelativeAngle, is_off_road: bool) -> bool:
    """A turn begins when the expected direction is far to the side, and lasts until it is nearly straight ahead.

    Who is led round something may head farther aside, but not once they have left the road for it.
    """
    follower = cycle.settings.follower
    if _goes_round(cycle) and not is_off_road:
        return abs(error) > _MAX_DETOUR_RAD
    turning = _is_turning_to_expected(cycle)
    return abs(error) > math.radians(follower.turn_settled_deg if turning else follower.turn_angle_deg)


def _is_turning_to_expected(cycle: _Cycle) -> bool:
    """Whether the frame before turned to where the route leads, not aside to a free direction or to look."""
    return cycle.previous is not None and cycle.previous.trace.turn in _TO_THE_ROUTE


def _look_threshold_rad(cycle: _Cycle) -> float:
    """A turn that has begun goes on past the angle that begins one, so that noise does not make it flicker."""
    settled = math.radians(cycle.settings.follower.turn_settled_deg)
    return settled / 2 if _is_turning_to_expected(cycle) else settled


def _last_direction(cycle: _Cycle, heading: WorldAngle) -> RelativeAngle | None:
    """The direction of the frame before, as seen from the present heading."""
    before = cycle.previous
    if before is None or before.direction is None or before.trace.heading is None:
        return None
    return relative_to(in_world(before.direction, before.trace.heading), heading)


def _blocking_reason(cycle: _Cycle, towards: float) -> Reason:
    """Why a direction is closed: a drop, what is nearest, seen or only heard, or nothing that is known at all."""
    scan = cycle.scan
    near = (abs(scan.bearing_rad - towards) < _TOWARDS_RAD) & (scan.nearest_m < cycle.settings.obstacle.clearance_m)
    if not bool(near.any()):
        return Reason.NO_CANDIDATE
    if bool((near & (scan.state == BearingState.DROP)).any()):
        return Reason.DROP_AHEAD
    nearest = int(np.argmin(np.where(near, scan.nearest_m, np.inf)))
    return Reason.OBSTACLE_SONAR if scan.state[nearest] == BearingState.HEARD else Reason.OBSTACLE_DEPTH


def _is_finite(pose: Pose2D) -> bool:
    return math.isfinite(pose.x_m) and math.isfinite(pose.y_m) and math.isfinite(pose.heading)


def _velocity_m_s(cycle: _Cycle, pose: Pose2D, is_held: bool) -> tuple[float, float]:
    before = cycle.walked
    if is_held and before is not None:
        # Whoever walked walks on: they need as much room to stop as before.
        return before.trace.velocity_m_s
    return (0.0, 0.0) if before is None else walking_velocity_m_s(before.trace, cycle.stamp_s - before.stamp_s, pose)


def _is_off_road(trace: DecisionTrace, settings: Settings) -> bool:
    return trace.deviation_m is not None and trace.deviation_m > settings.follower.off_road_distance_m


def _remembered(cycle: _Cycle, trace: DecisionTrace) -> DecisionTrace:
    """Keep the place on the route over a pause."""
    if cycle.previous is None:
        return trace
    before = cycle.previous.trace
    return replace(trace, closest_index=before.closest_index, lost_index=before.lost_index, sub_goal=before.sub_goal)


def _lost(cycle: _Cycle, trace: DecisionTrace, why: _Why) -> Guidance:
    """Stop, and remember only where on the route the walker was: they may be found again on another leg of it.

    Who stays lost is turned once round, on the spot: somebody who faces a wall sees nothing that the map could know.
    """
    before = None if cycle.previous is None else cycle.previous.trace
    index = None if before is None else before.closest_index if before.lost_index is None else before.lost_index
    since_s = cycle.stamp_s if before is None or before.lost_since_s is None else before.lost_since_s
    trace = replace(trace, lost_index=index, lost_since_s=since_s, sure_count=0, lost_towards=_lost_towards(cycle))
    if not LOOK_ROUND_AFTER_S <= cycle.stamp_s - since_s < LOOK_ROUND_AFTER_S + LOOK_ROUND_FOR_S:
        return cycle.stop(Reason.POSE_LOST, trace, why)
    trace = replace(trace, turn=TurnKind.LOOK)
    return cycle.result(Action.TURN, LOOK_ROUND, Reason.POSE_LOST, trace, why.then("look round for a known place"))


def _lost_towards(cycle: _Cycle) -> WorldAngle | None:
    """Return where the walker faced when the pose was lost in a turn to the route, now or before.

    That is a little farther than where it was known last; who was told to stop may have turned on beyond it.
    """
    before = cycle.previous
    if before is None:
        return None
    heading, direction = before.trace.heading, before.direction
    if before.trace.turn not in _TO_THE_ROUTE or heading is None or direction is None:
        return before.trace.lost_towards
    return in_world(relative_angle(math.copysign(_LOST_FARTHER_RAD, direction)), heading)


def _sensed(cycle: _Cycle, localization: Localization) -> DecisionTrace:
    """Begin the trace with what is measured, and with what goes on from the frame before."""
    pose = localization.pose
    before = None if cycle.previous is None else cycle.previous.trace
    uncertain_since_s = None if before is None else before.uncertain_since_s
    stopped_since_s = None if before is None else before.stopped_since_s
    sure = localization.quality is LocalizationQuality.LOCALIZED
    sure_count = None if before is None or before.sure_count is None else before.sure_count + 1 if sure else 0
    if sure_count is not None and sure_count >= cycle.settings.obstacle.leave_frames_count:
        sure_count = None
    velocity_m_s = (0.0, 0.0) if pose is None else _velocity_m_s(cycle, pose, localization.is_held)
    return DecisionTrace(
        heading=None if pose is None else pose.heading,
        position=None if pose is None else (pose.x_m, pose.y_m),
        velocity_m_s=velocity_m_s,
        fastest_m_s=max(
            0.0 if cycle.walked is None else cycle.walked.trace.fastest_m_s,
            min(_FASTEST_M_S, math.hypot(*velocity_m_s)),
        ),
        lost_towards=None if before is None else before.lost_towards,
        rejoined_from=None if before is None else before.rejoined_from,
        candidates=cycle.scan.candidates,
        nearest_ahead_m=cycle.scan.nearest_ahead_m,
        closing_m_s=float(cycle.scan.closing_m_s.max(initial=0.0)),
        sonar_state=cycle.sonar.state,
        sonar_m=echo_distance_m(cycle.sonar),
        sonar_bearing_rad=cycle.sonar.bearing_rad,
        valid_fraction=cycle.scan.valid_fraction,
        stopped_since_s=cycle.stamp_s if stopped_since_s is None else stopped_since_s,
        look_count=0 if before is None else before.look_count,
        reversals_count=0 if before is None else before.reversals_count,
        sure_count=sure_count,
        uncertain_since_s=None if sure else cycle.stamp_s if uncertain_since_s is None else uncertain_since_s,
    )
