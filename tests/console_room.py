"""A console that really serves, people with browsers of few words, and a device that really dials."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import parse_qs, urlsplit

import argon2
import httpx
import numpy as np
from websockets.sync.client import ClientConnection, connect

from console import secrets_kept
from console.config import ConsoleConfig
from console.hub import DeviceHub
from console.live import LiveDevice
from console.server import ConsoleServer
from navcore.settings import Settings
from navcore.silhouette import silhouette_jpeg
from navcore.wire import (
    PROTOCOL_VERSION,
    ConsoleMessage,
    DeviceMessage,
    Hello,
    decode_from_console,
    encode,
)

PICTURE = silhouette_jpeg(np.full((12, 16), 2.0, np.float32))
"""A small picture, as devices send it."""
PASSWORD = "seven quiet corridors"
WAIT_S = 20.0
Message = TypeVar("Message")
PRODUCT_HASHER = secrets_kept._hasher
# Hundreds of people sign in here: the same hash, made weak, so that it does not take a fifth of a second each time.
secrets_kept._hasher = argon2.PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)
secrets_kept._HASH_OF_NOTHING = secrets_kept._hasher.hash("nothing")


@contextmanager
def serving(
    site_folder: Path, data_folder: Path, public_hosts: frozenset[str] = frozenset(), **options: Any
) -> Iterator[ConsoleServer]:
    """Serve a site on a free port until the block ends."""
    config = ConsoleConfig(site_folder, data_folder, port=0, public_hosts=public_hosts)
    server = ConsoleServer(config, with_scene=False, **options)
    server.start()
    try:
        yield server
    finally:
        server.stop()


class HandClock:
    """A clock that stands still until it is set on."""

    def __init__(self) -> None:
        self.s = 1_800_000_000.0

    def __call__(self) -> float:
        return self.s


class Person:
    """Somebody with a browser: keeps cookies, and says where each request comes from."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.http = httpx.Client(base_url=url, headers={"Origin": url}, trust_env=False, verify=False, timeout=WAIT_S)

    def open_link(self, link: str, name: str = "", password: str = PASSWORD) -> httpx.Response:
        """Choose a name and a password behind a one-time link."""
        return self.http.post("/api/first", json={"token": token_of(link), "name": name, "password": password})

    def sign_in(self, name: str, password: str = PASSWORD) -> httpx.Response:
        """Sign in."""
        return self.http.post("/api/sign-in", json={"name": name, "password": password})

    def edit(self, edit: str, **values: Any) -> httpx.Response:
        """Edit the draft."""
        return self.http.post("/api/edits", json={"edit": edit, **values})

    def graph(self) -> dict[str, Any]:
        """Return the draft as the pages see it."""
        return self.http.get("/api/graph").raise_for_status().json()

    def live(self, origin: str | None = None, path: str = "/live") -> ClientConnection:
        """Open a live stream."""
        cookies = "; ".join(f"{name}={value}" for name, value in self.http.cookies.items())
        headers = {"Cookie": cookies} if cookies else {}
        return connect(
            self.url.replace("http", "ws") + path,
            origin=self.url if origin is None else origin,
            additional_headers=headers,
            proxy=None,
        )


def first_admin(server: ConsoleServer) -> Person:
    """Return the first admin, signed in by the link that the console printed."""
    assert server.ready.first_link is not None
    person = Person(server.ready.url)
    person.open_link(server.ready.first_link, "Ada").raise_for_status()
    return person


def invited(admin: Person, name: str, role: str) -> Person:
    """Return a person of a role, signed in by an invitation."""
    answer = admin.http.post("/api/users", json={"name": name, "role": role}).raise_for_status()
    person = Person(admin.url)
    person.open_link(answer.json()["link"]).raise_for_status()
    return person


def token_of(link: str) -> str:
    """Return the token in a one-time link."""
    return parse_qs(urlsplit(link).query)["token"][0]


class DialledDevice:
    """A device on its end of a real link."""

    def __init__(self, url: str, token: str, hello: Hello | None) -> None:
        self.socket = connect(
            url.replace("http", "ws") + "/device", additional_headers={"Authorization": f"Bearer {token}"}, proxy=None
        )
        if hello is not None:
            self.send(hello)

    def send(self, message: DeviceMessage) -> None:
        """Send a message."""
        self.socket.send(encode(message))

    def next(self, kind: type[Message]) -> Message:
        """Return the next message of a kind; others are passed over."""
        while True:
            message: ConsoleMessage = decode_from_console(bytes(self.socket.recv(timeout=WAIT_S)))  # type: ignore[arg-type]
            if isinstance(message, kind):
                return message

    def close_code(self) -> tuple[int, str]:
        """Read until the console closes the link; return code and reason."""
        try:
            while True:
                self.socket.recv(timeout=WAIT_S)
        except Exception:
            assert self.socket.protocol.close_rcvd is not None
            return self.socket.protocol.close_rcvd.code, self.socket.protocol.close_rcvd.reason


def hello_of(server: ConsoleServer, device_id: str = "glasses", **changes: Any) -> Hello:
    """Return the hello of a device that runs what the console offers."""
    values: dict[str, Any] = {
        "protocol_version": PROTOCOL_VERSION,
        "device_id": device_id,
        "software_version": "0.1.0",
        "site_id": server.services.model.site.site_id,
        "map_checksum": server.services.package.checksum,
        "graph_version": server.services.model.published.version,
        "settings_revision": 0,
        "now_s": 1000.0,
    }
    return Hello(**(values | changes))


def until(hub: DeviceHub, holds: Callable[[LiveDevice], bool]) -> LiveDevice:
    """Wait for the hub to hear something that makes a device such; fails after a while."""
    found: list[LiveDevice] = []
    heard = threading.Event()

    def look(device: LiveDevice) -> None:
        if not found and holds(device):
            found.append(device)
            heard.set()

    unsubscribe = hub.subscribe(look)
    try:
        for device in hub.devices():
            look(device)
        assert heard.wait(WAIT_S), "the device never came to be so"
    finally:
        unsubscribe()
    return found[0]


DEFAULTS = Settings().values()


def heard_until(socket: ClientConnection, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Return the first message of a live stream that is such; a walker is shown only once told who watches."""
    deadline_s = time.monotonic() + WAIT_S
    while not holds(told := json.loads(socket.recv(timeout=WAIT_S))):
        assert time.monotonic() < deadline_s, "it was never told"
    picture: dict[str, Any] = told
    return picture
