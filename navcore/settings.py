"""Every threshold of the product, one line each.

The unit is the last word of a name; each field carries its default, safe range, step and source, and the string
under it says what it means. Command-line flags (``--set follower.sub_goal_distance_m=2.5``), the console's sliders
and the settings page of the docs are all made from this file.

A :class:`Settings` is never changed: a live change builds a new, validated one, which the loop takes at its next frame.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from navcore.errors import SettingError

SettingValue = float | int | bool | str


def _setting(default: Any, low: float | None = None, high: float | None = None, *, step: float | None = None,
             source: str = "", safety: bool = False, paper: Any = None) -> Any:  # fmt: skip
    """Declare a setting: default, safe range, step of its slider, source, and whether people's safety hangs on it.

    ``paper`` is the value that the paper names, where it names one.
    """
    extra: dict[str, Any] = {"step": step, "source": source, "safety": safety, "paper": paper}
    return (
        Field(default=default, ge=low, le=high, json_schema_extra=extra, allow_inf_nan=False)
        if low is not None
        else Field(default=default, json_schema_extra=extra)
    )


class _Group(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True, strict=False)


class LocalizationSettings(_Group):
    """Localization."""

    feature_count: int = _setting(600, 200, 2000, step=50, source="ORB-SLAM2")
    """Features extracted from a frame."""
    min_inliers_count: int = _setting(20, 10, 100, step=1, source="design")
    """Landmarks that must agree before a pose counts as found."""
    uncertain_hold_s: float = _setting(3.0, 0.0, 30.0, step=0.5, source="unknown is never clear", safety=True)
    """How long guidance goes on while the pose is only "Uncertain"."""
    uncertain_position_m: float = _setting(0.25, 0.05, 1.0, step=0.05, source="design")
    """Standard deviation of the position above which a pose is only "Uncertain"."""
    use_fisheye: bool = _setting(True, source="IV-A")
    """Whether the fisheye camera's pictures are used, where there are any."""


class PlanningSettings(_Group):
    """Way finding."""

    route_spacing_m: float = _setting(0.1, 0.05, 0.5, step=0.05, source="design")
    """Distance between the points of a route."""
    max_start_distance_m: float = _setting(5.0, 1.0, 50.0, step=0.5, source="design")
    """A walker farther from the road than this is told to come nearer instead of being led across the unknown."""
    replan_deviation_m: float = _setting(2.0, 0.5, 10.0, step=0.1, source="design")
    """Distance from the route beyond which a new one is planned, after the hold time."""
    replan_hold_s: float = _setting(3.0, 0.5, 30.0, step=0.5, source="design")
    """How long the deviation must last before a new route is planned."""
    blocked_hold_s: float = _setting(12.0, 5.0, 120.0, step=1.0, source="people in the way mostly walk on")
    """How long something may block the way before another way is looked for."""
    blocked_memory_s: float = _setting(300.0, 30.0, 3600.0, step=30.0, source="design")
    """How long a place that was blocked is not planned through again."""


class ObstacleSettings(_Group):
    """Obstacle detection."""

    clearance_m: float = _setting(3.0, 1.0, 4.0, step=0.1, source="closed-loop trials; [13]: 2 m", safety=True)
    """δ of depth: a direction is walkable when it is free up to here (or up to the sub-goal and a margin, where that is
    nearer). More than the gate's: who hears of an obstacle at 2 m has 1 m left when they have reacted."""
    narrow_clearance_m: float = _setting(1.2, 0.8, 4.0, step=0.1, source="closed-loop trials", safety=True)
    """Where no direction is free for δ, somebody who stands may begin to walk in one that is free for this."""
    stop_distance_m: float = _setting(0.8, 0.5, 2.0, step=0.05, source="design", safety=True)
    """Anything nearer than this straight ahead stops the walker at once."""
    slow_reaction_s: float = _setting(0.9, 0.3, 2.0, step=0.1, source="reaction time 0.3–0.9 s", safety=True)
    """Somebody who walks must have room to stop even where they react as slowly as this."""
    sub_goal_margin_m: float = _setting(0.5, 0.3, 1.0, step=0.05, source="design", safety=True)
    """Free space needed beyond a sub-goal that is nearer than δ."""
    person_width_m: float = _setting(0.7, 0.5, 1.2, step=0.05, source="design", safety=True)
    """Width of the corridor that must be free."""
    low_height_m: float = _setting(0.10, 0.05, 0.3, step=0.01, source="design", safety=True)
    """What stands higher than this above the floor is an obstacle."""
    head_height_m: float = _setting(1.9, 1.5, 2.5, step=0.05, source="design", safety=True)
    """What hangs lower than this above the floor is an obstacle."""
    drop_depth_m: float = _setting(0.10, 0.05, 0.5, step=0.01, source="design", safety=True)
    """A floor lower than this below the walker's is a drop: an obstacle at its edge."""
    min_valid_fraction: float = _setting(0.3, 0.05, 0.9, step=0.05, source="design", safety=True)
    """Share of the depth image that must carry a depth before it is believed."""
    candidate_step_deg: float = _setting(3.0, 1.0, 10.0, step=1.0, source="design")
    """Angle between neighbouring candidate directions."""
    leave_frames_count: int = _setting(3, 1, 10, step=1, source="design", safety=True)
    """Free frames in a row that are needed before walking again after a stop."""
    approach_horizon_s: float = _setting(1.0, 0.0, 3.0, step=0.1, source="reaction 0.7 s, braking 0.3 s", safety=True)
    """What comes towards the walker counts as being where it will be after this time."""


