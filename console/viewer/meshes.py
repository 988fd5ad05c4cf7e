"""Small meshes and poses for the scene. Pure functions; viser is not imported here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navcore.geometry import FloatArray

FIGURE_EYE_HEIGHT_M = 1.6
"""Eye height of the figure as it is modelled; it is scaled to the walker's."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles: vertices (v, 3) and faces (f, 3)."""

    vertices_m: FloatArray
    faces: NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class Placements:
    """Where the copies of one mesh stand: quaternions (n, 4) w first, positions (n, 3), scales (n, 3)."""

    quats_wxyz: FloatArray
    positions_m: FloatArray
    scales: FloatArray


def lathe(profile_m: Sequence[tuple[float, float]], sides_count: int = 20) -> Mesh:
    """Turn a profile of (radius, height) points about the z axis."""
    turn = np.linspace(0.0, math.tau, sides_count, endpoint=False)
    rings = [np.column_stack([r * np.cos(turn), r * np.sin(turn), np.full(sides_count, z)]) for r, z in profile_m]
    faces: list[tuple[int, int, int]] = []
    for ring in range(len(profile_m) - 1):
        for side in range(sides_count):
            a, b = ring * sides_count + side, ring * sides_count + (side + 1) % sides_count
            faces += [(a, b, a + sides_count), (b, b + sides_count, a + sides_count)]
    return Mesh(np.vstack(rings), np.array(faces, dtype=np.uint32))


def unit_cylinder(sides_count: int = 10) -> Mesh:
    """A cylinder of radius 1 from z = −½ to z = ½, closed at both ends."""
    return lathe([(0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5)], sides_count)


def unit_cone(sides_count: int = 14) -> Mesh:
    """A cone of radius 1 at z = −½ with its tip at z = ½."""
    return lathe([(0.0, -0.5), (1.0, -0.5), (0.0, 0.5)], sides_count)


def walker_body() -> Mesh:
    """The walker's body, feet to neck, on the floor at the origin; its eyes would be at FIGURE_EYE_HEIGHT_M."""
    return lathe(
        [(0.0, 0.0), (0.15, 0.0), (0.17, 0.03), (0.14, 0.10), (0.15, 0.55), (0.21, 1.05), (0.24, 1.28), (0.19, 1.40),
         (0.08, 1.46), (0.0, 1.47)], 24,
    )  # fmt: skip


def merged(*parts: tuple[Mesh, float]) -> Mesh:
    """Put meshes together as one, each raised by a height in metres."""
    vertices = [mesh.vertices_m + np.array([0.0, 0.0, up_m]) for mesh, up_m in parts]
    firsts = np.cumsum([0, *(len(part) for part in vertices)])[:-1]
    faces = [mesh.faces + np.uint32(first) for (mesh, _), first in zip(parts, firsts, strict=True)]
    return Mesh(np.vstack(vertices), np.vstack(faces))


