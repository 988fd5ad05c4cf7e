"""A pose where the localizer has found none (yet): the camera goes on as it went, for a moment.

The rule is the localizer's own: after ``MAX_UNMATCHED_S`` without the map a pose is no longer *Localized*. A pose is
carried on for no longer than that from the last one found, which may itself be as old a match: 0.3 s in all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from navcore.geometry import Transform
from navcore.slam.lie import exp_se3, log_se3
from navcore.slam.localizer import MAX_UNMATCHED_S
from navcore.slam.pose_uncertainty import MAX_SPEED_M_S, walked_unseen
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
    ahead_s = stamp_s - last.stamp_s
    if not 0.0 < ahead_s <= MAX_UNMATCHED_S or last.covariance is None:
        return None
    pose = _moved_on(before, last, ahead_s)
    if pose is None:
        return None
    moved_m2, turned_rad2 = ((0.5 * each * ahead_s**2) ** 2 for each in (ACCELERATION_M_S2, TURNING_RAD_S2))
    covariance = last.covariance + np.diag([moved_m2] * 3 + [turned_rad2] * 3)
    return replace(last, stamp_s=stamp_s, world_from_camera=pose, covariance=covariance, inlier_count=0)


def reckoned(found: tuple[Localization, ...], stamp_s: float, held_s: float) -> Localization:
    """Return the pose at ``stamp_s`` by those that the localizer has found before, oldest first; the last two count.

    It is :func:`carried_on` as long as it may be. Then it stays where it is, *Uncertain*, and its covariance grows by
    what somebody may do in the time; older than ``held_s`` seconds it is *Lost*, as it is without any.
    """
    if not found:
        return Localization(stamp_s, LocalizationQuality.LOST, None)
    before, last = found[-2:] if len(found) > 1 else (None, found[-1])
    carried = None if before is None else carried_on(before, last, stamp_s)
    return carried or _held(before, last, stamp_s, held_s)


def _held(before: Localization | None, last: Localization, stamp_s: float, held_s: float) -> Localization:
    """Return the pose as far as it could be carried on, and how uncertain that is by now."""
    ahead_s, pose = stamp_s - last.stamp_s, last.world_from_camera
    is_lost = last.quality is LocalizationQuality.LOST or not 0.0 <= ahead_s <= held_s
    if is_lost or pose is None or last.covariance is None:
        return Localization(stamp_s, LocalizationQuality.LOST, None)
    moved = None if before is None else _moved_on(before, last, min(ahead_s, MAX_UNMATCHED_S))
    covariance = walked_unseen(last.covariance, ahead_s)
    return Localization(stamp_s, LocalizationQuality.UNCERTAIN, moved or pose, covariance, is_held=True)


def _moved_on(before: Localization, last: Localization, ahead_s: float) -> Transform | None:
    """Return the pose ``ahead_s`` after the last one by the velocity between two; None where they tell of none."""
    step_s = last.stamp_s - before.stamp_s
    is_sure = all(each.quality is LocalizationQuality.LOCALIZED for each in (before, last))
    old, new = before.world_from_camera, last.world_from_camera
    if not is_sure or not 0.0 < step_s <= MAX_STEP_S or old is None or new is None:
        return None
    if float(np.linalg.norm(new.translation - old.translation)) > MAX_SPEED_M_S * step_s:
        return None
    step = log_se3(np.array((old.inverse() @ new).matrix))
    return Transform(new.matrix @ exp_se3(step * (ahead_s / step_s)))


def warm_up() -> None:
    """Compile what carrying on needs."""
    here = Localization(0.0, LocalizationQuality.LOCALIZED, Transform.identity(), np.eye(6))
    carried_on(here, replace(here, stamp_s=0.1), 0.2)
