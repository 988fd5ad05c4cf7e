"""How long the readout of a picture takes, from how well a bundle-adjusted map fits together.

The readout time is one more unknown of the bundle adjustment, its Jacobian being how far each feature was moved per
second of it. Instead of carrying it through, one Gauss–Newton step is taken where the adjustment has ended, with all
poses and landmarks eliminated: exact to first order, and it costs less than one iteration.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.bundle_kernels import (
    back_substitute,
    damp_points,
    eliminate,
    linearize,
    observation_jacobians,
    pair_blocks,
)
from navcore.slam.reduced_system import solve_reduced

_DAMPING = 1e-6


def parameter_step(
    camera: FloatArray,
    poses: FloatArray,
    fixed: NDArray[np.bool_],
    points: FloatArray,
    obs_keyframe: NDArray[np.int32],
    obs_point: NDArray[np.int32],
    obs_uvr: FloatArray,
    obs_per_unit: FloatArray,
    inv_sigma2: FloatArray,
    used: NDArray[np.bool_],
) -> tuple[float, float]:
    """Return by how much to change a number that all observations depend on, and its information.

    Arguments are those of :func:`navcore.slam.bundle_adjustment.bundle_adjust` and its result; ``camera`` (5,) is
    fx, fy, cx, cy in pixels and bf in px·m, ``obs_per_unit`` (M, 3) how observations change with the number, and
    ``used`` (M,) which of them agree. The information is zero where the number cannot be told.
    """
    order = np.lexsort((obs_keyframe, obs_point))
    keyframe, point, uvr = obs_keyframe[order], obs_point[order], np.ascontiguousarray(obs_uvr[order])
    per_unit, weight, chosen = np.ascontiguousarray(obs_per_unit[order]), inv_sigma2[order], used[order]
    free = np.where(fixed, -1, np.cumsum(~fixed) - 1).astype(np.int32)
    start = np.searchsorted(point, np.arange(len(points) + 1)).astype(np.int64)
    cameras = int(free.max()) + 1
    hcc, gc = np.zeros((cameras, 6, 6)), np.zeros((cameras, 6))
    hpp, gp = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    hcp = np.zeros((len(keyframe), 6, 3))
    linearize(camera, keyframe, point, uvr, weight, free, poses, points, chosen, False, hcc, gc, hpp, gp, hcp)
    gc_unit, gp_unit = np.zeros_like(gc), np.zeros_like(gp)
    own, along = unit_gradient(
        camera, keyframe, point, uvr, per_unit, weight, free, poses, points, chosen, gc_unit, gp_unit
    )
    if own <= 0.0 or cameras == 0:
        return 0.0, 0.0
    block_of, row, col = pair_blocks(keyframe, free, start, cameras)
    inverse = damp_points(hpp, _DAMPING)
    blocks, rhs = eliminate(
        keyframe, free, start, chosen, hcc, gc_unit, gp_unit, hcp, inverse, _DAMPING, block_of, len(row)
    )
    step_c = solve_reduced(blocks, row, col, rhs)
    if step_c is None:
        return 0.0, 0.0
    step_p = back_substitute(keyframe, free, start, chosen, gp_unit, hcp, inverse, step_c)
    information = own + float(np.sum(gc_unit * step_c) + np.sum(gp_unit * step_p))
    slope = along + float(np.sum(gc * step_c) + np.sum(gp * step_p))
    if information <= 1e-6 * own:
        return 0.0, 0.0
    return -slope / information, information


@kernel
def unit_gradient(
    camera: FloatArray,
    keyframe: NDArray[np.int32],
    point: NDArray[np.int32],
    uvr: FloatArray,
    per_unit: FloatArray,
    inv_sigma2: FloatArray,
    free: NDArray[np.int32],
    poses: FloatArray,
    points: FloatArray,
    used: NDArray[np.bool_],
    gc: FloatArray,
    gp: FloatArray,
) -> tuple[float, float]:
    """Add Jᵀ W d to gc (C, 6) and gp (N, 3), d (M, 3) being the errors' change with the number; return dᵀWd, dᵀWe."""
    e = np.empty(3)
    jc = np.empty((3, 6))
    jp = np.empty((3, 3))
    own = along = 0.0
    for m in range(len(keyframe)):
        if not used[m]:
            continue
        rows = observation_jacobians(camera, poses[keyframe[m]], points[point[m]], uvr[m], e, jc, jp)
        c, p, w = free[keyframe[m]], point[m], inv_sigma2[m]
        for r in range(rows):
            # The error is what is expected less what was observed.
            d = -per_unit[m, r]
            own += w * d * d
            along += w * d * e[r]
            for i in range(3):
                gp[p, i] += w * d * jp[r, i]
            if c >= 0:
                for i in range(6):
                    gc[c, i] += w * d * jc[r, i]
    return own, along
