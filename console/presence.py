"""Who is looking at the map just now, and at what: each window says so itself, and is forgotten when it says no more.

A courtesy, not a lock: what two people do to the same thing is settled by the model, whatever stands here.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from console.edits import Thing
from console.roles import SignedIn

_log = logging.getLogger(__name__)
FORGOTTEN_AFTER_S = 12.0
"""A window that has said nothing for so long is gone: pages say where they are every few seconds."""
MAX_WINDOWS_COUNT = 500

Doing = Literal["looking", "editing", "dragging", "drawing"]
Where = Literal["scene", "tables"]


@dataclass(frozen=True, slots=True)
class Present:
    """One window of one person."""

    window_id: str
    session_id: str
    user_name: str
    where: Where
    doing: Doing = "looking"
    thing: Thing | None = None
    """What is selected, or being changed."""


class Presence:
    """The windows that are open on a site. All methods may be called from any thread; listeners must be quick.

    ``now_s`` is a monotonic clock.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._windows: dict[str, tuple[Present, float]] = {}
        self._listeners: list[Callable[[], None]] = []

    def say(
        self, person: SignedIn, window_id: str, where: Where, doing: Doing = "looking", thing: Thing | None = None
    ) -> None:
        """Say what a window does now. A window of another session of the same name is another window."""
        key = f"{person.session_id}/{window_id}"
        present = Present(window_id, person.session_id, person.user_name, where, doing, thing)
        with self._lock:
            self._forget_silent()
            known = self._windows.get(key)
            if known is None and len(self._windows) >= MAX_WINDOWS_COUNT:
                return
            self._windows[key] = present, self._now_s()
            is_news = known is None or known[0] != present
        if is_news:
            self._tell()

    def leave(self, person: SignedIn, window_id: str) -> None:
        """Forget a window that is closed."""
        with self._lock:
            known = self._windows.pop(f"{person.session_id}/{window_id}", None)
        if known is not None:
            self._tell()

    def windows(self) -> tuple[Present, ...]:
        """Return the windows that are open, longest there first."""
        with self._lock:
            self._forget_silent()
            return tuple(present for present, _ in self._windows.values())

    def others(self, user_name: str) -> tuple[Present, ...]:
        """Return the windows of everybody else."""
        return tuple(present for present in self.windows() if present.user_name != user_name)

    def subscribe(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call ``listener`` after each change, from whichever thread made it; return what ends that."""
        with self._lock:
            self._listeners.append(listener)

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return unsubscribe

    def _forget_silent(self) -> None:
        oldest_s = self._now_s() - FORGOTTEN_AFTER_S
        self._windows = {key: held for key, held in self._windows.items() if held[1] >= oldest_s}

    def _tell(self) -> None:
        for listener in tuple(self._listeners):
            try:
                listener()
            except Exception:
                _log.exception("A listener of the presence of people failed.")
