"""The simulated world: it alone knows the truth. The product meets it only through the ports of :mod:`adapters`."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np

from device_agent.simulation.building import (
    Building,
    Mover,
    Place,
    Start,
    checked_seed,
    push_from_solids,
    renderer_of,
    touchable,
)
from device_agent.simulation.conditions import EASY, Conditions, captured
from device_agent.simulation.courtesy import Courtesy, Seen, beside_path, given_way
from device_agent.simulation.gait import USUAL_GAIT, USUAL_MOUNT, Gait, HeadMount, advance_phase, head_pose
from device_agent.simulation.renderer import Placement, Renderer
from device_agent.simulation.sensors import (
    USUAL_COLOUR_NOISE,
    USUAL_DEPTH_NOISE,
    CameraModel,
    ColourNoise,
    DepthNoise,
    head_camera,
)
from device_agent.simulation.sonar import SonarModel
from device_agent.simulation.walker import WalkerBody, WalkerParameters, hear, step
from navcore.cues.table import Cue
from navcore.errors import InputError
from navcore.geometry import FloatArray, Transform
from navcore.types import CameraIntrinsics, Frame, SonarReading

_TICK_S = 0.02
_LONGEST_S = 600.0
_ROOM_FOR_A_PERSON_M = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class TruthLog:
    """Where the walker truly was, sample by sample (``_TICK_S`` apart): for evaluation, never for guidance."""

    stamp_s: FloatArray
    position_m: FloatArray
    """(n, 2)."""
    heading_rad: FloatArray
    contacts: np.ndarray
    """Episodes of contact up to each sample (n,)."""


def start_at(building: Building, place_name: str) -> Start:
    """Return a start at a place, facing the way by which the road leaves it. Raises InputError for an unknown place."""
    place: Place = building.place(place_name)
    corners = np.asarray(building.road_waypoints, np.float64)
    at = np.flatnonzero(np.hypot(corners[:-1, 0] - place.x_m, corners[:-1, 1] - place.y_m) < 0.05)
    if not len(at):
        raise InputError(f"The road does not lead to {place_name}: start at a place on the road.")
    away = corners[at[0] + 1] - corners[at[0]]
    return Start(place.x_m, place.y_m, math.atan2(float(away[1]), float(away[0])))


class SimulatedWorld:
    """A building, somebody who walks in it by what they hear, and what their sensors sense. Safe for several threads.

    The same arguments, and the same calls, give the same bytes.
    """

    def __init__(
        self,
        building: Building,
        walker: WalkerParameters,
        start: Start,
        seed: int = 0,
        *,
        size_px: tuple[int, int] = (320, 240),
        start_s: float = 0.0,
        gait: Gait = USUAL_GAIT,
        mount: HeadMount = USUAL_MOUNT,
        depth_noise: DepthNoise = USUAL_DEPTH_NOISE,
        colour_noise: ColourNoise = USUAL_COLOUR_NOISE,
        renderer: Renderer | None = None,
        conditions: Conditions = EASY,
    ) -> None:
        """``renderer`` may be shared by worlds in the same building, one after the other: building one takes seconds.

        ``conditions`` hamper the camera.

        Raises InputError where the walker would stand inside something.
        """
        checked_seed(seed)
        self._solids = touchable(building.solids)
        clearance_m, _ = push_from_solids(self._solids, start.x_m, start.y_m)
        if clearance_m < walker.body_radius_m:
            raise InputError(f"Nobody can stand at ({start.x_m:g}, {start.y_m:g}): choose a start that is free.")
        self.building = building
        self._walker, self._gait, self._mount = walker, gait, mount
        self._renderer = renderer_of(building) if renderer is None else renderer
        self._conditions = conditions
        self._camera_model = CameraModel(head_camera(*size_px), seed, depth_noise, colour_noise)
        self._sonar_model = SonarModel(building.surfaces, building.mover_surfaces, seed)
        self._rng = np.random.default_rng([seed, 7])
        self._start_s = start_s
        self._body = WalkerBody(start_s, start.x_m, start.y_m, start.heading_rad)
        self._phase_rad = 0.0
        self._frames = self._pings = 0
        self._courtesies = [Courtesy()] * len(building.movers)
        self._log: list[tuple[float, float, float, float, int]] = []
        self._lock = threading.RLock()
        self._note()

    @property
    def camera(self) -> CameraIntrinsics:
        """Geometry of the walker's camera."""
        return self._camera_model.camera

    def now_s(self) -> float:
        """Time of the world, seconds, on the scale of ``start_s``."""
        with self._lock:
            return self._body.time_s

    def advance(self, dt_s: float) -> None:
        """Let time pass."""
        self.advance_to(self.now_s() + dt_s)

    def advance_to(self, stamp_s: float) -> None:
        """Let time pass up to a stamp; one in the past changes nothing. Raises InputError for a leap of minutes."""
        with self._lock:
            remaining_s = stamp_s - self._body.time_s
            if remaining_s > _LONGEST_S:
                raise InputError(
                    f"The simulation cannot leap {remaining_s:.0f} s: was the clock changed? Start it again."
                )
            while remaining_s > 1e-9:
                dt_s = min(_TICK_S, remaining_s)
                self._tick(dt_s)
                remaining_s = stamp_s - self._body.time_s

    def hear(self, cue: Cue) -> None:
        """Let the walker hear a cue, now."""
        with self._lock:
            self._body = hear(self._body, cue, self._walker, self._rng)

    def capture(self) -> Frame:
        """Return what the camera captures now."""
        with self._lock:
            time_s, head = self._body.time_s, self._head()
            view = self._renderer.render(self.camera, head, self._placements(time_s))
            yaw_rate_rad_s = self._body.yaw_rate_rad_s
            number, self._frames = self._frames, self._frames + 1
        since_start_s = time_s - self._start_s
        return captured(
            self._camera_model, view, head, time_s, number, yaw_rate_rad_s, since_start_s, self._conditions
        )  # fmt: skip

    def ping(self) -> SonarReading:
        """Return what the ultrasonic rangefinder measures now, along the camera's axis."""
        with self._lock:
            time_s = self._body.time_s
            number, self._pings = self._pings, self._pings + 1
            return self._sonar_model.measure(time_s, self._head(), number, self._placements(time_s))

    def knock(self, mount: HeadMount) -> None:
        """Let the camera sit otherwise on the head from now on, as if somebody had knocked against the glasses."""
        with self._lock:
            self._mount = mount

    def truth(self) -> WalkerBody:
        """Return where the walker truly is. For evaluation only."""
        with self._lock:
            return self._body

    def true_head(self) -> Transform:
        """Return the true ``world_from_camera``. For evaluation only."""
        with self._lock:
            return self._head()

    def truth_log(self) -> TruthLog:
        """Return where the walker has truly been. For evaluation only."""
        with self._lock:
            table = np.asarray(self._log, np.float64)
        return TruthLog(table[:, 0], table[:, 1:3], table[:, 3], table[:, 4].astype(np.int64))

    def _tick(self, dt_s: float) -> None:
        placements = self._placements(self._body.time_s + dt_s)
        self._give_way(placements, dt_s)
        moving = touchable(self.building.moving_solids(placements))
        self._body = step(self._body, self._walker, self._solids, moving, dt_s, self._rng)
        self._phase_rad = advance_phase(self._phase_rad, self._body.speed_mps, dt_s, self._gait)
        self._note()

    def _placements(self, time_s: float) -> tuple[Placement | None, ...]:
        since_s = time_s - self._start_s
        return tuple(
            beside_path(mover.placement_at(since_s - courtesy.waited_s), courtesy)
            for mover, courtesy in zip(self.building.movers, self._courtesies, strict=True)
        )

    def _give_way(self, placements: tuple[Placement | None, ...], dt_s: float) -> None:
        """People who walk their way give way to the walker; whatever else moves knows itself what it does."""
        body = self._body
        c, s = math.cos(body.heading_rad), math.sin(body.heading_rad)
        seen = Seen(body.x_m, body.y_m, body.speed_mps * c, body.speed_mps * s)
        for number, (mover, placement) in enumerate(zip(self.building.movers, placements, strict=True)):
            if placement is not None and isinstance(mover, Mover):
                courtesy = self._courtesies[number]
                late_s = self._start_s + courtesy.waited_s
                walks = mover.moves_between(self._body.time_s - late_s, self._body.time_s + dt_s - late_s)
                back = beside_path(mover.placement_at(self._body.time_s - late_s), courtesy)
                self._courtesies[number] = given_way(
                    courtesy, placement, seen, self._has_room, dt_s, walks=walks, back=back
                )

    def _has_room(self, x_m: float, y_m: float) -> bool:
        return push_from_solids(self._solids, x_m, y_m)[0] >= _ROOM_FOR_A_PERSON_M

    def _note(self) -> None:
        body = self._body
        self._log.append((body.time_s, body.x_m, body.y_m, body.heading_rad, body.contacts))

    def _head(self) -> Transform:
        body = self._body
        return head_pose(
            body.x_m,
            body.y_m,
            body.heading_rad,
            body.time_s - self._start_s,
            self._phase_rad,
            body.speed_mps,
            self._gait,
            self._mount,
        )
