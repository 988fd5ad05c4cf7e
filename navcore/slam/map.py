"""The growing map: key frames, landmarks, and which key frame sees which landmark at which feature.

Everything is held in flat arrays, so that searching, culling, fusing and adjusting are a few array operations or one
kernel. Key frame k sees landmark ``landmark_of[k, f]`` at its feature f; :mod:`navcore.slam.observers` holds the same
the other way round, so ``landmark_of`` is changed only by the methods here. Indices of key frames and landmarks are
never reused; what is culled is marked in ``keyframe_alive`` and ``landmark_alive``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam import observers
from navcore.slam.descriptors import WordArray, as_words, bit_distance
from navcore.slam.keyframes import (
    DESCRIPTOR_BYTES,
    INV_SIGMA2,
    NO_LANDMARK,
    SCALE_FACTOR,
    ByteArray,
    Features,
    IntArray,
    KeyFrame,
    SlamCamera,
)
from navcore.slam.rolling_shutter import ReadoutTime, unrolled

BoolArray = NDArray[np.bool_]

SETTLED_KEYFRAMES = 3
"""Key frames that must see a landmark before it may decide where the camera is against others."""
LONG_AGO = -1_000_000
"""Stands in ``first_keyframe`` of landmarks that were taken over from a finished map."""


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Observations as bundle adjustment takes them; indices are into the map's arrays."""

    keyframe: IntArray
    """(m,)."""
    landmark: IntArray
    """(m,)."""
    feature: IntArray
    """(m,): feature of the key frame."""
    uvr_px: FloatArray
    """(m, 3): u, v, u_r (NaN without depth)."""
    inv_sigma2: FloatArray
    """(m,): 1/px²."""


