"""The messages between device and console: one table, typed, versioned, msgpack on a WebSocket.

The device dials ``/device`` of the console with ``Authorization: Bearer TOKEN`` and sends :class:`Hello`; the console
answers :class:`Welcome`. Each frame of the socket is one message. What cannot be decoded is a WireError and closes the
link, never the guidance.

==================== ========= ======================== ==========================================
message              direction rate                     on a slow link
==================== ========= ======================== ==========================================
Hello / Welcome      ↑ / ↓     once a connection        –
WalkerState          ↑         ≤ 10 Hz                  the newest replaces what is not sent yet
DepthImage           ↑         ≤ 2 Hz                   dropped first
RouteChanged         ↑         on change                kept
Event                ↑         on change                kept until EventConfirmed
SettingsRunning      ↑         on change                kept
GraphRunning         ↑         on change                kept
MapRunning           ↑         on change                kept
Pong                 ↑         as Ping                  –
SetDestination …     ↓         when somebody acts       kept
==================== ========= ======================== ==========================================
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

import msgspec

from navcore.errors import WireError
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph

PROTOCOL_VERSION = 3
"""2: the states of :mod:`navcore.modes`, Repeat, and events of the walker's buttons.
3: a state tells how long the loop's stages take, and what is left out where they take too long.
"""
MAX_MESSAGE_BYTES = 4 << 20

Text = Annotated[str, msgspec.Meta(max_length=500)]
ShortText = Annotated[str, msgspec.Meta(max_length=120)]
Point2 = tuple[float, float]
T = TypeVar("T")
Finite = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]


class _Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type"):
    pass


# ------------------------------------------------------------------------------------------ device → console
class Hello(_Message, frozen=True, tag="hello"):
    """Who calls, and what it runs."""

    protocol_version: int
    device_id: ShortText
    software_version: ShortText
    site_id: ShortText
    map_checksum: ShortText
    graph_version: int
    settings_revision: int
    now_s: Finite
    """The device's clock as it sends this."""


class WireCandidate(msgspec.Struct, frozen=True, array_like=True):
    """One candidate direction."""

    angle_rad: float
    clearance_m: float


class StageSummary(msgspec.Struct, frozen=True, array_like=True):
    """How long a stage of the loop takes: percentiles of the newest cycles; the longest and the late of all."""

    stage: ShortText
    """capture (age when it is taken), localize, guide, cue, hand_off, or capture_to_cue (the whole)."""
    p50_ms: float
    p99_ms: float
    max_ms: float
    missed_count: int
    """Cycles in which it was later than its deadline."""


class WalkerState(_Message, frozen=True, tag="state"):
    """Where the walker is and what guidance decided, after one cycle."""

    stamp_s: Finite
    """Capture time of the frame that the decision was made from, on the device's clock."""
    quality: Literal["localized", "uncertain", "lost"]
    action: Literal["walk", "turn", "stop"]
    reason: ShortText
    """A navcore.types.Reason value."""
    rule: Text = ""
    pose: tuple[float, float, float, float] | None = None
    """x, y, eye height (m) and heading (rad) in the world; None when lost."""
    position_std_m: float | None = None
    inlier_count: int = 0
    direction_rad: float | None = None
    """θ_walk, relative to the heading."""
    expected_rad: float | None = None
    """θ_exp, in the world."""
    sub_goal: Point2 | None = None
    sub_goal_case: Literal[1, 2, 3] | None = None
    candidates: tuple[WireCandidate, ...] = ()
    deviation_m: float | None = None
    remaining_m: float | None = None
    nearest_ahead_m: float | None = None
    sonar_state: Literal["ok", "no_echo", "stale", "absent"] = "absent"
    sonar_m: float | None = None
    speed_m_s: float | None = None
    last_cue: Text = ""
    last_cue_stamp_s: float | None = None
    cycle_ms: float = 0.0
    frame_rate_hz: float = 0.0
    mode: Mode = Mode.LOCALIZING
    destination_id: ShortText | None = None
    load_level: Literal["full", "fewer_features", "half_rate"] = "full"
    """What is left out because the device is too slow."""
    stages: Annotated[tuple[StageSummary, ...], msgspec.Meta(max_length=16)] = ()


class DepthImage(_Message, frozen=True, tag="depth_image"):
    """The depth camera's view as a silhouette (JPEG): no colours of people or places."""

    stamp_s: Finite
    jpeg: Annotated[bytes, msgspec.Meta(max_length=200_000)]


