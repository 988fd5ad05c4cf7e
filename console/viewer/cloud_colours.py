"""Other colours for the point cloud: by height, and by how well localization knows its place there."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from console.viewer import appearance as look
from console.viewer.appearance import Rgb
from console.viewer.cloud import CEILING_M
from navcore.geometry import FloatArray
from navcore.settings import Settings

REACH_M = 2.5
"""Where no key frame is nearer than this, nobody has stood: how well localization works there is not known."""
KEYFRAMES_COUNT = 3
MAX_STD_M = 0.15
"""A key frame whose own position is less certain than this knows its place poorly."""
_CELL_M = 0.25
_SHADE = 0.6
"""Share of the brightness that shade may take."""
_ROW_COUNT = 1 << 32
"""More cells than there are in a row: a cell is one number."""

Colours = NDArray[np.uint8]


class Colouring(enum.Enum):
    """What the colours of the cloud tell."""

    SEEN = "As seen"
    HEIGHT = "Height"
    LOCALIZATION = "Localization"


class LocalizationGrade(enum.IntEnum):
    """How well localization knows its place somewhere."""

    UNKNOWN = 0
    POOR = 1
    FAIR = 2
    GOOD = 3


_GRADES: dict[LocalizationGrade, tuple[Rgb, str]] = {
    LocalizationGrade.GOOD: (look.KNOWN_WELL, "knows its place well"),
    LocalizationGrade.FAIR: (look.KNOWN_FAIRLY, "knows it fairly"),
    LocalizationGrade.POOR: (look.KNOWN_POORLY, "poorly: walk there again with the camera"),
    LocalizationGrade.UNKNOWN: (look.NOT_KNOWN, "not known: nobody has stood near"),
}


def legend(colouring: Colouring) -> tuple[tuple[Rgb, str], ...]:
    """Return the colours of a colouring, and what they mean; none for what was seen."""
    if colouring is Colouring.LOCALIZATION:
        return tuple(_GRADES.values())
    if colouring is Colouring.HEIGHT:
        heights_m = np.linspace(0.0, CEILING_M, len(look.STEPS))
        return tuple((colour, f"{height_m:.1f} m") for colour, height_m in zip(look.STEPS, heights_m, strict=True))
    return ()


def by_height(points_m: NDArray[np.float32]) -> Colours:
    """Return a colour (n, 3) for each point (n, 3), from the floor up to the ceiling cut."""
    steps = np.linspace(0.0, CEILING_M, len(look.STEPS))
    table = np.array(look.STEPS, dtype=np.float64)
    return np.column_stack([np.interp(points_m[:, 2], steps, table[:, part]) for part in range(3)]).astype(np.uint8)


def by_localization(points_m: NDArray[np.float32], map_arrays: Mapping[str, NDArray[Any]]) -> Colours:
    """Return a colour (n, 3) for each point (n, 3), by the grade of the place of the floor below it."""
    table = np.array([_GRADES[grade][0] for grade in LocalizationGrade], dtype=np.uint8)
    if not len(points_m):
        return np.zeros((0, 3), np.uint8)
    # A place of the floor has one grade: it is worked out once for each cell.
    cells = np.floor(points_m[:, :2] / _CELL_M).astype(np.int64)
    _, first, cell_of = np.unique(cells[:, 0] * _ROW_COUNT + cells[:, 1], return_index=True, return_inverse=True)
    return np.asarray(table[grades((cells[first] + 0.5) * _CELL_M, map_arrays)][cell_of.ravel()])


def shaded(colours_rgb: Colours, seen_rgb: Colours) -> Colours:
    """Return colours (n, 3) with some of the light and shade that was seen, so that surfaces can be told apart."""
    grey = seen_rgb.astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32) / 255.0
    return np.asarray(colours_rgb * (1.0 - _SHADE * (1.0 - grey[:, None])), dtype=np.uint8)


def grades(places_m: FloatArray, map_arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
    """Return the :class:`LocalizationGrade` (n,) of places of the floor (n, 2).

    It is that of the key frames around: how many landmarks they see (the settings of a map walk say how few are weak),
    and how certain their own positions are. Of a map without key frames nothing is known.
    """
    result = np.full(len(places_m), int(LocalizationGrade.UNKNOWN))
    needed = {"camera_from_world", "feature_start", "feature_landmark", "keyframe_covariance"}
    if not needed <= map_arrays.keys() or not len(map_arrays["camera_from_world"]):
        return result
    weak_count = Settings().map_walk.landmarks_count
    counts, stds_m = _landmark_counts(map_arrays), _stds_m(map_arrays["keyframe_covariance"])
    stood_m = _camera_places_m(map_arrays["camera_from_world"])[:, :2]
    distances_m, near = cKDTree(stood_m).query(places_m, k=KEYFRAMES_COUNT)
    is_near = np.asarray(distances_m <= REACH_M)
    # Key frames that do not exist, or are far away, do not count.
    near = np.where(is_near, near, 0)
    seen, std_m = _median(counts[near], is_near), _median(stds_m[near], is_near)
    known = is_near.any(axis=1)
    result[known] = int(LocalizationGrade.GOOD)
    result[known & (seen < 2 * weak_count)] = int(LocalizationGrade.FAIR)
    result[known & ((seen < weak_count) | (std_m > MAX_STD_M))] = int(LocalizationGrade.POOR)
    return result


def _median(values: FloatArray, counts: NDArray[np.bool_]) -> FloatArray:
    """Return the lower median of each row (n,) over what counts; 0 where nothing does."""
    ordered = np.sort(np.where(counts, values, np.inf), axis=1)
    middle = np.maximum(counts.sum(axis=1) - 1, 0) // 2
    found = ordered[np.arange(len(ordered)), middle]
    return np.where(np.isfinite(found), found, 0.0)


def _landmark_counts(map_arrays: Mapping[str, NDArray[Any]]) -> FloatArray:
    before = np.concatenate([[0], np.cumsum(map_arrays["feature_landmark"] >= 0)])
    return np.asarray(np.diff(before[map_arrays["feature_start"]]), dtype=np.float64)


def _stds_m(covariances: FloatArray) -> FloatArray:
    variances = np.trace(covariances[:, :3, :3], axis1=1, axis2=2)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def _camera_places_m(camera_from_world: FloatArray) -> FloatArray:
    rotations, translations = camera_from_world[:, :3, :3], camera_from_world[:, :3, 3]
    return np.asarray(-np.einsum("nji,nj->ni", rotations, translations))
