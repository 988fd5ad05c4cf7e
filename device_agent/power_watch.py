"""The walker hears that the battery ends, or that the glasses get hot, whether or not anybody is at the console.

:func:`looked` is the whole logic, a pure function; the thread asks it now and then. The limits are those at which the
console raises its alerts (docs/alerts.md).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

from device_agent.ports import HostHealth
from navcore.errors import VbrError
from navcore.repeating import Repeating

LOOK_EVERY_S = 5.0
LOW_PERCENT, NEARLY_EMPTY_PERCENT = 20.0, 8.0
CHARGED_BY_PERCENT = 5.0
"""So much fuller a battery must get before it is told of again: its gauge trembles."""
HOT_C, COOL_C = 80.0, 72.0
SAID_AGAIN_AFTER_S = 120.0
"""Of a battery that is nearly empty the walker hears again and again, until they have it charged."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PowerTold:
    """What the walker has been told, and still holds."""

    limit_percent: float | None = None
    """The lower one of the limits that was told of; None while the battery is full enough."""
    told_s: float = 0.0
    is_hot: bool = False


def looked(told: PowerTold, health: HostHealth, now_s: float) -> tuple[PowerTold, tuple[str, ...]]:
    """Look once; return what to remember, and the keys of the texts to say now. What is unknown changes nothing."""
    told, battery = _battery(told, health, now_s)
    told, heat = _heat(told, health)
    return told, battery + heat


def _battery(told: PowerTold, health: HostHealth, now_s: float) -> tuple[PowerTold, tuple[str, ...]]:
    percent = health.battery_percent
    if health.is_charging:
        return replace(told, limit_percent=None), ()
    if percent is None:
        return told, ()
    if told.limit_percent is not None and percent > told.limit_percent + CHARGED_BY_PERCENT:
        told = replace(told, limit_percent=None)
    if percent <= NEARLY_EMPTY_PERCENT:
        is_news = told.limit_percent != NEARLY_EMPTY_PERCENT or now_s - told.told_s >= SAID_AGAIN_AFTER_S
        return (replace(told, limit_percent=NEARLY_EMPTY_PERCENT, told_s=now_s), ("battery_empty",)) if is_news else (
            told, ()
        )  # fmt: skip
    if percent <= LOW_PERCENT and told.limit_percent is None:
        return replace(told, limit_percent=LOW_PERCENT, told_s=now_s), ("battery_low",)
    return told, ()


def _heat(told: PowerTold, health: HostHealth) -> tuple[PowerTold, tuple[str, ...]]:
    if health.temperature_c is None:
        return told, ()
    if told.is_hot:
        return replace(told, is_hot=health.temperature_c >= COOL_C), ()
    if health.temperature_c >= HOT_C:
        return replace(told, is_hot=True), ("device_hot",)
    return told, ()


class PowerWatch:
    """Looks at battery and temperature in a thread of its own, and has the walker told."""

    def __init__(
        self, read: Callable[[], HostHealth], on_duty: Callable[[], bool], say: Callable[[str], None],
        now_s: Callable[[], float],
    ) -> None:  # fmt: skip
        """``say(key)`` has a text of :data:`navcore.cues.texts.TEXTS` spoken; off duty nothing is said."""
        self._read, self._on_duty, self._say, self._now_s = read, on_duty, say, now_s
        self._told = PowerTold()
        self._looking = Repeating("power", LOOK_EVERY_S, self.look)

    def start(self) -> None:
        """Begin to look."""
        self._looking.start()

    def stop(self) -> None:
        """Look no more."""
        self._looking.close()

    def look(self) -> None:
        """Look once, and have said what is due; whoever could not be told is told at the next look."""
        if not self._on_duty():
            return
        told, keys = looked(self._told, self._read(), self._now_s())
        try:
            for key in keys:
                self._say(key)
        except VbrError as error:
            _log.warning("%s", error)
            return
        self._told = told
