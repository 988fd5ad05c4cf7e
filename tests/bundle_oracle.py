"""Bundle adjustment written plainly in NumPy: numeric Jacobians, one dense system. Slow, and the oracle in tests."""

from __future__ import annotations

import numpy as np

from navcore.geometry import rotation_from_rotvec

LIMITS = {2: 5.991, 3: 7.815}


def residuals(camera, pose, point, uvr) -> np.ndarray:
    """Reprojection error (2,), or (3,) with depth."""
    fx, fy, cx, cy, bf = camera
    x, y, z = pose[:3, :3] @ point + pose[:3, 3]
    predicted = np.array([fx * x / z + cx, fy * y / z + cy, fx * x / z + cx - bf / z])
    rows = 2 if np.isnan(uvr[2]) else 3
    return (predicted - uvr)[:rows]


def moved(pose, twist) -> np.ndarray:
    """The pose after a left-multiplied small motion (translation, rotation)."""
    out = np.eye(4)
    rotation = rotation_from_rotvec(np.asarray(twist[3:]))
    out[:3, :3] = rotation @ pose[:3, :3]
    out[:3, 3] = rotation @ pose[:3, 3] + twist[:3]
    return out


def numeric_jacobian(function, size: int, step: float = 1e-6) -> np.ndarray:
    """Central differences of a function of a vector (size,) at zero."""
    columns = []
    for k in range(size):
        delta = np.zeros(size)
        delta[k] = step
        columns.append((function(delta) - function(-delta)) / (2 * step))
    return np.stack(columns, axis=1)


def huber(squared: float, rows: int) -> tuple[float, float]:
    """Cost and weight of a squared error."""
    limit = LIMITS[rows]
    return (squared, 1.0) if squared <= limit else (2 * np.sqrt(limit * squared) - limit, np.sqrt(limit / squared))


def cost(camera, poses, points, keyframe, point, uvr, inv_sigma2) -> float:
    """Huber cost of all observations."""
    total = 0.0
    for m in range(len(keyframe)):
        e = residuals(camera, poses[keyframe[m]], points[point[m]], uvr[m])
        total += huber(float(e @ e) * inv_sigma2[m], len(e))[0]
    return total


def bundle_adjust(camera, poses, fixed, points, keyframe, point, uvr, inv_sigma2, iterations=30):
    """Levenberg–Marquardt on the Huber cost; returns poses and points."""
    poses, points = poses.copy(), points.copy()
    free = np.flatnonzero(~fixed)
    size = 6 * len(free) + 3 * len(points)
    damping = 1e-3
    now = cost(camera, poses, points, keyframe, point, uvr, inv_sigma2)
    for _ in range(iterations):
        h, g = np.zeros((size, size)), np.zeros(size)
        for m in range(len(keyframe)):
            pose, landmark = poses[keyframe[m]], points[point[m]]
            e = residuals(camera, pose, landmark, uvr[m])
            weight = inv_sigma2[m] * huber(float(e @ e) * inv_sigma2[m], len(e))[1]
            jacobian = np.zeros((len(e), size))
            column = 6 * len(free) + 3 * point[m]
            jacobian[:, column : column + 3] = numeric_jacobian(
                lambda d, p=pose, x=landmark, o=uvr[m]: residuals(camera, p, x + d, o), 3
            )
            if not fixed[keyframe[m]]:
                column = 6 * int(np.flatnonzero(free == keyframe[m])[0])
                jacobian[:, column : column + 6] = numeric_jacobian(
                    lambda d, p=pose, x=landmark, o=uvr[m]: residuals(camera, moved(p, d), x, o), 6
                )
            h += weight * jacobian.T @ jacobian
            g += weight * jacobian.T @ e
        step = np.linalg.solve(h + damping * np.diag(np.diag(h)) + 1e-9 * np.eye(size), -g)
        trial_poses = poses.copy()
        for n, k in enumerate(free):
            trial_poses[k] = moved(poses[k], step[6 * n : 6 * n + 6])
        trial_points = points + step[6 * len(free) :].reshape(-1, 3)
        after = cost(camera, trial_poses, trial_points, keyframe, point, uvr, inv_sigma2)
        if after < now:
            poses, points, now, damping = trial_poses, trial_points, after, damping * 0.1
        else:
            damping *= 10
    return poses, points
