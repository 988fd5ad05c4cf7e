"""What is open ends at once with what it was opened by: sessions and device tokens, over real sockets."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
from console_room import PASSWORD, DialledDevice, Person, first_admin, hello_of, invited, token_of, until
from test_viewer_mount import CAMERA
from viewer_site import crossing_corridors
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from console.accounts import SESSION_IDLE_S, SESSION_LONGEST_S
from console.config import ConsoleConfig
from console.device_link import REVOKED_CODE
from console.device_store import MAX_DEVICES_OF_TOKEN_COUNT, DeviceStore
from console.http_patience import HEAD_WITHIN_S, PatientHttp
from console.server import WS_MAX_BYTES, ConsoleServer
from console.sockets import MAX_SOCKETS_COUNT, SIGNED_OUT_CODE
from console.store import Store
from console.viewer.embedded import SUBPROTOCOL
from navcore.site import Site, save_site
from navcore.wire import Event, EventConfirmed, Welcome

STREAMS = ("/live", "/live/overview", "/live/alerts", "/viewer/scene")
WAIT_S = 20.0


@dataclass
class Hands:
    """A console that serves, its admin, and a person whose sockets are opened."""

    server: ConsoleServer
    admin: Person
    person: Person
    user_id: int

    def open(self, path: str) -> ClientConnection:
        """Open a socket of the person, as a page does."""
        cookies = "; ".join(f"{name}={value}" for name, value in self.person.http.cookies.items())
        return connect(
            self.person.url.replace("http", "ws", 1) + path, origin=self.person.url, proxy=None, max_size=None,
            additional_headers={"Cookie": cookies}, subprotocols=[SUBPROTOCOL] if "viewer" in path else None,
        )  # type: ignore[arg-type] # fmt: skip

    def change(self, **change: Any) -> None:
        """Let the admin change the person's account."""
        self.admin.http.patch(f"/api/users/{self.user_id}", json=change).raise_for_status()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ConsoleServer]:
    folder = tmp_path_factory.mktemp("sockets")
    save_site(crossing_corridors(200), folder / "site")
    server = ConsoleServer(ConsoleConfig(folder / "site", folder / "data", port=0))
    server.start()
    try:
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="module")
def admin(server: ConsoleServer) -> Person:
    return first_admin(server)


@pytest.fixture
def hands(server: ConsoleServer, admin: Person, request: pytest.FixtureRequest) -> Hands:
    name = request.node.name[-40:].strip("[]")
    person = invited(admin, name, "editor")
    users = admin.http.get("/api/users").json()["users"]
    return Hands(server, admin, person, next(user["id"] for user in users if user["name"] == name))


def close_code(connection: ClientConnection) -> int | None:
    """Read until the other side closes; return its code."""
    try:
        while True:
            connection.recv(timeout=WAIT_S)
    except ConnectionClosed as closed:
        return closed.rcvd.code if closed.rcvd is not None else None


def new_password(hands: Hands) -> None:
    link = hands.admin.http.post(f"/api/users/{hands.user_id}/link").json()["link"]
    Person(hands.person.url).open_link(link, password=f"{PASSWORD}!").raise_for_status()


def days_pass(hands: Hands) -> None:
    """The session becomes too old, though its page is open all the time."""
    store, real_s = hands.server.services.store, time.time
    store.wall_s = lambda: real_s() + SESSION_LONGEST_S + 1.0


ENDS: dict[str, Callable[[Hands], object]] = {
    "sign-out": lambda hands: hands.person.http.post("/api/sign-out").raise_for_status(),
    "a lower role": lambda hands: hands.change(role="viewer"),
    "a higher role": lambda hands: hands.change(role="admin"),
    "a locked account": lambda hands: hands.change(disabled=True),
    "another password": new_password,
    "somebody else at the same browser": lambda hands: hands.person.sign_in("Ada").raise_for_status(),
    "time": days_pass,
}


@pytest.mark.parametrize("end", ENDS)
def test_whatever_ends_a_session_closes_all_that_it_has_open(hands: Hands, end: str) -> None:
    before = hands.server.services.store.wall_s
    opened = [hands.open(path) for path in STREAMS]
    stays = hands.admin.live()
    try:
        for each in opened:
            each.recv(timeout=WAIT_S)
        was = dict(hands.person.http.cookies)
        ENDS[end](hands)
        assert {path: close_code(each) for path, each in zip(STREAMS, opened, strict=True)} == dict.fromkeys(
            STREAMS, SIGNED_OUT_CODE
        )
        if end != "time":
            stays.recv(timeout=WAIT_S)
        assert httpx.get(f"{hands.person.url}/api/session", cookies=was, trust_env=False).status_code == 401
    finally:
        hands.server.services.store.wall_s = before
        for each in (*opened, stays):
            each.close()
        if end == "time":
            # The admin's open page may have noted its use in those days: that session is no longer believed.
            hands.admin.sign_in("Ada").raise_for_status()


