"""Recordings on their way to the console: behind every event, one at a time, and one that cannot go stops no other."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np
import pytest
from console_room import first_admin
from device_console import Console
from recorded_walk import STORED_WALK
from test_device_link import Device, make_link

from console.recordings import RESERVE_BYTES
from console.server import ConsoleServer
from device_agent.journal import EventJournal
from device_agent.link_settings import LinkSettings
from device_agent.map_download import MapSource
from device_agent.map_walk.walk_folder import (
    CHECKSUMS_FILE,
    STATE_FILE,
    WalkState,
    new_walk,
    read_state,
    write_checksums,
    write_state,
)
from device_agent.recording.settled import SENT_FILE
from device_agent.recording_queues import WalkQueue
from device_agent.recording_upload import InterruptedUploadError, send_recording
from device_agent.recording_uploads import RecordingUploads
from device_agent.state import MapWalkTold
from navcore.errors import VbrError
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import PIECE_BYTES, RecordingOffer

DEADLINE_S = 60.0


@pytest.fixture
def source(server: ConsoleServer) -> MapSource:
    token = first_admin(server).http.post("/api/tokens", json={"name": "Glasses"}).raise_for_status().json()["token"]
    return MapSource(server.ready.url.replace("http", "ws", 1), str(token))


def waiting_walk(folder: Path, name: str = "1.png", size_bytes: int = 3 * PIECE_BYTES) -> Path:
    walk = new_walk(folder, "2026-11-29")
    (walk / name).write_bytes(np.random.default_rng(size_bytes).bytes(size_bytes))
    write_state(walk, WalkState("handed_over", "2026-11-29"))
    return walk


def offer_of(archive: RecordingArchive) -> RecordingOffer:
    return RecordingOffer("recording", "walk-0001", archive.size_bytes, archive.sha256())


def test_no_piece_goes_while_something_more_urgent_waits(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    archive = RecordingArchive(waiting_walk(tmp_path / "walks"), {STATE_FILE})
    sent: list[int] = []

    async def run() -> None:
        quiet, asked = asyncio.Event(), asyncio.Event()

        async def until_quiet() -> None:
            asked.set()
            await quiet.wait()

        sending = asyncio.create_task(
            send_recording(archive, offer_of(archive), source, until_quiet, lambda count, _: sent.append(count))
        )
        await asked.wait()
        assert server.services.recordings.all() == (), "not even the offer"
        quiet.set()
        while len(sent) < 2:
            await asyncio.sleep(0.001)  # until a piece has gone; what follows waits for nothing but its turn
        quiet.clear()
        asked.clear()
        await asked.wait()
        here = server.services.recordings.all()[0].have_bytes
        assert 0 < here < archive.size_bytes
        quiet.set()
        await sending

    asyncio.run(asyncio.wait_for(run(), DEADLINE_S))
    assert server.services.recordings.all()[0].complete
    assert sent[-1] == archive.size_bytes


def test_nothing_is_quiet_before_the_console_is_there_and_has_confirmed_every_event(tmp_path: Path) -> None:
    console, journal = Console(), EventJournal(tmp_path / "events.sqlite")
    console.confirms = False
    console.start()
    link = make_link(f"ws://127.0.0.1:{console.port}", journal, tmp_path)
    try:
        link.start(Device())  # type: ignore[arg-type]
        link.event(1.0, "cue", "urgent")
        console.wait_for(lambda: any(event.text == "urgent" for event in console.stored))
        quiet = asyncio.run_coroutine_threadsafe(link._until_quiet(), link._loop)
        with pytest.raises(TimeoutError):
            quiet.result(0.5)
        # Once it confirms, the next event's confirmation is that of all before.
        console.confirms = True
        link.event(2.0, "cue", "also urgent")
        asyncio.run_coroutine_threadsafe(link._until_quiet(), link._loop).result(DEADLINE_S)
        assert journal.pending(0) == []
    finally:
        link.stop()
        journal.close()
        console.close()


async def at_once(seconds: float = 0.0) -> None:
    await asyncio.sleep(0)


def uploads_of(
    source: MapSource, folder: Path, until_quiet: Callable[[], Awaitable[None]], tell: Callable[[MapWalkTold], None]
) -> RecordingUploads:
    settings = LinkSettings(source.console_url, source.token, folder / "incoming", map_walks=folder)
    return RecordingUploads(settings, asyncio.Event(), until_quiet, lambda failures: 0.0, at_once, tell, bool)


def uploaded(source: MapSource, folder: Path, count: int) -> list[str]:
    """Let the uploads run until so many sentences were told; return their keys."""
    told: list[str] = []

    async def run() -> None:
        done = asyncio.Event()

        def tell(each: MapWalkTold) -> None:
            told.append(each.phrases[0].key)
            if len(told) == count:
                done.set()

        running = asyncio.create_task(uploads_of(source, folder, at_once, tell).run())
        await done.wait()
        running.cancel()

    asyncio.run(asyncio.wait_for(run(), DEADLINE_S))
    return told


def test_one_that_cannot_be_sent_says_so_and_stops_no_other(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    unfit = waiting_walk(tmp_path / "walks", "Grüße.png", 10)
    fit = waiting_walk(tmp_path / "walks")
    built = waiting_walk(tmp_path / "walks")
    write_state(built, WalkState("built"))
    assert uploaded(source, tmp_path / "walks", 2) == ["map_not_sent", "map_sent"]
    assert read_state(unfit).stage == "failed"
    assert "plain name" in read_state(unfit).reason
    assert (unfit / "Grüße.png").exists(), "it is kept"
    assert read_state(fit).stage == "sent"
    assert read_state(built).stage == "built", "what was built here stays here"
    (there,) = server.services.recordings.all()
    assert (there.entry.offer.name, there.entry.offer.date, there.entry.device) == (fit.name, "2026-11-29", "Glasses")


MORE_THAN_THERE_IS_BYTES = 1 << 50
"""Of memory, for the stack of a thread: the system starts none."""


@pytest.mark.parametrize("asked_count", [0, 1, 2, 4])
def test_where_no_thread_starts_it_is_told_and_the_recording_goes_later(
    server: ConsoleServer, source: MapSource, tmp_path: Path, caplog: pytest.LogCaptureFixture, asked_count: int
) -> None:
    """At its start, before a recording is opened, while its checksum is made, and while it is sent."""
    walk = waiting_walk(tmp_path / "walks")
    asked, pauses = 0, list[float]()
    told, usual_bytes = list[str](), threading.stack_size()

    async def run() -> None:
        done = asyncio.Event()

        def run_out() -> None:
            threading.stack_size(MORE_THAN_THERE_IS_BYTES)
            # As if each thread that there is had other work.
            asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor())

        async def until_quiet() -> None:
            nonlocal asked
            asked += 1
            if asked == asked_count:
                run_out()

        async def wait(seconds: float) -> None:
            pauses.append(seconds)
            assert read_state(walk).stage == "handed_over", "it is not given up"
            threading.stack_size(usual_bytes)

        def tell(each: MapWalkTold) -> None:
            told.append(each.phrases[0].key)
            done.set()

        settings = LinkSettings(source.console_url, source.token, tmp_path / "incoming", map_walks=walk.parent)
        uploads = RecordingUploads(settings, asyncio.Event(), until_quiet, float, wait, tell, bool)
        if asked_count == 0:
            run_out()
        running = asyncio.create_task(uploads.run())
        await done.wait()
        running.cancel()

    try:
        asyncio.run(asyncio.wait_for(run(), DEADLINE_S))
    finally:
        threading.stack_size(usual_bytes)
    assert (told, pauses) == (["map_sent"], [1.0])
    (said,) = (record.message for record in caplog.records if "no recording is sent for now" in record.message)
    assert "(can't start new thread): they wait here" in said
    (there,) = server.services.recordings.all()
    assert there.complete


KILLED_BEFORE_THE_RENAME = """
import os, signal, sys
from pathlib import Path
from device_agent.map_walk.walk_folder import WalkState, write_checksums, write_state
walk = Path(sys.argv[1])
sys.addaudithook(lambda event, _: event == "os.rename" and os.kill(os.getpid(), signal.SIGKILL))
"""


def test_what_a_killed_device_had_begun_to_write_is_no_part_of_the_recording(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    walk = waiting_walk(tmp_path / "walks", size_bytes=10)
    for last in ("write_checksums(walk)", "write_state(walk, WalkState('sent'))"):
        victim = [sys.executable, "-c", KILLED_BEFORE_THE_RENAME + last, str(walk)]
        assert subprocess.run(victim, timeout=DEADLINE_S, check=False).returncode == -signal.SIGKILL
    left = {path.name.partition("-")[0] for path in walk.iterdir() if path.name.startswith(".")}
    assert left == {f".{STATE_FILE}", f".{CHECKSUMS_FILE}"}
    write_checksums(walk)
    assert [line.split()[1] for line in (walk / CHECKSUMS_FILE).read_text().splitlines()] == ["1.png"]
    assert uploaded(source, tmp_path / "walks", 1) == ["map_sent"]
    assert read_state(walk) == WalkState("sent", "2026-11-29")
    (there,) = server.services.recordings.all()
    assert there.complete


def test_a_console_that_is_away_or_refuses_is_told_apart(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    archive = RecordingArchive(waiting_walk(tmp_path / "walks"), {STATE_FILE})

    def send(to: MapSource, offer: RecordingOffer) -> None:
        asyncio.run(send_recording(archive, offer, to, at_once))

    with pytest.raises(InterruptedUploadError, match="token is not valid"):
        send(MapSource(source.console_url, "another-token"), offer_of(archive))
    with pytest.raises(InterruptedUploadError, match="not gone whole yet"):
        send(MapSource("ws://127.0.0.1:9", source.token), offer_of(archive))
    with pytest.raises(VbrError, match="is empty") as refused:
        send(source, RecordingOffer("recording", "walk", 0, offer_of(archive).sha256))
    assert not isinstance(refused.value, InterruptedUploadError)


@pytest.mark.parametrize("size_bytes", [1000, 3 * PIECE_BYTES], ids=["one piece", "several pieces"])
def test_what_never_comes_as_it_was_offered_is_not_begun_for_ever(
    source: MapSource, tmp_path: Path, size_bytes: int
) -> None:
    archive = RecordingArchive(waiting_walk(tmp_path / "walks", size_bytes=size_bytes), {STATE_FILE})
    wrong = RecordingOffer("recording", "walk", archive.size_bytes, "0" * 64)
    with pytest.raises(VbrError, match="damaged again and again"):
        asyncio.run(asyncio.wait_for(send_recording(archive, wrong, source, at_once), DEADLINE_S))


def test_one_that_has_no_room_lets_the_next_go_and_has_its_turn_again(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    large = waiting_walk(tmp_path / "walks")
    small = waiting_walk(tmp_path / "walks", size_bytes=10)

    def free_bytes(folder: Path) -> int:
        return RESERVE_BYTES + (4096 if read_state(small).stage == "handed_over" else 4 * PIECE_BYTES)

    server.services.recordings._free_bytes = free_bytes
    assert uploaded(source, tmp_path / "walks", 2) == ["map_sent", "map_sent"]
    assert (read_state(small).stage, read_state(large).stage) == ("sent", "sent")


def test_what_the_console_has_lost_meanwhile_is_offered_anew(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    archive = RecordingArchive(waiting_walk(tmp_path / "walks"), {STATE_FILE})
    description = tmp_path / "data" / "recordings" / f"{archive.sha256()}.json"

    def lose(sent_bytes: int, size_bytes: int) -> None:
        if sent_bytes:
            description.unlink()

    with pytest.raises(InterruptedUploadError, match="offer it first"):
        asyncio.run(send_recording(archive, offer_of(archive), source, at_once, lose))
    asyncio.run(send_recording(archive, offer_of(archive), source, at_once))
    assert server.services.recordings.all()[0].complete


def test_nothing_of_a_recording_is_read_before_it_is_quiet_and_its_reading_ends_with_the_link(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    walk = waiting_walk(tmp_path / "walks", size_bytes=20 * PIECE_BYTES)

    async def run() -> None:
        quiet, asked = asyncio.Semaphore(0), asyncio.Semaphore(0)

        async def until_quiet() -> None:
            asked.release()
            await quiet.acquire()

        running = asyncio.create_task(uploads_of(source, tmp_path / "walks", until_quiet, lambda told: None).run())
        await asked.acquire()
        for _ in range(3):
            quiet.release()
            await asked.acquire()
        assert server.services.recordings.all() == (), "it is being read, piece by piece, for its checksum"
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running

    asyncio.run(asyncio.wait_for(run(), DEADLINE_S))
    assert read_state(walk).stage == "handed_over", "it is offered at the next start"


# ---------------------------------------------------------------------------------------------------------- walks
def walk_uploads(
    source: MapSource, folder: Path, is_shared: Callable[[], bool], written: Path | None = None
) -> RecordingUploads:
    settings = LinkSettings(source.console_url, source.token, folder / "incoming", walks=folder)
    return RecordingUploads(
        settings,
        asyncio.Event(),
        at_once,
        lambda failures: 0.0,
        at_once,
        lambda told: None,
        is_shared,
        lambda: written,
    )


def sent_walks(source: MapSource, folder: Path, until: Callable[[], bool], written: Path | None = None) -> None:
    """Let the uploads of recorded walks run until something is so."""

    async def run() -> None:
        running = asyncio.create_task(walk_uploads(source, folder, lambda: True, written).run())
        while not until():
            await asyncio.sleep(0.005)  # until the file that says so is there; it is given up after the deadline
        running.cancel()

    asyncio.run(asyncio.wait_for(run(), DEADLINE_S))


def noted(folder: Path) -> dict[str, dict[str, str]]:
    try:
        return msgspec.json.decode((folder / SENT_FILE).read_bytes(), type=dict[str, dict[str, str]])
    except FileNotFoundError:
        return {}


def test_walks_go_to_the_console_by_themselves_once_and_stay_on_the_device(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    """A whole one, one that a crash has cut, and one that is being written: that waits until it is complete.

    It began before the device knew the time, so that its name is the first of all.
    """
    folder, walk = tmp_path / "walks", STORED_WALK.read_bytes()
    folder.mkdir()
    whole, cut = (folder / f"20261129T1147{second}Z-glasses-001.mcap" for second in ("18", "30"))
    written = folder / "19700101T000010Z-glasses-001.mcap"
    assert WalkQueue(folder, lambda: True).waiting() == (), "nothing is there yet"
    whole.write_bytes(walk)
    cut.write_bytes(walk[: len(walk) // 2])
    written.write_bytes(walk[:-100])
    assert WalkQueue(folder, lambda: True, lambda: written).waiting() == (whole, cut)
    sent_walks(source, folder, lambda: len(noted(folder)) == 2, written)
    there = {stored.entry.offer.name: stored for stored in server.services.recordings.all()}
    assert set(there) == {whole.stem, cut.stem}
    assert all(stored.complete and stored.entry.offer.kind == "walk" for stored in there.values())
    assert there[whole.stem].entry.offer.date == "2026-12-01"
    assert there[whole.stem].file.read_bytes() == walk
    assert WalkQueue(folder, lambda: True, lambda: written).waiting() == (), (
        "nothing is sent twice, at no later start either"
    )
    written.write_bytes(walk)
    assert WalkQueue(folder, lambda: True).waiting() == (written,)
    assert sorted(path.name for path in folder.glob("*.mcap")) == [written.name, whole.name, cut.name]
    (folder / SENT_FILE).write_bytes(b"\xff{")
    assert WalkQueue(folder, lambda: True).waiting() == (written, whole, cut), "the console says at once what it has"


def test_a_walk_that_is_no_longer_shared_stops_where_it_is_and_goes_on_when_it_is_again(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    folder = tmp_path / "walks"
    folder.mkdir()
    walk = STORED_WALK.read_bytes()
    assert len(walk) > 3 * PIECE_BYTES
    for second, data in ((18, walk[: len(walk) // 2]), (30, walk)):
        (folder / f"20261129T1147{second}Z-glasses-001.mcap").write_bytes(data)
    recordings, is_shared = server.services.recordings, [True]

    def shared_until_a_piece_has_gone() -> bool:
        is_shared[0] = is_shared[0] and not any(stored.have_bytes for stored in recordings.all())
        return is_shared[0]

    uploads = walk_uploads(source, folder, shared_until_a_piece_has_gone)
    (queue,) = uploads._queues
    assert asyncio.run(asyncio.wait_for(uploads._sent_all(queue), DEADLINE_S))
    (begun,) = recordings.all()
    assert (begun.complete, begun.have_bytes) == (False, PIECE_BYTES)
    assert noted(folder) == {}, "neither sent nor given up"
    sent_walks(source, folder, lambda: len(noted(folder)) == 2)
    assert [stored.complete for stored in recordings.all()] == [True, True]


def test_a_walk_that_the_console_refuses_is_noted_with_the_reason_and_stops_no_other(
    server: ConsoleServer, source: MapSource, tmp_path: Path
) -> None:
    folder = tmp_path / "walks"
    folder.mkdir()
    paths = [folder / f"20261129T1147{second}Z-glasses-001.mcap" for second in ("18", "30")]
    for path in paths:
        path.write_bytes(STORED_WALK.read_bytes())
    settle = WalkQueue(folder, lambda: True).settle
    settle(paths[0], "The disk is on fire.")
    settle(folder / "20200101T000000Z-glasses-001.mcap", "")
    assert set(noted(folder)) == {paths[0].name, "20200101T000000Z-glasses-001.mcap"}
    sent_walks(source, folder, lambda: paths[1].name in noted(folder))
    assert noted(folder) == {paths[0].name: {"failure": "The disk is on fire."}, paths[1].name: {"failure": ""}}
    (there,) = server.services.recordings.all()
    assert there.entry.offer.name == paths[1].stem
