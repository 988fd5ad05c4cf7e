"""Displays without glasses: pictures on disk."""

from __future__ import annotations

import logging
import queue
import threading
from pathlib import Path

import cv2
import numpy as np

from navcore.cues.overlay import Overlay
from navcore.cues.overlay_display import DisplayGeometry
from navcore.errors import InputError

_log = logging.getLogger(__name__)
_WAITING = 64
_FAST = (cv2.IMWRITE_PNG_COMPRESSION, 1)


class PngDisplay:
    """Writes what each eye sees as ``left/00012.300.png`` and ``right/00012.300.png``, named by the time in seconds.

    Pixels are RGBA, transparent where nothing is shown. Writing happens in a thread of its own; a disk that is too slow
    loses pictures, not time.
    """

    def __init__(self, folder: Path, geometry: DisplayGeometry | None = None) -> None:
        """Raises InputError where the folder cannot be written."""
        self._folder = folder
        self._geometry = geometry or DisplayGeometry()
        try:
            for name in ("left", "right"):
                (folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be written ({error.strerror}): name another folder.") from error
        self._overlays: queue.Queue[Overlay | None] = queue.Queue(_WAITING)
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="png", daemon=True)
        self._thread.start()

    @property
    def geometry(self) -> DisplayGeometry:
        """The displays that are written."""
        return self._geometry

    def show(self, overlay: Overlay) -> None:
        """Hand the pictures over; none is taken after closing."""
        if self._closed:
            return
        try:
            self._overlays.put_nowait(overlay)
        except queue.Full:
            _log.debug("a picture of the overlay was left out: the disk is slow")

    def close(self) -> None:
        """Write what is waiting."""
        if not self._closed:
            self._closed = True
            self._overlays.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (overlay := self._overlays.get()) is not None:
            for name, rgba in (("left", overlay.left_rgba), ("right", overlay.right_rgba)):
                path = self._folder / name / f"{overlay.stamp_s:09.3f}.png"
                if not self._write(path, rgba):
                    _log.warning("%s could not be written: free the disk", path)

    @staticmethod
    def _write(path: Path, rgba: np.ndarray) -> bool:
        try:
            return bool(cv2.imwrite(str(path), cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA), _FAST))
        except cv2.error:
            return False