class RouteChanged(_Message, frozen=True, tag="route"):
    """The planned route, or an empty one."""

    stamp_s: Finite
    points_m: tuple[Point2, ...] = ()
    stops: tuple[tuple[ShortText, float], ...] = ()
    """Names of the PoIs on the way, with their distance from the start."""
    destination_id: ShortText | None = None
    refusal: Text = ""
    """Why there is no route, where one was asked for."""


class Event(_Message, frozen=True, tag="event"):
    """Something that must not be lost: kept on the device until confirmed."""

    sequence: int
    stamp_s: Finite
    kind: Literal["cue", "arrived", "route_refused", "localization", "sensor", "link", "mode", "watchdog", "button"]
    text: Text


class SettingsRunning(_Message, frozen=True, tag="settings_running"):
    """The settings that the device runs; the answer to ApplySettings."""

    revision: int
    values: dict[str, float | int | bool | str]
    refused_revision: int | None = None
    refusal: Text = ""


class GraphRunning(_Message, frozen=True, tag="graph_running"):
    """The PoI-graph that the device runs; the answer to PublishGraph."""

    version: int
    refusal: Text = ""


class MapRunning(_Message, frozen=True, tag="map_running"):
    """The map that the device runs; the answer to MapAvailable."""

    map_checksum: ShortText
    refusal: Text = ""


class Pong(_Message, frozen=True, tag="pong"):
    """Answer to Ping: both clocks, for the offset between them."""

    console_now_s: Finite
    device_now_s: Finite


# ------------------------------------------------------------------------------------------ console → device
class Welcome(_Message, frozen=True, tag="welcome"):
    """The console takes the device in."""

    protocol_version: int
    last_event_sequence: int
    """The last event of this device that the console has stored."""


class SetDestination(_Message, frozen=True, tag="set_destination"):
    """Lead the walker to a PoI."""

    poi_id: ShortText


class ClearDestination(_Message, frozen=True, tag="clear_destination"):
    """Stop leading."""


class Pause(_Message, frozen=True, tag="pause"):
    """Hold guidance: the walker stands."""


class Resume(_Message, frozen=True, tag="resume"):
    """Go on after a pause."""


class Repeat(_Message, frozen=True, tag="repeat"):
    """Say the last sentence again."""


class Say(_Message, frozen=True, tag="say"):
    """Speak a sentence to the walker."""

    text: Text


class ApplySettings(_Message, frozen=True, tag="apply_settings"):
    """Run these settings: all of them or, where one is refused, none."""

    revision: int
    values: dict[str, float | int | bool | str]


class PublishGraph(_Message, frozen=True, tag="publish_graph"):
    """Run this PoI-graph; taken at once when nobody is being led, else at the next stop."""

    graph: PoiGraph


class MapAvailable(_Message, frozen=True, tag="map_available"):
    """A map to fetch (GET ``path`` of the console, with the device's token); swapped only between walks."""

    path: ShortText
    map_checksum: ShortText
    size_bytes: int


class EventConfirmed(_Message, frozen=True, tag="event_confirmed"):
    """Events up to this one are stored."""

    sequence: int


class Ping(_Message, frozen=True, tag="ping"):
    """Asks for the device's clock."""

    console_now_s: Finite


DeviceMessage = (
    Hello | WalkerState | DepthImage | RouteChanged | Event | SettingsRunning | GraphRunning | MapRunning | Pong
)
ConsoleMessage = (
    Welcome | SetDestination | ClearDestination | Pause | Resume | Repeat | Say | ApplySettings | PublishGraph
    | MapAvailable | EventConfirmed | Ping
)  # fmt: skip

_encoder = msgspec.msgpack.Encoder()
_device_decoder: msgspec.msgpack.Decoder[DeviceMessage] = msgspec.msgpack.Decoder(DeviceMessage)
_console_decoder: msgspec.msgpack.Decoder[ConsoleMessage] = msgspec.msgpack.Decoder(ConsoleMessage)


def encode(message: DeviceMessage | ConsoleMessage) -> bytes:
    """Return the message as one WebSocket frame."""
    return _encoder.encode(message)


def decode_from_device(data: bytes) -> DeviceMessage:
    """Read a message that a device sent. Raises WireError."""
    return _checked(data, _device_decoder)


def decode_from_console(data: bytes) -> ConsoleMessage:
    """Read a message that the console sent. Raises WireError."""
    return _checked(data, _console_decoder)


def _checked(data: bytes, decoder: msgspec.msgpack.Decoder[T]) -> T:
    if len(data) > MAX_MESSAGE_BYTES:
        raise WireError(
            f"A message of {len(data)} bytes is larger than the {MAX_MESSAGE_BYTES} that are taken: send less."
        )
    try:
        return decoder.decode(data)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise WireError(
            f"A message cannot be read ({error}): use the same version of the program on both sides."
        ) from error
