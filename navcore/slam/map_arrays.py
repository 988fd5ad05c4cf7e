"""The arrays in which a map is stored, and what must hold of them before anything is computed with them.

Whoever changes a stored map by hand, or stores one that is damaged in memory, is told so when it is read: every index
points at something, every number that must be one is one, and no table grows beyond what a device can hold.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navcore.errors import SiteError
from navcore.slam.keyframes import DESCRIPTOR_BYTES, LEVEL_COUNT, MAX_READOUT_S
from navcore.slam.pattern import comparison_pattern

Arrays = Mapping[str, NDArray[Any]]

FEATURE_VERSION = 1
"""Counts up when corners or descriptors are computed in another way than before, beyond the comparison pattern."""
DESCRIPTOR_KIND = "descriptor_kind"
"""Name of the array that says how a map's descriptors were made."""
MAX_FEATURES = 20_000
"""Features of one key frame, at most."""
MAX_TABLE_ENTRIES = 1 << 28
"""Entries of the table of key frames by features, at most: 1 GiB."""
MAX_DEPTH_CELLS = 20_000
"""Cells of one key frame's depth grid, at most."""
MAX_COORDINATE_M = 100_000.0
MAX_PIXEL = 100_000.0
MAX_SESSIONS = 64
"""Recordings that make one map, at most: each is a bit of a cloud point's mask."""
_ORTHONORMAL = 1e-4

SHAPES: dict[str, tuple[type, tuple[int | str, ...]]] = {
    "camera": (np.float64, (7,)),
    "readout_s": (np.float64, (1,)),
    "keyframe_stamp_s": (np.float64, ("K",)),
    "keyframe_session": (np.int32, ("K",)),
    "keyframe_depth": (np.uint16, ("K", "R", "C")),
    "keyframe_grey": (np.uint8, ("K", "R", "C")),
    "camera_from_world": (np.float64, ("K", 4, 4)),
    "keyframe_covariance": (np.float64, ("K", 6, 6)),
    "keyframe_drift": (np.float64, ("K", 6, 6)),
    "parent": (np.int32, ("K",)),
    "loop_edges": (np.int32, ("L", 2)),
    "feature_start": (np.int64, ("K+1",)),
    "feature_uvr_px": (np.float32, ("M", 3)),
    "feature_octave": (np.uint8, ("M",)),
    "feature_angle_rad": (np.float32, ("M",)),
    "feature_descriptor": (np.uint8, ("M", DESCRIPTOR_BYTES)),
    "feature_landmark": (np.int32, ("M",)),
    "positions": (np.float64, ("N", 3)),
    "normals": (np.float64, ("N", 3)),
    "reach": (np.float64, ("N",)),
    "descriptors": (np.uint8, ("N", DESCRIPTOR_BYTES)),
    "trajectory_stamp_s": (np.float64, ("T",)),
    "trajectory_session": (np.int32, ("T",)),
    "trajectory": (np.float64, ("T", 4, 4)),
}
"""Type and shape of every stored array; letters stand for lengths that must agree."""
PLACE_SHAPES: dict[str, tuple[type, tuple[int | str, ...]]] = {
    "place_vocabulary": (np.uint8, ("V", DESCRIPTOR_BYTES)),
    "place_image_ids": (np.int32, ("P",)),
    "place_image_end": (np.int64, ("P+1",)),
    "place_image_words": (np.int32, ("W",)),
    "place_image_word_counts": (np.int32, ("W",)),
}
"""The same of the index of places; what its words mean is checked where it is read."""
_SINCE_SECOND_SCHEMA = {"keyframe_session": "keyframe_stamp_s", "trajectory_session": "trajectory_stamp_s"}
_FINITE = (
    "camera", "readout_s", "keyframe_stamp_s", "camera_from_world", "keyframe_covariance", "keyframe_drift",
    "feature_angle_rad", "positions", "normals", "reach", "trajectory_stamp_s", "trajectory",
)  # fmt: skip


def damaged(what: str) -> SiteError:
    """Return the error that says what is wrong with a stored map."""
    return SiteError(f"The map is damaged, {what}: build it again, or restore the site from a copy.")


