"""A device that walks for hours of its own time, as fast as the machine can: the process that ``long_run`` starts.

    python -m benchmarks.long_run_device FOLDER CONSOLE_URL TOKEN HOURS SIZE RATE_HZ SEED

The real agent in lock step: obstacles, guidance, planning, voice, watchdog, recorder with rotation by its own clock,
journal, log, and a link that dials a real console in real time and sends recorded walks there. Its words are spoken by
espeak into nothing. Prints one JSON object a line, every ten minutes of its time.
"""

from __future__ import annotations

import gc
import json
import logging
import sys
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.growth import folder_mb
from benchmarks.recording import Walk, simulated
from device_agent.adapters.clocks import SteppedClock, SystemClock
from device_agent.adapters.fakes import FakeCamera, FakeLocalizer, FakeSonar
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.logged_uplink import LoggedUplink
from device_agent.logs import PACKAGES, log_files
from device_agent.orders import Lead
from device_agent.ports import Uplink
from device_agent.recording.options import RecordingOptions
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.walk_files import WalkFiles
from device_agent.sharing import Consent, Privacy
from device_agent.simulation.pace import RealTimeUplink
from device_agent.state import DeviceState
from navcore.cue_sound import render_cue
from navcore.cues.table import Cue
from navcore.espeak import Speech
from navcore.geometry import Transform
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.settings import Settings
from navcore.types import Frame, Localization, LocalizationQuality

DEVICE_ID = "glasses-0"
FRAMES_COUNT = 300
TELL_EVERY_S = 600.0
RECORDINGS_MB = 256
"""As if the device had so little room: files of old walks must go."""


class FastClock(SteppedClock):
    """The clock of the loop, which passes as fast as the machine can; tells the real time of its stamps."""

    def __init__(self, real: SystemClock) -> None:
        super().__init__(real.now_s())
        self._real = real

    def real_s(self, stamp_s: float) -> float:
        """Return when something of this stamp has happened in real time."""
        return self._real.now_s() - (self.now_s() - stamp_s)


class SpokenIntoNothing:
    """Makes the sound of every cue with words, as a loudspeaker's adapter does."""

    def __init__(self) -> None:
        self._speech = Speech()
        self.spoken_count = 0

    def play(self, cue: Cue) -> None:
        """Render it."""
        if cue.text:
            render_cue(cue, self._speech)
            self.spoken_count += 1

    def close(self) -> None:
        """Nothing to close."""


class LongWalk:
    """The agent on the frames of one walk, again and again from its beginning; always led to its end."""

    def __init__(self, walk: Walk, clock: FastClock, uplink: Uplink, recorder: WalkRecorder, rate_hz: float) -> None:
        self._clock, self._walk, self._period_s = clock, walk, 1.0 / rate_hz
        self._poses: dict[float, Transform] = {}
        self._sonar, self.output = FakeSonar(clock), SpokenIntoNothing()
        camera = FakeCamera(walk.camera, clock, self._frames())
        parts = DeviceParts(
            clock,
            camera,
            self._sonar,
            self.output,
            uplink,
            lambda *_: FakeLocalizer(self._locate),
            tap=recorder,
            device_id=DEVICE_ID,
        )
        state = DeviceState(Settings(), _along(walk), "corridor", privacy=Privacy(Consent(walks=True)))
        self.agent = DeviceAgent(parts, state, FakeLocalizer(self._locate))

    def cycle(self) -> None:
        """Run one; who has arrived is led again."""
        if not self.agent.state.leading:
            self.agent.submit(Lead("b"))
        self._sonar.echo(None)
        self.agent.run_cycle()
        self.agent.watchdog.check()

    def _frames(self) -> Iterable[Frame]:
        stamp_s = self._clock.now_s()
        while True:
            for frame, pose in self._walk.seen:
                stamp_s += self._period_s
                self._poses = {stamp_s: pose}
                yield replace(frame, stamp_s=stamp_s)

    def _locate(self, frame: Frame) -> Localization:
        pose = self._poses[frame.stamp_s]
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, pose, np.eye(6) * 1e-4, 200)


