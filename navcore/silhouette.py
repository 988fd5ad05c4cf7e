"""Small pictures for the console: the depth image as shapes by distance, without colours of people or places; and,
where the walker allows it, what the camera sees.
"""

from __future__ import annotations

import cv2
import numpy as np

from navcore.types import DepthImage, ImageRgb

SIZE_PX = (160, 120)
COLOUR_LONGEST_PX = 320
JPEG_QUALITY = 60
NEAR_M, FAR_M = 0.3, 6.0


def _palette_bgr() -> np.ndarray:
    """Return (256, 1, 3): 0 (unknown) black, then from pale grey (near) to deep blue (far)."""
    share = np.linspace(0.0, 1.0, 255)[:, None]
    near, far = np.array([[235.0, 232.0, 228.0]]), np.array([[96.0, 34.0, 12.0]])
    colours = np.concatenate([np.zeros((1, 3)), near + share * (far - near)])
    return colours.round().astype(np.uint8)[:, None, :]


_PALETTE_BGR = _palette_bgr()


def silhouette_jpeg(depth_m: DepthImage) -> bytes:
    """Return a JPEG (160×120) of a depth image (h, w): near is pale, far is deep blue, unknown is black."""
    small = cv2.resize(depth_m, SIZE_PX, interpolation=cv2.INTER_NEAREST)
    known = np.isfinite(small)
    share = (np.clip(np.where(known, small, FAR_M), NEAR_M, FAR_M) - NEAR_M) / (FAR_M - NEAR_M)
    levels = np.where(known, 1 + share * 254, 0).astype(np.uint8)
    picture = cv2.applyColorMap(levels, _PALETTE_BGR)
    _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return jpeg.tobytes()


def colour_jpeg(colour_rgb: ImageRgb) -> bytes:
    """Return a JPEG of a colour image (h, w, 3), its longer side at most 320 pixels."""
    height_px, width_px = colour_rgb.shape[:2]
    share = min(1.0, COLOUR_LONGEST_PX / max(height_px, width_px))
    size_px = (max(1, round(width_px * share)), max(1, round(height_px * share)))
    small = cv2.resize(colour_rgb, size_px, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return jpeg.tobytes()
