"""HTTP for people and devices, and not for whoever opens connections to hold them.

Uvicorn waits without end for the head of a request, and takes connections without end. Here the head has to come within
a while, and one address has only so many connections: there would be no file handles left for anybody else.
"""

from __future__ import annotations

import asyncio
from typing import Any

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
        """Take a connection, or turn it away."""
        super().connection_made(transport)
        if _is_crowded(self):
            transport.abort()
            return
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


def _is_crowded(protocol: H11Protocol) -> bool:
    address = protocol.client[0] if protocol.client is not None else ""
    if address in LOOPBACK_NAMES:
        return False
    peers = (_address_of(each) for each in protocol.connections)
    return sum(peer == address for peer in peers) > MAX_CONNECTIONS_COUNT


def _address_of(protocol: Any) -> str:
    """Return whom a connection is with, of HTTP or of a WebSocket."""
    peer = protocol.transport.get_extra_info("peername")
    return str(peer[0]) if isinstance(peer, tuple) else ""
