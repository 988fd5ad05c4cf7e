"""Lenses from views of a board: a pinhole with distortion (Zhang 2000), and a fisheye (Kannala and Brandt 2006).

OpenCV does both (``cv2.calibrateCamera``, ``cv2.fisheye.calibrate``). What it cannot know is checked here: that the
views say enough about the lens, and which of them do not fit and are to be taken again.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import cv2
import numpy as np

from navcore.calibrating.boards import BoardView, shown_share
from navcore.calibration import FisheyeCalibration, LensQuality, PinholeCalibration
from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.slam.fisheye import project
from navcore.types import CameraIntrinsics, FisheyeIntrinsics

T = TypeVar("T")
MIN_VIEWS = 8
_MIN_COVERAGE = 0.5
_MAX_RMS_PX = 1.0
_BAD_VIEW_TIMES = 3.0
_BAD_VIEW_PX = 0.7
_MIN_TILT_SPREAD_RAD = math.radians(10.0)
"""Boards that all face the camera leave focal length and distance apart undecided (Zhang 2000, section 4)."""
_BEYOND_SEEN_RAD = math.radians(5.0)
_FISHEYE_FLAGS: Any = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2
"""Where its flags are: OpenCV 5 has moved them."""
_FOCAL_WIDTHS = (0.33, 0.42, 0.26, 0.55)
"""Focal lengths to begin with, pixels per radian in picture widths: fields of view from 100 to 220°."""
_PLACES = (("upper", "middle", "lower"), ("left", "middle", "right"))


@dataclass(frozen=True, slots=True)
class LensReport(Generic[T]):
    """A measured lens, and what is to be said of the pictures."""

    calibration: T
    view_rms_px: dict[str, float]
    """Reprojection error of each picture that was used."""
    left_out: tuple[str, ...]
    """Those that did not fit: take these again."""


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """What OpenCV makes of some views."""

    matrix: FloatArray
    distortion: FloatArray
    rms_px: FloatArray
    """Of each view (n,)."""
    boards: list[tuple[FloatArray, FloatArray]]
    """Rotation vector (3,) and translation (3,) of each board in the camera's frame."""


Solve = Callable[[list[BoardView], int, int], _Fit]


