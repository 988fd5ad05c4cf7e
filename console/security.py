"""The guard in front of every route: host, origin, session or device token, role, and the headers of each answer.

What a role may do is in :mod:`console.rules`. The guard puts who asks into ``scope["state"]``: ``visitor``
(:class:`console.roles.SignedIn`) for people, ``device_name`` and ``device_token_id`` for devices.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import quote, urlsplit

import msgspec
from fastapi import Request
from fastapi.responses import JSONResponse, RedirectResponse, Response
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from console.errors import ConsoleError, ForbiddenError, SignInError, TooLargeError, TooSlowError, TwoLengthsError
from console.origin import is_same_origin, is_secure
from console.pages import is_page, refused_page
from console.roles import SignedIn
from console.rules import MAX_BODY_BYTES, RULES, Rule
from console.secrets_kept import hash_of_token
from console.services import Services

_log = logging.getLogger(__name__)
BODY_PATIENCE_S = 60.0
SLOWEST_BODY_BYTES_PER_S = 1000.0
"""Whoever sends slower than this, for longer than that, holds a connection that others need."""
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; media-src 'self'; "
    "connect-src 'self'; frame-src 'self'; manifest-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
"""Content-Security-Policy of our own pages; a route that sets its own (the scene's page) keeps it."""
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), payment=(), usb=()",
    "Content-Security-Policy": PAGE_POLICY,
    "Cache-Control": "no-store",
}


def cookie_name(connection: HTTPConnection) -> str:
    """Return the name of the session cookie: with the port, since browsers share cookies between ports of a host.

    Over TLS it has the prefix that browsers let nobody but this very host set, and only by TLS.
    """
    port = _split_host(connection.headers.get("host", ""))[1]
    name = f"vbr_session_{port}" if port else "vbr_session"
    return f"__Host-{name}" if is_secure(connection) else name


def set_session_cookie(response: Response, request: Request, token: str, longest_s: float) -> None:
    """Give the browser its session; no script can read it, no other site can make the browser send it."""
    response.set_cookie(
        cookie_name(request), token, max_age=int(longest_s), path="/", httponly=True, samesite="strict",
        secure=is_secure(request),
    )  # fmt: skip


def drop_session_cookie(response: Response, request: Request) -> None:
    """Have the browser forget its session."""
    response.delete_cookie(cookie_name(request), path="/", httponly=True, samesite="strict", secure=is_secure(request))


def visitor_of(connection: HTTPConnection) -> SignedIn | None:
    """Return who sent a request or opened a WebSocket, as the guard found; None for nobody."""
    visitor = connection.scope.get("state", {}).get("visitor")
    return visitor if isinstance(visitor, SignedIn) else None


