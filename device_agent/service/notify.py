"""What a service says to systemd (``sd_notify(3)``): ready, alive, stopping. One datagram each, and no library.

Where nobody listens (no ``NOTIFY_SOCKET``) all of this does nothing. A datagram that cannot be sent at once is left
out: guidance never waits for whoever watches over it.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Mapping

BEATS_PER_TIMEOUT = 4
"""systemd asks for at least two signs of life in its timeout; one may be lost."""


class ServiceNotifier:
    """Says to systemd how the service is."""

    def __init__(
        self,
        environment: Mapping[str, str] | None = None,
        monotonic_now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Read from the environment (that of the process where None) where systemd listens, and how patient it is."""
        environment = os.environ if environment is None else environment
        path = environment.get("NOTIFY_SOCKET", "")
        # A name that begins with "@" is in Linux' abstract namespace, which has a NUL there.
        self._address = "\0" + path[1:] if path.startswith("@") else path
        self._now_s = monotonic_now_s
        self._interval_s = _interval_s(environment)
        self._told_s: float | None = None
        self._is_ready = False
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def alive(self) -> None:
        """Say that the loop has gone round; only as often as is asked for. The first time says that all is ready."""
        if self._socket is None:
            return
        now_s = self._now_s()
        if not self._is_ready:
            self._is_ready = self._say("READY=1\nSTATUS=Running.\nWATCHDOG=1")
            self._told_s = now_s
        elif self._interval_s is not None and (self._told_s is None or now_s - self._told_s >= self._interval_s):
            self._told_s = now_s
            self._say("WATCHDOG=1")

    def stopping(self) -> None:
        """Say that the service ends on purpose; nothing is said after it."""
        self._say("STOPPING=1")
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _say(self, text: str) -> bool:
        if self._socket is None:
            return False
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:
            return False
        return True


def _interval_s(environment: Mapping[str, str]) -> float | None:
    """Return how often to say that the loop lives; None where nobody asked this process for it."""
    process_id = environment.get("WATCHDOG_PID", "")
    if process_id and process_id != str(os.getpid()):
        return None
    try:
        timeout_s = int(environment["WATCHDOG_USEC"]) / 1e6
    except (KeyError, ValueError):
        return None
    return timeout_s / BEATS_PER_TIMEOUT if timeout_s > 0 else None
