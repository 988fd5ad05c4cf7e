"""The finished map: frozen, compact, stored as plain arrays, and ready to be localized in.

It is made of one or more recordings, its *sessions*; each key frame and each pose of the trajectory knows its own.
Only what lives is kept: key frames and landmarks are numbered anew. Transforms are ``camera_from_world`` as everywhere
in this package; the world is the site's levelled frame once :meth:`SlamMap.transformed` has been applied.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.keyframes import NO_LANDMARK, ByteArray, IntArray, SlamCamera
from navcore.slam.map_arrays import (
    DESCRIPTOR_KIND,
    SHAPES,
    checked_arrays,
    damaged,
    descriptor_kind,
    refuse_other_descriptors,
)
from navcore.slam.place_recognition import PlaceIndex

BoolArray = NDArray[np.bool_]
Int64Array = NDArray[np.int64]

_PLACE_PREFIX = "place_"


@dataclass(frozen=True, slots=True, eq=False)
class SlamMap:
    """Key frames, landmarks, what sees what, and the index of places. Arrays are C-contiguous."""

    camera: SlamCamera
    readout_s: FloatArray
    """(1,): how long the camera that made it takes to read a picture, see :mod:`navcore.slam.rolling_shutter`."""
    keyframe_stamp_s: FloatArray
    """(K,)."""
    keyframe_session: IntArray
    """(K,): the recording that each key frame comes from, ascending; stamps are only comparable within one."""
    keyframe_depth: NDArray[np.uint16]
    """(K, rows, columns): the surfaces each key frame saw, the grid of :class:`navcore.slam.depth_model.DepthModel`;
    all zero where none was kept."""
    keyframe_grey: NDArray[np.uint8]
    """(K, rows, columns): the grey of these cells, see :mod:`navcore.slam.shading_alignment`; all zero where none was
    kept."""
    camera_from_world: FloatArray
    """(K, 4, 4): poses of the key frames."""
    keyframe_covariance: FloatArray
    """(K, 6, 6): of (camera position, rotation) in the world, of each key frame: how far the map can be wrong there;
    see :func:`navcore.slam.map_uncertainty.keyframe_covariances`."""
    keyframe_drift: FloatArray
    """(K, 6, 6): covariance of a twist in each camera's frame, by which the step from the key frame before may be wrong
    beyond what was seen, see :mod:`navcore.slam.blind_steps`; zero where everything was fixed."""
    parent: IntArray
    """(K,): spanning tree, −1 at its root."""
    loop_edges: IntArray
    """(L, 2): key frames that loop closing joined."""
    feature_start: Int64Array
    """(K + 1,): features of key frame k are ``feature_start[k]`` up to ``feature_start[k + 1]``."""
    feature_uvr_px: NDArray[np.float32]
    """(M, 3): undistorted u, v, and u_r (NaN without depth)."""
    feature_octave: ByteArray
    """(M,)."""
    feature_angle_rad: NDArray[np.float32]
    """(M,)."""
    feature_descriptor: ByteArray
    """(M, 32)."""
    feature_landmark: IntArray
    """(M,): landmark that the feature shows, or −1."""
    positions: FloatArray
    """(N, 3): landmarks, metres in the world."""
    normals: FloatArray
    """(N, 3): mean viewing directions."""
    reach: FloatArray
    """(N,): see :attr:`navcore.slam.map.MapBuilder.reach`."""
    descriptors: ByteArray
    """(N, 32)."""
    trajectory_stamp_s: FloatArray
    """(T,): every tracked frame of the recordings, ascending within each."""
    trajectory_session: IntArray
    """(T,): the recording of each, ascending."""
    trajectory: FloatArray
    """(T, 4, 4): world_from_camera."""
    places: PlaceIndex
    """Which key frames look like an image."""
    landmark_of: IntArray
    """(K, F): ``feature_landmark`` by key frame, padded with NO_LANDMARK."""
    observer_start: Int64Array
    """(N + 1,): observers of landmark n are ``observer[observer_start[n]]`` and the following."""
    observer: IntArray
    """(observations,): key frames."""
    landmark_alive: BoolArray
    """(N,): all True; tracking asks."""

    @property
    def landmark_settled(self) -> BoolArray:
        """(N,): all True; tracking asks."""
        return self.landmark_alive

    @property
    def keyframe_count(self) -> int:
        """K."""
        return len(self.keyframe_stamp_s)

    def keyframes_seeing(self, landmarks: IntArray) -> tuple[IntArray, IntArray]:
        """Return the key frames that see any of the landmarks, best first, and how many of them each sees."""
        counts = _seen_by_each(self.observer_start, self.observer, landmarks.astype(np.int32), self.keyframe_count)
        seeing = np.flatnonzero(counts).astype(np.int32)
        order = np.lexsort((-seeing, -counts[seeing]))
        return seeing[order], counts[seeing[order]]

    def covisible(self, index: int, min_shared: int) -> tuple[IntArray, IntArray]:
        """Return the key frames that share at least ``min_shared`` landmarks with one, best first, and how many."""
        seeing, counts = self.keyframes_seeing(self.landmark_of[index])
        chosen = (seeing != index) & (counts >= min_shared)
        return seeing[chosen], counts[chosen]

    def transformed(self, new_from_old: FloatArray) -> SlamMap:
        """Return the same map in another world frame, ``new_from_old`` (4, 4)."""
        rotation, translation = new_from_old[:3, :3], new_from_old[:3, 3]
        turned = np.kron(np.eye(2), rotation)
        return replace(
            self,
            camera_from_world=np.ascontiguousarray(self.camera_from_world @ np.linalg.inv(new_from_old)),
            keyframe_covariance=np.ascontiguousarray(turned @ self.keyframe_covariance @ turned.T),
            positions=np.ascontiguousarray(self.positions @ rotation.T + translation),
            normals=np.ascontiguousarray(self.normals @ rotation.T),
            trajectory=np.ascontiguousarray(new_from_old @ self.trajectory),
        )

    # ---------------------------------------------------------------------------------------------- storage
    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything as plain arrays by name, to be stored."""
        camera = self.camera
        arrays: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in SHAPES if name != "camera"}
        arrays[DESCRIPTOR_KIND] = descriptor_kind()
        arrays["camera"] = np.array(
            [
                camera.width_px,
                camera.height_px,
                camera.fx_px,
                camera.fy_px,
                camera.cx_px,
                camera.cy_px,
                camera.bf_px_m,
            ]
        )
        arrays.update({_PLACE_PREFIX + name: array for name, array in self.places.arrays().items()})
        return arrays

    @staticmethod
    def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> SlamMap:
        """Read back what :meth:`to_arrays` gave. Raises SiteError where something is missing, does not fit, or was made
        with descriptors that this program does not make."""
        checked = checked_arrays(arrays)
        refuse_other_descriptors(arrays)
        try:
            places = PlaceIndex.from_arrays(
                {name.removeprefix(_PLACE_PREFIX): a for name, a in arrays.items() if name.startswith(_PLACE_PREFIX)}
            )
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise damaged("its index of places is incomplete") from error
        values = checked.pop("camera")
        camera = SlamCamera(int(values[0]), int(values[1]), *(float(value) for value in values[2:]))
        slam_map = assembled(camera, places, checked)
        if slam_map.keyframe_covariance.any():
            return slam_map
        # Imported only for maps of older schemas: the device starts without it.
        from navcore.slam.map_uncertainty import with_covariances

        return with_covariances(slam_map)


