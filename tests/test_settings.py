"""The settings model: one line each, and everything else made from it."""

import math
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from navcore.errors import SettingError
from navcore.settings import Settings, SettingSpec, parse_assignment, setting_specs

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
    together = {"obstacle.stop_distance_m", "obstacle.clearance_m"}
    assume(spec.key not in together)  # checked against each other, above
    changed = Settings().changed({spec.key: value}).values()
    assert changed.pop(spec.key) == value
    assert changed == {key: old for key, old in Settings().values().items() if key != spec.key}


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
