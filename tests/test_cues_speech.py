"""What is heard: enough to walk by, nothing twice, the important first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from closed_loop import route_along
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from navcore.angles import relative_angle, world_angle
from navcore.cues.bus import PAUSE_S, CueBus, play
from navcore.cues.memory import CueMemory
from navcore.cues.speech import cues_for, message_cue, repeat_last, say
from navcore.cues.synthesis import beep_cue, beep_interval_s, steer_cue, stop_cue, tick_cue, tone_samples
from navcore.cues.table import PRIORITY, Cue, CueKind, CuePriority
from navcore.cues.texts import STOP_TEXTS, TEXTS, Language, speech_duration_s
from navcore.settings import Settings
from navcore.types import Action, DecisionTrace, Guidance, Reason, RouteStop, SonarState

SETTINGS = Settings()
ROUTE = route_along((0, 0), (30, 0), name="Bar")


def guidance(
    action: Action, stamp_s: float, angle_deg: float | None = None, reason: Reason = Reason.OK,
    heading_deg: float = 0.0, **trace,
) -> Guidance:  # fmt: skip
    direction = None if angle_deg is None else relative_angle(math.radians(angle_deg))
    trace.setdefault("sonar_state", SonarState.NO_ECHO)
    trace.setdefault("velocity_m_s", (0.85, 0.0) if action is Action.WALK else (0.0, 0.0))
    return Guidance(
        stamp_s, action, direction, reason, DecisionTrace(heading=world_angle(math.radians(heading_deg)), **trace), 1
    )


def heard(stream, memory: CueMemory | None = None, settings: Settings = SETTINGS) -> list[Cue]:
    memory, cues = memory or CueMemory(), []
    for each in stream:
        played, memory = cues_for(each, memory, ROUTE, settings, each.stamp_s)
        assert len(played) <= 1, "one voice"
        cues += played
    return cues


def kinds(cues: list[Cue]) -> list[CueKind]:
    return [cue.kind for cue in cues]


@hypothesis_settings(deadline=None)
@given(st.lists(st.floats(-35, 35), min_size=30, max_size=60))
def test_while_walking_it_is_never_silent_for_long(angles_deg: list[float]):
    cues = heard(guidance(Action.WALK, i / 10, angle) for i, angle in enumerate(angles_deg))
    assert cues[0].kind is CueKind.WALK
    ends = [cue.stamp_s + max(cue.duration_s, len(cue.text) / 15.0) for cue in cues]
    begins = [cue.stamp_s for cue in cues[1:]] + [len(angles_deg) / 10]
    assert max(b - a for a, b in zip(ends, begins, strict=True)) <= SETTINGS.cues.tick_interval_s + 0.11


def test_straight_on_is_ticks_and_aside_is_steering():
    straight = heard(guidance(Action.WALK, i / 10, 0.0) for i in range(50))
    assert set(kinds(straight[1:])) == {CueKind.TICK}
    aside = heard(guidance(Action.WALK, i / 10, 20.0) for i in range(50))
    assert set(kinds(aside[1:])) == {CueKind.STEER}
    assert all(cue.angle_deg == 20.0 and cue.pan < 0 for cue in aside[1:])


def test_a_turn_is_said_once_while_it_is_under_way_and_again_when_it_falls_short():
    turning = [guidance(Action.TURN, i / 10, 90 - 30 * max(0, i / 10 - 1), heading_deg=30 * max(0, i / 10 - 1))
               for i in range(32)]  # fmt: skip
    cues = heard(turning)
    assert [(cue.kind, cue.angle_deg) for cue in cues] == [(CueKind.TURN, 90.0)]
    standing = [guidance(Action.TURN, 3.2 + i / 10, 24.0, heading_deg=66.0) for i in range(15)]
    assert [cue.angle_deg for cue in heard(turning + standing)] == [90.0, 25.0]


def test_a_turn_nobody_follows_is_said_again_after_the_repeat_time():
    cues = heard(guidance(Action.TURN, i / 10, -90.0) for i in range(65))
    assert [round(cue.stamp_s, 1) for cue in cues] == pytest.approx([0.0, 3.0, 6.0], abs=0.11)
    assert all("right" in cue.text for cue in cues)


@pytest.mark.parametrize("language", ["en", "zh"])
def test_a_turn_is_not_said_again_while_it_is_still_being_heard(language: str):
    """Whoever sways while they listen has not turned and stopped."""
    settings = SETTINGS.changed({"cues.language": language, "cues.direction_style": "clock"})
    sways = [guidance(Action.TURN, i / 10, 90.0 - (4.0 if 2 <= i < 4 else 0.0), heading_deg=4.0 if 2 <= i < 4 else 0.0)
             for i in range(24)]  # fmt: skip
    assert kinds(heard(sways, settings=settings)) == [CueKind.TURN]


def test_stop_is_immediate_and_gives_the_reason():
    walking = [guidance(Action.WALK, i / 10, 0.0) for i in range(10)]
    stop = guidance(Action.STOP, 1.0, None, Reason.DROP_AHEAD)
    cue = heard([*walking, stop])[-1]
    assert (cue.kind, cue.stamp_s, cue.text) == (CueKind.STOP, 1.0, STOP_TEXTS["en"][Reason.DROP_AHEAD])
    again = [guidance(Action.STOP, 1.1 + i / 10, None, Reason.DROP_AHEAD) for i in range(50)]
    assert kinds(heard([*walking, stop, *again])).count(CueKind.STOP) == 1


def test_a_walk_after_a_stop_is_said_even_while_the_stop_is_still_spoken():
    stream = [guidance(Action.STOP, 0.0, None, Reason.OBSTACLE_SONAR), guidance(Action.WALK, 0.3, 0.0)]
    assert kinds(heard(stream)) == [CueKind.STOP, CueKind.WALK]


def test_somebody_who_stands_is_not_talked_to_at_every_flicker():
    stream = [
        guidance(Action.STOP, i / 10, None, Reason.OBSTACLE_DEPTH if i % 2 else Reason.NO_CANDIDATE) for i in range(40)
    ]
    assert len(heard(stream)) <= 2


def test_places_are_announced_once_and_reassurance_comes_every_ten_metres():
    stream = (guidance(Action.WALK, i / 10, 0.0, remaining_m=30 - i * 0.08) for i in range(360))
    cues = heard(stream)
    places = [cue for cue in cues if cue.kind is CueKind.POI_AHEAD]
    assert len(places) == 1
    assert "Bar" in places[0].text
    assert places[0].distance_m == pytest.approx(6.0, abs=1.0)
    assert kinds(cues).count(CueKind.REASSURANCE) == 2


def test_arrival_names_the_place():
    cue = heard([guidance(Action.WALK, 0.0, 0.0), guidance(Action.STOP, 0.1, None, Reason.ARRIVED)])[-1]
    assert cue.kind is CueKind.ARRIVED
    assert "Bar" in cue.text


def test_a_lost_rangefinder_is_said_once_and_so_is_its_return():
    stream = [guidance(Action.WALK, i / 10, 0.0, sonar_state=SonarState.STALE if 20 <= i < 60 else SonarState.OK)
              for i in range(100)]  # fmt: skip
    texts = [cue.text for cue in heard(stream) if cue.kind is CueKind.MESSAGE]
    assert texts == [TEXTS["en"]["sonar_lost"], TEXTS["en"]["sonar_back"]]


def test_chinese_is_complete_and_spoken():
    assert TEXTS["zh"].keys() == TEXTS["en"].keys()
    assert STOP_TEXTS["zh"].keys() == STOP_TEXTS["en"].keys() == set(Reason)
    settings = SETTINGS.changed({"cues.language": "zh"})
    assert heard([guidance(Action.TURN, 0.0, 45.0)], settings=settings)[0].text == "向左转45度。"


def test_a_message_waits_for_what_is_more_important_and_can_be_repeated():
    played, memory = cues_for(guidance(Action.STOP, 0.0, None, Reason.PAUSED), CueMemory(), ROUTE, SETTINGS, 0.0)
    assert kinds(list(played)) == [CueKind.STOP]
    now, memory = say("Your friend is coming.", memory, SETTINGS, 0.1)
    assert now == ()
    later, memory = cues_for(guidance(Action.STOP, 2.0, None, Reason.PAUSED), memory, ROUTE, SETTINGS, 2.0)
    assert [cue.text for cue in later] == ["Your friend is coming."]
    again, _ = repeat_last(guidance(Action.STOP, 9.0, None, Reason.PAUSED), memory, SETTINGS, 9.0)
    assert [cue.text for cue in again] == ["Your friend is coming."]


def test_an_instruction_is_repeated_only_while_it_holds():
    walking = guidance(Action.WALK, 0.0, 0.0)
    played, memory = cues_for(walking, CueMemory(), ROUTE, SETTINGS, 0.0)
    assert kinds(list(played)) == [CueKind.WALK]
    again, repeated = repeat_last(replace(walking, stamp_s=3.0), memory, SETTINGS, 3.0)
    assert [cue.text for cue in again] == [cue.text for cue in played]
    stop = guidance(Action.STOP, 3.2, None, Reason.OBSTACLE_DEPTH)
    assert repeat_last(stop, memory, SETTINGS, 3.2)[0] == ()
    said, repeated = cues_for(stop, repeated, ROUTE, SETTINGS, 3.2)
    for tenth in range(33, 100):
        late, repeated = cues_for(replace(stop, stamp_s=tenth / 10), repeated, ROUTE, SETTINGS, tenth / 10)
        said += late
    assert {cue.kind for cue in said} == {CueKind.STOP}, "what was cut off by a stop does not come back after it"


spoken = st.builds(
    lambda kind, stamp: Cue(stamp, kind, PRIORITY[kind], kind.value),
    st.sampled_from([CueKind.STOP, CueKind.TURN, CueKind.MESSAGE, CueKind.POI_AHEAD]),
    st.just(0.0),
)


@hypothesis_settings(deadline=None)
@given(st.lists(st.tuples(spoken, st.floats(0, 0.5)), max_size=20))
def test_nothing_lower_cuts_off_something_higher(sequence):
    bus, now_s = CueBus(), 0.0
    for cue, pause_s in sequence:
        now_s += pause_s
        before = bus.speaking.priority if bus.speaking and bus.is_speaking(now_s) else CuePriority.POI
        played, bus = play(bus, [Cue(now_s, cue.kind, cue.priority, cue.text)], now_s, "en", lambda _: True)
        assert all(each.priority >= before for each in played)
        assert len({each.priority for each in bus.waiting}) == len(bus.waiting)


@pytest.mark.parametrize("language", ["en", "zh"])
def test_of_a_message_that_is_cut_off_what_was_heard_is_not_said_again(language: Language):
    """Each turn on the spot cuts it off; with none of them is "The way is blocked" heard anew."""
    text = TEXTS[language]["way_blocked"].format(metres=23)
    first = text[: text.index("." if language == "en" else "。") + 1]
    heard_s = 1.4 * (speech_duration_s(first, language) + PAUSE_S)
    for cut_s, rest in ((heard_s - 0.1, text), (heard_s + 0.1, text.removeprefix(first).strip())):
        _, bus = play(CueBus(), [message_cue(0.0, text)], 0.0, language, lambda _: True)
        _, bus = play(bus, [stop_cue(cut_s, Reason.PAUSED)], cut_s, language, lambda _: True)
        (again,), bus = play(bus, [], cut_s + 5.0, language, lambda _: True)
        assert again.text == rest
        _, bus = play(bus, [stop_cue(cut_s + 5.1, Reason.PAUSED)], cut_s + 5.1, language, lambda _: True)
        (once_more,), _ = play(bus, [], cut_s + 10.0, language, lambda _: True)
        assert once_more.text == rest, "nothing is lost"


def test_an_instruction_that_is_asked_for_again_is_told_whole():
    whole = replace(message_cue(0.0, "Turn right. 45 degrees."), repeats=CueKind.TURN)
    _, bus = play(CueBus(), [whole], 0.0, "en", lambda _: True)
    _, bus = play(bus, [stop_cue(1.9, Reason.PAUSED)], 1.9, "en", lambda _: True)
    assert play(bus, [], 5.5, "en", lambda _: True)[0] == (whole,)


def test_an_interrupted_sentence_is_said_again_only_if_it_still_holds():
    for holds in (True, False):
        bus = CueBus()
        place = Cue(0.0, CueKind.POI_AHEAD, CuePriority.POI, "Bar in 6 metres.")
        _, bus = play(bus, [place], 0.0, "en", lambda _: True)
        _, bus = play(bus, [stop_cue(0.2, Reason.PAUSED)], 0.2, "en", lambda _: True)
        played, bus = play(bus, [], 3.0, "en", lambda _, holds=holds: holds)
        assert played == ((place,) if holds else ())


@hypothesis_settings(deadline=None)
@given(st.floats(-60, 60))
def test_the_tone_is_heard_from_where_to_walk(angle_deg: float):
    cue = steer_cue(0.0, angle_deg)
    samples = tone_samples(cue).astype(float)
    assert samples.shape == (round(cue.duration_s * 16_000), 2)
    left, right = np.square(samples).sum(axis=0)
    if abs(angle_deg) > 1:
        assert (left > right) == (angle_deg > 0)
    mirrored = tone_samples(steer_cue(0.0, -angle_deg)).astype(float)
    assert np.abs(samples - mirrored[:, ::-1]).max() <= 1
    assert np.abs(samples[[0, -1]]).max() < 2000, "no click"


def test_the_beep_rises_and_quickens():
    distances = np.linspace(0.0, 4.0, 9)
    pitches = [beep_cue(0.0, float(d), 4.0).frequency_hz for d in distances]
    pauses = [beep_interval_s(float(d), 4.0) for d in distances]
    assert pitches == sorted(pitches, reverse=True)
    assert (pitches[0], pitches[-1]) == (1200.0, 600.0)
    assert pauses == sorted(pauses)
    assert (pauses[0], pauses[-1]) == pytest.approx((0.1, 1.0))
    assert tone_samples(tick_cue(0.0)).any()
    assert tone_samples(message_cue(0.0, "Wait.")).shape == (0, 2)


def test_stop_is_heard_even_without_a_voice():
    assert np.abs(tone_samples(stop_cue(0.0, Reason.OK))).max() > 8000


def test_a_momentary_failure_is_not_talked_about():
    stream = (
        guidance(
            Action.WALK, i / 10, 0.0, sonar_state=SonarState.STALE if i % 7 == 0 else SonarState.OK,
            uncertain_since_s=i / 10 - 0.2 if i % 9 < 5 else None,
        )
        for i in range(200)
    )  # fmt: skip
    assert CueKind.MESSAGE not in kinds(heard(stream))


def test_notices_that_come_together_are_each_said_and_none_for_ever():
    """Uncertain and off the road at once: said one after the other, not the first one over and over."""
    stream = (
        guidance(Action.WALK, i / 10, 0.0, Reason.OFF_ROAD, uncertain_since_s=0.0, sonar_state=SonarState.STALE)
        for i in range(150)
    )
    texts = [cue.text for cue in heard(stream) if cue.kind is CueKind.MESSAGE]
    assert texts[:2] == [TEXTS["en"]["off_road"], TEXTS["en"]["sonar_lost"]]
    assert texts.count(TEXTS["en"]["pose_uncertain"]) == 1
    assert texts.count(TEXTS["en"]["off_road"]) == 2, "every ten seconds"


def test_a_notice_does_not_take_the_place_of_a_message_that_waits():
    _, memory = cues_for(guidance(Action.TURN, 0.0, 90.0, Reason.OFF_ROAD), CueMemory(), ROUTE, SETTINGS, 0.0)
    _, memory = say("Your friend is coming.", replace(memory, off_road_s=-math.inf), SETTINGS, 0.1)
    stream = [guidance(Action.TURN, i / 10, 90.0, Reason.OFF_ROAD) for i in range(2, 60)]
    assert "Your friend is coming." in [cue.text for cue in heard(stream, memory)]


def test_what_is_told_once_is_not_lost_behind_turns():
    """Ten seconds of turning to and fro, each turn said at once: the message is said when it is quiet."""
    _, memory = cues_for(guidance(Action.TURN, 0.0, 90.0), CueMemory(), ROUTE, SETTINGS, 0.0)
    _, memory = say("Another way: 32 metres.", memory, SETTINGS, 0.1)
    turns = [guidance(Action.TURN, i / 10, 40.0 if i // 10 % 2 else -40.0, heading_deg=i % 360) for i in range(2, 100)]
    quiet = [guidance(Action.STOP, i / 10, None, Reason.PAUSED) for i in range(100, 140)]
    assert "Another way: 32 metres." in [cue.text for cue in heard([*turns, *quiet], memory)]


def test_an_announcement_that_steering_cuts_off_is_not_begun_again_and_again():
    """Somebody who wobbles: an announcement waits until they walk straight, and is said once."""
    stream = (
        guidance(Action.WALK, i / 10, 0.0 if i % 25 < 14 else 20.0, remaining_m=30 - i * 0.08) for i in range(330)
    )
    texts = [cue.text for cue in heard(stream) if cue.kind in (CueKind.REASSURANCE, CueKind.POI_AHEAD)]
    assert texts
    assert len(texts) == len(set(texts))


def test_no_turn_is_told_that_nobody_can_make():
    cue = heard([guidance(Action.TURN, 0.0, -3.0)])[0]
    assert (cue.angle_deg, cue.text) == (-10.0, "Turn right 10 degrees.")


def test_a_turn_is_said_again_even_where_the_heading_never_rests():
    stream = (guidance(Action.TURN, i / 10, 60.0, heading_deg=6.0 * (i % 2)) for i in range(120))
    assert kinds(heard(stream)).count(CueKind.TURN) == 2


def test_a_silent_junction_is_passed_in_silence():
    stops = (RouteStop("j", "Junction 1", 10.0, is_silent=True), *ROUTE.stops)
    memory, cues = CueMemory(), []
    for i in range(330):
        each = guidance(Action.WALK, i / 10, 0.0, remaining_m=30 - i * 0.08)
        played, memory = cues_for(each, memory, replace(ROUTE, stops=stops), SETTINGS, i / 10)
        cues += played
    assert [cue.text for cue in cues if cue.kind is CueKind.POI_AHEAD] == ["Bar in 6 metres."]
