"""The messages between device and console: typed, versioned, msgpack on a WebSocket; :data:`MESSAGES` is the table.

The device dials ``/device`` of the console with ``Authorization: Bearer TOKEN`` and sends :class:`Hello`; the console
answers :class:`Welcome`. Each frame of the socket is one message. What cannot be decoded is a WireError and closes the
link, never the guidance. Rate, priority, size limit and fate on a slow link are taken from the table by both ends; the
page of the docs (link.md) is made from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Literal, TypeVar, cast

import msgspec

from navcore.errors import VersionError, WireError
from navcore.misfit import words_of
from navcore.modes import Mode, is_led
from navcore.planning.poi_graph import PoiGraph
from navcore.wire_row import Delivery, Direction, MessageRow
from navcore.wire_trace import DecisionTraceView, Finite, WireCandidate

PROTOCOL_VERSION = 6
"""2: the states of :mod:`navcore.modes`, Repeat, and events of the walker's buttons.
3: both clocks are read twice for a ping, their offset is told; a map's package has a checksum, one that waits is told;
a state tells how long the loop's stages take, and what is left out where they take too long.
4: map walks are begun and ended from the console, and what is seen of the building is told.
6: the whole decision trace, battery and temperature; who watches, what is shared, colour on request.
"""
PING_EVERY_S = 2.0
"""How often the console asks for the device's clock, once it has been told it a few times."""
ORDER_HOLDS_S = 10.0
"""What somebody asks for is carried out within this time or not at all: a device that was away may be elsewhere."""
MAX_MESSAGE_BYTES = 4 << 20
"""No message is larger; most may be much less (see the table)."""

Text = Annotated[str, msgspec.Meta(max_length=500)]
ShortText = Annotated[str, msgspec.Meta(max_length=120)]
Point2 = tuple[Finite, Finite]
T = TypeVar("T")
Count = Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
"""As far as every database and language in use counts exactly."""
MAX_NAMES_COUNT = 20
Names = Annotated[tuple[ShortText, ...], msgspec.Meta(max_length=MAX_NAMES_COUNT)]
MAX_ACCESSES_COUNT = 40
Whole = Annotated[int, msgspec.Meta(ge=-(1 << 53), le=1 << 53)]
Values = dict[ShortText, Finite | Whole | bool | str]
"""Settings by their keys."""


class _Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type"):
    pass


# ------------------------------------------------------------------------------------------ device → console
class Hello(_Message, frozen=True, tag="hello"):
    """Who calls, and what it runs."""

    protocol_version: int
    device_id: Annotated[str, msgspec.Meta(min_length=1, max_length=120)]
    software_version: ShortText
    site_id: ShortText
    map_checksum: ShortText
    graph_version: Count
    settings_revision: Count
    now_s: Finite
    """The device's clock as it sends this."""


