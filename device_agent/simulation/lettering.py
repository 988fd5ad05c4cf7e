"""Letters, and lines of text that are too small to read."""

from __future__ import annotations

import cv2
import numpy as np

from device_agent.simulation.patterns import Colour, Rng

PAPER: Colour = (248.0, 247.0, 242.0)
INK: Colour = (34.0, 36.0, 42.0)


def write_text(
    image: np.ndarray, text: str, at: tuple[int, int], width_px: int, colour: Colour, height_px: int = 0
) -> int:
    """Write text as wide as asked (and not higher); return the row below it."""
    (full_w, full_h), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 1.0, 2)
    scale = width_px / max(1, full_w)
    if height_px:
        scale = min(scale, height_px / full_h)
    base = at[1] + int(full_h * scale)
    left = at[0] + int((width_px - full_w * scale) / 2)
    # Text is drawn on 8-bit images only: as a mask, then.
    mask = np.zeros(image.shape[:2], np.uint8)
    cv2.putText(mask, text, (left, base), cv2.FONT_HERSHEY_DUPLEX, scale, 255, max(1, round(2 * scale)), cv2.LINE_AA)
    share = mask[:, :, None].astype(np.float32) / 255
    image[:] = image * (1 - share) + np.asarray(colour, np.float32) * share
    return base + int(0.3 * full_h * scale)


def write_lines(rng: Rng, image: np.ndarray, area: tuple[int, int, int, int], colour: Colour) -> None:
    """Fill an area (left, top, width, height) with lines of words, too small to read."""
    left, top, width, height = area
    for y in range(top, top + height - 4, 8):
        x = left
        while x < left + width - 8:
            word = int(rng.integers(5, 22))
            if x + word > left + width:
                break
            cv2.rectangle(image, (x, y), (x + word, y + int(rng.integers(2, 4))), colour, -1)
            x += word + 4