def descriptor_kind() -> NDArray[np.uint8]:
    """Return eight bytes that name how this program makes descriptors; those of another kind match nothing."""
    made_by = repr(FEATURE_VERSION).encode() + comparison_pattern().tobytes()
    return np.frombuffer(hashlib.sha256(made_by).digest()[:8], np.uint8)


def refuse_other_descriptors(arrays: Arrays) -> None:
    """Raise SiteError where a map was made with other descriptors: nothing would ever be recognised in it."""
    kind = arrays.get(DESCRIPTOR_KIND)
    if kind is None or kind.dtype != np.uint8 or not np.array_equal(kind, descriptor_kind()):
        raise SiteError(
            "The map was made by a program that describes its features in another way, so nothing can be recognised in"
            " it: build it again from its recordings."
        )


def checked_arrays(arrays: Arrays) -> dict[str, NDArray[Any]]:
    """Return the arrays of :data:`SHAPES`, C-contiguous. Raises SiteError with the first thing that is wrong."""
    arrays = _with_what_came_later(arrays)
    lengths: dict[str, int] = {}
    checked = {name: _fitting(arrays, name, *form, lengths) for name, form in SHAPES.items()}
    for name, form in PLACE_SHAPES.items():
        _fitting(arrays, name, *form, lengths)
    for name in _FINITE:
        if not np.isfinite(checked[name]).all():
            raise damaged(f"{name} holds something that is no number")
    _check_features(checked, lengths)
    _check_indices(checked, arrays, lengths)
    _check_geometry(checked)
    return checked


def _with_what_came_later(arrays: Arrays) -> Arrays:
    """Return the arrays of an older schema with what it lacks.

    Maps of the first were made of one recording and do not say so, and their key frames kept no depth; those of the
    second kept no grey, and do not say how far they can be wrong, which all zeros stand for; nor did early ones of the
    third say how long the camera reads a picture, or between which key frames nothing seen led.
    """
    missing: dict[str, NDArray[Any]] = {
        name: np.zeros(len(arrays[like]), np.int32)
        for name, like in _SINCE_SECOND_SCHEMA.items()
        if name not in arrays and like in arrays and arrays[like].ndim
    }
    if "keyframe_stamp_s" in arrays and arrays["keyframe_stamp_s"].ndim:
        count = len(arrays["keyframe_stamp_s"])
        kept = arrays.get("keyframe_depth", arrays.get("keyframe_grey", np.zeros((count, 1, 1))))
        missing["keyframe_depth"] = np.zeros(kept.shape, np.uint16)
        missing["keyframe_grey"] = np.zeros(kept.shape, np.uint8)
        missing["keyframe_covariance"] = np.zeros((count, 6, 6))
        missing["keyframe_drift"] = np.zeros((count, 6, 6))
    missing["readout_s"] = np.zeros(1)
    return {**missing, **arrays}


def _fitting(
    arrays: Arrays, name: str, dtype: type, shape: tuple[int | str, ...], lengths: dict[str, int]
) -> NDArray[Any]:
    if name not in arrays:
        raise damaged(f"{name} is missing")
    array = arrays[name]
    if array.dtype != dtype or array.ndim != len(shape):
        raise damaged(f"{name} has the wrong type or shape")
    for size, expected in zip(array.shape, shape, strict=True):
        if isinstance(expected, str) and expected.endswith("+1"):
            fits = size == lengths[expected[:-2]] + 1
        elif isinstance(expected, str):
            fits = size == lengths.setdefault(expected, size)
        else:
            fits = size == expected
        if not fits:
            raise damaged(f"{name} has the wrong length")
    return np.ascontiguousarray(array)


def _check_features(arrays: dict[str, NDArray[Any]], lengths: dict[str, int]) -> None:
    start = arrays["feature_start"]
    if lengths["K"] == 0:
        raise damaged("it has no key frames")
    if start[0] != 0 or start[-1] != lengths["M"] or np.any(np.diff(start) < 0):
        raise damaged("feature_start does not divide the features")
    most = int(np.diff(start).max())
    if most > MAX_FEATURES or most * lengths["K"] > MAX_TABLE_ENTRIES:
        raise damaged("a key frame has more features than any camera gives")
    if lengths["R"] * lengths["C"] > MAX_DEPTH_CELLS:
        raise damaged("keyframe_depth has more cells than any key frame keeps")
    uvr = arrays["feature_uvr_px"]
    if not (np.abs(uvr[:, :2]) <= MAX_PIXEL).all() or np.isinf(uvr[:, 2]).any():
        raise damaged("feature_uvr_px lies outside every image")
    if len(arrays["feature_octave"]) and arrays["feature_octave"].max() >= LEVEL_COUNT:
        raise damaged("feature_octave names a level that does not exist")


