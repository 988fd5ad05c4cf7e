"""Logging, set up in one place: readable on stderr, JSON lines in files that are rotated and never grow beyond bounds.

Guidance never waits for a log. A line is handed to a thread of its own; where the disk is full, slow or gone, lines are
counted as lost, and the first line that can be written again says how many. A file holds whole lines only: what could
not be written to its end is taken back.

A line: ``{"time": "2026-01-31T12:00:00.123Z", "level": "WARNING", "logger": …, "thread": …, "text": …}``, with
``error`` (a traceback) where there is one, and whatever the caller gave as ``extra``.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import queue
import sys
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from device_agent.plain_text import plain

PACKAGES = ("navcore", "device_agent", "console")
"""Whose logs are of interest; a compiler's would drown them, and slow everything down."""
FILE_NAME = "device.jsonl"
MAX_FILE_BYTES, MAX_FILES = 2 << 20, 8
"""At most 16 MiB on disk."""
MAX_WAITING_LINES = 2000
_MAX_TEXT = 8000
_CLOSED_WITHIN_S = 2.0
_OWN_FIELDS = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName"}


def log_to_stderr(debug: bool) -> None:
    """Show warnings, and with ``debug`` everything of ours, on stderr, for people."""
    root = logging.getLogger()
    if not root.handlers:
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        handler.setLevel(logging.DEBUG if debug else logging.WARNING)
        root.addHandler(handler)
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.DEBUG if debug else logging.INFO)


@contextlib.contextmanager
def log_files(folder: Path) -> Iterator[Path]:
    """Write what is logged inside to ``device.jsonl`` in a folder as well; return its path. Never raises."""
    handler = JsonLinesHandler(RotatedLines(folder / FILE_NAME))
    logging.getLogger().addHandler(handler)
    try:
        yield folder / FILE_NAME
    finally:
        logging.getLogger().removeHandler(handler)
        handler.close()


@contextlib.contextmanager
def off_the_terminal() -> Iterator[None]:
    """Show nothing that is logged inside on stderr where that is a terminal: somebody presses keys and reads there."""
    root = logging.getLogger()
    shown = [each for each in root.handlers if isinstance(each, logging.StreamHandler) and each.stream.isatty()]
    for handler in shown:
        root.removeHandler(handler)
    try:
        yield
    finally:
        for handler in shown:
            root.addHandler(handler)


def json_line(record: logging.LogRecord) -> str:
    """Return a log record as one line of JSON."""
    stamp = datetime.fromtimestamp(record.created, UTC)
    line: dict[str, Any] = {
        "time": stamp.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        "level": record.levelname,
        "logger": record.name,
        "thread": record.threadName,
        "text": record.getMessage()[:_MAX_TEXT],
    }
    if record.exc_info:
        # The end of a traceback says what was raised.
        line["error"] = logging.Formatter().formatException(record.exc_info)[-_MAX_TEXT:]
    for name, value in vars(record).items():
        if name not in _OWN_FIELDS and name not in line:
            line[name] = _plain(value)
    return json.dumps(line, ensure_ascii=False)


def _plain(value: object) -> object:
    """Return what JSON can hold of a value."""
    if value is None or isinstance(value, (bool, int)) or (isinstance(value, float) and math.isfinite(value)):
        return value
    return str(value)[:_MAX_TEXT]


def readable_line(line: str) -> str:
    """Return a line of a log file for people; one that is no line of ours as it is."""
    try:
        entry = json.loads(line)
        time, level, text = entry.pop("time"), entry.pop("level"), entry.pop("text")
        logger, error = entry.pop("logger"), entry.pop("error", "")
        entry.pop("thread", None)
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError):
        return plain(line)
    rest = "".join(f" {name}={value}" for name, value in entry.items())
    traceback = "".join(f"\n{plain(each)}" for each in str(error).splitlines())
    return plain(f"{time} {level:<7} {logger}: {text}{rest}") + traceback