class StageSummary(msgspec.Struct, frozen=True, array_like=True):
    """How long a stage of the loop takes: percentiles of the newest cycles; the longest and the late of all."""

    stage: ShortText
    """capture (age when it is taken), localize, guide, cue, hand_off, or capture_to_cue (the whole)."""
    p50_ms: Finite
    p99_ms: Finite
    max_ms: Finite
    missed_count: Count
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
    pose: tuple[Finite, Finite, Finite, Finite] | None = None
    """x, y, eye height (m) and heading (rad) in the world; None when lost."""
    position_std_m: Finite | None = None
    inlier_count: Count = 0
    direction_rad: Finite | None = None
    """θ_walk, relative to the heading."""
    expected_rad: Finite | None = None
    """θ_exp, in the world."""
    sub_goal: Point2 | None = None
    sub_goal_case: Literal[1, 2, 3] | None = None
    candidates: tuple[WireCandidate, ...] = ()
    deviation_m: Finite | None = None
    remaining_m: Finite | None = None
    nearest_ahead_m: Finite | None = None
    sonar_state: Literal["ok", "no_echo", "stale", "absent"] = "absent"
    sonar_m: Finite | None = None
    speed_m_s: Finite | None = None
    last_cue: Text = ""
    last_cue_stamp_s: Finite | None = None
    cycle_ms: Finite = 0.0
    frame_rate_hz: Finite = 0.0
    mode: Mode = Mode.LOCALIZING
    destination_id: ShortText | None = None
    destination_by: ShortText = ""
    """Who at the console chose the destination; empty where nobody did but the walker."""
    load_level: Literal["full", "fewer_features", "half_rate"] = "full"
    """What is left out because the device is too slow."""
    stages: Annotated[tuple[StageSummary, ...], msgspec.Meta(max_length=16)] = ()
    trace: DecisionTraceView | None = None
    """How the decision came about; None in recordings that are older than this field."""
    eye_m: Finite | None = None
    """Height of the camera above the floor, as the depth image shows it; None where no floor is found."""
    tilt_rad: Finite | None = None
    """Angle between the picture's up and up, by gravity, else by the depth image; None where neither tells."""
    battery_percent: Finite | None = None
    """None for a device without a battery, or one that does not tell."""
    is_charging: bool | None = None
    temperature_c: Finite | None = None
    """Of the hottest part that the device measures; None where it measures none."""

    @property
    def leads_somebody(self) -> bool:
        """Whether somebody is being led, though they may stand just now."""
        return is_led(self.mode, has_destination=self.destination_id is not None)


class DepthImage(_Message, frozen=True, tag="depth_image"):
    """The depth camera's view as a silhouette (JPEG): no colours of people or places."""

    stamp_s: Finite
    jpeg: Annotated[bytes, msgspec.Meta(max_length=200_000)]


class ColourImage(_Message, frozen=True, tag="colour_image"):
    """What the camera sees, in colour (JPEG): only while the walker allows it, and nobody keeps it."""

    stamp_s: Finite
    jpeg: Annotated[bytes, msgspec.Meta(max_length=100_000)]


class SharingRunning(_Message, frozen=True, tag="sharing_running"):
    """What the walker lets be seen, and of whom they have heard that they watch; also the answer to AskColour."""

    silhouettes: bool
    """Depth images may go to the console."""
    walks: bool
    """Recordings of walks may go to the console."""
    told: Names = ()
    """Of whom the walker has heard that they watch, and not yet that they have gone."""
    colour_for: ShortText = ""
    """Who may see colour pictures now; nobody where it is empty."""
    colour_until_s: Finite | None = None
    """Until when, on the device's clock."""
    answered_id: Count = 0
    """The request for colour that was answered last."""
    refusal: Text = ""
    """Why that request is not granted; empty where it is, or was."""
    colour_ended: Text = ""
    """Why nobody sees colour pictures any more; empty while somebody does, and before anybody has."""


class RouteChanged(_Message, frozen=True, tag="route"):
    """The planned route, or an empty one."""

    stamp_s: Finite
    points_m: tuple[Point2, ...] = ()
    stops: tuple[tuple[ShortText, Finite], ...] = ()
    """Names of the PoIs on the way, with their distance from the start."""
    destination_id: ShortText | None = None
    refusal: Text = ""
    """Why there is no route, where one was asked for."""


GUIDANCE_IS_FRESH = "Guidance is fresh again."
"""What the watchdog's event says that ends the incident which its event before began."""


class Event(_Message, frozen=True, tag="event"):
    """Something that must not be lost: kept on the device until confirmed."""

    sequence: Count
    stamp_s: Finite
    kind: Literal[
        "cue", "arrived", "route_refused", "localization", "sensor", "link", "mode", "watchdog", "button", "privacy"
    ]
    text: Text


class SettingsRunning(_Message, frozen=True, tag="settings_running"):
    """The settings that the device runs; the answer to ApplySettings and KeepSettings."""

    revision: Count
    values: Values
    refused_revision: Count | None = None
    """A revision that was asked for and does not run: it was refused, or tried out and not kept."""
    refusal: Text = ""
    revert_at_s: Finite | None = None
    """When the settings before run again, on the device's clock; None where these have been kept."""