def test_an_open_page_uses_its_session_and_one_that_is_closed_does_not(hands: Hands) -> None:
    accounts, store = hands.server.services.accounts, hands.server.services.store
    token = next(iter(hands.person.http.cookies.values()))
    before, real_s = store.wall_s, time.time
    signed_in = accounts.signed_in(token)
    assert signed_in is not None
    try:
        with hands.open("/live") as stream:
            stream.recv(timeout=WAIT_S)
            store.wall_s = lambda: real_s() + SESSION_IDLE_S / 2
            deadline_s = time.monotonic() + WAIT_S
            accounts.note_used(hands.server.services.sockets.session_ids())
            assert time.monotonic() < deadline_s
        store.wall_s = lambda: real_s() + SESSION_IDLE_S + 10.0
        assert accounts.over([signed_in.session_id]) == set()
        store.wall_s = lambda: real_s() + 2 * SESSION_IDLE_S
        assert accounts.over([signed_in.session_id]) == {signed_in.session_id}
    finally:
        store.wall_s = before


def test_a_session_that_ends_while_its_page_is_let_in_is_closed_soon_after(hands: Hands) -> None:
    """The guard has let it in, and somebody signs out before its socket is known."""
    services = hands.server.services
    signed_in = services.accounts.signed_in(next(iter(hands.person.http.cookies.values())))
    assert signed_in is not None
    services.accounts._on_session_end, told = (lambda _: None), services.accounts._on_session_end
    try:
        with hands.open("/live") as stream:
            stream.recv(timeout=WAIT_S)
            services.accounts.sign_out(signed_in)
            assert close_code(stream) == SIGNED_OUT_CODE
    finally:
        services.accounts._on_session_end = told


def test_one_session_has_many_pages_open_and_not_endlessly_many(hands: Hands) -> None:
    opened: list[ClientConnection] = []
    try:
        opened += [hands.open("/live/alerts") for _ in range(MAX_SOCKETS_COUNT)]
        with pytest.raises(InvalidStatus) as refused:
            hands.open("/live/alerts")
        assert refused.value.response.status_code == 403
        with hands.admin.live() as other:
            assert other.recv(timeout=WAIT_S)
        opened.pop().close()
        deadline_s = time.monotonic() + WAIT_S
        while True:
            try:
                opened.append(hands.open("/live/alerts"))
                break
            except InvalidStatus:
                assert time.monotonic() < deadline_s, "a place that is free again can be taken"
    finally:
        hands.server.services.sockets.close_all()
        for each in opened:
            each.close()


@pytest.mark.parametrize("path", STREAMS)
def test_a_page_that_floods_its_stream_is_closed_and_the_others_go_on(hands: Hands, path: str) -> None:
    with hands.open(path) as flooding, hands.admin.live() as other:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(5000):
                flooding.send(msgspec.msgpack.encode(CAMERA) if "viewer" in path else '{"type":"x"}')
        assert close_code(flooding) in (1007, 1008)
        assert other.recv(timeout=WAIT_S)


@pytest.mark.parametrize("path", ["/live", "/viewer/scene"])
def test_a_message_of_many_megabytes_is_not_taken_in(hands: Hands, path: str) -> None:
    with hands.open(path) as stream:
        with contextlib.suppress(ConnectionClosed):
            stream.send(b"x" * (WS_MAX_BYTES + 1))
        assert close_code(stream) in (1009, 1006, None)


# ------------------------------------------------------------------------------------------------------- devices
def revoked_by_the_api(server: ConsoleServer, admin: Person) -> None:
    admin.http.post("/api/tokens/revoke", json={"name": "  Lead   glasses "}).raise_for_status()


def replaced_by_the_api(server: ConsoleServer, admin: Person) -> None:
    admin.http.post("/api/tokens", json={"name": " Lead  glasses"}).raise_for_status()


def revoked_by_the_command_line(server: ConsoleServer, admin: Person) -> None:
    """Another process: the console hears nothing of it."""
    store = Store.open(server.services.config.data_folder)
    try:
        DeviceStore(store).revoke_token("Lead glasses", "command line")
    finally:
        store.close()


