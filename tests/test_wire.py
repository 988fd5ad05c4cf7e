"""The wire: every message comes back as it was sent, and nothing else is taken."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navcore import wire
from navcore.errors import WireError
from navcore.modes import Mode
from navcore.planning.poi_graph import Poi, PoiGraph

UP: list[wire.DeviceMessage] = [
    wire.Hello(wire.PROTOCOL_VERSION, "glasses-1", "0.1.0", "site", "abc", 3, 0, 12.5),
    wire.WalkerState(1.0, "lost", "stop", "pose_lost"),
    wire.WalkerState(
        2.0, "localized", "walk", "ok", "Eq. 4",
        (1.0, 2.0, 1.6, 0.3), 0.02, 80, 0.1, 0.4, (3.0, 2.0), 1,
        (wire.WireCandidate(0.1, 3.0),), 0.2, 5.0, None, "ok", 3.2, 0.8,
        "Move forward.", 1.9, 8.0, 10.0, Mode.GUIDING, "bar",
    ),
    wire.DepthImage(2.0, b"\xff\xd8"),
    wire.RouteChanged(2.0, ((0.0, 0.0), (0.1, 0.0)), (("Bar", 0.1),), "bar"),
    wire.Event(5, 2.0, "cue", "Move forward."),
    wire.SettingsRunning(4, {"gate.clearance_m": 2.0, "cues.language": "en"}),
    wire.GraphRunning(3),
    wire.MapRunning("abc"),
    wire.Pong(1.0, 2.0, 2.1),
]  # fmt: skip
DOWN: list[wire.ConsoleMessage] = [
    wire.Welcome(wire.PROTOCOL_VERSION, 5),
    wire.SetDestination("bar"),
    wire.ClearDestination(),
    wire.Pause(),
    wire.Resume(),
    wire.Repeat(),
    wire.Say("Hello."),
    wire.ApplySettings(4, {"gate.clearance_m": 2.0}),
    wire.PublishGraph(PoiGraph(1, {"a": Poi("a", "A", "room", 0.0, 0.0)})),
    wire.MapAvailable("/api/device/map", "abc", 10, "0" * 64),
    wire.EventConfirmed(5),
    wire.Ping(1.0),
]


def test_the_samples_cover_every_message() -> None:
    assert {type(message) for message in UP} == set(wire.DeviceMessage.__args__)
    assert {type(message) for message in DOWN} == set(wire.ConsoleMessage.__args__)


@pytest.mark.parametrize("message", UP, ids=lambda m: type(m).__name__)
def test_a_device_message_comes_back(message: wire.DeviceMessage) -> None:
    assert wire.decode_from_device(wire.encode(message)) == message


@pytest.mark.parametrize("message", DOWN, ids=lambda m: type(m).__name__)
def test_a_console_message_comes_back(message: wire.ConsoleMessage) -> None:
    assert wire.decode_from_console(wire.encode(message)) == message


@pytest.mark.parametrize("message", DOWN, ids=lambda m: type(m).__name__)
def test_a_device_cannot_send_what_only_the_console_may(message: wire.ConsoleMessage) -> None:
    with pytest.raises(WireError):
        wire.decode_from_device(wire.encode(message))


@given(st.binary(max_size=200))
def test_garbage_is_a_wire_error(data: bytes) -> None:
    for decode in (wire.decode_from_device, wire.decode_from_console):
        with pytest.raises(WireError):
            decode(data)


@pytest.mark.parametrize(
    "data",
    [
        {"type": "say", "text": "x" * 501},
        {"type": "set_destination", "poi_id": 5},
        {"type": "set_destination", "poi_id": "bar", "extra": 1},
        {"type": "ping", "console_sent_s": float("nan")},
        {
            "type": "publish_graph",
            "graph": {"pois": {"a": {"id": "../a", "name": "A", "kind": "room", "x_m": 0.0, "y_m": 0.0}}},
        },
    ],
)
def test_what_does_not_fit_the_table_is_refused(data: dict[str, object]) -> None:
    with pytest.raises(WireError, match="cannot be read"):
        wire.decode_from_console(msgspec.msgpack.encode(data))


def test_an_oversized_message_is_refused_unread() -> None:
    with pytest.raises(WireError, match="larger than"):
        wire.decode_from_device(bytes(wire.MAX_MESSAGE_BYTES + 1))