class GraphRunning(_Message, frozen=True, tag="graph_running"):
    """The PoI-graph that the device runs; the answer to PublishGraph."""

    version: Count
    refusal: Text = ""


class MapRunning(_Message, frozen=True, tag="map_running"):
    """The map that the device runs; the answer to MapAvailable."""

    map_checksum: ShortText
    refusal: Text = ""
    waiting_checksum: ShortText = ""
    """A newer map that is here and checked, and is taken as soon as nobody is being led; empty where none waits."""


class MapWalkRunning(_Message, frozen=True, tag="map_walk_running"):
    """Whether a map walk is being recorded; also the answer to BeginMapWalk and EndMapWalk."""

    is_running: bool
    refusal: Text = ""
    """Why what was asked for is not done."""


class MapWalkSeen(_Message, frozen=True, tag="map_walk_seen"):
    """How well the building is seen in the map walk that is being recorded."""

    stamp_s: Finite
    """Capture time of the frame that was looked at last, on the device's clock."""
    recorded_s: Finite
    frame_count: Count
    place_count: Count
    """Places that were marked."""
    landmark_count: Count
    """Landmarks that agree with the pose of that frame."""
    loop_count: Count
    weak_s: Finite
    """How long, in all, the building was not seen well enough."""
    troubles: Annotated[tuple[ShortText, ...], msgspec.Meta(max_length=16)] = ()
    """What is wrong just now: values of navcore.coverage.Advice."""
    last_advice: ShortText = ""
    """What was said last, such a value."""
    last_advice_stamp_s: Finite | None = None


class Pong(_Message, frozen=True, tag="pong"):
    """Answer to Ping: when it left and came, and when this leaves, for the offset between the clocks."""

    console_sent_s: Finite
    """As the Ping told it, on the console's clock."""
    device_received_s: Finite
    """When the Ping came, on the device's clock."""
    device_sent_s: Finite
    """When this goes, on the device's clock."""


# ------------------------------------------------------------------------------------------ console → device
class Welcome(_Message, frozen=True, tag="welcome"):
    """The console takes the device in."""

    protocol_version: int
    last_event_sequence: Count
    """The last event of this device that the console has stored."""


class Order(_Message, frozen=True, kw_only=True):
    """Something that a person asks for now, and that is not to happen when nobody expects it any more."""

    order_id: Count = 0
    """Names this order, where the device says that it came too late."""
    expires_s: Finite | None = None
    """When it is no longer carried out, on the device's clock; None where the clocks have not been compared."""


class SetDestination(Order, frozen=True, tag="set_destination"):
    """Lead the walker to a PoI."""

    poi_id: ShortText
    who: ShortText = ""
    """Who asks for it: the walker hears the name."""


class ClearDestination(Order, frozen=True, tag="clear_destination"):
    """Stop leading."""


class Pause(Order, frozen=True, tag="pause"):
    """Hold guidance: the walker stands."""


class Resume(Order, frozen=True, tag="resume"):
    """Go on after a pause."""


class BeginMapWalk(Order, frozen=True, tag="begin_map_walk"):
    """Record a map walk, where nobody is led; a sighted person wears the glasses."""


class EndMapWalk(Order, frozen=True, tag="end_map_walk"):
    """End the map walk; its recording is completed."""


class Repeat(Order, frozen=True, tag="repeat"):
    """Say the last sentence again."""


class Say(Order, frozen=True, tag="say"):
    """Speak a sentence to the walker."""

    text: Text


class Watchers(_Message, frozen=True, tag="watchers"):
    """Who watches the walker now."""

    names: Names


class AskColour(Order, frozen=True, tag="ask_colour"):
    """Ask the walker to let somebody see colour pictures for a minute."""

    request_id: Count
    """Names this request in the answer."""
    who: ShortText
    why: ShortText = ""


