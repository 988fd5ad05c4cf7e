"""The colour image is not taken all at once: row after row is read, and the camera moves meanwhile.

At 1.5 rad/s and 500 px of focal length, the 25 ms that a Kinect takes from the first row to the last bend the picture
by 20 px, which pose and map would have to explain by a movement that never was. Where the camera's velocity is known,
each feature is moved to where it would have been seen at the time of the middle row (Ringaby and Forssén 2011); all
that follows works with ideal pictures. How long the readout takes is estimated along with the map
(:mod:`navcore.slam.readout_estimation`); of a camera that takes its picture at once, the estimate is zero.

A velocity is a twist per second (6,), translation in m/s, then rotation in rad/s, multiplied from the left:
camera_from_world(t + dt) = exp(velocity · dt) camera_from_world(t).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.features import GRID_PX, sort_into_cells
from navcore.slam.keyframes import MAX_READOUT_S, Features, SlamCamera
from navcore.slam.lie import inverse_se3, log_se3, product

MIN_VELOCITY_GAP_S = 0.01
"""Over less than this, what poses are uncertain by is a velocity."""
MAX_SPEED_M_S = 2.0
"""A faster step is a pose that was put right, not a walk."""
MAX_VELOCITY_GAP_S = 0.08
"""Between poses farther apart than this a head may have turned to and fro: what led from one to the other is not the
velocity at the second. At 10 pictures a second a camera without readout seemed to have one of 1 ms."""
DRIFT = 0.5
"""Share of what was known that still counts when the map says anew how long the readout takes: both rest on nearly the
same observations, but the later ones had better places to start from."""
MIN_READOUT_S = 1e-3
"""A picture that is read in less is taken as it is: fast turns bend it by less than a corner is uncertain."""
KEPT_SHARE = 0.9
"""So many of a pose's landmarks must agree when the readout has been taken out, or it is not."""
START_SIGMA_S = 0.01
"""How far from zero a readout time may well be, before anything has been seen."""


@dataclass(frozen=True, slots=True)
class ReadoutTime:
    """How long the camera takes from its first row to its last: negative where it begins below."""

    seconds: float = 0.0
    information: float = START_SIGMA_S**-2
    """Inverse variance, 1/s²."""

    def refined(self, step_s: float, information: float) -> ReadoutTime:
        """Return what is known after the map said that it is ``step_s`` longer, with an information in 1/s²."""
        kept = max(DRIFT * self.information, START_SIGMA_S**-2)
        total = kept + information
        seconds = self.seconds + step_s * information / total
        return ReadoutTime(min(max(seconds, -MAX_READOUT_S), MAX_READOUT_S), total)


def velocity_between(earlier: FloatArray, later: FloatArray, step_s: float) -> FloatArray:
    """Return the velocity (6,) from one camera_from_world (4, 4) to another ``step_s`` later; zero if not known."""
    if not MIN_VELOCITY_GAP_S <= abs(step_s) <= MAX_VELOCITY_GAP_S:
        return np.zeros(6)
    velocity = np.asarray(log_se3(product(later, inverse_se3(earlier))) / step_s)
    return velocity if np.linalg.norm(velocity[:3]) <= MAX_SPEED_M_S else np.zeros(6)


def unrolled(features: Features, velocity: FloatArray, readout_s: float, camera: SlamCamera) -> Features:
    """Return features where they would have been seen at the time of the middle row, in the same order.

    ``velocity`` is a twist per second (6,). What was seen is kept beside it, so that it can be done again when the
    velocity or the readout time is known better.
    """
    seen = features.uvr_px if features.rolled_uvr_px is None else features.rolled_uvr_px
    uvr, depth_m = unroll(
        seen,
        np.ascontiguousarray(velocity),
        readout_s,
        camera.height_px,
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        camera.bf_px_m,
    )
    return replace(features, uvr_px=uvr, depth_m=depth_m, rolled_uvr_px=seen)


def sorted_anew(features: Features, camera: SlamCamera) -> tuple[Features, NDArray[np.int64]]:
    """Return features sorted into the grid by where they are now, and the order (n,) that does it."""
    rows = (camera.height_px + GRID_PX - 1) // GRID_PX
    order, cell_start = sort_into_cells(features.uvr_px, features.cell_columns, rows)
    ordered = replace(
        features,
        uvr_px=features.uvr_px[order],
        depth_m=features.depth_m[order],
        octave=features.octave[order],
        angle_rad=features.angle_rad[order],
        descriptors=features.descriptors[order],
        cell_start=cell_start,
        rolled_uvr_px=None if features.rolled_uvr_px is None else features.rolled_uvr_px[order],
        slides=None if features.slides is None else features.slides[order],
    )
    return ordered, order


@kernel
def unroll(
    uvr: FloatArray,
    velocity: FloatArray,
    readout_s: float,
    height_px: int,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    bf: float,
) -> tuple[FloatArray, FloatArray]:
    """Return u, v, u_r (n, 3) and depth (n,) at the time of the middle row, of what was seen (n, 3) row by row.

    Where no depth was measured, translation does not count: it moves what is far away little.
    """
    out = np.empty_like(uvr)
    depth = np.empty(len(uvr))
    rx, ry, rz = velocity[3], velocity[4], velocity[5]
    for i in range(len(uvr)):
        late_s = readout_s * (uvr[i, 1] / height_px - 0.5)
        z = bf / (uvr[i, 0] - uvr[i, 2])
        has_depth = z > 0.0
        if not has_depth:
            z = 1.0
        x = (uvr[i, 0] - cx) / fx * z
        y = (uvr[i, 1] - cy) / fy * z
        dx, dy, dz = ry * z - rz * y, rz * x - rx * z, rx * y - ry * x
        if has_depth:
            dx, dy, dz = dx + velocity[0], dy + velocity[1], dz + velocity[2]
        if z - late_s * dz <= 0.5 * z:
            # Nothing comes so near within one picture: the velocity is wrong.
            dx, dy, dz = 0.0, 0.0, 0.0
        x, y, z = x - late_s * dx, y - late_s * dy, z - late_s * dz
        out[i, 0] = fx * x / z + cx
        out[i, 1] = fy * y / z + cy
        depth[i] = z if has_depth else np.nan
        out[i, 2] = out[i, 0] - bf / depth[i]
    return out, depth