class FollowerSettings(_Group):
    """Route following."""

    policy: Literal["paper", "road_centred"] = _setting(
        "road_centred", source="IV-C; docs/experiments.md", paper="paper"
    )
    """The guidance policy: the paper's equations, or the middle of the road."""
    sub_goal_distance_m: float = _setting(3.0, 0.5, 10.0, step=0.1, source="Eq. 2: d = 3 m", paper=3.0)
    """d: the sub-goal lies this far from the closest point."""
    turning_angle_deg: float = _setting(30.0, 10.0, 90.0, step=5.0, source="Eq. 2: θ = π/6", paper=30.0)
    """θ: a bend of the route by more than this is a turning point."""
    turning_reached_m: float = _setting(0.7, 0.2, 2.0, step=0.05, source="Eq. 2, case 2")
    """A turning point nearer than this is reached."""
    arrival_distance_m: float = _setting(1.0, 0.3, 3.0, step=0.1, source="IV-C, case 3: 1.0 m", paper=1.0)
    """A destination nearer than this is reached."""
    off_road_distance_m: float = _setting(1.0, 0.3, 3.0, step=0.1, source="Eq. 4: 1.0 m", paper=1.0)
    """A walker farther from the route than this is led back to it."""
    heading_error_deg: float = _setting(30.0, 5.0, 90.0, step=1.0, source="Eq. 4: π/6", paper=30.0)
    """A heading that differs more than this from the expected direction is corrected."""
    turn_angle_deg: float = _setting(40.0, 20.0, 90.0, step=1.0, source="half the depth camera's field")
    """An expected direction farther to the side than this is turned to on the spot, without a step."""
    turn_settled_deg: float = _setting(12.0, 3.0, 30.0, step=1.0, source="design")
    """A turn on the spot ends when the expected direction is nearer to straight ahead than this."""
    closest_window_m: float = _setting(4.0, 1.0, 20.0, step=0.5, source="Eq. 1")
    """How far along the route, from the last one, the closest point is looked for."""
    reaction_s: float = _setting(0.7, 0.2, 1.5, step=0.1, source="reaction time 0.3–0.9 s")
    """Road-centred: time from an instruction to the walker's movement."""
    lead_s: float = _setting(0.7, 0.2, 3.0, step=0.1, source="closed-loop trials")
    """Road-centred: the walker is led to where they will be so long after they have reacted."""
    min_look_ahead_m: float = _setting(1.0, 0.5, 3.0, step=0.1, source="closed-loop trials")
    """Road-centred: but never to a point nearer than this."""
    corner_angle_deg: float = _setting(45.0, 30.0, 90.0, step=5.0, source="closed-loop trials")
    """Road-centred: a bend sharper than this is turned at on the spot."""
    corner_reached_m: float = _setting(0.3, 0.1, 1.0, step=0.05, source="closed-loop trials")
    """Road-centred: a corner nearer than this is reached, however slow the walker."""


