"""Every reader of the product of what comes over the air or a wire: targets for fuzzing, with small valid inputs.

A target takes any bytes. It may refuse them with an error of :mod:`navcore.errors`, whose sentence says what is wrong;
anything else that it raises is a fault of the product, and so is a law that does not hold afterwards.
"""

from __future__ import annotations

import contextlib
import inspect
import json
from collections.abc import Callable, Iterator

import msgspec
import numpy as np
import pydantic
from test_wire import DOWN, UP

from console import bodies
from console.api_graph import decode_edit
from console.edits import AddEdge, AddPoi, DrawRoad, Edit, MovePoi, SetEdge, SplitEdge, SplitRoad, UpdatePoi, evaluate
from console.hub import DeviceHub
from console.live_panel import device_view
from console.overview import overview_row
from console.page_stream import read_said
from console.place_words import PlaceWords
from console.recordings import offer_of
from device_agent.adapters.sonar_line import LineParser, SonarKind, SonarLine, encoded
from device_agent.orders import at_rest, carry_out
from device_agent.privacy import passed, watching_now, who_has_looked
from device_agent.state import DeviceState
from navcore import wire
from navcore.errors import WireError
from navcore.jpeg_size import MAX_PICTURE_PX, jpeg_size_px, refuse_picture
from navcore.modes import Mode
from navcore.planning.edits import validate
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road
from navcore.planning.road_network import RoadNetwork
from navcore.settings import Settings
from navcore.silhouette import silhouette_jpeg

GRAPH = PoiGraph(
    1,
    {"a": Poi("a", "Hall", "hall", 0.0, 0.0), "b": Poi("b", "Bar", "bar", 6.0, 0.0)},
    {"a-b": Edge("a-b", "a", "b", ((0.0, 0.0), (6.0, 0.0)), 6.0)},
    {"road-1": Road("road-1", ((0.0, 0.0), (3.0, 0.0), (6.0, 0.0)))},
)
NETWORK = RoadNetwork.from_roads([np.array(road.points_m) for road in GRAPH.roads.values()])
HELLO = wire.Hello(wire.PROTOCOL_VERSION, "glasses", "0.1.0", "small", "c0ffee", 1, 0, 1000.0)
STATE = wire.WalkerState(1000.0, "localized", "walk", "ok", pose=(1.0, 0.1, 1.6, 0.0), mode=Mode.GUIDING, eye_m=1.6)


# ---------------------------------------------------------------------------------------------------- the messages
def wire_device(data: bytes) -> None:
    """A message of a device: what is taken can be sent on, and is the same then."""
    _comes_back(wire.decode_from_device(data), wire.decode_from_device)


def wire_console(data: bytes) -> None:
    """A message of the console: what is taken can be sent on, and is the same then."""
    _comes_back(wire.decode_from_console(data), wire.decode_from_console)


def wire_greetings(data: bytes) -> None:
    """A greeting of either side: whatever is taken is one, of this version."""
    for decode in (wire.decode_hello, wire.decode_welcome):
        with contextlib.suppress(WireError):
            assert decode(data).protocol_version == wire.PROTOCOL_VERSION


def device_seen(data: bytes) -> None:
    """Messages of a device, one after the other (length in two bytes): whatever is taken can be shown to people."""
    now_s = [1000.0]
    hub = DeviceHub(lambda: now_s[0], lambda: 1.7e9)
    hub.connect(HELLO, "Glasses", _Nowhere())
    places = PlaceWords(GRAPH)
    for message in _decoded(data, wire.decode_from_device):
        if isinstance(message, wire.Hello):
            continue
        now_s[0] += 0.1
        hub.receive(HELLO.device_id, message)
        device = hub.device(HELLO.device_id)
        for shown in (device_view(device, now_s[0]), overview_row(device, GRAPH, places)):
            json.loads(msgspec.json.encode(shown))


def device_ordered(data: bytes) -> None:
    """Messages of the console, one after the other (length in two bytes): the device carries out, refuses, goes on."""
    state = DeviceState(Settings(), GRAPH, "small", "c0ffee", mode=Mode.GUIDING, destination_id="b")
    for number, message in enumerate(_decoded(data, wire.decode_from_console)):
        now_s = 1000.0 + number
        for step in (lambda s: carry_out(s, message, now_s), at_rest, lambda s: passed(s, now_s)):  # noqa: B023
            state, effects = step(state)
            for effect in effects:
                if type(effect) in wire.MESSAGES:
                    wire.decode_from_device(wire.encode(effect))
        who_has_looked(state, now_s)
        watching_now(state)
        assert state.settings == Settings().changed(state.settings.values()), "within their ranges"


def _comes_back(message: msgspec.Struct, decode: Callable[[bytes], msgspec.Struct]) -> None:
    sent = wire.encode(message)  # type: ignore[arg-type]
    assert decode(sent) == message


def _decoded(data: bytes, decode: Callable[[bytes], msgspec.Struct]) -> Iterator[msgspec.Struct]:
    while len(data) >= 2:
        size_bytes = int.from_bytes(data[:2], "big")
        with contextlib.suppress(WireError):
            yield decode(data[2 : 2 + size_bytes])
        data = data[2 + size_bytes :]


class _Nowhere:
    """A way to a device that nobody listens at."""

    def send(self, message: wire.ConsoleMessage) -> None:
        wire.encode(message)

    def close(self, code: int, reason: str) -> None:
        """There is nothing to close."""


