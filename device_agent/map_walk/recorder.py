"""One map walk while it is walked: frames to the disk, and to SLAM for advice, each in a thread of its own.

The disk gets every frame that it can take, SLAM the newest ones. What waits is bounded; what cannot be written, or not
followed, is said once. Without threads (``beside`` False) all is done while the loop waits, as a lock-step driver
needs it.
"""

from __future__ import annotations

import errno
import logging
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from device_agent.map_walk.tracker import WalkTracker
from device_agent.map_walk.walk_folder import WalkState, read_state, write_state
from device_agent.state import MapWalkTold, Phrase
from navcore.coverage import GOOD_NEWS, HOLD_S, Advice, Coverage, Sight, advise
from navcore.cues.table import CueKind
from navcore.live_recording import LiveRecording, mend_recording
from navcore.recording import Mark
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, Frame
from navcore.wire import MapWalkSeen

RESERVE_BYTES = 512 << 20
"""Room that is left on the disk: for building the map, and for all else that the device keeps."""
DISK_LOOK_EVERY_S = 1.0
MAX_WAITING_S = 0.8
"""Frames that wait for the disk for longer are lost with the process: no more of them are taken."""
SLOW_TOLD_EVERY_S = 20.0
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_log = logging.getLogger(__name__)

Tell = Callable[[MapWalkTold], None]
Show = Callable[[MapWalkSeen], None]
_Item = Frame | Mark | tuple[float, tuple[Advice, ...]]


def advice_told(advice: Advice) -> MapWalkTold:
    """Return an advice as what is said."""
    kind = CueKind.MAP_NEWS if advice in GOOD_NEWS else CueKind.MAP_ADVICE
    return MapWalkTold(kind, (Phrase(f"map_walk_{advice.value}"),))


