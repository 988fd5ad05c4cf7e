"""Values of ours that are recorded for people to read and plot, as JSON."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from navcore.cues.table import Cue
from navcore.types import Localization

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


class StageTimesMessage(msgspec.Struct, frozen=True):
    """How long the stages of a cycle took."""

    stamp_s: float
    stage_ms: dict[str, float]
    fault: str = ""
    pictures_dropped: int = 0
    """Frames since recording began whose pictures were not kept, because the disk was behind."""


class PoseMessage(msgspec.Struct, frozen=True):
    """What localization said of a frame."""

    stamp_s: float
    quality: Literal["localized", "uncertain", "lost"]
    inlier_count: int
    x_m: float | None = None
    y_m: float | None = None
    eye_m: float | None = None
    """Height of the camera above the map's floor."""
    heading_rad: float | None = None
    position_std_m: float | None = None

    @staticmethod
    def of(located: Localization) -> PoseMessage:
        """Return a localization in numbers that can be plotted."""
        pose = located.pose
        if pose is None or located.world_from_camera is None:
            return PoseMessage(located.stamp_s, located.quality.value, located.inlier_count)
        covariance = located.covariance
        spread_m2 = math.nan if covariance is None else float(covariance[0, 0] + covariance[1, 1])
        return PoseMessage(
            located.stamp_s, located.quality.value, located.inlier_count, pose.x_m, pose.y_m,
            float(located.world_from_camera.translation[2]), pose.heading,
            math.sqrt(spread_m2) if spread_m2 >= 0.0 else None,
        )  # fmt: skip