class GateSettings(_Group):
    """Ultrasonic gate."""

    clearance_m: float = _setting(2.0, 0.5, 4.0, step=0.1, source="Eq. 5: δ = 2.0 m", safety=True, paper=2.0)
    """δ: an echo nearer than this closes the gate (or nearer than the sub-goal and a margin, where that is nearer)."""
    half_field_deg: float = _setting(7.5, 5.0, 30.0, step=0.5, source="Eq. 5: ±7.5°", safety=True, paper=7.5)
    """Half of the ultrasonic field: directions inside it are checked."""
    stale_after_s: float = _setting(0.25, 0.05, 1.0, step=0.05, source="Eq. 5", safety=True)
    """A reading older than this is not believed."""


class CalibrationSettings(_Group):
    """Calibration."""

    tilt_tolerance_deg: float = _setting(6.0, 3.0, 15.0, step=0.5, source="a ramp of 1:12 is 4.8°", safety=True)
    """The floor may lie so far from where the calibration has it before the camera has moved."""
    height_tolerance_m: float = _setting(0.2, 0.1, 0.5, step=0.05, source="design", safety=True)
    """The camera may be so much higher or lower above the floor than it was when calibrated."""
    moved_after_s: float = _setting(3.0, 1.0, 20.0, step=0.5, source="design", safety=True)
    """How long the floor must disagree with the calibration where a nodding head is told from a camera that has moved:
    in height, and against gravity or the pose."""
    posture_after_s: float = _setting(5.0, 2.0, 60.0, step=1.0, source="a look at one's feet is shorter", safety=True)
    """How long the camera must look higher, lower or more aslant than when calibrated, on the average of a stride,
    where only the head might."""
    yaw_tolerance_deg: float = _setting(15.0, 8.0, 45.0, step=1.0, source="what sounds like straight ahead is 10°")
    """The camera may look so far aside of where the walker walks before they are told."""
    turned_after_m: float = _setting(6.0, 3.0, 30.0, step=1.0, source="design")
    """So far must be walked straight on before the camera is said to look aside."""


class CueSettings(_Group):
    """Cues."""

    language: Literal["en", "zh"] = _setting("en", source="design")
    """Language of the speech."""
    verbosity: Literal["brief", "normal", "full"] = _setting("normal", source="Wayfindr")
    """Brief: stops, turns, warnings, arrival. Normal: places and turns ahead, reassurance. Full: exact turns ahead,
    where the road is, and why it was stopped, in sentences. What safety hangs on is said at every level."""
    direction_style: Literal["degrees", "clock", "sides"] = _setting("degrees", source="design")
    """Directions are told in degrees, by the clock face, or as slightly, half, sharp left and right."""
    straight_within_deg: float = _setting(10.0, 2.0, 30.0, step=1.0, source="design")
    """Directions within this of straight ahead need no steering tone."""
    tick_interval_s: float = _setting(
        1.0, 0.3, 1.4, step=0.1, source="the walker's own stop after 1.5 s of silence", safety=True
    )
    """Time between the heart-beats that say "walk" still holds."""
    steer_interval_s: float = _setting(0.5, 0.2, 1.4, step=0.1, source="reaction time 0.3–0.9 s", safety=True)
    """Time between steering tones while the direction is not straight ahead."""
    turn_repeat_s: float = _setting(3.0, 1.0, 10.0, step=0.5, source="design")
    """Time before an instruction that still holds is said again."""
    reassurance_m: float = _setting(10.0, 3.0, 50.0, step=1.0, source="Wayfindr")
    """Distance walked between two reassurances."""
    announce_m: float = _setting(6.0, 2.0, 10.0, step=0.5, source="Wayfindr: 6 ± 1 m")
    """How far ahead a place on the way is announced at the usual speed of 0.85 m/s; earlier to whoever walks faster."""
    turn_lead_s: float = _setting(1.5, 0.0, 5.0, step=0.5, source="closed-loop trials")
    """Time between the end of the announcement of a turn and the turn itself."""
    beep_range_m: float = _setting(4.0, 1.0, 6.0, step=0.5, source="design")
    """An obstacle nearer than this is heard as a beep."""


