"""Emulates a slower processor: a process gets only a share of one core's time, in slices of 10 ms.

The kernel does it where a cgroup can be made (v2 ``cpu.max``, v1 ``cpu.cfs_quota_us``), and gives the process that
share before all others, so that a busy machine emulates the same processor; elsewhere a child of this process stops
and continues it in turn. A share by the ratio of two clocks says nothing of what the other processor does within one
cycle of its clock: a real target of the same clock may be slower.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

PERIOD_S = 0.01
CGROUPS = Path("/sys/fs/cgroup")
_LEAST_S = 0.001
"""The kernel takes no shorter quota."""


def clock_ghz() -> float | None:
    """Return the clock of this machine's first core, as the kernel tells it; None where it does not."""
    found = re.search(r"^cpu MHz\s*:\s*([0-9.]+)", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.MULTILINE)
    return float(found[1]) / 1000.0 if found else None


@contextlib.contextmanager
def limited(fraction: float) -> Iterator[str]:
    """Give this process, with all its threads, only this share (0, 1] of a core; yield the way in which it is done."""
    if fraction >= 1.0:
        yield "no limit"
        return
    folder = _made_group(fraction)
    if folder is None:
        with _stopped_in_turn(fraction):
            yield "SIGSTOP and SIGCONT"
        return
    try:
        _put(folder / "cgroup.procs", os.getpid())
        yield f"cgroup quota of {1000 * fraction * PERIOD_S:.2f} ms in {1000 * PERIOD_S:.0f} ms"
    finally:
        _put(folder.parent / "cgroup.procs", os.getpid())
        folder.rmdir()


def measured_fraction(seconds: float = 1.0) -> float:
    """Return the share of one core that this thread gets while it wants all of it."""
    began_s, cpu_s = time.perf_counter(), time.thread_time()
    while time.perf_counter() - began_s < seconds:
        pass
    return (time.thread_time() - cpu_s) / (time.perf_counter() - began_s)


def others_fraction(core: int) -> Callable[[], float]:
    """Return what tells, when it is called, the share of a core's time that other processes have had since now."""
    began_s, core_s, own_s = time.monotonic(), _busy_s(core), time.process_time()

    def fraction() -> float:
        others_s = _busy_s(core) - core_s - (time.process_time() - own_s)
        return max(0.0, others_s / (time.monotonic() - began_s))

    return fraction


def _busy_s(core: int) -> float:
    """Return for how long a core has not been idle, to the kernel's hundredth of a second."""
    lines = Path("/proc/stat").read_text(encoding="ascii").splitlines()
    ticks = next(line.split()[1:] for line in lines if line.startswith(f"cpu{core} "))
    idle, waiting = int(ticks[3]), int(ticks[4])
    return (sum(map(int, ticks[:8])) - idle - waiting) / os.sysconf("SC_CLK_TCK")


def _made_group(fraction: float) -> Path | None:
    """Make a group with this quota; None where no group can be made."""
    quota_us, period_us = round(1e6 * max(_LEAST_S, fraction * PERIOD_S)), round(1e6 * PERIOD_S)
    for parent, lines in (
        (CGROUPS, {"cpu.max": f"{quota_us} {period_us}", "cpu.weight": "10000"}),
        (
            CGROUPS / "cpu",
            {"cpu.cfs_period_us": str(period_us), "cpu.cfs_quota_us": str(quota_us), "cpu.shares": "262144"},
        ),
    ):
        folder = parent / f"vbr-quota-{os.getpid()}"
        try:
            folder.mkdir()
        except OSError:
            continue
        try:
            for name, text in lines.items():
                # Not created: where there is no such file, the controller is not at work here.
                with (folder / name).open("r+") as file:
                    file.write(text)
        except OSError:
            folder.rmdir()
            continue
        return folder
    return None


def _put(path: Path, number: int) -> None:
    path.write_text(str(number), encoding="utf-8")


@contextlib.contextmanager
def _stopped_in_turn(fraction: float) -> Iterator[None]:
    command = [sys.executable, "-m", "benchmarks.cpu_quota", str(os.getpid()), str(fraction)]
    child = subprocess.Popen(command)
    try:
        yield
    finally:
        # It may have stopped this process a moment ago, but not itself: it continues it before it ends.
        child.terminate()
        child.wait()


def _take_turns(pid: int, fraction: float) -> None:
    """Stop and continue a process until terminated, or until it is gone or somebody else's."""
    ended = False

    def end(*_: object) -> None:
        nonlocal ended
        ended = True

    signal.signal(signal.SIGTERM, end)
    with contextlib.suppress(ProcessLookupError):
        try:
            while not ended and os.getppid() == pid:
                time.sleep(fraction * PERIOD_S)
                os.kill(pid, signal.SIGSTOP)
                time.sleep((1.0 - fraction) * PERIOD_S)
                os.kill(pid, signal.SIGCONT)
        finally:
            if os.getppid() == pid:
                os.kill(pid, signal.SIGCONT)


if __name__ == "__main__":
    _take_turns(int(sys.argv[1]), float(sys.argv[2]))
