"""The open WebSockets of each sign-in session: signing out, a new role or a revoked account ends them at once."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

_log = logging.getLogger(__name__)
SIGNED_OUT_CODE = 4401
"""WebSocket close code: the session is over."""
Closer = Callable[[], None]


class SessionSockets:
    """Knows how to close what a session has open. All methods may be called from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._closers: dict[str, list[Closer]] = {}

    def add(self, session_id: str, closer: Closer) -> Callable[[], None]:
        """Remember how to close a socket (quick, from any thread); return what forgets it again."""
        with self._lock:
            self._closers.setdefault(session_id, []).append(closer)

        def remove() -> None:
            with self._lock:
                closers = self._closers.get(session_id, [])
                if closer in closers:
                    closers.remove(closer)
                if not closers:
                    self._closers.pop(session_id, None)

        return remove

    def close(self, session_id: str) -> None:
        """Close all sockets of a session."""
        with self._lock:
            closers = self._closers.pop(session_id, [])
        for closer in closers:
            try:
                closer()
            except Exception:
                _log.exception("A socket of an ended session could not be closed.")

    def close_all(self) -> None:
        """Close the sockets of every session (the console stops)."""
        with self._lock:
            session_ids = list(self._closers)
        for session_id in session_ids:
            self.close(session_id)
