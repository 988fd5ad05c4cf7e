"""How a dense cloud compares with the true building: walls that are drawn twice, and people who remain in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from device_agent.simulation.building import Building
from device_agent.simulation.picture import PlanView, plan_view
from device_agent.simulation.scene import RayScene
from device_agent.simulation.shapes import GLASS, Solid
from navcore.errors import InputError
from navcore.geometry import FloatArray

BoolArray = NDArray[np.bool_]
Rgb = tuple[int, int, int]

LOW_M, HIGH_M = 0.3, 1.8
"""The slice that is judged: above chair legs and below lamps."""
NEAR_WALL_M = 0.30
ON_SURFACE_M = 0.08
"""Nearer than this to a true surface that is no wall, a point belongs to that."""
STRETCH_M = 0.5
SECOND_PEAK = 0.25
"""A stretch of wall is doubled where a second layer has this share of the points of the first."""
_BIN_M = 0.025
_LAYER_GAP_M = 0.06
GHOST_CLEAR_M = 0.15
"""A point farther than this from everything that is really there is a ghost."""
ROAD_REACH_M = 1.2
VOXEL_M = 0.04
MIN_CLUSTER = 20
_PX_PER_M, _FINER = 40.0, 2
"""Of the picture, which is drawn finer and then reduced."""
_WALL_RGB, _TRUE_ROAD_RGB, _ROAD_RGB, _GHOST_RGB = (225, 25, 25), (150, 215, 160), (25, 70, 220), (230, 0, 200)


@dataclass(frozen=True, slots=True, eq=False)
class CloudCheck:
    """The slice of a cloud (n points, in the building's frame), judged."""

    points_m: FloatArray
    is_slice: BoolArray
    """Which points of the whole cloud (k,) the slice has."""
    is_wall: BoolArray
    """Points near walls, and near nothing else."""
    wall_distance_m: FloatArray
    """From the nearest wall's surface: positive before it, negative inside it."""
    stretch_count: int
    doubled_count: int
    is_ghost: BoolArray
    """Points in free space along the road."""
    ghost_share: float
    """Of the points of the slice along the road."""
    ghost_clusters: FloatArray
    """Where many ghosts are together (m, 3): x, y, number of points."""

    @property
    def wall_median_m(self) -> float:
        """Median distance of wall points from the true wall."""
        return float(np.median(np.abs(self.wall_distance_m[self.is_wall])))

    def wall_share_within(self, limit_m: float) -> float:
        """Share of wall points that lie so near to the true wall."""
        return float(np.mean(np.abs(self.wall_distance_m[self.is_wall]) <= limit_m))

    @property
    def ghost_volume_m3(self) -> float:
        """Volume of the voxels that show ghosts."""
        return float(np.count_nonzero(self.is_ghost)) * VOXEL_M**3


def checked_cloud(building: Building, cloud_m: FloatArray, road_m: FloatArray) -> CloudCheck:
    """Compare the slice of a cloud (k, 3) with the true building; ``road_m`` (m, 2) is the true walk."""
    is_slice = (cloud_m[:, 2] > LOW_M) & (cloud_m[:, 2] < HIGH_M)
    points_m = cloud_m[is_slice]
    walls = [solid for solid in building.solids if solid.name.startswith(("wall", "window"))]
    wall_distance, nearest_wall = _nearest(walls, points_m)
    others, _ = _nearest([solid for solid in building.solids if solid not in set(walls)], points_m)
    clear = _clearance(building, points_m)
    is_wall = (np.abs(wall_distance) < NEAR_WALL_M) & (others > ON_SURFACE_M)
    # A point in the air beside a wall that is on a leaf or a picture's edge is none of the wall's.
    is_wall &= (clear > np.abs(wall_distance) - 0.03) | (np.abs(wall_distance) < 0.05)
    doubled, stretches = _doubled_stretches(walls, points_m[is_wall], wall_distance[is_wall], nearest_wall[is_wall])
    near_road = cKDTree(road_m).query(points_m[:, :2])[0] < ROAD_REACH_M
    is_ghost = near_road & (clear > GHOST_CLEAR_M)
    return CloudCheck(
        points_m,
        is_slice,
        is_wall,
        wall_distance,
        stretches,
        doubled,
        is_ghost,
        float(np.count_nonzero(is_ghost) / max(1, np.count_nonzero(near_road))),
        _clusters(points_m[is_ghost]),
    )


def _clearance(building: Building, points_m: FloatArray) -> FloatArray:
    """Return the distance (n,) of points from everything that is really there."""
    real = RayScene([surface for surface in building.surfaces if surface.texture != GLASS])
    clear: FloatArray = real.nearest_m(np.ascontiguousarray(points_m, np.float32)).astype(np.float64)
    return clear


def _distance_from(solid: Solid, points_m: FloatArray) -> FloatArray:
    """Return the signed distance (n,) of points from an upright box, on the floor plan; inf at other heights."""
    c, s = np.cos(solid.yaw_rad), np.sin(solid.yaw_rad)
    x, y = points_m[:, 0] - solid.x_m, points_m[:, 1] - solid.y_m
    beyond_x = np.abs(c * x + s * y) - solid.half_x_m
    beyond_y = np.abs(-s * x + c * y) - solid.half_y_m
    outside = np.hypot(np.maximum(beyond_x, 0.0), np.maximum(beyond_y, 0.0))
    signed: FloatArray = outside + np.minimum(np.maximum(beyond_x, beyond_y), 0.0)
    signed[(points_m[:, 2] < solid.low_m - 0.05) | (points_m[:, 2] > solid.high_m + 0.05)] = np.inf
    return signed


def _nearest(solids: list[Solid], points_m: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the signed distance (n,) of points from the nearest of several boxes, and which that is."""
    distance = np.full(len(points_m), np.inf)
    nearest = np.zeros(len(points_m), np.int64)
    for number, solid in enumerate(solids):
        own = _distance_from(solid, points_m)
        nearest[own < distance] = number
        distance = np.minimum(distance, own)
    return distance, nearest


def _doubled_stretches(
    walls: list[Solid], points_m: FloatArray, distance_m: FloatArray, wall: NDArray[np.int64]
) -> tuple[int, int]:
    """Return how many stretches of wall, of each side, have two layers of points, and how many there are."""
    along, side = _along_walls(walls, points_m, wall)
    key = (wall * 1000 + np.floor(along / STRETCH_M).astype(np.int64) + 500) * 2 + side
    doubled = count = 0
    for stretch in np.unique(key):
        own = distance_m[key == stretch]
        if len(own) < MIN_CLUSTER:
            continue
        count += 1
        doubled += _has_two_layers(own)
    return doubled, count


def _along_walls(
    walls: list[Solid], points_m: FloatArray, wall: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the place (n,) of points along the long side of their walls, and on which side (0, 1) they are."""
    table = np.array([(w.x_m, w.y_m, w.yaw_rad) for w in walls])[wall]
    x, y = points_m[:, 0] - table[:, 0], points_m[:, 1] - table[:, 1]
    c, s = np.cos(table[:, 2]), np.sin(table[:, 2])
    return c * x + s * y, (-s * x + c * y > 0).astype(np.int64)


def _has_two_layers(distance_m: FloatArray) -> bool:
    """Tell whether the distances of a stretch's points from the wall have two peaks with a gap between them."""
    edges = np.arange(-0.1, NEAR_WALL_M + _BIN_M, _BIN_M)
    counts = ndimage.uniform_filter1d(np.histogram(distance_m, edges)[0].astype(np.float64), 2)
    first = int(np.argmax(counts))
    apart = np.abs(np.arange(len(counts)) - first) * _BIN_M >= _LAYER_GAP_M
    if not apart.any():
        return False
    second = int(np.flatnonzero(apart)[np.argmax(counts[apart])])
    between = counts[min(first, second) : max(first, second) + 1].min()
    return bool(counts[second] >= SECOND_PEAK * counts[first] and between < 0.5 * counts[second])


def _clusters(ghosts_m: FloatArray) -> FloatArray:
    """Return where at least ``MIN_CLUSTER`` ghosts are within half a metre of each other (m, 3): x, y, number."""
    if not len(ghosts_m):
        return np.zeros((0, 3))
    cells = np.floor(ghosts_m[:, :2] / 0.25).astype(np.int64)
    low = cells.min(axis=0)
    grid = np.zeros(tuple(cells.max(axis=0) - low + 1), np.int64)
    np.add.at(grid, tuple((cells - low).T), 1)
    labels, count = ndimage.label(grid, np.ones((3, 3)))
    of_point = labels[tuple((cells - low).T)]
    rows = [
        (*ghosts_m[of_point == k, :2].mean(axis=0), float(np.count_nonzero(of_point == k))) for k in range(1, count + 1)
    ]
    table = np.array([row for row in rows if row[2] >= MIN_CLUSTER]).reshape(-1, 3)
    return table[np.argsort(-table[:, 2])]


def drawn_cloud(
    building: Building,
    check: CloudCheck,
    colours_rgb: NDArray[np.uint8],
    true_road_m: FloatArray,
    road_m: FloatArray,
    path: Path,
) -> None:
    """Write the top view: the cloud's slice, the true walls over it, the true road and the estimated one, ghosts.

    Raises InputError where the file cannot be written.
    """
    view = plan_view(building, _PX_PER_M * _FINER)
    image = np.full((view.height_px, view.width_px, 3), 255, np.uint8)
    places = np.rint(view.pixels(check.points_m[:, :2])).astype(np.int64)
    for (column, row), colour in zip(places.tolist(), colours_rgb[check.is_slice].tolist(), strict=True):
        # Darkened, for white walls must show on white paper.
        image[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2] = [value * 2 // 3 for value in colour]
    for solid in building.solids:
        if solid.name.startswith(("wall", "window")) and solid.low_m < HIGH_M:
            _draw_line(image, view, solid.outline_m, _WALL_RGB, 1, closed=True)
    _draw_line(image, view, true_road_m, _TRUE_ROAD_RGB, 7)
    _draw_line(image, view, road_m, _ROAD_RGB, 2)
    for ghost in view.pixels(check.points_m[check.is_ghost][:, :2]):
        cv2.circle(image, (round(float(ghost[0])), round(float(ghost[1]))), 5, _GHOST_RGB, -1)
    smaller = np.asarray(cv2.resize(image, None, fx=1 / _FINER, fy=1 / _FINER, interpolation=cv2.INTER_AREA), np.uint8)
    _write_legend(smaller)
    options = [cv2.IMWRITE_JPEG_QUALITY, 80] if path.suffix.lower() in (".jpg", ".jpeg") else []
    if not cv2.imwrite(str(path), smaller[:, :, ::-1], options):
        raise InputError(f"{path} cannot be written: name a .jpg or .png file in a folder that exists.")


def _draw_line(
    image: NDArray[np.uint8], view: PlanView, points_m: FloatArray, rgb: Rgb, width_px: int, *, closed: bool = False
) -> None:
    points = np.rint(view.pixels(points_m) * 16).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(image, [points], closed, rgb, width_px, cv2.LINE_AA, 4)


def _write_legend(image: NDArray[np.uint8]) -> None:
    legend = (
        (f"cloud between {LOW_M:g} and {HIGH_M:g} m", (110, 110, 110)),
        ("true walls", _WALL_RGB),
        ("true road", _TRUE_ROAD_RGB),
        ("estimated road", _ROAD_RGB),
        ("points where nothing is", _GHOST_RGB),
    )
    for number, (text, rgb) in enumerate(legend):
        row = image.shape[0] - 22 - 22 * (len(legend) - 1 - number)
        cv2.line(image, (14, row), (44, row), rgb, 3)
        cv2.putText(image, text, (54, row + 5), cv2.FONT_HERSHEY_DUPLEX, 0.5, (40, 40, 44), 1, cv2.LINE_AA)