class MapWalkSettings(_Group):
    """Map walk."""

    build_here: bool = _setting(True, source="design")
    """Whether the device builds the map of a map walk itself. Otherwise, and wherever a console is named, which owns
    the map, the recording is left for the console's machine."""
    turn_in_1_s_deg: float = _setting(75.0, 30.0, 180.0, step=5.0, source="motion blur; overlap of frames")
    """Whoever turns faster is asked to slow down."""
    way_in_1_s_m: float = _setting(1.6, 0.5, 3.0, step=0.1, source="brisk walking")
    """Whoever walks faster is asked to slow down."""
    look_down_deg: float = _setting(45.0, 25.0, 80.0, step=5.0, source="design")
    """A camera that points farther down than this looks at the floor."""
    look_up_deg: float = _setting(30.0, 10.0, 80.0, step=5.0, source="design")
    """A camera that points farther up than this looks at the ceiling."""
    far_m: float = _setting(2.0, 1.0, 4.0, step=0.1, source="design")
    """What is nearer than this tells little about where one is."""
    far_fraction: float = _setting(0.1, 0.0, 0.5, step=0.05, source="design")
    """Share of the depth image that must be farther than that."""
    landmarks_count: int = _setting(60, 20, 300, step=10, source="ORB-SLAM2; closed-loop trials")
    """A stretch with fewer landmarks in view is weak."""
    valid_depth_fraction: float = _setting(0.3, 0.05, 0.9, step=0.05, source="design")
    """A stretch with less of the depth image measured is weak."""
    dark_fraction: float = _setting(0.08, 0.01, 0.5, step=0.01, source="design")
    """A picture with a mean brightness below this is too dark."""
    flat_fraction: float = _setting(0.03, 0.01, 0.2, step=0.01, source="design")
    """A picture whose brightness varies by less than this shows nothing."""
    covered_fraction: float = _setting(0.05, 0.0, 0.3, step=0.01, source="design")
    """A camera that measures less of its depth image than this, and shows nothing, is covered."""
    repeat_s: float = _setting(10.0, 5.0, 60.0, step=1.0, source="design")
    """Time before the same advice is given again."""


class WatchdogSettings(_Group):
    """Watchdog."""

    guidance_timeout_s: float = _setting(0.5, 0.2, 1.0, step=0.05, source="design", safety=True)
    """Guidance older than this is the cue Stop."""
    camera_timeout_s: float = _setting(0.5, 0.1, 2.0, step=0.05, source="design", safety=True)
    """A camera that delivers nothing for this long has failed."""


class DeadlineSettings(_Group):
    """Deadlines of the loop."""

    capture_s: float = _setting(0.06, 0.02, 0.2, step=0.01, source="design")
    """Age of a frame when the loop takes it: exposure, driver, and waiting for the cycle before."""
    localize_s: float = _setting(0.045, 0.01, 0.3, step=0.005, source="design")
    """Localization in one frame. Guidance waits no longer for a pose, and less where the work's budget leaves less."""
    guide_s: float = _setting(0.015, 0.005, 0.1, step=0.005, source="design")
    """Planning, obstacle detection and guidance."""
    cue_s: float = _setting(0.005, 0.001, 0.05, step=0.001, source="design")
    """Choosing the cues and handing them to the output."""
    hand_off_s: float = _setting(0.01, 0.001, 0.05, step=0.001, source="design")
    """Handing over to watchdog, screen, link and recorder, after the cue."""
    capture_to_cue_s: float = _setting(0.12, 0.08, 0.4, step=0.01, source="design: p50 60 ms, p99 120 ms")
    """From a frame's capture to the cue that it leads to. What this leaves after ``capture_s`` is the work's budget."""
    do_less: bool = _setting(True, source="degrade by plan, not by lag")
    """Whether localization uses fewer features, and then every second frame only, while the work exceeds its budget."""

    @property
    def work_s(self) -> float:
        """What the device's own work may take, from the frame to its cue."""
        return max(0.02, self.capture_to_cue_s - self.capture_s)

    @property
    def pose_wait_s(self) -> float:
        """How long a cycle waits for the pose of its frame: what the others leave of its work's time, at the most."""
        return max(0.01, min(self.localize_s, self.work_s - self.guide_s - self.cue_s))


