"""Why a decision is what it is: the sentence contradicts nothing, and calls nothing free that nobody has seen."""

from __future__ import annotations

import itertools
import math
import re
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from message_strategies import messages

from navcore.decision_facts import facts_of
from navcore.decision_steps import steps_of
from navcore.explain import explain
from navcore.modes import Mode
from navcore.types import Action, BearingState, Reason, Rule
from navcore.wire import WalkerState
from navcore.wire_trace import DecisionLimits, DecisionTraceView, WireCandidate, WireScan

LIMITS = DecisionLimits(0.8, 2.0, 3.0, 0.7, math.radians(7.5), 1.0, 0.52, 0.7, math.radians(10.0), 1.0, 3.0, 0.3, 3)
FREE, OBSTACLE, DROP, UNKNOWN, HEARD = BearingState
BEGINS = {"walk": "Walk", "turn": "Turn", "stop": "Stop"}
NOT_FREE = re.compile(r"\b(?:no|not|nothing)\b[^;.]*?\bfree\b")


def scan_of(*states: int, nearest_m: float = 2.0) -> WireScan:
    """A scan of 1° bearings about straight ahead."""
    first_rad = math.radians(-(len(states) - 1) / 2.0)
    nearest_cm = tuple(0 if each in (FREE, UNKNOWN) else round(100 * nearest_m) for each in states)
    return WireScan(first_rad, math.radians(1.0), tuple(int(each) for each in states), nearest_cm)


def state(action: str = "stop", reason: str = "ok", rule: Rule | None = None, **changes: Any) -> WalkerState:
    traced = {each: changes.pop(each) for each in DecisionTraceView.__struct_fields__ if each in changes}
    trace = DecisionTraceView(
        **({"decided": "" if rule is None else rule.value, "limits": LIMITS, "scan": scan_of(*(FREE,) * 61)} | traced)
    )
    values = {"mode": Mode.GUIDING, "quality": "localized", "pose": (0.0, 0.0, 1.6, 0.0), "trace": trace}
    return WalkerState(1.0, action=action, reason=reason, **(values | changes))  # type: ignore[arg-type]


def check(told: WalkerState) -> str:
    """Hold a sentence against the laws, and return it."""
    explanation = explain(told)
    sentence = explanation.sentence
    assert sentence.startswith(BEGINS[told.action])
    assert sentence[-1] in ".?"
    assert len(sentence) > len("Walk: .")
    assert not any(f"{verb} " in sentence for action, verb in BEGINS.items() if action != told.action)
    assert "None" not in sentence
    assert "nan" not in sentence
    assert "inf" not in sentence.replace("information", "")
    assert all(step.name and step.found for step in explanation.steps)
    assert sum(step.decides for step in explanation.steps) <= 1
    return sentence


def test_who_is_led_to_the_road_first_is_said_to_be():
    sentence = check(state("walk", "ok", Rule.TO_EXPECTED, direction_rad=0.0, deviation_m=0.6, rejoins=True))
    assert "to the road first" in sentence
    turned = state("turn", "ok", Rule.FAR_ASIDE, direction_rad=-1.2, turn="along", rejoins=True, deviation_m=0.6)
    assert "to the road first" in check(turned)
    assert "to the road first" not in check(msgspec.structs.replace(turned, trace=DecisionTraceView()))


@pytest.mark.parametrize("action", Action, ids=lambda each: each.value)
def test_every_action_with_every_reason_and_rule_is_explained_without_contradiction(action: Action):
    direction_rad = None if action is Action.STOP else 0.5
    said = set()
    for reason, rule, turn in itertools.product(Reason, [None, *Rule], ["along", "around", "aside", "look"]):
        blind = state(
            action.value, reason.value, rule, direction_rad=direction_rad, scan=scan_of(*(UNKNOWN,) * 61),
            turn=turn if action is Action.TURN else None,
        )  # fmt: skip
        sentence = check(blind)
        assert "free" not in NOT_FREE.sub("", sentence), sentence
        check(msgspec.structs.replace(blind, trace=None))
        said.add(sentence)
    assert len(said) >= {Action.WALK: 3, Action.TURN: 8, Action.STOP: 25}[action], "it is told what it is about"


@settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(messages(WalkerState), st.sampled_from([None, *Rule]), st.sampled_from([each.value for each in Reason]))
def test_any_state_at_all_is_explained(told: WalkerState, rule: Rule | None, reason: str):
    # Words of the device are quoted; what others may write there says nothing of these laws.
    told = msgspec.structs.replace(told, rule="", reason=reason, destination_id=None)
    if told.trace is not None and rule is not None:
        told = msgspec.structs.replace(told, trace=msgspec.structs.replace(told.trace, decided=rule.value))
    sentence = check(told)
    is_seen = told.candidates or (told.trace and told.trace.scan and FREE in told.trace.scan.states)
    assert is_seen or "free" not in NOT_FREE.sub("", sentence)


def test_each_rule_is_decided_by_one_step_and_those_after_it_were_not_reached():
    for rule in Rule:
        steps = steps_of(facts_of(state(rule=rule)))
        decisive = [i for i, step in enumerate(steps) if step.decides]
        assert len(decisive) == 1, rule
        assert {step.outcome for step in steps[: decisive[0]]} <= {"passed"}
        assert {step.outcome for step in steps[decisive[0] + 1 :]} <= {"not reached"}
    assert {step.outcome for step in steps_of(facts_of(state(rule=None)))} == {""}, "of an unknown rule nothing is told"


OPEN = (FREE,) * 61
HOLE = (*(FREE,) * 28, *(UNKNOWN,) * 5, *(FREE,) * 28)
WALL = (OBSTACLE,) * 61
ECHO = {"reason": "obstacle_sonar", "sonar_state": "ok", "sonar_m": 1.4}
RIGHT_30 = math.radians(-30.0)
CASES = (
    ("Stop: the sonar hears something at 1.4 m where the depth camera sees free: glass?",
     state(rule=Rule.GATE_CLOSED, **ECHO)),
    ("Stop: the sonar hears something at 1.4 m where the depth camera cannot tell what is there.",
     state(rule=Rule.GATE_CLOSED, scan=scan_of(*HOLE), **ECHO)),
    ("Stop: the sonar hears something at 1.4 m where the depth camera cannot tell what is there.",
     state(rule=Rule.GATE_CLOSED, sonar_rad=math.radians(29.0), **ECHO)),
    ("Stop: the sonar hears something at 1.4 m where the depth camera cannot tell what is there.",
     state(rule=Rule.GATE_CLOSED, **(ECHO | {"reason": "depth_invalid"}))),
    ("Stop: the sonar hears something at 1.4 m, and the depth camera sees something at 1.5 m.",
     state(rule=Rule.ECHO_NEAR, scan=scan_of(*WALL, nearest_m=1.5), **ECHO)),
    ("Stop: the place in the map has been unknown for 4 s.",
     state("stop", "pose_lost", Rule.POSE_LOST, quality="lost", pose=None, lost_s=4.0)),
    ("Stop: only 12% of the depth picture carries a depth, less than the 30% that are needed: what is ahead is"
     " unknown.",
     state("stop", "depth_invalid", Rule.DEPTH_INVALID, valid_fraction=0.12)),
    ("Stop: the floor falls away 0.7 m ahead, nearer than the 0.8 m that are needed to come to a stand.",
     state("stop", "drop_ahead", Rule.NEAR_AHEAD, nearest_ahead_m=0.7)),
    ("Turn left 85°: the way bends here.",
     state("turn", "ok", Rule.FAR_ASIDE, turn="along", direction_rad=math.radians(85.0), is_at_corner=True)),
    ("Turn around by the right: the way leads behind.",
     state("turn", "ok", Rule.FAR_ASIDE, turn="around", direction_rad=math.radians(-170.0))),
    ("Turn right 30°: something is in the way 0.6 m ahead, nearer than the 0.8 m that are needed to come to a stand;"
     " that way is free for 2.1 m.",
     state("turn", "ok", Rule.NEAR_AHEAD, turn="aside", direction_rad=RIGHT_30, nearest_ahead_m=0.6,
           candidates=(WireCandidate(RIGHT_30, 2.1, True),))),
    ("Walk 12° right: round something 1.9 m ahead.",
     state("walk", "ok", Rule.TO_EXPECTED, direction_rad=math.radians(-12.0), expected_rad=0.0, nearest_ahead_m=1.9,
           sonar_state="ok", sonar_m=4.0)),
    ("Walk straight ahead: along the way; by the depth camera alone, for the sonar is silent.",
     state("walk", "ok", Rule.TO_EXPECTED, direction_rad=0.01, expected_rad=0.0, sonar_state="stale")),
)  # fmt: skip


@pytest.mark.parametrize(("sentence", "told"), CASES, ids=lambda each: each[:40] if isinstance(each, str) else "")
def test_what_matters_is_said_in_figures(sentence: str, told: WalkerState):
    assert check(told) == sentence
