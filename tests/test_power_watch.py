"""The walker hears that the battery ends, without a console: once at each limit, again while it is nearly empty."""

from __future__ import annotations

import threading
from contextlib import ExitStack

import pytest
from device_hall import Rig
from hypothesis import given
from hypothesis import strategies as st

from device_agent.adapters.fakes import FakeHost
from device_agent.device_process import _watch_power
from device_agent.ports import HostHealth
from device_agent.power_watch import (
    CHARGED_BY_PERCENT,
    COOL_C,
    HOT_C,
    LOW_PERCENT,
    NEARLY_EMPTY_PERCENT,
    SAID_AGAIN_AFTER_S,
    PowerTold,
    PowerWatch,
    looked,
)
from device_agent.sensors import Hardware
from navcore.cues.texts import TEXTS
from navcore.errors import SensorError, VbrError
from navcore.modes import Mode


class Watched:
    """A watch, the machine that it looks at, and what has been said."""

    def __init__(self) -> None:
        self.host, self.said, self.on_duty, self.now_s = FakeHost(), list[str](), True, 0.0
        self.fails = False
        self.watch = PowerWatch(self.host.read, lambda: self.on_duty, self._say, lambda: self.now_s)

    def _say(self, key: str) -> None:
        if self.fails:
            raise VbrError("The device is too busy to take more orders: try again.")
        assert all(key in TEXTS[language] for language in ("en", "zh"))
        self.said.append(key)

    def look(self, after_s: float = 5.0, **health: object) -> list[str]:
        """Look once more; return what is said."""
        self.now_s += after_s
        self.host.health = HostHealth(**health)  # type: ignore[arg-type]
        before = len(self.said)
        self.watch.look()
        return self.said[before:]


def test_a_battery_that_runs_down_is_told_of_at_each_limit_and_again_while_it_is_nearly_empty() -> None:
    watched = Watched()
    assert watched.look(battery_percent=LOW_PERCENT + 1) == []
    assert watched.look(battery_percent=LOW_PERCENT) == ["battery_low"]
    assert watched.look(battery_percent=LOW_PERCENT + CHARGED_BY_PERCENT) == [], "a gauge that trembles is no news"
    assert watched.look(battery_percent=LOW_PERCENT - 1) == []
    assert watched.look(battery_percent=NEARLY_EMPTY_PERCENT) == ["battery_empty"]
    assert watched.look(SAID_AGAIN_AFTER_S - 1, battery_percent=5.0) == []
    assert watched.look(1.0, battery_percent=5.0) == ["battery_empty"]
    assert watched.look(battery_percent=5.0, is_charging=True) == []
    assert watched.look(battery_percent=5.0, is_charging=False) == ["battery_empty"], "taken off the charger too early"


def test_a_battery_that_was_charged_is_told_of_again() -> None:
    watched = Watched()
    watched.look(battery_percent=10.0)
    assert watched.look(battery_percent=LOW_PERCENT + CHARGED_BY_PERCENT + 1) == []
    assert watched.look(battery_percent=10.0) == ["battery_low"]


def test_what_is_hot_is_told_once_until_it_was_cool() -> None:
    watched = Watched()
    assert watched.look(temperature_c=HOT_C - 1) == []
    assert watched.look(temperature_c=HOT_C) == ["device_hot"]
    assert watched.look(temperature_c=COOL_C) == watched.look(temperature_c=HOT_C) == []
    assert watched.look(temperature_c=COOL_C - 1) == []
    assert watched.look(temperature_c=HOT_C, battery_percent=1.0) == ["battery_empty", "device_hot"]


def test_off_duty_nothing_is_said_and_on_duty_it_is_not_forgotten() -> None:
    watched = Watched()
    watched.on_duty = False
    assert watched.look(battery_percent=1.0) == []
    watched.on_duty = True
    assert watched.look(battery_percent=1.0) == ["battery_empty"]


def test_who_could_not_be_told_is_told_at_the_next_look() -> None:
    watched = Watched()
    watched.fails = True
    assert watched.look(battery_percent=1.0) == []
    watched.fails = False
    assert watched.look(battery_percent=1.0) == ["battery_empty"]


@given(
    st.sampled_from([None, LOW_PERCENT, NEARLY_EMPTY_PERCENT]), st.booleans(), st.sampled_from([None, False]),
)  # fmt: skip
def test_what_is_unknown_changes_nothing(limit: float | None, is_hot: bool, is_charging: bool | None) -> None:
    told = PowerTold(limit, 0.0, is_hot)
    assert looked(told, HostHealth(is_charging=is_charging), 1e6) == (told, ())


def test_whoever_is_led_hears_it_and_is_led_on() -> None:
    rig = Rig()
    rig.lead_to()
    camera = rig.agent._parts.camera
    hardware = Hardware(camera, rig.sonar, rig.output, host=FakeHost(HostHealth(battery_percent=5.0)))
    with ExitStack() as stack:
        _watch_power(hardware, rig.agent, rig.clock, stack)
    # Its first look comes before it heeds that it is stopped.
    rig.cycles(60)
    assert any(cue.text == TEXTS["en"]["battery_empty"] for cue in rig.output.cues)
    assert rig.agent.state.mode is Mode.GUIDING


def test_a_look_that_fails_is_not_the_last_one() -> None:
    looked_once, said = threading.Event(), threading.Event()

    def read() -> HostHealth:
        if not looked_once.is_set():
            looked_once.set()
            raise SensorError("The battery cannot be read: see to its cable.")
        return HostHealth(battery_percent=1.0)

    watch = PowerWatch(read, lambda: True, lambda key: said.set(), lambda: 0.0)
    watch.start()
    try:
        assert looked_once.wait(20.0)
        watch._looking.wake()
        assert said.wait(20.0)
    finally:
        watch.stop()


def test_the_limits_are_those_of_the_alerts() -> None:
    """Device and console share no code; who reads docs/alerts.md must be able to rely on it for both."""
    from console.alerts.rules import RULES

    def limits(kind: str) -> tuple[float, float]:
        (quantity,) = RULES[kind].quantities  # type: ignore[index]
        return quantity.raise_at, quantity.clear_at

    assert limits("battery_low")[0] == LOW_PERCENT
    assert limits("battery_empty")[0] == NEARLY_EMPTY_PERCENT
    assert limits("too_hot") == (HOT_C, COOL_C)


@pytest.mark.parametrize("language", ["en", "zh"])
def test_a_walker_hears_it_in_their_language(language: str) -> None:
    assert len({TEXTS[language][key] for key in ("battery_low", "battery_empty", "device_hot")}) == 3  # type: ignore[index]
