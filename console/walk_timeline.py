"""A past walk as columns over its cycles, and any instant of it as the live page would have shown it.

The files are read once, from end to end. What is small or asked for often is kept in memory (about 140 bytes a cycle:
5 MB for an hour); of each cycle's message only where it lies, so that an instant is read again from its file.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from mcap.records import McapRecord, Message
from numpy.typing import NDArray

from console.errors import NotFoundError
from console.live import LiveDevice
from console.past_walks import PastWalk
from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.settings import SettingValue
from navcore.silhouette import silhouette_jpeg
from navcore.walk_file import block_at
from navcore.walk_messages import SettingsMessage, depths_of
from navcore.wire import PROTOCOL_VERSION, DepthImage, Event, Hello, Point2, RouteChanged, WalkerState

EVENTS_KEPT_COUNT = 200
"""As many of the latest events as a live device has."""
_BLOCKS_KEPT_COUNT = 4
"""Instants that follow one another mostly lie in one block: half a second."""
NUMBERS = (
    "x_m", "y_m", "heading_rad", "position_std_m", "deviation_m", "remaining_m", "nearest_ahead_m", "sonar_m",
    "speed_m_s",
)  # fmt: skip
"""Columns that hold numbers; NaN where there is none."""
WORDS = ("quality", "action", "reason", "mode", "sonar_state", "destination_id")
"""Columns that hold words, as indices into :attr:`WalkTimeline.words`."""


@dataclass(frozen=True, slots=True)
class NamedPlace:
    """A place of the road as the walk's own files have it."""

    name: str
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class Stamped:
    """Something that happened, on the device's clock."""

    stamp_s: float
    kind: str
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Where:
    """Where a message lies: in which file, from which byte its block begins, and by what it is told apart there."""

    stamp_s: float
    part: int
    offset: int
    channel_id: int
    log_time_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class WalkTimeline:
    """What is known of a past walk. Times are the device's clock, as it was recorded."""

    walk: PastWalk
    stamps_s: FloatArray
    """(n,) of the cycles, ascending."""
    numbers: dict[str, NDArray[np.float32]]
    """Columns (n,) of :data:`NUMBERS`."""
    codes: dict[str, NDArray[np.int16]]
    """Columns (n,) of :data:`WORDS`."""
    words: tuple[str, ...]
    """What the codes stand for."""
    events: tuple[Event, ...]
    cues: tuple[Stamped, ...]
    """What was heard: kind of the cue, and its words (empty for a tone)."""
    orders: tuple[Stamped, ...]
    """What was asked of the device: kind of the order, and what came with it."""
    routes: tuple[RouteChanged, ...]
    settings: tuple[tuple[float, SettingsMessage], ...]
    places: tuple[NamedPlace, ...]
    roads: tuple[tuple[Point2, ...], ...]
    """Lines of the road."""
    troubles: tuple[str, ...]
    """What of the walk is missing or damaged, in sentences."""
    _where: tuple[Where, ...]
    """Of each cycle's state."""
    _depths: tuple[Where, ...]
    _blocks: Callable[[Path, int], list[McapRecord]] = field(
        default_factory=lambda: lru_cache(maxsize=_BLOCKS_KEPT_COUNT)(block_at)
    )

    @property
    def began_s(self) -> float:
        """The first cycle."""
        return float(self.stamps_s[0])

    @property
    def ended_s(self) -> float:
        """The last cycle."""
        return float(self.stamps_s[-1])

    def is_word(self, column: str, *words: str) -> NDArray[np.bool_]:
        """Return (n,) whether a column holds one of these words."""
        wanted = [index for index, word in enumerate(self.words) if word in words]
        return np.isin(self.codes[column], wanted)

    def word(self, column: str, index: int) -> str:
        """Return the word of a cycle."""
        return self.words[int(self.codes[column][index])]

    def index_at(self, stamp_s: float) -> int:
        """Return the cycle that was the newest at a time; the first one before the beginning."""
        return max(0, int(np.searchsorted(self.stamps_s, stamp_s, side="right")) - 1)

    def route_at(self, stamp_s: float) -> RouteChanged | None:
        """Return the route that was walked then."""
        found = bisect_right(self.routes, stamp_s, key=lambda route: route.stamp_s)
        return self.routes[found - 1] if found else None

    def settings_at(self, stamp_s: float) -> SettingsMessage | None:
        """Return the settings that ran then."""
        found = bisect_right(self.settings, stamp_s, key=lambda each: each[0])
        return self.settings[found - 1][1] if found else None

    def device_at(self, stamp_s: float) -> LiveDevice:
        """Return the device as the console would have known it then, without any delay.

        Raises NotFoundError where the files are gone meanwhile.
        """
        index = self.index_at(stamp_s)
        settings = self.settings_at(stamp_s)
        revision = settings.revision if settings else 0
        walk = self.walk
        hello = Hello(
            PROTOCOL_VERSION, walk.device[:120], walk.software_version[:120], walk.site_id, walk.map_checksum,
            walk.graph_version, revision, stamp_s,
        )  # fmt: skip
        seen = bisect_right(self.events, stamp_s, key=lambda event: event.stamp_s)
        depth = self._depth_before(stamp_s)
        return LiveDevice(
            walk.device, walk.device, hello, connected=True, connected_at_s=self.began_s, clock_offset_s=0.0,
            clock_uncertainty_s=0.0, round_trip_s=None, state=self._state(index),
            state_arrival_s=float(self.stamps_s[index]), route=self.route_at(stamp_s),
            depth_image=None if depth is None else DepthImage(depth.stamp_s, b""),
            events=self.events[max(0, seen - EVENTS_KEPT_COUNT) : seen],
            settings=None if settings is None else flat(settings.settings), settings_revision=revision,
            map_checksum=walk.map_checksum, graph_version=walk.graph_version,
        )  # fmt: skip

    def depth_jpeg(self, stamp_s: float) -> bytes:
        """Return the depth silhouette that was the newest then. Raises NotFoundError."""
        where = self._depth_before(stamp_s)
        if where is None:
            raise NotFoundError("This walk was recorded without pictures: there is no depth image.")
        try:
            return silhouette_jpeg(depths_of(RawImage.FromString(self._message(where))))
        except (DecodeError, InputError) as error:
            raise NotFoundError("The depth image of this instant is damaged.") from error

    def _depth_before(self, stamp_s: float) -> Where | None:
        found = bisect_right(self._depths, stamp_s, key=lambda where: where.stamp_s)
        return self._depths[found - 1] if found else None

    def _state(self, index: int) -> WalkerState:
        state = state_of(self._message(self._where[index]))
        if state is None:
            raise NotFoundError("This instant of the walk cannot be read any more.")
        return state

    def _message(self, where: Where) -> bytes:
        """Return a message by where it lies. Raises NotFoundError."""
        try:
            records = self._blocks(self.walk.parts[where.part], where.offset)
        except InputError as error:
            raise NotFoundError("This walk was deleted meanwhile.") from error
        for record in records:
            if (
                isinstance(record, Message)
                and record.channel_id == where.channel_id
                and record.log_time == where.log_time_ns
            ):
                return record.data
        raise NotFoundError("This instant of the walk cannot be read any more: its file has changed.")


def flat(settings: dict[str, Any]) -> dict[str, SettingValue]:
    """Return settings by group and name as the wire has them, by ``group.name``."""
    return {
        f"{group}.{name}": value
        for group, values in settings.items()
        if isinstance(values, dict)
        for name, value in values.items()
    }


def state_of(data: bytes) -> WalkerState | None:
    """Return a recorded state; None where it cannot be read.

    JSON knows no NaN and no infinity: in lists of numbers, null stands for them.
    """
    try:
        return _state_decoder.decode(data)
    except msgspec.MsgspecError:
        pass
    try:
        return msgspec.convert(_with_nan(msgspec.json.decode(data)), WalkerState)
    except (msgspec.MsgspecError, RecursionError):
        return None


def _with_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _with_nan(each) for name, each in value.items()}
    if isinstance(value, list):
        return [math.nan if each is None else _with_nan(each) for each in value]
    return value


_state_decoder = msgspec.json.Decoder(WalkerState)
