"""What waits to be sent to the console, and in which order it goes.

What is kept goes in order; of states, of what a map walk sees, and of pictures the newest is sent, as often as the
message table allows (:data:`navcore.wire.MESSAGES`). Nothing here grows without bound, and no method waits.

No picture leaves the device but by here, and none that the walker does not share: what was told to the console of it
last (:class:`~navcore.wire.SharingRunning`) decides, and before it was told, nothing goes. Recordings of walks ask here
as well (:meth:`Outbox.shares_walks`).
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

import msgspec

from device_agent.ports import KeptMessage
from navcore.types import Frame
from navcore.wire import (
    MESSAGES,
    ColourImage,
    DepthImage,
    MapWalkRunning,
    MapWalkSeen,
    SharingRunning,
    WalkerState,
)
from navcore.wire_pace import Pace

MAX_KEPT = 256
"""More than these are not kept while there is no link: the newest of each kind is told at the joining in any case."""


Newest = WalkerState | MapWalkSeen
"""What is replaced by the next of its kind while it is not sent yet."""


ImageMessage = DepthImage | ColourImage
"""A picture for the console, made of a frame when it goes."""


def _pace_of(message: type[Newest] | type[ImageMessage]) -> Pace:
    rate_hz = MESSAGES[message].rate_hz
    assert rate_hz is not None
    return Pace(rate_hz)


class Outbox:
    """Filled by the loop, emptied by the link; any thread may call anything."""

    def __init__(self, on_filled: Callable[[], None] = lambda: None) -> None:
        self.on_filled = on_filled
        """Called, in the filler's thread, when there is something to send."""
        self._lock = threading.Lock()
        self._kept: deque[KeptMessage] = deque(maxlen=MAX_KEPT)
        self._latest: dict[type, KeptMessage] = {}
        self._newest: dict[type[Newest], Newest] = {}
        self._paces = {kind: _pace_of(kind) for kind in (WalkerState, MapWalkSeen)}
        self._frames: dict[type[ImageMessage], Frame] = {}
        self._frame_paces = {kind: _pace_of(kind) for kind in (DepthImage, ColourImage)}
        self._shared: frozenset[type[ImageMessage]] = frozenset()
        self._shares_walks = False

    def keep(self, message: KeptMessage) -> None:
        """Add a message that is kept until it is sent, and of which the newest of its kind is sent at each joining."""
        with self._lock:
            self._kept.append(message)
            self._latest[type(message)] = message
            if isinstance(message, SharingRunning):
                self._shared = _shared_by(message)
                self._shares_walks = message.walks
                self._frames = {kind: frame for kind, frame in self._frames.items() if kind in self._shared}
        self.on_filled()

    def shares_walks(self) -> bool:
        """Whether the walker shares recordings of walks just now."""
        return self._shares_walks

    def offer(self, message: Newest) -> None:
        """Replace the message of this kind that is not sent yet."""
        with self._lock:
            self._newest[type(message)] = message
        self.on_filled()

    def offer_frame(self, kind: type[ImageMessage], frame: Frame) -> None:
        """Replace the picture of this kind that is not sent yet; nothing where the walker does not share it."""
        with self._lock:
            if kind not in self._shared:
                return
            self._frames[kind] = frame
        self.on_filled()

    def joined(self) -> None:
        """A new connection begins: what the console may have missed is put in front again; old pictures go.

        A refusal of a map walk does not: its order was given up at both ends, and it would be taken for the answer to
        an order of the new connection.
        """
        with self._lock:
            waiting = {type(message) for message in self._kept}
            missed = [message for kind, message in self._latest.items() if kind not in waiting]
            # Where all of it is too much, the oldest go: never the newest of a kind.
            self._kept = deque(
                map(_without_refusal, [*missed, *list(self._kept)[-(MAX_KEPT - len(missed)) :]]), MAX_KEPT
            )
            self._newest.clear()
            self._frames.clear()

    def next_kept(self) -> KeptMessage | None:
        """Take the oldest kept message."""
        with self._lock:
            return self._kept.popleft() if self._kept else None

    def put_back(self, message: KeptMessage) -> None:
        """Return a message whose sending failed."""
        with self._lock:
            if len(self._kept) < MAX_KEPT:
                self._kept.appendleft(message)

    def next_newest(self, now_s: float) -> Newest | None:
        """Take a newest message that is due."""
        with self._lock:
            for kind, pace in self._paces.items():
                if kind in self._newest and pace.wait_s(now_s) <= 0:
                    pace.went(now_s)
                    return self._newest.pop(kind)
        return None

    def next_frame(self, kind: type[ImageMessage], now_s: float) -> Frame | None:
        """Take the newest frame for a picture of this kind when one is due."""
        with self._lock:
            if kind not in self._frames or self._frame_paces[kind].wait_s(now_s) > 0:
                return None
            self._frame_paces[kind].went(now_s)
            return self._frames.pop(kind)

    def wait_s(self, now_s: float) -> float | None:
        """Return how long until a newest message or an image that waits is due; None when none waits."""
        with self._lock:
            waits = [self._paces[kind].wait_s(now_s) for kind in self._newest]
            waits += [self._frame_paces[kind].wait_s(now_s) for kind in self._frames]
        return max(0.0, min(waits)) if waits else None


def _shared_by(sharing: SharingRunning) -> frozenset[type[ImageMessage]]:
    """Return the pictures that may go."""
    silhouettes: tuple[type[ImageMessage], ...] = (DepthImage,) if sharing.silhouettes else ()
    colour: tuple[type[ImageMessage], ...] = (ColourImage,) if sharing.colour_for else ()
    return frozenset(silhouettes + colour)


def _without_refusal(message: KeptMessage) -> KeptMessage:
    return msgspec.structs.replace(message, refusal="") if isinstance(message, MapWalkRunning) else message
