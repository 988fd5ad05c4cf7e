"""The guard in front of every route, at the door of a small application: real accounts, real device tokens.

What the console's own routes permit is shown by test_authorization_matrix, by many more callers; here it is what the
guard does with a rule. Quick, so that a fault in any line of it can be put in and looked for (.ci/mutants).
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from asgi_calls import Answer, AsgiCalls
from console_room import PASSWORD, HandClock
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from console.accounts import Accounts
from console.config import ConsoleConfig
from console.device_store import DeviceStore
from console.errors import BadRequestError, ConsoleError, TooManyError
from console.origin import is_same_origin
from console.roles import EDITING, SIGNED_IN
from console.rules import MAX_BODY_BYTES, Rule
from console.secrets_kept import hash_of_token
from console.security import (
    PAGE_POLICY,
    Guard,
    drop_session_cookie,
    error_response,
    set_session_cookie,
    visitor_of,
)
from console.store import Store

HOST = "localhost:8765"
ORIGIN, SECURE_ORIGIN = f"http://{HOST}", f"https://{HOST}"
COOKIE = "vbr_session_8765"
LARGE_BYTES = 2 << 20
RULES = {
    ("GET", "/open"): Rule("anyone"),
    ("POST", "/open"): Rule("anyone"),
    ("GET", "/look"): Rule("people", SIGNED_IN),
    ("GET", "/pois"): Rule("people", EDITING),
    ("GET", "/api/look"): Rule("people", SIGNED_IN),
    ("POST", "/api/edit"): Rule("people", EDITING),
    ("POST", "/api/large"): Rule("people", EDITING, LARGE_BYTES),
    ("POST", "/api/mebibyte"): Rule("people", EDITING, 1 << 20),
    ("GET", "/api/device"): Rule("devices"),
    ("POST", "/api/device"): Rule("devices"),
    ("WS", "/live"): Rule("people", SIGNED_IN),
    ("WS", "/device"): Rule("devices"),
}
HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=(), payment=(), usb=()",
    "content-security-policy": PAGE_POLICY,
    "cache-control": "no-store",
}


@dataclass(frozen=True)
class Parts:
    """What the guard asks."""

    config: ConsoleConfig
    accounts: Accounts
    devices: DeviceStore


@dataclass(frozen=True)
class People:
    """Who comes: an admin, a viewer and a device, their tokens by these names."""

    accounts: Accounts
    devices: DeviceStore
    tokens: Mapping[str, str]


@dataclass(frozen=True)
class Door:
    """An application behind the guard, and who comes to it."""

    calls: AsgiCalls
    tokens: Mapping[str, str]
    clock: HandClock

    def call(
        self,
        method: str,
        path: str,
        who: str = "",
        body: bytes | Iterator[bytes] = b"",
        *,
        by_tls: bool = False,
        **headers: str | None,
    ) -> Answer:
        """Make a request as our own page does, ``WS`` for a WebSocket; a header that is None is left out."""
        token = self.tokens.get(who)
        cookie = f"__Host-{COOKIE}" if by_tls else COOKIE
        session = {} if not token else {"authorization": f"Bearer {token}"} if who == "device" else {
            "cookie": f"{cookie}={token}"
        }  # fmt: skip
        own = {"host": HOST, "origin": SECURE_ORIGIN if by_tls else ORIGIN}
        merged: dict[str, str | None] = own | session | headers
        sent = {name: value for name, value in merged.items() if value is not None}
        return self.calls.call(method, path, sent, body, by_tls=by_tls)


def told(answer: Answer) -> str:
    """Return the sentence of a refusal."""
    return str(json.loads(answer.body)["error"])


async def whoever(request: Request) -> Response:
    """Say as whom the guard let somebody in."""
    await request.body()
    visitor, state = visitor_of(request), request.scope["state"]
    return JSONResponse([visitor.user_name if visitor else None, state["device_name"], state.get("device_token_id")])


async def live(socket: WebSocket) -> None:
    """Accept, and stay until the other side goes."""
    await socket.accept()
    assert (visitor_of(socket) is None) is (socket.scope["state"]["device_name"] is not None)
    await socket.receive()


async def answered(_: Request, error: Exception) -> Response:
    """Answer a refusal as the console does."""
    assert isinstance(error, ConsoleError)
    return error_response(error)


@contextmanager
def opened(people: People, others: Mapping[str, Any], **config: Any) -> Iterator[Door]:
    """Open an application of a few routes, those of ``others`` by their path, behind the guard."""
    methods: dict[str, list[str]] = {"/surprise": ["GET"]} | {path: ["GET"] for path in others}
    for method, path in RULES:
        methods.setdefault(path, []).append(method)
    routes: list[Any] = [
        Route(path, others.get(path, whoever), methods=each) for path, each in methods.items() if "WS" not in each
    ]
    routes += [WebSocketRoute(path, live) for path in ("/live", "/device", "/unruled")]
    services = Parts(ConsoleConfig(Path(), Path(), **config), people.accounts, people.devices)
    rules = RULES | {("GET", path): Rule("anyone") for path in others}
    clock = HandClock()
    middleware: Any = Middleware(Guard, services=services, rules=rules, now_s=clock)
    app = Starlette(routes=routes, middleware=[middleware], exception_handlers={ConsoleError: answered})
    with AsgiCalls(app) as calls:
        yield Door(calls, people.tokens, clock)


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> Iterator[People]:
    store = Store.open(tmp_path_factory.mktemp("door"))
    accounts, devices = Accounts(store, lambda: 0.0), DeviceStore(store)
    first = accounts.first_admin_link_token()
    assert first is not None
    ids = {"admin": accounts.use_link(first, "admin", PASSWORD).id}
    ids["viewer"] = accounts.invite("viewer", "viewer", "admin")[0].id
    tokens = {name: accounts.start_session(user_id) for name, user_id in ids.items()}
    yield People(accounts, devices, tokens | {"device": devices.create_token("Glasses", "admin")})
    store.close()


@pytest.fixture(scope="module")
def door(people: People) -> Iterator[Door]:
    with opened(people, {}) as door:
        yield door


# -------------------------------------------------------------------------------------------------- who is let in
@pytest.mark.parametrize(
    ("method", "path", "nobody", "viewer", "admin", "device"),
    [
        ("GET", "/open", 200, 200, 200, 200), ("POST", "/open", 200, 200, 200, 200),
        ("GET", "/look", 303, 200, 200, 303), ("GET", "/pois", 303, 403, 200, 303),
        ("GET", "/api/look", 401, 200, 200, 401), ("HEAD", "/api/look", 401, 200, 200, 401),
        ("POST", "/api/edit", 401, 403, 200, 401),
        ("GET", "/api/device", 401, 401, 401, 200), ("POST", "/api/device", 401, 401, 401, 200),
        ("HEAD", "/api/device", 401, 401, 401, 200),
        ("GET", "/surprise", 403, 403, 403, 403), ("GET", "/nothing", 404, 404, 404, 404),
        ("WS", "/live", 403, 101, 101, 403), ("WS", "/device", 403, 403, 403, 101),
        ("WS", "/unruled", 403, 403, 403, 403),
    ],
)  # fmt: skip
@pytest.mark.parametrize("by_tls", [False, True])
def test_who_is_let_in(
    door: Door, method: str, path: str, nobody: int, viewer: int, admin: int, device: int, by_tls: bool
) -> None:
    for who, status in {"": nobody, "viewer": viewer, "admin": admin, "device": device}.items():
        answer = door.call(method, path, who, by_tls=by_tls)
        assert answer.status == status, f"{who}: {answer.body!r}"
        if status == 200 and method != "HEAD":
            person = who if who in ("viewer", "admin") else None
            is_device = who == "device" and path == "/api/device"
            token_id = hash_of_token(door.tokens["device"]) if is_device else None
            assert json.loads(answer.body) == [person, "Glasses" if is_device else None, token_id]


def test_why_a_socket_is_refused(door: Door) -> None:
    for path, who, code in (("/live", "", 4401), ("/unruled", "viewer", 4403)):
        answer = door.call("WS", path, who)
        assert (answer.close_code, bool(answer.body)) == (code, True)


@pytest.mark.parametrize(
    "authorization", ["", "Bearer", "Bearer ", "Basic {token}", "{token}", "Bearer {token}x", "Bearer none"]
)
def test_only_a_valid_bearer_token_is_a_device(door: Door, authorization: str) -> None:
    token = door.tokens["device"]
    assert door.call("GET", "/api/device", authorization=authorization.format(token=token)).status == 401


def test_a_bearer_token_is_read_as_the_standard_writes_it(door: Door) -> None:
    answer = door.call("GET", "/api/device", authorization=f"bearer  {door.tokens['device']} ")
    assert json.loads(answer.body)[1:] == ["Glasses", hash_of_token(door.tokens["device"])]


def test_a_session_is_believed_by_its_own_cookie_alone(door: Door) -> None:
    token = door.tokens["viewer"]
    for cookie in ("vbr_session_8766", "vbr_session", f"__Host-{COOKIE}"):
        assert door.call("GET", "/api/look", cookie=f"{cookie}={token}").status == 401
    assert door.call("GET", "/api/look", host="localhost", cookie=f"vbr_session={token}").status == 200
    assert door.call("GET", "/api/look", by_tls=True, cookie=f"{COOKIE}={token}").status == 401


# ------------------------------------------------------------------------------------------- from where, by which name
@pytest.mark.parametrize("method", ["POST", "WS"])
@pytest.mark.parametrize("origin", [None, "https://evil.example", "http://["])
def test_what_changes_something_comes_from_our_own_page(door: Door, method: str, origin: str | None) -> None:
    for path in ("/live",) if method == "WS" else ("/open", "/api/edit", "/nothing"):
        assert door.call(method, path, "admin", origin=origin).status == 403
        assert door.call(method, path, "admin").status != 403


def test_what_changes_nothing_and_what_is_no_browser_comes_from_anywhere(door: Door) -> None:
    for method in ("GET", "HEAD", "OPTIONS"):
        assert door.call(method, "/open", origin="https://evil.example").status in (200, 405)
    for method, path, status in (("POST", "/api/device", 200), ("WS", "/device", 101)):
        assert door.call(method, path, "device", origin=None).status == status


@pytest.mark.parametrize(
    ("scheme", "origin", "host", "is_ours"),
    [
        ("http", ORIGIN, HOST, True), ("http", ORIGIN.upper(), HOST, True), ("http", ORIGIN, HOST.upper(), True),
        ("ws", ORIGIN, HOST, True), ("http", SECURE_ORIGIN, HOST, True), ("https", SECURE_ORIGIN, HOST, True),
        ("wss", SECURE_ORIGIN, HOST, True), ("https", ORIGIN, HOST, False), ("wss", ORIGIN, HOST, False),
        ("http", f"ftp://{HOST}", HOST, False), ("http", f"//{HOST}", HOST, False), ("http", HOST, HOST, False),
        ("http", "http://localhost", HOST, False), ("http", f"http://user@{HOST}", HOST, False),
        ("http", "", "", False), ("http", "http://", "", False), ("http", "http://[", "[", False),
        ("http", "null", "null", False),
    ],
)  # fmt: skip
def test_an_origin_is_ours_by_scheme_name_and_port(scheme: str, origin: str, host: str, is_ours: bool) -> None:
    headers = [(b"origin", origin.encode()), (b"host", host.encode())]
    assert is_same_origin(HTTPConnection({"type": "http", "scheme": scheme, "headers": headers})) is is_ours


def test_who_names_no_origin_or_no_host_is_not_ours() -> None:
    for name in (b"origin", b"host"):
        headers = [(name, HOST.encode() if name == b"host" else ORIGIN.encode())]
        assert not is_same_origin(HTTPConnection({"type": "http", "headers": headers}))


def test_another_name_is_refused(door: Door) -> None:
    for host in ("evil.example:8765", "", "[::1", "localhost:port"):
        answer = door.call("GET", "/pois", "admin", host=host)
        assert (answer.status, "the address that it printed" in told(answer)) == (403, True)
    for host in ("LOCALHOST:8765", "127.0.0.1:8765", "[::1]:8765"):
        assert door.call("GET", "/open", host=host).status == 200


def test_beyond_this_machine_any_name_leads_to_it(people: People) -> None:
    with opened(people, {}, host="0.0.0.0") as door:
        assert door.call("GET", "/open", host="console.example").status == 200


# ---------------------------------------------------------------------------------------------------- bodies
@pytest.mark.parametrize(
    ("path", "most", "words"),
    [
        ("/api/edit", MAX_BODY_BYTES, "256 KiB"), ("/api/large", LARGE_BYTES, "2 MiB"),
        ("/api/mebibyte", 1 << 20, "1 MiB"), ("/nothing", MAX_BODY_BYTES, "256 KiB"),
    ],
)  # fmt: skip
def test_a_body_that_says_how_long_it_is_is_refused_unread(door: Door, path: str, most: int, words: str) -> None:
    answer = door.call("POST", path, "admin", **{"content-length": str(most + 1)})
    assert (answer.status, words in told(answer)) == (413, True)
    for length in (str(most), "many"):
        assert door.call("POST", path, "admin", **{"content-length": length}).status != 413


@pytest.mark.parametrize(("path", "most"), [("/api/edit", MAX_BODY_BYTES), ("/api/large", LARGE_BYTES)])
def test_a_body_that_does_not_say_so_is_bounded_as_it_comes(door: Door, path: str, most: int) -> None:
    for more, status in ((0, 200), (1, 413)):
        pieces = iter((b"x" * (most // 2), b"x" * (most - most // 2 + more)))
        assert door.call("POST", path, "admin", pieces).status == status


@pytest.mark.parametrize("length", [0, 2_000_000])
def test_a_body_has_a_minute_and_a_second_for_each_kilobyte_that_came(door: Door, length: int) -> None:
    allowed_s = 60.0 + length / 1000.0

    def pieces(took_s: float) -> Iterator[bytes]:
        yield b"x" * length
        door.clock.s += took_s
        yield b""

    for took_s, status in ((allowed_s - 0.5, 200), (allowed_s + 0.5, 408)):
        assert door.call("POST", "/api/large", "admin", pieces(took_s)).status == status


def test_who_has_sent_all_may_wait_for_the_answer_as_long_as_it_takes(people: People) -> None:
    async def slow(request: Request) -> Response:
        await request.body()
        door.clock.s += 1e6
        leaves = asyncio.ensure_future(request.receive())
        # As many turns of the loop as a bound on waiting needs to be noticed.
        for _ in range(10):
            await asyncio.sleep(0)
        has_ended = leaves.done()
        leaves.cancel()
        return PlainTextResponse(status_code=500 if has_ended else 200)

    with opened(people, {"/slow": slow}) as door:
        for body in (b"x", iter((b"x", b"x"))):
            assert door.call("GET", "/slow", body=body).status == 200


def test_what_says_in_two_ways_how_long_it_is_is_refused_and_nothing_more_is_read(people: People) -> None:
    with opened(people, {}, host="0.0.0.0") as door:
        for host, origin in ((HOST, ORIGIN), (None, None)):
            both = {"content-length": "1", "transfer-encoding": "chunked"}
            answer = door.call("POST", "/open", host=host, origin=origin, **both)
            assert (answer.status, answer.headers["connection"]) == (400, "close")
        for one in both:
            assert door.call("POST", "/open", **{one: both[one]}).status == 200


# --------------------------------------------------------------------------------------------- answers
@pytest.mark.parametrize("path", ["/open", "/look", "/api/look", "/nothing"])
def test_every_answer_carries_the_headers(door: Door, path: str) -> None:
    answer = door.call("GET", path)
    assert {name: answer.headers.get(name) for name in HEADERS} == HEADERS
    assert "strict-transport-security" not in answer.headers
    by_tls = door.call("GET", path, by_tls=True)
    assert int(by_tls.headers["strict-transport-security"].removeprefix("max-age=")) >= 180 * 86_400


def test_a_route_that_sets_its_own_policy_keeps_it(people: People) -> None:
    async def own(request: Request) -> Response:
        return PlainTextResponse("", headers={"Content-Security-Policy": "sandbox"})

    with opened(people, {"/own": own}) as door:
        assert door.call("GET", "/own").headers["content-security-policy"] == "sandbox"


def test_whoever_is_not_signed_in_is_led_to_the_page_where_they_sign_in_and_back(door: Door) -> None:
    assert door.call("GET", "/look").headers["location"] == "/signin?next=/look"
    assert told(door.call("POST", "/api/edit"))
    refused = door.call("GET", "/pois", "viewer")
    assert b"not for your role" in refused.body
    assert refused.headers["content-type"].startswith("text/html")
    assert told(door.call("GET", "/surprise", "viewer")), "no page of ours: a sentence"
    assert "(viewer)" in told(door.call("POST", "/api/edit", "viewer"))


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_the_cookie_is_for_this_host_alone_and_no_script_reads_it(scheme: str) -> None:
    request = Request({"type": "http", "scheme": scheme, "headers": [(b"host", HOST.encode())]})
    given, taken = Response(), Response()
    set_session_cookie(given, request, "secret", 60.9)
    drop_session_cookie(taken, request)
    secure = {"secure"} if scheme == "https" else set()
    for response, value in ((given, {"secret", "max-age=60"}), (taken, {'""', "max-age=0"})):
        name, _, rest = response.headers["set-cookie"].partition("=")
        flags = {each.strip().lower() for each in rest.split(";")}
        assert name == ("__Host-" if secure else "") + COOKIE
        assert {flag for flag in flags if not flag.startswith("expires")} == value | secure | {
            "httponly", "samesite=strict", "path=/",
        }, "no other host of the domain gets it"  # fmt: skip


def test_a_refusal_says_what_is_wrong_and_when_to_come_again() -> None:
    plain = error_response(BadRequestError("No."))
    assert (plain.status_code, plain.body) == (400, b'{"error":"No."}')
    assert not {"retry-after", "connection"} & set(plain.headers)
    for wait_s, seconds in ((0.2, "1"), (7.6, "8")):
        assert error_response(TooManyError("Later.", wait_s)).headers["retry-after"] == seconds


def test_what_is_neither_a_request_nor_a_socket_passes() -> None:
    passed: list[str] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        passed.append(scope["type"])

    nothing: Any = None
    asyncio.run(Guard(app, nothing, RULES)({"type": "lifespan"}, nothing, nothing))
    assert passed == ["lifespan"]
