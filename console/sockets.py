"""The open WebSockets of each sign-in session, and of each device token: what ends these ends them at once.

What is over without anybody doing it here (a session that has become too old, a token that the command line has
revoked, a session that ended while its page was being let in) is found by :func:`close_what_is_over`.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Collection

from console.errors import TooManyError

_log = logging.getLogger(__name__)
SIGNED_OUT_CODE = 4401
"""WebSocket close code: the session is over."""
TOO_MANY_CODE = 1013
"""WebSocket close code: try again later."""
MAX_SOCKETS_COUNT = 64
"""Of one session: many pages, and no flood."""
LOOK_EVERY_S = 2.0
Closer = Callable[[], None]


class SessionSockets:
    """Knows how to close what a session (or a device token) has open. All methods may be called from any thread.

    Sessions are named by the hashes of their tokens.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._closers: dict[str, list[Closer]] = {}

    def add(self, session_id: str, closer: Closer) -> Callable[[], None]:
        """Remember how to close a socket (quick, from any thread); return what forgets it again.

        Raises TooManyError where a session has very many open.
        """
        with self._lock:
            closers = self._closers.setdefault(session_id, [])
            if len(closers) >= MAX_SOCKETS_COUNT:
                raise TooManyError("Very many pages of this console are open: close some of them.", 10.0)
            closers.append(closer)

        def remove() -> None:
            with self._lock:
                closers = self._closers.get(session_id, [])
                if closer in closers:
                    closers.remove(closer)
                if not closers:
                    self._closers.pop(session_id, None)

        return remove

    def session_ids(self) -> tuple[str, ...]:
        """Return the sessions that have something open."""
        with self._lock:
            return tuple(self._closers)

    def close(self, session_id: str) -> None:
        """Close all sockets of a session: each is remembered until it has ended, and told again."""
        with self._lock:
            closers = tuple(self._closers.get(session_id, ()))
        for closer in closers:
            try:
                closer()
            except Exception:
                _log.exception("A socket of an ended session could not be closed.")

    def close_all(self) -> None:
        """Close the sockets of every session (the console stops)."""
        for session_id in self.session_ids():
            self.close(session_id)


def close_what_is_over(
    sockets: SessionSockets, over: Callable[[Collection[str]], Collection[str]], end: Callable[[str], object]
) -> None:
    """End each session that is ``over`` though it still has something open."""
    open_ids = sockets.session_ids()
    for session_id in over(open_ids) if open_ids else ():
        end(session_id)
