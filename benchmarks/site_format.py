"""The site format with a map of 300 key frames: size, time to load and to verify, start-up to the first pose, as JSON.

    python -m benchmarks.site_format [--keyframes 300] [--recording FOLDER]

Without a recording, the map is synthetic: key frames of 600 features along a corridor, each landmark seen by several,
and a cloud of 200,000 points. With one (TUM RGB-D layout), its site is built, and its first frames are localized in it
by a new process: from its start to the first pose that is not lost.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from device_agent.single_core import use_one_core
from navcore.recording import Recording, open_recording
from navcore.settings import LocalizationSettings
from navcore.site import Site, load_site, save_site
from navcore.site_building import build_site
from navcore.site_files import read_checked, read_manifest
from navcore.slam.features import GRID_PX, sort_into_cells
from navcore.slam.freezing import freeze
from navcore.slam.keyframes import NO_LANDMARK, Features, SlamCamera
from navcore.slam.localizer import Localizer
from navcore.slam.map import MapBuilder
from navcore.slam.place_recognition import PlaceIndex, Vocabulary
from navcore.slam.slam_map import SlamMap
from navcore.types import CameraIntrinsics, LocalizationQuality

CAMERA = CameraIntrinsics(320, 240, 232.0, 232.0, 159.5, 119.5)
FEATURES = 600
SHARED = 350
"""Landmarks of a key frame that the one before has seen."""
CLOUD_POINTS = 200_000
REPEATS = 5


def main() -> int:
    """Run the benchmark; print its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--keyframes", type=int, default=300)
    parser.add_argument("--recording", type=Path, metavar="FOLDER")
    parser.add_argument("--first-pose", type=Path, metavar="SITE", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    use_one_core()
    if arguments.first_pose is not None:
        return _first_pose(arguments.first_pose, open_recording(arguments.recording))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "site"
        if arguments.recording is not None:
            recording = open_recording(arguments.recording)
            site, _ = build_site(recording, "Benchmark", LocalizationSettings(), lambda *_: None)
        else:
            site = synthetic_site(arguments.keyframes)
        figures = _writing(site, folder) | _reading(folder)
        if arguments.recording is not None:
            figures |= _start_up(folder, arguments.recording)
    json.dump(figures, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 0


def synthetic_site(keyframes: int, seed: int = 0) -> Site:
    """Return a site whose map has the size of a real one; nothing can be recognised in it."""
    rng = np.random.default_rng(seed)
    camera = SlamCamera.of(CAMERA, 100.0)
    builder = MapBuilder(camera, FEATURES)
    before = np.zeros(0, np.int32)
    for k in range(keyframes):
        features = _random_features(camera, rng)
        landmark_of = np.full(FEATURES, NO_LANDMARK, np.int32)
        chosen = rng.permutation(FEATURES)[: min(SHARED, len(before))]
        landmark_of[chosen] = rng.permutation(before)[: len(chosen)]
        pose = np.eye(4)
        pose[0, 3] = -0.3 * k
        builder.add_keyframe(float(k), features, pose, landmark_of)
        fresh = np.flatnonzero(landmark_of < 0).astype(np.int32)
        builder.add_landmarks(k, fresh, features.points_in_camera(camera)[fresh] - pose[:3, 3])
        before = builder.landmark_of[k].copy()
    places = PlaceIndex(Vocabulary.train(np.concatenate([held.features.descriptors for held in builder.keyframes])))
    trajectory = [(0.1 * i, np.linalg.inv(builder.camera_from_world[i * keyframes // 3000])) for i in range(3000)]
    road = np.column_stack([np.arange(0.0, 0.3 * keyframes, 0.1), *np.zeros((2, 3 * keyframes))])
    return Site(
        "benchmark", "Benchmark", CAMERA, freeze(builder, places, trajectory).to_arrays(), (road,),
        rng.normal(0.0, 10.0, (CLOUD_POINTS, 3)).astype(np.float32),
        rng.integers(0, 256, (CLOUD_POINTS, 3)).astype(np.uint8),
    )  # fmt: skip


def _random_features(camera: SlamCamera, rng: np.random.Generator) -> Features:
    depth = rng.uniform(0.8, 5.0, FEATURES)
    uvr = np.column_stack(
        [rng.uniform(0, camera.width_px, FEATURES), rng.uniform(0, camera.height_px, FEATURES), depth]
    )
    uvr[:, 2] = uvr[:, 0] - camera.bf_px_m / depth
    columns, rows = -(-camera.width_px // GRID_PX), -(-camera.height_px // GRID_PX)
    order, cell_start = sort_into_cells(uvr, columns, rows)
    return Features(
        np.ascontiguousarray(uvr[order]),
        np.ascontiguousarray(depth[order]),
        rng.integers(0, 8, FEATURES).astype(np.int32),
        rng.uniform(-np.pi, np.pi, FEATURES),
        rng.integers(0, 256, (FEATURES, 32)).astype(np.uint8),
        cell_start,
        columns,
    )


# ------------------------------------------------------------------------------------------------------- measuring
def _writing(site: Site, folder: Path) -> dict[str, Any]:
    started_s = time.perf_counter()
    save_site(site, folder)
    took_s = time.perf_counter() - started_s
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return {"save_s": round(took_s, 3), "megabytes": round(size / 1e6, 1)}


def _reading(folder: Path) -> dict[str, Any]:
    # The first of a process pays for importing what is used; the others are what loading costs.
    load_s, map_s, verify_s, hash_s = (
        min(_cpu_s(work) for _ in range(REPEATS))
        for work in (
            lambda: load_site(folder),
            lambda: SlamMap.from_arrays(load_site(folder).map_arrays),
            lambda: _verify(folder),
            lambda: _hash(folder),
        )
    )
    slam_map = SlamMap.from_arrays(load_site(folder).map_arrays)
    return {
        "keyframes": slam_map.keyframe_count,
        "features": int(slam_map.feature_start[-1]),
        "landmarks": len(slam_map.positions),
        "load_files_s": round(load_s, 4),
        "load_s": round(map_s, 4),
        "verify_s": round(verify_s, 4),
        "sha256_alone_s": round(hash_s, 4),
    }


def _cpu_s(work: Any) -> float:
    started_s = time.thread_time()
    work()
    return time.thread_time() - started_s


def _verify(folder: Path) -> None:
    for name, entry in read_manifest(folder).files.items():
        read_checked(folder, name, entry)


def _hash(folder: Path) -> None:
    for name in read_manifest(folder).files:
        hashlib.sha256((folder / name).read_bytes()).digest()


def _start_up(folder: Path, recording: Path) -> dict[str, Any]:
    """Measure twice: the first time compiles what is not in the cache yet."""
    command = [
        sys.executable,
        "-m",
        "benchmarks.site_format",
        "--first-pose",
        str(folder),
        "--recording",
        str(recording),
    ]
    answers = []
    for _ in range(2):
        started_s = time.time()
        out = subprocess.run(command, capture_output=True, check=True, text=True)
        answers.append(json.loads(out.stdout) | {"process_s": round(time.time() - started_s, 2)})
    return {"first_pose": answers[-1]}


def _first_pose(folder: Path, recording: Recording) -> int:
    """Locate frames until one is found; print when that was, by this process's CPU time since its start."""
    slam_map = SlamMap.from_arrays(load_site(folder).map_arrays)
    loaded_s = time.process_time()
    localizer = Localizer(slam_map, recording.intrinsics, LocalizationSettings())
    frames = 0
    for frame in recording.frames():
        frames += 1
        if localizer.locate(frame).quality is not LocalizationQuality.LOST:
            break
    json.dump({"loaded_cpu_s": loaded_s, "first_pose_cpu_s": time.process_time(), "frames": frames}, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
