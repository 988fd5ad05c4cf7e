"""Where the walkers went, over the floor plan: the paper's Figs. 8 and 9."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from device_agent.experiments.course import with_course
from device_agent.experiments.design import EXPERIMENTS, PATHS, POLICIES, SIGHTS
from device_agent.experiments.running import Figures
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.picture import floor_plan
from navcore.errors import InputError
from navcore.geometry import FloatArray

_PX_PER_M = 40.0
_JPEG_QUALITY = 85


def draw_all(figures: Sequence[Figures], folder: Path) -> list[Path]:
    """Write a picture for each experiment, path and policy; return the files. Raises InputError where one cannot be."""
    written = []
    for experiment in EXPERIMENTS:
        for policy in POLICIES:
            for path in PATHS:
                walks = [
                    walk
                    for walk in figures
                    if (walk.experiment, walk.policy, walk.path) == (experiment, policy, path.name)
                ]
                if walks:
                    name = f"figure-{7 + experiment}-{policy}-{path.name.replace('→', '')}.jpg"
                    written.append(_draw(walks, folder / name))
    return written


def _draw(walks: Sequence[Figures], file: Path) -> Path:
    building = office_floor()
    if walks[0].experiment != 1:
        building = with_course(building, walks[0].path)
    lines: dict[str, list[FloatArray]] = {
        sight: [np.array(walk.path_m) for walk in walks if walk.sight == sight and walk.path_m] for sight in SIGHTS
    }
    lines["planned"] = [np.array(walk.route_m) for walk in walks if walk.route_m][:1]
    picture = floor_plan(building, {name: paths for name, paths in lines.items() if paths}, px_per_m=_PX_PER_M)
    if not cv2.imwrite(str(file), picture[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]):
        raise InputError(f"{file} cannot be written: name another folder with --out.")
    return file
