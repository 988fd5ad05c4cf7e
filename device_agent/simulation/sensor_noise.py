"""The compiled part of the camera model: noise, missing depth, shadows of the second imager."""

from __future__ import annotations

import math

import numpy as np

from device_agent.simulation.shading import F32, U8
from device_agent.simulation.textures import Material
from navcore.compiled import kernel

SHINY = int(Material.SHINY)
LIT = int(Material.LIT)
ABSORBING = int(Material.ABSORBING)
_IMAGER_FOCAL_PX = 424.0


@kernel
def spoil_colour(
    image: U8, red: F32, green: F32, blue: F32, gain: float, read_sigma: float, shot_sigma: float, out: U8
) -> None:
    """Fill ``out`` (h, w, 3): exposure, noise of read-out and light. Noise fields (h, w), standard normal."""
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            for c in range(3):
                value = gain * image[v, u, c]
                grain = red[v, u] if c == 0 else (green[v, u] if c == 1 else blue[v, u])
                value += grain * math.sqrt(read_sigma * read_sigma + shot_sigma * shot_sigma * value / 255.0)
                out[v, u, c] = np.uint8(min(255.0, max(0.0, value + 0.5)))


@kernel
def spoil_depth(
    depth: F32,
    incidence: F32,
    material: U8,
    fine: F32,
    coarse: F32,
    blobs: F32,
    focal_px: float,
    focal_baseline: float,
    sigma_px: float,
    step_px: float,
    correlated: float,
    min_m: float,
    max_m: float,
    grazing: float,
    shiny_missing: float,
    lit_missing: float,
    random_missing: float,
    edge_missing: float,
    out: F32,
) -> None:
    """Fill ``out`` (h, w) with what the depth camera reports for the true depth; NaN where it reports nothing.

    ``fine`` and ``coarse`` are standard normal, ``blobs`` is uniform in 0–1 and smooth, all (h, w). The parameters are
    those of :class:`sensors.DepthNoise`.
    """
    rows, columns = depth.shape
    white = math.sqrt(1.0 - correlated * correlated)
    own_baseline = focal_baseline / _IMAGER_FOCAL_PX * focal_px
    for v in range(rows):
        # The second imager sees a pixel at ``seen_at``; left of a near edge, something else hides it there.
        nearest_right = np.inf
        for u in range(columns - 1, -1, -1):
            z = depth[v, u]
            out[v, u] = np.nan
            seen_at = u - own_baseline / z
            hidden = edge_missing > 0.0 and seen_at > nearest_right + 0.5
            nearest_right = min(nearest_right, seen_at)
            if hidden or not z < max_m:
                continue
            missing = _missing_share(
                incidence[v, u], material[v, u], grazing, shiny_missing, lit_missing, random_missing
            )
            if blobs[v, u] < missing:
                continue
            if edge_missing > 0.0 and incidence[v, u] > 0.25 and 0 < u < columns - 1 and 0 < v < rows - 1:
                near = min(min(depth[v, u - 1], depth[v, u + 1]), min(depth[v - 1, u], depth[v + 1, u]))
                z = _on_edge(z, near, blobs[rows - 1 - v, u], blobs[v, columns - 1 - u], edge_missing)
            if z < min_m:
                # Too near: matched wrongly, and reported near if at all.
                z = min_m * (0.6 + 0.5 * blobs[v, u]) if blobs[v, u] >= 0.5 else np.nan
            disparity = focal_baseline / z + sigma_px * (correlated * coarse[v, u] + white * fine[v, u])
            disparity = max(step_px, math.floor(disparity / step_px + 0.5) * step_px)
            measured = focal_baseline / disparity
            if z > 0.0 and measured < max_m:
                out[v, u] = measured


@kernel
def _missing_share(
    incidence: float, material: int, grazing: float, shiny_missing: float, lit_missing: float, random_missing: float
) -> float:
    """Return the share of such pixels that gives no depth."""
    if material == ABSORBING:
        return 1.0
    missing = random_missing
    if incidence < grazing:
        missing += (1.0 - incidence / grazing) * 0.9
    if material == SHINY:
        missing += shiny_missing
    elif material == LIT:
        missing += lit_missing
    return missing


@kernel
def _on_edge(z: float, near: float, luck: float, share: float, edge_missing: float) -> float:
    """Return the depth of a pixel behind a depth edge: none (NaN), or something between front and back."""
    if near >= 0.93 * z or z - near <= 0.05:
        return z
    if luck < edge_missing:
        return np.nan
    return near + (z - near) * share
