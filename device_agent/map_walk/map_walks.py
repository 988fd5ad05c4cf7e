"""The device's map walks, from the first frame to the map that is put in use.

A walk is recorded (:mod:`recorder`); then its map is built here (:mod:`building`), or the recording is left for the
console's machine. A finished map goes to the agent as an order, which takes it when nobody is led and no map is
recorded. What was broken off is taken up at the next start.
"""

from __future__ import annotations

import datetime
import logging
import os
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import msgspec

from device_agent.map_walk.recorder import Show, WalkRecording
from device_agent.map_walk.report import report_told
from device_agent.map_walk.walk_folder import (
    BROKEN_OFF,
    WalkState,
    new_walk,
    read_state,
    walks_in,
    write_checksums,
    write_state,
)
from device_agent.orders import Order
from device_agent.ports import LocalizerPort
from device_agent.state import MapWalkTold, Phrase, PreparedMap
from navcore.cues.table import CueKind
from navcore.errors import VbrError
from navcore.live_recording import mend_recording
from navcore.map_building import MapBuilding
from navcore.recording import read_marks
from navcore.settings import Settings
from navcore.site import Site, load_site, map_checksum
from navcore.types import CameraIntrinsics, Frame

MAX_ATTEMPTS = 2
"""A map whose building was cut off so often by the end of the device is not begun again by itself."""
PROGRESS_TOLD_PERCENT = (25, 50, 75)
_JOIN_TIMEOUT_S = 10.0
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class WalkPlan:
    """Where map walks go, and what becomes of them."""

    folder: Path
    """Each walk has a folder of its own in here."""
    site_folder: Path
    """The map that the device runs; new ones wait beside it, so that they can be moved into place in one step."""
    owns_map: bool = True
    """No console publishes this device's map. Where one does, it is there that a new map is built."""
    beside: bool = True
    """Whether threads do the work; a lock-step driver waits for all of it."""

    def staging(self, walk: Path) -> Path:
        """Return where the new map of a walk waits."""
        return self.site_folder.parent / f".{self.site_folder.name}-{walk.name}"


def free_bytes_of(folder: Path) -> int:
    """Return the room that is left on the disk of a folder. Raises OSError."""
    return shutil.disk_usage(folder).free


def _today() -> str:
    return datetime.datetime.now(tz=datetime.UTC).date().isoformat()


LEAST_ROAD_M = 1.0
"""A map of less than this does not take the place of one that is in use: somebody pressed a button by mistake."""


class _TooShortError(VbrError):
    """A walk of which nobody wants a map."""