def ball(radius_m: float, sides_count: int = 18, rings_count: int = 10) -> Mesh:
    """A ball about the origin."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, rings_count)
    return lathe([(radius_m * math.cos(a), radius_m * math.sin(a)) for a in angles], sides_count)


def upright(radius_m: float, height_m: float, sides_count: int = 20) -> Mesh:
    """A closed upright cylinder about the origin; of four sides, a box."""
    half_m = height_m / 2
    return lathe([(0.0, -half_m), (radius_m, -half_m), (radius_m, half_m), (0.0, half_m)], sides_count)


def diamond(radius_m: float) -> Mesh:
    """An octahedron about the origin."""
    return lathe([(0.0, -radius_m), (radius_m, 0.0), (0.0, radius_m)], 4)


def ribbon(paths_m: Sequence[FloatArray], width_m: float) -> Mesh:
    """Flat bands of one width along paths (n, 2), on the floor, facing up."""
    vertices: list[FloatArray] = []
    faces: list[NDArray[np.uint32]] = []
    first = 0
    for path in paths_m:
        side = _sides(path) * (width_m / 2)
        both = np.stack([path + side, path - side], axis=1).reshape(-1, 2)
        vertices.append(np.column_stack([both, np.zeros(len(both))]))
        left = first + 2 * np.arange(len(path) - 1, dtype=np.uint32)
        faces += [np.column_stack([left, left + 1, left + 2]), np.column_stack([left + 1, left + 3, left + 2])]
        first += len(both)
    return Mesh(np.vstack(vertices), np.vstack(faces).astype(np.uint32))


def _sides(path_m: FloatArray) -> FloatArray:
    """Return at each point of a path (n, 2) the way to its left edge, longer at bends, so that the width holds."""
    steps = np.diff(path_m, axis=0)
    along = steps / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
    left = np.column_stack([-along[:, 1], along[:, 0]])
    before, after = np.vstack([left[:1], left]), np.vstack([left, left[-1:]])
    # At a sharp bend the corner would lie far away: it is cut.
    return np.asarray((before + after) / np.maximum(1.0 + (before * after).sum(axis=1, keepdims=True), 0.5))


def ring(radius_m: float, width_m: float, sides_count: int = 48) -> Mesh:
    """A flat ring on the floor."""
    return lathe([(max(radius_m - width_m, 0.0), 0.0), (radius_m, 0.0)], sides_count)


def dashed_ring(radius_m: float, z_m: float, dashes_count: int = 12) -> FloatArray:
    """Return a ring of dashes as segments (3 · dashes, 2, 3): each dash has three, each gap is as long."""
    ring_rad = np.linspace(0.0, 2.0 * np.pi, 6 * dashes_count + 1)
    circle_m = radius_m * np.column_stack([np.cos(ring_rad), np.sin(ring_rad)])
    segments = line_segments(circle_m, z_m)
    return segments[np.arange(len(segments)) % 6 < 3]


def horizontal_cone(half_angle_rad: float, length_m: float, sides_count: int = 24) -> Mesh:
    """A cone with its tip at the origin that opens along the x axis: the ultrasonic field."""
    upright = lathe([(0.0, 0.0), (length_m * math.tan(half_angle_rad), length_m)], sides_count)
    return Mesh(upright.vertices_m[:, [2, 0, 1]].copy(), upright.faces)


def line_segments(path_m: FloatArray, z_m: float) -> FloatArray:
    """Return a path (n, 2) as segments (n − 1, 2, 3) at one height; none for a single point."""
    if len(path_m) < 2:
        return np.zeros((0, 2, 3))
    points = np.column_stack([path_m[:, 0], path_m[:, 1], np.full(len(path_m), z_m)])
    return np.stack([points[:-1], points[1:]], axis=1)


def along(path_m: FloatArray, radius_m: float, z_m: float) -> Placements:
    """Place unit cylinders along a path (n, 2) at one height."""
    segments = line_segments(path_m, z_m)
    steps = segments[:, 1] - segments[:, 0]
    lengths = np.linalg.norm(steps, axis=1)
    keep = lengths > 1e-6
    segments, steps, lengths = segments[keep], steps[keep], lengths[keep]
    scales = np.column_stack([np.full(len(lengths), radius_m), np.full(len(lengths), radius_m), lengths])
    return Placements(quats_from_z_to(steps / lengths[:, None]), segments.mean(axis=1), scales)


def quats_from_z_to(directions: FloatArray) -> FloatArray:
    """Return quaternions (n, 4), w first, that turn the z axis into unit directions (n, 3)."""
    quats = np.column_stack(
        [1.0 + directions[:, 2], -directions[:, 1], directions[:, 0], np.zeros(len(directions))]
    )  # fmt: skip
    straight_down = quats[:, 0] < 1e-9
    quats[straight_down] = (0.0, 1.0, 0.0, 0.0)
    return np.asarray(quats / np.linalg.norm(quats, axis=1, keepdims=True))


def quat_about_z(angle_rad: float) -> tuple[float, float, float, float]:
    """Return the quaternion, w first, of a turn seen from above."""
    return (math.cos(angle_rad / 2), 0.0, 0.0, math.sin(angle_rad / 2))


def simplified(path_m: FloatArray, tolerance_m: float = 0.03) -> FloatArray:
    """Return a path (n, 2) with fewer points, within the tolerance of the given one (Douglas–Peucker)."""
    path = np.asarray(path_m, dtype=np.float64)
    keep = np.zeros(len(path), dtype=bool)
    keep[[0, -1]] = True
    spans = [(0, len(path) - 1)]
    while spans:
        start, end = spans.pop()
        if end - start < 2:
            continue
        offsets_m = _distance_to_chord_m(path[start + 1 : end], path[start], path[end])
        farthest = int(np.argmax(offsets_m))
        if offsets_m[farthest] > tolerance_m:
            middle = start + 1 + farthest
            keep[middle] = True
            spans += [(start, middle), (middle, end)]
    return np.asarray(path[keep])


def _distance_to_chord_m(points_m: FloatArray, start_m: FloatArray, end_m: FloatArray) -> FloatArray:
    chord = end_m - start_m
    squared = float(chord @ chord)
    if squared < 1e-12:
        return np.asarray(np.linalg.norm(points_m - start_m, axis=1))
    share = np.clip((points_m - start_m) @ chord / squared, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points_m - start_m - share[:, None] * chord, axis=1))


def spaced(path_m: FloatArray, spacing_m: float, offset_m: float) -> tuple[FloatArray, FloatArray]:
    """Return points (k, 2) along a path every ``spacing_m`` from ``offset_m``, and unit directions (k, 2) there."""
    steps = np.diff(path_m, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    keep = lengths > 1e-9
    steps, lengths, starts = steps[keep], lengths[keep], path_m[:-1][keep]
    if len(lengths) == 0:
        return np.zeros((0, 2)), np.zeros((0, 2))
    ends_at = np.cumsum(lengths)
    places = np.arange(offset_m, ends_at[-1], spacing_m)
    index = np.minimum(np.searchsorted(ends_at, places, side="right"), len(lengths) - 1)
    directions = steps[index] / lengths[index][:, None]
    into = places - (ends_at[index] - lengths[index])
    return starts[index] + into[:, None] * directions, directions


def dashes(path_m: FloatArray, dash_m: float, gap_m: float) -> list[FloatArray]:
    """Cut a path (n, 2) into dashes, each a path of its own."""
    starts, _ = spaced(path_m, dash_m + gap_m, 0.0)
    ends, _ = spaced(path_m, dash_m + gap_m, dash_m)
    if len(ends) < len(starts):
        ends = np.vstack([ends.reshape(-1, 2), path_m[-1:]])
    return [np.stack([a, b]) for a, b in zip(starts, ends, strict=False)]


def middle_of(path_m: FloatArray) -> tuple[float, float]:
    """Return the point half-way along a path (n, 2)."""
    length_m = float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum())
    points, _ = spaced(np.asarray(path_m, dtype=np.float64), max(length_m, 1e-6), length_m / 2)
    x_m, y_m = points[0] if len(points) else path_m[0]
    return float(x_m), float(y_m)


def floor_point(
    origin_m: Sequence[float], direction: Sequence[float], z_m: float = 0.0
) -> tuple[float, float] | None:  # fmt: skip
    """Return where a ray meets the horizontal plane at ``z_m``; None where it does not, or only beyond 1 km."""
    if abs(direction[2]) < 1e-6:
        return None
    share = (z_m - origin_m[2]) / direction[2]
    if not 0.0 < share * math.hypot(direction[0], direction[1], direction[2]) < 1000.0:
        return None
    return float(origin_m[0] + share * direction[0]), float(origin_m[1] + share * direction[1])
