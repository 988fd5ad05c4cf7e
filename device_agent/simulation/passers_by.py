"""People who walk through the view of somebody who records or walks: they overtake, come towards, and change sides.

Their ways are planned along the walk: each keeps clear of walls, furniture and the walker, and is on stage for some
seconds. So many are let in that about a wanted share of the frames shows somebody; a small picture of each frame tells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from device_agent.simulation.building import Building, SolidArrays, pose_in_stride, push_from_solids, touchable
from device_agent.simulation.people import STRIDE_M, WARDROBE, walking_figure
from device_agent.simulation.renderer import Placement
from device_agent.simulation.scene import RayScene, rays_from
from device_agent.simulation.sensors import HFOV_DEG
from device_agent.simulation.shading import F32
from device_agent.simulation.shapes import GLASS, Piece, Surface
from navcore.errors import InputError
from navcore.geometry import FloatArray, Transform, rotation_about_z

BoolArray = NDArray[np.bool_]

SHOWN_SHARE = 0.01
"""A frame shows somebody when people cover this share of the picture: a whole person at about 6 m."""
_CLEAR_M = 0.27
_WALKER_CLEAR_M = 0.7
"""From body axis to body axis."""
_STEP_S = 0.1
_LONGEST_S = 18.0
_AWAY_M = 9.0
"""They come and go at this distance, or out of sight."""
_POP_UP_M = 6.0
"""Nearer than this nobody appears from nowhere."""
_FASTEST_MPS = 2.2
_SHORTEST = 10
"""Samples of a passage, at least."""
_UNSEEN_S = 0.5
"""They are there for so long before and after they are in sight."""
_ATTEMPTS = 2500
_AUDITIONS = 160
"""So many passages that touch nothing are looked at, at most."""
_TOLERANCE = 0.004
"""Of the share of frames; never less than a frame and a half."""
_FIRST_S = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """One appearance of somebody: samples of where they are, ``_STEP_S`` apart."""

    start_s: float
    position_m: FloatArray
    """(n, 2)."""
    heading_rad: FloatArray
    travelled_m: FloatArray

    @property
    def end_s(self) -> float:
        """When they are gone."""
        return self.start_s + _STEP_S * (len(self.heading_rad) - 1)

    def cut(self, begin: int, end: int) -> Passage:
        """Return the samples from ``begin`` up to ``end``."""
        return Passage(
            self.start_s + _STEP_S * begin,
            self.position_m[begin:end],
            self.heading_rad[begin:end],
            self.travelled_m[begin:end],
        )

    def between(self, begin_s: float, end_s: float) -> Passage:
        """Return the part between two times."""
        count = len(self.heading_rad)
        begin = max(0, math.floor((begin_s - self.start_s) / _STEP_S))
        return self.cut(begin, min(count, math.ceil((end_s - self.start_s) / _STEP_S) + 1))

    def placement_at(self, time_s: float, poses: int) -> Placement | None:
        """Return where they are; None before and after."""
        at = (time_s - self.start_s) / _STEP_S
        if not 0.0 <= at <= len(self.heading_rad) - 1:
            return None
        samples = np.arange(len(self.heading_rad))
        x_m, y_m, yaw_rad, travelled_m = (
            float(np.interp(at, samples, column)) for column in (*self.position_m.T, self.heading_rad, self.travelled_m)
        )
        return Placement(x_m, y_m, yaw_rad, pose_in_stride(travelled_m, STRIDE_M, poses))


@dataclass(frozen=True, slots=True, eq=False)
class PasserBy:
    """A person with all their appearances in a walk, in order of time."""

    poses: tuple[Piece, ...]
    passages: tuple[Passage, ...]

    def placement_at(self, time_s: float) -> Placement | None:
        """Return where they are at a time of the simulation; None while they are away."""
        for passage in self.passages:
            if passage.start_s <= time_s <= passage.end_s:
                return passage.placement_at(time_s, len(self.poses))
        return None


@dataclass(frozen=True, slots=True, eq=False)
class WalkerTrack:
    """The walk that people pass: stamps (n,), positions (n, 2) of the body, and ``world_from_camera`` of the head."""

    stamp_s: FloatArray
    position_m: FloatArray
    heads: tuple[Transform, ...]

    @property
    def arc_m(self) -> FloatArray:
        """Distance walked up to each sample (n,)."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.position_m, axis=0).T))])