class Access(msgspec.Struct, frozen=True, array_like=True):
    """That somebody has watched the walker, or looked at what is kept of them."""

    who: ShortText
    what: Literal["watch", "past_walk", "incident", "colour", "export"]
    began_s: Finite
    """Unix time."""
    ended_s: Finite
    """Unix time; the same as ``began_s`` for what has no length."""
    about_s: Finite | None = None
    """When that walk or incident was (Unix time), where it is known."""


class Accesses(_Message, frozen=True, tag="accesses"):
    """Who has watched this walker, and who has looked at what is kept of them: the latest, oldest first."""

    entries: Annotated[tuple[Access, ...], msgspec.Meta(max_length=MAX_ACCESSES_COUNT)]
    now_s: Finite
    """The time of day as this is sent (Unix time)."""
    utc_offset_s: Finite = 0.0
    """What the clocks on the wall show more than UTC."""


class ApplySettings(_Message, frozen=True, tag="apply_settings"):
    """Change these settings: all of them or, where one is refused, none; the others stay as they are."""

    revision: Count
    values: Values
    """Those that change."""
    revert_after_s: Annotated[float, msgspec.Meta(ge=0.0, le=3600.0)] = 0.0
    """The settings before run again after this time unless these are kept; 0: these are kept at once, but what safety
    hangs on is tried out all the same, for as long as the device has it tried out by itself."""
    override_reason: Text = ""
    """Why what safety hangs on is changed though somebody is being led; empty: then it is refused."""
    base_revision: Count | None = None
    """They are changes of this revision, and refused where another one runs by now; None: of whatever runs."""
    kept_before: bool = False
    """The device ran these and somebody kept them, but it has lost them: they are not tried out again."""


class KeepSettings(_Message, frozen=True, tag="keep_settings"):
    """Keep the settings that are tried out, or give them up at once."""

    revision: Count
    keep: bool = True


class PublishGraph(_Message, frozen=True, tag="publish_graph"):
    """Run this PoI-graph; taken at once when nobody is being led, else at the next stop."""

    graph: PoiGraph


class MapAvailable(_Message, frozen=True, tag="map_available"):
    """A map to fetch (GET ``path`` of the console, with the device's token); swapped only between walks."""

    path: ShortText
    map_checksum: ShortText
    size_bytes: Count
    package_sha256: Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]
    """Of the package as it is fetched; it also names the package, so that a download can go on later."""


class EventConfirmed(_Message, frozen=True, tag="event_confirmed"):
    """Events up to this one are stored."""

    sequence: Count


class Ping(_Message, frozen=True, tag="ping"):
    """Asks for the device's clock, and tells what is known of it so far."""

    console_sent_s: Finite
    offset_s: Finite | None = None
    """Device clock minus console clock; None before it has been measured."""
    uncertainty_s: Finite | None = None
    """The true offset is no farther than this from ``offset_s``."""


DeviceMessage = (
    Hello | WalkerState | DepthImage | RouteChanged | Event | SettingsRunning | GraphRunning | MapRunning
    | ColourImage | SharingRunning | MapWalkRunning | MapWalkSeen | Pong
)  # fmt: skip
ConsoleMessage = (
    Welcome | SetDestination | ClearDestination | Pause | Resume | Repeat | Say | ApplySettings | PublishGraph
    | MapAvailable | BeginMapWalk | EndMapWalk | Watchers | AskColour | Accesses | EventConfirmed | Ping | KeepSettings
)  # fmt: skip