class Settings(BaseModel):
    """All settings, by group."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    localization: LocalizationSettings = LocalizationSettings()
    planning: PlanningSettings = PlanningSettings()
    obstacle: ObstacleSettings = ObstacleSettings()
    follower: FollowerSettings = FollowerSettings()
    gate: GateSettings = GateSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    cues: CueSettings = CueSettings()
    watchdog: WatchdogSettings = WatchdogSettings()
    deadlines: DeadlineSettings = DeadlineSettings()
    map_walk: MapWalkSettings = MapWalkSettings()

    def values(self) -> dict[str, SettingValue]:
        """Return every setting as ``group.name`` and value."""
        return {spec.key: getattr(getattr(self, spec.group), spec.name) for spec in setting_specs()}

    def changed(self, changes: Mapping[str, SettingValue]) -> Settings:
        """Return new settings with ``group.name`` values changed. Raises SettingError, naming the range."""
        groups: dict[str, dict[str, SettingValue]] = {}
        for key, value in changes.items():
            spec = spec_of(key)
            if (isinstance(value, bool) and spec.kind != "bool") or not _is_plain(value):
                raise SettingError(f"{key} cannot be {value!r}: {spec.range_text()}.", keys=(key,))
            groups.setdefault(spec.group, {})[spec.name] = value
        data = self.model_dump()
        for group, values in groups.items():
            data[group].update(values)
        try:
            changed = Settings.model_validate(data)
        except ValidationError as error:
            key = ".".join(str(part) for part in error.errors()[0]["loc"][:2])
            given = changes.get(key, error.errors()[0]["input"])
            raise SettingError(f"{key} cannot be {given!r}: {spec_of(key).range_text()}.", keys=(key,)) from error
        for order in ORDERS:
            order.check(changed)
        return changed

    def value(self, key: str) -> SettingValue:
        """Return the setting ``group.name``."""
        group, name = key.split(".")
        value: SettingValue = getattr(getattr(self, group), name)
        return value


@dataclass(frozen=True, slots=True)
class SettingOrder:
    """Two settings of which one must stay below the other, whatever their own ranges allow."""

    lower: str
    upper: str
    why: str
    may_equal: bool = False

    def check(self, settings: Settings) -> None:
        """Raise SettingError where they are not in order."""
        low, high = float(settings.value(self.lower)), float(settings.value(self.upper))
        if low < high or (self.may_equal and low == high):
            return
        unit = _unit_of(self.lower)
        relation = "not be more than" if self.may_equal else "be less than"
        raise SettingError(
            f"{self.lower} ({low:g}{unit and ' ' + unit}) must {relation} {self.upper} ({high:g}{unit and ' ' + unit}):"
            f" {self.why}. Change both together.",
            keys=(self.lower, self.upper),
        )


ORDERS = (
    SettingOrder(
        "obstacle.stop_distance_m", "obstacle.narrow_clearance_m", "whoever begins to walk would be stopped at once"
    ),
    SettingOrder(
        "obstacle.narrow_clearance_m", "obstacle.clearance_m", "a narrow place asks for less room, never for more",
        may_equal=True,
    ),
    SettingOrder(
        "obstacle.stop_distance_m", "gate.clearance_m", "an echo closes the gate before the walker must stop at once"
    ),
    SettingOrder(
        "follower.turn_settled_deg", "follower.turn_angle_deg", "a turn that begins must not have ended already"
    ),
    SettingOrder(
        "cues.straight_within_deg", "follower.turn_angle_deg", "what is turned to on the spot is not straight ahead"
    ),
    SettingOrder(
        "follower.turning_reached_m", "follower.sub_goal_distance_m",
        "a turning point would be reached before it is a sub-goal",
    ),
    SettingOrder(
        "follower.off_road_distance_m", "planning.replan_deviation_m",
        "the walker is led back to the road before another way is planned", may_equal=True,
    ),
    SettingOrder(
        "planning.blocked_hold_s", "planning.blocked_memory_s",
        "a blocked place must be remembered for longer than it is waited at",
    ),
    SettingOrder(
        "deadlines.capture_s", "deadlines.capture_to_cue_s", "nothing would be left of the time for the device's work"
    ),
    SettingOrder(
        "deadlines.capture_to_cue_s", "watchdog.guidance_timeout_s", "guidance that comes in time must not be stale"
    ),
    SettingOrder(
        "map_walk.covered_fraction", "map_walk.valid_depth_fraction", "a covered camera measures less than a weak view",
        may_equal=True,
    ),
)  # fmt: skip
"""The related settings: checked together at each change."""
_NOT_REPLAYED_GROUPS = frozenset({"localization", "watchdog", "deadlines", "map_walk"})
_NOT_REPLAYED_KEYS = frozenset({"obstacle.low_height_m", "obstacle.head_height_m", "obstacle.drop_depth_m"})
_REPLAYED_KEYS = frozenset({"localization.uncertain_hold_s"})
"""Poses, what stands in the way, and how long the device took are in a recorded walk as they were then. What decides on
these before guidance does cannot be judged from it."""


def not_replayed(keys: Iterable[str]) -> tuple[str, ...]:
    """Return those of the settings ``group.name`` whose effect a replay without pictures cannot show."""
    asked = set(keys)
    return tuple(spec.key for spec in setting_specs() if spec.key in asked and not spec.replayed)


def safety_changes(before: Settings, after: Settings) -> tuple[str, ...]:
    """Return the settings that people's safety hangs on and that differ."""
    return tuple(s.key for s in setting_specs() if s.safety and before.value(s.key) != after.value(s.key))