@pytest.mark.parametrize("end", [revoked_by_the_api, replaced_by_the_api, revoked_by_the_command_line])
def test_a_token_that_is_void_ends_the_link_that_it_opened(
    server: ConsoleServer, admin: Person, end: Callable[[ConsoleServer, Person], None]
) -> None:
    tokens = {name: str(admin.http.post("/api/tokens", json={"name": name}).json()["token"])
              for name in ("Lead glasses", "Other glasses")}  # fmt: skip
    lead = DialledDevice(server.ready.url, tokens["Lead glasses"], hello_of(server, "lead"))
    other = DialledDevice(server.ready.url, tokens["Other glasses"], hello_of(server, "other"))
    with lead.socket, other.socket:
        lead.next(Welcome)
        end(server, admin)
        assert lead.close_code()[0] == REVOKED_CODE
        until(server.services.hub, lambda device: device.device_id == "lead" and not device.connected)
        other.send(Event(server.services.devices.last_sequence("other") + 1, 0.0, "cue", "still here"))
        assert other.next(EventConfirmed)
    with pytest.raises(InvalidStatus):
        DialledDevice(server.ready.url, tokens["Lead glasses"], None)


def test_a_token_that_is_void_before_the_device_says_hello_lets_nothing_in(
    server: ConsoleServer, admin: Person
) -> None:
    token = str(admin.http.post("/api/tokens", json={"name": "Slow glasses"}).json()["token"])
    slow = DialledDevice(server.ready.url, token, None)
    with slow.socket:
        admin.http.post("/api/tokens/revoke", json={"name": "Slow glasses"}).raise_for_status()
        slow.send(hello_of(server, "slow"))
        assert slow.close_code()[0] == REVOKED_CODE


def test_a_device_speaks_for_itself_alone(server: ConsoleServer, admin: Person) -> None:
    mine, others = (str(admin.http.post("/api/tokens", json={"name": name}).json()["token"])
                    for name in ("My glasses", "Their glasses"))  # fmt: skip
    devices = server.services.devices
    with DialledDevice(server.ready.url, others, hello_of(server, "theirs")).socket:
        until(server.services.hub, lambda device: device.device_id == "theirs" and device.connected)
        thief = DialledDevice(server.ready.url, mine, hello_of(server, "theirs"))
        assert thief.close_code()[0] == 4403
        until(server.services.hub, lambda device: device.device_id == "theirs" and device.connected)
    assert devices.latest_events("theirs", 10) == ()


def test_one_token_is_of_a_few_devices_and_not_of_all_that_can_be_made_up(server: ConsoleServer, admin: Person) -> None:
    admin.http.post("/api/tokens", json={"name": "Many"}).raise_for_status()
    token = str(admin.http.post("/api/tokens", json={"name": "Many"}).json()["token"])
    for number in range(MAX_DEVICES_OF_TOKEN_COUNT):
        server.services.devices.take_in(f"made-up-{number}", "Many")
    code, reason = DialledDevice(server.ready.url, token, hello_of(server, "made-up-too-many")).close_code()
    assert code == 4403
    assert "make one for each" in reason
    with DialledDevice(server.ready.url, token, hello_of(server, "made-up-0")).socket:
        until(server.services.hub, lambda device: device.device_id == "made-up-0" and device.connected)


