"""Reads the files of a past walk, once and from end to end, into a :class:`console.walk_timeline.WalkTimeline`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import get_args, get_type_hints

import msgspec
import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import DecodeError
from mcap.records import Channel, McapRecord, Message

from console.errors import NotFoundError
from console.past_walks import PastWalk
from console.timeline import ColumnsBuilder, NamedPlace, Stamped
from console.walk_timeline import WalkTimeline, Where, state_of
from navcore.errors import InputError
from navcore.walk_file import NS_PER_S, WalkFile
from navcore.walk_messages import (
    CUES_TOPIC,
    DEPTH_TOPIC,
    DEVICE_TOPIC,
    LOG_TOPIC,
    ORDERS_TOPIC,
    ROAD_TOPIC,
    ROUTE_TOPIC,
    SETTINGS_TOPIC,
    WAY_TOPIC,
    HeardCue,
    OrderMessage,
    SettingsMessage,
)
from navcore.wire import Event, Point2, RouteChanged

MAX_CYCLE_COUNT = 360_000
"""Ten hours at 10 Hz; a longer walk is read up to there."""
_EVENT_KINDS = frozenset(get_args(get_type_hints(Event)["kind"]))
_FROM_CONSOLE_OR_BUTTONS = frozenset(
    {"SetDestination", "ClearDestination", "Pause", "Resume", "Repeat", "Say", "ApplySettings", "Lead", "ButtonPress"}
)
"""Orders that are worth a mark; the others are the device's own affairs."""


def read_walk(walk: PastWalk) -> WalkTimeline:
    """Read a walk. Raises NotFoundError where nothing of it can be read."""
    reader = _Reader(walk)
    for number, path in enumerate(walk.parts):
        try:
            reader.read(number, WalkFile(path))
        except InputError:
            # It stands among the walk's troubles already.
            continue
    return reader.timeline()


