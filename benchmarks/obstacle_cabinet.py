"""Obstacle detection on a real recording, against the measured box of a cabinet on a bare floor.

    python benchmarks/obstacle_cabinet.py RECORDING [--json] [--frames CSV]

RECORDING is in the TUM RGB-D layout, with ``groundtruth.txt`` and ``truth_objects.txt`` (x y z yaw and half-sizes of a
box, metres, in the world of the ground truth). The true pose stands in for localization, for levelling; the same is
done with the floor plane of the image alone. Detected distances and bearings are compared with where the rays of the
same bearings meet the box on the floor plan. Prints one JSON object; ``--frames`` writes a row for each frame.
"""

from __future__ import annotations

import argparse
import csv
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
    distance_errors_m: FloatArray
    """Found minus true distance of each bearing that agrees."""
    edge_errors_deg: FloatArray
    """Found minus true bearing of the box's right and left end in the image (2); empty where it is not found."""


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
    edges = np.empty(0)
    if agrees.any():
        true_edges = bearing[np.isfinite(truth)]
        found_edges = bearing[seen & (np.abs(nearest - np.nanmin(truth)) < 1.0)]
        if len(found_edges):
            edges = np.degrees([found_edges.min() - true_edges.min(), found_edges.max() - true_edges.max()])
    return FrameResult(
        int(is_box.sum()), int(agrees.sum()), int((agrees | false).sum()), int(false.sum()), int(is_floor.sum()),
        nearest[agrees] - truth[agrees], edges,
    )  # fmt: skip


def _nearest_box(boxes: list[Box], origin: FloatArray, bearing: FloatArray) -> FloatArray:
    return np.min([box.distances_m(origin, bearing) for box in boxes], axis=0)


def _floor_reach_m(truth: FloatArray) -> float:
    """The floor round the box is known to be bare as far as the box itself is away."""
    return float(np.min(truth)) if np.isfinite(truth).any() else 2.0


def judged(folder: Path, level_by_pose: bool) -> list[FrameResult]:
    """Return each frame of a recording against the truth. Raises RecordingError."""
    recording = open_recording(folder)
    boxes = read_boxes(folder / "truth_objects.txt")
    stamps, poses = read_trajectory(folder / "groundtruth.txt")
    results = []
    for entry in recording.entries:
        pose = poses[int(np.argmin(np.abs(stamps - entry.stamp_s)))]
        frame = recording.read(entry)
        found = scan(frame.depth_m, recording.intrinsics, pose if level_by_pose else None, ObstacleSettings())
        results.append(judge(found, pose, boxes))
    return results


def summary(results: list[FrameResult]) -> dict[str, Any]:
    """Return the figures over all frames."""
    with_box = [result for result in results if result.true_count]
    frames_m = [abs(float(np.median(r.distance_errors_m))) for r in results if r.distance_errors_m.size]
    each_m = np.abs(np.concatenate([r.distance_errors_m for r in results]))
    centres_deg = [abs(float(r.edge_errors_deg.mean())) for r in results if r.edge_errors_deg.size]
    edges_deg = np.abs(np.concatenate([r.edge_errors_deg for r in results]))
    return {
        "frames": len(results),
        "frames_with_box": len(with_box),
        "frames_found": sum(r.hit_count > 0 for r in with_box),
        "bearing_recall": _share(sum(r.hit_count for r in results), sum(r.true_count for r in results)),
        "bearing_precision": _share(sum(r.hit_count for r in results), sum(r.claimed_count for r in results)),
        "distance_error_of_a_frame_m": _spread(frames_m),
        "distance_error_of_a_bearing_m": _spread(each_m),
        "bearing_error_of_the_middle_deg": _spread(centres_deg),
        "bearing_error_of_an_edge_deg": _spread(edges_deg),
        "floor_bearings": sum(r.floor_count for r in results),
        "false_floor_bearings": sum(r.false_count for r in results),
    }


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 4) if whole else None


def _spread(errors: FloatArray | list[float]) -> dict[str, float] | None:
    """Return median, 95th percentile and worst of errors without sign; None where there are none."""
    if not len(errors):
        return None
    median, p95, worst = np.percentile(errors, [50, 95, 100])
    return {"median": round(float(median), 4), "p95": round(float(p95), 4), "worst": round(float(worst), 4)}


_COLUMNS = (
    "levelled_by", "frame", "true_bearings", "found", "false_on_the_floor", "distance_error_median_m",
    "distance_error_worst_m", "right_edge_error_deg", "left_edge_error_deg",
)  # fmt: skip


def _row(levelled_by: str, number: int, result: FrameResult) -> list[str]:
    counts = [str(number), str(result.true_count), str(result.hit_count), str(result.false_count)]
    distances, edges = result.distance_errors_m, result.edge_errors_deg
    errors_m = [np.median(distances), distances[np.abs(distances).argmax()]] if distances.size else []
    return [
        levelled_by, *counts, *([f"{error:.4f}" for error in errors_m] or ["", ""]),
        *([f"{error:.2f}" for error in edges] or ["", ""]),
    ]  # fmt: skip


def main() -> int:
    """Print the figures; 1 where the recording cannot be read."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--json", action="store_true", help="on one line")
    parser.add_argument("--frames", type=Path, metavar="CSV", help="write a row for each frame here")
    arguments = parser.parse_args()
    try:
        results = {name: judged(arguments.recording, name == "pose") for name in ("pose", "floor")}
        if arguments.frames is not None:
            with arguments.frames.open("w", newline="") as file:
                rows = csv.writer(file)
                rows.writerow(_COLUMNS)
                rows.writerows(_row(name, k, result) for name, each in results.items() for k, result in enumerate(each))
    except (VbrError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    figures = {f"levelled_by_{name}": summary(each) for name, each in results.items()}
    print(json.dumps(figures, indent=None if arguments.json else 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
