"""Where along the road localization is, or may be, weak: from the map's key frames, and from the warnings of its walk.

A pose is found by what key frames near it show. Where the map itself is not sure of their place, a pose cannot be
surer; where they show few landmarks, or there are none near, it may not be found.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from navcore.geometry import FloatArray
from navcore.map_check.evidence import MapEvidence, WeakPlace, spaced
from navcore.map_check.finding import Finding
from navcore.settings import Settings

MAX_KEYFRAME_DISTANCE_M = 2.5
"""A key frame farther off than this shows another view: the map walk makes one about every metre."""
MIN_STRETCH_M = 1.0
"""Shorter than this is passed before the pose is "Uncertain": it is carried on meanwhile."""

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class _KeyFrames:
    places_m: FloatArray
    """(k, 2)."""
    deviation_m: FloatArray
    """(k,): standard deviation of the position in the map, along its worst direction."""
    landmark_counts: NDArray[np.int64]
    """(k,)."""


def weak_localization(evidence: MapEvidence) -> Iterator[Finding]:
    """Find the stretches where localization is, or may be, weak."""
    for weak in evidence.weak:
        text = f"Localization may be weak here, for {weak.length_m:.1f} m: {weak.reason}."
        action = "Record another walk here, slowly, with light, and looking ahead; then join it to the map."
        roads = evidence.road_ids_at(weak.x_m, weak.y_m)
        yield Finding("weak_localization", "warning", text, action, weak.x_m, weak.y_m, road_ids=roads)


def weak_places(
    map_arrays: Arrays, report: Mapping[str, Any], lines_m: Sequence[FloatArray], settings: Settings
) -> tuple[WeakPlace, ...]:
    """Return the weak stretches of a road.

    Args:
        map_arrays: the site's map (:data:`navcore.slam.map_arrays.SHAPES`); what it lacks is not looked at.
        report: the site's report, which may hold the warnings of the map walk.
        lines_m: the road as polylines (n, 2).
        settings: what is uncertain, and how few landmarks are few.
    """
    warned = tuple(_warnings(report))
    frames = _key_frames(map_arrays)
    if frames is None:
        return warned
    return warned + tuple(weak for line in lines_m if len(line) > 1 for weak in _along(line, frames, settings))


def _warnings(report: Mapping[str, Any]) -> Iterator[WeakPlace]:
    """Return what the map walk was warned of. A report is written for people: what is of another form is left out."""
    stretches = report.get("weak_stretches")
    for stretch in stretches if isinstance(stretches, Sequence) and not isinstance(stretches, str) else ():
        try:
            x_m, y_m, length_m = (float(stretch[name]) for name in ("x_m", "y_m", "length_m"))
            kinds = ", ".join(str(kind).replace("_", " ") for kind in stretch["kinds"])
        except (KeyError, TypeError, ValueError):
            continue
        if np.isfinite([x_m, y_m, length_m]).all():
            yield WeakPlace(x_m, y_m, length_m, f"the map walk was warned of it ({kinds})")


def _key_frames(arrays: Arrays) -> _KeyFrames | None:
    names = ("camera_from_world", "keyframe_covariance", "feature_start", "feature_landmark")
    if any(name not in arrays for name in names) or not len(arrays["camera_from_world"]):
        return None
    poses, covariances, start, landmark = (arrays[name] for name in names)
    places = -np.einsum("kji,kj->ki", poses[:, :3, :3], poses[:, :3, 3])
    seen = np.concatenate([[0], np.cumsum(landmark >= 0)])
    deviation = np.sqrt(np.maximum(np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1], 0.0))
    return _KeyFrames(places[:, :2], deviation, seen[start[1:]] - seen[start[:-1]])


def _along(line_m: FloatArray, frames: _KeyFrames, settings: Settings) -> Iterator[WeakPlace]:
    points = spaced(np.asarray(line_m, np.float64)[:, :2])
    # Of the key frames near a point, the best one counts: it is the one that a pose is found by.
    near = cKDTree(frames.places_m).query_ball_point(points, MAX_KEYFRAME_DISTANCE_M)
    reasons = [_reason(np.array(close, np.int64), frames, settings) for close in near]
    begin = 0
    for reason, group in itertools.groupby(reasons):
        end = begin + len(list(group))
        stretch = points[begin:end]
        length_m = float(np.hypot(*np.diff(stretch, axis=0).T).sum())
        if reason is not None and length_m >= MIN_STRETCH_M:
            x_m, y_m = stretch[len(stretch) // 2].tolist()
            yield WeakPlace(x_m, y_m, length_m, reason)
        begin = end


def _reason(close: NDArray[np.int64], frames: _KeyFrames, settings: Settings) -> str | None:
    if not len(close):
        return "the map has no view from near here"
    if float(frames.deviation_m[close].min()) > settings.localization.uncertain_position_m:
        return "the map itself is not sure of its place"
    if int(frames.landmark_counts[close].max()) < settings.map_walk.landmarks_count:
        return "the views here show few landmarks"
    return None