def measured_pinhole(
    views: list[BoardView], width_px: int, height_px: int, now_s: float
) -> LensReport[PinholeCalibration]:
    """Return the pinhole camera that took the views.

    Args:
        views: of one board, from pictures of one size.
        width_px: of the pictures.
        height_px: of the pictures.
        now_s: the present time, seconds since 1970, to be noted.

    Raises:
        InputError: where the views do not say enough or do not fit; the text says which to take again.
    """
    used, left_out, fit = _fitted(views, width_px, height_px, _solve_pinhole)
    _refuse_alike(fit)
    fx, fy, cx, cy = (float(fit.matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    distortion = tuple(float(each) for each in fit.distortion.ravel()[:5])
    intrinsics = CameraIntrinsics(width_px, height_px, fx, fy, cx, cy, distortion)
    quality = _quality(used, fit, width_px, height_px, now_s)
    return LensReport(PinholeCalibration(intrinsics, quality), _by_name(used, fit.rms_px), left_out)


def measured_fisheye(
    views: list[BoardView], width_px: int, height_px: int, now_s: float, max_angle_rad: float | None = None
) -> LensReport[FisheyeCalibration]:
    """Return the fisheye lens that took the views (see :func:`measured_pinhole`).

    ``max_angle_rad`` is half of the lens's field of view; without it, the lens holds for as far off its axis as corners
    of the board were seen, and five degrees more.
    """
    used, left_out, fit = _fitted(views, width_px, height_px, _solve_fisheye)
    _refuse_alike(fit)
    fx, fy, cx, cy = (float(fit.matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    k1, k2, k3, k4 = (float(each) for each in fit.distortion.ravel()[:4])
    angle_rad = max_angle_rad or _widest_rad(used, fit) + _BEYOND_SEEN_RAD
    lens = FisheyeIntrinsics(width_px, height_px, fx, fy, cx, cy, k1, k2, k3, k4, angle_rad)
    _refuse_other_model(lens, used, fit)
    quality = _quality(used, fit, width_px, height_px, now_s)
    return LensReport(FisheyeCalibration(lens, quality), _by_name(used, fit.rms_px), left_out)


def _fitted(
    views: list[BoardView], width_px: int, height_px: int, solve: Solve
) -> tuple[list[BoardView], tuple[str, ...], _Fit]:
    """Fit, leave out the views that do not agree with the others, and fit again."""
    _refuse_few(views, width_px, height_px)
    kept, fit = _without_the_worst(views, width_px, height_px, solve)
    limit_px = max(_BAD_VIEW_PX, _BAD_VIEW_TIMES * float(np.median(fit.rms_px)))
    kept = [view for view, rms_px in zip(kept, fit.rms_px, strict=True) if rms_px <= limit_px]
    if len(kept) < len(views):
        _refuse_few(kept, width_px, height_px, [view.name for view in views if view not in kept])
        fit = _solved(solve, kept, width_px, height_px)
    left_out = tuple(view.name for view in views if view not in kept)
    rms_px = _overall(kept, fit)
    if not rms_px <= _MAX_RMS_PX:
        worst = sorted(_by_name(kept, fit.rms_px).items(), key=lambda item: -item[1])[:3]
        raise InputError(
            f"The lens does not fit the pictures (off by {rms_px:.2f} px, at most {_MAX_RMS_PX:g}): take again"
            f" {', '.join(name for name, _ in worst)}, sharp and with a flat board; and see that --board is right."
        )
    return kept, left_out, fit


def _without_the_worst(
    views: list[BoardView], width_px: int, height_px: int, solve: Solve
) -> tuple[list[BoardView], _Fit]:
    """Fit; where one bad view leads the fit astray altogether, fit without it."""
    try:
        fit = _solved(solve, views, width_px, height_px)
        if len(views) <= MIN_VIEWS or _overall(views, fit) <= _MAX_RMS_PX:
            return views, fit
        fits = [(views, fit)]
    except InputError:
        if len(views) <= MIN_VIEWS:
            raise
        fits = []
    for view in views:
        others = [each for each in views if each is not view]
        with contextlib.suppress(InputError):
            fits.append((others, _solved(solve, others, width_px, height_px)))
    if not fits:
        raise _no_lens()
    return min(fits, key=lambda each: _overall(*each))


def _no_lens() -> InputError:
    return InputError(
        "No lens fits the pictures: see that --board is right, and take them again with the board tilted this way and"
        " that, at several distances."
    )


def _solved(solve: Solve, views: list[BoardView], width_px: int, height_px: int) -> _Fit:
    try:
        fit = solve(views, width_px, height_px)
    except cv2.error as error:
        raise _no_lens() from error
    if not (np.isfinite(fit.matrix).all() and np.isfinite(fit.distortion).all() and np.isfinite(fit.rms_px).all()):
        raise _no_lens()
    return fit


def _refuse_few(views: list[BoardView], width_px: int, height_px: int, left_out: Sequence[str] = ()) -> None:
    again = f"; take again {', '.join(left_out)}, which do not fit the others" if left_out else ""
    if len(views) < MIN_VIEWS:
        raise InputError(
            f"The board was found in {len(views)} pictures, and {MIN_VIEWS} are needed: take more, with the whole board"
            f" sharp and well lit{again}."
        )
    coverage, seen = shown_share(views, width_px, height_px)
    if coverage < _MIN_COVERAGE:
        raise InputError(
            f"The board was seen in {coverage:.0%} of the picture only, and {_MIN_COVERAGE:.0%} are needed: take"
            f" pictures with it {_emptiest(seen)}{again}."
        )


def _emptiest(seen: np.ndarray) -> str:
    """Name the parts of the picture in which the board was seen least."""
    blocks = seen.reshape(3, 2, 8)
    thirds = np.array([[part.mean() for part in np.array_split(block, 3, axis=1)] for block in blocks])
    worst = np.argsort(thirds, axis=None)[:3]
    names = [f"{_PLACES[0][at // 3]} {_PLACES[1][at % 3]}" for at in worst if thirds.flat[at] < 0.5]
    return "at the " + ", the ".join(names) if names else "nearer to the edges"


def _refuse_alike(fit: _Fit) -> None:
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn, _ in fit.boards])
    normals *= np.sign(normals[:, 2:3])
    spread_rad = float(np.max(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0))))
    if spread_rad < _MIN_TILT_SPREAD_RAD:
        raise InputError(
            f"The board is held the same way in all pictures (within {math.degrees(spread_rad):.0f}°), which leaves the"
            " focal length open: tilt it by 20 to 40° to the left, right, up and down."
        )


def _refuse_other_model(lens: FisheyeIntrinsics, views: list[BoardView], fit: _Fit) -> None:
    """The lens must mean for the rest of the program what it means for OpenCV."""
    for view, (turn, place) in zip(views, fit.boards, strict=True):
        seen = project(lens, view.corners_m @ cv2.Rodrigues(turn)[0].T + place.ravel())
        if not np.nanmax(np.abs(seen - view.pixels), initial=0.0) < 20.0:
            raise InputError(f"The lens does not fit {view.name}: take that picture again.")


