"""Outputs, recorder, journal and link that hang: cycles go on, Stop is given, pictures are dropped, events are not.

Real threads, a real pipe, a real socket; what hangs does so until the test lets it go.
"""

from __future__ import annotations

import contextlib
import os
import socket
import sqlite3
import sys
import threading
import types
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from device_hall import GRAPH, INTRINSICS, Rig, pose_at
from test_recorder import assert_replays, numbers

from device_agent.adapters.clocks import SystemClock
from device_agent.adapters.fakes import FakeOutput
from device_agent.adapters.outputs import TextOutput
from device_agent.adapters.sound_device import SoundDeviceOutput
from device_agent.adapters.waiting_cues import MAX_WAITING_CUES, ThreadedOutput, WaitingCues
from device_agent.device_store import DeviceStore
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.recording.options import RecordingOptions
from device_agent.recording.part_writer import create
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import MAX_WAITING_PICTURES, WalkRecorder
from device_agent.recording.walk_files import WalkFiles, parts_in
from device_agent.state import PreparedMap
from navcore.cues.synthesis import stop_cue
from navcore.cues.table import Cue, CueKind
from navcore.espeak import Speech
from navcore.planning.poi_graph import PoiGraph
from navcore.site import Site
from navcore.types import Action, Reason
from navcore.wire import Pause, PublishGraph, Resume

LONG_S = 30.0
CYCLES = 60


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def run_off_thread(work: Callable[[], object]) -> None:
    """Run what must not wait for anybody; where it does, the test fails instead of hanging."""
    failures: list[BaseException] = []

    def guarded() -> None:
        try:
            work()
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=guarded, daemon=True)
    thread.start()
    thread.join(LONG_S)
    assert not thread.is_alive(), "the loop waits for what hangs"
    if failures:
        raise failures[0]


def walk_on(rig: Rig, count: int = CYCLES) -> list[Action]:
    """Walk down the hall; return what guidance said."""
    actions: list[Action] = []

    def work() -> None:
        for _ in range(count):
            x_m = float(rig.pose.translation[0]) if rig.pose is not None else 0.0
            rig.pose = pose_at(x_m + 0.08)
            actions.extend(cycle.guidance.action for cycle in rig.cycles(1))

    run_off_thread(work)
    return actions


def stop_is_given(rig: Rig) -> None:
    """The loop fails, and the watchdog says Stop."""
    stops = rig.agent.watchdog.stop_count
    heard = rig.heard.count(CueKind.STOP)
    run_off_thread(lambda: rig.agent.watchdog.fault("The loop has failed."))
    assert rig.agent.watchdog.stop_count == stops + 1
    assert rig.heard.count(CueKind.STOP) == heard + 1


