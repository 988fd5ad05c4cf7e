"""What is begun and not yet accepted, in the scene of one client: rings on the floor, lines, the keyboard's cursor.

All nodes are made once; only their properties change.
"""

from __future__ import annotations

import itertools

import numpy as np
import viser

from console.viewer import meshes
from console.viewer.appearance import DARK, Rgb, Theme
from console.viewer.begun import Begun, Drawing, FloorPoint, NewEdges, NewPlace, TrimmedRoad
from navcore.geometry import FloatArray

_LINE_Z_M, _RING_Z_M, _CURSOR_Z_M = 0.12, 0.06, 0.14
_CROSS_M = 0.12
_CURSOR_M = 0.45


class PreviewLayer:
    """Draws what is begun for one client."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._lines = self._add_lines("/graph/preview", DARK.preview, 6.0)
        self._cursor = self._add_lines("/graph/cursor", DARK.cursor, 4.0)
        self._ring = self._add_ring("/graph/pending", 48)
        self._square = self._add_ring("/graph/pending_free", 4)
        self._end_rings = [self._add_ring(f"/graph/end{n}", 48) for n in (0, 1)]

    def set_theme(self, theme: Theme) -> None:
        """Draw in other colours from now on."""
        self._lines.colors = np.array(theme.preview, dtype=np.uint8)
        self._cursor.colors = np.array(theme.cursor, dtype=np.uint8)
        for ring in (self._ring, self._square, *self._end_rings):
            ring.color = theme.preview

    def show(self, begun: Begun | None, snapped_m: tuple[FloorPoint, ...], cursor_m: FloorPoint | None) -> None:
        """Draw what is begun; ``snapped_m`` are the places where a drawn line meets a road."""
        with self._client.atomic():
            show_lines(self._lines, _lines_of(begun), _LINE_Z_M)
            place = begun if isinstance(begun, NewPlace) else None
            _put(self._ring, place.place_m if place is not None and place.on_road else None)
            _put(self._square, place.place_m if place is not None and not place.on_road else None)
            ends: tuple[FloorPoint | None, ...] = snapped_m
            if isinstance(begun, TrimmedRoad):
                ends = (begun.start_m,)
            for ring, end in itertools.zip_longest(self._end_rings, ends[:2]):
                _put(ring, end)
            show_lines(self._cursor, [] if cursor_m is None else _cross(cursor_m, _CURSOR_M), _CURSOR_Z_M)

    def _add_lines(self, name: str, colour: Rgb, thickness_px: float) -> viser.LineSegmentsHandle:
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        return self._client.scene.add_line_segments(
            name, nothing, colour, thickness=thickness_px, thickness_units="screen", visible=False
        )

    def _add_ring(self, name: str, sides_count: int) -> viser.MeshHandle:
        mesh = meshes.ring(0.32, 0.12, sides_count)
        return self._client.scene.add_mesh_simple(
            name, mesh.vertices_m, mesh.faces, color=DARK.preview, side="double", visible=False, cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip


def show_lines(handle: viser.LineSegmentsHandle, paths_m: list[FloatArray], z_m: float) -> None:
    """Draw paths (n, 2) at one height; none hides the node."""
    pieces = [meshes.line_segments(path_m, z_m) for path_m in paths_m]
    points = np.concatenate(pieces) if pieces else np.zeros((0, 2, 3))
    handle.visible = len(points) > 0
    if len(points):
        handle.points = points.astype(np.float32)


def _lines_of(begun: Begun | None) -> list[FloatArray]:
    match begun:
        case NewEdges(edges):
            return [np.array(edge.path_m) for edge in edges]
        case Drawing(points_m):
            return [np.array(points_m), *(arm for point in points_m for arm in _cross(point, _CROSS_M))]
        case _:
            return []


def _cross(point_m: FloorPoint, arm_m: float) -> list[FloatArray]:
    x, y = point_m
    return [np.array([(x - arm_m, y), (x + arm_m, y)]), np.array([(x, y - arm_m), (x, y + arm_m)])]


def _put(ring: viser.MeshHandle, place_m: FloorPoint | None) -> None:
    ring.visible = place_m is not None
    if place_m is not None:
        ring.position = (*place_m, _RING_Z_M)
