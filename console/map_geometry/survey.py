"""What is measured once in a map's cloud: what stands where, and the walls; in a process of its own.

Open3D holds Python's lock while it computes, seconds at a time in a large cloud: in the console's own process nobody
would be watched over meanwhile. :func:`main` is that process; a file hands over what it finds, and is kept.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from console.map_geometry.occupancy import Occupancy, occupancy_of
from console.map_geometry.wall_segments import wall_segments
from navcore.errors import InputError, SiteError, VbrError
from navcore.geometry import FloatArray
from navcore.site import Site, load_site, map_checksum
from navcore.zip_reading import told_of_damage

SURVEY_VERSION = 2
"""Counts up when something is measured in another way: what was kept is measured anew."""
_FILES = ("frame", "is_occupied", "is_known", "walls_m")
_NICENESS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What has been measured in a map's cloud."""

    occupancy: Occupancy
    walls_m: FloatArray
    """Segments (m, 2, 2)."""


def survey_of(site: Site, progress: Callable[[int], None] = lambda _: None) -> Survey:
    """Measure a site's cloud; ``progress`` is called with percents."""
    walked_m = [road[:, :2] for road in site.roads_m if len(road)]
    progress(20)
    occupancy = occupancy_of(site.cloud_points_m, walked_m)
    progress(60)
    return Survey(occupancy, wall_segments(site.cloud_points_m))


def save_survey(survey: Survey, file: Path) -> None:
    """Write a survey in one step."""
    seen = survey.occupancy
    frame = np.array([SURVEY_VERSION, seen.x_min_m, seen.y_min_m, seen.cell_m])
    fresh = file.with_name(f".{file.name}.{os.getpid()}")
    with fresh.open("wb") as out:
        np.savez_compressed(
            out, frame=frame, is_occupied=seen.is_occupied, is_known=seen.is_known, walls_m=survey.walls_m
        )
    os.replace(fresh, file)


def load_survey(file: Path) -> Survey:
    """Read a survey. Raises InputError where it is damaged, missing, or was measured in another way."""
    try:
        frame, is_occupied, is_known, walls_m = told_of_damage(lambda: _stored(file), str(file))
    except (OSError, SiteError) as error:
        raise InputError(f"{file} cannot be read ({error}): measure the map again.") from error
    fits = (
        frame.shape == (4,) and frame[0] == SURVEY_VERSION and bool(np.isfinite(frame).all()) and frame[3] > 0.0
        and is_occupied.ndim == 2 and is_occupied.dtype == np.bool_ and is_known.dtype == np.bool_
        and is_known.shape == is_occupied.shape and walls_m.shape[1:] == (2, 2) and walls_m.dtype == np.float64
    )  # fmt: skip
    if not fits:
        raise InputError(f"{file} is of another form: measure the map again.")
    return Survey(Occupancy(float(frame[1]), float(frame[2]), float(frame[3]), is_occupied, is_known), walls_m)


def _stored(file: Path) -> tuple[NDArray[Any], ...]:
    with np.load(file, allow_pickle=False) as stored:
        try:
            return tuple(stored[name] for name in _FILES)
        except (KeyError, MemoryError, AttributeError, TypeError) as error:
            raise ValueError(f"{type(error).__name__}: {error}") from error


def main(arguments: list[str] | None = None) -> int:
    """Measure a site's cloud and write it down; percents go to stdout, a line each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("site", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--checksum", required=True, help="the map that is meant (navcore.site.map_checksum)")
    options = parser.parse_args(arguments)
    os.nice(_NICENESS)
    try:
        if map_checksum(options.site) != options.checksum:
            raise SiteError("The site's folder holds another map than the console has opened: start the console anew.")
        save_survey(survey_of(load_site(options.site), _say), options.out)
    except (VbrError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


def _say(percent: int) -> None:
    sys.stdout.write(f"{percent}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