# ----------------------------------------------------------------------------------------------------------- audio
def test_text_that_nobody_reads(stack: ExitStack) -> None:
    """The terminal's pipe is full: writing to it waits for ever."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(writing, b"." * 4096):
            pass
    os.set_blocking(writing, True)
    stream = stack.enter_context(os.fdopen(writing, "w"))
    output = ThreadedOutput(TextOutput(stream, tones=True))
    rig = Rig(first_output=output)
    rig.lead_to()
    assert set(walk_on(rig)) == {Action.WALK}
    stop_is_given(rig)
    # The reader comes back, and finds the newest that was said.
    drained = threading.Event()

    def drain() -> None:
        read = b""
        while b"stop" not in read:
            read += os.read(reading, 65536)
        drained.set()

    threading.Thread(target=drain, daemon=True).start()
    assert drained.wait(LONG_S)
    output.close()
    os.close(reading)


def test_a_sound_device_that_hangs(monkeypatch: pytest.MonkeyPatch, stack: ExitStack) -> None:
    """On a stand-in for the package sounddevice, which does not return from playing the first cue."""
    go_on, hangs = threading.Event(), threading.Event()
    played: list[int] = []

    def play(samples: object, rate_hz: int) -> None:
        played.append(1)
        hangs.set()
        assert go_on.wait(LONG_S)

    package = types.SimpleNamespace(check_output_settings=lambda **_: None, play=play, wait=lambda: None)
    monkeypatch.setitem(sys.modules, "sounddevice", package)
    output = SoundDeviceOutput(Speech())
    stack.callback(output.close)
    stack.callback(go_on.set)
    rig = Rig(first_output=output)
    rig.lead_to()
    assert hangs.wait(LONG_S)
    assert set(walk_on(rig)) == {Action.WALK}
    stop_is_given(rig)
    assert len(played) == 1


def test_waiting_cues_are_bounded_and_the_newest_stays() -> None:
    waiting = WaitingCues()
    for number in range(3 * MAX_WAITING_CUES):
        waiting.put(stop_cue(float(number), Reason.OK, "en"))
    assert waiting.dropped_count == 2 * MAX_WAITING_CUES
    taken = [waiting.next() for _ in range(MAX_WAITING_CUES)]
    assert [cue.stamp_s for cue in taken if cue is not None] == list(range(2 * MAX_WAITING_CUES, 3 * MAX_WAITING_CUES))
    waiting.close()
    waiting.put(stop_cue(0.0, Reason.OK, "en"))
    assert waiting.next() is None
    assert waiting.newest() is None


def test_an_output_that_fails_in_its_thread_plays_the_next_cue() -> None:
    heard, second = [], threading.Event()

    def on_play(cue: Cue) -> None:
        heard.append(cue)
        if len(heard) == 1:
            raise OSError("the earphone is unplugged")
        second.set()

    output = ThreadedOutput(FakeOutput(on_play))
    for stamp_s in (1.0, 2.0):
        output.play(stop_cue(stamp_s, Reason.OK, "en"))
    assert second.wait(LONG_S)
    output.close()
    assert [cue.stamp_s for cue in heard] == [1.0, 2.0]


# -------------------------------------------------------------------------------------------------------- recorder
def test_a_disk_that_hangs_drops_pictures_and_no_event(tmp_path: Path, stack: ExitStack) -> None:
    may_write, hangs = threading.Event(), threading.Event()

    def hanging(path: Path) -> BinaryIO:
        hangs.set()
        assert may_write.wait(LONG_S)
        return create(path)

    options = RecordingOptions(tmp_path, pictures=True)
    recorder = WalkRecorder(options, WalkFiles(options, lambda text: recorder.told(text), open_file=hanging))
    rig = Rig(tap=recorder)
    recorder.start()
    stack.callback(recorder.close)
    stack.callback(may_write.set)
    rig.lead_to()
    assert hangs.wait(LONG_S)
    assert set(walk_on(rig)) == {Action.WALK}
    rig.agent.submit(Pause())
    rig.cycles(2)
    rig.agent.submit(Resume())
    rig.cycles(2)
    stop_is_given(rig)
    assert recorder.pictures_dropped >= CYCLES - MAX_WAITING_PICTURES
    may_write.set()
    recorder.close()
    (path,) = parts_in(tmp_path)
    assert numbers(path) == list(range(1, recorder.cycle_count + 1))
    orders = [order.kind for each in RecordedPart(path).cycles() for order in each.notes.orders]
    assert orders == ["SetDestination", "Pause", "Resume"]
    assert_replays(path)


def test_a_disk_that_hangs_while_a_map_is_put_in_place(tmp_path: Path, stack: ExitStack) -> None:
    """The next walk begins meanwhile; the graph that belongs to the map is written after it."""
    may_write, hangs, done = threading.Event(), threading.Event(), []
    stack.callback(may_write.set)

    class HangingStore(DeviceStore):
        """A store whose disk takes its time."""

        def swap_map(self, staging: Path) -> None:
            """Hang."""
            hangs.set()
            assert may_write.wait(LONG_S)
            done.append("map")

        def save_graph(self, graph: PoiGraph) -> None:
            """Come after it."""
            done.append("graph")

    rig = Rig(HangingStore(tmp_path / "state", tmp_path / "site"))
    rig.cycles(3)
    empty = np.zeros((0, 3))
    site = Site("new", "New", INTRINSICS, {}, (), empty.astype(np.float32), empty.astype(np.uint8), GRAPH)
    rig.agent.submit(PreparedMap(tmp_path / "staging", "new-map", site, rig.localizer))
    rig.agent.submit(PublishGraph(PoiGraph(9, GRAPH.pois, GRAPH.edges)))
    run_off_thread(lambda: rig.cycles(1))
    assert hangs.wait(LONG_S)
    assert rig.agent.state.map_checksum == "new-map"
    run_off_thread(lambda: rig.lead_to())
    assert set(walk_on(rig)) == {Action.WALK}
    assert done == []
    may_write.set()
    rig.agent.settle()
    assert done == ["map", "graph"]


# ----------------------------------------------------------------------------------------------- journal and link
class HangingConsole:
    """A machine that takes the connection, and then says nothing and reads nothing."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._connections: list[socket.socket] = []
        self.joined = threading.Event()
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self._listening.getsockname()[1]}"

    def _accept(self) -> None:
        try:
            while True:
                connection, _ = self._listening.accept()
                self._connections.append(connection)
                self.joined.set()
        except OSError:
            return

    def close(self) -> None:
        self._listening.close()
        for connection in self._connections:
            connection.close()


