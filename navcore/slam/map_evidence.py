"""Whether the map really is where a pose says: what should be in view, what the depth image says of it, what is found.

A pose that is wrong by a period of a repeating wall still finds landmarks, and a blurred view of the right place misses
many. Three measures tell them apart, none of which depends on how densely the map is set with landmarks: surfaces lie
where landmarks are; enough landmarks are found, of as many as the image's features could show; and they are found all
over the image, wherever the map has some.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.keyframes import IntArray
from navcore.slam.matching import project_landmarks
from navcore.slam.tracking import MapView, Track
from navcore.types import DepthImage

CELL_COLUMNS = 8
CELL_ROWS = 6
"""Cells of the image that are counted."""
EXPECTED_IN_CELL = 3
"""Landmarks that should be seen in a cell for it to count."""
MIN_DEPTH_SHARE = 0.8
"""Share of the landmarks in view with which the depth image must agree; what hides a landmark says nothing."""
MIN_FOUND_SHARE = 0.15
"""Share of the landmarks to be found that a convincing pose finds: right ones 0.35–0.9, blurred ones from 0.15 on."""
MIN_CELL_SHARE = 0.65
"""Share of the cells in which some are found: right poses 0.8–1, wrong ones with agreeing depth up to 0.63."""
MIN_SEEN_THROUGH = 10
"""Fewer landmarks behind which the surface lies contradict nothing."""
MIN_CELLS = 5
"""Cells with found landmarks, at least; fewer are a sliver of the map that fixes no pose."""
MIN_FOUND_SHARE_FOLLOWED = 0.08
"""As ``MIN_FOUND_SHARE``, where map and odometry say the same: blur and turning hide landmarks."""
DEPTH_MARGIN_M = 0.1
DEPTH_MARGIN_SHARE = 0.05
"""Surface and landmark agree when their depths differ by less than this, and this share of the depth."""


@dataclass(frozen=True, slots=True)
class MapEvidence:
    """What speaks for a pose at which landmarks were found."""

    found: int
    """Landmarks that agree with the pose."""
    agreeing: int
    """Landmarks that should be in view, and where the depth image shows a surface."""
    seen_through: int
    """Landmarks behind which the surface lies: they are not there, or the pose is wrong."""
    feature_count: int
    """Features of the frame: no more landmarks can be found."""
    cells: int
    """Cells of the image in which landmarks agree with the depth image."""
    found_cells: int
    """Of these, cells in which landmarks were found."""

    @property
    def depth_share(self) -> float:
        """Share of the decided landmarks that agree with the depth image, 0–1; 0 where none is decided."""
        decided = self.agreeing + self.seen_through
        return self.agreeing / decided if decided else 0.0

    @property
    def found_share(self) -> float:
        """Found landmarks over those that could be: ``agreeing`` landmarks that choose among n features at random take
        n (1 − exp(−agreeing / n)) different ones."""
        if self.feature_count == 0 or self.agreeing == 0:
            return 0.0
        return self.found / (self.feature_count * -math.expm1(-self.agreeing / self.feature_count))

    @property
    def cell_share(self) -> float:
        """Share of the cells in which landmarks are found, 0–1."""
        return self.found_cells / self.cells if self.cells else 0.0

    @property
    def is_convincing(self) -> bool:
        """Whether enough of what should be seen is seen, where it should be, all over the image."""
        return (
            self.depth_share >= MIN_DEPTH_SHARE
            and self.found_share >= MIN_FOUND_SHARE
            and self.cell_share >= MIN_CELL_SHARE
            and self.found_cells >= MIN_CELLS
        )

    @property
    def is_contradicted(self) -> bool:
        """Whether the depth image looks through many of the landmarks that should be there."""
        return self.seen_through >= MIN_SEEN_THROUGH and self.depth_share < MIN_DEPTH_SHARE

    @property
    def is_plausible(self) -> bool:
        """Whether nothing speaks against the pose, if something else than the map says the same."""
        return self.depth_share >= MIN_DEPTH_SHARE and self.found_share >= MIN_FOUND_SHARE_FOLLOWED


def evidence_for(view: MapView, track: Track, expected: IntArray, depth_m: DepthImage) -> MapEvidence:
    """Weigh a pose: ``expected`` (k,) are the landmarks of the map around it, ``depth_m`` (h, w) the depth image."""
    uvr, _, octave, _ = project_landmarks(
        track.camera_from_world, view.positions[expected], view.normals[expected], view.reach[expected], view.camera
    )
    camera = view.camera
    found_uv = track.features.uvr_px[track.landmark_of >= 0]
    agreeing, seen_through, cells, found_cells = _weigh(
        uvr, octave, found_uv, depth_m, camera.bf_px_m, float(camera.width_px), float(camera.height_px)
    )
    return MapEvidence(len(found_uv), agreeing, seen_through, len(track.features), cells, found_cells)


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _cell(u: float, v: float, width: float, height: float) -> int:
    column = min(max(int(u * CELL_COLUMNS / width), 0), CELL_COLUMNS - 1)
    row = min(max(int(v * CELL_ROWS / height), 0), CELL_ROWS - 1)
    return row * CELL_COLUMNS + column


@kernel
def _weigh(
    uvr: FloatArray,
    octave: IntArray,
    found_uv: FloatArray,
    depth_m: DepthImage,
    bf: float,
    width: float,
    height: float,
) -> tuple[int, int, int, int]:
    """Return landmarks that agree and that are seen through, cells where some agree, and where some are found."""
    expected = np.zeros(CELL_COLUMNS * CELL_ROWS, np.int64)
    found = np.zeros(CELL_COLUMNS * CELL_ROWS, np.int64)
    agreeing, seen_through = 0, 0
    for i in range(len(uvr)):
        if octave[i] < 0:
            continue
        column = min(max(int(np.floor(uvr[i, 0] + 0.5)), 0), depth_m.shape[1] - 1)
        row = min(max(int(np.floor(uvr[i, 1] + 0.5)), 0), depth_m.shape[0] - 1)
        z = bf / (uvr[i, 0] - uvr[i, 2])
        beyond = float(depth_m[row, column]) - z
        margin = DEPTH_MARGIN_M + DEPTH_MARGIN_SHARE * z
        # Where nothing was measured, both comparisons are false.
        if abs(beyond) < margin:
            agreeing += 1
            expected[_cell(uvr[i, 0], uvr[i, 1], width, height)] += 1
        elif beyond >= margin:
            seen_through += 1
    for i in range(len(found_uv)):
        found[_cell(found_uv[i, 0], found_uv[i, 1], width, height)] += 1
    cells, found_cells = 0, 0
    for c in range(len(expected)):
        if expected[c] >= EXPECTED_IN_CELL:
            cells += 1
            if found[c] > 0:
                found_cells += 1
    return agreeing, seen_through, cells, found_cells
