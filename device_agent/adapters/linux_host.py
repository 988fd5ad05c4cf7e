"""Battery and temperature as Linux tells them (/sys/class/power_supply, /sys/class/thermal).

Reading them asks the hardware, over slow buses on some boards, so that a thread of their own does it, now and then.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path

from device_agent.ports import HostHealth

POWER, THERMAL = Path("/sys/class/power_supply"), Path("/sys/class/thermal")
LOOK_EVERY_S = 5.0
KNOWN_FOR_LOOKS = 3
"""What was found is told for as long as so many looks take; then it is not known any more."""
_log = logging.getLogger(__name__)
_ON_THE_CHARGER = frozenset({"Charging", "Full", "Not charging"})
"""The kernel's words for a battery whose charger is plugged in; the last one means that it needs no more."""


class LinuxHost:
    """Looks every few seconds, and gives what it found last, while that is not old.

    ``now_s`` is a steady clock.
    """

    def __init__(
        self,
        power: Path = POWER,
        thermal: Path = THERMAL,
        every_s: float = LOOK_EVERY_S,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._power, self._thermal, self._every_s, self._now_s = power, thermal, every_s, now_s
        self._found = now_s(), HostHealth()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._look, name="host", daemon=True)
        self._thread.start()

    def read(self) -> HostHealth:
        """Return what was found last; nothing before the first look, or where looking has failed or hung for long."""
        found_s, health = self._found
        return health if self._now_s() - found_s <= KNOWN_FOR_LOOKS * self._every_s else HostHealth()

    def close(self) -> None:
        """Look no more; a look that hangs in a driver is not waited for."""
        self._closed.set()
        self._thread.join(1.0)

    def _look(self) -> None:
        has_failed = False
        while True:
            try:
                self._found = self._now_s(), host_health(self._power, self._thermal)
                has_failed = False
            except OSError as error:
                # A driver that goes away under the look; the next one may find it again.
                if not has_failed:
                    _log.warning("Battery and temperature cannot be read (%s): they are told as not known.", error)
                has_failed = True
            if self._closed.wait(self._every_s):
                return


def host_health(power: Path = POWER, thermal: Path = THERMAL) -> HostHealth:
    """Return what the files tell now; None for what they do not. Of several batteries the emptiest counts."""
    emptiest: tuple[float, bool] | None = None
    for supply in sorted(power.glob("*")):
        battery = _battery(supply)
        if battery is not None and (emptiest is None or battery < emptiest):
            emptiest = battery
    percent, is_charging = (None, None) if emptiest is None else emptiest
    return HostHealth(percent, is_charging, hottest_c(thermal))


def hottest_c(thermal: Path) -> float | None:
    """Return the temperature of the hottest zone; None where there is none."""
    readings = []
    for path in thermal.glob("thermal_zone*/temp"):
        with contextlib.suppress(OSError, ValueError):
            readings.append(int(path.read_text(encoding="ascii")) / 1000.0)
    return max(readings, default=None)


def _battery(supply: Path) -> tuple[float, bool] | None:
    """Return charge (percent) and whether it is on the charger; None for what is no battery of this machine."""
    # A mouse has a battery as well: its scope is "Device".
    if _word(supply / "type") != "Battery" or _word(supply / "scope") == "Device":
        return None
    with contextlib.suppress(ValueError):
        percent = float(_word(supply / "capacity"))
        return min(100.0, max(0.0, percent)), _word(supply / "status") in _ON_THE_CHARGER
    return None


def _word(path: Path) -> str:
    with contextlib.suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="ascii").strip()
    return ""