def told(journal: EventJournal) -> list[str]:
    journal.flush()
    events, after = [], 0
    while batch := journal.pending(after):
        events += batch
        after = batch[-1].sequence
    return [event.text for event in events]


def test_a_console_that_hangs(tmp_path: Path, stack: ExitStack) -> None:
    console = HangingConsole()
    stack.callback(console.close)
    journal = EventJournal(tmp_path / "events.sqlite")
    stack.callback(journal.close)
    settings = LinkSettings(console.url, "token", tmp_path / "staging", answer_timeout_s=LONG_S)
    link = ConsoleLink(settings, journal, SystemClock())
    stack.callback(link.stop)
    rig = Rig(link=link)
    link.start(rig.agent)
    assert console.joined.wait(LONG_S)
    rig.lead_to()
    assert set(walk_on(rig)) == {Action.WALK}
    stop_is_given(rig)
    heard = [cue.text for cue in rig.output.cues if cue.text]
    spoken_by_loop = [text for text in told(journal) if text in heard]
    assert spoken_by_loop, "what was said is kept for the console"
    assert [text for text in heard if text not in spoken_by_loop] in ([], [heard[-1]]), "but for the watchdog's Stop"


def test_a_journal_whose_disk_hangs_loses_no_event(tmp_path: Path, stack: ExitStack) -> None:
    """Another process holds the file: writing to it waits."""
    journal = EventJournal(tmp_path / "events.sqlite")
    stack.callback(journal.close)
    holder = sqlite3.connect(tmp_path / "events.sqlite", isolation_level=None)
    stack.callback(holder.close)
    holder.execute("BEGIN IMMEDIATE")
    settings = LinkSettings("ws://127.0.0.1:9", "token", tmp_path / "staging")
    link = ConsoleLink(settings, journal, SystemClock())
    stack.callback(link.stop)
    rig = Rig(link=link)
    rig.lead_to()
    assert set(walk_on(rig)) == {Action.WALK}
    stop_is_given(rig)
    holder.execute("ROLLBACK")
    heard = [cue.text for cue in rig.output.cues if cue.text]
    assert set(heard[:-1]) <= set(told(journal))


# ------------------------------------------------------------------------------------------------------ everything
def test_all_of_it_at_once(tmp_path: Path, stack: ExitStack) -> None:
    """Text, recorder and link hang together, and the depth image shows the way all the same."""
    release = threading.Event()

    class Hanging:
        """An output that does not return."""

        def play(self, cue: Cue) -> None:
            """Hang."""
            assert release.wait(LONG_S)

        def close(self) -> None:
            """Nothing is open."""

    def hanging(path: Path) -> BinaryIO:
        assert release.wait(LONG_S)
        return create(path)

    console = HangingConsole()
    stack.callback(console.close)
    journal = EventJournal(tmp_path / "events.sqlite")
    stack.callback(journal.close)
    link = ConsoleLink(LinkSettings(console.url, "token", tmp_path / "staging"), journal, SystemClock())
    stack.callback(link.stop)
    options = RecordingOptions(tmp_path / "walks", pictures=True)
    recorder = WalkRecorder(options, WalkFiles(options, lambda text: recorder.told(text), open_file=hanging))
    output = ThreadedOutput(Hanging())
    rig = Rig(tap=recorder, link=link, first_output=output)
    stack.callback(output.close)
    stack.callback(recorder.close)
    stack.callback(release.set)
    recorder.start()
    link.start(rig.agent)
    assert console.joined.wait(LONG_S)
    rig.lead_to()
    assert set(walk_on(rig, 2 * CYCLES)) == {Action.WALK}
    stop_is_given(rig)
    assert recorder.pictures_dropped >= 2 * CYCLES - MAX_WAITING_PICTURES