STOPS_HZ = 20.0
"""What stops a walker may come from many persons at once, each of whom keeps to what other orders may."""
_UP, _DOWN = Direction.UP, Direction.DOWN
_KIB = 1 << 10
_ROWS = (
    # message, direction, since, sent, at most (Hz), priority, on a slow link, at most (bytes)
    MessageRow(Hello, _UP, 1, "once a connection", None, 0, Delivery.GREETING, 4 * _KIB),
    MessageRow(Pong, _UP, 3, "at each Ping", 5.0, 1, Delivery.ANSWER, 1 * _KIB),
    MessageRow(SettingsRunning, _UP, 1, "on change", 10.0, 2, Delivery.KEPT, 64 * _KIB),
    MessageRow(GraphRunning, _UP, 1, "on change", 10.0, 2, Delivery.KEPT, 4 * _KIB),
    MessageRow(MapRunning, _UP, 3, "on change", 10.0, 2, Delivery.KEPT, 4 * _KIB),
    MessageRow(MapWalkRunning, _UP, 4, "on change", 10.0, 2, Delivery.KEPT, 4 * _KIB),
    MessageRow(SharingRunning, _UP, 6, "on change", 10.0, 2, Delivery.KEPT, 8 * _KIB),
    MessageRow(RouteChanged, _UP, 1, "on change", 10.0, 2, Delivery.KEPT, 2048 * _KIB),
    MessageRow(Event, _UP, 6, "when it happens", None, 3, Delivery.CONFIRMED, 4 * _KIB),
    MessageRow(WalkerState, _UP, 6, "after each cycle", 20.0, 4, Delivery.NEWEST, 64 * _KIB),
    MessageRow(MapWalkSeen, _UP, 4, "in a map walk", 2.0, 4, Delivery.NEWEST, 4 * _KIB),
    MessageRow(DepthImage, _UP, 1, "after each cycle", 2.0, 5, Delivery.SPARE, 256 * _KIB),
    MessageRow(ColourImage, _UP, 6, "while it is allowed", 1.0, 6, Delivery.SPARE, 128 * _KIB),
    MessageRow(Welcome, _DOWN, 1, "once a connection", None, 0, Delivery.GREETING, 1 * _KIB),
    MessageRow(Ping, _DOWN, 3, f"every {PING_EVERY_S:g} s", 5.0, 1, Delivery.ANSWER, 1 * _KIB),
    MessageRow(EventConfirmed, _DOWN, 1, "when it is stored", None, 1, Delivery.ANSWER, 1 * _KIB),
    MessageRow(SetDestination, _DOWN, 6, "when somebody acts", 2.0, 2, Delivery.ORDER, 4 * _KIB),
    MessageRow(ClearDestination, _DOWN, 6, "when somebody acts", STOPS_HZ, 2, Delivery.ORDER, 1 * _KIB),
    MessageRow(Pause, _DOWN, 6, "when somebody acts", STOPS_HZ, 2, Delivery.ORDER, 1 * _KIB),
    MessageRow(Resume, _DOWN, 6, "when somebody acts", 2.0, 2, Delivery.ORDER, 1 * _KIB),
    MessageRow(Repeat, _DOWN, 6, "when somebody acts", 2.0, 2, Delivery.ORDER, 1 * _KIB),
    MessageRow(BeginMapWalk, _DOWN, 6, "when somebody acts", 2.0, 2, Delivery.ORDER, 1 * _KIB),
    MessageRow(EndMapWalk, _DOWN, 6, "when somebody acts", 2.0, 2, Delivery.ORDER, 1 * _KIB),
    MessageRow(Say, _DOWN, 6, "when somebody acts", 2.0, 2, Delivery.ORDER, 4 * _KIB),
    MessageRow(AskColour, _DOWN, 6, "when somebody acts", 2.0, 2, Delivery.ORDER, 4 * _KIB),
    MessageRow(Watchers, _DOWN, 6, "on change", None, 2, Delivery.KEPT, 16 * _KIB),
    MessageRow(KeepSettings, _DOWN, 6, "when somebody acts", 2.0, 3, Delivery.ORDER, 1 * _KIB),
    MessageRow(ApplySettings, _DOWN, 6, "when somebody acts", 2.0, 3, Delivery.ORDER, 64 * _KIB),
    MessageRow(MapAvailable, _DOWN, 3, "at each joining", 2.0, 4, Delivery.OFFER, 4 * _KIB),
    MessageRow(Accesses, _DOWN, 6, "on change", None, 4, Delivery.KEPT, 32 * _KIB),
    MessageRow(PublishGraph, _DOWN, 1, "when it is published", 2.0, 5, Delivery.OFFER, MAX_MESSAGE_BYTES),
)
MESSAGES: Mapping[type[msgspec.Struct], MessageRow] = MappingProxyType({row.message: row for row in _ROWS})
"""Every message that passes between device and console."""

