"""The guard in front of every route, at the door of a small application: real accounts, real device tokens.

What the console's own routes permit is tested elsewhere; here it is what the guard does with a rule. Quick, so that a
fault in any line of it can be put in and looked for (.ci/mutants).
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from console_room import PASSWORD
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket

from console.accounts import Accounts
from console.config import ConsoleConfig
from console.device_store import DeviceStore
from console.errors import BadRequestError, TooManyError
from console.roles import EDITING, SIGNED_IN
from console.rules import MAX_BODY_BYTES, Rule
from console.security import PAGE_POLICY, Guard, error_response, set_session_cookie, visitor_of
from console.store import Store

HOST = "localhost:8765"
ORIGIN = f"http://{HOST}"
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


@dataclass
class Door:
    """The application, and who comes to it."""

    app: Starlette
    parts: Parts
    tokens: dict[str, str]

    def call(self, method: str, path: str, who: str = "", **headers: str | None) -> httpx.Response:
        """Make a request as our own page does; a header that is None is left out, ``body`` is sent."""
        sent = self.headers(who, **headers)
        body = (sent.pop("body", None) or "").encode()
        client = TestClient(self.app, ORIGIN, follow_redirects=False)
        return client.request(method, path, headers=sent, content=body or None)

    def headers(self, who: str, **others: str | None) -> dict[str, str]:
        """Return the headers of somebody's request."""
        token = self.tokens.get(who)
        session = {} if not token else {"authorization": f"Bearer {token}"} if who == "device" else {
            "cookie": f"{COOKIE}={token}"
        }  # fmt: skip
        merged: dict[str, str | None] = {"host": HOST, "origin": ORIGIN} | session | others
        return {name: value for name, value in merged.items() if value is not None}

    def open_socket(self, path: str, who: str = "", **headers: str | None) -> dict[str, Any]:
        """Open a WebSocket, which the other side closes again; return the first that the application says."""
        sent: list[dict[str, Any]] = []
        incoming = [{"type": "websocket.connect"}, {"type": "websocket.disconnect", "code": 1000}]

        async def receive() -> dict[str, Any]:
            return incoming.pop(0) if len(incoming) > 1 else incoming[0]

        async def send(message: Any) -> None:
            sent.append(message)

        scope = {
            "type": "websocket", "asgi": {"version": "3.0"}, "http_version": "1.1", "scheme": "ws", "path": path,
            "raw_path": path.encode(), "root_path": "", "query_string": b"", "client": ("127.0.0.1", 5),
            "server": ("127.0.0.1", 80), "subprotocols": [], "state": {},
            "headers": [(name.encode(), value.encode()) for name, value in self.headers(who, **headers).items()],
        }  # fmt: skip
        asyncio.run(self.app(scope, receive, send))
        return sent[0] if sent else {"type": "nothing"}

    def is_accepted(self, path: str, who: str = "", **headers: str | None) -> bool:
        """Open a WebSocket, and say whether it was accepted."""
        return bool(self.open_socket(path, who, **headers)["type"] == "websocket.accept")


async def whoever(request: Request) -> Response:
    """Say as whom the guard let somebody in."""
    await request.body()
    visitor = visitor_of(request)
    return JSONResponse([visitor.user_name if visitor else None, request.scope["state"]["device_name"]])


async def live(socket: WebSocket) -> None:
    """Accept, and say as whom."""
    await socket.accept()
    visitor = visitor_of(socket)
    await socket.send_text(str(visitor.user_name if visitor else socket.scope["state"]["device_name"]))
    await socket.close()


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Parts]:
    folder = tmp_path_factory.mktemp("door")
    store = Store.open(folder / "data")
    yield Parts(ConsoleConfig(folder, folder / "data"), Accounts(store, lambda: 0.0), DeviceStore(store))
    store.close()


