"""Values of ours that are recorded for people to read and plot, as JSON."""

from __future__ import annotations

import math
from typing import Any, Literal

import msgspec

from device_agent.cycle import Cycle
from device_agent.load_plan import LoadLevel
from navcore.settings import Settings
from navcore.types import Localization


class StageTimesMessage(msgspec.Struct, frozen=True):
    """How long the stages of a cycle took, milliseconds; null for one that was not come to."""

    stamp_s: float
    capture_ms: float | None = None
    localize_ms: float | None = None
    plan_ms: float | None = None
    scan_ms: float | None = None
    guide_ms: float | None = None
    cues_ms: float | None = None
    fault: str = ""
    load_level: str = LoadLevel.FULL.value
    """What was left out because the device was too slow."""
    pictures_dropped: int = 0
    """Frames since recording began whose pictures were not kept, because the disk was behind."""
    pose_late: bool = False
    """Guidance went on without the pose of its frame: localization was not in time."""

    @staticmethod
    def of(cycle: Cycle, level: LoadLevel, pictures_dropped: int) -> StageTimesMessage:
        """Return the times of a cycle."""
        known = {f"{stage}_ms": took_ms for stage, took_ms in cycle.stage_ms.items()}
        known = {name: took_ms for name, took_ms in known.items() if name in StageTimesMessage.__struct_fields__}
        return StageTimesMessage(
            cycle.stamp_s, **known, fault=cycle.fault, load_level=level.value, pictures_dropped=pictures_dropped,
            pose_late=cycle.pose_late,
        )  # fmt: skip


SETTINGS_SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {"revision": {"type": "integer"}, "settings": {"$ref": "#/$defs/Settings"}},
    "$defs": {**Settings.model_json_schema()["$defs"], "Settings": Settings.model_json_schema()},
}
"""What the settings' own model says of them."""


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
