"""How one decision came about, as the console is told: compact, for it goes out after each cycle.

All angles are relative to the heading, to the left, unless they say otherwise; all durations end at the state's stamp.
Everything has a default, so that a recording that is older than a field can still be read.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

MAX_STAMP_S = 1e12
Finite = Annotated[float, msgspec.Meta(ge=-MAX_STAMP_S, le=MAX_STAMP_S)]
MAX_BEARINGS = 361
_Centimetres = Annotated[int, msgspec.Meta(ge=0, le=65535)]
_State = Annotated[int, msgspec.Meta(ge=0, le=4)]
_Degrees = Annotated[int, msgspec.Meta(ge=-180, le=180)]
_Bearings = msgspec.Meta(max_length=MAX_BEARINGS)


class WireScan(msgspec.Struct, frozen=True, array_like=True):
    """The depth image reduced to evenly spaced bearings, right to left, and what is remembered beside it."""

    first_rad: Finite
    """The rightmost bearing."""
    step_rad: Finite
    states: Annotated[tuple[_State, ...], _Bearings]
    """A navcore.types.BearingState for each bearing; one that the image does not cover is unknown."""
    nearest_cm: Annotated[tuple[_Centimetres, ...], _Bearings]
    """Distance to what is nearest in each bearing; 0 where it is free, or unknown."""
    unseen: Annotated[tuple[tuple[_Degrees, _Centimetres], ...], _Bearings] = ()
    """Bearing (degrees) and distance of what is remembered to be in the way, and not in the image."""


class WireCandidate(msgspec.Struct, frozen=True, array_like=True):
    """One candidate direction."""

    angle_rad: Finite
    clearance_m: Finite
    is_walkable: bool = False
    """It is free as far as was required, and leads where the walker is to go: θ_opt was chosen among these."""


class WireCorner(msgspec.Struct, frozen=True, array_like=True):
    """The next corner of the route, as far as it can be foreseen."""

    distance_m: Finite
    bend_rad: Finite
    turn_m: Finite
    """So far before the corner the turn is due."""


class DecisionLimits(msgspec.Struct, frozen=True, array_like=True):
    """What was compared with: the settings in force, and two limits that depend on the moment."""

    stop_m: Finite | None = None
    """Nothing may be nearer ahead than this; None where that was not looked at."""
    gate_m: Finite | None = None
    """d_sonar must exceed this (Eq. 5); None where the gate was not asked."""
    clearance_m: Finite = 0.0
    """δ."""
    person_width_m: Finite = 0.0
    half_field_rad: Finite = 0.0
    """Half the width of the ultrasonic field (Eq. 5)."""
    off_road_m: Finite = 0.0
    heading_error_rad: Finite = 0.0
    """Eq. 4 corrects from this difference between θ_exp and θ_c on."""
    turn_rad: Finite = 0.0
    """θ_exp farther to the side than this is turned to on the spot."""
    straight_rad: Finite = 0.0
    """What is nearer to straight ahead than this sounds like it."""
    arrival_m: Finite = 0.0
    uncertain_s: Finite = 0.0
    """So long guidance goes on while the pose is uncertain."""
    min_valid_fraction: Finite = 0.0
    free_frames_count: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 0
    """Free frames in a row that are needed after a stop."""


class DecisionTraceView(msgspec.Struct, frozen=True, array_like=True):
    """What went into a decision beyond the state's own fields (navcore.types.DecisionTrace, ObstacleScan)."""

    decided: Annotated[str, msgspec.Meta(max_length=120)] = ""
    """A navcore.types.Rule value: the check that decided."""
    turn: Literal["along", "around", "aside", "look"] | None = None
    """Why the walker is turned on the spot."""
    optimal_rad: Finite | None = None
    """θ_opt (Eq. 4)."""
    required_m: Finite | None = None
    """How far a direction had to be free: δ, or less."""
    closing_m_s: Finite = 0.0
    """How fast what comes towards the walker comes."""
    offset_m: Finite = 0.0
    """How far left of the road's middle the walker is led, round what stands on it."""
    free_frame_count: Annotated[int, msgspec.Meta(ge=0, le=1 << 31)] = 0
    """Frames in a row, since a stop, in which the way was free."""
    stopped_s: Finite | None = None
    """How long the walker has not been told to walk."""
    uncertain_s: Finite | None = None
    """How long the pose has not been sure."""
    lost_s: Finite | None = None
    """How long the pose has been lost."""
    look_rad: Finite | None = None
    """Where the walker turns to look for a way round."""
    corner: WireCorner | None = None
    is_at_corner: bool = False
    """The walker is at a corner of the route, or has just passed its middle."""
    sonar_rad: Finite = 0.0
    """Where the rangefinder looks."""
    valid_fraction: Finite | None = None
    """Share of the depth image that carries a depth; None where no image was looked at."""
    limits: DecisionLimits = DecisionLimits()
    scan: WireScan | None = None
    """None where no image was looked at."""
    rejoins: bool = False
    """Beside the road nothing was found that leads on: the walker is led to the road first."""
