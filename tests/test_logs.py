"""Logs: JSON lines, bounded, whole; a disk that is full costs lines, never guidance."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from device_hall import Rig
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.cli import main
from device_agent.demo_processes import _process, _tell_log
from device_agent.logged_uplink import LoggedUplink
from device_agent.logs import JsonLinesHandler, RotatedLines, json_line, log_files, readable_line
from navcore.types import Action

LOG = logging.getLogger("device_agent.test_logs")


def lines_of(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def record(text: str, **extra: object) -> logging.LogRecord:
    return logging.makeLogRecord({"name": "device_agent.x", "levelname": "WARNING", "msg": text, **extra})


@settings(deadline=None)
@given(text=st.text(), extra=st.one_of(st.text(), st.floats(), st.none(), st.binary()))
def test_whatever_is_logged_is_one_line_of_json(text: str, extra: object) -> None:
    line = json_line(record(text.replace("%", "%%"), stamp=extra, args=()))
    assert "\n" not in line
    assert json.loads(line)["level"] == "WARNING"
    assert "WARNING" in readable_line(line)
    assert readable_line(line).isprintable(), "nothing that is logged tells a terminal what to do"


def test_a_line_has_time_level_thread_traceback_and_what_the_caller_gave(tmp_path: Path) -> None:
    with log_files(tmp_path / "logs") as path:
        LOG.warning("%s failed", "camera", extra={"kind": "sensor", "stamp_s": 1.5})
        try:
            raise ValueError("a reason")
        except ValueError:
            LOG.exception("it went wrong")
    first, second = lines_of(path)
    assert (first["text"], first["kind"], first["stamp_s"], first["thread"]) == (
        "camera failed", "sensor", 1.5, threading.current_thread().name,
    )  # fmt: skip
    assert str(first["time"]).endswith("Z")
    assert "ValueError: a reason" in str(second["error"])
    assert "camera failed kind=sensor" in readable_line(json.dumps(first))


def test_rotation_keeps_the_newest_lines_and_never_more_than_the_bound(tmp_path: Path) -> None:
    lines = RotatedLines(tmp_path / "device.jsonl", max_bytes=1000, max_files=3)
    for number in range(500):
        lines.write(f"{number:05d} " + "x" * (number % 90))
        assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 3000
    kept = [line for path in lines.paths() for line in path.read_text().splitlines()]
    numbers = [int(line[:5]) for line in kept]
    assert numbers == list(range(500 - len(numbers), 500))
    assert len(numbers) > 20
    assert len(list(tmp_path.iterdir())) == 3


def test_a_full_disk_costs_lines_and_says_later_how_many(tmp_path: Path) -> None:
    path = tmp_path / "device.jsonl"
    path.symlink_to("/dev/full")
    handler = JsonLinesHandler(RotatedLines(path))
    for number in range(5):
        handler.emit(record(f"line {number}"))
    handler.flush()
    path.unlink()
    handler.emit(record("the disk has room again"))
    handler.close()
    told, line = lines_of(path)
    assert str(told["text"]).startswith("5 lines before this one could not be written")
    assert line["text"] == "the disk has room again"


def test_a_disk_that_hangs_holds_up_nobody(tmp_path: Path) -> None:
    """A FIFO that nobody reads: opening it blocks, as a dead network disk would."""
    path = tmp_path / "device.jsonl"
    import os

    os.mkfifo(path)
    handler = JsonLinesHandler(RotatedLines(path), max_waiting=10)
    finished = threading.Event()

    def log_much() -> None:
        for number in range(1000):
            handler.emit(record(f"line {number}"))
        finished.set()

    threading.Thread(target=log_much, daemon=True).start()
    assert finished.wait(10.0)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    handler.close()
    os.close(reader)


def test_guidance_goes_on_while_the_log_has_no_disk(tmp_path: Path) -> None:
    (tmp_path / "logs").symlink_to("/dev/full")
    with log_files(tmp_path / "logs"):
        rig = Rig()
        for _ in range(3):
            LoggedUplink(rig.uplink).event(1.0, "sensor", "told")
        assert rig.lead_to().guidance.action is Action.WALK
    assert rig.events("sensor")[:3] == ["told"] * 3


@pytest.mark.parametrize("terminal", [True, False])
def test_nothing_is_shown_between_the_keys_of_a_terminal_and_all_of_it_is_kept(terminal: bool, tmp_path: Path) -> None:
    script = (
        "import logging, sys; from pathlib import Path; from device_agent import logs\n"
        "logs.log_to_stderr(False); log = logging.getLogger('device_agent.test')\n"
        "log.warning('before')\n"
        "with logs.log_files(Path(sys.argv[1])), logs.off_the_terminal():\n    log.warning('within')\n"
        "log.warning('after')\n"
    )
    ours, theirs = os.openpty() if terminal else os.pipe()
    done = subprocess.run([sys.executable, "-c", script, str(tmp_path)], stderr=theirs, timeout=60, check=True)
    shown = os.read(ours, 10_000).decode()
    os.close(theirs)
    os.close(ours)
    assert done.returncode == 0
    assert [word for word in ("before", "within", "after") if word in shown] == [
        "before", *([] if terminal else ["within"]), "after"
    ]  # fmt: skip
    assert "within" in (tmp_path / "device.jsonl").read_text()


def test_the_command_shows_the_last_lines_for_people_and_for_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["logs", "--state", str(tmp_path)]) == 2
    assert "There is no log" in capsys.readouterr().err
    with log_files(tmp_path / "logs") as path:
        for number in range(5):
            LOG.warning("line %d", number)
    with path.open("a") as file:
        file.write("half a li")
    assert main(["logs", "--state", str(tmp_path), "--lines", "3"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert [line.rpartition(": ")[2] for line in shown] == ["line 3", "line 4", "half a li"]
    assert main(["logs", "--state", str(tmp_path), "--lines", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[0])["text"] == "line 4"


def test_what_a_process_of_the_demo_had_to_say_is_shown_once_it_has_failed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with (tmp_path / "console.log").open("wb") as log:
        with _process(["console", "--site", str(tmp_path / "gone")], quiet=True, log=log) as process:
            assert process.wait(60.0) == 2
        assert capfd.readouterr().err == "", "not between the keys"
        _tell_log(log)
    assert "There is no site at" in capfd.readouterr().err
