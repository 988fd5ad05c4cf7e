"""A cycle as messages: what people see in Foxglove, and what a replay reads. Pure but for what was last shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
from google.protobuf.wrappers_pb2 import BytesValue

from device_agent.cycle import Cycle
from device_agent.orders import Lead, Order
from device_agent.ports import ButtonPress, EventKind
from device_agent.recording import channels, exact, foxglove
from device_agent.recording.channels import Channel
from device_agent.recording.messages import PoseMessage, StageTimesMessage
from device_agent.recording.notes import Notepad, Opening
from device_agent.state import DeviceState
from device_agent.voice import VoiceMemory
from device_agent.way import route_message
from navcore import wire
from navcore.cues.table import Cue
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.types import Frame, Localization, Route
from navcore.walk_messages import HeardCue, OrderMessage, SettingsMessage, Speaker

Message = tuple[Channel, float, object]
"""Channel, stamp (s), and the value to be encoded."""
_WARNINGS: frozenset[EventKind] = frozenset({"watchdog", "sensor", "route_refused"})


@dataclass(frozen=True, slots=True, eq=False)
class CycleItem:
    """One cycle on its way to the disk. All in it is frozen, or not touched any more."""

    number: int
    pad: Notepad
    cycle: Cycle
    state: DeviceState
    state_before: DeviceState
    voice_before: VoiceMemory
    pictures_dropped: int = 0
    """Frames since recording began whose pictures are not kept, though they were to be."""


class Transcript:
    """Makes the messages of one file; remembers what of the road and the route the file shows already."""

    def __init__(self, opening: Opening) -> None:
        self._opening = opening
        self._graph: PoiGraph | None = None
        self._route: Route | None = None
        self._settings: Settings | None = None
        self._fisheye_shown = False

    def beginning(self, stamp_s: float, rehearsal: Frame | None) -> Iterator[Message]:
        """Yield what a file begins with, so that it can be understood without the ones before."""
        state = self._opening.state
        yield channels.CALIBRATION, stamp_s, foxglove.calibration(stamp_s, self._opening.intrinsics)
        yield from self._standing(stamp_s, state)
        if state.route is None:
            yield from _way(stamp_s, state)
        if rehearsal is not None:
            yield from self._pictures(rehearsal)

    def cycle(self, item: CycleItem) -> Iterator[Message]:
        """Yield a cycle; its last message makes it whole."""
        cycle, frame = item.cycle, item.pad.frame
        stamp_s = cycle.stamp_s
        for order in item.pad.orders:
            yield channels.ORDERS, stamp_s, _order_message(stamp_s, order)
        if frame is not None:
            yield from self._pictures(frame)
        if cycle.localization is not None:
            yield from _place(cycle.localization, frame)
        if item.pad.sonar is not None:
            yield channels.SONAR, stamp_s, item.pad.sonar
        if cycle.scan is not None and (seen := foxglove.obstacles(stamp_s, cycle.scan)) is not None:
            yield channels.OBSTACLES, stamp_s, seen
        yield from self._standing(stamp_s, item.state)
        yield channels.GUIDANCE, stamp_s, cycle.guidance
        yield channels.ADVICE, stamp_s, foxglove.advice(cycle.guidance)
        for cue in item.pad.cues:
            yield from heard("loop", cue)
        yield channels.STAGES, stamp_s, StageTimesMessage.of(cycle, item.pad.load_level, item.pictures_dropped)
        notes = item.pad.notes(item.number, cycle.guidance, pictures=frame is not None)
        yield channels.REPLAY, stamp_s, BytesValue(value=exact.encode(notes))

    def _pictures(self, frame: Frame) -> Iterator[Message]:
        yield channels.COLOUR, frame.stamp_s, foxglove.picture(frame.stamp_s, foxglove.CAMERA, frame.colour_rgb)
        yield channels.DEPTH, frame.stamp_s, foxglove.depth_image(frame.stamp_s, frame.depth_m)
        if (wide := frame.fisheye) is not None:
            if not self._fisheye_shown:
                self._fisheye_shown = True
                shown = foxglove.fisheye_calibration(frame.stamp_s, wide.camera)
                yield channels.FISHEYE_CALIBRATION, frame.stamp_s, shown
            yield channels.FISHEYE, frame.stamp_s, foxglove.picture(wide.stamp_s, foxglove.FISHEYE, wide.grey)

    def _standing(self, stamp_s: float, state: DeviceState) -> Iterator[Message]:
        """Yield what holds until it changes, where it has changed."""
        if state.settings is not self._settings:
            self._settings = state.settings
            yield channels.SETTINGS, stamp_s, SettingsMessage(state.settings_revision, state.settings.model_dump())
        if state.graph is not self._graph:
            self._graph = state.graph
            yield channels.ROAD, stamp_s, foxglove.road(stamp_s, state.graph)
        if state.route is not self._route:
            self._route = state.route
            yield from _way(stamp_s, state)


def _way(stamp_s: float, state: DeviceState) -> Iterator[Message]:
    yield channels.ROUTE, stamp_s, foxglove.route(stamp_s, state.route)
    yield channels.WAY, stamp_s, wire.RouteChanged(stamp_s) if state.route is None else route_message(state, stamp_s)


def heard(speaker: Speaker, cue: Cue) -> Iterator[Message]:
    """Yield a cue that was played; its words are in the log as well."""
    yield channels.CUES, cue.stamp_s, HeardCue(speaker, cue)
    if cue.text:
        yield channels.LOG, cue.stamp_s, foxglove.log(cue.stamp_s, f"said by {speaker}", cue.text)


def happened(stamp_s: float, kind: EventKind, text: str) -> Iterator[Message]:
    """Yield an event; what was said is in the log as it was heard."""
    if kind != "cue":
        yield channels.LOG, stamp_s, foxglove.log(stamp_s, kind, text, warning=kind in _WARNINGS)


def _place(located: Localization, frame: Frame | None) -> Iterator[Message]:
    yield channels.LOCALIZATION, located.stamp_s, PoseMessage.of(located)
    wide = frame.fisheye if frame is not None else None
    tree, pose = foxglove.transforms(located, None if wide is None else wide.camera), foxglove.pose(located)
    if tree is not None and pose is not None:
        yield channels.TRANSFORMS, located.stamp_s, tree
        yield channels.POSE, located.stamp_s, pose


def _order_message(stamp_s: float, order: Order) -> OrderMessage:
    is_message = isinstance(order, wire.ConsoleMessage | Lead | ButtonPress)
    content = msgspec.json.encode(order).decode() if is_message else ""
    return OrderMessage(stamp_s, type(order).__name__, content)
