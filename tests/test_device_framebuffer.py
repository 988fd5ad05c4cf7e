"""Both eyes' pictures side by side in a framebuffer's memory."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hardware_stand_ins import make_framebuffer

from device_agent.adapters.framebuffer import FramebufferDisplay, framebuffer_bytes, read_framebuffer
from navcore.cues.overlay import Overlay
from navcore.errors import SensorError

WIDTH_PX, HEIGHT_PX = 640, 180


def overlay(left: tuple[int, int, int, int], right: tuple[int, int, int, int]) -> Overlay:
    size = (HEIGHT_PX, WIDTH_PX // 2, 4)
    return Overlay(1.0, np.full(size, left, np.uint8), np.full(size, right, np.uint8), is_stop=False)


def pixels(device: Path, bits_per_pixel: int) -> np.ndarray:
    """Return the visible bytes (h, w, bytes) of the display's memory."""
    rows = np.frombuffer(device.read_bytes(), np.uint8).reshape(HEIGHT_PX, -1)
    return rows[:, : WIDTH_PX * bits_per_pixel // 8].reshape(HEIGHT_PX, WIDTH_PX, bits_per_pixel // 8)


def test_each_eye_sees_its_own_half(tmp_path: Path) -> None:
    device = make_framebuffer(tmp_path)
    display = FramebufferDisplay(device, tmp_path)
    assert (display.geometry.width_px, display.geometry.height_px) == (WIDTH_PX // 2, HEIGHT_PX)
    display.show(overlay((250, 100, 10, 255), (0, 200, 0, 255)))
    shown = pixels(device, 32)
    assert (shown[:, :320, :3] == (10, 100, 250)).all(), "blue first, as the memory has it"
    assert (shown[:, 320:, :3] == (0, 200, 0)).all()


def test_where_nothing_is_shown_no_light_is_added(tmp_path: Path) -> None:
    device = make_framebuffer(tmp_path)
    display = FramebufferDisplay(device, tmp_path)
    display.show(overlay((255, 255, 255, 0), (200, 200, 200, 128)))
    shown = pixels(device, 32)
    assert (shown[:, :320, :3] == 0).all()
    assert (shown[:, 320:, :3] == 100).all()


def test_after_closing_the_display_is_dark_and_stays_so(tmp_path: Path) -> None:
    device = make_framebuffer(tmp_path)
    display = FramebufferDisplay(device, tmp_path)
    display.show(overlay((255, 255, 255, 255), (255, 255, 255, 255)))
    display.close()
    display.show(overlay((255, 255, 255, 255), (255, 255, 255, 255)))
    assert (pixels(device, 32)[..., :3] == 0).all()


def test_sixteen_bits_are_written_as_565(tmp_path: Path) -> None:
    device = make_framebuffer(tmp_path, bits_per_pixel=16)
    display = FramebufferDisplay(device, tmp_path)
    display.show(overlay((255, 0, 0, 255), (0, 0, 255, 255)))
    words = pixels(device, 16).copy().view("<u2")[..., 0]
    assert (words[:, :320] == 0b11111_000000_00000).all()
    assert (words[:, 320:] == 0b00000_000000_11111).all()


def test_rows_are_as_long_as_the_memory_has_them(tmp_path: Path) -> None:
    make_framebuffer(tmp_path)
    buffer = read_framebuffer(tmp_path / "fb0")
    data = framebuffer_bytes(np.full((HEIGHT_PX, WIDTH_PX, 3), 9, np.uint8), buffer)
    assert len(data) == buffer.row_bytes * HEIGHT_PX
    assert data[WIDTH_PX * 4 : buffer.row_bytes] == bytes(64)


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("bits_per_pixel", "8", "set it to 32 bits"),
        ("stride", "12", "set it to 32 bits"),
        ("stride", "many", "plug the glasses in"),
        ("bits_per_pixel", None, "plug the glasses in"),
    ],
)
def test_a_display_that_cannot_be_used_is_told(tmp_path: Path, name: str, text: str | None, sentence: str) -> None:
    device = make_framebuffer(tmp_path)
    (tmp_path / "fb0" / name).unlink()
    if text is not None:
        (tmp_path / "fb0" / name).write_text(text)
    with pytest.raises(SensorError, match=sentence):
        FramebufferDisplay(device, tmp_path)


def test_a_display_that_is_not_there_or_goes_is_told(tmp_path: Path) -> None:
    device = make_framebuffer(tmp_path)
    with pytest.raises(SensorError, match="plug the glasses in"):
        FramebufferDisplay(Path("/dev/fb7"), tmp_path)
    display = FramebufferDisplay(device, tmp_path)
    full = os.open("/dev/full", os.O_WRONLY)
    assert display._file is not None
    os.dup2(full, display._file)
    os.close(full)
    with pytest.raises(SensorError, match="has gone"):
        display.show(overlay((1, 1, 1, 255), (1, 1, 1, 255)))
    display.close()
    display.close()


def test_without_a_mode_the_whole_memory_is_the_picture(tmp_path: Path) -> None:
    make_framebuffer(tmp_path)
    (tmp_path / "fb0" / "mode").write_text("\n")
    buffer = read_framebuffer(tmp_path / "fb0")
    assert (buffer.width_px, buffer.height_px) == (WIDTH_PX, 2 * HEIGHT_PX)