@pytest.fixture(scope="module")
def door(parts: Parts) -> Door:
    first = parts.accounts.first_admin_link_token()
    assert first is not None
    people = {"admin": parts.accounts.use_link(first, "admin", PASSWORD).id}
    people["viewer"] = parts.accounts.invite("viewer", "viewer", "admin")[0].id
    tokens = {name: parts.accounts.start_session(user_id) for name, user_id in people.items()}
    tokens["device"] = parts.devices.create_token("Glasses", "admin")
    return Door(application(parts), parts, tokens)


def application(parts: Parts) -> Starlette:
    """Return an application of a few routes behind the guard."""
    paths = {path for method, path in RULES if method != "WS"} | {"/surprise"}
    routes = [Route(path, whoever, methods=["GET", "POST"]) for path in paths if ("POST", path) in RULES]
    routes += [Route(path, whoever, methods=["GET"]) for path in paths if ("POST", path) not in RULES]
    routes += [WebSocketRoute(path, live) for path in ("/live", "/device", "/unruled")]
    guard: Any = Guard
    return Starlette(routes=routes, middleware=[Middleware(guard, services=parts, rules=RULES)])


# -------------------------------------------------------------------------------------------------- who is let in
@pytest.mark.parametrize(
    ("method", "path", "nobody", "viewer", "admin", "device"),
    [
        ("GET", "/open", 200, 200, 200, 200), ("POST", "/open", 200, 200, 200, 200),
        ("GET", "/look", 303, 200, 200, 303), ("GET", "/pois", 303, 403, 200, 303),
        ("GET", "/api/look", 401, 200, 200, 401), ("POST", "/api/edit", 401, 403, 200, 401),
        ("GET", "/api/device", 401, 401, 401, 200), ("POST", "/api/device", 401, 401, 401, 200),
        ("GET", "/surprise", 403, 403, 403, 403), ("GET", "/nothing", 404, 404, 404, 404),
    ],
)  # fmt: skip
def test_who_is_let_in(door: Door, method: str, path: str, nobody: int, viewer: int, admin: int, device: int) -> None:
    for who, status in {"": nobody, "viewer": viewer, "admin": admin, "device": device}.items():
        answer = door.call(method, path, who)
        assert answer.status_code == status, f"{who}: {answer.text}"
        if status == 200:
            assert answer.json() == [who if who in ("viewer", "admin") else None,
                                     "Glasses" if who == "device" and path == "/api/device" else None]  # fmt: skip


def test_head_is_get(door: Door) -> None:
    assert door.call("HEAD", "/api/look", "viewer").status_code == 200
    assert door.call("HEAD", "/api/look").status_code == 401
    assert door.call("HEAD", "/api/device", "device").status_code == 200


def test_sockets(door: Door) -> None:
    for path, who, accepted in (
        ("/live", "", False), ("/live", "viewer", True), ("/live", "device", False),
        ("/device", "device", True), ("/device", "admin", False), ("/unruled", "admin", False),
    ):  # fmt: skip
        assert door.is_accepted(path, who) is accepted, (path, who)
    assert not door.is_accepted("/live", "viewer", origin="https://evil.example")
    assert not door.is_accepted("/live", "viewer", origin=None)
    assert door.is_accepted("/device", "device", origin=None), "a device is no browser"


def test_a_socket_is_told_apart_by_why_it_is_refused(door: Door) -> None:
    for path, who, code in (("/live", "", 4401), ("/unruled", "viewer", 4403)):
        refused = door.open_socket(path, who)
        assert (refused["type"], refused["code"]) == ("websocket.close", code)
        assert refused["reason"]


@pytest.mark.parametrize(
    "authorization", ["", "Bearer", "Bearer ", "Basic {token}", "{token}", "Bearer {token}x", "Bearer none"]
)
def test_only_a_valid_bearer_token_is_a_device(door: Door, authorization: str) -> None:
    token = door.tokens["device"]
    assert door.call("GET", "/api/device", authorization=authorization.format(token=token)).status_code == 401
    assert door.call("GET", "/api/device", authorization=f"bearer  {token} ").status_code == 200


