"""A past walk as columns over its cycles, and any instant of it as the live page would have shown it.

The files are read once, from end to end. What is small or asked for often is kept in memory (about 140 bytes a cycle:
5 MB for an hour); of each cycle's message only where it lies, so that an instant is read again from its file.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from mcap.records import McapRecord, Message

from console.errors import NotFoundError
from console.live import LiveDevice
from console.overruled import as_heard
from console.past_walks import PastWalk
from console.timeline import Stamped, Timeline
from navcore.errors import InputError
from navcore.settings import SettingValue
from navcore.silhouette import silhouette_jpeg
from navcore.walk_file import block_at
from navcore.walk_messages import SettingsMessage, depths_of
from navcore.wire import PROTOCOL_VERSION, DepthImage, Hello, WalkerState

EVENTS_KEPT_COUNT = 200
"""As many of the latest events as a live device has."""
_BLOCKS_KEPT_COUNT = 4
"""Instants that follow one another mostly lie in one block: half a second."""


@dataclass(frozen=True, slots=True, eq=False)
class Where:
    """Where a message lies: in which file, from which byte its block begins, and by what it is told apart there."""

    stamp_s: float
    part: int
    offset: int
    channel_id: int
    log_time_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class WalkTimeline(Timeline):
    """What is known of a past walk. Times are the device's clock, as it was recorded."""

    walk: PastWalk
    cues: tuple[Stamped, ...]
    """What was heard: kind of the cue, and its words (empty for a tone)."""
    settings: tuple[tuple[float, SettingsMessage], ...]
    _where: tuple[Where, ...]
    """Of each cycle's state."""
    _depths: tuple[Where, ...]
    _blocks: Callable[[Path, int], list[McapRecord]] = field(
        default_factory=lambda: lru_cache(maxsize=_BLOCKS_KEPT_COUNT)(block_at)
    )

    def settings_at(self, stamp_s: float) -> SettingsMessage | None:
        """Return the settings that ran then."""
        found = bisect_right(self.settings, stamp_s, key=lambda each: each[0])
        return self.settings[found - 1][1] if found else None

    def state_at(self, index: int) -> WalkerState | None:
        """Return the state of a cycle; None where it cannot be read any more."""
        try:
            return self._state(index)
        except NotFoundError:
            return None

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
        events, depth = self.events[max(0, seen - EVENTS_KEPT_COUNT) : seen], self._depth_before(stamp_s)
        return LiveDevice(
            walk.device, walk.device, hello, connected=True, connected_at_s=self.began_s, clock_offset_s=0.0,
            clock_uncertainty_s=0.0, round_trip_s=None, state=as_heard(self._state(index), events),
            state_arrival_s=float(self.stamps_s[index]), route=self.route_at(stamp_s),
            depth_image=None if depth is None else DepthImage(depth.stamp_s, b""),
            events=events,
            settings=None if settings is None else flat(settings.settings), settings_revision=revision,
            map_checksum=walk.map_checksum, graph_version=walk.graph_version,
        )  # fmt: skip

    def depth_stamp_s(self, stamp_s: float) -> float | None:
        """Return the time of the depth image that was the newest then; None where there was none."""
        where = self._depth_before(stamp_s)
        return None if where is None else where.stamp_s

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

    JSON knows no NaN and no infinity: where earlier versions recorded them, null stands in a list of numbers. Such a
    candidate is left out, and such a pose or sub-goal is not known: the instant is still one.
    """
    try:
        return _state_decoder.decode(data)
    except msgspec.MsgspecError:
        pass
    try:
        return msgspec.convert(_of_known_numbers(msgspec.json.decode(data, type=dict[str, Any])), WalkerState)
    except (msgspec.MsgspecError, RecursionError, TypeError):
        return None


def _of_known_numbers(values: dict[str, Any]) -> dict[str, Any]:
    candidates = [each for each in values.get("candidates") or () if None not in each]
    places = {name: None for name in ("pose", "sub_goal") if None in (values.get(name) or ())}
    return values | places | {"candidates": candidates}


_state_decoder = msgspec.json.Decoder(WalkerState)
