"""A device whose disk is full: guidance is the same, the loss is told, and all goes on as soon as there is room."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from device_console import Console
from device_hall import Rig
from small_disk import SmallDisk, small_disk
from test_device_link import Device, cues, make_link
from test_recorder import Times, numbers, recorded_rig

from device_agent.device_store import DeviceStore
from device_agent.journal import EventJournal
from device_agent.recording.options import RecordingOptions
from device_agent.recording.walk_files import parts_in
from navcore.settings import Settings
from navcore.wire import ApplySettings, SetDestination

CYCLE_S, RETRY_AFTER_S = 0.1, 4.0


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    with small_disk(tmp_path / "disk") as disk:
        yield disk


@pytest.fixture
def console() -> Iterator[Console]:
    console = Console()
    console.start()
    yield console
    console.close()


def test_guidance_is_the_same_decision_for_decision_and_the_loss_is_told(
    disk: SmallDisk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("device_agent.recording.walk_files.RETRY_AFTER_S", RETRY_AFTER_S)
    times = Times()
    options = RecordingOptions(disk.folder / "walks", reserve_bytes=0)
    rig, recorder = recorded_rig(options, times)
    store = DeviceStore(disk.folder / "state", disk.folder / "site")
    rig = Rig(tap=recorder, store=store)
    plain = Rig()
    for each in (rig, plain):
        each.agent.submit(SetDestination("bar"))
    told, expected = [], []
    for number in range(140):
        if number == 20:
            disk.fill()
        if number == 30:
            for each in (rig, plain):
                each.agent.submit(ApplySettings(7, {"planning.replan_hold_s": 4.0}))
        if number == 60:
            disk.free()
        told += [(cycle.guidance, cycle.cues) for cycle in rig.cycles(1)]
        expected += [(cycle.guidance, cycle.cues) for cycle in plain.cycles(1)]
        rig.agent.settle()
        times.advance(CYCLE_S)
        recorder.check()
    recorder.close()
    assert told == expected
    modes = rig.events("mode")
    assert any("could not be kept for the next start" in text and "free the disk" in text for text in modes)
    broken, again = [text for text in modes if "ecord" in text and "kept" not in text]
    assert "The walk is not recorded any more (No space left on device): free the disk of" in broken
    assert "Recording goes on" in again
    first, *_, last = [numbers(path) for path in parts_in(options.folder) if path.stat().st_size]
    assert first == list(range(1, len(first) + 1)), "up to the gap, all of it"
    assert last[-1] == len(told)
    assert store.load_settings() == (Settings(), 0), "what ran before is still whole"


def test_a_device_on_a_full_disk_is_joined_to_the_console_and_its_events_come_once(
    disk: SmallDisk, console: Console, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("device_agent.journal.RETRY_EVERY_S", 0.05)
    with ExitStack() as stack:
        journal = EventJournal(disk.folder / "events.sqlite")
        stack.callback(journal.close)
        link = make_link(f"ws://127.0.0.1:{console.port}", journal, tmp_path)
        link.start(Device())
        stack.callback(link.stop)
        link.event(1.0, "cue", "before")
        console.wait_for(lambda: cues(console) == ["before"])
        # What waits on a disk that is full is sent, and confirmed; the link holds, and comes back after a cut.
        console.kill()
        link.event(2.0, "cue", "stored")
        journal.flush()
        disk.fill()
        link.event(3.0, "cue", "not stored")
        journal.flush()
        joins = console.joins
        console.start()
        console.wait_for(lambda: cues(console) == ["before", "stored"])
        console.kill()
        console.start()
        console.wait_for(lambda: console.joins == joins + 2)
        assert cues(console) == ["before", "stored"]
        disk.free()
        # By itself, though nothing else happens.
        console.wait_for(lambda: cues(console) == ["before", "stored", "not stored"])
        console.wait_for(lambda: not journal.pending(0))
    again = EventJournal(disk.folder / "events.sqlite")
    assert [event.text for event in again.pending(0) if event.kind == "cue"] == []
    again.close()
