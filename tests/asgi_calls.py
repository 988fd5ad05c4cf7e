"""Requests to an application without a socket: whole requests and answers of ASGI, as many as a matrix needs."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from starlette.datastructures import Headers

_LONGEST_S = 20.0


@dataclass(frozen=True)
class Answer:
    """What an application answered; a WebSocket that was accepted has the status 101, one that was not 403 and why."""

    status: int
    headers: Headers
    body: bytes


class AsgiCalls:
    """Calls an application in a loop of its own. Use as a context."""

    def __init__(self, app: Any, host: str) -> None:
        self._app, self.host = app, host
        self._runner = asyncio.Runner()

    def __enter__(self) -> AsgiCalls:
        return self

    def __exit__(self, *_: object) -> None:
        self._runner.close()

    def call(
        self, method: str, path: str, headers: Mapping[str, str], body: bytes = b"", *, by_tls: bool = False
    ) -> Answer:
        """Make one request; the method ``WS`` opens a WebSocket, and closes it once it is accepted."""
        path, _, query = path.partition("?")
        sent = [(name.lower().encode(), value.encode("latin-1")) for name, value in headers.items()]
        scope = {
            "type": "websocket" if method == "WS" else "http", "asgi": {"version": "3.0"}, "http_version": "1.1",
            "scheme": ("ws" if method == "WS" else "http") + "s" * by_tls, "path": path, "raw_path": path.encode(),
            "root_path": "",
            "query_string": query.encode(), "headers": sent, "client": ("127.0.0.1", 5), "server": ("127.0.0.1", 80),
            "state": {},
        }  # fmt: skip
        if method == "WS":
            scope["subprotocols"] = headers.get("Sec-WebSocket-Protocol", "").split()
            incoming = [{"type": "websocket.connect"}, {"type": "websocket.disconnect", "code": 1001}]
        else:
            scope["method"] = method
            incoming = [{"type": "http.request", "body": body, "more_body": False}]
        return self._runner.run(asyncio.wait_for(self._exchange(scope, incoming), _LONGEST_S))

    async def _exchange(self, scope: dict[str, Any], incoming: list[dict[str, Any]]) -> Answer:
        sent: list[dict[str, Any]] = []
        stays = asyncio.Event()

        async def receive() -> dict[str, Any]:
            if not incoming:
                # Whoever has sent all of a request waits for the answer.
                await stays.wait()
            return incoming.pop(0)

        async def send(message: dict[str, Any]) -> None:
            sent.append(message)

        await self._app(scope, receive, send)
        if scope["type"] == "websocket":
            first = sent[0] if sent else {"type": "nothing"}
            return Answer(
                101 if first["type"] == "websocket.accept" else 403, Headers(), first.get("reason", "").encode()
            )
        start = sent[0]
        body = b"".join(message.get("body", b"") for message in sent[1:])
        return Answer(start["status"], Headers(raw=list(start["headers"])), body)
