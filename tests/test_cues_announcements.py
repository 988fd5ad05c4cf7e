"""What is announced comes at the right distance for the walking speed, and no more of it than the walker wants."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from closed_loop import route_along, walk
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from test_guide_closed_loop import CORRIDOR, ROUND_THE_CORNER

from navcore.angles import relative_angle, world_angle
from navcore.cues.announcements import (
    LEAST_SHARE,
    MOST_SHARE,
    place_distances_m,
    turn_distances_m,
)
from navcore.cues.memory import CueMemory
from navcore.cues.speech import cues_for, say
from navcore.cues.table import Cue, CueKind, is_said
from navcore.cues.texts import EXPLANATIONS, STOP_TEXTS, speech_duration_s
from navcore.follower.corner_ahead import corner_ahead
from navcore.settings import Settings
from navcore.types import (
    Action,
    CornerAhead,
    DecisionTrace,
    Guidance,
    Reason,
    Route,
    RoutePiece,
    RouteStop,
    SonarState,
    SubGoal,
    SubGoalCase,
)

SETTINGS = Settings()
REACTION_S = SETTINGS.follower.reaction_s
LENGTH_M = 40.0
STRAIGHT = route_along((0, 0), (LENGTH_M, 0))
FRAME_S = 0.1


def walked(
    speed_m_s: float, stops: tuple[RouteStop, ...] = (), settings: Settings = SETTINGS, corner_m: float | None = None,
    turn_m: float = 1.2, bend_deg: float = 90.0, from_m: float = 0.0, pieces: tuple[RoutePiece, ...] = (), **trace,
) -> list[Cue]:  # fmt: skip
    """Return what is heard on the way along a straight road at a steady speed."""
    route = Route(STRAIGHT.points_m, STRAIGHT.arc_length_m, stops, pieces)
    memory, cues = CueMemory(), []
    for frame in range(int((LENGTH_M - from_m) / speed_m_s / FRAME_S)):
        now_s, done_m = frame * FRAME_S, from_m + frame * FRAME_S * speed_m_s
        corner = None
        if corner_m is not None and done_m < corner_m:
            index = round(corner_m / 0.1)
            corner = CornerAhead(index, corner_m - done_m, relative_angle(math.radians(bend_deg)), turn_m)
        guidance = Guidance(
            now_s, Action.WALK, relative_angle(0.0), Reason.OK,
            DecisionTrace(
                heading=world_angle(0.0), position=(done_m, 0.0), velocity_m_s=(speed_m_s, 0.0), corner=corner,
                closest_index=round(done_m / 0.1), remaining_m=LENGTH_M - done_m, sonar_state=SonarState.NO_ECHO,
            ),
            1,
        )  # fmt: skip
        played, memory = cues_for(replace(guidance, trace=replace(guidance.trace, **trace)), memory, route, settings,
                                  now_s)  # fmt: skip
        cues += played
    return cues


def of_kind(cues: list[Cue], kind: CueKind) -> list[Cue]:
    return [cue for cue in cues if cue.kind is kind]


speeds = st.floats(0.3, 1.8)


@hypothesis_settings(deadline=None, max_examples=20)
@given(speeds, st.integers(1, 80), st.floats(20.0, 30.0), st.sampled_from(["en", "zh"]))
def test_a_place_is_announced_so_that_the_walker_can_react_when_the_sentence_is_over(
    speed_m_s: float, name_length: int, place_m: float, language: str
) -> None:
    settings = SETTINGS.changed({"cues.language": language, "cues.reassurance_m": 50.0})
    stop = RouteStop("p", "m" * name_length, place_m)
    (cue,) = of_kind(walked(speed_m_s, (stop,), settings), CueKind.POI_AHEAD)
    over_m = cue.stamp_s * speed_m_s + speed_m_s * speech_duration_s(cue.text, language)
    assert place_m - over_m >= speed_m_s * REACTION_S - 1e-6
    assert cue.distance_m == pytest.approx(place_m - cue.stamp_s * speed_m_s, abs=1e-6)


@pytest.mark.parametrize("speed_m_s", [0.75, 0.85, 0.95])
def test_at_the_usual_speed_it_is_six_metres(speed_m_s: float) -> None:
    (cue,) = of_kind(walked(speed_m_s, (RouteStop("p", "Bar", 25.0),)), CueKind.POI_AHEAD)
    assert cue.distance_m == pytest.approx(6.0, abs=1.0)


@given(speeds, speeds, st.floats(0.5, 8.0))
def test_the_faster_the_earlier_within_the_documented_range(first: float, second: float, sentence_s: float) -> None:
    slow, fast = sorted((first, second))
    (slow_latest, slow_earliest), (fast_latest, fast_earliest) = (
        place_distances_m(speed, sentence_s, SETTINGS) for speed in (slow, fast)
    )
    assert slow_latest <= fast_latest
    assert slow_earliest <= fast_earliest
    for latest, earliest in ((slow_latest, slow_earliest), (fast_latest, fast_earliest)):
        usual_m = SETTINGS.cues.announce_m
        assert latest < earliest
        assert LEAST_SHARE * usual_m <= earliest <= max(MOST_SHARE * usual_m, latest + 1.0)


def test_a_place_that_is_too_near_for_the_sentence_is_not_announced() -> None:
    """Whoever starts just before a place passes it before they would have heard its name."""
    stop = RouteStop("p", "The long name of a place that takes long to say", 2.5)
    assert not of_kind(walked(0.85, (stop,)), CueKind.POI_AHEAD)


@pytest.mark.parametrize("verbosity", ["brief", "normal", "full"])
def test_stairs_are_a_warning_at_every_verbosity_and_late_rather_than_never(verbosity: str) -> None:
    settings = SETTINGS.changed({"cues.verbosity": verbosity})
    for place_m in (25.0, 2.5):
        stop = RouteStop("s", "North", place_m, is_silent=True, kind="stairs")
        (cue,) = of_kind(walked(0.85, (stop,), settings), CueKind.HAZARD_AHEAD)
        assert cue.text.startswith("Caution, stairs in ")
        assert cue.stamp_s * 0.85 < place_m


@hypothesis_settings(deadline=None, max_examples=20)
@given(speeds, st.floats(0.3, 2.0), st.sampled_from(["normal", "full"]), st.sampled_from(["degrees", "clock", "sides"]),
       st.sampled_from(["en", "zh"]), st.floats(-170, 170).filter(lambda bend: abs(bend) > 45))  # fmt: skip
def test_a_turn_is_announced_once_and_the_sentence_is_over_before_the_turn(
    speed_m_s: float, turn_m: float, verbosity: str, style: str, language: str, bend_deg: float
) -> None:
    settings = SETTINGS.changed(
        {"cues.verbosity": verbosity, "cues.direction_style": style, "cues.language": language,
         "cues.reassurance_m": 50.0}
    )  # fmt: skip
    cues = walked(speed_m_s, (), settings, corner_m=25.0, turn_m=turn_m, bend_deg=bend_deg)
    (cue,) = of_kind(cues, CueKind.TURN_AHEAD)
    over_s = cue.stamp_s + speech_duration_s(cue.text, language)
    due_s = (25.0 - turn_m) / speed_m_s
    assert over_s <= due_s
    assert due_s - over_s <= settings.cues.turn_lead_s + 2 * FRAME_S + 0.25
    assert cue.angle_deg is None, "nothing is to be done yet"
    left, right = ("left", "right") if language == "en" else ("左", "右")
    if verbosity == "normal" or style != "clock":
        assert (left if bend_deg > 0 else right) in cue.text
        assert (right if bend_deg > 0 else left) not in cue.text


@given(speeds, speeds, st.floats(0.5, 5.0), st.floats(0.3, 2.0))
def test_the_faster_the_earlier_a_turn_is_announced(first: float, second: float, sentence_s: float, turn_m: float):
    slow, fast = (turn_distances_m(speed, sentence_s, turn_m, SETTINGS) for speed in sorted((first, second)))
    assert slow[0] <= fast[0]
    assert slow[1] <= fast[1]
    assert turn_m < slow[0] <= slow[1]


def test_a_turn_is_announced_in_the_words_of_the_verbosity() -> None:
    def said(**changes: str) -> list[str]:
        settings = SETTINGS.changed({f"cues.{name}": value for name, value in changes.items()})
        return [cue.text for cue in of_kind(walked(0.85, (), settings, corner_m=25.0), CueKind.TURN_AHEAD)]

    assert said() == ["In 4 metres turn left."]
    assert said(verbosity="full") == ["In 5 metres: turn left 90 degrees."]
    assert said(verbosity="full", direction_style="clock") == ["In 5 metres: turn to 9 o'clock."]
    assert said(verbosity="full", language="zh") == ["4米后,向左转90度。"]
    assert said(verbosity="brief") == []


def test_of_two_corners_each_is_announced() -> None:
    first = walked(0.85, (), corner_m=15.0)
    assert len(of_kind(first, CueKind.TURN_AHEAD)) == 1
    memory, cues = CueMemory(), []
    for frame in range(400):
        done_m = frame * 0.085
        corner_m = 15.0 if done_m < 15.0 else 30.0
        corner = CornerAhead(round(corner_m * 10), corner_m - done_m, relative_angle(1.5), 1.2)
        trace = DecisionTrace(
            heading=world_angle(0.0), velocity_m_s=(0.85, 0.0), corner=corner, remaining_m=LENGTH_M - done_m,
            sonar_state=SonarState.NO_ECHO,
        )  # fmt: skip
        guidance = Guidance(frame * FRAME_S, Action.WALK, relative_angle(0.0), Reason.OK, trace, 1)
        played, memory = cues_for(guidance, memory, STRAIGHT, SETTINGS, frame * FRAME_S)
        cues += played
    assert len(of_kind(cues, CueKind.TURN_AHEAD)) == 2


@pytest.mark.parametrize("policy", ["paper", "road_centred"])
def test_the_corner_that_is_foreseen_is_the_one_where_the_walker_is_turned(policy: str) -> None:
    """In the closed loop: announced to the side to which they are then turned, and over before the turn."""
    settings = SETTINGS.changed({"follower.policy": policy, "cues.verbosity": "full"})
    result = walk(CORRIDOR, ROUND_THE_CORNER, (0, 0, 0), seed=1, limit_s=60.0, settings=settings)
    assert result.arrived
    (ahead,) = of_kind(result.cues, CueKind.TURN_AHEAD)
    turns = [cue for cue in of_kind(result.cues, CueKind.TURN) if cue.stamp_s > ahead.stamp_s]
    assert "left" in ahead.text
    assert max(cue.angle_deg or 0.0 for cue in turns) > 60.0
    assert ahead.stamp_s + speech_duration_s(ahead.text, "en") <= turns[0].stamp_s


def test_no_corner_is_foreseen_on_a_straight_road_or_one_that_was_passed() -> None:
    goal = SubGoal(5.0, 0.0, SubGoalCase.STRAIGHT, 50)
    assert corner_ahead(STRAIGHT, 10, goal, 0.85, SETTINGS.follower) is None
    seen = corner_ahead(ROUND_THE_CORNER, 60, goal, 0.85, SETTINGS.follower)
    assert seen is not None
    assert seen.distance_m == pytest.approx(4.0, abs=0.2)
    assert seen.bend == pytest.approx(math.pi / 2, abs=0.1)
    passed = replace(goal, passed_index=seen.route_index)
    assert corner_ahead(ROUND_THE_CORNER, 98, passed, 0.85, SETTINGS.follower) is None


# -------------------------------------------------------------------------------------------- caution and narrow
def edges(*begins_m: float, **changes) -> tuple[RoutePiece, ...]:
    """Pieces of the straight road that begin so; the second is the one that something is known of."""
    ends_m = (*begins_m[1:], LENGTH_M)
    pieces = [RoutePiece(f"e{i}", a, b, 0.0, b - a) for i, (a, b) in enumerate(zip(begins_m, ends_m, strict=True))]
    return (pieces[0], replace(pieces[1], **changes), *pieces[2:])


@pytest.mark.parametrize("verbosity", ["brief", "normal", "full"])
@pytest.mark.parametrize(("language", "left"), [("en", "Caution on the left."), ("zh", "注意左边。")])
def test_caution_is_said_at_every_verbosity_once_as_the_edge_begins(verbosity: str, language: str, left: str) -> None:
    settings = SETTINGS.changed({"cues.verbosity": verbosity, "cues.language": language})
    cues = walked(0.85, (), settings, pieces=edges(0.0, 15.0, 30.0, caution_side="left", width_m=0.8))
    (caution,), (narrow,) = (of_kind(cues, kind) for kind in (CueKind.CAUTION_SIDE, CueKind.NARROW_PASSAGE))
    assert (caution.text, caution.angle_deg) == (left, None), "it says where something is, not where to go"
    # A sentence that has begun is heard out first.
    assert 15.0 <= caution.stamp_s * 0.85 < 18.0
    assert caution.stamp_s < narrow.stamp_s < 25.0 / 0.85


@pytest.mark.parametrize("action", [Action.TURN, Action.STOP])
def test_whoever_stands_on_the_edge_is_not_told_of_its_sides_before_they_walk(action: Action) -> None:
    """At a corner they still face another way."""
    route = Route(STRAIGHT.points_m, STRAIGHT.arc_length_m, (), edges(0.0, 10.0, caution_side="right"))
    memory, kinds = CueMemory(), []
    for frame in range(60):
        now_s, walks = frame * FRAME_S, frame >= 30
        trace = DecisionTrace(heading=world_angle(0.0), remaining_m=28.0, sonar_state=SonarState.NO_ECHO)
        direction = relative_angle(0.0 if walks else 1.5)
        guidance = Guidance(now_s, Action.WALK if walks else action, direction, Reason.OK, trace, 1)
        played, memory = cues_for(guidance, memory, route, SETTINGS, now_s)
        kinds += [(walks, cue.kind) for cue in played]
    assert (False, CueKind.CAUTION_SIDE) not in kinds
    assert kinds.count((True, CueKind.CAUTION_SIDE)) == 1


@hypothesis_settings(deadline=None, max_examples=30)
@given(speeds, st.floats(10.0, 20.0), st.floats(3.0, 12.0), st.booleans(), st.sampled_from(["en", "zh"]))
def test_neither_caution_nor_reassurance_makes_a_place_be_told_late(
    speed_m_s: float, begin_m: float, ahead_m: float, is_narrow: bool, language: str
) -> None:
    settings = SETTINGS.changed({"cues.language": language})
    place = RouteStop("p", "Bar", begin_m + ahead_m)
    pieces = edges(0.0, begin_m, begin_m + ahead_m, caution_side="both", width_m=0.75 if is_narrow else None)
    cues = walked(speed_m_s, (place,), settings, pieces=pieces)
    told = of_kind(cues, CueKind.POI_AHEAD)[-1]
    assert told.distance_m is not None
    latest_m, earliest_m = place_distances_m(speed_m_s, speech_duration_s(told.text, language), settings)
    assert latest_m <= told.distance_m <= earliest_m
    cautions = of_kind(cues, CueKind.CAUTION_SIDE)
    assert cautions[-1].stamp_s * speed_m_s - begin_m <= ahead_m / 2.0, "late only rather than not early on its edge"


def test_caution_that_words_cut_off_is_said_again() -> None:
    route = Route(STRAIGHT.points_m, STRAIGHT.arc_length_m, (), edges(0.0, 5.0, caution_side="left"))
    memory, cues = CueMemory(), []
    for frame in range(150):
        now_s, done_m = frame * FRAME_S, frame * 0.085
        trace = DecisionTrace(
            heading=world_angle(0.0), velocity_m_s=(0.85, 0.0), remaining_m=LENGTH_M - done_m,
            sonar_state=SonarState.NO_ECHO,
        )  # fmt: skip
        guidance = Guidance(now_s, Action.WALK, relative_angle(0.0), Reason.OK, trace, 1)
        played, memory = cues_for(guidance, memory, route, SETTINGS, now_s)
        cues += played
        if played and played[0].kind is CueKind.CAUTION_SIDE and len(of_kind(cues, CueKind.CAUTION_SIDE)) == 1:
            spoken, memory = say("Your friend is coming.", memory, SETTINGS, now_s + 0.05)
            cues += spoken
    assert [cue.kind for cue in cues if cue.kind in (CueKind.CAUTION_SIDE, CueKind.MESSAGE)] == [
        CueKind.CAUTION_SIDE, CueKind.MESSAGE, CueKind.CAUTION_SIDE,
    ]  # fmt: skip


@pytest.mark.parametrize("corner_m", [14.4, 15.0, 15.6, 16.2, 16.8])
def test_all_is_well_does_not_drown_a_turn(corner_m: float) -> None:
    """Ten metres have been walked about where the turn is to be announced: both are told."""
    cues = walked(0.85, (), corner_m=corner_m)
    (turn,) = of_kind(cues, CueKind.TURN_AHEAD)
    assert abs(of_kind(cues, CueKind.REASSURANCE)[0].stamp_s - turn.stamp_s) < 5.0


# ---------------------------------------------------------------------------------------------------- verbosity
@pytest.mark.parametrize("verbosity", ["brief", "normal", "full"])
def test_no_more_is_said_than_the_verbosity_allows(verbosity: str) -> None:
    settings = SETTINGS.changed({"cues.verbosity": verbosity})
    stops = (RouteStop("p", "Bar", 12.0), RouteStop("goal", "Room", LENGTH_M))
    cues = walked(0.85, stops, settings, corner_m=30.0, deviation_m=0.7, position=(0.0, 0.7))
    kinds = {cue.kind for cue in cues}
    assert all(is_said(kind, verbosity) for kind in kinds)
    assert {CueKind.WALK, CueKind.TICK} <= kinds
    extra = {CueKind.POI_AHEAD, CueKind.REASSURANCE, CueKind.TURN_AHEAD}
    assert kinds & extra == (set() if verbosity == "brief" else extra)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([Action.WALK, Action.TURN, Action.STOP]), st.floats(-90, 90), st.sampled_from(list(Reason)),
            st.integers(1, 25), st.one_of(st.none(), st.floats(0.2, 5.0)),
        ),
        min_size=1, max_size=6,
    )
)  # fmt: skip
@hypothesis_settings(deadline=None, max_examples=60)
def test_what_safety_hangs_on_does_not_depend_on_the_verbosity(phases) -> None:
    """Stops, turns and the beginnings of a walk are said in the same words, and a stop in the same frame."""

    def said(verbosity: str) -> list[Cue]:
        settings, memory, cues, now_s = SETTINGS.changed({"cues.verbosity": verbosity}), CueMemory(), [], 0.0
        for action, angle_deg, reason, frames, near_m in phases:
            for _ in range(frames):
                now_s += FRAME_S
                direction = None if action is Action.STOP else relative_angle(math.radians(angle_deg))
                trace = DecisionTrace(
                    heading=world_angle(0.0), sonar_state=SonarState.OK, nearest_ahead_m=near_m,
                    velocity_m_s=(0.8, 0.0), remaining_m=max(0.0, 30.0 - 0.8 * now_s),
                )  # fmt: skip
                guidance = Guidance(now_s, action, direction, reason, trace, 1)
                played, memory = cues_for(guidance, memory, STRAIGHT, settings, now_s)
                cues += played
        return cues

    instructions = (CueKind.STOP, CueKind.ARRIVED, CueKind.TURN, CueKind.WALK)
    brief, full = (
        [(cue.stamp_s, cue.kind, cue.text, cue.angle_deg) for cue in said(level) if cue.kind in instructions]
        for level in ("brief", "full")
    )
    assert brief == full


def test_a_stop_is_explained_after_it_and_only_where_that_is_wanted() -> None:
    def heard(verbosity: str, frames: int = 100) -> list[Cue]:
        settings, memory, cues = SETTINGS.changed({"cues.verbosity": verbosity}), CueMemory(), []
        for frame in range(frames):
            trace = DecisionTrace(sonar_state=SonarState.OK)
            guidance = Guidance(frame * FRAME_S, Action.STOP, None, Reason.DROP_AHEAD, trace, 1)
            played, memory = cues_for(guidance, memory, None, settings, frame * FRAME_S)
            cues += played
        return cues

    stop, explanation = (texts["en"][Reason.DROP_AHEAD] for texts in (STOP_TEXTS, EXPLANATIONS))
    assert [cue.text for cue in heard("normal")] == [stop, stop]
    assert [cue.text for cue in heard("full")] == [stop, explanation, stop]
    first, second, _ = heard("full")
    assert second.stamp_s >= first.stamp_s + speech_duration_s(stop, "en")


@pytest.mark.parametrize(("y_m", "side"), [(0.7, "right"), (-0.7, "left")])
def test_whoever_walks_beside_the_road_hears_where_it_is(y_m: float, side: str) -> None:
    settings = SETTINGS.changed({"cues.verbosity": "full", "cues.reassurance_m": 50.0})
    route, memory, cues = Route(STRAIGHT.points_m, STRAIGHT.arc_length_m), CueMemory(), []
    for frame in range(150):
        done_m = frame * 0.085
        trace = DecisionTrace(
            heading=world_angle(0.0), position=(done_m, y_m), velocity_m_s=(0.85, 0.0), deviation_m=abs(y_m),
            closest_index=round(done_m / 0.1), remaining_m=LENGTH_M - done_m, sonar_state=SonarState.NO_ECHO,
        )  # fmt: skip
        guidance = Guidance(frame * FRAME_S, Action.WALK, relative_angle(0.0), Reason.OK, trace, 1)
        played, memory = cues_for(guidance, memory, route, settings, frame * FRAME_S)
        cues += played
    texts = [cue.text for cue in of_kind(cues, CueKind.DEVIATION)]
    assert texts == [f"The road is 0.7 metres to your {side}."] * 2, "every ten seconds"


def test_an_announcement_that_words_cut_off_comes_again_with_a_true_distance() -> None:
    stop, memory, cues = RouteStop("p", "Bar", 25.0), CueMemory(), []
    route = Route(STRAIGHT.points_m, STRAIGHT.arc_length_m, (stop,))
    settings = SETTINGS.changed({"cues.reassurance_m": 50.0})
    for frame in range(300):
        now_s, done_m = frame * FRAME_S, frame * 0.085
        trace = DecisionTrace(
            heading=world_angle(0.0), velocity_m_s=(0.85, 0.0), remaining_m=LENGTH_M - done_m,
            sonar_state=SonarState.NO_ECHO,
        )  # fmt: skip
        guidance = Guidance(now_s, Action.WALK, relative_angle(0.0), Reason.OK, trace, 1)
        played, memory = cues_for(guidance, memory, route, settings, now_s)
        cues += played
        if played and played[0].kind is CueKind.POI_AHEAD and len(of_kind(cues, CueKind.POI_AHEAD)) == 1:
            spoken, memory = say("Your friend is coming.", memory, settings, now_s + 0.05)
            cues += spoken
    places = of_kind(cues, CueKind.POI_AHEAD)
    assert len(places) == 2
    for cue in places:
        assert cue.distance_m == pytest.approx(25.0 - cue.stamp_s * 0.85, abs=1e-6)
        assert f"{cue.distance_m:.0f} metres" in cue.text
