"""What came of a walk: arrival, contacts, deviation, time. Here, and only here, the truth is looked at."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from device_agent.cycle import Cycle
from device_agent.simulation.walker import WalkerBody
from navcore.cues.table import Cue
from navcore.geometry import FloatArray
from navcore.modes import ON_THE_WAY, Mode
from navcore.types import LocalizationQuality, Route

ARRIVED_WITHIN_M = 2.0
"""Who says "arrived" farther than this from the true place has not."""
_MIN_ALIGNED_COUNT = 10


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One cycle, and where the walker truly was then."""

    cycle: Cycle
    true_m: FloatArray
    """(2,): true head position in the building."""
    mode: Mode
    """After the cycle; in a fault, the state beneath it."""
    route: Route | None


@dataclass(frozen=True, slots=True, eq=False)
class WalkResult:
    """What came of a walk. Deviations are of the true head position from the planned route, metres; NaN: unknown."""

    arrived: bool
    """The device said so, and the walker truly stood near the place."""
    outcome: str
    """How it ended, in words."""
    contacts: int
    """Times that the walker touched something."""
    deviation_max_m: float
    deviation_mean_m: float
    deviation_variance_m2: float
    seconds: float
    """Simulated duration, to the end of guidance."""
    cycles: int
    median_ms: float
    """Of a cycle's work on the device, from the frame to the cue, without rendering the simulation."""
    p95_ms: float
    localized_fraction: float
    """Share of the frames whose pose was known."""
    localization_rmse_m: float
    """Of the located positions on the floor against the true ones, after aligning the two frames of reference."""
    end_distance_m: float
    """True distance of the body from the destination at the end; NaN where the building does not know the place."""
    route_length_m: float
    cues: tuple[Cue, ...]
    route_m: FloatArray
    """The planned route (n, 2), in the map."""
    path_m: FloatArray
    """The true path (k, 2) while guiding, in the map."""
    map_from_building: FloatArray
    """Rigid transform on the floor (3, 3); NaN where the walker was not located, or did not move."""
    reasons: dict[str, int]
    """How many cycles ended with each reason."""


def measured(
    samples: Sequence[Sample], body: WalkerBody, place_m: FloatArray | None, cues: tuple[Cue, ...]
) -> WalkResult:
    """Return the figures of a walk: its samples, the walker's body at its end, and where the place truly is."""
    map_from_building, rmse_m = _alignment(samples)
    deviations_m, path_m = _deviations(samples, map_from_building)
    said = any(sample.mode is Mode.ARRIVED for sample in samples)
    distance_m = math.nan if place_m is None else math.hypot(body.x_m - place_m[0], body.y_m - place_m[1])
    near = place_m is None or distance_m <= ARRIVED_WITHIN_M
    guided = [sample for sample in samples if sample.mode in ON_THE_WAY]
    work_ms = np.array([sample.cycle.work_ms for sample in guided or samples])
    routes = [sample.route for sample in samples if sample.route is not None]
    return WalkResult(
        arrived=said and near,
        outcome=_outcome(samples, said, near),
        contacts=body.contacts,
        deviation_max_m=float(deviations_m.max()) if len(deviations_m) else math.nan,
        deviation_mean_m=float(deviations_m.mean()) if len(deviations_m) else math.nan,
        deviation_variance_m2=float(deviations_m.var()) if len(deviations_m) else math.nan,
        seconds=(guided or samples)[-1].cycle.stamp_s - samples[0].cycle.stamp_s,
        cycles=len(samples),
        median_ms=float(np.median(work_ms)),
        p95_ms=float(np.percentile(work_ms, 95)),
        localized_fraction=_localized_fraction(samples),
        localization_rmse_m=rmse_m,
        end_distance_m=distance_m,
        route_length_m=routes[0].length_m if routes else math.nan,
        cues=cues,
        route_m=routes[0].points_m if routes else np.zeros((0, 2)),
        path_m=path_m,
        map_from_building=map_from_building,
        reasons=dict(Counter(sample.cycle.guidance.reason.value for sample in samples)),
    )


def _outcome(samples: Sequence[Sample], said: bool, near: bool) -> str:
    if said:
        return "arrived" if near else "said to have arrived, but at another place"
    last = samples[-1]
    why = last.cycle.fault or last.cycle.guidance.trace.rule
    return f"not arrived: {last.cycle.guidance.reason.sentence} ({why})"


def _localized_fraction(samples: Sequence[Sample]) -> float:
    known = [
        sample.cycle.localization is not None and sample.cycle.localization.quality is not LocalizationQuality.LOST
        for sample in samples
    ]
    return sum(known) / len(known)


def _alignment(samples: Sequence[Sample]) -> tuple[FloatArray, float]:
    """Return the rigid transform on the floor, (3, 3), that takes true positions into the map, and the remaining RMSE.

    Least squares over the located frames (Umeyama 1991, without scale). NaN where too few were located, or the walker
    did not move.
    """
    pairs = [
        (sample.true_m, (pose.x_m, pose.y_m))
        for sample in samples
        if (located := sample.cycle.localization) is not None and (pose := located.pose) is not None
    ]
    unknown = np.full((3, 3), np.nan)
    if len(pairs) < _MIN_ALIGNED_COUNT:
        return unknown, math.nan
    true, located_m = (np.array(side, dtype=np.float64) for side in zip(*pairs, strict=True))
    if float(np.ptp(true, axis=0).max()) < 1.0:
        return unknown, math.nan
    return _rigid(true, located_m)


def _rigid(source: FloatArray, target: FloatArray) -> tuple[FloatArray, float]:
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    angle = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    c, s = math.cos(angle), math.sin(angle)
    rotation = np.array([[c, -s], [s, c]])
    transform = np.eye(3)
    transform[:2, :2] = rotation
    transform[:2, 2] = target.mean(axis=0) - rotation @ source.mean(axis=0)
    residual = b - a @ rotation.T
    return transform, float(np.sqrt((residual**2).sum(axis=1).mean()))


def _deviations(samples: Sequence[Sample], map_from_building: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distance (k,) of the true path from the route then planned, and that path (k, 2) in the map."""
    deviations: list[float] = []
    path: list[FloatArray] = []
    for sample in samples:
        if sample.mode not in ON_THE_WAY or sample.route is None or np.isnan(map_from_building[0, 0]):
            continue
        here = map_from_building[:2, :2] @ sample.true_m + map_from_building[:2, 2]
        path.append(here)
        deviations.append(distance_to_polyline_m(here, sample.route.points_m))
    return np.array(deviations), np.array(path).reshape(-1, 2)


def distance_to_polyline_m(point_m: FloatArray, polyline_m: FloatArray) -> float:
    """Return the distance of a point (2,) from a polyline (n, 2), n ≥ 1."""
    if len(polyline_m) == 1:
        return float(np.hypot(*(point_m - polyline_m[0])))
    begins, steps = polyline_m[:-1], np.diff(polyline_m, axis=0)
    share = ((point_m - begins) * steps).sum(axis=1) / np.maximum((steps**2).sum(axis=1), 1e-12)
    nearest = begins + np.clip(share, 0.0, 1.0)[:, None] * steps
    return float(np.hypot(*(point_m - nearest).T).min())
