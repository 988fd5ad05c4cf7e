"""A disk that gets full: which recordings go, in which order, which never do, and who is told."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec
import pytest
from test_recorder import Times, recorded_rig, run

from device_agent.doctor.machine import check_recordings
from device_agent.map_walk.walk_folder import STATE_FILE, Stage, WalkState, read_state, write_state
from device_agent.recording import room
from device_agent.recording.options import RecordingOptions
from device_agent.recording.settled import SENT_FILE, Settled
from device_agent.recording.walk_files import RETRY_AFTER_S, parts_in

PART_BYTES = 1000


class Disk:
    """Room that becomes less as somebody else writes, and more as our files go."""

    def __init__(self, folder: Path, capacity_bytes: int) -> None:
        self._folder, self._capacity_bytes = folder, capacity_bytes

    def free_bytes(self, folder: Path) -> int:
        """What is left beside the old recordings."""
        old = [path for path in self._folder.rglob("*") if path.is_file() and path.name.startswith(("2020", "rgb"))]
        return self._capacity_bytes - sum(path.stat().st_size for path in old)


def old_walk(folder: Path, number: int) -> Path:
    """A file of an old walk, the older the smaller its number."""
    path = folder / f"20200101T00000{number}Z-glasses-001.mcap"
    path.write_bytes(b"x" * PART_BYTES)
    os.utime(path, (1.6e9 + number, 1.6e9 + number))
    return path


def map_walk(folder: Path, number: int, stage: Stage) -> Path:
    walk = folder / f"walk-{number:04d}"
    (walk / "rgb").mkdir(parents=True)
    (walk / "rgb" / "rgb1.png").write_bytes(b"x" * PART_BYTES)
    write_state(walk, WalkState(stage))
    os.utime(walk, (1.5e9 + number, 1.5e9 + number))
    return walk


@pytest.fixture
def walks(tmp_path: Path) -> Path:
    folder = tmp_path / "walks"
    folder.mkdir()
    return folder


def options_of(walks: Path, keep_free_bytes: int, reserve_bytes: int = 100) -> RecordingOptions:
    return RecordingOptions(
        walks, keep_free_bytes=keep_free_bytes, reserve_bytes=reserve_bytes, keep_s=1e9,
        map_walks=walks.parent / "map-walks",
    )  # fmt: skip


def test_what_the_console_has_goes_first_then_the_oldest_and_never_an_unconfirmed_map_walk(walks: Path) -> None:
    paths = [old_walk(walks, number) for number in range(4)]
    sent = {paths[1].name: Settled(), paths[2].name: Settled("The console does not take it.")}
    (walks / SENT_FILE).write_bytes(msgspec.json.encode(sent))
    stages: tuple[Stage, ...] = ("sent", "handed_over", "built", "failed", "recording")
    maps = [map_walk(walks.parent / "map-walks", number, stage) for number, stage in enumerate(stages)]
    disk, times = Disk(walks.parent, 10 * PART_BYTES), Times()
    # As if the disk became smaller by a file each time: what goes, goes one after the other.
    expected = [maps[0], paths[1], paths[0], paths[2], paths[3]]
    for count in range(1, len(expected) + 1):
        wanted_bytes = (1 + count) * PART_BYTES
        # What the console has is all that goes for more room; the rest only for going on at all.
        most_bytes = 9 * PART_BYTES
        limits = {1: (wanted_bytes, 100), 2: (most_bytes, 100), 3: (most_bytes, wanted_bytes)}
        options = options_of(walks, *limits[min(count, 3)])
        rig, recorder = recorded_rig(options, times, free_bytes=disk.free_bytes)
        run(rig, recorder, times, 2)
        recorder.close()
        times.advance(2.0)
        gone = [each for each in (*maps, *paths) if not each.exists()]
        assert set(gone) == set(expected[:count]), count
        lost = [text for text in rig.events("mode") if "does not have" in text]
        assert len(lost) == (count > 2), "only what is lost is told"
    assert all(read_state(each).stage == stage for each, stage in zip(maps[1:], stages[1:], strict=True))


def test_a_disk_that_gets_full_meanwhile_makes_room_and_the_walk_goes_on_in_its_file(walks: Path) -> None:
    old = [old_walk(walks, number) for number in range(3)]
    disk, times = Disk(walks, 3 * PART_BYTES + 900), Times()
    rig, recorder = recorded_rig(options_of(walks, 850, 800), times, free_bytes=disk.free_bytes)
    run(rig, recorder, times, 10)
    written = recorder.files.path
    assert all(path.exists() for path in old)
    disk._capacity_bytes -= 850
    run(rig, recorder, times, 10, dt_s=RETRY_AFTER_S / 5)
    assert recorder.files.path == written, "nothing has broken off"
    assert [path.exists() for path in old] == [False, True, True], "no more than is needed"
    recorder.close()
    assert written in parts_in(walks)


@pytest.mark.parametrize(("free_bytes", "goes_on"), [(5500, True), (1500, False)], ids=["room to record", "none"])
def test_walks_that_are_nowhere_else_stay_where_losing_them_all_would_not_help(
    walks: Path, free_bytes: int, goes_on: bool
) -> None:
    """Somebody else fills the disk: three old walks would not make it enough, or it is enough to record."""
    old = [old_walk(walks, number) for number in range(3)]
    disk, times = Disk(walks, 3 * PART_BYTES + free_bytes), Times()
    rig, recorder = recorded_rig(options_of(walks, 9000, 5000), times, free_bytes=disk.free_bytes)
    run(rig, recorder, times, 10, dt_s=RETRY_AFTER_S / 3)
    recorder.close()
    assert all(path.exists() for path in old)
    assert (len(parts_in(walks)) > len(old)) == goes_on
    assert any("not recorded any more" in text for text in rig.events("mode")) != goes_on


def test_where_nothing_may_go_recording_ends_and_says_so_as_before(walks: Path) -> None:
    kept = map_walk(walks.parent / "map-walks", 1, "handed_over")
    times = Times()
    rig, recorder = recorded_rig(options_of(walks, 800), times, free_bytes=lambda folder: 50)
    run(rig, recorder, times, 3)
    recorder.close()
    assert [text for text in rig.events("mode") if "not recorded any more" in text]
    assert kept.exists()
    assert parts_in(walks) == []


@pytest.mark.parametrize(("free", "sent", "status"), [(5000, False, "ok"), (500, True, "ok"), (500, False, "warning")])
def test_the_doctor_says_what_goes_next(walks: Path, free: int, sent: bool, status: str) -> None:
    path = old_walk(walks, 1)
    if sent:
        (walks / SENT_FILE).write_bytes(msgspec.json.encode({path.name: Settled()}))
    finding = check_recordings(options_of(walks, 1200), lambda folder: free)
    assert finding.status.value == status
    assert ("--share-walks" in finding.advice) == (status == "warning")
    assert check_recordings(None).status.value == "ok"


def test_a_map_walk_whose_removal_was_cut_off_is_removed_the_next_time(
    walks: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    walk = map_walk(walks.parent / "map-walks", 1, "sent")
    (walk / "depth").mkdir()
    removed: list[Path] = []

    def cut_off(path: Path) -> None:
        if removed:
            raise OSError("the battery was pulled out")
        removed.append(path)
        for each in path.iterdir():
            each.unlink()
        path.rmdir()

    (kept,) = room.map_walks_that_may_go(walk.parent)
    with monkeypatch.context() as patched:
        patched.setattr(room.shutil, "rmtree", cut_off)
        with pytest.raises(OSError, match="battery"):
            room.remove(kept)
    assert (walk / STATE_FILE).exists()
    (again,) = room.map_walks_that_may_go(walk.parent)
    room.remove(again)
    assert not walk.exists()
