"""Recording beside the loop: what is in the files, and what becomes of them when disk or process fail."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import pytest
from recorded_walk import walk_among_boxes
from test_device_agent import Rig

from device_agent.adapters.fakes import FakeLocalizer
from device_agent.recording import recorder as recorder_module
from device_agent.recording.options import RecordingOptions
from device_agent.recording.part_writer import create
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import MAX_WAITING_PICTURES, WalkRecorder
from device_agent.recording.replay import replay
from device_agent.recording.tap import Tap
from device_agent.recording.walk_files import FLUSH_EVERY_S, RETRY_AFTER_S, WalkFiles, parts_in
from navcore.errors import InputError
from navcore.walk_file import WalkFile
from navcore.wire import ClearDestination, ConsoleMessage, Pause, Resume, SetDestination


class Times:
    """Both clocks of the files, moved by hand."""

    def __init__(self) -> None:
        self.monotonic_s = 50.0
        self.wall_s = time.time()
        self.synchronised = False

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        self.monotonic_s += seconds
        self.wall_s += seconds


def recorded_rig(
    options: RecordingOptions,
    times: Times,
    open_file: Callable[[Path], BinaryIO] = create,
    free_bytes: Callable[[Path], int] = lambda folder: 1 << 40,
) -> tuple[Rig, WalkRecorder]:
    """A device on fakes whose files have clocks, a disk and room that a test decides."""
    files = WalkFiles(
        options, lambda text: recorder.told(text), monotonic_s=lambda: times.monotonic_s, wall_s=lambda: times.wall_s,
        is_synchronised=lambda: times.synchronised, open_file=open_file, free_bytes=free_bytes,
    )  # fmt: skip
    recorder = WalkRecorder(options, files)
    return Rig(tap=recorder), recorder


def run(rig: Rig, recorder: WalkRecorder, times: Times, count: int, dt_s: float = 0.1) -> None:
    """Run cycles in lock step; each takes ``dt_s``."""
    for _ in range(count):
        rig.cycles(1)
        times.advance(dt_s)
        recorder.check()


def numbers(path: Path) -> list[int]:
    return [each.notes.number for each in RecordedPart(path).cycles()]


def assert_replays(path: Path) -> None:
    part = RecordedPart(path)
    cycles = list(replay([part]))
    assert cycles
    assert [each.notes.number for each in cycles if each.differs_in] == []


# --------------------------------------------------------------------------------------------------- rotation
def test_a_file_ends_when_it_is_old_and_the_next_one_can_be_replayed_alone(tmp_path: Path) -> None:
    times, walks = Times(), tmp_path / "walks"
    rig, recorder = recorded_rig(RecordingOptions(walks, max_part_s=2.0), times)
    rig.agent.submit(SetDestination("bar"))
    run(rig, recorder, times, 50)
    recorder.close()
    assert walks.stat().st_mode & 0o777 == 0o700  # Nobody else on this machine may look where the walker went.
    paths = parts_in(walks)
    assert [numbers(path) for path in paths] == [[*range(1, 21)], [*range(21, 41)], [*range(41, 51)]]
    for path in paths:
        assert_replays(path)
        assert RecordedPart(path).length_s() is not None
    chained = [each.notes.number for each in replay(map(RecordedPart, paths))]
    assert chained == list(range(1, 51))


def said_in(path: Path, topic: str) -> list[bytes]:
    return [message.data for channel, message in WalkFile(path).messages() if channel.topic == topic]


def test_a_walk_has_files_of_its_own_that_say_which_walk_and_when(tmp_path: Path) -> None:
    """Waiting; a walk with a pause whose file got too old; waiting; and two walks one right after the other."""
    times, finished = Times(), []
    rig, recorder = recorded_rig(RecordingOptions(tmp_path, max_part_s=2.0), times)
    recorder.files.on_finished = lambda: finished.append(True)

    def asked(order: ConsoleMessage, cycles: int) -> None:
        rig.agent.submit(order)
        run(rig, recorder, times, cycles)

    run(rig, recorder, times, 5)
    began_s = times.wall_s
    asked(SetDestination("bar"), 10)
    asked(Pause(), 5)
    asked(Resume(), 10)
    asked(ClearDestination(), 50)
    asked(SetDestination("bar"), 5)
    asked(ClearDestination(), 5)
    asked(SetDestination("bar"), 5)
    recorder.close()
    paths = parts_in(tmp_path)
    parts = [WalkFile(path).part for path in paths]
    walks = [(part.walk_number, part.part) for part in parts if part.is_walk]
    assert not parts[0].is_walk, "nobody was led yet"
    assert walks[:2] == [(1, 1), (1, 2)], "a pause belongs to the walk, which goes on in the next file"
    assert [number for number, part in walks if part == 1] == [1, 2, 3]
    assert not all(part.is_walk for part in parts[1:]), "what lies between two walks is neither's"
    assert parts[1].began_at_s == pytest.approx(began_s, abs=0.2)
    assert len({part.walk_id for part in parts if part.is_walk}) == 3
    assert len(finished) == len(parts), "each file was told of"
    assert [number for path in paths for number in numbers(path)] == list(range(1, 96))
    for part, path in zip(parts, paths, strict=True):
        assert_replays(path)
        modes = {json.loads(state)["mode"] for state in said_in(path, "/device")}
        assert part.is_walk or not modes & {"guiding", "paused", "lost"}
    # What led to the walk is in its own file, and where it leads to.
    assert any(b"Leading to" in line for line in said_in(paths[1], "/log"))
    assert not any(b"Leading to" in line for line in said_in(paths[0], "/log"))
    way = json.loads(said_in(paths[1], "/device/route")[-1])
    assert (way["destination_id"], way["stops"][-1][0]) == ("bar", "Bar")


def test_a_file_ends_when_it_is_large(tmp_path: Path) -> None:
    times = Times()
    options = RecordingOptions(tmp_path, pictures=True, max_part_bytes=400_000)
    rig, recorder = recorded_rig(options, times)
    run(rig, recorder, times, 60)
    recorder.close()
    paths = parts_in(tmp_path)
    assert len(paths) > 2
    # A file may exceed its size by what a second holds, not by more.
    assert max(path.stat().st_size for path in paths) < 2 * options.max_part_bytes
    assert [number for path in paths for number in numbers(path)] == list(range(1, 61))


def test_old_files_make_room_but_never_the_one_that_is_written_nor_files_of_others(tmp_path: Path) -> None:
    times = Times()
    (tmp_path / "holiday.mcap").write_bytes(b"x" * 900_000)
    options = RecordingOptions(
        tmp_path, pictures=True, max_part_bytes=200_000, max_total_bytes=600_000, reserve_bytes=0
    )
    rig, recorder = recorded_rig(options, times)
    for _ in range(100):
        run(rig, recorder, times, 1)
        own = parts_in(tmp_path)
        assert recorder.files.path in own
        assert sum(path.stat().st_size for path in own) <= options.max_total_bytes + options.max_part_bytes
    recorder.close()
    assert (tmp_path / "holiday.mcap").exists()
    first_kept = parts_in(tmp_path)[0]
    assert numbers(first_kept)[0] > 1
    assert_replays(first_kept)


def test_files_are_removed_after_some_days(tmp_path: Path) -> None:
    times = Times()
    options = RecordingOptions(tmp_path, max_part_s=2.0, keep_s=3600.0)
    rig, recorder = recorded_rig(options, times)
    run(rig, recorder, times, 10)
    (old,) = parts_in(tmp_path)
    # Files get their time from the machine, and the test's clock runs ahead of it.
    times.advance(4000.0)
    run(rig, recorder, times, 1)
    recorder.close()
    assert not old.exists()
    assert numbers(parts_in(tmp_path)[0]) == [11]


# --------------------------------------------------------------------------------------------------- failures
@pytest.mark.parametrize("pictures", ["pictures", "none"])
def test_kill_9_loses_at_most_the_last_seconds(tmp_path: Path, pictures: str) -> None:
    victim = Path(__file__).with_name("recording_victim.py")
    process = subprocess.Popen(
        [sys.executable, str(victim), str(tmp_path), pictures], stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        done: list[tuple[int, float]] = []
        while not done or done[-1][1] - done[0][1] < 6.0:
            number, at_s = process.stdout.readline().split()
            done.append((int(number), float(at_s)))
        killed_s = time.monotonic()
        os.kill(process.pid, signal.SIGKILL)
    finally:
        process.kill()
        process.communicate()
    (path,) = parts_in(tmp_path)
    part = RecordedPart(path)
    kept = {each.notes.number for each in part.cycles()}
    # By the device's own clock it is one second (test_kill_device.py); a busy machine may hold the recorder up.
    assert {number for number, at_s in done if at_s < killed_s - 4.0} <= kept
    assert part.damage
    assert_replays(path)
    repaired = tmp_path / "repaired.mcap"
    part.repair(repaired)
    assert RecordedPart(repaired).length_s() is not None
    assert {each.notes.number for each in RecordedPart(repaired).cycles()} == kept


def test_what_was_written_is_handed_over_in_time(tmp_path: Path) -> None:
    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(tmp_path), times)
    run(rig, recorder, times, round(FLUSH_EVERY_S / 0.1) + 1)
    (path,) = parts_in(tmp_path)
    for _ in range(20):
        # The file is read as another process would read it, which is what a crash leaves.
        assert recorder.cycle_count - numbers(path)[-1] <= round(FLUSH_EVERY_S / 0.1)
        run(rig, recorder, times, 1)
    recorder.close()


def full_disk(path: Path) -> BinaryIO:
    """The system's own full disk: everything that is written there fails for want of room."""
    return Path("/dev/full").open("wb")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_guidance_goes_on_when_the_disk_is_full_and_recording_later(tmp_path: Path) -> None:
    times, disks = Times(), [create, full_disk, full_disk]
    options = RecordingOptions(tmp_path, max_part_s=1.0)
    rig, recorder = recorded_rig(options, times, lambda path: (disks.pop(0) if disks else create)(path))
    plain = Rig()
    for each in (rig, plain):
        each.agent.submit(SetDestination("bar"))
    guidance = []
    for _ in range(round(2.5 * RETRY_AFTER_S / 0.1)):
        guidance += [cycle.guidance for cycle in rig.cycles(1)]
        times.advance(0.1)
        recorder.check()
    recorder.close()
    assert guidance == [cycle.guidance for cycle in plain.cycles(len(guidance))]
    broken, again = [text for text in rig.events("mode") if "record" in text.lower()]
    assert "free the disk" in broken
    assert "goes on" in again
    whole = [path for path in parts_in(tmp_path) if path.stat().st_size]
    assert numbers(whole[0])[0] == 1
    assert numbers(whole[1])[0] > round(2 * RETRY_AFTER_S / 0.1)
    for path in whole:
        assert_replays(path)
        assert RecordedPart(path).length_s() is not None


