"""Records a walk beside the loop: the loop only leaves what it has read and found; a thread of its own writes it.

What waits for the disk is bounded. Where the disk is behind, pictures are dropped, and counted; never what happened.
Where it takes nothing at all for minutes, recording breaks off with a sentence, and goes on in a new file, which
begins with all that the loop remembers then. A lock-step driver calls :meth:`WalkRecorder.check` instead of running
the thread. Nothing here is raised into the loop.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from device_agent.cycle import Cycle
from device_agent.load_plan import LoadLevel
from device_agent.loop import Ports
from device_agent.orders import Order
from device_agent.ports import Clock, CueOutput, EventKind, KeptMessage, Uplink
from device_agent.recording import channels
from device_agent.recording.notes import (
    Notepad,
    NotingCamera,
    NotingClock,
    NotingLocator,
    NotingOutput,
    NotingSonar,
    noting_floor_finder,
    noting_scanner,
)
from device_agent.recording.options import RecordingOptions
from device_agent.recording.tap import Tap
from device_agent.recording.transcript import CycleItem, Message, happened, heard
from device_agent.recording.walk_files import FLUSH_EVERY_S, WalkFiles
from device_agent.state import DeviceState
from device_agent.voice import VoiceMemory
from navcore.cues.table import Cue
from navcore.types import CameraIntrinsics, Frame
from navcore.wire import WalkerState

MAX_WAITING_PICTURES = 8
MAX_WAITING_ITEMS = 1200
"""About a minute at ten cycles a second: a cycle, a state, and what else happens."""
_Item = CycleItem | list[Message]


class WalkRecorder(Tap):
    """Notes what the loop reads and decides, and has it written."""

    def __init__(self, options: RecordingOptions, files: WalkFiles | None = None) -> None:
        """``files`` is where it is written; made from the options where it is None."""
        self._pictures = options.pictures
        self.files = files or WalkFiles(options, self.told)
        """Where it goes; the recorder's thread alone writes there."""
        self._uplink: Uplink | None = None
        self._pad = Notepad()
        self.cycle_count = 0
        """Cycles since recording began."""
        self._before: tuple[DeviceState, VoiceMemory] | None = None
        self._intrinsics: CameraIntrinsics | None = None
        self._waiting: deque[_Item] = deque()
        self._waiting_pictures = 0
        self._overrun = False
        self.pictures_dropped = 0
        """Frames whose pictures were not kept, though they were to be."""
        self._changed = threading.Condition()
        self._closed = False
        self._thread: threading.Thread | None = None

    # --------------------------------------------------------------------------------------- what the loop meets
    def clock(self, clock: Clock) -> Clock:
        """Note each reading."""
        return NotingClock(clock, self._notepad)

    def uplink(self, uplink: Uplink) -> Uplink:
        """Record what the console is told."""
        self._uplink = uplink
        return _RecordedUplink(uplink, self._offer)

    def voice_output(self, output: CueOutput) -> CueOutput:
        """Note what the loop says."""
        return NotingOutput(output, self._notepad)

    def watchdog_output(self, output: CueOutput) -> CueOutput:
        """Record what the watchdog says."""
        return _RecordedOutput(output, self._offer)

    def stop_count(self, count: Callable[[], int]) -> Callable[[], int]:
        """Note each answer."""

        def noted() -> int:
            value = count()
            self._pad.stop_counts.append(value)
            return value

        return noted

    def load_level(self, level: LoadLevel) -> LoadLevel:
        """Note the level of each cycle."""
        self._pad.load_level = level
        return level

    def ports(self, ports: Ports) -> Ports:
        """Note what a cycle reads."""

        def stale_s() -> float:
            value = ports.stale_s()
            self._pad.stale_s.append(value)
            return value

        return replace(
            ports,
            camera=NotingCamera(ports.camera, self._notepad),
            sonar=NotingSonar(ports.sonar, self._notepad),
            locator=NotingLocator(ports.locator, self._notepad),
            scan=noting_scanner(ports.scan, self._notepad),
            floor=noting_floor_finder(ports.floor, self._notepad),
            stale_s=stale_s,
        )

    def begin(self, state: DeviceState, voice: VoiceMemory, intrinsics: CameraIntrinsics) -> None:
        """Remember what the first file begins with."""
        self._before, self._intrinsics = (state, voice), intrinsics

    def rehearsed(self, frame: Frame) -> None:
        """Keep it for the first file: the localizer remembers it."""
        self.files.rehearsal = frame

    def cycle_begins(self) -> None:
        """Take a new notepad."""
        self._pad = Notepad()

    def order(self, order: Order) -> None:
        """Note an order."""
        self._pad.orders.append(order)

    def cycle_ended(self, state: DeviceState, voice: VoiceMemory, cycle: Cycle) -> None:
        """Leave the cycle for the disk."""
        self.cycle_count += 1
        assert self._before is not None, "the agent begins before it runs"
        before, self._before = self._before, (state, voice)
        pad = self._pad
        if pad.frame is not None and not self._may_keep_pictures():
            pad.frame = None
        item = CycleItem(self.cycle_count, pad, replace(cycle, frame=None), state, *before, self.pictures_dropped)
        self._offer(item)

    # ------------------------------------------------------------------------------------------- beside the loop
    def check(self) -> None:
        """Write all that waits, and hand it to the operating system where that is due."""
        while (item := self._next()) is not None:
            self._write(item)
        self.files.flush_if_due()

    def start(self) -> None:
        """Write from a thread of its own until :meth:`close`; one that writes already goes on."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Write what waits, and complete the file."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()
        self.check()
        self.files.close()

    def _run(self) -> None:
        while not self._closed:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed, FLUSH_EVERY_S / 2)
            self.check()

    def _write(self, item: _Item) -> None:
        if isinstance(item, list):
            self.files.add(item)
            return
        assert self._intrinsics is not None
        self.files.add_cycle(item, self._intrinsics)

    def _next(self) -> _Item | None:
        with self._changed:
            if not self._waiting:
                self._overrun = False
                return None
            item = self._waiting.popleft()
            if isinstance(item, CycleItem) and item.pad.frame is not None:
                self._waiting_pictures -= 1
            return item

    def _offer(self, item: _Item) -> None:
        with self._changed:
            is_news = not self._overrun and len(self._waiting) >= MAX_WAITING_ITEMS
            # Once something is missing, nothing is taken up again before all that waits is written: one gap, not many.
            self._overrun = self._overrun or is_news
            if not self._overrun:
                self._waiting.append(item)
                if isinstance(item, CycleItem) and item.pad.frame is not None:
                    self._waiting_pictures += 1
                self._changed.notify_all()
        if is_news:
            self.told("The disk takes nothing: a part of the walk is not recorded.")

    def _may_keep_pictures(self) -> bool:
        if not self._pictures:
            return False
        with self._changed:
            if self._waiting_pictures < MAX_WAITING_PICTURES:
                return True
        self.pictures_dropped += 1
        return False

    def told(self, text: str) -> None:
        """Tell the console of a trouble with the disk."""
        state_s = self._pad.now_s[-1] if self._pad.now_s else 0.0
        if self._uplink is not None:
            self._uplink.event(state_s, "mode", text)

    def _notepad(self) -> Notepad:
        return self._pad


class _RecordedOutput:
    """What the watchdog speaks through."""

    def __init__(self, output: CueOutput, offer: Callable[[list[Message]], None]) -> None:
        self._output, self._offer = output, offer

    def play(self, cue: Cue) -> None:
        """Begin the cue now."""
        self._output.play(cue)
        self._offer(list(heard("watchdog", cue)))

    def close(self) -> None:
        """Close the output."""
        self._output.close()


class _RecordedUplink:
    """Passes on what the console is told, and records it."""

    def __init__(self, uplink: Uplink, offer: Callable[[list[Message]], None]) -> None:
        self._uplink, self._offer = uplink, offer

    def state(self, state: WalkerState) -> None:
        """Pass on the newest state."""
        self._uplink.state(state)
        self._offer([(channels.DEVICE, state.stamp_s, state)])

    def depth_image(self, frame: Frame) -> None:
        """Pass on the newest depth image."""
        self._uplink.depth_image(frame)

    def colour_image(self, frame: Frame) -> None:
        """Pass on the newest colour picture; it is not recorded here."""
        self._uplink.colour_image(frame)

    def message(self, message: KeptMessage) -> None:
        """Pass on a message."""
        self._uplink.message(message)

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Pass on an event."""
        self._uplink.event(stamp_s, kind, text)
        self._offer(list(happened(stamp_s, kind, text)))
