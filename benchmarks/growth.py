"""Whether anything grows: what processes and folders hold, read again and again, and the line through the readings."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

WARM_UP_H = 1.0
"""Simulated; caches fill, and the allocator takes its pages. The slope is of what comes after it."""
_FIXED_EVERY_S = 0.1
_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20
_KEY_KB = "Pss:"

Reading = Mapping[str, float]
"""By the name of what was read, its unit at the end of the name."""


@dataclass(frozen=True, slots=True)
class Trend:
    """How one figure went."""

    name: str
    first: float
    """Median of the hour after the warm-up."""
    last: float
    """Median of the last hour."""
    slope_per_h: float
    """Theil–Sen: the median of the slopes between any two readings."""
    low_per_h: float
    high_per_h: float
    """Where the slope lies with 95 %."""

    @property
    def ratio(self) -> float:
        """Last to first; 1 where both are nothing."""
        return self.last / self.first if self.first else (1.0 if not self.last else float("inf"))


def trend(name: str, hours: Sequence[float], values: Sequence[float]) -> Trend:
    """Return how a figure went; ``hours`` are simulated, and rise.

    P. K. Sen, Estimates of the regression coefficient based on Kendall's tau (1968), as SciPy has it.
    """
    at_h, found = np.array(hours), np.array(values)
    warm = at_h >= min(WARM_UP_H, at_h[-1] / 4)
    at_h, found = at_h[warm], found[warm]
    first, last = found[at_h <= at_h[0] + 1.0], found[at_h > at_h[-1] - 1.0]
    if len(found) < 3 or np.ptp(found) == 0.0:
        return Trend(name, float(np.median(first)), float(np.median(last)), 0.0, 0.0, 0.0)
    slope, _, low, high = stats.theilslopes(found, at_h, 0.95)
    return Trend(name, float(np.median(first)), float(np.median(last)), float(slope), float(low), float(high))


def table(hours: Sequence[float], readings: Sequence[Reading]) -> list[str]:
    """Return a Markdown table of every figure that was read each time."""
    lines = [
        "| what | first hour | last hour | ratio | slope an hour (95 %) |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name in readings[0]:
        if all(name in reading for reading in readings):
            each = trend(name, hours, [reading[name] for reading in readings])
            interval = f"{each.slope_per_h:+.3g} ({each.low_per_h:+.3g} … {each.high_per_h:+.3g})"
            lines.append(f"| {name} | {each.first:.4g} | {each.last:.4g} | {each.ratio:.2f} | {interval} |")
    return lines


def process_reading(pid: int, whose: str) -> dict[str, float]:
    """Return what a process holds by what the kernel says of it."""
    folder = Path(f"/proc/{pid}")
    handles = [_target(path) for path in (folder / "fd").iterdir()]
    return {
        f"{whose}: resident, MB": int((folder / "statm").read_text().split()[1]) * _PAGE_MB,
        f"{whose}: its share of memory (PSS), MB": _pss_mb(folder / "smaps_rollup"),
        f"{whose}: file handles": len(handles),
        f"{whose}: of these sockets": sum(target.startswith("socket:") for target in handles),
        f"{whose}: threads": len(list((folder / "task").iterdir())),
        f"{whose}: children, zombies included": _children_count(pid),
    }


def folder_mb(folder: Path, pattern: str = "**/*") -> float:
    """Return how large the files in a folder are, all together."""
    return sum(_size_bytes(path) for path in folder.glob(pattern)) / 1e6


def _target(handle: Path) -> str:
    try:
        return os.readlink(handle)
    except FileNotFoundError:
        # Closed since the folder was listed.
        return ""


def _pss_mb(path: Path) -> float:
    lines = (line.split() for line in path.read_text().splitlines())
    return next(int(line[1]) / 1024 for line in lines if line[0] == _KEY_KB)


def _children_count(pid: int) -> int:
    return sum(len(path.read_text().split()) for path in Path(f"/proc/{pid}/task").glob("*/children"))


def _size_bytes(path: Path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except FileNotFoundError:
        return 0


class Machine:
    """How long the same computation takes meanwhile, which tells what other work takes of the machine: a context."""

    def __init__(self) -> None:
        self._taken_ms: list[float] = []
        self._values = np.random.default_rng(0).random(60_000)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._compute, daemon=True)

    def __enter__(self) -> Machine:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def reading(self) -> dict[str, float]:
        """Return what it took since this was asked last."""
        taken_ms, self._taken_ms = self._taken_ms, []
        return {
            "machine: a fixed computation, median, ms": float(np.median(taken_ms)),
            "machine: a fixed computation, p99, ms": float(np.percentile(taken_ms, 99)),
        }

    def _compute(self) -> None:
        while not self._ended.wait(_FIXED_EVERY_S):
            began_s = time.perf_counter()
            np.sort(self._values)
            self._taken_ms.append(1e3 * (time.perf_counter() - began_s))
