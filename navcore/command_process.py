"""A command of this program in a process of its own, which tells its progress, may be ended, and has only so long."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended."""

    code: int
    answer: str
    """The last line that it printed and that tells no progress."""
    complaint: str
    """The end of what it printed for people."""
    was_late: bool
    """It was killed because it took too long."""
    was_stopped: bool
    """Somebody has ended it."""


class CommandProcess:
    """Runs ``vbr …``; :meth:`stop` ends it from another thread, and lets no other begin."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._stopped = False

    def run(self, arguments: Sequence[str], progress: Callable[[int], None], limit_s: float | None = None) -> Ended:
        """Run a command to its end; ``progress`` is called with each percent, ``limit_s`` is the most it may take."""
        with tempfile.TemporaryFile("w+", encoding="utf-8") as complaints:
            process = self._started(arguments, complaints)
            if process is None:
                return Ended(-1, "", "", was_late=False, was_stopped=True)
            assert process.stdout is not None
            answer = ""
            with _killed_after(process, limit_s) as was_late:
                for line in process.stdout:
                    if (percent := _percent(line)) is not None:
                        progress(percent)
                    else:
                        answer = line
                code = process.wait()
            process.stdout.close()
            complaints.seek(0)
            complaint = complaints.read()[-400:].strip()
            return Ended(code, answer, complaint, was_late=was_late.is_set(), was_stopped=self._stopped)

    def stop(self) -> None:
        """End the command, and begin no other."""
        with self._lock:
            self._stopped = True
            if self._process is not None and self._process.poll() is None:
                self._process.terminate()

    def _started(self, arguments: Sequence[str], complaints: object) -> subprocess.Popen[str] | None:
        with self._lock:
            if self._stopped:
                return None
            self._process = subprocess.Popen(  # type: ignore[call-overload]  # the file is one
                [sys.executable, "-m", "device_agent", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=complaints,
                text=True,
                # Ctrl-C is the parent's alone: it ends this process itself.
                start_new_session=True,
            )
            return self._process


@contextlib.contextmanager
def _killed_after(process: subprocess.Popen[str], limit_s: float | None) -> Iterator[threading.Event]:
    """Kill a process that still runs after so long; what is yielded is set then."""
    was_late = threading.Event()

    def kill() -> None:
        was_late.set()
        process.kill()

    timer = threading.Timer(limit_s or 0.0, kill)
    timer.daemon = True
    if limit_s is not None:
        timer.start()
    try:
        yield was_late
    finally:
        timer.cancel()


def _percent(line: str) -> int | None:
    """Return the percent of a line of progress; the other lines are the answer."""
    try:
        found = json.loads(line)
    except ValueError:
        return None
    percent = found.get("percent") if isinstance(found, dict) else None
    return percent if isinstance(percent, int) else None
