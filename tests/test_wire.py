"""The wire: every message comes back as it was sent, and nothing else is taken."""

import contextlib

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from message_strategies import messages

from navcore import wire
from navcore.errors import VersionError, WireError
from navcore.modes import Mode
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.wire_pace import BURST_S, Allowance, Pace
from navcore.wire_page import link_markdown
from navcore.wire_row import Direction
from navcore.wire_trace import DecisionLimits, DecisionTraceView, WireCandidate, WireCorner, WireScan

UP: list[wire.DeviceMessage] = [
    wire.Hello(wire.PROTOCOL_VERSION, "glasses-1", "0.1.0", "site", "abc", 3, 0, 12.5),
    wire.WalkerState(1.0, "lost", "stop", "pose_lost"),
    wire.WalkerState(
        2.0, "localized", "walk", "ok", "Eq. 4",
        (1.0, 2.0, 1.6, 0.3), 0.02, 80, 0.1, 0.4, (3.0, 2.0), 1,
        (WireCandidate(0.1, 3.0, True),), 0.2, 5.0, None, "ok", 3.2, 0.8,
        "Move forward.", 1.9, 8.0, 10.0, Mode.GUIDING, "bar",
        trace=DecisionTraceView(
            "to_expected", "along", 0.1, 3.0, 0.2, -0.3, 1, 2.0, 3.0, None, 0.5, WireCorner(2.0, -1.5, 0.4),
            True, 0.01, 0.9,
            DecisionLimits(0.8, 2.0, 3.0, 0.7, 0.13, 1.0, 0.5, 0.7, 0.17, 1.0, 3.0, 0.3, 3),
            WireScan(-0.6, 0.017, (0, 1, 2, 3, 4), (0, 123, 250, 0, 140), ((-90, 80),)),
        ),
        eye_m=1.6, tilt_rad=0.2, battery_percent=80.0, is_charging=False, temperature_c=51.5,
    ),
    wire.DepthImage(2.0, b"\xff\xd8"),
    wire.RouteChanged(2.0, ((0.0, 0.0), (0.1, 0.0)), (("Bar", 0.1),), "bar"),
    wire.Event(5, 2.0, "cue", "Move forward."),
    wire.SettingsRunning(4, {"gate.clearance_m": 2.0, "cues.language": "en"}),
    wire.GraphRunning(3),
    wire.MapRunning("abc"),
    wire.MapWalkRunning(False, "Somebody is being led."),
    wire.MapWalkSeen(2.0, 10.0, 100, 2, 80, 1, 0.5, ("weak",), "weak", 1.5),
    wire.Pong(1.0, 2.0, 2.1),
    wire.ColourImage(2.0, b"\xff\xd8"),
    wire.SharingRunning(True, False, ("Anna",), "Anna", 62.0, 7, "The walker does not want it."),
]  # fmt: skip
DOWN: list[wire.ConsoleMessage] = [
    wire.Watchers(("Anna", "Ben")),
    wire.AskColour(7, "Anna", "to see the door"),
    wire.Accesses((wire.Access("Anna", "watch", 1.7e9, 1.7e9 + 60.0, 1.6e9),), 1.7e9, 3600.0),
    wire.Welcome(wire.PROTOCOL_VERSION, 5),
    wire.SetDestination("bar"),
    wire.ClearDestination(),
    wire.Pause(),
    wire.Resume(),
    wire.BeginMapWalk(),
    wire.EndMapWalk(),
    wire.Repeat(),
    wire.Say("Hello."),
    wire.ApplySettings(4, {"gate.clearance_m": 2.0}),
    wire.KeepSettings(4, keep=False),
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


@pytest.mark.parametrize("kind", wire.MESSAGES, ids=lambda kind: kind.__name__)
@given(data=st.data())
@settings(max_examples=30, suppress_health_check=[HealthCheck.too_slow])
def test_any_message_comes_back_as_it_was_sent_and_from_its_own_side_alone(
    kind: type[msgspec.Struct], data: st.DataObject
) -> None:
    message = data.draw(messages(kind))
    sent = wire.encode(message)
    row = wire.MESSAGES[kind]
    mine, other = wire.decode_from_device, wire.decode_from_console
    if row.direction is Direction.DOWN:
        mine, other = other, mine
    assert mine(sent) == message
    assert len(sent) <= row.max_bytes
    with pytest.raises(WireError):
        other(sent)


@pytest.mark.parametrize("kind", wire.MESSAGES, ids=lambda kind: kind.__name__)
@given(data=st.data())
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_damaged_message_is_a_message_or_a_wire_error(kind: type[msgspec.Struct], data: st.DataObject) -> None:
    sent = bytearray(wire.encode(data.draw(messages(kind))))
    for _ in range(data.draw(st.integers(1, 4))):
        sent[data.draw(st.integers(0, len(sent) - 1))] = data.draw(st.integers(0, 255))
    damaged = bytes(sent[: data.draw(st.integers(0, len(sent)))])
    for decode in (wire.decode_from_device, wire.decode_from_console, wire.decode_hello, wire.decode_welcome):
        with contextlib.suppress(WireError):
            assert type(decode(damaged)) in wire.MESSAGES


def test_the_table_says_everything_of_every_message() -> None:
    for row in wire.MESSAGES.values():
        assert wire.MESSAGES[row.message] is row
        assert 1 <= row.since_version <= wire.PROTOCOL_VERSION
        assert 0 < row.max_bytes <= wire.MAX_MESSAGE_BYTES
        assert row.meaning.endswith(".")
        assert f"| `{row.name}` | {row.since_version} |" in link_markdown()
    up = {row.message for row in wire.MESSAGES.values() if row.direction is Direction.UP}
    assert up == set(wire.DeviceMessage.__args__)
    assert set(wire.MESSAGES) - up == set(wire.ConsoleMessage.__args__)


def test_of_what_goes_up_greetings_go_first_then_what_is_kept_then_pictures() -> None:
    first = min(wire.MESSAGES.values(), key=lambda row: row.priority).message
    priority = {kind: row.priority for kind, row in wire.MESSAGES.items()}
    assert first in (wire.Hello, wire.Welcome)
    assert priority[wire.RouteChanged] < priority[wire.Event] < priority[wire.WalkerState] < priority[wire.DepthImage]
    assert priority[wire.Pause] < priority[wire.ApplySettings] < priority[wire.PublishGraph]


def test_what_is_larger_than_its_row_allows_is_neither_sent_nor_taken() -> None:
    row = wire.MESSAGES[wire.SettingsRunning]
    large = wire.SettingsRunning(1, {"cues.language": "x" * row.max_bytes})
    data = msgspec.msgpack.encode(large)
    sentence = f"SettingsRunning of {len(data)} bytes is larger than the {row.max_bytes} that are taken"
    with pytest.raises(WireError, match=sentence):
        wire.encode(large)
    with pytest.raises(WireError, match=sentence):
        wire.decode_from_device(data)


@pytest.mark.parametrize(
    ("greeting", "sentence"),
    [
        ({"type": "hello", "protocol_version": 1, "of": "old"}, "this device 1: update the device"),
        ({"type": "hello", "protocol_version": 99, "more": [1]}, "this device 99: update the console"),
        ({"type": "welcome", "protocol_version": 1}, "console speaks protocol 1, this device .: update the console"),
        ({"type": "welcome", "protocol_version": 99}, "console speaks protocol 99, this device .: update the device"),
    ],
)
def test_another_version_is_told_from_a_greeting_of_any_form(greeting: dict[str, object], sentence: str) -> None:
    decode = wire.decode_hello if greeting["type"] == "hello" else wire.decode_welcome
    with pytest.raises(VersionError, match=sentence):
        decode(msgspec.msgpack.encode(greeting))


def test_a_greeting_that_is_none_is_refused() -> None:
    with pytest.raises(WireError, match="did not begin with a hello"):
        wire.decode_hello(wire.encode(wire.GraphRunning(1)))
    with pytest.raises(WireError, match="did not begin with a welcome"):
        wire.decode_welcome(wire.encode(wire.Pause()))


@given(st.floats(0.1, 50.0), st.lists(st.floats(0.0, 5.0), min_size=1, max_size=200))
def test_whoever_keeps_to_the_rate_is_never_refused_however_the_network_jams(
    rate_hz: float, jams_s: list[float]
) -> None:
    pace, allowance = Pace(rate_hz), Allowance(rate_hz, 0.0)
    sent_s = came_s = 0.0
    for jam_s in jams_s:
        sent_s += max(0.0, pace.wait_s(sent_s))
        pace.went(sent_s)
        # Nothing overtakes what was sent before, and nothing takes longer than pings allow.
        came_s = max(came_s, sent_s + jam_s)
        assert allowance.take(came_s)


@given(st.floats(0.5, 50.0), st.floats(1.5, 10.0))
def test_whoever_sends_more_is_found_out(rate_hz: float, times: float) -> None:
    allowance = Allowance(rate_hz, 0.0)
    count = int(4 * BURST_S * rate_hz * times / (times - 1.0)) + 2
    assert not all(allowance.take(number / (times * rate_hz)) for number in range(count))


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
