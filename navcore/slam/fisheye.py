"""The fisheye camera: where it sees a point, and along which ray a pixel looks (Kannala and Brandt 2006).

A point at θ off the optical axis appears at the radius θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) times the focal
length. Nothing here divides by z: points beside and behind the camera are seen like any other, up to the lens's limit.
Kernels take the lens as ``numbers``: fx fy cx cy k1 k2 k3 k4 and the largest angle.
"""

from __future__ import annotations

import math

import numpy as np

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.types import FisheyeIntrinsics

NUMBER_COUNT = 9
_NEWTON_STEPS = 30


def lens_numbers(lens: FisheyeIntrinsics) -> FloatArray:
    """Return the lens as the kernels take it (9,): fx fy cx cy k1 k2 k3 k4 in pixels, and the largest angle, rad."""
    return np.array([lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion, lens.max_angle_rad])


def project(lens: FisheyeIntrinsics, points: FloatArray) -> FloatArray:
    """Return the pixels (n, 2) at which points (n, 3) in the fisheye camera's frame are seen.

    NaN for points outside the lens's field of view. Pixels may lie outside the picture, where it cuts the image circle.
    """
    return project_all(lens_numbers(lens), np.ascontiguousarray(points, dtype=np.float64))


def unproject(lens: FisheyeIntrinsics, pixels: FloatArray) -> FloatArray:
    """Return unit rays (n, 3) of pixels (n, 2); NaN for pixels outside the image circle."""
    return unproject_all(lens_numbers(lens), np.ascontiguousarray(pixels, dtype=np.float64))


def projection_jacobian(lens: FisheyeIntrinsics, points: FloatArray) -> FloatArray:
    """Return d(u, v) / d(x, y, z) (n, 2, 3), px/m, of points (n, 3); NaN outside the lens's field of view."""
    return jacobian_all(lens_numbers(lens), np.ascontiguousarray(points, dtype=np.float64))


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def radius_of(numbers: FloatArray, theta: float) -> float:
    """Return θ_d of θ, radians."""
    t2 = theta * theta
    return float(theta * (1.0 + t2 * (numbers[4] + t2 * (numbers[5] + t2 * (numbers[6] + t2 * numbers[7])))))


@kernel
def radius_slope(numbers: FloatArray, theta: float) -> float:
    """Return dθ_d / dθ."""
    t2 = theta * theta
    slope = 3.0 * numbers[4] + t2 * (5.0 * numbers[5] + t2 * (7.0 * numbers[6] + t2 * 9.0 * numbers[7]))
    return float(1.0 + t2 * slope)


@kernel
def project_point(numbers: FloatArray, x: float, y: float, z: float) -> tuple[float, float]:
    """Return u, v of a point; NaN outside the field of view."""
    r = math.sqrt(x * x + y * y)
    theta = math.atan2(r, z)
    if not theta <= numbers[8] or r + abs(z) < 1e-9:
        return math.nan, math.nan
    # On the axis θ_d / r tends to 1 / z.
    gain = radius_of(numbers, theta) / r if r > 1e-9 else 1.0 / z
    return numbers[0] * gain * x + numbers[2], numbers[1] * gain * y + numbers[3]


@kernel
def project_with_jacobian(
    numbers: FloatArray, x: float, y: float, z: float, jacobian: FloatArray
) -> tuple[float, float]:
    """Return u, v of a point and fill ``jacobian`` (2, 3) = d(u, v) / d(x, y, z); NaN outside the field of view."""
    u, v = project_point(numbers, x, y, z)
    r2 = x * x + y * y
    length2 = r2 + z * z
    fx, fy = numbers[0], numbers[1]
    if r2 < 1e-16:
        # Here z > 0: straight behind lies outside every field of view.
        jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = fx / z, 0.0, -fx * x / (z * z)
        jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = 0.0, fy / z, -fy * y / (z * z)
        return u, v
    r = math.sqrt(r2)
    theta = math.atan2(r, z)
    slope = radius_slope(numbers, theta) / length2
    across = radius_of(numbers, theta) / (r2 * r)
    along = slope * z / r2
    jacobian[0, 0] = fx * (along * x * x + across * y * y)
    jacobian[0, 1] = fx * (along - across) * x * y
    jacobian[0, 2] = -fx * slope * x
    jacobian[1, 0] = fy * (along - across) * x * y
    jacobian[1, 1] = fy * (along * y * y + across * x * x)
    jacobian[1, 2] = -fy * slope * y
    return u, v


@kernel
def angle_of_radius(numbers: FloatArray, radius: float) -> float:
    """Return θ of θ_d by Newton's method, kept inside the lens's field of view; NaN where θ_d lies outside."""
    low, high = 0.0, numbers[8]
    if not 0.0 <= radius <= radius_of(numbers, high):
        return math.nan
    theta = float(min(radius, high))
    for _ in range(_NEWTON_STEPS):
        error = radius_of(numbers, theta) - radius
        if error > 0.0:
            high = theta
        else:
            low = theta
        if abs(error) < 1e-14:
            break
        step = theta - error / radius_slope(numbers, theta)
        # Where the curve is nearly flat, Newton's step leaves the bracket; half of it does not.
        theta = step if low < step < high else 0.5 * (low + high)
    return theta


@kernel
def project_all(numbers: FloatArray, points: FloatArray) -> FloatArray:
    """Return pixels (n, 2) of points (n, 3)."""
    pixels = np.empty((len(points), 2))
    for i in range(len(points)):
        pixels[i, 0], pixels[i, 1] = project_point(numbers, points[i, 0], points[i, 1], points[i, 2])
    return pixels


@kernel
def jacobian_all(numbers: FloatArray, points: FloatArray) -> FloatArray:
    """Return d(u, v) / d(x, y, z) (n, 2, 3) of points (n, 3)."""
    out = np.empty((len(points), 2, 3))
    for i in range(len(points)):
        u, _ = project_with_jacobian(numbers, points[i, 0], points[i, 1], points[i, 2], out[i])
        if math.isnan(u):
            out[i] = math.nan
    return out


@kernel
def unproject_all(numbers: FloatArray, pixels: FloatArray) -> FloatArray:
    """Return unit rays (n, 3) of pixels (n, 2)."""
    rays = np.empty((len(pixels), 3))
    for i in range(len(pixels)):
        a = (pixels[i, 0] - numbers[2]) / numbers[0]
        b = (pixels[i, 1] - numbers[3]) / numbers[1]
        radius = math.sqrt(a * a + b * b)
        theta = angle_of_radius(numbers, radius)
        gain = math.sin(theta) / radius if radius > 1e-12 else 1.0
        rays[i, 0] = gain * a
        rays[i, 1] = gain * b
        rays[i, 2] = math.cos(theta)
    return rays


def warm_up() -> None:
    """Compile this module's kernels."""
    numbers = np.array([100.0, 100.0, 80.0, 60.0, 0.01, 0.0, 0.0, 0.0, 1.5])
    points = np.array([[0.1, 0.2, 1.0]])
    unproject_all(numbers, project_all(numbers, points))
    jacobian_all(numbers, points)
