"""What device and console both know of the messages in a recorded walk: topics, values in JSON, and pictures."""

from __future__ import annotations

from typing import Any, Literal

import msgspec
import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from numpy.typing import NDArray

from navcore.cues.table import Cue
from navcore.errors import InputError
from navcore.recording import depth_from_units
from navcore.types import DepthImage

DEPTH_TOPIC = "/camera/depth"
ROAD_TOPIC = "/road"
ROUTE_TOPIC = "/route"
WAY_TOPIC = "/device/route"
LOG_TOPIC = "/log"
CUES_TOPIC = "/cues"
SETTINGS_TOPIC = "/settings"
DEVICE_TOPIC = "/device"
ORDERS_TOPIC = "/orders"

MM_PER_M = 1000.0
Speaker = Literal["loop", "watchdog"]


class HeardCue(msgspec.Struct, frozen=True):
    """A cue that was played."""

    speaker: Speaker
    cue: Cue


class OrderMessage(msgspec.Struct, frozen=True):
    """An order that was carried out."""

    stamp_s: float
    kind: str
    content: str = ""
    """The message as JSON, where it came from the console."""


class SettingsMessage(msgspec.Struct, frozen=True):
    """The settings that run."""

    revision: int
    settings: dict[str, Any]
    """By group and name."""


def pixels_of(image: RawImage) -> NDArray[np.uint8]:
    """Return the pixels of a picture, (h, w, 3) red first, or (h, w) grey. Raises InputError."""
    channels = {"rgb8": (3,), "mono8": ()}.get(image.encoding)
    return _values(image, "u1", channels).astype(np.uint8)


def depths_of(image: RawImage) -> DepthImage:
    """Return the depths (h, w), metres. Raises InputError."""
    if image.encoding == "16UC1":
        return depth_from_units(_values(image, "<u2", ()).astype(np.uint16), MM_PER_M)
    return _values(image, "<f4", () if image.encoding == "32FC1" else None).astype(np.float32)


def _values(image: RawImage, dtype: str, channels: tuple[int, ...] | None) -> NDArray[Any]:
    try:
        if channels is None:
            raise ValueError(image.encoding)
        return np.frombuffer(image.data, dtype).reshape(image.height, image.width, *channels)
    except ValueError as error:
        raise InputError(
            "A picture of the recording is damaged: replay it without --site, from poses and scans."
        ) from error