class MapBuilder:
    """The map while it is built. A view such as ``positions`` is valid until something is added."""

    def __init__(self, camera: SlamCamera, features_per_frame: int) -> None:
        self.camera = camera
        self.keyframes: list[KeyFrame] = []
        self.loop_edges: list[tuple[int, int, FloatArray]] = []
        """(i, j, i_from_j (4, 4)) of every closed loop, for the essential graph."""
        self.version = 0
        """Counts corrections of the whole map (loops closed), after which remembered poses are stale."""
        self.session = 0
        """The recording that key frames which are added now come from."""
        self.depth_grids: dict[int, NDArray[np.uint16]] = {}
        """Depth grids (rows, columns) of key frames, see :class:`navcore.slam.depth_model.DepthModel`."""
        self.grey_grids: dict[int, ByteArray] = {}
        """Mean grey (rows, columns) of the depth grids' cells."""
        self.depth_carried: set[int] = set()
        """Key frames whose poses rest on depth more than on landmarks."""
        self.drifts: dict[int, FloatArray] = {}
        """Of key frames up to which something was open: see :attr:`navcore.slam.slam_map.SlamMap.keyframe_drift`."""
        self.readout = ReadoutTime()
        """How long the camera takes to read a picture, as far as is known."""
        self._feature_capacity = features_per_frame
        self._camera_from_world = np.zeros((0, 4, 4))
        self._landmark_of: IntArray = np.zeros((0, features_per_frame), np.int32)
        self._keyframe_alive: BoolArray = np.zeros(0, np.bool_)
        self._parent: IntArray = np.zeros(0, np.int32)
        self._culled_from_parent = np.zeros((0, 4, 4))
        self._landmark_count = 0
        self._positions = np.zeros((0, 3))
        self._normals = np.zeros((0, 3))
        self._reach = np.zeros(0)
        self._descriptors: ByteArray = np.zeros((0, DESCRIPTOR_BYTES), np.uint8)
        self._landmark_alive: BoolArray = np.zeros(0, np.bool_)
        self._visible: IntArray = np.zeros(0, np.int32)
        self._found: IntArray = np.zeros(0, np.int32)
        self._first_keyframe: IntArray = np.zeros(0, np.int32)
        self._observers: IntArray = np.zeros((0, 16, 2), np.int32)
        self._observer_count: IntArray = np.zeros(0, np.int32)
        self._octaves: NDArray[np.int8] = np.zeros((0, features_per_frame), np.int8)

    # ------------------------------------------------------------------------------------------- key frames
    @property
    def camera_from_world(self) -> FloatArray:
        """(K, 4, 4): poses of the key frames; write into it to move them."""
        return self._camera_from_world[: len(self.keyframes)]

    @property
    def landmark_of(self) -> IntArray:
        """(K, F): landmark that each feature of each key frame shows, or NO_LANDMARK. Change it by :meth:`connect`."""
        return self._landmark_of[: len(self.keyframes)]

    @property
    def keyframe_alive(self) -> BoolArray:
        """(K,): False for culled key frames."""
        return self._keyframe_alive[: len(self.keyframes)]

    @property
    def parent(self) -> IntArray:
        """(K,): spanning tree; each key frame's most covisible elder when it was added; −1 for the first."""
        return self._parent[: len(self.keyframes)]

    def add_keyframe(
        self, stamp_s: float, features: Features, camera_from_world: FloatArray, landmark_of: IntArray
    ) -> int:
        """Add a key frame that sees ``landmark_of`` (n,) at its features; return its index."""
        index = len(self.keyframes)
        if index == len(self._keyframe_alive):
            self._grow_keyframes(max(64, 2 * index))
        self.keyframes.append(KeyFrame(index, stamp_s, features, self.session))
        self._camera_from_world[index] = camera_from_world
        self._octaves[index, : len(features)] = features.octave
        self._keyframe_alive[index] = True
        self.connect(index, np.arange(len(features), dtype=np.int32), landmark_of)
        others, _ = self.covisible(index, 1)
        self._parent[index] = others[0] if len(others) else self._last_alive_before(index)
        return index

    def unroll(self, index: int, velocity: FloatArray | None = None) -> None:
        """Take the camera's movement during the readout out of a key frame's features, as it is known now.

        ``velocity`` is the twist per second (6,) while the picture was taken, the one known before where None.
        """
        held = self.keyframes[index]
        known = held.velocity if velocity is None else velocity
        if known is not None:
            features = unrolled(held.features, known, self.readout.seconds, self.camera)
            self.keyframes[index] = replace(held, features=features, velocity=known)

    def refine_readout(self, step_s: float, information: float) -> None:
        """Take in by how much longer the readout of a picture takes than was thought, and unroll all key frames so."""
        before = self.readout.seconds
        self.readout = self.readout.refined(step_s, information)
        if abs(self.readout.seconds - before) > 1e-5:
            for index in np.flatnonzero(self.keyframe_alive).tolist():
                self.unroll(index)

    def _last_alive_before(self, index: int) -> int:
        alive = np.flatnonzero(self._keyframe_alive[:index])
        return int(alive[-1]) if len(alive) else -1

    def remove_keyframe(self, index: int) -> None:
        """Cull a key frame; its children in the spanning tree go to its parent, its pose stays relative to that."""
        self._keyframe_alive[index] = False
        parent = int(self._parent[index])
        world_from_parent = np.linalg.inv(self._camera_from_world[parent])
        self._culled_from_parent[index] = self._camera_from_world[index] @ world_from_parent
        children = np.flatnonzero(self.parent == index)
        self._parent[children[self._keyframe_alive[children]]] = parent
        features = np.flatnonzero(self._landmark_of[index] >= 0).astype(np.int32)
        self.disconnect(np.full(len(features), index, np.int32), features)

    def pose_of(self, index: int) -> FloatArray:
        """Return camera_from_world (4, 4) of a key frame, also of a culled one (relative to its living ancestor)."""
        pose = np.eye(4)
        while not self._keyframe_alive[index]:
            pose = pose @ self._culled_from_parent[index]
            index = int(self._parent[index])
        return np.asarray(pose @ self._camera_from_world[index])

    def covisible(self, index: int, min_shared: int) -> tuple[IntArray, IntArray]:
        """Return the living key frames that share at least ``min_shared`` landmarks with one, best first, and how many.

        Ties go to the younger.
        """
        shared = observers.seen_by_each(
            self._observers, self._observer_count, self._landmark_of[index], len(self.keyframes)
        )
        shared[index] = 0
        shared[~self.keyframe_alive] = 0
        others = np.flatnonzero(shared >= max(1, min_shared)).astype(np.int32)
        order = np.lexsort((-others, -shared[others]))
        return others[order], shared[others[order]]

    def keyframes_seeing(self, landmarks: IntArray) -> tuple[IntArray, IntArray]:
        """Return the living key frames that see any of the landmarks, best first, and how many of them each sees."""
        counts = observers.seen_by_each(
            self._observers, self._observer_count, landmarks.astype(np.int32), len(self.keyframes)
        )
        counts[~self.keyframe_alive] = 0
        seeing = np.flatnonzero(counts).astype(np.int32)
        order = np.lexsort((-seeing, -counts[seeing]))
        return seeing[order], counts[seeing[order]]

    # -------------------------------------------------------------------------------------------- landmarks
    @property
    def landmark_count(self) -> int:
        """N, culled ones included."""
        return self._landmark_count

    @property
    def positions(self) -> FloatArray:
        """(N, 3): metres in the world; write into it to move them."""
        return self._positions[: self._landmark_count]

    @property
    def normals(self) -> FloatArray:
        """(N, 3): mean direction from the observing cameras to the landmark."""
        return self._normals[: self._landmark_count]

    @property
    def reach(self) -> FloatArray:
        """(N,): distance, per pixel of focal length, at which the landmark appears at pyramid level 0."""
        return self._reach[: self._landmark_count]

    @property
    def descriptors(self) -> ByteArray:
        """(N, 32): the most typical descriptor of each landmark."""
        return self._descriptors[: self._landmark_count]

    @property
    def landmark_alive(self) -> BoolArray:
        """(N,): False for culled and fused landmarks."""
        return self._landmark_alive[: self._landmark_count]

    @property
    def visible(self) -> IntArray:
        """(N,): in how many frames the landmark should have been seen."""
        return self._visible[: self._landmark_count]

    @property
    def found(self) -> IntArray:
        """(N,): in how many frames it was."""
        return self._found[: self._landmark_count]

    @property
    def first_keyframe(self) -> IntArray:
        """(N,): the key frame that created it, LONG_AGO where that is not known."""
        return self._first_keyframe[: self._landmark_count]

    def add_landmarks(self, keyframe: int, features: IntArray, positions: FloatArray) -> IntArray:
        """Add landmarks at positions (n, 3) that a key frame sees at its features (n,); return their indices (n,)."""
        count = len(features)
        first = self._landmark_count
        while first + count > len(self._reach):
            self._grow_landmarks(max(4096, 2 * len(self._reach)))
        self._landmark_count = first + count
        new = np.arange(first, first + count, dtype=np.int32)
        seen = self.keyframes[keyframe].features
        pose = self._camera_from_world[keyframe]
        self._positions[new] = positions
        rays = positions - (-pose[:3, :3].T @ pose[:3, 3])
        distance = np.maximum(np.linalg.norm(rays, axis=1), 1e-9)
        self._normals[new] = rays / distance[:, None]
        self._reach[new] = distance * SCALE_FACTOR ** seen.octave[features] / self.camera.fx_px
        self._descriptors[new] = seen.descriptors[features]
        self._landmark_alive[new] = True
        self._visible[new] = 1
        self._found[new] = 1
        self._first_keyframe[new] = keyframe
        self.connect(keyframe, features, new)
        return new

    def adopt_landmarks(
        self, positions: FloatArray, normals: FloatArray, reach: FloatArray, descriptors: ByteArray
    ) -> IntArray:
        """Add landmarks of a finished map, (n, 3), (n, 3), (n,) and (n, 32), that no key frame sees yet.

        Return their indices (n,). They have proved themselves: they are never culled as young ones.
        """
        first, count = self._landmark_count, len(positions)
        if first + count > len(self._reach):
            self._grow_landmarks(max(4096, first + count, 2 * len(self._reach)))
        self._landmark_count = first + count
        new = np.arange(first, first + count, dtype=np.int32)
        self._positions[new] = positions
        self._normals[new] = normals
        self._reach[new] = reach
        self._descriptors[new] = descriptors
        self._landmark_alive[new] = True
        self._visible[new] = 1
        self._found[new] = 1
        self._first_keyframe[new] = LONG_AGO
        return new

    def connect(self, keyframe: int, features: IntArray, landmarks: IntArray) -> None:
        """Let a key frame see ``landmarks`` (n,) at its ``features`` (n,), in place of what it saw there."""
        landmarks = landmarks.astype(np.int32)
        shown = landmarks[landmarks >= 0]
        if len(shown) == 0 and not len(self._reach):
            return
        self._make_room(int(self._observer_count[shown].max(initial=0)) + 2)
        observers.connect(
            self._observers, self._observer_count, self._landmark_of, keyframe, features.astype(np.int32), landmarks
        )

    def disconnect(self, keyframes: IntArray, features: IntArray) -> None:
        """Take away what each feature (n,) of each key frame (n,) shows."""
        observers.disconnect(
            self._observers,
            self._observer_count,
            self._landmark_of,
            keyframes.astype(np.int32),
            features.astype(np.int32),
        )

    def remove_landmarks(self, landmarks: IntArray) -> None:
        """Cull landmarks and all their observations."""
        self._landmark_alive[landmarks] = False
        observers.clear(self._observers, self._observer_count, self._landmark_of, landmarks.astype(np.int32))

    def fuse_landmarks(self, old: IntArray, new: IntArray) -> None:
        """Replace landmarks ``old`` (n,) by ``new`` (n,) everywhere.

        Chains (a → b, b → c) are followed; a key frame that would see the survivor at two features keeps one.
        """
        survivor: dict[int, int] = {}
        for source, target in zip(old.tolist(), new.tolist(), strict=True):
            source_root, target_root = _root(survivor, source), _root(survivor, target)
            if source_root == target_root:
                continue
            survivor[source_root] = target_root
            self._visible[target_root] += self._visible[source_root]
            self._found[target_root] += self._found[source_root]
            self._landmark_alive[source_root] = False
            self._make_room(int(self._observer_count[source_root] + self._observer_count[target_root]))
            observers.hand_over(self._observers, self._observer_count, self._landmark_of, source_root, target_root)

    @property
    def landmark_settled(self) -> BoolArray:
        """(N,): whether enough key frames see a landmark at the same place to believe that it stands still."""
        return np.asarray(self.observation_counts() >= SETTLED_KEYFRAMES)

    def observation_counts(self) -> IntArray:
        """Return in how many living key frames each landmark is seen (N,). Read only."""
        return self._observer_count[: self._landmark_count]

    def redundancy(self, keyframe: int, others_needed: int) -> tuple[int, int]:
        """Return how many landmarks a key frame sees, and how many of them enough others see about as well."""
        return observers.redundancy(
            self._observers, self._observer_count, self._octaves, self._landmark_of[keyframe], keyframe, others_needed
        )

    def observations(self, keyframes: IntArray, chosen_landmarks: BoolArray | None = None) -> Observations:
        """Return the observations that key frames (k,) make, of all living or of the chosen (N,) landmarks."""
        chosen = self.landmark_alive if chosen_landmarks is None else chosen_landmarks & self.landmark_alive
        rows: list[IntArray] = []
        columns: list[IntArray] = []
        measured: list[FloatArray] = []
        octaves: list[IntArray] = []
        for keyframe in keyframes.tolist():
            row = self._landmark_of[keyframe]
            columns.append(np.flatnonzero((row >= 0) & chosen[np.maximum(row, 0)]).astype(np.int32))
            rows.append(np.full(len(columns[-1]), keyframe, np.int32))
            features = self.keyframes[keyframe].features
            measured.append(features.uvr_px[columns[-1]])
            octaves.append(features.octave[columns[-1]])
        keyframe_index = np.concatenate(rows) if rows else np.zeros(0, np.int32)
        feature_index = np.concatenate(columns) if columns else np.zeros(0, np.int32)
        return Observations(
            keyframe_index,
            self._landmark_of[keyframe_index, feature_index],
            feature_index,
            np.concatenate(measured) if measured else np.zeros((0, 3)),
            INV_SIGMA2[np.concatenate(octaves)] if octaves else np.zeros(0),
        )

    def refresh_landmarks(self, landmarks: IntArray) -> None:
        """Recompute normal, reach and typical descriptor of landmarks (n,) from the key frames that see them."""
        chosen = np.zeros(self._landmark_count, np.bool_)
        chosen[landmarks] = True
        seeing, _ = self.keyframes_seeing(landmarks)
        seen = self.observations(np.sort(seeing), chosen)
        if len(seen.keyframe) == 0:
            return
        order = np.argsort(seen.landmark, kind="stable")
        octaves = np.concatenate(
            [self.keyframes[k].features.octave[seen.feature[seen.keyframe == k]] for k in np.unique(seen.keyframe)]
        )
        descriptors = np.concatenate(
            [self.keyframes[k].features.descriptors[seen.feature[seen.keyframe == k]] for k in np.unique(seen.keyframe)]
        )
        rotations = self.camera_from_world[:, :3, :3]
        centres = -np.einsum("kji,kj->ki", rotations, self.camera_from_world[:, :3, 3])
        _refresh(
            np.ascontiguousarray(seen.landmark[order]),
            np.ascontiguousarray(centres[seen.keyframe[order]]),
            np.ascontiguousarray(octaves[order]),
            as_words(descriptors[order]),
            SCALE_FACTOR,
            self.camera.fx_px,
            self.positions,
            self.normals,
            self.reach,
            as_words(self.descriptors),
        )

    # ---------------------------------------------------------------------------------------------- storage
    def _grow_keyframes(self, capacity: int) -> None:
        self._camera_from_world = _grown(self._camera_from_world, capacity, 0.0)
        self._landmark_of = _grown(self._landmark_of, capacity, NO_LANDMARK)
        self._octaves = _grown(self._octaves, capacity, 0)
        self._keyframe_alive = _grown(self._keyframe_alive, capacity, False)
        self._parent = _grown(self._parent, capacity, -1)
        self._culled_from_parent = _grown(self._culled_from_parent, capacity, 0.0)

    def _grow_landmarks(self, capacity: int) -> None:
        self._positions = _grown(self._positions, capacity, 0.0)
        self._normals = _grown(self._normals, capacity, 0.0)
        self._reach = _grown(self._reach, capacity, 0.0)
        self._descriptors = _grown(self._descriptors, capacity, 0)
        self._landmark_alive = _grown(self._landmark_alive, capacity, False)
        self._visible = _grown(self._visible, capacity, 0)
        self._found = _grown(self._found, capacity, 0)
        self._first_keyframe = _grown(self._first_keyframe, capacity, -1)
        self._observers = _grown(self._observers, capacity, 0)
        self._observer_count = _grown(self._observer_count, capacity, 0)

    def _make_room(self, width: int) -> None:
        if width > self._observers.shape[1]:
            # Few landmarks are seen by many: their rows make all others longer, so the table widens in small steps.
            wider = np.zeros((len(self._observers), width + width // 4, 2), np.int32)
            count = self._landmark_count
            wider[:count, : self._observers.shape[1]] = self._observers[:count]
            self._observers = wider


def _grown(array: NDArray[np.generic], capacity: int, fill: float) -> NDArray:  # type: ignore[type-arg]
    # Memory that is zero from the start is taken only where something is written.
    shape = (capacity, *array.shape[1:])
    grown = np.full(shape, fill, array.dtype) if fill else np.zeros(shape, array.dtype)
    grown[: len(array)] = array
    return grown


def _root(survivor: dict[int, int], landmark: int) -> int:
    while landmark in survivor:
        landmark = survivor[landmark]
    return landmark


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _refresh(
    landmark: IntArray,
    centre: FloatArray,
    octave: IntArray,
    words: WordArray,
    scale_factor: float,
    focal_px: float,
    positions: FloatArray,
    normals: FloatArray,
    reach: FloatArray,
    map_words: WordArray,
) -> None:
    """Refresh the landmarks whose observations lie in runs of equal ``landmark`` (m,)."""
    start = 0
    while start < len(landmark):
        end = start
        point = landmark[start]
        normal = np.zeros(3)
        reach_sum = 0.0
        while end < len(landmark) and landmark[end] == point:
            ray = positions[point] - centre[end]
            distance = max(np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2), 1e-9)
            normal += ray / distance
            reach_sum += np.log(distance * scale_factor ** octave[end] / focal_px)
            end += 1
        length = max(np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2), 1e-9)
        normals[point] = normal / length
        reach[point] = np.exp(reach_sum / (end - start))
        best, best_sum = start, 1 << 30
        for i in range(start, end):
            distances = 0
            for j in range(start, end):
                distances += bit_distance(words[i], words[j])
            if distances < best_sum:
                best, best_sum = i, distances
        map_words[point] = words[best]
        start = end
