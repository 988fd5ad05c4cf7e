"""Whether localization knows what it does not know: simulated walks under hard conditions in the map of another walk.

    python -m benchmarks.trust RECORDING [--floor office] [--walks 50] [--length 18] [--only dark] [--map FILE.npz]

RECORDING is a simulated recording of a floor, the office by default, with its ground truth (``vbr sim record``); its
map is built, or read from FILE where that exists. Walks begin at a different place each, take the scenarios in turn,
and are located frame by frame. The JSON tells for each scenario how often a pose was called Localized, Uncertain or
Lost, the worst error of each, ``wrong_as_localized`` (poses called Localized more than 0.5 m from the truth; there must
be none), and how often the covariance's 95 % ellipse holds the truth. Milliseconds are the thread's own CPU time.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from device_agent.simulation.building import Building, renderer_of
from device_agent.simulation.floors import FLOORS
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.scenario import Scenario
from device_agent.simulation.simulated_walk import simulated_walk
from device_agent.single_core import use_one_core
from navcore.errors import MappingError, VbrError
from navcore.evaluation import align_rigidly
from navcore.geometry import FloatArray, Transform
from navcore.recording import Recording, open_recording, read_trajectory
from navcore.settings import LocalizationSettings
from navcore.slam import warm_up
from navcore.slam.features import feature_count_for
from navcore.slam.keyframes import SlamCamera
from navcore.slam.lie import log_so3
from navcore.slam.localizer import Localizer
from navcore.slam.map_build import BF_PX_M
from navcore.slam.mapper import Mapper
from navcore.slam.slam_map import SlamMap
from navcore.types import Frame, Localization, LocalizationQuality

WRONG_M = 0.5
CHI2_95 = {2: 5.991, 3: 7.815}
"""95 % of the χ² distribution, by degrees of freedom."""
CARRIED = "carried elsewhere"
UNSEEN_FROM_S = 5.0
UNSEEN_S = {"no frames for 3 s": 3.0, "no frames for 8 s": 8.0}
"""How long the camera delivers nothing, from ``UNSEEN_FROM_S`` on, while the walker goes on."""
SCENARIOS = {
    "ordinary": Scenario(),
    "people": Scenario(people_share=0.3),
    "changed furniture": Scenario(changed_furniture_share=0.5),
    "dark stretch": Scenario(dark_m=(5.0, 11.0)),
    "covered 3 s": Scenario(covered_s=(8.0, 3.0)),
    "kidnapped start": Scenario(kidnapped=True),
    CARRIED: Scenario(kidnapped=True),
    "no frames for 3 s": Scenario(),
    "no frames for 8 s": Scenario(),
    "everything": Scenario(0.2, 0.4, (6.0, 10.0), (4.0, 3.0), True),
}

Walk = Iterator[tuple[Frame, Transform]]


@dataclass
class Tally:
    """What is counted over the walks of one scenario."""

    walks: int = 0
    quality: list[LocalizationQuality] = field(default_factory=list)
    error_m: dict[LocalizationQuality, list[float]] = field(default_factory=dict)
    within: dict[str, list[bool]] = field(default_factory=dict)
    recovery_s: list[float] = field(default_factory=list)
    took_ms: list[float] = field(default_factory=list)
    wrong: list[dict[str, Any]] = field(default_factory=list)

    def add(self, found: Localization, truth: Transform) -> None:
        """Count one located frame."""
        self.quality.append(found.quality)
        if found.world_from_camera is None or found.covariance is None:
            return
        error = found.world_from_camera.translation - truth.translation
        turn = log_so3(np.ascontiguousarray(found.world_from_camera.rotation @ truth.rotation.T))
        self.error_m.setdefault(found.quality, []).append(float(np.linalg.norm(error)))
        covariance = found.covariance
        name = found.quality.value
        self.within.setdefault(f"position_3d_{name}", []).append(_holds(error, covariance[:3, :3]))
        self.within.setdefault(f"ground_2d_{name}", []).append(_holds(error[:2], covariance[:2, :2]))
        self.within.setdefault(f"rotation_{name}", []).append(_holds(turn, covariance[3:, 3:]))

    def figures(self) -> dict[str, Any]:
        """Return what the benchmark prints of this scenario."""
        count = max(1, len(self.quality))
        localized, uncertain = LocalizationQuality.LOCALIZED, LocalizationQuality.UNCERTAIN
        claimed = self.error_m.get(localized, [])
        return {
            "walks": self.walks,
            "frames": len(self.quality),
            "share": {q.value: round(self.quality.count(q) / count, 4) for q in LocalizationQuality},
            "worst_localized_m": round(max(claimed, default=0.0), 3),
            "worst_uncertain_m": round(max(self.error_m.get(uncertain, []), default=0.0), 3),
            "wrong_as_localized": sum(error > WRONG_M for error in claimed),
            "within_95": {name: round(float(np.mean(held)), 4) for name, held in sorted(self.within.items())},
            "recovery_s": {
                "count": len(self.recovery_s),
                "median": round(float(np.median(self.recovery_s)), 2) if self.recovery_s else None,
                "max": round(max(self.recovery_s), 2) if self.recovery_s else None,
            },
            "ms": {
                "median": round(float(np.median(self.took_ms)), 2),
                "p99": round(float(np.percentile(self.took_ms, 99)), 2),
                "max": round(max(self.took_ms), 2),
            },
            "wrong": self.wrong[:5],
        }


def main() -> int:
    """Run the walks; print the figures. The exit status tells whether a wrong pose was called Localized."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("source", type=Path, metavar="RECORDING")
    parser.add_argument("--floor", choices=sorted(FLOORS), default="office", help="that was recorded")
    parser.add_argument("--walks", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--length", type=float, default=18.0, help="metres of each walk")
    parser.add_argument("--only", choices=sorted(SCENARIOS), help="one scenario")
    parser.add_argument("--map", type=Path, metavar="FILE.npz", help="where the map is kept")
    arguments = parser.parse_args()
    use_one_core()
    warm_up()
    recording = open_recording(arguments.source)
    slam_map = _aligned(_map_of(recording, arguments.map), recording)
    building = FLOORS[arguments.floor]()
    renderer = renderer_of(building)
    names = [arguments.only] if arguments.only else list(SCENARIOS)
    tallies = {name: Tally() for name in names}
    for number in range(arguments.walks):
        name = names[number % len(names)]
        seed = arguments.first_seed + number
        _walk(slam_map, recording, _staged(building, renderer, name, seed, arguments.length), tallies[name], seed)
        sys.stderr.write(f"{number + 1}/{arguments.walks} {name}: {_share(tallies[name])}\n")
    figures = {name: tally.figures() for name, tally in tallies.items() if tally.walks}
    wrong = sum(f["wrong_as_localized"] for f in figures.values())
    json.dump({"walks": arguments.walks, "wrong_as_localized": wrong, "scenarios": figures}, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 1 if wrong else 0


def _map_of(recording: Recording, kept: Path | None) -> SlamMap:
    if kept is not None and kept.exists():
        with np.load(kept, allow_pickle=False) as arrays:
            return SlamMap.from_arrays(dict(arrays))
    intrinsics = recording.intrinsics
    count = feature_count_for(intrinsics.width_px, intrinsics.height_px, LocalizationSettings().feature_count)
    mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, BF_PX_M), count)
    for frame in recording.frames():
        mapper.add(frame)
    slam_map = mapper.finish()
    if kept is not None:
        np.savez(kept, **slam_map.to_arrays())  # type: ignore[arg-type]
    return slam_map


