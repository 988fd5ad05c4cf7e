"""The simulated walk on disk: a recording as any other, with its ground truth and who was seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from device_agent.simulation.building import Building
from device_agent.simulation.marking import spoken_marks
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.passers_by import SHOWN_SHARE
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.routes import lengthened
from device_agent.simulation.scenario import ORDINARY, Scenario
from device_agent.simulation.sensors import head_camera
from device_agent.simulation.simulated_walk import shots, staged_walk
from navcore.geometry import Transform
from navcore.recording import RecordingWriter
from navcore.types import FisheyeCamera

PEOPLE_FILE = "people.txt"


@dataclass(frozen=True, slots=True)
class WalkRecord:
    """What was recorded."""

    frame_count: int
    length_m: float
    people_frame_share: float
    """Share of the frames in which people cover at least ``SHOWN_SHARE`` of the picture, as drawn."""


def record_walk(
    folder: Path,
    seed: int = 0,
    size_px: tuple[int, int] = (320, 240),
    rate_hz: float = 10.0,
    progress: Callable[[int, int], None] | None = None,
    max_length_m: float = math.inf,
    building: Building | None = None,
    renderer: Renderer | None = None,
    fisheye: FisheyeCamera | None = None,
    scenario: Scenario = ORDINARY,
    min_length_m: float = 0.0,
) -> WalkRecord:
    """Write the sighted person's walk as a recording, with its ground truth, and tell what was recorded.

    ``progress`` is called with the number of frames done and their total. A walk shorter than ``min_length_m`` goes on
    round the building; ``renderer`` is as in :func:`simulated_walk.simulated_walk`.
    """
    floor = office_floor() if building is None else building
    floor = replace(floor, road_waypoints=lengthened(floor.road_waypoints, seed, min_length_m))
    staged = staged_walk(floor, None, seed, scenario, rate_hz=rate_hz, max_length_m=max_length_m)
    usable = None if scenario.changed_furniture_share > 0.0 else renderer
    writer = RecordingWriter(folder, head_camera(*size_px), fisheye=fisheye)
    walked: list[tuple[float, Transform]] = []
    people: list[float] = []
    for shot in shots(staged, seed, size_px, usable, fisheye):
        writer.add(shot.frame, shot.world_from_camera)
        walked.append((shot.frame.stamp_s, shot.world_from_camera))
        people.append(shot.people_share)
        if progress is not None:
            progress(len(walked), len(staged))
    for mark in spoken_marks(floor, walked):
        writer.mark(mark)
    writer.close()
    if scenario.people_share > 0.0:
        _write_people(folder / PEOPLE_FILE, [stamp_s for stamp_s, _ in walked], people)
    return WalkRecord(len(walked), staged.length_m, float(np.mean(np.array(people) >= SHOWN_SHARE)))


def _write_people(path: Path, stamps_s: Sequence[float], shares: Sequence[float]) -> None:
    """Write how much of each picture shows people: for evaluation, as the ground truth."""
    lines = [f"{stamp_s:.6f} {share:.4f}\n" for stamp_s, share in zip(stamps_s, shares, strict=True)]
    path.write_text("# share of the picture that shows people\n# t share\n" + "".join(lines), encoding="utf-8")