def test_room_is_left_to_the_rest_of_the_device(tmp_path: Path) -> None:
    times, free = Times(), [1 << 40]
    options = RecordingOptions(tmp_path, reserve_bytes=1 << 20)
    rig, recorder = recorded_rig(options, times, free_bytes=lambda folder: free[0])
    run(rig, recorder, times, 20)
    free[0] = 1 << 19
    run(rig, recorder, times, 20)
    (path,) = parts_in(tmp_path)
    assert recorder.files.path is None
    assert RecordedPart(path).length_s() is not None
    assert any("not recorded any more" in text for text in rig.events("mode"))
    free[0] = 1 << 40
    times.advance(RETRY_AFTER_S)
    run(rig, recorder, times, 5)
    recorder.close()
    assert numbers(parts_in(tmp_path)[1]) == [*range(41, 46)]


def test_a_folder_that_cannot_be_made_is_said_and_hurts_nobody(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(tmp_path / "file" / "walks"), times)
    rig.agent.submit(SetDestination("bar"))
    run(rig, recorder, times, 20)
    recorder.close()
    assert rig.agent.state.mode == "guiding"
    assert sum("not recorded" in text for text in rig.events("mode")) == 1


# ----------------------------------------------------------------------------------------------- back-pressure
def test_pictures_are_dropped_first_and_never_what_happened(tmp_path: Path) -> None:
    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(tmp_path, pictures=True), times)
    rig.agent.submit(SetDestination("bar"))
    # Nobody writes meanwhile: the disk takes nothing.
    rig.cycles(30)
    rig.agent.submit(Pause())
    rig.cycles(10)
    recorder.close()
    (path,) = parts_in(tmp_path)
    cycles = list(RecordedPart(path).cycles())
    assert [each.notes.number for each in cycles] == list(range(1, 41))
    assert [each.notes.number for each in cycles if each.notes.pictures] == list(range(1, MAX_WAITING_PICTURES + 1))
    assert recorder.pictures_dropped == 40 - MAX_WAITING_PICTURES
    assert_replays(path)
    with pytest.raises(InputError, match="has no pictures"):
        list(replay([RecordedPart(path)], lambda intrinsics, settings: FakeLocalizer(rig.locate)))


