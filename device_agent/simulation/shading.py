"""The compiled part of the renderer: which ray each pixel casts, and what colour it sees. Arrays are C-contiguous."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]

MAX_TAPS = 3
"""Samples along the longer side of a pixel's footprint, where a surface is seen at a grazing angle."""
RED_BLUE = 0x00FF00FF
"""Mask of two channels of a packed texel."""


@kernel
def aim(in_camera: F32, rotation: NDArray[np.float64], origin: NDArray[np.float64], rays: F32) -> None:
    """Fill ``rays`` (n, 6): origin and direction in the world, of directions (n, 3) in the camera."""
    for i in range(in_camera.shape[0]):
        x, y, z = in_camera[i, 0], in_camera[i, 1], in_camera[i, 2]
        for c in range(3):
            rays[i, c] = origin[c]
            rays[i, 3 + c] = rotation[c, 0] * x + rotation[c, 1] * y + rotation[c, 2] * z


@kernel
def shade(
    rays: F32,
    distance: F32,
    surface_of_ray: I32,
    pixel_rad: float,
    corner: F32,
    axis_u: F32,
    axis_v: F32,
    normal: F32,
    extent_v: F32,
    texture_of: I32,
    texels: NDArray[np.uint32],
    offset: NDArray[np.int64],
    width: I32,
    height: I32,
    shrink: F32,
    px_per_m: F32,
    repeats: U8,
    material_of_texture: U8,
    light: F32,
    light_offset: I32,
    light_shape: I32,
    light_per_m: F32,
    colour: U8,
    incidence: F32,
    material: U8,
) -> None:
    """Fill ``colour`` (n, 3), ``incidence`` (n,), the cosine between ray and normal, and ``material`` (n,).

    ``distance`` (n,) counts in lengths of the rays' directions (n, 6: origin, direction); ``surface_of_ray`` is −1
    where nothing was hit. The other arrays are those of :class:`textures.TextureAtlas` and of the renderer's surfaces.
    """
    last_level = width.shape[1] - 1
    for i in range(distance.shape[0]):
        s = surface_of_ray[i]
        if s < 0:
            colour[i, 0] = 0
            colour[i, 1] = 0
            colour[i, 2] = 0
            incidence[i] = 0.0
            material[i] = 0
            continue
        dx, dy, dz = float(rays[i, 3]), float(rays[i, 4]), float(rays[i, 5])
        t = float(distance[i])
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        px = rays[i, 0] + t * dx - corner[s, 0]
        py = rays[i, 1] + t * dy - corner[s, 1]
        pz = rays[i, 2] + t * dz - corner[s, 2]
        u_m = px * axis_u[s, 0] + py * axis_u[s, 1] + pz * axis_u[s, 2]
        v_m = px * axis_v[s, 0] + py * axis_v[s, 1] + pz * axis_v[s, 2]
        facing = abs(dx * normal[s, 0] + dy * normal[s, 1] + dz * normal[s, 2]) / length
        incidence[i] = facing
        k = texture_of[s]
        material[i] = material_of_texture[k]
        # The footprint is longer by 1 / facing along the ray's direction in the plane.
        short_m = t * length * pixel_rad
        stretch = min(1.0 / max(facing, 0.02), 12.0)
        taps = min(MAX_TAPS, int(stretch + 0.6))
        scale_u, scale_v = float(px_per_m[k, 0]), float(px_per_m[k, 1])
        footprint_px = max(1.0, short_m * max(1.0, stretch / taps) * max(scale_u, scale_v))
        level = math.log2(footprint_px)
        x = u_m * scale_u
        y = (extent_v[s] - v_m) * scale_v
        step_x, step_y, samples, lower = 0.0, 0.0, 2, int(level)
        blend = level - lower
        if taps > 1:
            # Several samples along the footprint hide the step from one level to the next: the nearest one will do.
            along_u = (dx * axis_u[s, 0] + dy * axis_u[s, 1] + dz * axis_u[s, 2]) / length
            along_v = (dx * axis_v[s, 0] + dy * axis_v[s, 1] + dz * axis_v[s, 2]) / length
            step = short_m * stretch / (taps * (math.sqrt(along_u * along_u + along_v * along_v) + 1e-6))
            step_x, step_y, samples, lower = along_u * step * scale_u, -along_v * step * scale_v, taps, int(level + 0.5)
        elif blend < 0.05:
            samples, blend = 1, 0.0
        r, g, b = 0.0, 0.0, 0.0
        for n in range(samples):
            m = min(lower if taps > 1 else lower + n, last_level)
            shift = n - 0.5 * (taps - 1) if taps > 1 else 0.0
            w, h = int(width[k, m]), int(height[k, m])
            fx = (x + shift * step_x) * shrink[k, m, 0] - 0.5
            fy = (y + shift * step_y) * shrink[k, m, 1] - 0.5
            if repeats[k]:
                fx -= math.floor(fx / w) * w
                fy -= math.floor(fy / h) * h
            else:
                fx, fy = min(max(fx, 0.0), w - 1.0), min(max(fy, 0.0), h - 1.0)
            xa, ya = int(fx), int(fy)
            # Bilinear weights of 8 bits; red and blue share one multiplication, 16 bits apart.
            ax, ay = int((fx - xa) * 256.0), int((fy - ya) * 256.0)
            xb, yb = xa + 1, ya + 1
            if xb >= w:
                xb = 0 if repeats[k] else w - 1
            if yb >= h:
                yb = 0 if repeats[k] else h - 1
            base = offset[k, m]
            t00, t01 = np.int64(texels[base + ya * w + xa]), np.int64(texels[base + ya * w + xb])
            t10, t11 = np.int64(texels[base + yb * w + xa]), np.int64(texels[base + yb * w + xb])
            w11 = (ax * ay) >> 8
            w01, w10 = ax - w11, ay - w11
            w00 = 256 - ax - w10
            rb = (t00 & RED_BLUE) * w00 + (t01 & RED_BLUE) * w01 + (t10 & RED_BLUE) * w10 + (t11 & RED_BLUE) * w11
            green = (t00 >> 8 & 255) * w00 + (t01 >> 8 & 255) * w01 + (t10 >> 8 & 255) * w10 + (t11 >> 8 & 255) * w11
            weight = 1.0 / taps
            if taps == 1:
                weight = 1.0 - blend if n == 0 else blend
            r += weight * (rb & 0xFFFF)
            g += weight * green
            b += weight * (rb >> 16)
        columns, rows = light_shape[s, 0], light_shape[s, 1]
        gain = _light(light, light_offset[s], columns, rows, u_m * light_per_m[s, 0], v_m * light_per_m[s, 1]) / 256.0
        colour[i, 0] = np.uint8(min(255.0, r * gain + 0.5))
        colour[i, 1] = np.uint8(min(255.0, g * gain + 0.5))
        colour[i, 2] = np.uint8(min(255.0, b * gain + 0.5))


@kernel
def _light(light: F32, begin: int, columns: int, rows: int, x: float, y: float) -> float:
    """Return the light at (x, y), cells of one surface's grid, bilinear."""
    x = min(max(x, 0.0), columns - 1.0)
    y = min(max(y, 0.0), rows - 1.0)
    x0 = min(int(x), max(0, columns - 2))
    y0 = min(int(y), max(0, rows - 2))
    ax, ay = x - x0, y - y0
    x1, y1 = min(x0 + 1, columns - 1), min(y0 + 1, rows - 1)
    top = light[begin + y0 * columns + x0] * (1 - ax) + light[begin + y0 * columns + x1] * ax
    bottom = light[begin + y1 * columns + x0] * (1 - ax) + light[begin + y1 * columns + x1] * ax
    return float(top * (1 - ay) + bottom * ay)
