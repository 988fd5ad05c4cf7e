"""Obstacle detection on a real recording, against the measured box of a cabinet on a bare floor.

    python benchmarks/obstacle_cabinet.py RECORDING [--json]

RECORDING is in the TUM RGB-D layout, with ``groundtruth.txt`` and ``truth_objects.txt`` (x y z yaw and half-sizes of a
box, metres, in the world of the ground truth). The true pose stands in for localization, for levelling; the same is
done with the floor plane of the image alone. Detected distances and bearings are compared with where the rays of the
same bearings meet the box on the floor plan. Prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from navcore.errors import RecordingError, VbrError
from navcore.geometry import FloatArray, Transform, heading_of_camera, rotation_about_z
from navcore.obstacle.scan import scan
from navcore.recording import open_recording, read_trajectory
from navcore.settings import ObstacleSettings
from navcore.types import BearingState, ObstacleScan

_NEAR_M = 4.0
"""Only what the truth has nearer than this is asked for."""
_EDGE_RAD = math.radians(1.5)
"""Bearings this near to the box's edges are not judged: the box was measured to centimetres, not millimetres."""
_AGREES_M = 0.3


@dataclass(frozen=True, slots=True)
class Box:
    """An upright box on the floor."""

    centre_m: FloatArray
    yaw_rad: float
    half_m: FloatArray

    def distances_m(self, origin_m: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Return where rays (n) on the floor plan enter the box; inf where they miss it."""
        turn = rotation_about_z(-self.yaw_rad)[:2, :2]
        local = turn @ (origin_m - self.centre_m[:2])
        rays = np.stack([np.cos(bearing_rad - self.yaw_rad), np.sin(bearing_rad - self.yaw_rad)], axis=1)
        rays = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
        first, second = (-self.half_m[:2] - local) / rays, (self.half_m[:2] - local) / rays
        enter, leave = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
        return np.where((leave >= enter) & (enter > 0), enter, np.inf)


def read_boxes(path: Path) -> list[Box]:
    """Read ``truth_objects.txt``. Raises RecordingError."""
    try:
        table = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path} cannot be read ({error}): it needs lines of x y z yaw and half-sizes.") from error
    if table.shape[1] != 7:
        raise RecordingError(f"{path} needs seven numbers a line: x y z yaw and three half-sizes.")
    return [Box(row[:3], float(row[3]), row[4:7]) for row in table]


@dataclass(frozen=True, slots=True)
class FrameResult:
    """One frame against the truth."""

    true_count: int
    hit_count: int
    claimed_count: int
    false_count: int
    floor_count: int
    distance_error_m: float | None
    bearing_error_deg: float | None


def judge(found: ObstacleScan, pose: Transform, boxes: list[Box]) -> FrameResult:
    """Compare a scan with the boxes as seen from a true pose."""
    heading = heading_of_camera(pose)
    origin = pose.translation[:2]
    bearing = found.bearing_rad
    truth = _nearest_box(boxes, origin, heading + bearing)
    beside = (
        _nearest_box(boxes, origin, heading + bearing - _EDGE_RAD),
        _nearest_box(boxes, origin, heading + bearing + _EDGE_RAD),
    )
    is_box = (truth < _NEAR_M) & np.isfinite(beside[0]) & np.isfinite(beside[1])
    is_floor = ~np.isfinite(truth) & ~np.isfinite(beside[0]) & ~np.isfinite(beside[1])
    seen = (found.state == BearingState.OBSTACLE) | (found.state == BearingState.DROP)
    nearest = np.where(seen, found.nearest_m, np.inf)
    both = is_box & np.isfinite(nearest)
    agrees = both.copy()
    agrees[both] = np.abs(nearest[both] - truth[both]) < _AGREES_M
    # What stands farther away than the box's surroundings is the room, not the floor.
    false = is_floor & (nearest < _floor_reach_m(truth))
    distance = bearing_error = None
    if agrees.any():
        distance = float(np.median(nearest[agrees] - truth[agrees]))
        edge = bearing[np.isfinite(truth)]
        found_edge = bearing[seen & (np.abs(nearest - np.nanmin(truth)) < 1.0)]
        if len(found_edge):
            bearing_error = math.degrees(float((found_edge.min() + found_edge.max() - edge.min() - edge.max()) / 2))
    return FrameResult(
        int(is_box.sum()), int(agrees.sum()), int((agrees | false).sum()), int(false.sum()), int(is_floor.sum()),
        distance, bearing_error,
    )  # fmt: skip


def _nearest_box(boxes: list[Box], origin: FloatArray, bearing: FloatArray) -> FloatArray:
    return np.min([box.distances_m(origin, bearing) for box in boxes], axis=0)


def _floor_reach_m(truth: FloatArray) -> float:
    """The floor round the box is known to be bare as far as the box itself is away."""
    return float(np.min(truth)) if np.isfinite(truth).any() else 2.0


def evaluate(folder: Path, level_by_pose: bool) -> dict[str, Any]:
    """Return the figures over all frames of a recording. Raises RecordingError."""
    recording = open_recording(folder)
    boxes = read_boxes(folder / "truth_objects.txt")
    stamps, poses = read_trajectory(folder / "groundtruth.txt")
    results = []
    for entry in recording.entries:
        pose = poses[int(np.argmin(np.abs(stamps - entry.stamp_s)))]
        frame = recording.read(entry)
        found = scan(frame.depth_m, recording.intrinsics, pose if level_by_pose else None, ObstacleSettings())
        results.append(judge(found, pose, boxes))
    with_box = [result for result in results if result.true_count]
    distances = [abs(r.distance_error_m) for r in results if r.distance_error_m is not None]
    bearings = [abs(r.bearing_error_deg) for r in results if r.bearing_error_deg is not None]
    return {
        "frames": len(results),
        "frames_with_box": len(with_box),
        "frames_found": sum(r.hit_count > 0 for r in with_box),
        "bearing_recall": _share(sum(r.hit_count for r in results), sum(r.true_count for r in results)),
        "bearing_precision": _share(sum(r.hit_count for r in results), sum(r.claimed_count for r in results)),
        "distance_error_median_m": _median(distances),
        "bearing_error_median_deg": _median(bearings),
        "floor_bearings": sum(r.floor_count for r in results),
        "false_floor_bearings": sum(r.false_count for r in results),
    }


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 4) if whole else None


def _median(values: list[float]) -> float | None:
    return round(float(np.median(values)), 4) if values else None


def main() -> int:
    """Print the figures; 1 where the recording cannot be read."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--json", action="store_true", help="on one line")
    arguments = parser.parse_args()
    try:
        figures = {
            "levelled_by_pose": evaluate(arguments.recording, True),
            "levelled_by_floor": evaluate(arguments.recording, False),
        }
    except VbrError as error:
        print(error, file=sys.stderr)
        return 1
    print(json.dumps(figures, indent=None if arguments.json else 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