_encoder = msgspec.msgpack.Encoder()
_device_decoder: msgspec.msgpack.Decoder[DeviceMessage] = msgspec.msgpack.Decoder(DeviceMessage)
_console_decoder: msgspec.msgpack.Decoder[ConsoleMessage] = msgspec.msgpack.Decoder(ConsoleMessage)


class _Greeting(msgspec.Struct):
    """What a greeting of any version says: the rest of it may have another form."""

    type: str
    protocol_version: int


_greeting_decoder = msgspec.msgpack.Decoder(_Greeting)


def encode(message: DeviceMessage | ConsoleMessage) -> bytes:
    """Return the message as one WebSocket frame. Raises WireError where it is larger than the table allows."""
    data = _encoder.encode(message)
    _refuse_larger(len(data), MESSAGES[type(message)].max_bytes, type(message).__name__)
    return data


def expired_text(order: Order) -> str:
    """Return the text of the event that tells that an order came too late."""
    tag = str(order.__struct_config__.tag)
    return f"Order {order.order_id} came too late and is not carried out: {tag.replace('_', ' ')}."


def tells_expired(event: Event, order_id: int) -> bool:
    """Return whether an event tells that this order came too late."""
    return event.kind == "link" and event.text.startswith(f"Order {order_id} came too late ")


def decode_from_device(data: bytes) -> DeviceMessage:
    """Read a message that a device sent. Raises WireError."""
    return _checked(data, _device_decoder)


def decode_from_console(data: bytes) -> ConsoleMessage:
    """Read a message that the console sent. Raises WireError."""
    return _checked(data, _console_decoder)


def decode_hello(data: bytes) -> Hello:
    """Read what a device begins with. Raises VersionError where it is of another version, else WireError."""
    theirs = _version_of(data, "hello")
    if theirs is not None:
        _refuse_other_version(console=PROTOCOL_VERSION, device=theirs)
    message = decode_from_device(data)
    if not isinstance(message, Hello):
        raise WireError("The device did not begin with a hello: use the same version on both sides.")
    return message


def decode_welcome(data: bytes) -> Welcome:
    """Read what the console begins with. Raises VersionError where it is of another version, else WireError."""
    theirs = _version_of(data, "welcome")
    if theirs is not None:
        _refuse_other_version(console=theirs, device=PROTOCOL_VERSION)
    message = decode_from_console(data)
    if not isinstance(message, Welcome):
        raise WireError("The console did not begin with a welcome: use the same version on both sides.")
    return message


def _version_of(data: bytes, greeting: str) -> int | None:
    """Return the version that a greeting names, whatever else is in it; None where it is none."""
    try:
        seen = _greeting_decoder.decode(data)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
        return None
    return seen.protocol_version if seen.type == greeting else None


def _refuse_other_version(*, console: int, device: int) -> None:
    if console != device:
        older = "console" if console < device else "device"
        raise VersionError(f"The console speaks protocol {console}, this device {device}: update the {older}.")


def _checked(data: bytes, decoder: msgspec.msgpack.Decoder[T]) -> T:
    _refuse_larger(len(data), MAX_MESSAGE_BYTES, "A message")
    try:
        message = decoder.decode(data)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise WireError(
            f"A message cannot be read ({words_of(error)}): use the same version of the program on both sides."
        ) from error
    kind = cast("type[msgspec.Struct]", type(message))
    _refuse_larger(len(data), MESSAGES[kind].max_bytes, kind.__name__)
    return message


def _refuse_larger(size_bytes: int, max_bytes: int, what: str) -> None:
    if size_bytes > max_bytes:
        raise WireError(f"{what} of {size_bytes} bytes is larger than the {max_bytes} that are taken: send less.")
