"""Disks of a few megabytes that can be filled, and that can fail, while somebody works on them."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


class SmallDisk:
    """A disk that is mounted at a folder."""

    def __init__(self, folder: Path, device: Path | None = None) -> None:
        self.folder, self._device = folder, device
        self._zeros = folder / "zeros"

    def fill(self) -> None:
        """Leave no room at all."""
        with self._zeros.open("ab", buffering=0) as out:
            for size in (1 << 16, 1 << 12, 1):
                try:
                    while True:
                        out.write(bytes(size))
                except OSError:
                    continue

    def free(self) -> None:
        """Make room again."""
        self._zeros.unlink()

    def remount(self, how: str) -> None:
        """Make it ``ro`` or ``rw``: only where nobody has a file open for writing."""
        _run("mount", "-o", f"remount,{how}", self.folder)

    def fail(self) -> None:
        """From now on it can only be read, whoever has files open: as Linux does it after an error of the disk."""
        _run("mount", "-o", "remount,abort", self.folder)
        # It notices at the next change.
        with contextlib.suppress(OSError):
            (self.folder / "change").touch()

    def repair(self) -> None:
        """Do what an administrator does then."""
        assert self._device is not None
        _run("umount", self.folder)
        subprocess.run(["fsck.ext4", "-fy", str(self._device)], capture_output=True, check=False)
        _run("mount", "-o", "loop", self._device, self.folder)


@contextmanager
def small_disk(folder: Path, size: str = "24m") -> Iterator[SmallDisk]:
    """Mount a small disk in memory at a new folder; skips the test where nobody may mount."""
    with _mounted(folder, "-t", "tmpfs", "-o", f"size={size}", "none"):
        yield SmallDisk(folder)


@contextmanager
def failing_disk(folder: Path, size: str = "24M") -> Iterator[SmallDisk]:
    """Mount a small disk that can fail at a new folder; skips the test where nobody may mount, or nothing is looped."""
    image = folder.with_name(f"{folder.name}.image")
    made = [["truncate", "-s", size, str(image)], ["mkfs.ext4", "-q", "-F", str(image)]]
    try:
        for command in made:
            subprocess.run(command, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("there is no mkfs.ext4 here")
    with _mounted(folder, "-o", "loop", image):
        yield SmallDisk(folder, image)


@contextmanager
def _mounted(folder: Path, *how: str | Path) -> Iterator[None]:
    folder.mkdir()
    command = ["mount", *map(str, how), str(folder)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True, check=False).returncode != 0:
        pytest.skip(f"only root may mount a small disk, and not everywhere: {' '.join(command)}")
    try:
        yield
    finally:
        _run("umount", "-l", folder)


def _run(*command: str | Path) -> None:
    subprocess.run(list(map(str, command)), check=True)