@dataclass(frozen=True, slots=True)
class SettingSpec:
    """One setting as a form, a slider, a flag or a page shows it."""

    group: str
    group_title: str
    name: str
    kind: Literal["float", "int", "bool", "choice"]
    unit: str
    default: SettingValue
    low: float | None
    high: float | None
    step: float | None
    choices: tuple[str, ...]
    source: str
    safety: bool
    meaning: str
    paper: SettingValue | None
    """The value that the paper names; None where it names none."""

    @property
    def key(self) -> str:
        """``group.name``."""
        return f"{self.group}.{self.name}"

    @property
    def replayed(self) -> bool:
        """A replay of a recorded walk without its pictures shows what another value would have changed."""
        if self.key in _REPLAYED_KEYS:
            return True
        return self.group not in _NOT_REPLAYED_GROUPS and self.key not in _NOT_REPLAYED_KEYS

    def range_text(self) -> str:
        """The permitted values in words."""
        if self.choices:
            return "choose one of " + ", ".join(self.choices)
        if self.low is None:
            return "choose true or false"
        kind = "a whole number" if self.kind == "int" else "a number"
        return f"give {kind} from {self.low:g} to {self.high:g}" + (f" ({self.unit})" if self.unit else "")


def _unit_of(key: str) -> str:
    return _UNITS.get(key.rsplit("_", 1)[-1], "")


_UNITS = {"m": "m", "s": "s", "deg": "°", "px": "px", "hz": "Hz", "count": "", "fraction": "", "rad": "rad"}


def setting_specs() -> tuple[SettingSpec, ...]:
    """Return every setting in order of the groups."""
    return _SPECS


def spec_of(key: str) -> SettingSpec:
    """Return the setting ``group.name``. Raises SettingError where there is none."""
    found = _SPECS_BY_KEY.get(key)
    if found is None:
        raise SettingError(f"There is no setting {key!r}: `vbr settings` lists them all.", keys=(key,))
    return found


def _specs() -> Iterator[SettingSpec]:
    for group, group_field in Settings.model_fields.items():
        group_type = group_field.annotation
        assert isinstance(group_type, type)
        assert issubclass(group_type, _Group)
        schema = group_type.model_json_schema()["properties"]
        title = (group_type.__doc__ or group).strip().rstrip(".")
        for name, model_field in group_type.model_fields.items():
            entry = schema[name]
            choices = tuple(entry.get("enum", ())) or ((entry["const"],) if "const" in entry else ())
            kind: Any = "choice" if choices else {"number": "float", "integer": "int", "boolean": "bool"}[entry["type"]]
            yield SettingSpec(
                group, title, name, kind, _unit_of(name), model_field.default,
                entry.get("minimum"), entry.get("maximum"), entry.get("step"), choices,
                entry.get("source", ""), bool(entry.get("safety")), model_field.description or "", entry.get("paper"),
            )  # fmt: skip


_SPECS = tuple(_specs())
_SPECS_BY_KEY = {spec.key: spec for spec in _SPECS}


def parse_assignment(text: str) -> tuple[str, SettingValue]:
    """Read ``group.name=value`` as the command line gives it. Raises SettingError."""
    key, equals, value_text = text.partition("=")
    if not equals:
        raise SettingError(f"{text!r} is not of the form group.name=value: name a setting and its value.")
    spec = spec_of(key)
    if spec.kind == "choice":
        return key, value_text
    try:
        value = json.loads(value_text)
    except (ValueError, RecursionError) as error:
        raise SettingError(f"{key} cannot be {value_text!r}: {spec.range_text()}.") from error
    if not isinstance(value, (bool, int, float)):
        raise SettingError(f"{key} cannot be {value_text!r}: {spec.range_text()}.")
    return key, value


def _is_plain(value: object) -> bool:
    return isinstance(value, (bool, int, str)) or (isinstance(value, float) and math.isfinite(value))
