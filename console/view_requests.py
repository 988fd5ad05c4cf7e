"""What pages ask of the 3D scene: fly there, select this, follow that device, show this instant of the past.

Page and scene are two connections of one sign-in session; the scene's side subscribes with the id of its session and
hears only what was asked in that session.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from console.edits import Thing
from console.live import LiveDevice
from navcore.geometry import FloatArray

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class FlyToPoi:
    """Move the camera to a place, and select it."""

    poi_id: str


@dataclass(frozen=True, slots=True)
class FlyToPoint:
    """Move the camera to a place of the floor, and select what is meant there; None selects nothing."""

    x_m: float
    y_m: float
    thing: Thing | None = None


@dataclass(frozen=True, slots=True)
class FollowDevice:
    """Show this device's walker; None shows none."""

    device_id: str | None


@dataclass(frozen=True, slots=True)
class MoveCamera:
    """Let the camera go with the walker, or show the whole floor."""

    to: Literal["walker", "overview"]


@dataclass(frozen=True, slots=True, eq=False)
class ShowPast:
    """Show an instant of the past in place of the live walker; it must be said again and again."""

    device: LiveDevice
    """As the console knew it then."""
    at_s: float
    """The instant, on the clock that ``device`` is told by."""
    words: str
    """What says that it is past, as ``PAST WALK 12:03:10``."""
    trail_m: FloatArray
    """Where the walker had been until then, points (n, 2)."""


@dataclass(frozen=True, slots=True)
class EndPast:
    """Show the live walker again."""


ViewRequest = FlyToPoi | FlyToPoint | FollowDevice | MoveCamera | ShowPast | EndPast
Listener = Callable[[ViewRequest], None]


class ViewRequests:
    """Carries requests from pages to scenes. All methods may be called from any thread; listeners must be quick."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: dict[str, list[Listener]] = {}
        self._followed: dict[str, str | None] = {}

    def subscribe(self, session_id: str, listener: Listener) -> Callable[[], None]:
        """Hear what is asked in this session; return what ends that."""
        with self._lock:
            self._listeners.setdefault(session_id, []).append(listener)

        def unsubscribe() -> None:
            with self._lock:
                listeners = self._listeners.get(session_id, [])
                if listener in listeners:
                    listeners.remove(listener)
                if not listeners:
                    self._listeners.pop(session_id, None)

        return unsubscribe

    def followed(self, session_id: str) -> str | None:
        """Return the device that was last asked for in this session; None where none was."""
        with self._lock:
            return self._followed.get(session_id)

    def ask(self, session_id: str, request: ViewRequest) -> int:
        """Tell every scene of this session; return how many there are."""
        with self._lock:
            if isinstance(request, FollowDevice):
                self._followed[session_id] = request.device_id
            listeners = tuple(self._listeners.get(session_id, ()))
        for listener in listeners:
            try:
                listener(request)
            except Exception:
                _log.exception("A scene could not take in a request of its page.")
        return len(listeners)

    def forget(self, session_id: str) -> None:
        """Drop what is remembered of a session that has ended."""
        with self._lock:
            self._followed.pop(session_id, None)
