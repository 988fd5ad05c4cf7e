"""What is worth an alert, and the life of one: the table of rules, and laws over any course of events."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from console.alerts import lifecycle
from console.alerts.lifecycle import Change, Life, Phase
from console.alerts.rules import (
    RULES,
    AlertKind,
    Finding,
    Observation,
    Priority,
    Rule,
    Verdict,
    judge,
    observe,
    sentence_of,
)
from console.live import LiveDevice
from navcore.modes import Mode
from navcore.types import Reason
from navcore.wire import Hello, WalkerState


def seen(*, silent_s: float = 0.1, was_led: bool = True, **changes: Any) -> Observation:
    values: dict[str, Any] = {
        "stamp_s": 0.0, "quality": "localized", "action": "walk", "reason": "ok", "mode": Mode.GUIDING,
        "destination_id": "b", "deviation_m": 0.2, "speed_m_s": 0.8, "sonar_state": "no_echo",
        "battery_percent": 80.0, "temperature_c": 50.0, "eye_m": 1.6, "tilt_rad": 0.2,
    }  # fmt: skip
    return Observation(WalkerState(**(values | changes)), silent_s, was_led)


FINE = seen()
BAD: tuple[tuple[AlertKind, Observation, str], ...] = (
    ("fall_suspected", seen(eye_m=0.6), "Ada may have fallen: eyes above the floor 0.6 m."),
    ("fall_suspected", seen(eye_m=None, tilt_rad=math.radians(-80)), "fallen: tilt of the head 80°."),
    ("link_lost", Observation(None, 7.2, True), "Nothing new from Ada for 7 s, and somebody was being led."),
    ("device_fault", seen(mode=Mode.FAULT, reason="sensor_stale"), "A sensor has stopped delivering."),
    ("device_fault", seen(mode=Mode.FAULT, reason="arrived"), "Ada has stopped the walker: its own log says why."),
    ("battery_empty", seen(battery_percent=7.6), "The battery of Ada is at 8 %."),
    ("position_lost", seen(mode=Mode.LOST, quality="lost", reason="pose_lost"), "does not know where the walker is"),
    ("no_way", seen(action="stop", reason="no_candidate"), "No way on for Ada. No free direction in view."),
    ("broke_off", Observation(None, 1.0, False, broke_off=True), "Ada leads the walker no more: they have not"),
    ("off_road", seen(deviation_m=2.3), "Ada is 2.3 m off the road."),
    ("stalled", seen(speed_m_s=0.02), "Ada is told to walk, and moves at 0.02 m/s."),
    ("battery_low", seen(battery_percent=19.0), "The battery of Ada is at 19 %."),
    ("too_hot", seen(temperature_c=84.0, mode=Mode.READY), "Ada is at 84 °C."),
    ("sensors_disagree", seen(sonar_state="ok", sonar_m=1.4), "4.6 m nearer than the depth camera sees: glass?"),
    ("sensors_disagree", seen(sonar_state="ok", sonar_m=1.4, nearest_ahead_m=1.4, reason="obstacle_sonar"), "1.0 m"),
    ("sonar_silent", seen(sonar_state="stale"), "Ada leads by the depth camera alone: nothing comes from the sonar"),
    ("sonar_silent", seen(sonar_state="absent"), "glass is seen by nothing else."),
)  # fmt: skip


@pytest.mark.parametrize(("kind", "observation", "sentence"), BAD)
def test_what_is_wrong_is_found_and_told_with_its_figures(
    kind: AlertKind, observation: Observation, sentence: str
) -> None:
    rule = RULES[kind]
    found = judge(rule, observation, was_holding=False)
    assert found.verdict is Verdict.HOLDS
    assert sentence in sentence_of(rule, found, observation, "Ada")
    assert judge(rule, FINE, was_holding=True).verdict is Verdict.NORMAL


def test_each_kind_is_tried_and_a_walk_in_good_order_raises_nothing() -> None:
    assert {kind for kind, _, _ in BAD} == set(RULES)
    assert {judge(rule, FINE, was_holding=False).verdict for rule in RULES.values()} == {Verdict.NORMAL}


@pytest.mark.parametrize("kind", RULES)
def test_what_is_stale_raises_nothing_else_and_ends_nothing(kind: AlertKind) -> None:
    stale = Observation(None, 60.0, True, broke_off=True)
    for was_holding in (False, True):
        verdict = judge(RULES[kind], stale, was_holding).verdict
        assert verdict is (Verdict.HOLDS if kind in ("link_lost", "broke_off") else Verdict.UNKNOWN)


@pytest.mark.parametrize("reason", [*(reason.value for reason in Reason), "a reason of a newer device"])
def test_whoever_is_guided_and_told_to_stand_is_not_overlooked_whatever_the_reason(reason: str) -> None:
    told_otherwise = {Reason.ARRIVED.value, Reason.PAUSED.value, Reason.NO_ROUTE.value, Reason.POSE_LOST.value}
    verdict = judge(RULES["no_way"], seen(action="stop", reason=reason), was_holding=False).verdict
    assert verdict is (Verdict.NORMAL if reason in told_otherwise else Verdict.HOLDS)
    assert judge(RULES["no_way"], seen(action="walk", reason=reason), was_holding=True).verdict is Verdict.NORMAL


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.GUIDING])
def test_a_silent_sonar_matters_to_nobody_who_is_not_led(mode: Mode) -> None:
    assert (
        judge(RULES["sonar_silent"], seen(sonar_state="absent", mode=mode), was_holding=True).verdict is Verdict.NORMAL
    )


@pytest.mark.parametrize("reason", ["depth_invalid", "sensor_stale"])
@pytest.mark.parametrize("seen_m", [None, 6.0])
def test_where_the_depth_camera_is_not_believed_nothing_is_said_of_glass(reason: str, seen_m: float | None) -> None:
    heard = seen(action="stop", reason=reason, sonar_state="ok", sonar_m=1.4, nearest_ahead_m=seen_m)
    for was_holding in (False, True):
        assert judge(RULES["sensors_disagree"], heard, was_holding).verdict is Verdict.UNKNOWN


def test_a_figure_that_is_missing_ends_nothing() -> None:
    rule = RULES["fall_suspected"]
    assert judge(rule, seen(eye_m=None), was_holding=True).verdict is Verdict.UNKNOWN
    assert judge(rule, seen(eye_m=None), was_holding=False).verdict is Verdict.NORMAL
    nothing = seen(eye_m=None, tilt_rad=math.nan)
    assert judge(rule, nothing, was_holding=False).verdict is Verdict.UNKNOWN


@pytest.mark.parametrize("kind", [kind for kind, rule in RULES.items() if rule.quantities])
def test_between_its_two_limits_a_condition_stays_what_it_was(kind: AlertKind) -> None:
    for number, quantity in enumerate(RULES[kind].quantities):
        middle = (quantity.raise_at + quantity.clear_at) / 2.0
        trembling = replace(quantity, measure=lambda _, middle=middle: middle)
        others = (
            replace(each, measure=lambda _, e=each: 2 * e.clear_at - e.raise_at) for each in RULES[kind].quantities
        )
        quantities = [trembling if at == number else other for at, other in enumerate(others)]
        rule = replace(RULES[kind], quantities=tuple(quantities), when=lambda _: True)
        assert judge(rule, FINE, was_holding=True).verdict is Verdict.HOLDS
        assert judge(rule, FINE, was_holding=False).verdict is Verdict.NORMAL


def test_a_device_is_believed_only_while_it_is_connected_and_what_it_says_is_fresh() -> None:
    state = WalkerState(100.0, "localized", "walk", "ok", mode=Mode.GUIDING)
    hello = Hello(6, "g", "1", "s", "m", 0, 0, 0.0)
    device = LiveDevice("g", "Ada", hello, True, 0.0, 0.0, 0.01, state=state)
    assert observe(device, 101.0, 100.0, False) == Observation(state, 1.0, True)
    assert observe(device, 106.0, 100.0, True) == Observation(None, 6.0, True)
    assert observe(replace(device, connected=False), 101.0, 100.0, True).state is None
    assert observe(None, 101.0, 100.0, False) == Observation(None, 1.0, False)


# ---------------------------------------------------------------------------------------------------- the life of one
RULE = replace(RULES["no_way"], on_delay_s=2.0, off_delay_s=3.0, escalate_after_s=10.0, priority=Priority.MEDIUM)
H, N, U = Verdict.HOLDS, Verdict.NORMAL, Verdict.UNKNOWN
acts = st.one_of(
    st.tuples(st.sampled_from([H, N, U]), st.floats(0.1, 5.0)),
    st.sampled_from(["acknowledge", "shelve", "unshelve"]).map(lambda act: (act, 0.0)),
)


def played(events: list[tuple[Any, float]], rule: Rule = RULE) -> list[tuple[Life, Any, float, tuple[Change, ...]]]:
    """Return the life after each event, with the event, the time and what has happened."""
    life, now_s, course = Life(), 0.0, []
    for what, after_s in events:
        now_s += after_s
        match what:
            case "acknowledge":
                life, changes = lifecycle.acknowledge(life)
            case "shelve":
                life, changes = lifecycle.shelve(life, now_s + 8.0)
            case "unshelve":
                life, changes = lifecycle.unshelve(life, now_s)
            case verdict:
                life, changes = lifecycle.step(life, rule, verdict, now_s)
        course.append((life, what, now_s, changes))
    return course


@settings(deadline=None)
@given(st.lists(acts, max_size=40))
def test_an_alert_ends_only_by_an_acknowledgement_and_never_without_a_trace(events: list[tuple[Any, float]]) -> None:
    before, acknowledged = Life(), False
    for life, what, _, changes in played(events):
        if Change.RAISED in changes:
            acknowledged = False
        acknowledged = acknowledged or what == "acknowledge"
        assert (life.phase is before.phase) or changes, "a change that nobody is told of"
        if before.is_open and not life.is_open:
            assert acknowledged
            assert Change.CLOSED in changes
        before = life


@settings(deadline=None)
@given(st.lists(acts, max_size=40))
def test_what_is_unknown_raises_nothing_and_returns_nothing(events: list[tuple[Any, float]]) -> None:
    before = Life()
    for life, what, _, changes in played(events):
        if what is U:
            assert not {Change.RAISED, Change.AGAIN, Change.RETURNED} & set(changes)
            assert life.is_active == before.is_active
        before = life


@settings(deadline=None)
@given(st.lists(acts, max_size=40))
def test_a_shelf_ends_by_itself_and_what_holds_then_is_unacknowledged(events: list[tuple[Any, float]]) -> None:
    course = played(events)
    assert all(life.shelved_until_s is None or life.shelved_until_s > now_s - 8.0 for life, _, now_s, _ in course)
    for life, _, now_s, changes in course:
        if isinstance(changes, tuple) and Change.SHELF_ENDED in changes:
            assert life.phase is (Phase.UNACKNOWLEDGED if life.is_active else life.phase)
            assert life.phase is not Phase.SHELVED
        later, _ = lifecycle.step(life, RULE, U, now_s + 100.0)
        assert later.phase is not Phase.SHELVED


@settings(deadline=None)
@given(st.lists(st.sampled_from([H, N, U]), min_size=1, max_size=60))
def test_a_condition_that_chatters_is_raised_once(verdicts: list[Verdict]) -> None:
    course = played([(verdict, 1.0) for verdict in verdicts])
    raised = sum(Change.RAISED in changes for _, _, _, changes in course)
    assert raised <= 1, "nobody has acknowledged the first one"


def phases(*events: tuple[Any, float]) -> list[Phase]:
    return [life.phase for life, _, _, _ in played(list(events))]


def test_it_is_raised_after_its_delay_and_returns_after_the_other() -> None:
    un, ret = Phase.UNACKNOWLEDGED, Phase.RETURNED
    assert phases((H, 1.0), (H, 1.9), (H, 0.1)) == [Phase.NORMAL, Phase.NORMAL, un]
    assert phases((H, 0), (N, 1), (H, 1), (H, 1.5)) == [Phase.NORMAL] * 4, "it must hold without a break"
    assert phases((H, 0), (H, 2), (N, 1), (N, 2.9), (N, 0.1)) == [Phase.NORMAL, un, un, un, ret]
    assert phases((H, 0), (H, 2), (N, 1), (U, 1), (N, 2), (N, 3))[-2:] == [un, ret], "unknown is not normal"
    again = played([(H, 0.0), (H, 2.0), (N, 1.0), (N, 3.0), (H, 1.0), (H, 2.0)])
    assert again[-1][0].phase is un
    assert again[-1][3] == (Change.AGAIN,)


def test_acknowledged_it_ends_when_it_returns_and_a_shelf_hides_neither() -> None:
    course = [(H, 0.0), (H, 2.0), ("acknowledge", 0.0), (N, 1.0), (N, 3.0)]
    assert phases(*course)[-3:] == [Phase.ACKNOWLEDGED, Phase.ACKNOWLEDGED, Phase.NORMAL]
    shelved = [(H, 0.0), (H, 2.0), ("acknowledge", 0.0), ("shelve", 0.0), (N, 1.0), (N, 3.0), (H, 1.0), (H, 2.0)]
    assert phases(*shelved)[-4:] == [Phase.SHELVED] * 4
    assert phases(*shelved, (H, 2.0))[-1] is Phase.UNACKNOWLEDGED, "it holds when its time on the shelf is up"
    assert phases(*shelved, ("unshelve", 0.0))[-1] is Phase.UNACKNOWLEDGED


def test_what_nobody_acknowledges_goes_up_one_step_and_what_is_shelved_does_not() -> None:
    raised = [(H, 0.0), (H, 2.0)]
    priorities = [life.priority for life, _, _, _ in played([*raised, (H, 9.9), (H, 0.1), (H, 50.0)])]
    assert priorities[1:] == [Priority.MEDIUM, Priority.MEDIUM, Priority.HIGH, Priority.HIGH]
    for act in ("acknowledge", "shelve"):
        assert played([*raised, (act, 0.0), (H, 5.0), (U, 2.9)])[-1][0].priority is Priority.MEDIUM
    low = replace(RULE, priority=Priority.LOW)
    assert played([*raised, (H, 10.0), (H, 90.0)], low)[-1][0].priority is Priority.MEDIUM


def test_every_rule_has_something_to_say_and_its_limits_lie_the_right_way() -> None:
    for rule in RULES.values():
        assert rule.advice.endswith(".")
        assert sentence_of(rule, Finding(Verdict.HOLDS, "x", "1 m"), FINE, "Ada")
        assert rule.on_delay_s >= 0.0
        assert rule.off_delay_s > 0.0
        for quantity in rule.quantities:
            assert quantity.raise_at != quantity.clear_at
            assert quantity.is_beyond(quantity.raise_at, quantity.clear_at)
            assert not quantity.is_beyond(quantity.clear_at, quantity.raise_at)
