"""Kill -9 of what a device keeps, and of its recorder, at moments that a seed chooses (benchmarks/kills/device.py)."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from console_room import serving
from link_processes import quick_folder
from recording_victim import CYCLE_S

from benchmarks.kills.device import KilledDevice
from benchmarks.kills.nursery import BrokenPromiseError, Nursery
from console.tables import EventRow
from device_agent.recording.reading import RecordedPart
from device_agent.recording.walk_files import FLUSH_EVERY_S, parts_in
from navcore.site import Site, save_site

pytestmark = pytest.mark.slow
KEPT_KILLS, RECORDED_KILLS, LINKED_KILLS = 60, 6, 8


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "log"


def nursery_of(module: str, log: Path) -> Iterator[Nursery]:
    nursery = Nursery(module, log)
    yield nursery
    nursery.close()


@pytest.fixture
def keepers(log: Path) -> Iterator[Nursery]:
    yield from nursery_of("benchmarks.kills.device", log)


@pytest.fixture
def recorders(log: Path) -> Iterator[Nursery]:
    yield from nursery_of("recording_victim", log)


@pytest.fixture
def links(log: Path) -> Iterator[Nursery]:
    yield from nursery_of("link_device_victim", log)


def test_what_a_device_keeps_is_whole_after_every_kill(keepers: Nursery, tmp_path: Path) -> None:
    with quick_folder(tmp_path) as folder:
        device = KilledDevice(folder, 5, keepers)
        for _ in range(KEPT_KILLS):
            device.kill_once()
        assert device.request_count > KEPT_KILLS


def test_what_a_device_has_lost_is_found(keepers: Nursery, tmp_path: Path) -> None:
    with quick_folder(tmp_path) as folder:
        device = KilledDevice(folder, 6, keepers)
        for _ in range(5):
            device.kill_once()
        for path in (folder / "state").glob("events.sqlite*"):
            path.unlink()
        with pytest.raises(BrokenPromiseError, match="events after the kill"):
            device.kill_once()


def test_a_recording_is_whole_but_for_its_last_half_second(recorders: Nursery, tmp_path: Path) -> None:
    """By the recorder's own clock, which a test advances: a hundred cycles take a moment."""
    dice = random.Random(8)
    for number in range(RECORDED_KILLS):
        with quick_folder(tmp_path) as folder:
            victim = recorders.bear("walk", folder / "walks")
            for _ in range(dice.randrange(1, 50)):
                said = victim.says()
            time.sleep(dice.uniform(0.0, 0.02))
            said = [said, *victim.kill()][-1]
            numbers = [
                cycle.notes.number for part in parts_in(folder / "walks") for cycle in RecordedPart(part).cycles()
            ]  # fmt: skip
            assert numbers == list(range(1, len(numbers) + 1)), f"kill {number}: a gap in what was recorded"
            lost_s = (int(said) - len(numbers)) * CYCLE_S
            assert lost_s <= FLUSH_EVERY_S + 2 * CYCLE_S, f"kill {number}"


def test_every_event_that_was_kept_comes_once_though_the_device_is_killed_again_and_again(
    links: Nursery, tmp_path: Path, small_site: Site
) -> None:
    dice = random.Random(9)
    save_site(small_site, tmp_path / "site")
    with quick_folder(tmp_path) as folder, serving(tmp_path / "site", folder / "data") as server:
        token = server.services.devices.create_token("Glasses", "test")
        url = server.ready.url.replace("http", "ws")
        kept = []
        for run in range(LINKED_KILLS):
            victim = links.bear("talk", url, token, folder, run, 1_000_000)
            said = [victim.says() for _ in range(dice.randrange(1, 25))]
            time.sleep(dice.uniform(0.0, 0.03))
            kept.append(int([*said, *victim.kill()][-1]))
        last = links.bear("talk", url, token, folder, LINKED_KILLS, 1)
        while last.says() != "all confirmed":
            continue
        last.kill()
        with server.services.store.reading() as session:
            rows = session.query(EventRow).filter(EventRow.kind == "cue").order_by(EventRow.id).all()
            every = session.query(EventRow).order_by(EventRow.id).all()
    assert [row.sequence for row in every] == list(range(1, len(every) + 1))
    told = [tuple(map(int, row.text.split())) for row in rows]
    for run, count in enumerate(kept):
        mine = [number for each, number in told if each == run]
        assert mine == list(range(len(mine))), f"run {run}: missing, twice or out of order"
        assert len(mine) >= count, f"run {run}: lost what was kept"
    assert [run for run, _ in told] == sorted(run for run, _ in told)