def _aligned(slam_map: SlamMap, recording: Recording) -> SlamMap:
    """Return the map in the building's frame, as well as the recording's truth lets it be laid there rigidly."""
    stamps_s, poses = read_trajectory(recording.folder / "groundtruth.txt")
    true_m = np.array([pose.translation for pose in poses])
    if len(slam_map.trajectory) < 3:
        raise MappingError("The map holds no walk to align by: record one of at least ten metres.")
    truth = np.stack([np.interp(slam_map.trajectory_stamp_s, stamps_s, true_m[:, k]) for k in range(3)], axis=1)
    return slam_map.transformed(align_rigidly(truth, slam_map.trajectory[:, :3, 3]).matrix)


def _staged(building: Building, renderer: Renderer, name: str, seed: int, length_m: float) -> Walk:
    """Return a walk of a scenario that begins at a leg of the recorded way given by the seed."""
    if name != CARRIED:
        walk = _leg(building, renderer, SCENARIOS[name], seed, length_m)
        return _without_frames(walk, UNSEEN_S[name]) if name in UNSEEN_S else walk
    return _joined(
        _leg(building, renderer, Scenario(), seed, length_m / 2),
        _leg(building, renderer, SCENARIOS[name], seed + 1000, length_m / 2),
    )


def _leg(building: Building, renderer: Renderer, scenario: Scenario, seed: int, length_m: float) -> Walk:
    way = building.road_waypoints
    begin = int(np.random.default_rng([seed, 5]).integers(len(way) - 1))
    way = (*way[begin:], *way[1:]) if way[0] == way[-1] else way
    return simulated_walk(building, way, seed, scenario, max_length_m=length_m, renderer=renderer)


def _without_frames(walk: Walk, unseen_s: float) -> Walk:
    """Leave out what the camera would have seen for so long."""
    return (seen for seen in walk if not 0.0 <= seen[0].stamp_s - UNSEEN_FROM_S < unseen_s)


def _joined(first: Walk, second: Walk) -> Walk:
    """Go on with another walk in the very next frame: somebody has carried the camera away."""
    shift_s = 0.0
    for frame, truth in first:
        shift_s = frame.stamp_s + 0.1
        yield frame, truth
    yield from ((replace(frame, stamp_s=frame.stamp_s + shift_s), truth) for frame, truth in second)


def _walk(slam_map: SlamMap, recording: Recording, walk: Walk, tally: Tally, seed: int) -> None:
    localizer = Localizer(slam_map, recording.intrinsics, LocalizationSettings())
    lost_s: float | None = None
    tally.walks += 1
    for number, (frame, truth) in zip(itertools.count(), walk):
        started_s = time.thread_time()
        found = localizer.locate(frame)
        tally.took_ms.append(1e3 * (time.thread_time() - started_s))
        tally.add(found, truth)
        if found.quality is LocalizationQuality.LOST:
            lost_s = frame.stamp_s
        elif found.quality is LocalizationQuality.LOCALIZED:
            if lost_s is not None:
                tally.recovery_s.append(frame.stamp_s - lost_s)
            lost_s = None
            error_m = tally.error_m[LocalizationQuality.LOCALIZED][-1]
            if error_m > WRONG_M:
                tally.wrong.append({"seed": seed, "frame": number, "error_m": round(error_m, 2)})


def _holds(error: FloatArray, covariance: FloatArray) -> bool:
    """Tell whether the 95 % ellipse(oid) around the estimate holds the truth."""
    return bool(error @ np.linalg.solve(covariance, error) <= CHI2_95[len(error)])


def _share(tally: Tally) -> str:
    figures = tally.figures()
    return f"{figures['share']} worst {figures['worst_localized_m']} m, wrong {figures['wrong_as_localized']}"


if __name__ == "__main__":
    try:
        sys.exit(main())
    except VbrError as error:
        sys.exit(str(error))
