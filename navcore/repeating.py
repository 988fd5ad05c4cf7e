"""Work that is done again and again, in a thread of its own, until it is stopped."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

_log = logging.getLogger(__name__)


class Repeating:
    """Does some work at its start, every so many seconds, and when woken; what it raises is logged, and ends nothing.

    What fails again and again is logged once: a log that grows would take the last of a full disk.
    """

    def __init__(self, name: str, every_s: float, work: Callable[[], object]) -> None:
        self._name, self._every_s, self._work = name, every_s, work
        self._is_stopped = False
        self._due = threading.Event()
        self._is_failing = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def wake(self) -> None:
        """Do the work as soon as it can be done; from any thread, never waits."""
        self._due.set()

    def close(self) -> None:
        """End; returns when the work that runs is done."""
        self._is_stopped = True
        self._due.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while True:
            try:
                self._work()
                self._is_failing = False
            except Exception:
                if not self._is_failing:
                    _log.exception("%s failed, and is tried again every %g s.", self._name, self._every_s)
                self._is_failing = True
            self._due.wait(self._every_s)
            self._due.clear()
            if self._is_stopped:
                return