class DeviceMapWalks:
    """Fulfils :class:`device_agent.ports.MapWalks`."""

    def __init__(
        self,
        plan: WalkPlan,
        intrinsics: CameraIntrinsics,
        make_localizer: Callable[[Site, CameraIntrinsics, Settings], LocalizerPort],
        submit: Callable[[Order], None],
        *,
        show: Show = lambda seen: None,
        handed_over: Callable[[], None] = lambda: None,
        today: Callable[[], str] = _today,
        free_bytes: Callable[[Path], int] = free_bytes_of,
    ) -> None:
        """Put it together.

        Args:
            plan: where walks go.
            intrinsics: the camera's.
            make_localizer: prepares a new map.
            submit: takes orders for the agent, from any thread.
            show: told how well the building is seen, for the console.
            handed_over: called when a recording waits to be sent to the console's machine.
            today: the date, for tests.
            free_bytes: room left on the disk of a folder, for tests.
        """
        self._show, self._handed_over = show, handed_over
        self._plan, self._intrinsics, self._make_localizer = plan, intrinsics, make_localizer
        self._submit, self._today, self._free_bytes = submit, today, free_bytes
        self._recording: WalkRecording | None = None
        self._settings = Settings()
        self._one_at_a_time = threading.Lock()
        self._building = MapBuilding()
        self._threads: list[threading.Thread] = []

    # ------------------------------------------------------------------------------------------ from the loop
    def begin(self, settings: Settings) -> None:
        """Begin to record a walk; where that cannot be, it is said, and the walk is over."""
        self._settings = settings
        try:
            self._recording = WalkRecording(
                new_walk(self._plan.folder, self._today()), self._intrinsics, settings, self._tell,
                beside=self._plan.beside, free_bytes=self._free_bytes, show=self._show,
            )  # fmt: skip
        except OSError as error:
            _log.warning("no map walk can be recorded: %s", error)
            self._tell(MapWalkTold(CueKind.MAP_ADVICE, (Phrase("map_not_recorded"),), failed=True))

    def take(self, frame: Frame) -> None:
        """Record a frame."""
        if self._recording is not None:
            self._recording.take(frame)

    def mark(self, name: str) -> None:
        """Note that a place was named where the last frame was taken."""
        if self._recording is not None:
            self._recording.mark(name)

    def end(self) -> None:
        """End the walk; its map follows."""
        recording, self._recording = self._recording, None
        if recording is not None:
            self._do(lambda: self._complete(recording))

    def take_up(self, settings: Settings) -> None:
        """Bring to an end what was broken off when the device last ended."""
        self._settings = settings
        for walk in walks_in(self._plan.folder):
            stage = read_state(walk).stage
            # Path.is_dir would raise, and end the start, where the disk fails.
            if stage == "built" and os.path.isdir(self._plan.staging(walk)):
                self._do(partial(self._guarded, walk, self._hand_to_agent))
            elif stage in BROKEN_OFF:
                self._do(partial(self._guarded, walk, self._take_up))

    def close(self) -> None:
        """Complete the recording that runs, and end what is being built: the next start goes on with both."""
        self._building.stop()
        recording, self._recording = self._recording, None
        if recording is not None:
            self._guarded(recording.folder, lambda _: recording.finish())
        for thread in self._threads:
            thread.join(_JOIN_TIMEOUT_S)

    # ----------------------------------------------------------------------------------------- beside the loop
    def _do(self, work: Callable[[], None]) -> None:
        if not self._plan.beside:
            work()
            return
        self._threads = [each for each in self._threads if each.is_alive()]
        thread = threading.Thread(target=work, name="map-walk", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _guarded(self, walk: Path, work: Callable[[Path], object]) -> None:
        """Do a part of the work on a walk; what fails is said, and kept with the recording."""
        try:
            work(walk)
        except _TooShortError as error:
            self._fail(walk, str(error), "map_too_short")
        except (VbrError, OSError) as error:
            self._fail(walk, str(error), "map_not_built")

    def _fail(self, walk: Path, reason: str, told: str) -> None:
        _log.warning("%s: %s", walk.name, reason)
        try:
            write_state(walk, msgspec.structs.replace(read_state(walk), stage="failed", reason=reason))
        except OSError as error:
            _log.warning("%s: its state cannot be written (%s)", walk.name, error)
        self._news(Phrase(told))

    def _complete(self, recording: WalkRecording) -> None:
        def work(walk: Path) -> None:
            recording.finish()
            self._go_on(walk)

        self._guarded(recording.folder, work)

    def _take_up(self, walk: Path) -> None:
        """What was broken off, as a rule by an empty battery, is cut to what is whole of it."""
        mend_recording(walk)
        write_state(walk, msgspec.structs.replace(read_state(walk), stage="recorded"))
        self._news(Phrase("map_unfinished"))
        self._go_on(walk)

    def _go_on(self, walk: Path) -> None:
        """Build the map of a complete recording, or leave it for the console's machine."""
        places = len(read_marks(walk / "marks.txt"))
        if not (self._plan.owns_map and self._settings.map_walk.build_here):
            write_checksums(walk)
            write_state(walk, msgspec.structs.replace(read_state(walk), stage="handed_over"))
            self._news(Phrase("map_handed_over", {"places": places}))
            self._handed_over()
            return
        self._news(Phrase("map_recorded", {"places": places}))
        with self._one_at_a_time:
            if self._built(walk):
                self._hand_to_agent(walk)

    def _built(self, walk: Path) -> bool:
        """Build the map of a walk; False where the device ends meanwhile."""
        state = read_state(walk)
        if state.attempts >= MAX_ATTEMPTS:
            raise VbrError(f"The building of this map was cut off {state.attempts} times: run `vbr map build {walk}`.")
        # Counted before it begins: what takes the whole device down is not begun for ever.
        write_state(walk, msgspec.structs.replace(state, attempts=state.attempts + 1))
        due = list(PROGRESS_TOLD_PERCENT)

        def progress(percent: int) -> None:
            while due and percent >= due[0]:
                self._news(Phrase("map_building", {"percent": due.pop(0)}))

        if not self._building.build(walk, self._plan.staging(walk), walk.name, state.date, progress):
            write_state(walk, state)
            return False
        write_state(walk, WalkState("built", state.date, state.attempts + 1))
        return True

    def _hand_to_agent(self, walk: Path) -> None:
        staging = self._plan.staging(walk)
        site = load_site(staging)
        if site.report["road_m"] < LEAST_ROAD_M:
            shutil.rmtree(staging, ignore_errors=True)
            raise _TooShortError(f"Only {site.report['road_m']:.1f} m were walked: the map from before stays.")
        localizer = self._make_localizer(site, self._intrinsics, self._settings)
        self._submit(PreparedMap(staging, map_checksum(staging), site, localizer, report_told(site.report)))

    def _news(self, phrase: Phrase) -> None:
        self._tell(MapWalkTold(CueKind.MAP_NEWS, (phrase,)))

    def _tell(self, told: MapWalkTold) -> None:
        try:
            self._submit(told)
        except VbrError:
            _log.warning("not said: %s", told.text("en"))
