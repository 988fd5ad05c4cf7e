"""Building the map of a recording in a process of its own, which gives way to everything else.

Device and console both do so; the command line of this program is what does it.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from navcore.errors import MappingError


class MapBuilding:
    """Runs ``vbr map build``; :meth:`stop` ends it from another thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._stopped = False

    def build(
        self,
        walk: Path,
        site: Path,
        name: str,
        date: str,
        progress: Callable[[int], None],
        limit_s: float | None = None,
    ) -> bool:
        """Build the map of a recording into ``site``, replacing what lies there; False where it was stopped.

        ``name`` is the site's, ``date`` when it was recorded. ``progress`` is called with each percent. What is not
        built after ``limit_s`` is given up.

        Raises MappingError with what the build said where it failed, or that it took too long.
        """
        shutil.rmtree(site, ignore_errors=True)
        command = [
            sys.executable, "-m", "device_agent", "map", "build", str(walk), "--site", str(site), f"--name={name}",
            f"--date={date}", "--behind", "--json",
        ]  # fmt: skip
        with tempfile.TemporaryFile("w+", encoding="utf-8") as complaints:
            process = self._started(command, complaints)
            if process is None:
                return False
            assert process.stdout is not None
            with _killed_after(process, limit_s) as was_late:
                for line in process.stdout:
                    if (percent := _percent(line)) is not None:
                        progress(percent)
                code = process.wait()
            if self._stopped:
                return False
            if code != 0 and was_late.is_set():
                raise MappingError(
                    f"Building the map has taken more than {(limit_s or 0.0) / 3600:.3g} h and was given up:"
                    " record less at a time, or run `vbr map build` on a faster machine."
                )
            if code != 0:
                complaints.seek(0)
                raise MappingError(complaints.read()[-400:].strip() or f"The building of the map ended with {code}.")
        return True

    def _started(self, command: list[str], complaints: object) -> subprocess.Popen[str] | None:
        with self._lock:
            if self._stopped:
                return None
            self._process = subprocess.Popen(  # type: ignore[call-overload]  # the file is one
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=complaints,
                text=True,
                # Ctrl-C is the parent's alone: it ends this process itself.
                start_new_session=True,
            )
            return self._process

    def stop(self) -> None:
        """End the build, and begin no other."""
        with self._lock:
            self._stopped = True
            if self._process is not None and self._process.poll() is None:
                self._process.terminate()


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
