"""What a new key frame sets off, in line or beside tracking: culling, new landmarks, fusion, adjustment, loops.

It begins when the key frame has joined the map and is settled before the next frame is tracked, so tracking never sees
a half-changed map, and the same input gives the same bytes with and without an executor. What runs beside it is the
rest of the frame's period: waiting for the camera, reading, and the extraction of the next frame's features; nearly all
of the work is kernels that run without the interpreter's lock.
"""

from __future__ import annotations

from concurrent.futures import Executor, Future
from dataclasses import dataclass

from navcore.slam import mapping
from navcore.slam.loop_closing import LoopCloser
from navcore.slam.map import MapBuilder
from navcore.slam.triangulation import add_landmarks_without_depth


@dataclass(frozen=True, slots=True)
class Settled:
    """What became of a key frame."""

    keyframe: int
    has_closed_loop: bool
    """The whole map has moved."""


class LocalMapping:
    """Works on one key frame at a time. While it does, nobody else may touch the map: settle first.

    ``executor`` runs the work elsewhere (one worker is enough); without one it runs in line.
    """

    def __init__(self, builder: MapBuilder, closer: LoopCloser, executor: Executor | None = None) -> None:
        self._builder = builder
        self._closer = closer
        self._executor = executor
        self._running: Future[Settled] | None = None
        self._done: Settled | None = None

    def begin(self, keyframe: int) -> None:
        """Work on a key frame that has joined the map with the landmarks that tracking found."""
        if self._executor is None:
            self._done = self._work(keyframe)
        else:
            self._running = self._executor.submit(self._work, keyframe)

    def settle(self) -> Settled | None:
        """Wait until the map may be touched; return what became of the last key frame, None where nothing was begun.

        An error of the work is raised here.
        """
        if self._running is not None:
            running, self._running = self._running, None
            self._done = running.result()
        done, self._done = self._done, None
        return done

    def _work(self, keyframe: int) -> Settled:
        builder = self._builder
        row = builder.landmark_of[keyframe]
        builder.refresh_landmarks(row[row >= 0])
        mapping.cull_young_landmarks(builder, keyframe)
        mapping.add_landmarks_from_depth(builder, keyframe)
        add_landmarks_without_depth(builder, keyframe, mapping.MAX_LANDMARK_DEPTH_M)
        mapping.fuse_with_neighbours(builder, keyframe)
        mapping.adjust_locally(builder, keyframe)
        mapping.cull_redundant_keyframes(builder, keyframe)
        return Settled(keyframe, self._closer.add(keyframe) is not None)