def passers_by(building: Building, track: WalkerTrack, share: float, seed: int) -> tuple[PasserBy, ...]:
    """Let people pass so that about ``share`` of the track's samples show somebody. The same seed gives the same.

    Raises InputError for a share outside 0–0.6.
    """
    if not 0.0 <= share <= 0.6:
        raise InputError(f"People in {share:g} of the frames cannot be arranged: choose a share from 0 to 0.6.")
    rng = np.random.default_rng([seed, 11])
    stage = _Stage(building, track)
    cast: list[list[Passage]] = [[] for _ in WARDROBE]
    shown = np.zeros(len(track.stamp_s), np.bool_)
    tolerance = max(_TOLERANCE, 1.5 / max(1, len(shown)))
    auditions = 0
    for number in range(_ATTEMPTS):
        if share <= 0.0 or shown.mean() >= share - tolerance or auditions >= _AUDITIONS:
            break
        passage = _drawn_passage(rng, track, number % 3 == 0)
        actor = int(rng.integers(len(cast)))
        if passage is None:
            continue
        passage = stage.kept_clear(passage)
        show = None if passage is None else stage.on_show(passage, actor)
        if show is None:
            continue
        auditions += 1
        passage, seen = show
        if (shown | seen).mean() > share + tolerance or not _is_free(cast, actor, passage):
            continue
        cast[actor].append(passage)
        shown |= seen
    return tuple(
        PasserBy(stage.figures[k], tuple(sorted(passages, key=lambda passage: passage.start_s)))
        for k, passages in enumerate(cast)
        if passages
    )


def _is_free(cast: Sequence[Sequence[Passage]], actor: int, passage: Passage) -> bool:
    """Tell whether an actor is not on stage meanwhile, and at most one other is."""
    overlaps = [
        sum(other.start_s <= passage.end_s and passage.start_s <= other.end_s for other in passages)
        for passages in cast
    ]
    return overlaps[actor] == 0 and sum(overlaps) <= 1


def _drawn_passage(rng: np.random.Generator, track: WalkerTrack, overtakes: bool) -> Passage | None:
    """Draw somebody who overtakes the walker or comes towards them, and changes sides before them."""
    begin_s, end_s = float(track.stamp_s[0]), float(track.stamp_s[-1])
    meet_s = float(rng.uniform(begin_s + _FIRST_S, end_s))
    speed_mps = float(rng.uniform(1.25, 1.6) if overtakes else rng.uniform(0.7, 1.3))
    sides_m = float(rng.uniform(0.55, 0.85)) * np.array([1.0, float(rng.choice([-1.0, 1.0, -0.6]))])
    sides_m *= float(rng.choice([-1.0, 1.0]))
    cross_m = float(rng.uniform(1.3, 3.2))
    before_s, after_s = (2.0, _LONGEST_S - 2.0) if overtakes else (_LONGEST_S - 10.0, 2.0)
    stamps = np.arange(max(begin_s, meet_s - before_s), min(end_s, meet_s + after_s), _STEP_S)
    if len(stamps) < _SHORTEST:
        return None
    arc = track.arc_m
    meet_m = float(np.interp(meet_s, track.stamp_s, arc))
    along = meet_m + (stamps - meet_s) * speed_mps * (1.0 if overtakes else -1.0)
    on_track = (along > 0.0) & (along < arc[-1])
    if not on_track.all():
        # They come from where the walk has not been, or go where it will not go: leave that out.
        stamps, along = stamps[on_track], along[on_track]
    gap = along - np.interp(stamps, track.stamp_s, arc)
    near = np.abs(gap) < _AWAY_M
    if np.count_nonzero(near) < _SHORTEST:
        return None
    stamps, along, gap = stamps[near], along[near], gap[near]
    # On the near side of ``cross_m`` they are at one hand of the walker, beyond it at the other.
    blend = 0.5 + 0.5 * np.tanh((gap - cross_m) / 0.6)
    return _along_track(track, float(stamps[0]), along, sides_m[0] * (1 - blend) + sides_m[1] * blend, overtakes)


def _along_track(track: WalkerTrack, start_s: float, along_m: FloatArray, side_m: FloatArray, onward: bool) -> Passage:
    arc = track.arc_m
    moved = np.concatenate([[True], np.diff(arc) > 1e-6])
    middle = np.stack([np.interp(along_m, arc[moved], track.position_m[moved, k]) for k in range(2)], axis=1)
    ahead = np.stack([np.interp(along_m + 0.3, arc[moved], track.position_m[moved, k]) for k in range(2)], axis=1)
    behind = np.stack([np.interp(along_m - 0.3, arc[moved], track.position_m[moved, k]) for k in range(2)], axis=1)
    forward = (ahead - behind) / np.maximum(np.hypot(*(ahead - behind).T), 1e-6)[:, None]
    position = middle + side_m[:, None] * np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    return _passage(start_s, position, forward if onward else -forward)


def _passage(start_s: float, position_m: FloatArray, facing: FloatArray) -> Passage:
    steps = np.diff(position_m, axis=0)
    lengths = np.hypot(*steps.T)
    velocity = np.concatenate([steps, steps[-1:]])
    slow = np.concatenate([lengths, lengths[-1:]]) < 0.01
    velocity[slow] = facing[slow]
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    return Passage(start_s, position_m, heading, np.concatenate([[0.0], np.cumsum(lengths)]))


