"""Console and device as processes of their own, which can be killed at any moment."""

from __future__ import annotations

import os
import queue
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from console.secrets_kept import new_token
from console.store import DATABASE_FILE
from navcore.wire import Event

HERE = Path(__file__).resolve().parent
WAIT_S = 120.0


def surroundings() -> dict[str, str]:
    """Return the environment of a process that is to find this code, and the tests'."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE.parent), str(HERE)])}


@contextmanager
def quick_folder(otherwise: Path) -> Iterator[Path]:
    """Give an empty folder in memory, where there is one: kill -9 is not about disks, and these are slow."""
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="vbr-", dir=memory if os.access(memory, os.W_OK) else otherwise))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class Victim:
    """A process that is told things line by line, and tells things line by line."""

    def __init__(self, script: str, *arguments: object, within: Sequence[str] = ()) -> None:
        """``within`` is a command that runs another one, as ``ip netns exec NAME``."""
        self._process = subprocess.Popen(
            [*within, sys.executable, str(HERE / script), *map(str, arguments)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=surroundings(),
        )  # fmt: skip
        self._said: queue.Queue[str] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._said.put(line.strip())

    def tell(self, line: str) -> None:
        """Tell it something."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def says(self) -> str:
        """Return the next thing that it says."""
        return self._said.get(timeout=WAIT_S)

    def all_said(self) -> list[str]:
        """Return what it said and nobody has heard yet; for one that is dead."""
        self._reader.join()
        return list(self._said.queue)

    def ended(self, timeout_s: float = WAIT_S) -> int:
        """Wait until it has ended by itself; return its exit code."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        return self._process.wait(timeout_s)

    def kill(self) -> None:
        """Kill it as ``kill -9`` does."""
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            if pipe is self._process.stdout:
                self._reader.join()
            try:
                pipe.close()
            except BrokenPipeError:
                # What it was told last, it did not hear any more.
                continue


class ConsoleProcess:
    """A console that comes back on the same port with the same data."""

    def __init__(self, site: Path, folder: Path, host: str = "127.0.0.1", within: Sequence[str] = ()) -> None:
        self._site, self._folder, self._host, self._within = site, folder, host, within
        self._token_file = folder / "glasses.token"
        self.token = new_token()
        self._token_file.write_text(self.token, encoding="ascii")
        self.port = 0
        self.start()

    def start(self) -> None:
        """Serve; returns when requests are taken."""
        self._victim = Victim(
            "link_console_victim.py", self._site, self._folder / "data", self.port, self._token_file, self._host,
            within=self._within,
        )  # fmt: skip
        self.port = int(self._victim.says().rsplit(":", 1)[1])
        self.first_link = self._victim.says()

    def kill(self) -> None:
        """Kill it."""
        self._victim.kill()

    def stored(self) -> list[Event]:
        """Return every event in its database, in the order in which they were stored."""
        with sqlite3.connect(self._folder / "data" / DATABASE_FILE) as base:
            rows = base.execute("SELECT sequence, stamp_s, kind, text FROM device_events ORDER BY id").fetchall()
        base.close()
        return [Event(*row) for row in rows]
