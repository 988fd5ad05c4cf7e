"""The depth image as a small picture for the console: shapes by distance, no colours of people or places."""

from __future__ import annotations

import cv2
import numpy as np

from navcore.types import DepthImage

SIZE_PX = (160, 120)
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
