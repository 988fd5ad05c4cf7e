"""The step of the loop that compares the floor with the calibration, and what is told when they disagree."""

from __future__ import annotations

from dataclasses import replace

from device_agent.state import DeviceState, Effect, Happened, Notice
from navcore.calibration import Calibration
from navcore.cues.texts import TEXTS
from navcore.obstacle.levelling import Expected
from navcore.obstacle.mounting import LOOK_EVERY_S, FloorFinder, floor_difference, independent_up, watched
from navcore.types import CameraIntrinsics, Frame, Localization


def expected_of(calibration: Calibration, frame: Frame) -> Expected | None:
    """Return how the camera is held when the frame was taken, as far as calibration and gravity tell."""
    floor = calibration.floor
    return None if floor is None else Expected(floor.height_m, floor.up_by_gravity(frame.gravity))


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
    told = _news(state, was_moved=state.mounting.moved, moved=watch.moved, why=watch.why)
    return replace(state, mounting=watch), told


def _news(state: DeviceState, *, was_moved: bool, moved: bool, why: str) -> tuple[Effect, ...]:
    if moved == was_moved:
        return ()
    texts = TEXTS[state.settings.cues.language]
    if not moved:
        happened = Happened("sensor", "The camera sees the floor as it was calibrated again.")
        return happened, Notice(texts["camera_agrees"])
    happened = Happened("sensor", f"The camera has moved: it is {why}. Put it right, or run `vbr calibrate floor`.")
    # Whoever is led hears it with the stop.
    return (happened,) if state.leading else (happened, Notice(texts["camera_moved"]))