def _along(walk: Walk) -> PoiGraph:
    """Return a graph of the way itself."""
    path = tuple((float(pose.translation[0]), float(pose.translation[1])) for _, pose in walk.seen[::5])
    length_m = float(np.hypot(*np.diff(np.array(path), axis=0).T).sum())
    ends = {
        name: Poi(name, label, "other", *at) for name, label, at in (("a", "Start", path[0]), ("b", "End", path[-1]))
    }
    return PoiGraph(1, ends, {"ab": Edge("ab", "a", "b", path, length_m)})


def main() -> int:
    """Walk."""
    folder, url, token = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    hours, rate_hz, seed = float(sys.argv[4]), float(sys.argv[6]), int(sys.argv[7])
    width_px, height_px = map(int, sys.argv[5].split("x"))
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.INFO)
    walk = simulated((width_px, height_px), FRAMES_COUNT).in_millimetres()
    real = SystemClock()
    clock = FastClock(real)
    with ExitStack() as stack:
        stack.enter_context(log_files(folder / "logs"))
        journal = EventJournal(folder / "events.sqlite")
        stack.callback(journal.close)
        link = ConsoleLink(
            LinkSettings(url, token, folder / "staging", walks=folder / "walks", seed=seed), journal, real
        )
        stack.callback(link.stop)
        options = RecordingOptions(
            folder / "walks", max_part_bytes=RECORDINGS_MB << 18, max_total_bytes=RECORDINGS_MB << 20, reserve_bytes=0,
            shared=True,
        )  # fmt: skip
        files = WalkFiles(options, monotonic_s=clock.now_s, wall_s=clock.now_s)
        recorder = WalkRecorder(options, files)
        files.on_finished, link.open_walk = link.recording_waits, lambda: files.path
        stack.callback(recorder.close)
        uplink = LoggedUplink(RealTimeUplink(link, clock))  # type: ignore[arg-type]
        walking = LongWalk(walk, clock, uplink, recorder, rate_hz)
        walking.agent.announce()
        link.start(walking.agent)
        _walk_on(walking, recorder, clock, link, folder, hours)
    return 0


def _walk_on(
    walking: LongWalk, recorder: WalkRecorder, clock: FastClock, link: ConsoleLink, folder: Path, hours: float
) -> None:
    began_s = clock.now_s()
    due_s, real_s = TELL_EVERY_S, time.monotonic()
    total_ms: list[float] = []
    actions: Counter[str] = Counter()
    while due_s <= 3600.0 * hours:
        began_cycle_s = time.perf_counter()
        walking.cycle()
        total_ms.append(1000.0 * (time.perf_counter() - began_cycle_s))
        recorder.check()
        guidance = walking.agent.state.guidance
        actions[guidance.action.value if guidance is not None else "none"] += 1
        if (passed_s := clock.now_s() - began_s) < due_s:
            continue
        due_s += TELL_EVERY_S
        told = {
            "hours": passed_s / 3600.0,
            "figures": {
                "device: a cycle, median, ms": float(np.median(total_ms)),
                "device: a cycle, p99, ms": float(np.percentile(total_ms, 99)),
                "device: Python objects, thousands": len(gc.get_objects()) / 1e3,
                "device: passes of the full collector": gc.get_stats()[2]["collections"],
                "device: journal with its log, MB": folder_mb(folder, "events.sqlite*"),
                "device: recordings, MB": folder_mb(folder / "walks"),
                "device: log files, MB": folder_mb(folder / "logs"),
            },
            "cycles": recorder.cycle_count,
            "spoken": walking.output.spoken_count,
            "actions": dict(actions),
            "link": link.link_state.condition.value,
            "took_s": time.monotonic() - real_s,
        }
        total_ms.clear()
        sys.stdout.write(json.dumps(told) + "\n")
        sys.stdout.flush()
        # Whoever reads looks at this process now, before it goes on.
        if not sys.stdin.readline():
            return


if __name__ == "__main__":
    sys.exit(main())
