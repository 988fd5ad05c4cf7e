"""The walker's screen: guidance as pictures on the two displays, at a bounded rate, beside the loop.

The loop only leaves what it has found (:meth:`Screen.offer`). Drawing happens in a thread of its own, as the watchdog's
looks do; a lock-step driver calls :meth:`Screen.check` instead of running the thread. Whatever becomes of the loop, old
guidance is shown as *Stop*.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass

from device_agent.cycle import Cycle
from device_agent.ports import Clock, DisplayOutput
from navcore.cues.overlay import render_overlay
from navcore.cues.overlay_display import Head
from navcore.settings import Settings
from navcore.types import Guidance, Localization, ObstacleScan

RATE_HZ = 10.0
"""Pictures in a second, at the most."""
_LOWEST_EYE_M, _HIGHEST_EYE_M = 0.8, 2.2
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What the loop last found."""

    guidance: Guidance | None
    scan: ObstacleScan | None
    head: Head
    settings: Settings


class Screen:
    """Draws what the loop last found on a display."""

    def __init__(
        self, display: DisplayOutput, clock: Clock, settings: Settings, overruled: Callable[[], bool] = lambda: False
    ) -> None:
        """``overruled`` tells whether the watchdog has taken over: then the walker sees *Stop*, as they hear it."""
        self._display = display
        self._overruled = overruled
        self._clock = clock
        self._found = _Found(None, None, Head.level(), settings)
        self._next_s = -math.inf
        self._failed = False
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None

    def offer(self, cycle: Cycle, settings: Settings) -> None:
        """Take what a cycle has found; it is shown at the next picture."""
        self._found = _Found(cycle.guidance, cycle.scan, head_of(cycle.localization, cycle.scan), settings)

    def check(self) -> bool:
        """Draw and show a picture, where one is due; return whether one was shown."""
        now_s = self._clock.now_s()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + 1.0 / RATE_HZ - 1e-6
        found = self._found
        try:
            guidance = None if self._overruled() else found.guidance
            display = self._display
            overlay = render_overlay(guidance, found.scan, found.head, now_s, found.settings, display.geometry)
            display.show(overlay)
        except Exception:
            # A display that fails must not end the thread: it may be plugged in again. Told once.
            if not self._failed:
                _log.exception("the overlay could not be shown")
            self._failed = True
            return False
        self._failed = False
        return True

    def start(self) -> None:
        """Show pictures from a thread of its own until :meth:`stop`; one that shows already goes on."""
        if self._thread is not None:
            return
        self._thread = threading.Thread(target=self._run, name="screen", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread at its next picture."""
        self._stopped.set()

    def _run(self) -> None:
        while not self._stopped.is_set():
            self.check()
            self._clock.sleep_until(max(self._next_s, self._clock.now_s()))


def head_of(located: Localization | None, scan: ObstacleScan | None) -> Head:
    """Return how the displays are held, or a level head at the usual height where that is not known."""
    eye_m = math.nan if scan is None else scan.eye_m
    if not _LOWEST_EYE_M <= eye_m <= _HIGHEST_EYE_M:
        eye_m = Head.level().eye_m
    if located is None or located.world_from_camera is None:
        return Head.level(eye_m)
    return Head.at(located.world_from_camera, eye_m)
