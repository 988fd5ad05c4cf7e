"""How a decision came about, as plain data for JSON: for the picture, the sentence and the table of the page."""

from __future__ import annotations

from typing import Any

import msgspec

from navcore.decision_facts import facts_of
from navcore.explain import explain
from navcore.wire import WalkerState
from navcore.wire_trace import DecisionTraceView

_OWN_FIELDS = tuple(
    name for name in DecisionTraceView.__struct_fields__ if name not in ("limits", "scan", "corner")
)  # fmt: skip


def trace_view(state: WalkerState) -> dict[str, Any]:
    """Return a decision with all angles relative to the heading; the trace's own fields keep their names.

    The sentence and the steps are there for every state; ``is_told`` says whether the device has told its trace.
    """
    facts, trace = facts_of(state), state.trace or DecisionTraceView()
    explanation, goal = explain(state), facts.sub_goal
    return {
        "stamp_s": state.stamp_s,
        "is_told": state.trace is not None,
        "sentence": explanation.sentence,
        "steps": msgspec.to_builtins(explanation.steps),
        **{name: getattr(trace, name) for name in _OWN_FIELDS},
        "limits": msgspec.structs.asdict(trace.limits),
        "corner": None if trace.corner is None else msgspec.structs.asdict(trace.corner),
        "scan": None if trace.scan is None else msgspec.structs.asdict(trace.scan),
        "expected_rad": facts.expected_rad,
        "sub_goal": None if goal is None else {"bearing_rad": goal[0], "distance_m": goal[1]},
        "sub_goal_case": state.sub_goal_case,
        "candidates": state.candidates,
    }
