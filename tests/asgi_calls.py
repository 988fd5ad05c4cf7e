"""Requests to an application without a socket: whole requests and answers of ASGI, as many as a matrix needs."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
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
    close_code: int | None = None
    """Of a WebSocket that was not accepted."""


class AsgiCalls:
    """Calls an application in a loop of its own. Use as a context."""

    def __init__(self, app: Any) -> None:
        self._app = app
        self._runner = asyncio.Runner()

    def __enter__(self) -> AsgiCalls:
        return self

    def __exit__(self, *_: object) -> None:
        self._runner.close()

    def call(
        self,
        method: str,
        path: str,
        headers: Mapping[str, str],
        body: bytes | Iterator[bytes] = b"",
        *,
        by_tls: bool = False,
    ) -> Answer:
        """Make one request; the method ``WS`` opens a WebSocket, and closes it once it is accepted.

        Pieces of a body are asked for when the application asks for them, after it has waited.
        """
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
            incoming = iter([{"type": "websocket.connect"}, {"type": "websocket.disconnect", "code": 1001}])
        else:
            scope["method"] = method
            incoming = _messages(body)
        return self._runner.run(asyncio.wait_for(self._exchange(scope, incoming), _LONGEST_S))

    async def _exchange(self, scope: dict[str, Any], incoming: Iterator[dict[str, Any]]) -> Answer:
        sent: list[dict[str, Any]] = []
        stays = asyncio.Event()

        async def receive() -> dict[str, Any]:
            await asyncio.sleep(0)
            for message in incoming:
                return message
            # Whoever has sent all of a request waits for the answer.
            await stays.wait()
            raise AssertionError

        async def send(message: dict[str, Any]) -> None:
            sent.append(message)

        await self._app(scope, receive, send)
        if scope["type"] == "websocket":
            first = sent[0] if sent else {"type": "nothing"}
            status = 101 if first["type"] == "websocket.accept" else 403
            return Answer(status, Headers(), first.get("reason", "").encode(), first.get("code"))
        start = sent[0]
        body = b"".join(message.get("body", b"") for message in sent[1:])
        return Answer(start["status"], Headers(raw=list(start["headers"])), body)


def _messages(body: bytes | Iterator[bytes]) -> Iterator[dict[str, Any]]:
    if isinstance(body, bytes):
        yield {"type": "http.request", "body": body}
        return
    for piece in body:
        yield {"type": "http.request", "body": piece, "more_body": True}
    yield {"type": "http.request"}
