"""A bare corridor, from the first frame to the map and back: carried by its lamps' light, or said to be lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from slam_blank_room import CAMERA
from slam_shaded_corridor import INTRINSICS, walk

from navcore.settings import LocalizationSettings
from navcore.slam.localizer import Localizer
from navcore.slam.mapper import Mapper
from navcore.slam.slam_map import SlamMap
from navcore.types import Localization, LocalizationQuality

BEGIN_M, END_M = -1.0, 4.2
NOTHING_KNOWN_FROM_M = 0.6
"""From here on no paper is in the picture."""
CHI2_95 = 7.815
"""95 % of the χ² distribution with three degrees of freedom."""


@dataclass(frozen=True)
class Mapped:
    """What mapping made of a walk."""

    slam_map: SlamMap
    """In the corridor's frame, by the first pose."""
    along_m: np.ndarray
    """(n,): where each frame was."""
    error_m: np.ndarray
    """(n,): NaN where the frame was not tracked."""


def mapped(lamps: bool) -> Mapped:
    mapper = Mapper(INTRINSICS, CAMERA, 600)
    walked = walk(BEGIN_M, END_M, lamps=lamps, seed=0)
    first, along_m, error_m = np.eye(4), [], []
    for number, (frame, camera_from_world) in enumerate(walked):
        truth = np.linalg.inv(camera_from_world)
        tracked = mapper.add(frame)
        if number == 0:
            first = truth @ np.linalg.inv(mapper.world_from_camera)
        along_m.append(truth[0, 3])
        there = first @ mapper.world_from_camera
        error_m.append(np.linalg.norm(there[:3, 3] - truth[:3, 3]) if tracked else np.nan)
    return Mapped(mapper.finish().transformed(first), np.array(along_m), np.array(error_m))


@pytest.fixture(scope="module")
def lit() -> Mapped:
    return mapped(lamps=True)


@pytest.fixture(scope="module")
def even() -> Mapped:
    return mapped(lamps=False)


def located(slam_map: SlamMap, lamps: bool) -> list[tuple[float, Localization, np.ndarray]]:
    """Another walk in a map: where each frame was, what was said of it, and the error (3,) of its position."""
    localizer = Localizer(slam_map, INTRINSICS, LocalizationSettings())
    rows = []
    for frame, camera_from_world in walk(BEGIN_M + 0.1, END_M - 0.2, lamps=lamps, seed=3):
        truth = np.linalg.inv(camera_from_world)[:3, 3]
        found = localizer.locate(frame)
        error = np.full(3, np.nan) if found.world_from_camera is None else found.world_from_camera.translation - truth
        rows.append((float(truth[0]), found, error))
    return rows


def held(rows: list[tuple[float, Localization, np.ndarray]]) -> float:
    """Share of the poses whose 95 % ellipsoid holds the truth."""
    within = [
        error @ np.linalg.solve(found.covariance[:3, :3], error) <= CHI2_95
        for _, found, error in rows
        if found.covariance is not None
    ]
    return float(np.mean(within))


def wrong_as_localized(rows: list[tuple[float, Localization, np.ndarray]]) -> int:
    return sum(
        found.quality is LocalizationQuality.LOCALIZED and float(np.linalg.norm(error)) > 0.5
        for _, found, error in rows
    )


def test_by_its_lamps_a_bare_corridor_is_mapped(lit: Mapped) -> None:
    assert np.isfinite(lit.error_m).all()
    assert lit.error_m.max() < 0.25


def test_an_evenly_lit_one_is_given_up_before_the_map_is_wrong(even: Mapped) -> None:
    tracked = np.isfinite(even.error_m)
    assert tracked[even.along_m < 0.3].all()
    assert not tracked[even.along_m > NOTHING_KNOWN_FROM_M + 2.4].any()
    assert np.nanmax(even.error_m) < 0.25


def test_by_its_lamps_the_walker_is_found_in_it(lit: Mapped) -> None:
    rows = located(lit.slam_map, lamps=True)
    assert all(found.quality is not LocalizationQuality.LOST for _, found, _ in rows)
    sure = [error for _, found, error in rows if found.quality is LocalizationQuality.LOCALIZED]
    assert len(sure) > 10
    assert max(float(np.linalg.norm(error)) for error in sure) < 0.25
    assert wrong_as_localized(rows) == 0
    # Where lamps and surfaces lead on it is not exact, and neither is the map; the ellipsoid says so.
    assert max(float(np.linalg.norm(error)) for _, _, error in rows) < 0.4
    assert held(rows) > 0.95


def test_in_an_evenly_lit_one_the_way_along_it_is_open_until_the_walker_is_lost(even: Mapped) -> None:
    rows = located(even.slam_map, lamps=False)
    assert any(found.quality is LocalizationQuality.LOCALIZED for _, found, _ in rows)
    assert wrong_as_localized(rows) == 0
    assert held(rows) > 0.95
    bare = [found for along_m, found, _ in rows if along_m > NOTHING_KNOWN_FROM_M]
    assert all(found.quality is not LocalizationQuality.LOCALIZED for found in bare)
    assert bare[-1].quality is LocalizationQuality.LOST
    # Before it is lost the ellipsoid is long, along the corridor and nowhere else: across, only the map's own is left.
    last = [found.covariance for found in bare if found.covariance is not None][-1]
    along_m, across_m, up_m = np.sqrt(np.diag(last)[:3])
    assert along_m > 0.4
    assert max(across_m, up_m) < 0.25
    assert max(across_m, up_m) < 0.2 * along_m