def assembled(camera: SlamCamera, places: PlaceIndex, arrays: dict[str, NDArray[Any]]) -> SlamMap:
    """Return the map of checked arrays (all of :data:`SHAPES` but the camera), with the tables that tracking needs."""
    start, landmark = arrays["feature_start"], arrays["feature_landmark"]
    landmark_of = _padded(start, landmark)
    observer_start, observer = _observers(start, landmark, len(arrays["positions"]))
    return SlamMap(
        camera=camera,
        places=places,
        landmark_of=landmark_of,
        observer_start=observer_start,
        observer=observer,
        landmark_alive=np.ones(len(arrays["positions"]), np.bool_),
        **arrays,
    )


def _padded(start: Int64Array, landmark: IntArray) -> IntArray:
    lengths = np.diff(start)
    padded = np.full((len(lengths), int(lengths.max(initial=1))), NO_LANDMARK, np.int32)
    for k, (begin, end) in enumerate(zip(start[:-1].tolist(), start[1:].tolist(), strict=True)):
        padded[k, : end - begin] = landmark[begin:end]
    return padded


def _observers(start: Int64Array, landmark: IntArray, landmark_count: int) -> tuple[Int64Array, IntArray]:
    # Without a kernel: the first one of a process costs longer than reading the whole map.
    keyframe = np.repeat(np.arange(len(start) - 1, dtype=np.int32), np.diff(start))
    seen = landmark >= 0
    counts = np.bincount(landmark[seen], minlength=landmark_count)
    observer = keyframe[seen][np.argsort(landmark[seen], kind="stable")]
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), observer


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _seen_by_each(start: Int64Array, observer: IntArray, landmarks: IntArray, keyframe_count: int) -> IntArray:
    counts = np.zeros(keyframe_count, np.int32)
    for landmark in landmarks:
        if landmark >= 0:
            for i in range(start[landmark], start[landmark + 1]):
                counts[observer[i]] += 1
    return counts