def test_a_disk_that_takes_nothing_for_long_leaves_one_gap_that_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "MAX_WAITING_ITEMS", 40)
    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(tmp_path), times)
    rig.cycles(100)
    run(rig, recorder, times, 10)
    recorder.close()
    first, second = parts_in(tmp_path)
    assert [*numbers(first), *numbers(second)] == [*range(1, len(numbers(first)) + 1), *range(102, 111)]
    assert sum("takes nothing" in text for text in rig.events("mode")) == 1
    assert_replays(first)
    assert_replays(second)


def test_the_loop_does_not_wait_for_the_disk(tmp_path: Path) -> None:
    may_write = threading.Event()

    def slow(path: Path) -> BinaryIO:
        may_write.wait()
        return create(path)

    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(tmp_path, pictures=True), times, slow)
    recorder.start()
    rig.cycles(50)
    assert parts_in(tmp_path) == []
    may_write.set()
    recorder.close()
    assert [number for path in parts_in(tmp_path) for number in numbers(path)] == list(range(1, 51))


def test_where_no_thread_starts_recording_goes_on(tmp_path: Path) -> None:
    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(tmp_path), times)
    # More than there is: the system starts no thread with such a stack.
    usual_bytes = threading.stack_size(1 << 50)
    try:
        run(rig, recorder, times, 30)
    finally:
        threading.stack_size(usual_bytes)
    run(rig, recorder, times, 30)
    recorder.close()
    (path,) = parts_in(tmp_path)
    assert numbers(path) == list(range(1, 61))