def _quality(views: list[BoardView], fit: _Fit, width_px: int, height_px: int, now_s: float) -> LensQuality:
    return LensQuality(now_s, _overall(views, fit), len(views), shown_share(views, width_px, height_px)[0])


def _overall(views: list[BoardView], fit: _Fit) -> float:
    """Return the root mean square over all corners, pixels."""
    counts = np.array([len(view.pixels) for view in views])
    return math.sqrt(float(np.sum(counts * fit.rms_px**2) / counts.sum()))


def _by_name(views: list[BoardView], rms_px: FloatArray) -> dict[str, float]:
    return {view.name: float(rms) for view, rms in zip(views, rms_px, strict=True)}


def _widest_rad(views: list[BoardView], fit: _Fit) -> float:
    widest = 0.0
    for view, (turn, place) in zip(views, fit.boards, strict=True):
        x, y, z = (view.corners_m @ cv2.Rodrigues(turn)[0].T + place.ravel()).T
        widest = max(widest, float(np.max(np.arctan2(np.hypot(x, y), z))))
    return widest


def _solve_pinhole(views: list[BoardView], width_px: int, height_px: int) -> _Fit:
    corners = [view.corners_m.astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    start = np.eye(3)
    _, matrix, distortion, turns, places = cv2.calibrateCamera(
        corners, pixels, (width_px, height_px), start, np.zeros(5)
    )
    boards = _boards(turns, places)
    rms = [
        _rms_px(cv2.projectPoints(view.corners_m, turn, place, matrix, distortion)[0], view)
        for view, (turn, place) in zip(views, boards, strict=True)
    ]
    return _Fit(np.asarray(matrix), np.asarray(distortion), np.array(rms), boards)


def _solve_fisheye(views: list[BoardView], width_px: int, height_px: int) -> _Fit:
    """Solve from several starts until one fits: OpenCV's solver goes astray from some, whatever the views."""
    fits: list[_Fit] = []
    for focal_widths in (None, *_FOCAL_WIDTHS):
        start = np.zeros((3, 3))
        if focal_widths is not None:
            focal_px = focal_widths * width_px
            start = np.array([[focal_px, 0.0, width_px / 2], [0.0, focal_px, height_px / 2], [0.0, 0.0, 1.0]])
        with contextlib.suppress(cv2.error):
            fits.append(_fisheye_from(start, views, width_px, height_px))
            if _overall(views, fits[-1]) <= _MAX_RMS_PX:
                return fits[-1]
    if not fits:
        raise _no_lens()
    return min(fits, key=lambda fit: _overall(views, fit))


def _fisheye_from(start: FloatArray, views: list[BoardView], width_px: int, height_px: int) -> _Fit:
    """Solve from a camera matrix; all zeros leave the start to OpenCV. Raises cv2.error."""
    # One row of corners: OpenCV 5 refuses one column.
    corners = [view.corners_m.reshape(1, -1, 3) for view in views]
    pixels = [view.pixels.reshape(1, -1, 2) for view in views]
    flags = int(_FISHEYE_FLAGS.CALIB_RECOMPUTE_EXTRINSIC | _FISHEYE_FLAGS.CALIB_FIX_SKEW)
    if start.any():
        flags |= int(_FISHEYE_FLAGS.CALIB_USE_INTRINSIC_GUESS)
    _, matrix, distortion, turns, places = cv2.fisheye.calibrate(
        corners, pixels, (width_px, height_px), start, np.zeros((4, 1)), flags=flags,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9),
    )  # fmt: skip
    boards = _boards(turns, places)
    rms = [
        _rms_px(cv2.fisheye.projectPoints(each, turn, place, matrix, distortion)[0], view)
        for each, view, (turn, place) in zip(corners, views, boards, strict=True)
    ]
    fit = _Fit(np.asarray(matrix, np.float64), np.asarray(distortion, np.float64), np.array(rms), boards)
    # What is no number compares as fitting nowhere.
    return replace(fit, rms_px=np.nan_to_num(fit.rms_px, nan=np.inf))


def _boards(turns: Any, places: Any) -> list[tuple[FloatArray, FloatArray]]:
    pairs = zip(turns, places, strict=True)
    return [(np.asarray(a, np.float64).reshape(3), np.asarray(b, np.float64).reshape(3)) for a, b in pairs]


def _rms_px(seen: np.ndarray, view: BoardView) -> float:
    return float(np.sqrt(np.mean(np.sum((seen.reshape(-1, 2) - view.pixels) ** 2, axis=1))))
