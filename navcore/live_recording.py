"""A recording that is written as it goes, in the layout of :mod:`navcore.recording`: whole whenever it breaks off.

A frame's pictures are complete before a line names them, and each line is handed to the operating system in one piece:
who kills the process loses the frame that was being written. A power cut may lose more of the end;
:func:`mend_recording` cuts off what is incomplete.

Beside the usual tables, ``coverage.txt`` (``t kind``) says of which frames the walk's own tracking was not good, and
why (:class:`navcore.coverage.Advice`).
"""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import cv2

from navcore.errors import RecordingError
from navcore.fisheye_recording import fisheye_calibration_text, write_fisheye_picture
from navcore.recorded_files import is_inside, read_image
from navcore.recording import Mark, calibration_text, gravity_line, mark_line, write_pictures
from navcore.types import CameraIntrinsics, FisheyeImage, Frame

COVERAGE_FILE = "coverage.txt"
_DEPTH_FACTOR = 1000.0
_UNSURE_LINES = 300
"""So many of the last pictures may not have reached the disk when the power went."""


class LiveRecording:
    """Writes frames into a new folder, line by line. Every method may raise OSError, above all where the disk is full:
    what is there then stays sound."""

    def __init__(self, folder: Path, intrinsics: CameraIntrinsics) -> None:
        self._folder = folder
        self._tables: dict[str, IO[bytes]] = {}
        self.frame_count = 0
        for name in ("rgb", "depth"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / "calib.txt").write_text(calibration_text(intrinsics, _DEPTH_FACTOR), encoding="utf-8")

    def add(self, frame: Frame) -> None:
        """Write one frame; stamps grow."""
        line = write_pictures(self._folder, frame, _DEPTH_FACTOR)
        if frame.gravity is not None:
            self._append("gravity.txt", gravity_line(frame.stamp_s, frame.gravity))
        if frame.fisheye is not None:
            self._add_fisheye(frame.fisheye)
        self._append("associations.txt", line)
        self.frame_count += 1

    def _add_fisheye(self, image: FisheyeImage) -> None:
        if "fisheye.txt" not in self._tables:
            (self._folder / "fisheye").mkdir(exist_ok=True)
            calibration = fisheye_calibration_text(image.camera)
            (self._folder / "fisheye_calib.txt").write_text(calibration, encoding="utf-8")
        self._append("fisheye.txt", write_fisheye_picture(self._folder, image))

    def mark(self, mark: Mark) -> None:
        """Note that a place was named."""
        self._append("marks.txt", mark_line(mark))

    def cover(self, stamp_s: float, kinds: Sequence[str]) -> None:
        """Note of which kinds the trouble with a frame was."""
        for kind in kinds:
            self._append(COVERAGE_FILE, f"{stamp_s:.6f} {kind}\n")

    def _append(self, name: str, line: str) -> None:
        table = self._tables.get(name)
        if table is None:
            # Unbuffered: a line is in the file, or it is not.
            table = self._tables[name] = (self._folder / name).open("ab", buffering=0)
        data = line.encode()
        if table.write(data) != len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._folder / name))

    def close(self) -> None:
        """Write the tables through to the disk, and close them."""
        for table in self._tables.values():
            os.fdatasync(table.fileno())
            table.close()
        self._tables.clear()


def mend_recording(folder: Path) -> int:
    """Cut off what is incomplete at the end of a recording that broke off; return how many frames are left.

    Raises RecordingError where nothing is left, and OSError.
    """
    for name in ("gravity.txt", "marks.txt", COVERAGE_FILE):
        _keep_lines(folder / name, _whole_lines(folder / name))
    fisheye = _whole_lines(folder / "fisheye.txt")
    _keep_lines(folder / "fisheye.txt", _readable(folder, fisheye, (1,)))
    frames = _readable(folder, _whole_lines(folder / "associations.txt"), (1, 3))
    if not frames:
        raise RecordingError(f"{folder} holds no whole frame: record again.")
    _keep_lines(folder / "associations.txt", frames)
    return len(frames)


def _whole_lines(path: Path) -> list[str]:
    """Return the lines that are complete: those after the first that holds what no table holds are no lines."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return []
    whole = data[: data.rfind(b"\n") + 1].split(b"\0", 1)[0]
    return whole[: whole.rfind(b"\n") + 1].decode("utf-8", errors="replace").splitlines(keepends=True)


def _readable(folder: Path, lines: list[str], columns: Sequence[int]) -> list[str]:
    """Return the lines without those near the end whose pictures cannot be read."""
    sure, unsure = lines[:-_UNSURE_LINES], lines[-_UNSURE_LINES:]
    return sure + [line for line in unsure if _is_readable(folder, line.split(), columns)]


def _is_readable(folder: Path, words: list[str], columns: Sequence[int]) -> bool:
    if len(words) <= max(columns):
        return False
    files = [folder / words[column] for column in columns]
    return all(is_inside(file, folder) and read_image(file, cv2.IMREAD_UNCHANGED) is not None for file in files)


def _keep_lines(path: Path, lines: list[str]) -> None:
    if not path.exists():
        return
    if not lines:
        path.unlink()
        return
    text = "".join(lines)
    if path.read_bytes() != text.encode():
        path.write_text(text, encoding="utf-8")