def test_a_session_is_believed_by_its_own_cookie_alone(door: Door) -> None:
    token = door.tokens["viewer"]
    assert door.call("GET", "/api/look", cookie=f"{COOKIE}=forged").status_code == 401
    assert door.call("GET", "/api/look", cookie=f"vbr_session_8766={token}").status_code == 401
    assert door.call("GET", "/api/look", cookie=f"vbr_session={token}").status_code == 401
    assert door.call("GET", "/api/look", host="localhost", cookie=f"vbr_session={token}").status_code == 200


# ------------------------------------------------------------------------------------------- from where, by which name
@pytest.mark.parametrize("path", ["/open", "/api/edit", "/nothing"])
@pytest.mark.parametrize("origin", [None, "", "null", "https://evil.example", "http://localhost", "//"])
def test_what_changes_something_comes_from_our_own_page(door: Door, path: str, origin: str | None) -> None:
    assert door.call("POST", path, "admin", origin=origin).status_code == 403
    assert door.call("POST", path, "admin", origin=ORIGIN.upper()).status_code != 403


def test_no_host_is_no_origin_either(door: Door) -> None:
    assert door.call("POST", "/open", "admin", host="", origin="").status_code == 403


@pytest.mark.parametrize("method", ["GET", "HEAD", "OPTIONS"])
def test_what_changes_nothing_comes_from_anywhere(door: Door, method: str) -> None:
    assert door.call(method, "/open", origin="https://evil.example").status_code in (200, 405)


@pytest.mark.parametrize("host", ["evil.example:8765", "", "localhost.evil.example", "[::1", "localhost:port"])
def test_another_name_is_refused(door: Door, host: str) -> None:
    answer = door.call("GET", "/api/look", "admin", host=host)
    assert (answer.status_code, "the address that it printed" in answer.json()["error"]) == (403, True)


@pytest.mark.parametrize("host", ["LOCALHOST:8765", "127.0.0.1:8765", "[::1]:8765"])
def test_its_own_names_are_not(door: Door, host: str) -> None:
    assert door.call("GET", "/open", host=host).status_code == 200


def test_beyond_this_machine_any_name_leads_to_it(parts: Parts) -> None:
    config = ConsoleConfig(Path(), Path(), host="0.0.0.0")
    app = application(Parts(config, parts.accounts, parts.devices))
    assert TestClient(app, ORIGIN).get("/open", headers={"host": "console.example"}).status_code == 200


# ---------------------------------------------------------------------------------------------------- bodies
@pytest.mark.parametrize(
    ("path", "most"), [("/api/edit", MAX_BODY_BYTES), ("/api/large", LARGE_BYTES), ("/nothing", MAX_BODY_BYTES)]
)
def test_a_body_that_says_how_long_it_is_is_refused_unread(door: Door, path: str, most: int) -> None:
    refused = door.call("POST", path, "admin", **{"content-length": str(most + 1)})
    assert refused.status_code == 413
    words = {MAX_BODY_BYTES: "256 KiB", LARGE_BYTES: "2 MiB"}[most]
    assert words in refused.json()["error"]
    assert door.call("POST", path, "admin", **{"content-length": str(most)}).status_code != 413
    assert door.call("POST", path, "admin", **{"content-length": "many"}).status_code != 413