class WalkRecording:
    """Records one walk into its folder, and tells what is to be said of it."""

    def __init__(
        self,
        folder: Path,
        intrinsics: CameraIntrinsics,
        settings: Settings,
        tell: Tell,
        *,
        beside: bool,
        free_bytes: Callable[[Path], int],
        show: Show = lambda seen: None,
        make_tracker: Callable[[ThreadPoolExecutor | None], WalkTracker] | None = None,
    ) -> None:
        """Begin. Raises OSError where nothing can be written.

        Args:
            folder: made by :func:`walk_folder.new_walk`.
            intrinsics: the camera's.
            settings: thresholds of the advice.
            tell: hears what is to be said, from any thread.
            beside: whether threads do the work.
            free_bytes: room left on the disk of a folder.
            show: told how well the building is seen, frame by frame, for the console; from any thread.
            make_tracker: another tracker, for tests of what becomes of its errors.
        """
        self.folder = folder
        self._settings, self._tell, self._free_bytes, self._show = settings, tell, free_bytes, show
        self._seen = MapWalkSeen(0.0, 0.0, 0, 0, 0, 0, 0.0)
        self._first_stamp_s: float | None = None
        self._place_count = 0
        self._executor = ThreadPoolExecutor(1, "map-walk-mapping") if beside else None
        self._tracker: WalkTracker | None = (make_tracker or (lambda e: WalkTracker(intrinsics, settings, e)))(
            self._executor
        )
        self._recording = LiveRecording(folder, intrinsics)
        self._coverage = Coverage()
        self._changed = threading.Condition()
        self._to_write: deque[_Item] = deque()
        self._to_track: deque[Frame] = deque(maxlen=1)
        self._is_over = False
        self._writes = True
        self._last_stamp_s: float | None = None
        self._looked_s = self._slow_told_s = float("-inf")
        self.dropped_count = 0
        """Frames that were not recorded since the disk was too slow."""
        self._early_marks: list[str] = []
        self._threads = [
            threading.Thread(target=work, name=name, daemon=True)
            for name, work in (("map-walk-disk", self._write_all), ("map-walk-tracker", self._track_all))
            if beside
        ]
        for thread in self._threads:
            thread.start()

    # ------------------------------------------------------------------------------------------ from the loop
    def take(self, frame: Frame) -> None:
        """Record a frame, and let it be followed. Never waits with threads."""
        if self._last_stamp_s is not None and frame.stamp_s <= self._last_stamp_s:
            return
        with self._changed:
            if self._is_behind(frame.stamp_s):
                self.dropped_count += 1
            else:
                self._last_stamp_s = frame.stamp_s
                self._to_write.append(frame)
            self._to_track.append(frame)
            self._changed.notify_all()
        while self._early_marks:
            self.mark(self._early_marks.pop(0))
        if self.dropped_count:
            self._tell_slow(frame.stamp_s)
        if not self._threads:
            self._track(self._to_track.pop())
            self._write_waiting()

    def mark(self, name: str) -> None:
        """Note that a place was named where the last frame was taken; before the first one, where that will be."""
        if self._last_stamp_s is None:
            self._early_marks.append(name)
            return
        with self._changed:
            self._to_write.append(Mark(self._last_stamp_s, "other", name))
            self._changed.notify_all()
        self._place_count += 1
        if Advice.LOST in self._coverage.lasting:
            self._tell(MapWalkTold(CueKind.MAP_ADVICE, (Phrase("map_place_unsure", {"name": name}),)))
        if not self._threads:
            self._write_waiting()

    def _is_behind(self, stamp_s: float) -> bool:
        oldest = next((item for item in self._to_write if isinstance(item, Frame)), None)
        return oldest is not None and stamp_s - oldest.stamp_s > MAX_WAITING_S

    def _tell_slow(self, stamp_s: float) -> None:
        if self._writes and stamp_s - self._slow_told_s > SLOW_TOLD_EVERY_S:
            self._slow_told_s = stamp_s
            self._tell(MapWalkTold(CueKind.MAP_ADVICE, (Phrase("map_disk_slow"),)))

    def finish(self) -> int:
        """Write what waits, and complete the recording; return how many frames it has. Waits for the disk.

        Raises RecordingError where there are none, and OSError.
        """
        with self._changed:
            self._is_over = True
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()
        if self._executor is not None:
            self._executor.shutdown()
        self._write_waiting()
        try:
            self._recording.close()
        finally:
            count = mend_recording(self.folder)
        write_state(self.folder, WalkState("recorded", read_state(self.folder).date))
        return count

    # ------------------------------------------------------------------------------------------------ the disk
    def _write_all(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._to_write or self._is_over)
                if not self._to_write:
                    return
            self._write_waiting()

    def _write_waiting(self) -> None:
        while self._to_write:
            item = self._to_write[0]
            if self._writes:
                self._write(item)
            with self._changed:
                # It counts as waiting until it is written.
                self._to_write.popleft()

    def _write(self, item: _Item) -> None:
        try:
            if isinstance(item, Mark):
                self._recording.mark(item)
            elif isinstance(item, Frame):
                self._recording.add(item)
                self._look_at_disk(item.stamp_s)
            else:
                self._recording.cover(item[0], [advice.value for advice in item[1]])
        except OSError as error:
            self._break_off("map_disk_full" if error.errno in _FULL else "map_not_recorded", error)
        except Exception as error:
            # The thread must live to the end of the walk, and nobody may believe that they still record.
            self._break_off("map_not_recorded", error)

    def _look_at_disk(self, stamp_s: float) -> None:
        if stamp_s - self._looked_s < DISK_LOOK_EVERY_S:
            return
        self._looked_s = stamp_s
        if self._free_bytes(self.folder) < RESERVE_BYTES:
            self._break_off("map_disk_full", None)

    def _break_off(self, key: str, error: Exception | None) -> None:
        """Record no more; what was recorded stays."""
        self._writes = False
        if error is not None:
            _log.warning("a map walk is recorded no further: %s", error)
        self._tell(MapWalkTold(CueKind.MAP_ADVICE, (Phrase(key),), failed=True))

    # ------------------------------------------------------------------------------------------------- advice
    def _track_all(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._to_track or self._is_over)
                if self._is_over:
                    return
                frame = self._to_track.pop()
            self._track(frame)

    def _track(self, frame: Frame) -> None:
        if self._tracker is None:
            return
        try:
            sight = self._tracker.see(frame)
        except Exception:
            # The recording is what matters: it goes on without advice.
            _log.exception("a map walk could not be followed")
            self._tracker = None
            self._tell(MapWalkTold(CueKind.MAP_ADVICE, (Phrase("map_no_feedback"),)))
            return
        self._heed(sight)

    def _heed(self, sight: Sight) -> None:
        advice, self._coverage = advise(sight, self._coverage, self._settings.map_walk)
        self._show_seen(sight, advice)
        if self._coverage.gaps:
            with self._changed:
                self._to_write.append((sight.stamp_s, self._coverage.gaps))
                self._changed.notify_all()
        if advice is not None:
            self._tell(advice_told(advice))

    def _show_seen(self, sight: Sight, advice: Advice | None) -> None:
        before, gaps = self._seen, self._coverage.gaps
        if self._first_stamp_s is None:
            self._first_stamp_s = sight.stamp_s
        passed_s = sight.stamp_s - before.stamp_s if before.frame_count else 0.0
        self._seen = MapWalkSeen(
            sight.stamp_s,
            sight.stamp_s - self._first_stamp_s,
            self._recording.frame_count,
            self._place_count,
            sight.landmark_count,
            sight.loop_count,
            before.weak_s + (passed_s if gaps else 0.0),
            tuple(trouble.value for trouble in Advice if trouble in HOLD_S and self._coverage.holds(trouble)),
            before.last_advice if advice is None else advice.value,
            before.last_advice_stamp_s if advice is None else sight.stamp_s,
        )
        self._show(self._seen)
