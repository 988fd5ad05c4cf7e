"""Files or memory that run out: it is told in a sentence, nothing else stops, and it goes on afterwards."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from console_room import Person, first_admin
from device_hall import Rig
from link_processes import surroundings
from test_recorder import Times, recorded_rig

from console.server import ConsoleServer
from console.storage_trouble import refusal_of
from device_agent.recording.options import RecordingOptions
from device_agent.recording.walk_files import RETRY_AFTER_S
from navcore import command_process
from navcore.errors import MappingError
from navcore.map_building import MapBuilding
from navcore.recording import RecordingWriter
from navcore.repeating import Repeating
from navcore.types import CameraIntrinsics
from navcore.wire import SetDestination

_LIMITED = """
import resource, sys
from navcore.errors import MappingError
from navcore.map_building import MapBuilding
# Only what is started from here on feels it: this process has all that it needs.
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]), resource.RLIM_INFINITY))
try:
    MapBuilding().build(*map(__import__("pathlib").Path, sys.argv[1:3]), "A map", "2026-11-29", lambda percent: None)
except MappingError as error:
    print(error)
"""


def test_a_map_build_that_the_system_kills_says_that_memory_ran_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the kernel does it where memory runs out, but at once."""
    started = command_process.CommandProcess._started

    def killed(self: command_process.CommandProcess, *arguments: object) -> subprocess.Popen[str] | None:
        process = started(self, *arguments)  # type: ignore[arg-type]
        assert process is not None
        process.send_signal(signal.SIGKILL)
        return process

    monkeypatch.setattr(command_process.CommandProcess, "_started", killed)
    with pytest.raises(MappingError, match="more memory than there is"):
        MapBuilding().build(tmp_path / "walk", tmp_path / "site", "A map", "", lambda percent: None)


@pytest.mark.slow
def test_a_map_build_that_gets_no_memory_says_so(tmp_path: Path) -> None:
    RecordingWriter(tmp_path / "walk", CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0)).close()
    done = subprocess.run(
        [sys.executable, "-c", _LIMITED, str(tmp_path / "walk"), str(tmp_path / "site"), str(160 << 20)],
        env=surroundings() | {"OPENBLAS_NUM_THREADS": "1"}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "more memory than there is" in done.stdout
    assert not (tmp_path / "site").exists()


@contextmanager
def no_more_files() -> Iterator[None]:
    """Let this process open nothing more."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    # The lowest number that is free is the next one that is given.
    lowest = os.open(os.devnull, os.O_RDONLY)
    os.close(lowest)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_console_without_files_refuses_in_a_sentence_and_goes_on_afterwards(server: ConsoleServer) -> None:
    admin = first_admin(server)
    before = admin.graph()
    with no_more_files():
        for _ in range(5):
            answer = admin.edit("update_poi", poi_id="b", name="Tea bar")
            assert answer.status_code in (200, 503), answer.text
        exported = admin.http.get("/api/export/road.tum")
        assert 400 <= exported.status_code < 600
        assert exported.json()["error"].endswith(".")
    assert admin.graph()["version"] in (before["version"], before["version"] + 1)
    again = Person(server.ready.url)
    assert again.sign_in("Ada").is_success
    assert again.edit("update_poi", poi_id="b", name="Coffee").is_success
    assert again.http.get("/api/export/road.tum").is_success


def test_a_device_without_files_guides_and_tells_that_nothing_is_recorded(tmp_path: Path) -> None:
    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(tmp_path / "walks", reserve_bytes=0), times)
    plain = Rig()
    for each in (rig, plain):
        each.agent.submit(SetDestination("bar"))
    # What is compiled has been read by then, as a device does it before anybody is led.
    told = [cycle.guidance for cycle in rig.cycles(5)]
    with no_more_files():
        told += [cycle.guidance for cycle in rig.cycles(5)]
        recorder.check()
    told += [cycle.guidance for cycle in rig.cycles(10)]
    times.advance(RETRY_AFTER_S)
    recorder.check()
    recorder.close()
    assert told == [cycle.guidance for cycle in plain.cycles(20)]
    assert any("not recorded any more" in text and "Too many open" in text for text in rig.events("mode"))
    assert any("Recording goes on" in text for text in rig.events("mode"))


def test_what_is_no_trouble_of_the_disk_is_told_by_others() -> None:
    assert refusal_of(ValueError()) is None
    assert refusal_of(FileNotFoundError(2, "No such file")) is None
    full, read_only, no_files = (refusal_of(OSError(number, "")) for number in (28, 30, 24))
    assert [each is not None and each.status for each in (full, read_only, no_files)] == [507, 503, 503]


def test_work_that_fails_again_and_again_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    tried = 0

    def work() -> None:
        nonlocal tried
        tried += 1
        if tried in (1, 2, 3, 5, 6):
            raise OSError("full")
        if tried == 7:
            repeating.close()

    repeating = Repeating("the work", 0.0, work)
    repeating._run()
    assert [record.levelname for record in caplog.records] == ["ERROR", "ERROR"], "once for each time it began to fail"
