"""The settings model: one line each, and everything else made from it."""

import math
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from navcore.errors import SettingError
from navcore.settings import (
    ORDERS,
    SettingOrder,
    Settings,
    SettingSpec,
    not_replayed,
    parse_assignment,
    safety_changes,
    setting_specs,
)

numbers = [spec for spec in setting_specs() if spec.low is not None]


def test_every_setting_says_what_it_is() -> None:
    for spec in setting_specs():
        assert spec.meaning, spec.key
        assert spec.source, spec.key
        if spec.kind in ("float", "int"):
            assert spec.low is not None, spec.key
            assert spec.high is not None, spec.key
            assert spec.step, spec.key
            assert spec.low <= float(spec.default) <= spec.high, spec.key


def test_units_end_the_names_of_numbers() -> None:
    units = {"m", "s", "deg", "px", "hz", "count", "fraction", "rad"}
    assert {spec.name.rsplit("_", 1)[-1] for spec in numbers} <= units


@pytest.mark.parametrize("spec", numbers, ids=lambda spec: spec.key)
def test_out_of_range_is_refused_with_the_range(spec: SettingSpec) -> None:
    assert spec.high is not None
    with pytest.raises(SettingError, match=f"{spec.key} cannot be .*from {spec.low:g} to {spec.high:g}"):
        Settings().changed({spec.key: spec.high * 2 + 1})


@pytest.mark.parametrize(
    "changes",
    [
        {"obstacle.clearance_m": math.nan},
        {"obstacle.clearance_m": math.inf},
        {"obstacle.clearance_m": True},
        {"obstacle.clearance_m": "far"},
        {"obstacle.no_such_m": 1.0},
        {"obstacle.leave_frames_count": 1.5},
        {"cues.language": "fr"},
        {"obstacle.clearance_m": 1.0, "obstacle.stop_distance_m": 1.5},
    ],
)
def test_bad_values_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(SettingError):
        Settings().changed(changes)  # type: ignore[arg-type]


def test_one_bad_value_changes_nothing() -> None:
    settings = Settings()
    with pytest.raises(SettingError):
        settings.changed({"follower.sub_goal_distance_m": 2.0, "gate.clearance_m": 99.0})
    assert settings == Settings()


@given(st.sampled_from(numbers), st.floats(0, 1))
def test_a_change_changes_that_value_alone(spec: SettingSpec, share: float) -> None:
    assert spec.low is not None
    assert spec.high is not None
    value: float | int = spec.low + share * (spec.high - spec.low)
    if spec.kind == "int":
        value = round(value)
    assume(not any(spec.key in (order.lower, order.upper) for order in ORDERS))  # checked against each other, below
    changed = Settings().changed({spec.key: value}).values()
    assert changed.pop(spec.key) == value
    assert changed == {key: old for key, old in Settings().values().items() if key != spec.key}


ROOMY = {
    "obstacle.stop_distance_m": 0.5, "obstacle.narrow_clearance_m": 3.0, "obstacle.clearance_m": 4.0,
    "gate.clearance_m": 4.0, "follower.turn_settled_deg": 3.0, "follower.turn_angle_deg": 90.0,
    "cues.straight_within_deg": 2.0, "follower.turning_reached_m": 0.2, "follower.sub_goal_distance_m": 10.0,
    "follower.off_road_distance_m": 0.3, "planning.replan_deviation_m": 10.0, "planning.blocked_hold_s": 5.0,
    "planning.blocked_memory_s": 3600.0, "deadlines.capture_s": 0.02, "deadlines.capture_to_cue_s": 0.3,
    "watchdog.guidance_timeout_s": 1.0, "map_walk.covered_fraction": 0.0, "map_walk.valid_depth_fraction": 0.9,
}  # fmt: skip
"""Everything so far apart that of two settings that are put out of order nothing else is in the way."""
MEET_AT = dict(zip(ORDERS, (1.5, 3.5, 1.5, 25.0, 25.0, 1.5, 1.5, 60.0, 0.15, 0.3, 0.2), strict=True))
"""A value that both settings may have."""


@pytest.mark.parametrize("order", ORDERS, ids=lambda order: f"{order.lower} under {order.upper}")
def test_related_settings_keep_their_order(order: SettingOrder) -> None:
    meet = MEET_AT[order]
    Settings().changed(ROOMY | {order.lower: meet, order.upper: meet * 1.01})
    with pytest.raises(SettingError) as refused:
        Settings().changed(ROOMY | {order.lower: meet * 1.01, order.upper: meet})
    assert refused.value.keys == (order.lower, order.upper)
    for words in (f"{order.lower} ({meet * 1.01:g}", f"{order.upper} ({meet:g}", order.why, "Change both together."):
        assert words in str(refused.value)
    if order.may_equal:
        Settings().changed(ROOMY | {order.lower: meet, order.upper: meet})
    else:
        with pytest.raises(SettingError):
            Settings().changed(ROOMY | {order.lower: meet, order.upper: meet})


def test_a_chain_of_related_settings_may_be_moved_together() -> None:
    changed = Settings().changed(
        {"obstacle.stop_distance_m": 1.3, "obstacle.narrow_clearance_m": 1.4, "obstacle.clearance_m": 1.4}
    )
    assert changed.obstacle.narrow_clearance_m == changed.obstacle.clearance_m == 1.4
    with pytest.raises(SettingError, match="Change both together"):
        changed.changed({"obstacle.clearance_m": 1.35})


def test_what_safety_hangs_on_is_told_apart() -> None:
    before = Settings()
    after = before.changed({"gate.clearance_m": 1.5, "cues.announce_m": 8.0})
    assert safety_changes(before, after) == ("gate.clearance_m",)


def test_what_a_replay_cannot_show_is_named() -> None:
    keys = ["obstacle.low_height_m", "obstacle.person_width_m", "localization.uncertain_hold_s", "deadlines.guide_s"]
    assert not_replayed(keys) == ("obstacle.low_height_m", "deadlines.guide_s")


def test_the_papers_values_are_in_range_and_in_order() -> None:
    paper = {spec.key: spec.paper for spec in setting_specs() if spec.paper is not None}
    assert paper["follower.policy"] == "paper"
    assert Settings().changed(paper).values() == Settings().values() | paper


def test_values_of_the_command_line() -> None:
    assert parse_assignment("follower.sub_goal_distance_m=2.5") == ("follower.sub_goal_distance_m", 2.5)
    assert parse_assignment("cues.language=zh") == ("cues.language", "zh")
    for bad in ("follower", "nothing.here=1", "gate.clearance_m=[1]", "gate.clearance_m=__import__('os')"):
        with pytest.raises(SettingError):
            parse_assignment(bad)


def test_the_settings_page_of_the_docs_is_current() -> None:
    page = subprocess.run(
        [sys.executable, "-m", "device_agent", "settings", "--markdown"], capture_output=True, text=True, check=True
    )
    assert page.stdout == (Path(__file__).parent.parent / "docs" / "settings.md").read_text(encoding="utf-8")
