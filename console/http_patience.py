"""HTTP for people and devices, and not for whoever opens connections to hold them.

Uvicorn waits without end for the head of a request, a minute for TLS to be agreed on, and takes connections without
end. Here both have to come within a while, and one address has only so many connections, counted where they are
accepted: there would be no file handles left for anybody else.
"""

from __future__ import annotations

import asyncio
import errno
import socket
from typing import Any
from weakref import WeakKeyDictionary

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from console.config import LOOPBACK_NAMES

HEAD_WITHIN_S = 10.0
MAX_CONNECTIONS_COUNT = 400
"""Of one address; this machine's own, from which a proxy sends everybody's, may have more."""


class PatientHttp(H11Protocol):
    """One connection, as uvicorn makes it for each."""

    _head_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection; the head of its first request is awaited from now on."""
        super().connection_made(transport)
        self._wait_for_head()

    def data_received(self, data: bytes) -> None:
        """Take what came; the head of the next request has its own time."""
        super().data_received(data)
        if self._is_in_head():
            self._wait_for_head()
        else:
            self._stop_waiting()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is gone."""
        self._stop_waiting()
        super().connection_lost(exc)

    def _is_in_head(self) -> bool:
        return self.conn.their_state is h11.IDLE and bool(self.conn.trailing_data[0])

    def _wait_for_head(self) -> None:
        if self._head_timer is None:
            self._head_timer = self.loop.call_later(HEAD_WITHIN_S, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None


class CountingSocket(socket.socket):
    """A socket to listen on, which closes at once what an address opens beyond its number."""

    def __init__(self, family: int) -> None:
        super().__init__(family, socket.SOCK_STREAM)
        self._addresses: WeakKeyDictionary[socket.socket, str] = WeakKeyDictionary()

    def accept(self) -> tuple[socket.socket, Any]:
        """Return a connection and whom it is with. Raises ConnectionAbortedError where that one has too many."""
        connection, peer = super().accept()
        if self._is_crowded(peer[0]):
            connection.close()
            raise ConnectionAbortedError(errno.ECONNABORTED, "too many connections of one address")
        self._addresses[connection] = peer[0]
        return connection, peer

    def _is_crowded(self, address: str) -> bool:
        if address in LOOPBACK_NAMES:
            return False
        is_open = (each.fileno() != -1 for each, peer in self._addresses.items() if peer == address)
        return sum(is_open) >= MAX_CONNECTIONS_COUNT


class PatientLoop(asyncio.SelectorEventLoop):
    """An event loop whose servers do not wait long for TLS to be agreed on."""

    async def create_server(self, *args: Any, **named: Any) -> asyncio.Server:
        """As any loop does; uvicorn has no setting for this."""
        if named.get("ssl") is not None:
            named["ssl_handshake_timeout"] = HEAD_WITHIN_S
        return await super().create_server(*args, **named)