def test_a_device_that_begins_in_1970_gives_no_two_runs_the_same_name(tmp_path: Path) -> None:
    options, ids = RecordingOptions(tmp_path, device_id="g" * 60), list[str]()
    chance = iter(["00000001", "00000000"])
    for _ in range(2):
        before = {path: path.read_bytes() for path in parts_in(tmp_path)}
        told = list[str]()
        files = WalkFiles(options, told.append, wall_s=lambda: 12.0, random_hex=lambda count: next(chance))
        recorder = WalkRecorder(options, files)
        rig = Rig(tap=recorder)
        rig.cycles(20)
        recorder.close()
        assert told == []
        assert {path: path.read_bytes() for path in before} == before, "what is there stays as it is"
        (path,) = set(parts_in(tmp_path)) - set(before)
        assert numbers(path) == list(range(1, 21))
        ids.append(WalkFile(path).part.recording_id)
    assert ids == [f"19700101T000012Z-{'g' * 60}-0000000{number}" for number in (1, 0)]


def test_what_the_watchdog_says_is_recorded_as_the_watchdogs(tmp_path: Path) -> None:
    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(tmp_path), times)
    rig.lead_to()
    rig.clock.sleep_until(rig.clock.now_s() + 1.0)
    rig.agent.watchdog.check()
    run(rig, recorder, times, 20)
    recorder.close()
    (path,) = parts_in(tmp_path)
    said = [message.data for channel, message in RecordedPart(path).messages() if channel.topic == "/cues"]
    assert sum(b'"speaker":"watchdog"' in data for data in said) == 1
    assert_replays(path)


def test_recording_changes_nothing_of_the_walk(tmp_path: Path) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path, pictures=True, reserve_bytes=0))
    recorded = walk_among_boxes(recorder, max_s=8.0)
    recorder.close()
    assert recorded == walk_among_boxes(Tap(), max_s=8.0)
