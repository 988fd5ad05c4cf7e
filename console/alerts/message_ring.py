"""The last half minute and more of what each device sent, as bytes of the wire, in bounded memory."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable

from console.message_log import WireRecord
from navcore.wire import (
    DepthImage,
    DeviceMessage,
    Event,
    GraphRunning,
    MapRunning,
    MapWalkRunning,
    MapWalkSeen,
    RouteChanged,
    SettingsRunning,
    WalkerState,
)

KEPT_S = 35.0
"""So much is held of each device."""
MAX_RING_BYTES = 8 << 20
"""And no more than this of each: what comes in states and silhouettes at full rate is a fifth of it."""
LASTING: frozenset[type[DeviceMessage]] = frozenset(
    {RouteChanged, SettingsRunning, GraphRunning, MapRunning, MapWalkRunning}
)
"""What stays true until the next of its kind comes: the newest is kept, however old it is."""
KEPT: frozenset[type[DeviceMessage]] = LASTING | {WalkerState, DepthImage, Event, MapWalkSeen}
"""What an incident shows. Named one by one, so that no picture in colours is ever among them by accident."""


class MessageRing:
    """What one device sent of late. All methods may be called from any thread."""

    def __init__(self, kept_s: float = KEPT_S, max_bytes: int = MAX_RING_BYTES) -> None:
        self._kept_s, self._max_bytes = kept_s, max_bytes
        self._lock = threading.Lock()
        self._records: deque[tuple[int, type[DeviceMessage], WireRecord]] = deque()
        self._lasting: dict[type[DeviceMessage], WireRecord] = {}
        self._next = 0
        self._bytes = 0

    def add(self, kind: type[DeviceMessage], record: WireRecord) -> None:
        """Take a message in; those that are older than what is held go."""
        if kind not in KEPT:
            return
        with self._lock:
            self._records.append((self._next, kind, record))
            self._next += 1
            self._bytes += len(record.data)
            while self._bytes > self._max_bytes or record.arrival_s - self._records[0][2].arrival_s > self._kept_s:
                self._forget_oldest()
                if not self._records:
                    break

    def since(self, number: int) -> tuple[list[WireRecord], int]:
        """Return the messages from a number on that are held, and the number of the next one."""
        with self._lock:
            return [record for at, _, record in self._records if at >= number], self._next

    def from_time(self, begin_s: float) -> tuple[list[WireRecord], int]:
        """Return the messages from a time on, after what was true before; and the number of the next one."""
        with self._lock:
            before = dict(self._lasting)
            after = []
            for _, kind, record in self._records:
                if record.arrival_s >= begin_s:
                    after.append(record)
                elif kind in LASTING:
                    before[kind] = record
            return [*_by_arrival(before.values()), *after], self._next

    def let_pass(self, now_s: float) -> None:
        """Forget what is older than what is held: a device that sends nothing any more holds no memory."""
        with self._lock:
            while self._records and now_s - self._records[0][2].arrival_s > self._kept_s:
                self._forget_oldest()

    @property
    def size_bytes(self) -> int:
        """How much it holds."""
        return self._bytes

    def _forget_oldest(self) -> None:
        _, kind, record = self._records.popleft()
        self._bytes -= len(record.data)
        if kind in LASTING:
            self._lasting[kind] = record


def _by_arrival(records: Iterable[WireRecord]) -> list[WireRecord]:
    return sorted(records, key=lambda record: record.arrival_s)
