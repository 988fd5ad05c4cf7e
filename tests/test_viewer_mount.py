"""The scene's page and WebSocket inside the console: who gets in, what passes, and when it ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
import zstandard
from viewer_site import crossing_corridors
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from console.config import ConsoleConfig
from console.roles import Role
from console.server import ConsoleServer
from console.viewer.embedded import SUBPROTOCOL
from navcore.site import save_site

PASSWORD = "correct horse battery staple"
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, 5.0), "fov": 1.0, "near": 0.1,
    "far": 100.0, "image_height": 600, "image_width": 800, "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0),
}  # fmt: skip


@dataclass
class Console:
    """A running console with one person of each role; signing in gives the Cookie header of a fresh session."""

    server: ConsoleServer
    url: str
    user_ids: dict[Role, int]

    def sign_in(self, role: Role) -> str:
        token = self.server.services.accounts.start_session(self.user_ids[role])
        return f"vbr_session_{self.url.rsplit(':', 1)[1]}={token}"

    def open(self, role: Role | None = "editor", **headers: str) -> ClientConnection:
        """Open the scene's WebSocket as a browser does. Raises InvalidStatus where it is refused."""
        sent = {"Origin": self.url, **({"Cookie": self.sign_in(role)} if role else {}), **headers}
        origin = sent.pop("Origin")
        return connect(
            self.url.replace("http", "ws", 1) + "/viewer/scene", additional_headers=sent, compression=None,
            origin=origin or None, subprotocols=[SUBPROTOCOL], max_size=None, ping_interval=None,
        )  # type: ignore[arg-type] # fmt: skip


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    folder: Path = tmp_path_factory.mktemp("mounted")
    save_site(crossing_corridors(3000), folder / "site")
    server = ConsoleServer(ConsoleConfig(folder / "site", folder / "data", port=0))
    accounts = server.services.accounts
    first = accounts.first_admin_link_token()
    assert first is not None
    user_ids: dict[Role, int] = {"admin": accounts.use_link(first, "admin", PASSWORD).id}
    for role in ("viewer", "editor", "technician"):
        _, link = accounts.invite(role, role, "admin")
        user_ids[role] = accounts.use_link(link, role, PASSWORD).id
    ready = server.start()
    try:
        yield Console(server, ready.url, user_ids)
    finally:
        server.stop()


def received(socket: ClientConnection, *awaited: str, timeout_s: float = 20.0) -> list[dict[str, Any]]:
    """Read what viser sends, until there was a message of each of the given types."""
    messages: list[dict[str, Any]] = []
    while not set(awaited) <= {message["type"] for message in messages}:
        data = socket.recv(timeout=timeout_s)
        assert isinstance(data, bytes)
        length, packed = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:16], "little")
        inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=length)
        messages += msgspec.msgpack.decode(inner)["messages"]
    return messages


def send(socket: ClientConnection, message: dict[str, Any]) -> None:
    socket.send(msgspec.msgpack.encode(message))


def closing_code(socket: ClientConnection) -> int | None:
    """Read until the other side closes, and return its code."""
    try:
        while True:
            socket.recv(timeout=20)
    except ConnectionClosed as closed:
        return closed.rcvd.code if closed.rcvd is not None else None


# ------------------------------------------------------------------------------------------------------ the page
def test_the_page_needs_a_session(console: Console) -> None:
    answer = httpx.get(f"{console.url}/viewer/scene/")
    assert answer.status_code == 303
    assert answer.headers["location"].startswith("/signin")


def test_the_page_is_viser_under_a_policy_that_lets_no_foreign_code_in(console: Console) -> None:
    cookie = {"Cookie": console.sign_in("viewer")}
    answer = httpx.get(f"{console.url}/viewer/scene/", headers=cookie)
    policy = answer.headers["content-security-policy"]
    assert answer.status_code == 200
    assert "<title>Virtual blind road</title>" in answer.text
    assert "default-src 'none'" in policy
    assert "connect-src 'self' data: blob:;" in policy
    assert "frame-ancestors 'self'" in policy
    assert answer.headers["content-encoding"] == "gzip"
    again = httpx.get(f"{console.url}/viewer/scene/", headers={**cookie, "If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304


# ---------------------------------------------------------------------------------------------------- the socket
@pytest.mark.parametrize(
    ("role", "headers"),
    [
        (None, {}),
        (None, {"Cookie": "vbr_session=nonsense"}),
        ("editor", {"Origin": "http://evil.example"}),
        ("editor", {"Origin": ""}),
        ("editor", {"Origin": "null"}),
    ],
)
def test_a_stranger_or_a_foreign_page_is_refused_before_the_upgrade(
    console: Console, role: Role | None, headers: dict[str, str]
) -> None:
    with pytest.raises(InvalidStatus) as refusal:
        console.open(role, **headers)
    assert refusal.value.response.status_code == 403


def test_a_client_of_another_version_is_refused(console: Console) -> None:
    with pytest.raises(InvalidStatus):
        connect(
            console.url.replace("http", "ws", 1) + "/viewer/scene", origin=console.url,  # type: ignore[arg-type]
            additional_headers={"Cookie": console.sign_in("editor")}, subprotocols=["viser-v1.0.0"],  # type: ignore[list-item]
        )  # fmt: skip


def test_a_signed_in_person_gets_the_map_and_a_panel_for_their_role(console: Console) -> None:
    labels: dict[Role, set[str]] = {}
    for role in ("viewer", "editor", "technician"):
        with console.open(role) as socket:
            send(socket, CAMERA)
            messages = received(socket, "ReplayDoneMessage", "RegisterCommandMessage")
            assert any(message["type"] == "PointCloudMessage" for message in messages)
            labels[role] = {m["props"]["label"] for m in messages if m["type"] == "GuiButtonMessage"}
    assert "Tag a place (2)" in labels["editor"]
    assert "Tag a place (2)" not in labels["viewer"]
    assert "Tag a place (2)" not in labels["technician"]


def test_a_forbidden_message_is_dropped_and_the_socket_goes_on(console: Console) -> None:
    with console.open("admin") as socket:
        send(socket, {"type": "ShareUrlRequest"})
        send(socket, {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"removed": True}})
        send(socket, CAMERA)
        assert received(socket, "GuiTabGroupMessage")


def test_what_cannot_be_read_ends_that_socket_alone(console: Console) -> None:
    with console.open("editor") as good, console.open("editor") as bad:
        bad.send(b"\xc1")
        assert closing_code(bad) == 1007
        send(good, CAMERA)
        assert received(good, "GuiTabGroupMessage")


def test_signing_out_closes_the_scene_of_that_session_alone(console: Console) -> None:
    mine, other = console.sign_in("editor"), console.sign_in("editor")
    with console.open(None, Cookie=mine) as socket, console.open(None, Cookie=other) as stays:
        send(socket, CAMERA)
        received(socket, "GuiTabGroupMessage")
        answer = httpx.post(f"{console.url}/api/sign-out", headers={"Cookie": mine, "Origin": console.url})
        assert answer.is_success
        assert closing_code(socket) == 4401
        send(stays, CAMERA)
        assert received(stays, "GuiTabGroupMessage")