# ------------------------------------------------------------------------------------------- pictures and the sonar
def jpeg_header(data: bytes) -> None:
    """A picture of a device: what is taken is as large as it says, and no larger than any is."""
    refuse_picture(data)
    size_px = jpeg_size_px(data)
    assert size_px is not None
    assert 0 < size_px[0] * size_px[1] <= MAX_PICTURE_PX


def sonar_line(data: bytes) -> None:
    """What comes on the serial line, in pieces that the bytes themselves choose: only what was sent is read."""
    parser, found, rest = LineParser(), list[SonarLine](), data
    while rest:
        size = 1 + rest[0] % 7
        found += parser.feed(rest[:size])
        rest = rest[size:]
    for line in found:
        assert (line.distance_mm > 0) == (line.kind is SonarKind.ECHO)
        assert str(line.distance_mm).encode() in data, "no distance that was not sent"
    assert parser.feed(encoded(SonarLine(7, SonarKind.ECHO, 1500)))[-1:] == [SonarLine(7, SonarKind.ECHO, 1500)]


# ------------------------------------------------------------------------------------------------- bodies of requests
_MODELS = tuple(
    model
    for name, model in sorted(vars(bodies).items())
    if inspect.isclass(model) and issubclass(model, pydantic.BaseModel) and name.endswith("Body") and name[0] != "_"
)


def http_bodies(data: bytes) -> None:
    """The body of a request, by the model that its first byte names: what is taken says the same again."""
    if not data:
        return
    model = _MODELS[data[0] % len(_MODELS)]
    try:
        body = model.model_validate(json.loads(data[1:]))
    except (ValueError, RecursionError):
        # As the application does: pydantic's errors are ValueErrors, and become a 400 with a sentence.
        return
    assert model.model_validate(json.loads(body.model_dump_json())) == body


def edit_made(data: bytes) -> None:
    """An edit of the graph: it is made or refused, and the graph is sound afterwards."""
    edit = decode_edit(data)
    after = evaluate(edit, GRAPH, NETWORK)
    validate(after)
    assert msgspec.json.decode(msgspec.json.encode(after), type=PoiGraph) == after


def recording_offered(data: bytes) -> None:
    """An offer of a recording by a device."""
    offer_of(data)


def page_said(data: bytes) -> None:
    """What a page says on a live stream; None where it cannot be read."""
    with contextlib.suppress(UnicodeDecodeError):
        # The server closes what is no UTF-8 by itself.
        read_said(data.decode())


TARGETS: dict[str, Callable[[bytes], None]] = {
    "wire_device": wire_device,
    "wire_console": wire_console,
    "wire_greetings": wire_greetings,
    "device_seen": device_seen,
    "device_ordered": device_ordered,
    "jpeg_header": jpeg_header,
    "sonar_line": sonar_line,
    "http_bodies": http_bodies,
    "edit_made": edit_made,
    "recording_offered": recording_offered,
    "page_said": page_said,
}
"""By name; each takes any bytes, and lets no error through but the product's own."""


def framed(*messages: wire.DeviceMessage | wire.ConsoleMessage) -> bytes:
    """Return messages one after the other, each with its length."""
    return b"".join(len(data := wire.encode(each)).to_bytes(2, "big") + data for each in messages)


_EDITS: tuple[Edit, ...] = (
    AddPoi("Room", "room", 3.0, 0.1), MovePoi("a", 0.5, 0.0), UpdatePoi("a", name="Lobby"), AddEdge("a", "b"),
    SetEdge("a-b", closed=True, width_m=1.5), SplitEdge("a-b", 3.0, 0.0, "Corner"), SplitRoad("road-1", (3.0, 0.0)),
    DrawRoad(((0.0, 0.0), (0.0, 4.0))),
)  # fmt: skip
_BODIES: dict[str, object] = {
    "SignInBody": {"name": "Ada", "password": "seven quiet corridors"},
    "SettingsBody": {"changes": {"gate.clearance_m": 2.0}, "confirmed": True, "trial_s": 60.0},
    "PastViewBody": {"walk": "w", "at_s": 1.5, "clock": "12:00:00"},
    "ViewBody": {"point": [1.0, 2.0], "kind": "poi", "id": "a"},
    "PublishBody": {"confirmed": True, "version": 3},
}
SEEDS: dict[str, list[bytes]] = {
    "wire_device": [wire.encode(each) for each in UP],
    "wire_console": [wire.encode(each) for each in DOWN],
    "wire_greetings": [wire.encode(UP[0]), wire.encode(wire.Welcome(wire.PROTOCOL_VERSION, 5))],
    "device_seen": [framed(*UP[1:4]), *(framed(each) for each in UP[1:])],
    "device_ordered": [*(framed(each) for each in DOWN), framed(*DOWN[:4])],
    "jpeg_header": [silhouette_jpeg(np.full((12, 16), 2.0, np.float32))],
    "sonar_line": [
        b"".join(encoded(SonarLine(ms, SonarKind.ECHO, 1000 + ms)) for ms in (50, 100, 150)),
        encoded(SonarLine(5, SonarKind.NO_ECHO, 0)) + encoded(SonarLine(55, SonarKind.FAULT, 0)),
    ],
    "http_bodies": [
        bytes([number]) + json.dumps(_BODIES.get(model.__name__, {"name": "x"})).encode()
        for number, model in enumerate(_MODELS)
    ],
    "edit_made": [msgspec.json.encode(each) for each in _EDITS],
    "recording_offered": [
        json.dumps({"kind": "recording", "name": "a walk", "size_bytes": 10, "sha256": "0" * 64}).encode()
    ],
    "page_said": [b'{"type":"clock","page_sent_s":1.5}', b'{"type":"watching","watching":["glasses"]}'],
}
"""Valid inputs of each, to begin from."""