def _check_indices(arrays: dict[str, NDArray[Any]], stored: Arrays, lengths: dict[str, int]) -> None:
    bounds = {"feature_landmark": (-1, lengths["N"]), "parent": (-1, lengths["K"]), "loop_edges": (0, lengths["K"])}
    for name in _SINCE_SECOND_SCHEMA:
        bounds[name] = (0, MAX_SESSIONS)
    for name, (least, end) in bounds.items():
        values = arrays[name]
        if values.size and (values.min() < least or values.max() >= end):
            raise damaged(f"{name} points at nothing")
    ids = stored["place_image_ids"]
    if len(ids) and (ids.min() < 0 or ids.max() >= lengths["K"]):
        raise damaged("its index of places points at nothing")


def _check_geometry(arrays: dict[str, NDArray[Any]]) -> None:
    width_px, height_px, fx_px, fy_px, _, _, bf_px_m = arrays["camera"]
    if not (8 <= width_px <= 20_000 and 8 <= height_px <= 20_000 and min(fx_px, fy_px, bf_px_m) > 0):
        raise damaged("its camera cannot exist")
    if abs(arrays["readout_s"][0]) > MAX_READOUT_S:
        raise damaged("its camera reads a picture for longer than any does")
    for name in ("camera_from_world", "trajectory"):
        if not _are_rigid(arrays[name]):
            raise damaged(f"{name} holds something that is no pose")
    if not _are_covariances(arrays["keyframe_covariance"]):
        raise damaged("keyframe_covariance holds something that is no covariance")
    if not _are_drifts(arrays["keyframe_drift"]):
        raise damaged("keyframe_drift holds something that is no covariance")
    for values, name in ((arrays["positions"], "positions"), (arrays["reach"], "reach")):
        if not (np.abs(values) <= MAX_COORDINATE_M).all():
            raise damaged(f"{name} holds a place farther than 100 km away")
    for name in ("keyframe", "trajectory"):
        if np.any(np.diff(arrays[f"{name}_session"]) < 0):
            raise damaged(f"{name}_session does not go recording by recording")
    stamps, sessions = arrays["trajectory_stamp_s"], arrays["trajectory_session"]
    if np.any((np.diff(stamps) <= 0) & (np.diff(sessions) == 0)):
        raise damaged("trajectory_stamp_s does not grow within a recording")


def _are_rigid(poses: NDArray[np.float64]) -> bool:
    rotation = poses[:, :3, :3]
    square = rotation @ np.swapaxes(rotation, 1, 2)
    return bool(
        (np.abs(square - np.eye(3)) < _ORTHONORMAL).all()
        and (np.linalg.det(rotation) > 0).all()
        and (np.abs(poses[:, 3] - (0.0, 0.0, 0.0, 1.0)) < 1e-9).all()
        and (np.abs(poses[:, :3, 3]) <= MAX_COORDINATE_M).all()
    )


def _are_covariances(covariances: NDArray[np.float64]) -> bool:
    """Whether all are symmetric, with positive variances along every axis; or all zero, for not known."""
    size = np.abs(covariances).max(axis=(1, 2), initial=0.0)
    skew = np.abs(covariances - np.swapaxes(covariances, 1, 2)).max(axis=(1, 2), initial=0.0)
    least = np.linalg.eigvalsh(covariances)[:, 0]
    return bool((skew <= _ORTHONORMAL * size).all() and ((least > 0).all() or not size.any()))


def _are_drifts(covariances: NDArray[np.float64]) -> bool:
    """Whether all are symmetric, and of no axis negative."""
    size = np.abs(covariances).max(axis=(1, 2), initial=0.0)
    skew = np.abs(covariances - np.swapaxes(covariances, 1, 2)).max(axis=(1, 2), initial=0.0)
    least = np.linalg.eigvalsh(covariances)[:, 0]
    return bool((skew <= _ORTHONORMAL * size).all() and (least >= -_ORTHONORMAL * size).all())