class Guard:
    """ASGI middleware that lets through only what the rules permit."""

    def __init__(
        self,
        app: ASGIApp,
        services: Services,
        rules: Mapping[tuple[str, str], Rule] = RULES,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._app = app
        self._services = services
        self._rules = rules
        self._now_s = now_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or WebSocket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        is_request = scope["type"] == "http"
        sender = _with_headers(send, is_secure(connection)) if is_request else send
        try:
            max_body_bytes = await self._admit(connection)
        except ConsoleError as error:
            await _refusal(connection, error)(scope, receive, sender)
            return
        await self._app(scope, _bounded(receive, max_body_bytes, self._now_s) if is_request else receive, sender)

    async def _admit(self, connection: HTTPConnection) -> int:
        """Return how many bytes the body may have."""
        self._check_host(connection)
        if {"content-length", "transfer-encoding"} <= set(connection.headers):
            raise TwoLengthsError("This says in two ways how long it is: send it with one.")
        method, path = _route_of(connection.scope)
        rule = self._rules.get((method, path)) if path is not None else None
        max_body_bytes = rule.max_body_bytes if rule is not None else MAX_BODY_BYTES
        length = connection.headers.get("content-length", "")
        _check_length(int(length) if length.isdigit() else 0, max_body_bytes)
        state = connection.scope.setdefault("state", {})
        state["visitor"] = visitor = await self._find_visitor(connection)
        state["device_name"] = None
        if path is None:
            # No route: the application answers 404, or 405.
            _check_origin(connection, method)
            return max_body_bytes
        if rule is None:
            _log.error("The route %s %s has no rule in console.rules: it is refused.", method, path)
            raise ForbiddenError("Nobody may do this: the route has no rule.")
        if rule.who == "devices":
            state["device_name"], state["device_token_id"] = await self._find_device(connection)
            return max_body_bytes
        _check_origin(connection, method)
        if rule.permits(visitor.role if visitor else None):
            return max_body_bytes
        if visitor is None:
            raise SignInError("Sign in first: nobody is signed in here, or the session is over.")
        raise ForbiddenError(f"Your role ({visitor.role}) does not permit this: ask an admin.")

    def _check_host(self, connection: HTTPConnection) -> None:
        # A page elsewhere whose name is made to lead to this machine (DNS rebinding) still carries its own name.
        allowed = self._services.config.allowed_hosts
        name, _ = _split_host(connection.headers.get("host", ""))
        if allowed is not None and name not in allowed:
            raise ForbiddenError("This console is not reached by that name: use the address that it printed.")

    async def _find_visitor(self, connection: HTTPConnection) -> SignedIn | None:
        token = connection.cookies.get(cookie_name(connection))
        return await run_in_threadpool(self._services.accounts.signed_in, token) if token else None

    async def _find_device(self, connection: HTTPConnection) -> tuple[str, str]:
        """Return the name of a device, and what its token is known by."""
        scheme, _, token = connection.headers.get("authorization", "").partition(" ")
        name = None
        if scheme.lower() == "bearer" and token:
            name = await run_in_threadpool(self._services.devices.name_of, token.strip())
        if name is None:
            raise SignInError("This device token is not valid: make one with `vbr console token NAME`.")
        return name, hash_of_token(token.strip())


def _route_of(scope: Scope) -> tuple[str, str | None]:
    """Return the method (``WS`` for a WebSocket) and the path of the route that will serve this; None for no route."""
    method = "WS" if scope["type"] == "websocket" else scope["method"]
    for route in scope["app"].router.routes:
        if route.matches(scope)[0] is Match.FULL:
            return ("GET" if method == "HEAD" else method), getattr(route, "path", "")
    return method, None


def _check_origin(connection: HTTPConnection, method: str) -> None:
    if method not in SAFE_METHODS and not is_same_origin(connection):
        raise ForbiddenError("This was not sent by a page of this console: open the console and try there.")


def _check_length(length: int, max_bytes: int) -> None:
    if length > max_bytes:
        most = f"{max_bytes >> 20} MiB" if max_bytes >= 1 << 20 else f"{max_bytes >> 10} KiB"
        raise TooLargeError(f"This is too large: the console takes {most} at a time here.")


def _bounded(receive: Receive, max_bytes: int, now_s: Callable[[], float]) -> Receive:
    """Bound what comes without saying beforehand how long it is, and how long it may take to come."""
    received, is_whole, began_s = 0, False, now_s()

    async def receive_bounded() -> Message:
        nonlocal received, is_whole
        if is_whole:
            return await receive()
        allowed_s = BODY_PATIENCE_S + received / SLOWEST_BODY_BYTES_PER_S
        try:
            async with asyncio.timeout(began_s + allowed_s - now_s()):
                message = await receive()
        except TimeoutError as error:
            raise TooSlowError("The rest of this did not come: send it again.") from error
        received += len(message.get("body", b""))
        is_whole = not message.get("more_body", False)
        _check_length(received, max_bytes)
        return message

    return receive_bounded


def _split_host(host: str) -> tuple[str, str]:
    try:
        parts = urlsplit(f"//{host}")
        return (parts.hostname or "").lower(), str(parts.port or "")
    except ValueError:
        return "", ""


def _refusal(connection: HTTPConnection, error: ConsoleError) -> ASGIApp:
    if connection.scope["type"] == "websocket":
        # Before it is accepted: the browser gets a plain 403.
        return WebSocketClose(4401 if error.status == 401 else 4403, str(error))
    path = connection.url.path
    wants_page = connection.scope["method"] == "GET" and not path.startswith("/api/")
    if wants_page and error.status == 401:
        return RedirectResponse(f"/signin?next={quote(path)}", status_code=303)
    if wants_page and error.status == 403 and is_page(path) and visitor_of(connection) is not None:
        return refused_page()
    return error_response(error)


def error_response(error: ConsoleError) -> JSONResponse:
    """Return a refusal as JSON: ``{"error": sentence}``, and what belongs to it."""
    response = JSONResponse(msgspec.to_builtins({"error": str(error), **error.details()}), status_code=error.status)
    if isinstance(error, TwoLengthsError):
        # What comes next on it may be the rest of this, and not a request of anybody's.
        response.headers["Connection"] = "close"
    retry_after_s: Any = getattr(error, "retry_after_s", None)
    if retry_after_s is not None:
        response.headers["Retry-After"] = str(max(1, round(retry_after_s)))
    return response


def _with_headers(send: Send, by_tls: bool) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
            if by_tls:
                headers.setdefault("Strict-Transport-Security", "max-age=31536000")
        await send(message)

    return send_with_headers
