"""A process that has imported everything, and forks victims: a start costs a tenth of a second instead of three.

``python -m benchmarks.kills.nursery`` takes a line of JSON for each victim (``{"role": …, "arguments": […]}``), says
``born PID``, and then passes on what the victim says, line by line.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import select
import signal
import subprocess
import sys
import threading
import traceback
from collections import deque
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parents[2]
WAIT_S = 60.0
_NOBODY, _DEAD = "nobody", "dead"


class BrokenPromiseError(AssertionError):
    """Something that must hold after a kill does not."""


def must(holds: object, sentence: str, *values: object) -> None:
    """Raise BrokenPromiseError where something does not hold."""
    if not holds:
        raise BrokenPromiseError(f"{sentence} {' | '.join(map(repr, values))}")


class Nursery:
    """Where victims come from, one at a time. ``log`` takes what they complain of."""

    def __init__(self, module: str, log: Path) -> None:
        """``module`` is imported before anybody is born; its ``ROLES`` say what a victim does."""
        self._log = log.open("ab")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.kills.nursery", module],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True, cwd=ROOT,
            env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        self._changed = threading.Condition()
        self._said: deque[str] = deque()
        self._ended = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def bear(self, role: str, *arguments: object) -> Victim:
        """Return a new victim."""
        pid, _ = self._born(role, *arguments)
        return Victim(self, pid)

    def said_by_the_dead(self) -> list[str]:
        """Return what an earlier victim said that nobody has taken: it is in the pipe, before what comes now."""
        _, said = self._born(_NOBODY)
        return said

    def _born(self, role: str, *arguments: object) -> tuple[int, list[str]]:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"role": role, "arguments": [str(each) for each in arguments]}) + "\n")
        self._process.stdin.flush()
        earlier = []
        while not (line := self._next()).startswith("born "):
            earlier.append(line)
        return int(line.split()[1]), earlier

    def says(self) -> str:
        """Return the next line that a victim says."""
        line = self._next()
        must(line != _DEAD, "the victim ended by itself: see the log")
        return line

    def _next(self) -> str:
        with self._changed:
            if not self._changed.wait_for(lambda: self._said or self._ended, WAIT_S) or not self._said:
                raise AssertionError("nothing is said: see the log")
            return self._said.popleft()

    def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        self._reader.join()
        self._log.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._changed:
                self._said.append(line.strip())
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()


class Victim:
    """A process that is there to be killed."""

    def __init__(self, nursery: Nursery, pid: int) -> None:
        self._nursery = nursery
        self._handle = os.pidfd_open(pid)

    def says(self) -> str:
        """Return the next line that it says."""
        return self._nursery.says()

    def kill(self) -> list[str]:
        """Kill it as ``kill -9`` does; return what it had said that nobody has taken."""
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._handle, signal.SIGKILL)
        self.wait()
        return self._nursery.said_by_the_dead()

    def wait(self) -> None:
        """Return when it is dead."""
        poller = select.poll()
        poller.register(self._handle, select.POLLIN)
        assert poller.poll(WAIT_S * 1000.0), "it does not die"
        os.close(self._handle)


def say(line: str) -> None:
    """Tell whoever waits, from a victim."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _raise_children(orders: IO[str], module: str) -> None:
    roles = importlib.import_module(module).ROLES
    # Nobody has to be buried by hand.
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    for line in orders:
        order = json.loads(line)
        if order["role"] == _NOBODY:
            say("born 0")
            continue
        pid = os.fork()
        if pid == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            say(f"born {os.getpid()}")
            try:
                roles[order["role"]](*order["arguments"])
            except BaseException:
                traceback.print_exc()
            say(_DEAD)
            os._exit(0)


if __name__ == "__main__":
    _raise_children(sys.stdin, sys.argv[1])