# ---------------------------------------------------------------------------------------------- below the application
@pytest.mark.parametrize("head", [b"", b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Slow: "])
def test_whoever_does_not_end_the_head_of_a_request_is_cut_off(
    server: ConsoleServer, head: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("console.http_patience.HEAD_WITHIN_S", 0.2)
    assert HEAD_WITHIN_S == 10.0
    assert server._uvicorn.config.http is PatientHttp
    with socket.create_connection(server._socket.getsockname(), timeout=WAIT_S) as slow:
        slow.sendall(head)
        with contextlib.suppress(ConnectionResetError):
            assert slow.recv(100) == b""


def test_a_head_that_is_too_large_is_refused(server: ConsoleServer) -> None:
    with socket.create_connection(server._socket.getsockname(), timeout=WAIT_S) as large:
        try:
            large.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"x" * (200 << 10))
            assert large.recv(100).startswith(b"HTTP/1.1 400")
        except (ConnectionResetError, BrokenPipeError):
            pass


@pytest.mark.parametrize(
    "lengths",
    [
        "Content-Length: 6\r\nTransfer-Encoding: chunked", "Content-Length: 5\r\nContent-Length: 6",
        "Transfer-Encoding: xchunked", "Content-Length : 5", "Content-Length: +5", "Host: evil.example",
    ],
)  # fmt: skip
def test_no_request_hides_within_another(server: ConsoleServer, lengths: str) -> None:
    host = server.ready.url.partition("//")[2]
    head = f"POST /api/sign-in HTTP/1.1\r\nHost: {host}\r\nOrigin: {server.ready.url}\r\n{lengths}\r\n\r\n"
    hidden = f"GET /healthz HTTP/1.1\r\nHost: {host}\r\n\r\n"
    with socket.create_connection(server._socket.getsockname(), timeout=WAIT_S) as sender:
        sender.sendall((head + "0\r\n\r\n" + hidden).encode())
        answers = b""
        with contextlib.suppress(ConnectionResetError):
            while piece := sender.recv(4096):
                answers += piece
    assert answers.startswith(b"HTTP/1.1 400")
    assert answers.count(b"HTTP/1.1") == 1, "the second one was never answered"


def test_a_body_that_does_not_come_is_not_waited_for(server: ConsoleServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("console.security.BODY_PATIENCE_S", 0.2)
    host = server.ready.url.partition("//")[2]
    head = (
        f"POST /api/sign-in HTTP/1.1\r\nHost: {host}\r\nOrigin: {server.ready.url}\r\n"
        "Content-Type: application/json\r\nContent-Length: 1000\r\n\r\n{"
    )
    with socket.create_connection(server._socket.getsockname(), timeout=WAIT_S) as slow:
        slow.sendall(head.encode())
        assert slow.recv(100).startswith(b"HTTP/1.1 4")


def test_one_address_has_only_so_many_connections_and_another_one_its_own(
    server: ConsoleServer, admin: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("console.http_patience.MAX_CONNECTIONS_COUNT", 5)
    address, opened = server._socket.getsockname(), contextlib.ExitStack()
    with opened:
        held = [
            opened.enter_context(socket.create_connection(address, WAIT_S, source_address=("127.0.0.2", 0)))
            for _ in range(6)
        ]
        with contextlib.suppress(ConnectionResetError):
            assert held[-1].recv(100) == b"", "turned away"
        host = server.ready.url.partition("//")[2]
        held[0].sendall(f"GET /healthz HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        assert held[0].recv(100).startswith(b"HTTP/1.1 200"), "those that are in stay"
        assert admin.http.get("/healthz").status_code == 200


def test_whoever_never_agrees_on_tls_is_counted_and_cut_off_as_well(
    small_site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody says a word here, so no certificate is ever shown, and none is needed."""
    monkeypatch.setattr("console.http_patience.MAX_CONNECTIONS_COUNT", 5)
    monkeypatch.setattr("console.http_patience.HEAD_WITHIN_S", 2.0)
    monkeypatch.setattr("ssl.SSLContext.load_cert_chain", lambda *_: None)
    save_site(small_site, tmp_path / "site")
    empty = tmp_path / "empty.pem"
    empty.touch()
    config = ConsoleConfig(tmp_path / "site", tmp_path / "data", port=0, tls_certificate=empty, tls_key=empty)
    server = ConsoleServer(config, with_scene=False)
    with contextlib.ExitStack() as opened:
        server.start()
        opened.callback(server.stop)
        address = server._socket.getsockname()

        def connection() -> socket.socket:
            source = ("127.0.0.2", 0)
            return opened.enter_context(socket.create_connection(address, WAIT_S, source_address=source))

        silent = [connection() for _ in range(6)]
        closed, _, _ = select.select(silent, [], [], WAIT_S)
        assert closed == silent[-1:], "turned away before the others' time is over"
        for each in silent:
            with contextlib.suppress(ConnectionResetError):
                assert each.recv(100) == b"", "nobody holds a connection for long by saying nothing"
        again = connection()
        assert select.select([again], [], [], 0.1)[0] == [], "there is room once more"


def test_links_are_of_one_use_and_of_the_newest(hands: Hands) -> None:
    url = f"/api/users/{hands.user_id}/link"
    old, new = (hands.admin.http.post(url).json()["link"] for _ in range(2))
    assert Person(hands.person.url).open_link(old).status_code == 404
    assert Person(hands.person.url).open_link(new).status_code == 200
    assert Person(hands.person.url).open_link(new).status_code == 404
    third = hands.admin.http.post(url).json()["link"]
    hands.change(disabled=True)
    assert Person(hands.person.url).open_link(third).status_code == 404
    hands.change(disabled=False)
    assert Person(hands.person.url).open_link(third).status_code == 404, "nor when they may come in again"
    assert token_of(third)


def test_a_cookie_from_before_signing_in_is_worthless(hands: Hands) -> None:
    name, token = next(iter(hands.person.http.cookies.items()))
    planted = "a" * len(token)
    hands.person.http.cookies.clear()
    hands.person.http.cookies.set(name, planted)
    answer = hands.person.sign_in(hands.server.services.accounts.users()[0].name)
    chosen = answer.headers["set-cookie"].partition("=")[2].partition(";")[0]
    assert chosen not in (planted, token)
    for worthless in (planted, ""):
        got = httpx.get(f"{hands.person.url}/api/session", headers={"Cookie": f"{name}={worthless}"}, trust_env=False)
        assert got.status_code == 401
    assert Path(hands.server.services.config.data_folder).is_dir()
