"""Glasses that are a monitor: both eyes' pictures side by side on a Linux framebuffer.

See-through glasses of this kind (Epson, Xreal, Rokid and others) show the left half of one wide picture to the left eye
and the right half to the right. What the framebuffer looks like is read from ``/sys/class/graphics``; the picture is
written to ``/dev/fb*`` as it is. Black lets the world through.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.cues.overlay import Overlay
from navcore.cues.overlay_display import DisplayGeometry
from navcore.errors import SensorError

GRAPHICS = Path("/sys/class/graphics")
_MODE = re.compile(r"[A-Z]:(\d+)x(\d+)")
_BYTES_PER_PIXEL = {16: 2, 32: 4}


@dataclass(frozen=True, slots=True)
class Framebuffer:
    """What a framebuffer's memory holds."""

    width_px: int
    height_px: int
    bits_per_pixel: int
    """32: blue, green, red and an unused byte; 16: 5 bits red, 6 green, 5 blue."""
    row_bytes: int


def read_framebuffer(folder: Path) -> Framebuffer:
    """Return what ``/sys/class/graphics/fb0`` says. Raises SensorError where there is none that can be used."""
    try:
        width_px, height_px = _visible_size(folder)
        bits, row_bytes = int(_word(folder, "bits_per_pixel")), int(_word(folder, "stride"))
    except (OSError, ValueError) as error:
        raise SensorError(
            f"There is no display {folder.name}: plug the glasses in before the device starts."
        ) from error
    if bits not in _BYTES_PER_PIXEL or width_px < 2 or row_bytes < width_px * _BYTES_PER_PIXEL[bits] or height_px < 1:
        raise SensorError(
            f"The display {folder.name} has {width_px}×{height_px} pixels of {bits} bits: set it to 32 bits."
        )
    return Framebuffer(width_px, height_px, bits, row_bytes)


def _visible_size(folder: Path) -> tuple[int, int]:
    """Return width and height in pixels of what is seen: the memory may hold a second picture below it."""
    mode = _MODE.match(_word(folder, "mode"))
    width, height = mode.groups() if mode else _word(folder, "virtual_size").split(",")
    return int(width), int(height)


def _word(folder: Path, name: str) -> str:
    return (folder / name).read_text(encoding="ascii").strip()


class FramebufferDisplay:
    """The :class:`device_agent.ports.DisplayOutput` on a framebuffer, which is black again after :meth:`close`."""

    def __init__(self, device: Path, graphics: Path = GRAPHICS, field_deg: float = 45.0) -> None:
        """Open ``/dev/fb0`` or another one; ``field_deg`` is what one eye sees of the world, from side to side.

        Raises SensorError where it cannot be opened.
        """
        self._buffer = read_framebuffer(graphics / device.name)
        try:
            self._file: int | None = os.open(device, os.O_WRONLY | os.O_CLOEXEC)
        except OSError as error:
            raise SensorError(
                f"The display {device} cannot be opened ({error.strerror}): add the user to the group 'video'."
            ) from error
        self._geometry = DisplayGeometry(self._buffer.width_px // 2, self._buffer.height_px, field_deg)

    @property
    def geometry(self) -> DisplayGeometry:
        """Half of the framebuffer for each eye."""
        return self._geometry

    def show(self, overlay: Overlay) -> None:
        """Write both pictures; nothing after closing. Raises SensorError where the display has gone."""
        both = np.zeros((self._buffer.height_px, self._buffer.width_px, 3), np.uint8)
        eye_px = self._geometry.width_px
        both[:, :eye_px] = _light(overlay.left_rgba)
        both[:, eye_px : 2 * eye_px] = _light(overlay.right_rgba)
        self._write(both)

    def close(self) -> None:
        """Be dark from now on; closing twice is harmless."""
        if self._file is None:
            return
        try:
            self._write(np.zeros((self._buffer.height_px, self._buffer.width_px, 3), np.uint8))
        except SensorError:
            # It has gone: dark enough.
            pass
        finally:
            os.close(self._file)
            self._file = None

    def _write(self, rgb: NDArray[np.uint8]) -> None:
        if self._file is None:
            return
        try:
            os.pwrite(self._file, framebuffer_bytes(rgb, self._buffer), 0)
        except OSError as error:
            raise SensorError(f"The display has gone ({error.strerror}): plug the glasses in again.") from error


def framebuffer_bytes(rgb: NDArray[np.uint8], buffer: Framebuffer) -> bytes:
    """Return a picture (h, w, 3), red first, of the framebuffer's size as the bytes of its memory."""
    code = cv2.COLOR_RGB2BGRA if buffer.bits_per_pixel == 32 else cv2.COLOR_RGB2BGR565
    pixels = cv2.cvtColor(rgb, code).reshape(buffer.height_px, -1).view(np.uint8)
    rows = np.zeros((buffer.height_px, buffer.row_bytes), np.uint8)
    rows[:, : pixels.shape[1]] = pixels
    return rows.tobytes()


def _light(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the light that a picture adds to the world (h, w, 3): none where it is transparent."""
    return (rgba[..., :3].astype(np.uint16) * rgba[..., 3:] // 255).astype(np.uint8)
