"""The step of the loop that compares the floor with the calibration, and what is told when they disagree."""

from __future__ import annotations

import math
from dataclasses import replace

from device_agent.state import DeviceState, Effect, Happened, Notice
from navcore.cues.texts import TEXTS
from navcore.obstacle.facing import faced
from navcore.obstacle.levelling import Expected
from navcore.obstacle.mounting import (
    LOOK_EVERY_S,
    FloorFinder,
    MountingWatch,
    floor_difference,
    independent_up,
    watched,
)
from navcore.types import CameraIntrinsics, Frame, Localization, LocalizationQuality

_EYE_KNOWN_S = 5.0
"""Afterwards the walker may stoop, or somebody else wear the glasses."""


def expected_of(state: DeviceState, frame: Frame, located: Localization, *, has_pose: bool) -> Expected | None:
    """Return how the camera is held when the frame was taken, as far as that is known otherwise than by the pose.

    Without a pose calibration and gravity tell; beside one that is not sure, how high it was when the pose was last
    sure, a moment ago.
    """
    if not has_pose:
        floor = state.calibration.floor
        return None if floor is None else Expected(floor.height_m, floor.up_by_gravity(frame.gravity))
    if located.quality is LocalizationQuality.LOCALIZED or state.eye is None:
        return None
    stamp_s, height_m = state.eye
    return Expected(height_m) if 0.0 <= frame.stamp_s - stamp_s <= _EYE_KNOWN_S else None


def look_at_floor(
    state: DeviceState, find_floor: FloorFinder, intrinsics: CameraIntrinsics, frame: Frame, located: Localization
) -> tuple[DeviceState, tuple[Effect, ...]]:
    """Look for the floor where that is due; return what to remember, and what there is to tell."""
    calibrated = state.calibration.floor
    if calibrated is None or 0.0 <= frame.stamp_s - state.mounting.looked_s < LOOK_EVERY_S:
        return state, ()
    seen = find_floor(frame.depth_m, intrinsics)
    up = independent_up(calibrated, frame.gravity, located)
    difference = None if seen is None else floor_difference(seen, calibrated, up)
    watch = watched(state.mounting, difference, frame.stamp_s, state.settings.calibration)
    told = _news(state, watch)
    return replace(state, mounting=watch), told


def look_where_walked(state: DeviceState, located: Localization) -> tuple[DeviceState, tuple[Effect, ...]]:
    """Compare the way that is walked with where the camera looks; return what to remember, and what there is to tell.

    It stops nobody: it may be the head that is turned, and only who walks on can hear that it is straight again.
    """
    pose = located.pose if located.quality is LocalizationQuality.LOCALIZED else None
    watch = faced(state.facing, located.stamp_s, pose, state.settings.calibration)
    was_turned = state.facing.turned
    state = replace(state, facing=watch)
    if watch.turned == was_turned:
        return state, ()
    texts = TEXTS[state.settings.cues.language]
    if not watch.turned:
        return state, (
            Happened("sensor", "The camera looks where the walker walks again."),
            Notice(texts["looks_ahead"]),
        )
    side = "left" if watch.offset_rad > 0 else "right"
    degrees = f"{abs(math.degrees(watch.offset_rad)):.0f}°"
    happened = f"The camera has turned: it looks {degrees} to the {side} of where the walker walks. Put it right."
    return state, (Happened("sensor", happened), Notice(texts[f"looks_{side}"]))


def _news(state: DeviceState, watch: MountingWatch) -> tuple[Effect, ...]:
    if watch.moved == state.mounting.moved:
        return ()
    texts = TEXTS[state.settings.cues.language]
    if not watch.moved:
        happened = Happened("sensor", "The camera sees the floor as it was calibrated again.")
        return happened, Notice(texts["camera_agrees"])
    happened = Happened(
        "sensor", f"The camera has moved: it is {watch.why}. Put it right, or run `vbr calibrate floor`."
    )
    # Whoever is led hears it with the stop.
    return (
        (happened,)
        if state.leading
        else (happened, Notice(texts["look_ahead" if watch.by_posture else "camera_moved"]))
    )
