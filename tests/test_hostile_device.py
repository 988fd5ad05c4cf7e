"""A device with a good token that means harm, at a real console: it is told to go, and all others are served on."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from console_room import (
    DEFAULTS,
    PICTURE,
    WAIT_S,
    DialledDevice,
    Person,
    first_admin,
    heard_until,
    hello_of,
    serving,
    until,
)
from test_fuzzed_wire import _declared
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.kills.sites import small_site
from console.alerts.message_ring import MAX_RING_BYTES
from console.device_store import MAX_DEVICES_OF_TOKEN_COUNT
from console.server import ConsoleServer
from navcore import wire
from navcore.site import save_site
from navcore.wire import (
    ApplySettings,
    ColourImage,
    DepthImage,
    Event,
    EventConfirmed,
    GraphRunning,
    Hello,
    Pong,
    RouteChanged,
    SettingsRunning,
    WalkerState,
    Welcome,
)
from navcore.wire_trace import WireCandidate


class Room:
    """A console, a device that behaves, and a page that watches it."""

    def __init__(self, server: ConsoleServer) -> None:
        self.server, self.url = server, server.ready.url
        self.admin: Person = first_admin(server)
        self.token = server.services.devices.create_token("Hostile", "test")
        self.good = DialledDevice(
            self.url, server.services.devices.create_token("Good", "test"), hello_of(server, "good")
        )
        self.good.next(Welcome)
        self.good.send(SettingsRunning(0, DEFAULTS))
        self._count = 0
        threading.Thread(target=self._read_on, daemon=True).start()

    def _read_on(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for _ in self.good.socket:
                """What the console says is taken in."""

    def hostile(self, hello: Hello | None = None) -> DialledDevice:
        """Let the hostile device dial."""
        device = DialledDevice(self.url, self.token, hello or hello_of(self.server, "hostile"))
        device.next(Welcome)
        return device

    def serves_on(self) -> None:
        """What the good device says is on the page and in the overview, and people are answered."""
        self._count += 1
        self.good.send(WalkerState(1000.0, "localized", "stop", "ok", rule=f"cycle {self._count}"))
        with self.admin.live() as page:
            told = heard_until(page, lambda picture: _rule_of(picture, "good") == f"cycle {self._count}")
            assert {each["id"] for each in told["devices"]} >= {"good"}
        with self.admin.live(path="/live/overview") as overview:
            heard_until(overview, lambda picture: "good" in picture["rows"])
        assert self.admin.http.get("/api/alerts").status_code == 200


def _rule_of(picture: dict[str, Any], device_id: str) -> str:
    states = [each["state"] for each in picture["devices"] if each["id"] == device_id]
    return states[0]["rule"] if states and states[0] else ""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    folder: Path = tmp_path_factory.mktemp("hostile")
    save_site(small_site(), folder / "site")
    with serving(folder / "site", folder / "data") as server:
        yield Room(server)


def _raw(message: wire.DeviceMessage, **changes: object) -> bytes:
    return msgspec.msgpack.encode(msgspec.msgpack.decode(wire.encode(message)) | changes)


STATE = WalkerState(1000.0, "localized", "walk", "ok", pose=(1.0, 0.0, 1.6, 0.0))
REFUSED: dict[str, bytes | str] = {
    "garbage": b"\x00\x01\x02",
    "text": "hello",
    "nothing": b"",
    "deep": b"\x92" * 100_000,
    "larger than anything": bytes(wire.MAX_MESSAGE_BYTES + 1),
    "no number": _raw(STATE, pose=[float("nan")] * 4),
    "too far": _raw(STATE, pose=[1e308, 0.0, 1.6, 0.0]),
    "far future": _raw(STATE, stamp_s=1e300),
    "negative count": _raw(GraphRunning(1), version=-1),
    "huge count": _raw(GraphRunning(1), version=1 << 63),
    "too many candidates": _raw(STATE, candidates=[[0.0, 1.0, True]] * 20_000),
    "a bomb": wire.encode(DepthImage(1000.0, _declared(60_000, 60_000))),
    "no picture": wire.encode(DepthImage(1000.0, b"\x89PNG" + bytes(100))),
    "no colour picture": wire.encode(ColourImage(1000.0, b"")),
    "hello again": wire.encode(Hello(wire.PROTOCOL_VERSION, "x", "1", "s", "c", 0, 0, 0.0)),
    "an order": wire.encode(wire.Pause()),
}


def test_what_cannot_be_read_ends_its_own_link_with_the_reason_and_nothing_else(
    room: Room, caplog: pytest.LogCaptureFixture
) -> None:
    with room.admin.live() as page:
        for name, data in REFUSED.items():
            device = room.hostile()
            device.socket.send(data)
            code, reason = device.close_code()
            assert (code, reason.endswith("…") or len(reason) > 20) == (1007, True), (name, reason)
        json.loads(page.recv(timeout=WAIT_S))
    room.serves_on()
    told = [record for record in caplog.records if "The link of device hostile is closed" in record.getMessage()]
    assert len(told) <= 1, "the log tells it once a minute, however often"
    assert [record for record in caplog.records if record.exc_info] == []


def test_values_at_the_end_of_what_is_allowed_harm_nobody(room: Room) -> None:
    device = room.hostile()
    far = (1e12, -1e12, 1e12, -1e12)
    device.send(msgspec.structs.replace(STATE, pose=far, stamp_s=1e12, last_cue="\x00\x1b[2J\u202e", deviation_m=1e12))
    device.send(RouteChanged(-1e12, ((1e12, 1e12),) * 2, (("<b>", 1e12),) * 50, "no such place"))
    device.send(SettingsRunning(1 << 53, {"gate.clearance_m": -1e12, "no.such": "x" * 1000, "": True}))
    device.send(GraphRunning(1 << 53, "x" * 500))
    for number in (5, 5, 3, 1 << 53, 1):
        device.send(Event(number, 1e12, "cue", "\x07\u2028" * 100))
        assert device.next(EventConfirmed).sequence == number
    for stamps in ((1e12, -1e12, 1e12), (-1e12, 1e12, 1e12), (0.0, 0.0, 0.0)):
        device.send(Pong(*stamps))
    room.serves_on()
    with room.admin.live() as page:
        heard_until(page, lambda picture: any(each["id"] == "hostile" for each in picture["devices"]))
    for path in ("/api/devices/hostile/settings", "/api/alerts?device=hostile", "/api/incidents", "/api/privacy"):
        assert room.admin.http.get(path).status_code == 200, path
    device.socket.close()


def test_a_revision_that_no_console_counts_to_uses_up_nobodys_numbers(room: Room) -> None:
    device = room.hostile(hello_of(room.server, "hostile", settings_revision=1 << 53))
    device.send(SettingsRunning(1 << 53, DEFAULTS))
    until(room.server.services.hub, lambda known: known.device_id == "hostile" and known.settings is not None)
    wanted = {"changes": {"cues.language": "zh"}, "confirmed": True}
    for device_id in ("hostile", "good"):
        answer = room.admin.http.patch(f"/api/devices/{device_id}/settings", json=wanted).raise_for_status().json()
        assert 0 < int(answer["command"]["detail"]) < 1000
    assert device.next(ApplySettings).base_revision == 1 << 53
    device.socket.close()


@pytest.mark.parametrize(
    "flood",
    [
        RouteChanged(1000.0, ((0.0, 0.0),) * 500),
        GraphRunning(1),
        SettingsRunning(0, {"cues.language": "x" * 5000}),
        DepthImage(1000.0, PICTURE),
        Pong(0.0, 0.0, 0.0),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_flood_is_ended_while_others_are_served_and_memory_stays_bounded(
    room: Room, flood: wire.DeviceMessage
) -> None:
    device, data = room.hostile(), wire.encode(flood)
    deadline_s = time.monotonic() + WAIT_S
    # It may be ended at any of them, the first hundred included.
    with pytest.raises(ConnectionClosed):  # noqa: PT012
        for _ in range(100):
            device.socket.send(data)
        room.serves_on()
        while time.monotonic() < deadline_s:
            device.socket.send(data)
    code, reason = device.close_code()
    assert (code, "more often than" in reason) == (1007, True)
    assert room.server.services.incidents._rings["hostile"].size_bytes <= MAX_RING_BYTES
    room.serves_on()


def test_a_token_does_not_let_in_any_number_of_devices(room: Room) -> None:
    token = room.server.services.devices.create_token("Many", "test")
    for number in range(MAX_DEVICES_OF_TOKEN_COUNT + 5):
        device = DialledDevice(room.url, token, hello_of(room.server, f"many {number}"))
        if number < MAX_DEVICES_OF_TOKEN_COUNT:
            device.next(Welcome)
            device.socket.close()
        else:
            code, reason = device.close_code()
            assert (code, "make one for each" in reason) == (4403, True)
    nameless = DialledDevice(room.url, token, None)
    nameless.socket.send(_raw(hello_of(room.server), device_id=""))
    assert nameless.close_code()[0] == 1007


# ------------------------------------------------------------------------------------------------- hostile browsers
SAID: tuple[bytes | str, ...] = (
    "", "x", "{" * 16_000, "[" * 100_000, '{"type":"clock"}', '{"type":"clock","page_sent_s":1e999}',
    '{"type":"watching","watching":"x"}', '{"type":"nothing"}', b"\x00" * 100, "x" * 1_000_000,
    '{"type":"clock","page_sent_s":1,"page_sent_s":2,"more":3}',
)  # fmt: skip


@pytest.mark.parametrize("path", ["/live?says=1", "/live/overview?says=1", "/live/alerts"])
def test_a_page_that_talks_nonsense_or_too_much_is_left_and_others_are_served(room: Room, path: str) -> None:
    for said in (*SAID, None):
        with room.admin.live(path=path) as page:
            with contextlib.suppress(ConnectionClosed):
                for number in range(1 if said is not None else 3000):
                    page.send(said if said is not None else json.dumps({"type": "clock", "page_sent_s": float(number)}))
            with pytest.raises(ConnectionClosed):  # noqa: PT012
                while True:
                    page.recv(timeout=WAIT_S)
            assert page.protocol.close_rcvd is not None
            assert page.protocol.close_rcvd.code == 1008, said
    room.serves_on()


def test_a_page_that_never_reads_holds_up_nobody_and_little_memory(room: Room) -> None:
    host, port = room.url.removeprefix("http://").split(":")
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.connect((host, int(port)))
    cookies = "; ".join(f"{name}={value}" for name, value in room.admin.http.cookies.items())
    with connect(
        room.url.replace("http", "ws") + "/live", origin=room.url, additional_headers={"Cookie": cookies}, sock=deaf,  # type: ignore[arg-type]
        max_queue=1, proxy=None,
    ):  # fmt: skip
        with room.admin.live() as page:
            for number in range(40):
                large = (WireCandidate(0.1, 3.0, True),) * 1500
                room.good.send(msgspec.structs.replace(STATE, rule=f"{number}", candidates=large))
                heard_until(page, lambda picture, number=number: _rule_of(picture, "good") == f"{number}")
        waiting = [
            each.transport.get_write_buffer_size()
            for each in room.server._uvicorn.server_state.connections
            if each.transport is not None
        ]
        assert max(waiting) < 1 << 20
        room.serves_on()