class _Stage:
    """The building, as passers-by and those who look at them know it."""

    def __init__(self, building: Building, track: WalkerTrack) -> None:
        self.figures = tuple(walking_figure(clothes) for clothes in WARDROBE)
        self._track = track
        self._solids: SolidArrays = touchable(building.solids)
        self._walls = RayScene([surface for surface in building.surfaces if surface.texture != GLASS])
        self._bodies: dict[int, RayScene] = {}
        self._distances: dict[int, F32] = {}
        self._rays = _small_picture()

    def kept_clear(self, passage: Passage) -> Passage | None:
        """Return the longest part of the passage in which nothing and nobody is touched, or None if that is short."""
        clear = np.hypot(*(passage.position_m - self._walker_at(passage)).T) >= _WALKER_CLEAR_M
        clear[1:] &= np.diff(passage.travelled_m) <= _FASTEST_MPS * _STEP_S
        for k in np.flatnonzero(clear):
            x_m, y_m = passage.position_m[k]
            clear[k] = push_from_solids(self._solids, float(x_m), float(y_m))[0] >= _CLEAR_M
        edges = np.flatnonzero(np.diff(np.concatenate([[False], clear, [False]]).astype(np.int8)))
        runs = edges.reshape(-1, 2)
        begin, end = max(runs.tolist(), key=lambda run: int(run[1] - run[0]), default=(0, 0))
        if end - begin < _SHORTEST:
            return None
        return passage.cut(begin, end)

    def on_show(self, passage: Passage, actor: int) -> tuple[Passage, BoolArray] | None:
        """Return the part of the passage that is in sight, and which samples of the track (n,) it shows well.

        None where there is none, or the person would appear from nowhere.
        """
        track = self._track
        present = np.flatnonzero((track.stamp_s >= passage.start_s) & (track.stamp_s <= passage.end_s))
        if not len(present) or any(self._pops_up(passage, actor, int(present[end]), end) for end in (0, -1)):
            return None
        shares = np.array([self._share_shown(int(k), passage, actor) for k in present])
        if shares.max() < SHOWN_SHARE:
            return None
        seen = np.zeros(len(track.stamp_s), np.bool_)
        seen[present] = shares >= SHOWN_SHARE
        in_sight_s = track.stamp_s[present[shares > 0.0]]
        return passage.between(float(in_sight_s[0]) - _UNSEEN_S, float(in_sight_s[-1]) + _UNSEEN_S), seen

    def _pops_up(self, passage: Passage, actor: int, frame: int, end: int) -> bool:
        """Tell whether the person comes from (or goes to) nowhere, near the walker and seen by them."""
        away_m = math.dist(passage.position_m[end], self._walker_at(passage)[end])
        return away_m < _POP_UP_M and self._share_shown(frame, passage, actor) >= SHOWN_SHARE / 3

    def _walker_at(self, passage: Passage) -> FloatArray:
        stamps = passage.start_s + _STEP_S * np.arange(len(passage.heading_rad))
        track = self._track
        return np.stack([np.interp(stamps, track.stamp_s, track.position_m[:, k]) for k in range(2)], axis=1)

    def _share_shown(self, frame: int, passage: Passage, actor: int) -> float:
        placement = passage.placement_at(float(self._track.stamp_s[frame]), len(self.figures[actor]))
        if placement is None:
            return 0.0
        head = self._track.heads[frame]
        directions = self._rays @ head.rotation.T.astype(np.float32)
        offset = head.translation - np.array([placement.x_m, placement.y_m, 0.0])
        turn = rotation_about_z(placement.yaw_rad)
        origin = np.broadcast_to(offset @ turn, directions.shape)
        distance, _ = self._body(actor).cast(rays_from(origin, directions @ turn.astype(np.float32)))
        if not np.isfinite(distance).any():
            return 0.0
        if frame not in self._distances:
            origin = np.broadcast_to(head.translation, directions.shape)
            self._distances[frame] = self._walls.cast(rays_from(origin, directions))[0]
        return float(np.mean(distance < self._distances[frame]))

    def _body(self, actor: int) -> RayScene:
        """Return the rays' scene of a person in mid-stride."""
        if actor not in self._bodies:
            surfaces: tuple[Surface, ...] = self.figures[actor][0].surfaces
            self._bodies[actor] = RayScene(surfaces)
        return self._bodies[actor]


def _small_picture(width_px: int = 48, height_px: int = 36) -> F32:
    """Return the rays (n, 3) of a small picture with the head camera's field of view, 1 m along its axis each."""
    reach = math.tan(math.radians(HFOV_DEG) / 2)
    u = (np.arange(width_px) + 0.5) / width_px * 2 - 1
    v = ((np.arange(height_px) + 0.5) / height_px * 2 - 1) * height_px / width_px
    x, y = np.meshgrid(u * reach, v * reach)
    return np.stack([x, y, np.ones_like(x)], axis=2).reshape(-1, 3).astype(np.float32)
