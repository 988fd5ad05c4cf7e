"""Something that a device went through, as columns over its cycles, and any instant of it as the live page showed it.

A walk of a recording (:mod:`console.walk_timeline`) and an incident (:mod:`console.incident_timeline`) are both one, so
that one player, one set of panels and one list of marks show either.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from console.live import LiveDevice
from console.live_panel import reason_sentence
from navcore.explain import explain
from navcore.geometry import FloatArray
from navcore.wire import Event, Point2, RouteChanged, WalkerState

NUMBERS = (
    "x_m", "y_m", "heading_rad", "position_std_m", "deviation_m", "remaining_m", "nearest_ahead_m", "sonar_m",
    "speed_m_s",
)  # fmt: skip
"""Columns that hold numbers; NaN where there is none."""
WORDS = ("quality", "action", "reason", "mode", "sonar_state", "destination_id")
"""Columns that hold words, as indices into :attr:`Timeline.words`."""

TRAIL_S = 60.0
_TRAIL_POINTS = 240


@dataclass(frozen=True, slots=True)
class NamedPlace:
    """A place of the road as a recording has it."""

    name: str
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class Stamped:
    """Something that happened, on the timeline's clock."""

    stamp_s: float
    kind: str
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """The states of a device, one row each."""

    numbers: dict[str, NDArray[np.float32]]
    """Columns (n,) of :data:`NUMBERS`."""
    codes: dict[str, NDArray[np.int16]]
    """Columns (n,) of :data:`WORDS`."""
    words: tuple[str, ...]
    """What the codes stand for."""


class ColumnsBuilder:
    """Takes states, one after the other."""

    def __init__(self) -> None:
        self._rows: list[tuple[Any, ...]] = []
        self._words: dict[str, int] = {"": 0}

    def __len__(self) -> int:
        """Return how many states there are."""
        return len(self._rows)

    def add(self, state: WalkerState) -> None:
        """Add a state."""
        x_m, y_m, _, heading_rad = state.pose or (None, None, None, None)
        numbers = (
            x_m, y_m, heading_rad, state.position_std_m, state.deviation_m, state.remaining_m, state.nearest_ahead_m,
            state.sonar_m, state.speed_m_s,
        )  # fmt: skip
        words = (
            state.quality, state.action, state.reason, state.mode.value, state.sonar_state, state.destination_id or "",
        )  # fmt: skip
        codes = (self._words.setdefault(word, len(self._words)) for word in words)
        self._rows.append((*(math.nan if value is None else value for value in numbers), *codes))

    def columns(self) -> Columns:
        """Return what was added; there must be something."""
        columns = list(zip(*self._rows, strict=True))
        return Columns(
            {name: np.array(columns[index], np.float32) for index, name in enumerate(NUMBERS)},
            {name: np.array(columns[len(NUMBERS) + index], np.int16) for index, name in enumerate(WORDS)},
            tuple(self._words),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Timeline(ABC):
    """What is known of a stretch of the past. All times are on one clock, whichever it is."""

    stamps_s: FloatArray
    """(n,) of the cycles, ascending."""
    columns: Columns
    events: tuple[Event, ...]
    orders: tuple[Stamped, ...]
    """What was asked of the device: kind of the order, and what came with it."""
    routes: tuple[RouteChanged, ...]
    places: tuple[NamedPlace, ...]
    roads: tuple[tuple[Point2, ...], ...]
    """Lines of the road."""
    troubles: tuple[str, ...]
    """What of it is missing or damaged, in sentences."""

    @property
    def began_s(self) -> float:
        """The first cycle."""
        return float(self.stamps_s[0])

    @property
    def ended_s(self) -> float:
        """The last cycle, or the end of what is known."""
        return float(self.stamps_s[-1])

    @property
    def numbers(self) -> dict[str, NDArray[np.float32]]:
        """Columns (n,) of :data:`NUMBERS`."""
        return self.columns.numbers

    def is_word(self, column: str, *words: str) -> NDArray[np.bool_]:
        """Return (n,) whether a column holds one of these words."""
        wanted = [index for index, word in enumerate(self.columns.words) if word in words]
        return np.isin(self.columns.codes[column], wanted)

    def word(self, column: str, index: int) -> str:
        """Return the word of a cycle."""
        return self.columns.words[int(self.columns.codes[column][index])]

    def sentence_at(self, index: int) -> str:
        """Return why the walker was told in a cycle what they were told."""
        state = self.state_at(index)
        return reason_sentence(self.word("reason", index)) if state is None else explain(state).sentence

    def index_at(self, stamp_s: float) -> int:
        """Return the cycle that was the newest at a time; the first one before the beginning."""
        return max(0, int(np.searchsorted(self.stamps_s, stamp_s, side="right")) - 1)

    def route_at(self, stamp_s: float) -> RouteChanged | None:
        """Return the route that was walked then."""
        found = bisect_right(self.routes, stamp_s, key=lambda route: route.stamp_s)
        return self.routes[found - 1] if found else None

    def trail_until(self, stamp_s: float) -> FloatArray:
        """Return where the walker had been in the last minute until then, points (n, 2), the newest last."""
        begin, end = self.index_at(stamp_s - TRAIL_S), self.index_at(stamp_s) + 1
        points_m = np.column_stack([self.numbers["x_m"][begin:end], self.numbers["y_m"][begin:end]]).astype(np.float64)
        points_m = points_m[np.isfinite(points_m).all(axis=1)]
        return points_m[:: max(1, len(points_m) // _TRAIL_POINTS)]

    @abstractmethod
    def state_at(self, index: int) -> WalkerState | None:
        """Return the state of a cycle; None where it cannot be read any more."""

    @abstractmethod
    def device_at(self, stamp_s: float) -> LiveDevice:
        """Return the device as the console knew it then. Raises NotFoundError where its files are gone meanwhile."""

    @abstractmethod
    def depth_stamp_s(self, stamp_s: float) -> float | None:
        """Return the time of the depth silhouette that was the newest then; None where there was none."""

    @abstractmethod
    def depth_jpeg(self, stamp_s: float) -> bytes:
        """Return the depth silhouette that was the newest then. Raises NotFoundError."""
