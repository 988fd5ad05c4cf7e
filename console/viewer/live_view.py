"""What is known of a walker at one instant, and how far it can still be believed. Pure values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from console.live import Freshness, LiveDevice, freshness
from navcore.angles import wrap_rad
from navcore.geometry import FloatArray
from navcore.wire import WalkerState

CUE_SHOWN_S = 6.0
WALKING_SPEED_M_S = 1.0
_LARGEST_DISC_M = 15.0
_TRAIL_SPACING_M = 0.25
_TRAIL_POINTS_COUNT = 240


@dataclass(frozen=True, slots=True)
class PastMark:
    """Says of a view that it is of the past."""

    words: str
    console_s: float
    """The console's monotonic clock now: the scene itself is as young as ever."""


@dataclass(frozen=True, slots=True, eq=False)
class LiveView:
    """One device at one instant, as the scene shows it; ``device`` is None while none has ever connected."""

    device: LiveDevice | None = None
    now_s: float = 0.0
    """The console's monotonic clock."""
    silhouette_rgb: NDArray[np.uint8] | None = None
    """The latest depth silhouette, decoded."""
    trail_m: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    """Where the walker has been, points (n, 2), the newest last."""
    trail_deviations_m: FloatArray | None = None
    """How far off the route the walker was at each (n,); NaN where there was no route."""
    others: tuple[LiveDevice, ...] = ()
    """The other devices."""
    past: PastMark | None = None
    """Where this is of a past walk: ``now_s`` is on the clock of then."""

    @property
    def state(self) -> WalkerState | None:
        """The latest state of the walker."""
        return self.device.state if self.device is not None else None

    @property
    def age_s(self) -> float | None:
        """Seconds since the frame behind the state was captured."""
        return self.device.age_s(self.now_s) if self.device is not None else None

    @property
    def freshness(self) -> Freshness:
        """How far this can be believed."""
        return self.device.freshness(self.now_s) if self.device is not None else Freshness.LOST

    @property
    def is_believed(self) -> bool:
        """Whether what the device saw and decided may still hold; older than that it is not drawn."""
        return self.freshness in (Freshness.LIVE, Freshness.DELAYED)

    @property
    def is_silhouette_believed(self) -> bool:
        """Whether the depth image, which comes more rarely than the state, may still hold."""
        age_s = self.device.depth_age_s(self.now_s) if self.device is not None else None
        if self.device is None or age_s is None:
            return False
        age_s += self.device.clock_uncertainty_s or 0.0
        return freshness(age_s, self.device.connected) in (Freshness.LIVE, Freshness.DELAYED)

    @property
    def uncertainty_m(self) -> float:
        """Radius of the disc that holds the walker: the pose's own, growing at walking speed with its age."""
        longest_age_s = self.device.longest_age_s(self.now_s) if self.device is not None else None
        if self.state is None or longest_age_s is None:
            return 0.0
        own_m = 2.0 * (self.state.position_std_m or 0.1)
        moved_m = max(0.0, longest_age_s - 0.5) * WALKING_SPEED_M_S
        return min(own_m + moved_m, _LARGEST_DISC_M)

    @property
    def cue(self) -> str:
        """What was said last, while it is recent by the device's own clock; empty otherwise."""
        state = self.state
        if state is None or state.last_cue_stamp_s is None or not self.is_believed:
            return ""
        return state.last_cue if state.stamp_s - state.last_cue_stamp_s <= CUE_SHOWN_S else ""

    @property
    def route_m(self) -> FloatArray:
        """The planned route, points (n, 2)."""
        points = self.device.route.points_m if self.device is not None and self.device.route is not None else ()
        return np.array(points, dtype=np.float64).reshape(-1, 2)

    @property
    def closest_m(self) -> tuple[float, float] | None:
        """P_cls: the point of the route closest to the walker (Eq. 1)."""
        route_m = self.route_m
        if self.state is None or self.state.pose is None or len(route_m) == 0:
            return None
        x_m, y_m = route_m[int(np.argmin(np.hypot(*(route_m - np.array(self.state.pose[:2])).T)))]
        return float(x_m), float(y_m)


def direction_words(angle_rad: float) -> str:
    """Return a relative direction in words: “straight ahead”, “30° left”."""
    degrees = round(math.degrees(wrap_rad(angle_rad)))
    if abs(degrees) < 5:
        return "straight ahead"
    return f"{abs(degrees)}° {'left' if degrees > 0 else 'right'}"


class Trail:
    """Where a walker has been: grows with every state, forgets the oldest, and starts anew after a jump."""

    def __init__(self) -> None:
        self._points_m: list[tuple[float, float]] = []
        self._deviations_m: list[float] = []
        self.points_m: FloatArray = np.zeros((0, 2))
        """Points (n, 2), the newest last."""
        self.deviations_m: FloatArray = np.zeros(0)
        """How far off the route each of them is (n,); NaN where there was no route."""

    def add(self, state: WalkerState) -> None:
        """Add the position of a state, where it has one and has moved."""
        if state.pose is None:
            return
        point = state.pose[0], state.pose[1]
        if self._points_m:
            moved_m = math.dist(point, self._points_m[-1])
            if moved_m < _TRAIL_SPACING_M:
                return
            if moved_m > 3.0:
                self._points_m.clear()
                self._deviations_m.clear()
        self._points_m.append(point)
        self._deviations_m.append(state.deviation_m if state.deviation_m is not None else math.nan)
        del self._points_m[:-_TRAIL_POINTS_COUNT], self._deviations_m[:-_TRAIL_POINTS_COUNT]
        self.points_m, self.deviations_m = np.array(self._points_m), np.array(self._deviations_m)