class RotatedLines:
    """A file of lines; when it is full it becomes ``NAME.1.jsonl``, that one ``NAME.2.jsonl``, and the oldest goes."""

    def __init__(self, path: Path, max_bytes: int = MAX_FILE_BYTES, max_files: int = MAX_FILES) -> None:
        self.path = path
        self._max_bytes, self._max_files = max_bytes, max_files
        self._file: int | None = None

    def write(self, line: str) -> None:
        """Write a line, whole or not at all. Raises OSError."""
        data = line.encode("utf-8", "backslashreplace") + b"\n"
        size = os.fstat(self._opened()).st_size
        if size > 0 and size + len(data) > self._max_bytes:
            self._rotate()
            size = os.fstat(self._opened()).st_size
        self._append(data, size)

    def close(self) -> None:
        """Close the file; the next line opens it again."""
        if self._file is not None:
            with contextlib.suppress(OSError):
                os.close(self._file)
            self._file = None

    def paths(self) -> list[Path]:
        """Return the files that there are, oldest first."""
        return [
            path
            for path in (*reversed([self._older(n) for n in range(1, self._max_files)]), self.path)
            if path.exists()
        ]

    def _opened(self) -> int:
        if self._file is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o640)
        return self._file

    def _append(self, data: bytes, size: int) -> None:
        file = self._opened()
        try:
            written = os.write(file, data)
            if written < len(data):
                raise OSError(f"only {written} of {len(data)} bytes were written")
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(file, size)
            # Another disk may be there by the next line.
            self.close()
            raise

    def _rotate(self) -> None:
        self.close()
        for number in range(self._max_files - 1, 0, -1):
            newer = self._older(number - 1) if number > 1 else self.path
            with contextlib.suppress(FileNotFoundError):
                os.replace(newer, self._older(number))

    def _older(self, number: int) -> Path:
        return self.path.with_suffix(f".{number}{self.path.suffix}")


class JsonLinesHandler(logging.Handler):
    """Hands lines to a thread that writes them; whoever logs never waits, and never hears of a disk."""

    def __init__(self, lines: RotatedLines, max_waiting: int = MAX_WAITING_LINES) -> None:
        super().__init__()
        self._lines = lines
        self._waiting: queue.Queue[str | threading.Event | None] = queue.Queue(max_waiting)
        self._lost_count = 0
        self._lost_lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Hand over a record. Raises nothing."""
        try:
            self._waiting.put_nowait(json_line(record))
        except Exception:
            # A full queue, or a value that cannot even be told of: a log must not stop what it tells about.
            self._lose()

    def flush(self) -> None:
        """Return when what was handed over before has been written, or lost; at most two seconds later."""
        done = threading.Event()
        with contextlib.suppress(queue.Full):
            self._waiting.put(done, timeout=_CLOSED_WITHIN_S)
            done.wait(_CLOSED_WITHIN_S)

    def close(self) -> None:
        """Write what waits, and end the thread; a disk that hangs is not waited for."""
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=_CLOSED_WITHIN_S)
        self._thread.join(_CLOSED_WITHIN_S)
        super().close()

    def _lose(self) -> None:
        with self._lost_lock:
            self._lost_count += 1

    def _run(self) -> None:
        while (item := self._waiting.get()) is not None:
            if isinstance(item, threading.Event):
                item.set()
                continue
            try:
                self._tell_of_lost()
                self._lines.write(item)
            except OSError:
                self._lose()
        self._lines.close()

    def _tell_of_lost(self) -> None:
        with self._lost_lock:
            lost_count = self._lost_count
        if lost_count == 0:
            return
        text = f"{lost_count} lines before this one could not be written: the disk was full, slow or gone."
        record = logging.LogRecord(__name__, logging.WARNING, __file__, 0, text, None, None)
        self._lines.write(json_line(record))
        with self._lost_lock:
            self._lost_count -= lost_count