class _Reader:
    """Collects what the messages of the files say."""

    def __init__(self, walk: PastWalk) -> None:
        self._walk = walk
        self._states = ColumnsBuilder()
        self._where: list[Where] = []
        self._events: list[Event] = []
        self._cues: list[Stamped] = []
        self._orders: list[Stamped] = []
        self._routes: list[RouteChanged] = []
        self._drawn_routes: list[RouteChanged] = []
        self._settings: list[tuple[float, SettingsMessage]] = []
        self._places: tuple[NamedPlace, ...] = ()
        self._roads: tuple[tuple[Point2, ...], ...] = ()
        self._depths: list[Where] = []
        self._unread_count = 0
        self._take: Mapping[str, Callable[[bytes, Where], None]] = {
            DEVICE_TOPIC: self._take_state,
            LOG_TOPIC: self._take_log,
            CUES_TOPIC: self._take_cue,
            ORDERS_TOPIC: self._take_order,
            WAY_TOPIC: self._take_way,
            ROUTE_TOPIC: self._take_drawn_route,
            ROAD_TOPIC: self._take_road,
            SETTINGS_TOPIC: self._take_settings,
            DEPTH_TOPIC: self._take_depth,
        }

    def read(self, part: int, file: WalkFile) -> None:
        """Read a file up to its end or its damage. Raises InputError."""
        takers: dict[int, Callable[[bytes, Where], None]] = {}
        for offset, records in file.blocks():
            for record in records:
                self._read_record(record, part, offset, takers)
            if len(self._states) >= MAX_CYCLE_COUNT:
                break

    def _read_record(
        self, record: McapRecord, part: int, offset: int, takers: dict[int, Callable[[bytes, Where], None]]
    ) -> None:
        if isinstance(record, Channel) and record.topic in self._take:
            takers[record.id] = self._take[record.topic]
        elif isinstance(record, Message) and record.channel_id in takers:
            where = Where(record.log_time / NS_PER_S, part, offset, record.channel_id, record.log_time)
            try:
                takers[record.channel_id](record.data, where)
            except (msgspec.MsgspecError, DecodeError, UnicodeDecodeError, RecursionError):
                self._unread_count += 1

    # ------------------------------------------------------------------------------------------- the messages
    def _take_state(self, data: bytes, where: Where) -> None:
        state = state_of(data)
        if state is None:
            self._unread_count += 1
            return
        # A file that begins again where the last one ended brings nothing new.
        if self._where and where.stamp_s <= self._where[-1].stamp_s:
            return
        self._where.append(where)
        self._states.add(state)

    def _take_log(self, data: bytes, where: Where) -> None:
        line = Log.FromString(data)
        if line.name in _EVENT_KINDS:
            self._event(where.stamp_s, line.name, line.message)

    def _event(self, stamp_s: float, kind: str, text: str) -> None:
        event = {"type": "event", "sequence": len(self._events) + 1, "stamp_s": stamp_s, "kind": kind}
        self._events.append(msgspec.convert(event | {"text": text[:500]}, Event))

    def _take_cue(self, data: bytes, where: Where) -> None:
        cue = _cue_decoder.decode(data).cue
        self._cues.append(Stamped(where.stamp_s, cue.kind.value, cue.text))
        if cue.text:
            self._event(where.stamp_s, "cue", cue.text)

    def _take_order(self, data: bytes, where: Where) -> None:
        order = _order_decoder.decode(data)
        if order.kind in _FROM_CONSOLE_OR_BUTTONS:
            self._orders.append(Stamped(where.stamp_s, order.kind, order.content))

    def _take_way(self, data: bytes, where: Where) -> None:
        self._routes.append(msgspec.structs.replace(_route_decoder.decode(data), stamp_s=where.stamp_s))

    def _take_drawn_route(self, data: bytes, where: Where) -> None:
        lines = _lines(SceneUpdate.FromString(data))
        self._drawn_routes.append(RouteChanged(where.stamp_s, lines[0] if lines else ()))

    def _take_road(self, data: bytes, where: Where) -> None:
        scene = SceneUpdate.FromString(data)
        self._roads = _lines(scene)
        self._places = tuple(
            NamedPlace(text.text, text.pose.position.x, text.pose.position.y)
            for entity in scene.entities
            for text in entity.texts
        )

    def _take_settings(self, data: bytes, where: Where) -> None:
        settings = _settings_decoder.decode(data)
        if not self._settings or self._settings[-1][1].settings != settings.settings:
            self._settings.append((where.stamp_s, settings))

    def _take_depth(self, data: bytes, where: Where) -> None:
        self._depths.append(where)

    # ------------------------------------------------------------------------------------------- put together
    def timeline(self) -> WalkTimeline:
        """Return all of it. Raises NotFoundError where there is no cycle."""
        if not self._where:
            why = " ".join(self._walk.troubles) or "Its files hold no cycle."
            raise NotFoundError(f"Nothing of this walk can be read. {why}")
        by_time = sorted(self._events, key=lambda event: event.stamp_s)
        return WalkTimeline(
            walk=self._walk,
            stamps_s=np.array([where.stamp_s for where in self._where], np.float64),
            columns=self._states.columns(),
            events=tuple(msgspec.structs.replace(event, sequence=index) for index, event in enumerate(by_time, 1)),
            cues=tuple(self._cues),
            orders=tuple(self._orders),
            routes=tuple(self._routes or self._drawn_routes),
            settings=tuple(self._settings),
            places=self._places,
            roads=self._roads,
            troubles=(*self._walk.troubles, *self._unread()),
            _where=tuple(self._where),
            _depths=tuple(self._depths),
        )

    def _unread(self) -> tuple[str, ...]:
        if not self._unread_count:
            return ()
        return (f"{self._unread_count} messages could not be read: another version of the program has written them.",)


def _lines(scene: SceneUpdate) -> tuple[tuple[Point2, ...], ...]:
    return tuple(
        tuple((point.x, point.y) for point in line.points) for entity in scene.entities for line in entity.lines
    )


_cue_decoder = msgspec.json.Decoder(HeardCue)
_order_decoder = msgspec.json.Decoder(OrderMessage)
_route_decoder = msgspec.json.Decoder(RouteChanged)
_settings_decoder = msgspec.json.Decoder(SettingsMessage)