@pytest.mark.parametrize(("path", "most"), [("/api/edit", MAX_BODY_BYTES), ("/api/large", LARGE_BYTES)])
def test_a_body_that_does_not_say_so_is_bounded_as_it_comes(door: Door, path: str, most: int) -> None:
    async def sent(total: int) -> int:
        async def pieces() -> AsyncIterator[bytes]:
            for piece in (b"x" * (total // 2), b"x" * (total - total // 2)):
                yield piece

        transport = httpx.ASGITransport(app=door.app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url=ORIGIN) as client:
            answer = await client.post(path, headers=door.headers("admin"), content=pieces())
        return answer.status_code

    assert asyncio.run(sent(most)) == 200
    assert asyncio.run(sent(most + 1)) != 200


def test_a_mebibyte_is_called_one(door: Door) -> None:
    rules = {("POST", "/open"): Rule("anyone", max_body_bytes=1 << 20)}
    guard: Any = Guard
    app = Starlette(
        routes=[Route("/open", whoever, methods=["POST"])],
        middleware=[Middleware(guard, services=door.parts, rules=rules)],
    )
    refused = TestClient(app, ORIGIN).post("/open", headers={"origin": ORIGIN, "content-length": str(2 << 20)})
    assert "1 MiB" in refused.json()["error"]


# --------------------------------------------------------------------------------------------- answers
@pytest.mark.parametrize("path", ["/open", "/look", "/api/look", "/nothing"])
def test_every_answer_carries_the_headers(door: Door, path: str) -> None:
    answer = door.call("GET", path)
    assert {name: answer.headers.get(name) for name in HEADERS} == HEADERS
    assert "strict-transport-security" not in answer.headers


def test_a_route_that_sets_its_own_policy_keeps_it(parts: Parts) -> None:
    async def own(request: Request) -> Response:
        return PlainTextResponse("", headers={"Content-Security-Policy": "sandbox"})

    guard: Any = Guard
    rules = {("GET", "/own"): Rule("anyone")}
    app = Starlette(routes=[Route("/own", own)], middleware=[Middleware(guard, services=parts, rules=rules)])
    assert TestClient(app, ORIGIN).get("/own").headers["content-security-policy"] == "sandbox"


def test_by_tls_browsers_are_told_to_come_by_it_again(parts: Parts) -> None:
    config = ConsoleConfig(Path(), Path(), tls_certificate=Path("certificate"))
    app = application(Parts(config, parts.accounts, parts.devices))
    answer = TestClient(app, f"https://{HOST}").get("/open")
    assert int(answer.headers["strict-transport-security"].removeprefix("max-age=")) >= 180 * 86_400


def test_whoever_is_not_signed_in_is_led_to_the_page_where_they_sign_in_and_back(door: Door) -> None:
    assert door.call("GET", "/look").headers["location"] == "/signin?next=/look"
    assert "error" in door.call("POST", "/api/edit").json()
    refused = door.call("GET", "/pois", "viewer")
    assert "not for your role" in refused.text
    assert refused.headers["content-type"].startswith("text/html")
    assert door.call("GET", "/surprise", "viewer").json()["error"], "no page of ours: a sentence"
    assert "(viewer)" in door.call("POST", "/api/edit", "viewer").json()["error"]


def test_the_cookie_is_for_this_host_alone_and_no_script_reads_it() -> None:
    for scheme in ("http", "https"):
        scope = {"type": "http", "scheme": scheme, "headers": [(b"host", HOST.encode())], "server": ("localhost", 8765)}
        response = Response()
        set_session_cookie(response, Request(scope), "secret", scheme == "https", 60.9)
        name, _, rest = response.headers["set-cookie"].partition("=")
        flags = {each.strip().lower() for each in rest.split(";")}
        assert name == COOKIE
        assert {"secret", "httponly", "samesite=strict", "path=/", "max-age=60"} <= flags
        assert ("secure" in flags) is (scheme == "https")
        assert not any(flag.startswith("domain") for flag in flags), "no other host of the domain gets it"


def test_a_refusal_says_what_is_wrong_and_when_to_come_again() -> None:
    plain = error_response(BadRequestError("No."))
    assert (plain.status_code, plain.body, "retry-after" in plain.headers) == (400, b'{"error":"No."}', False)
    for wait_s, told in ((0.2, "1"), (7.6, "8")):
        assert error_response(TooManyError("Later.", wait_s)).headers["retry-after"] == told


def test_what_is_neither_a_request_nor_a_socket_passes(door: Door) -> None:
    passed: list[str] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        passed.append(scope["type"])

    services: Any = door.parts
    asyncio.run(Guard(app, services, RULES)({"type": "lifespan"}, None, None))  # type: ignore[arg-type]
    assert passed == ["lifespan"]
