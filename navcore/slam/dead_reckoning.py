"""A pose between two frames that were located: the camera goes on as it went, for a moment.

The rule is the localizer's own: after ``MAX_UNMATCHED_S`` without the map a pose is no longer *Localized*. What is
carried on is never farther from the map than that, and only where the map had matched before.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from navcore.geometry import Transform
from navcore.slam.lie import exp_se3, log_se3
from navcore.slam.localizer import MAX_UNMATCHED_S
from navcore.slam.pose_uncertainty import MAX_SPEED_M_S
from navcore.types import Localization, LocalizationQuality

MAX_STEP_S = 0.35
"""Two poses farther apart in time do not tell how the camera moves."""
ACCELERATION_M_S2 = 3.0
"""Standard deviation of the head's acceleration along each axis: it bobs by some centimetres, twice a second."""
TURNING_RAD_S2 = 10.0
"""The same of its turning."""


def carried_on(before: Localization, last: Localization, stamp_s: float) -> Localization | None:
    """Return the pose at ``stamp_s`` by the velocity between two poses that the localizer has found.

    None where that would be a guess: a pose is not *Localized*, too old, or they are no movement of one walk. The
    covariance (6, 6) allows for the head's acceleration. No landmark was seen: ``inlier_count`` is 0.
    """
    step_s, ahead_s = last.stamp_s - before.stamp_s, stamp_s - last.stamp_s
    is_sure = all(each.quality is LocalizationQuality.LOCALIZED for each in (before, last))
    if not is_sure or not 0.0 < step_s <= MAX_STEP_S or not 0.0 < ahead_s <= MAX_UNMATCHED_S:
        return None
    old, new = before.world_from_camera, last.world_from_camera
    if old is None or new is None or last.covariance is None:
        return None
    step = log_se3(np.array((old.inverse() @ new).matrix))
    if float(np.linalg.norm(new.translation - old.translation)) > MAX_SPEED_M_S * step_s:
        return None
    pose = Transform(new.matrix @ exp_se3(step * (ahead_s / step_s)))
    moved_m2, turned_rad2 = ((0.5 * each * ahead_s**2) ** 2 for each in (ACCELERATION_M_S2, TURNING_RAD_S2))
    covariance = last.covariance + np.diag([moved_m2] * 3 + [turned_rad2] * 3)
    return replace(last, stamp_s=stamp_s, world_from_camera=pose, covariance=covariance, inlier_count=0)


def warm_up() -> None:
    """Compile what carrying on needs."""
    here = Localization(0.0, LocalizationQuality.LOCALIZED, Transform.identity(), np.eye(6))
    carried_on(here, replace(here, stamp_s=0.1), 0.2)
