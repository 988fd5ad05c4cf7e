"""The values that flow from the sensors to the cue. All are frozen.

``None`` stands for the paper's *Null*. Unknown is never "clear", and silence is never "go".
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from navcore.angles import RelativeAngle, WorldAngle
from navcore.errors import InputError
from navcore.geometry import FloatArray, Transform, heading_of_camera
from navcore.planning.poi_graph import CautionSide

ImageRgb = NDArray[np.uint8]
"""Colour image (height, width, 3), red first."""
DepthImage = NDArray[np.float32]
"""Depth image (height, width), metres along the optical axis; NaN where the sensor gave nothing."""
ImageGrey = NDArray[np.uint8]
"""Grey image (height, width)."""


# ---------------------------------------------------------------------------------------------------- sensors
@dataclass(frozen=True, slots=True)
class CameraIntrinsics:
    """A pinhole camera with Brown–Conrady distortion of its colour image; depth is registered to the ideal pinhole."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()
    """k1 k2 p1 p2 k3, as OpenCV orders them; empty where the image is not distorted."""

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix (3, 3), pixels."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class FisheyeIntrinsics:
    """A fisheye lens after Kannala and Brandt (2006), with four coefficients, as OpenCV's fisheye module has it.

    A ray θ off the optical axis meets the image at the radius θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), times the
    focal length. Raises InputError for numbers that no lens has.
    """

    width_px: int
    height_px: int
    fx_px: float
    """Pixels per radian on the optical axis."""
    fy_px: float
    cx_px: float
    cy_px: float
    k1: float
    k2: float
    k3: float
    k4: float
    max_angle_rad: float
    """Half the field of view: the lens shows nothing farther off its axis. It may exceed 90°."""

    def __post_init__(self) -> None:
        if self.width_px < 16 or self.height_px < 16:
            raise InputError(f"A fisheye picture of {self.width_px}×{self.height_px} pixels is too small to be used.")
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, *self.distortion, self.max_angle_rad)
        if not all(math.isfinite(number) for number in numbers):
            raise InputError(
                "The calibration of the fisheye camera holds a number that is not finite: calibrate again."
            )
        sizes = (self.width_px, self.height_px)
        for name, focal_px, size_px in zip(("fx", "fy"), (self.fx_px, self.fy_px), sizes, strict=True):
            if not 0.1 * size_px <= focal_px <= 5.0 * size_px:
                raise InputError(
                    f"The fisheye camera's {name} is {focal_px:g} px per radian, which does not fit a picture of"
                    f" {self.width_px}×{self.height_px} pixels: use the calibration made at this size."
                )
        if not (0 < self.cx_px < self.width_px and 0 < self.cy_px < self.height_px):
            raise InputError(
                f"The fisheye camera's optical axis at ({self.cx_px:g}, {self.cy_px:g}) lies outside the picture of"
                f" {self.width_px}×{self.height_px} pixels: use the calibration made at this size."
            )
        if not math.radians(10.0) <= self.max_angle_rad <= math.radians(175.0):
            raise InputError(
                f"The fisheye camera is said to see up to {math.degrees(self.max_angle_rad):g}° off its axis: give half"
                " its field of view, 10 to 175°."
            )
        if not self._is_increasing():
            raise InputError(
                "The fisheye camera's k1 k2 k3 k4 fold the picture back on itself within"
                f" {math.degrees(self.max_angle_rad):g}°: calibrate again, or give a narrower field of view."
            )

    def _is_increasing(self) -> bool:
        """Return whether rays farther off the axis meet the image farther from its centre."""
        theta = np.linspace(0.0, self.max_angle_rad, 257)
        radius = theta.copy()
        for power, k in enumerate(self.distortion, 1):
            radius += k * theta ** (2 * power + 1)
        return bool(np.all(np.diff(radius) > 0.0))

    @property
    def distortion(self) -> tuple[float, float, float, float]:
        """k1 k2 k3 k4."""
        return self.k1, self.k2, self.k3, self.k4


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeCamera:
    """The second, wide camera, and how it is mounted beside the depth camera."""

    intrinsics: FisheyeIntrinsics
    fisheye_from_camera: Transform
    """Takes points in the depth camera's frame to the fisheye camera's, both x right, y down, z forward."""


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeImage:
    """One capture of the fisheye camera."""

    stamp_s: float
    """Its own time of capture, seconds, on the depth camera's clock."""
    grey: ImageGrey
    camera: FisheyeCamera
    """The camera that took it."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One capture of the depth camera: colour and registered depth, of the same instant."""

    stamp_s: float
    """The sensor's own time of capture, seconds."""
    colour_rgb: ImageRgb
    depth_m: DepthImage
    fisheye: FisheyeImage | None = None
    """What the fisheye camera saw at about the same time, where there is one."""
    gravity: FloatArray | None = None
    """Unit vector (3,) along gravity, down, in the camera's frame (x right, y down, z forward), as the accelerometer
    says: some degrees off while somebody walks. None where there is none, or where it says nothing of use."""


class SonarState(enum.Enum):
    """What the ultrasonic rangefinder can say (Eq. 5)."""

    OK = "ok"
    """An echo came back from ``distance_m``."""
    NO_ECHO = "no_echo"
    """Nothing within range: counts as the sensor's full range, 4.25 m."""
    STALE = "stale"
    """The last reading is too old to be believed: guidance goes on with depth only, and says so."""
    ABSENT = "absent"
    """There is no rangefinder: guidance goes on with depth only, and says so."""


@dataclass(frozen=True, slots=True)
class SonarReading:
    """One reading of the ultrasonic rangefinder."""

    stamp_s: float
    state: SonarState
    distance_m: float | None = None
    """Distance of the nearest echo within the 15° cone; None unless the state is OK."""
    bearing_rad: float = 0.0
    """Direction of the cone's axis, to the left of the camera's; 0 where it has not been measured."""


# ------------------------------------------------------------------------------------------------ localization
class LocalizationQuality(enum.Enum):
    """How far a pose can be trusted."""

    LOCALIZED = "localized"
    UNCERTAIN = "uncertain"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class Pose2D:
    """The paper's P_c(x_c, y_c, θ_c): where the walker is on the floor, and where the camera looks."""

    x_m: float
    y_m: float
    heading: WorldAngle


@dataclass(frozen=True, slots=True, eq=False)
class Localization:
    """What localization says of one frame."""

    stamp_s: float
    quality: LocalizationQuality
    world_from_camera: Transform | None
    """None when lost."""
    covariance: FloatArray | None = None
    """Covariance (6, 6) of (translation, rotation) in the world frame, m² and rad²; None when lost."""
    inlier_count: int = 0
    """Landmarks of the map that agree with the pose."""
    is_held: bool = False
    """The pose stands still because nobody knows how the walker moves on: it does not say that they stand."""

    @property
    def pose(self) -> Pose2D | None:
        """The pose on the floor, or None when lost."""
        if self.world_from_camera is None:
            return None
        x_m, y_m, _ = self.world_from_camera.translation
        return Pose2D(float(x_m), float(y_m), heading_of_camera(self.world_from_camera))


# ---------------------------------------------------------------------------------------------------- planning
@dataclass(frozen=True, slots=True)
class RouteStop:
    """A PoI that a route passes or ends at."""

    poi_id: str
    name: str
    distance_m: float
    """Arc length from the start of the route."""
    spoken_name: str = ""
    """What the walker hears; the name where this is empty."""
    is_silent: bool = False
    """Not announced on the way: a junction to which nobody gave a spoken name means nothing to the walker."""
    kind: str = ""
    """What it is, as the PoI-graph has it ("stairs", "lift", …)."""


@dataclass(frozen=True, slots=True)
class RoutePiece:
    """The part of a route that lies on one edge of the PoI-graph."""

    edge_id: str
    start_m: float
    """Arc length along the route at which it begins."""
    end_m: float
    edge_start_m: float
    """Arc length along the edge, counted from its PoI a, at which it begins; more than ``edge_end_m`` from b to a."""
    edge_end_m: float
    caution_side: CautionSide = "none"
    """On which side something asks for caution, as this piece is walked."""
    width_m: float | None = None
    """Free width of the passage; None where nobody has measured it."""


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """The paper's W: a globally shortest path, as evenly spaced points of the virtual blind road."""

    points_m: FloatArray
    """Points (n, 2), n ≥ 1, about 0.1 m apart; the last one is the destination."""
    arc_length_m: FloatArray
    """Arc length (n,) of each point from the first."""
    stops: tuple[RouteStop, ...] = ()
    """PoIs in the order in which the route passes them; the last is the destination."""
    pieces: tuple[RoutePiece, ...] = ()
    """The edges of the PoI-graph that it runs along, in order; they join without a gap."""
    leads_to_destination: bool = True
    """False for a few steps back: nobody arrives at their end."""

    @property
    def length_m(self) -> float:
        """Length of the whole route."""
        return float(self.arc_length_m[-1])

    def on_edge(self, distance_m: float) -> tuple[str, float] | None:
        """Return the edge at an arc length along the route, and the arc length along that edge; None if unknown."""
        piece = self.piece_at(distance_m)
        if piece is None:
            return None
        share = (distance_m - piece.start_m) / max(piece.end_m - piece.start_m, 1e-9)
        span_m = piece.edge_end_m - piece.edge_start_m
        return piece.edge_id, piece.edge_start_m + min(max(share, 0.0), 1.0) * span_m

    def piece_at(self, distance_m: float) -> RoutePiece | None:
        """Return the piece at an arc length along the route, beyond its end the last one; None if unknown."""
        for piece in self.pieces:
            if distance_m <= piece.end_m or piece is self.pieces[-1]:
                return piece
        return None


# --------------------------------------------------------------------------------------------------- obstacles
@dataclass(frozen=True, slots=True)
class CandidateDirection:
    """One θ_i of the paper's D: a direction in which a corridor of the person's width is free."""

    angle: RelativeAngle
    clearance_m: float
    """How far the corridor is free, up to the sensor's trusted range."""
    free_width_m: float
    """Width of the free corridor at the required distance."""


class BearingState(enum.IntEnum):
    """What the depth image says along one bearing."""

    FREE = 0
    OBSTACLE = 1
    DROP = 2
    UNKNOWN = 3
    HEARD = 4
    """Something that the rangefinder has heard and the image does not show."""


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleScan:
    """The depth image reduced to bearings, and the candidate walkable directions D."""

    bearing_rad: FloatArray
    """Bearings (n,) relative to the heading, ascending (right to left)."""
    nearest_m: FloatArray
    """Horizontal distance (n,) to the nearest obstacle or drop, or to where the unknown begins; inf where free, NaN
    where nothing is known at all."""
    state: NDArray[np.int8]
    """:class:`BearingState` of each bearing (n,)."""
    candidates: tuple[CandidateDirection, ...]
    valid_fraction: float
    """Share of the image's pixels that carry a depth, 0–1."""
    nearest_ahead_m: float | None = None
    """Distance to the nearest obstacle or drop inside the person's own corridor straight ahead; None where free."""
    top_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Height (n,) above the floor of what is nearest in each bearing; 0 for a drop and where nothing is."""
    steepest: FloatArray = field(default_factory=lambda: np.zeros(0))
    """How steeply down (n,) the image shows each bearing, metres down for each metre ahead."""
    eye_m: float = math.nan
    """Height of the camera above the floor."""
    closing_m_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    """How fast (n,) what is nearest in each bearing comes towards the walker by itself; 0 where it stands."""
    unseen_rad: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Bearings (m,) of what is remembered to be in the way, and not in the image."""
    unseen_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Their distances (m,)."""
    tilt_rad: float = math.nan
    """Angle between the image's up and up, as far as the levelling tells: the camera's pitch and roll together."""


# ---------------------------------------------------------------------------------------------------- guidance
class Action(enum.Enum):
    """What the walker is told to do with their feet."""

    WALK = "walk"
    """Walk in the given direction."""
    TURN = "turn"
    """Turn on the spot towards the given direction, without a step."""
    STOP = "stop"


class Reason(enum.Enum):
    """Why the guidance is what it is; the value is the wire's, the sentence is for people."""

    OK = "ok"
    OFF_ROAD = "off_road"
    OBSTACLE_DEPTH = "obstacle_depth"
    OBSTACLE_SONAR = "obstacle_sonar"
    DROP_AHEAD = "drop_ahead"
    NO_CANDIDATE = "no_candidate"
    DEPTH_INVALID = "depth_invalid"
    POSE_LOST = "pose_lost"
    SENSOR_STALE = "sensor_stale"
    CAMERA_MOVED = "camera_moved"
    LOOKS_AWAY = "looks_away"
    ARRIVED = "arrived"
    NO_ROUTE = "no_route"
    PAUSED = "paused"

    @property
    def sentence(self) -> str:
        """The reason in plain words."""
        return _REASON_SENTENCES[self]


_REASON_SENTENCES = {
    Reason.OK: "The way is free.",
    Reason.OFF_ROAD: "Off the road: leading back to it.",
    Reason.OBSTACLE_DEPTH: "The depth camera sees something in the way.",
    Reason.OBSTACLE_SONAR: "The ultrasonic rangefinder hears something in the way.",
    Reason.DROP_AHEAD: "The floor falls away ahead.",
    Reason.NO_CANDIDATE: "No free direction in view.",
    Reason.DEPTH_INVALID: "The depth camera sees too little to be believed.",
    Reason.POSE_LOST: "The place in the map is not known.",
    Reason.SENSOR_STALE: "A sensor has stopped delivering.",
    Reason.CAMERA_MOVED: "The camera has moved: the floor is not where the calibration has it.",
    Reason.LOOKS_AWAY: "The walker looks too far down, up or aslant, or the camera has slipped.",
    Reason.ARRIVED: "The destination is reached.",
    Reason.NO_ROUTE: "No destination is set, or no way leads there.",
    Reason.PAUSED: "Guidance is paused.",
}


class SubGoalCase(enum.IntEnum):
    """The paper's three cases of a sub-goal (step 2, Fig. 5)."""

    STRAIGHT = 1
    """A point at the distance threshold d."""
    TURNING_POINT = 2
    """A corner before d; held until it is reached."""
    DESTINATION = 3
    """The last point of the route."""


@dataclass(frozen=True, slots=True)
class SubGoal:
    """The paper's P_G."""

    x_m: float
    y_m: float
    case: SubGoalCase
    route_index: int
    """Index of the point in the route."""
    passed_index: int = 0
    """Turning points of the route up to this index have been reached and are not taken up again."""


class TurnKind(enum.Enum):
    """Why the walker turns on the spot."""

    ALONG = "along"
    """To where the route leads: at a corner, or at the start."""
    AROUND = "around"
    """The route leads behind them: a U-turn."""
    ASIDE = "aside"
    """To a free direction, round what is in the way."""
    LOOK = "look"
    """To look for a way round: the camera sees a third of what is ahead."""


class Rule(enum.Enum):
    """Which check decided a cycle, in the order in which they are made; what guidance then did is in its action."""

    OFF_DUTY = "off_duty"
    MAPPING = "mapping"
    NO_FRAME = "no_frame"
    """The camera gave nothing fresh."""
    FAULT = "fault"
    """Something was raised in the loop."""
    PAUSED = "paused"
    NO_ROUTE = "no_route"
    START_UNKNOWN = "start_unknown"
    """A destination is wanted, and it is not known yet where the way to it begins."""
    POSE_LOST = "pose_lost"
    NOT_SURE_AGAIN = "not_sure_again"
    """The pose was lost, and is only uncertain since."""
    UNCERTAIN_TOO_LONG = "uncertain_too_long"
    ARRIVED_BEFORE = "arrived_before"
    ARRIVED = "arrived"
    LOOKS_ASIDE = "looks_aside"
    """A look aside for a way round goes on."""
    FAR_ASIDE = "far_aside"
    """θ_exp is far to the side: it is turned to on the spot."""
    DEPTH_INVALID = "depth_invalid"
    NEAR_AHEAD = "near_ahead"
    """Something is nearer than the stop distance."""
    ECHO_NEAR = "echo_near"
    """The rangefinder hears something nearer than the stop distance."""
    NOTHING_FREE = "nothing_free"
    """D is empty: no direction is free for what is required."""
    GATE_CLOSED = "gate_closed"
    """Eq. 5."""
    TURN_FIRST = "turn_first"
    """Something is near ahead of somebody who stands: the free direction is faced before the first step."""
    FREE_FRAMES = "free_frames"
    """Not enough frames in a row have shown the way free since the stop."""
    TO_EXPECTED = "to_expected"
    """Eq. 4: the candidate nearest to θ_exp."""
    TO_STRAIGHT = "to_straight"
    """Eq. 4: the candidate nearest to straight ahead."""
    TO_WIDEST = "to_widest"
    """Nothing is free for δ: the direction that is free farthest."""
    CAMERA_MOVED = "camera_moved"
    DECISION_OLD = "decision_old"
    """Deciding took too long: the decision is of a place where the walker no longer is."""
    SETTLING = "settling"
    """All works again, not for long enough yet."""
    NOT_ALLOWED = "not_allowed"
    """The state of the device allows no such action."""
    WATCHDOG = "watchdog"
    """No decision came in time, or the loop failed: the watchdog has told *Stop* itself."""


@dataclass(frozen=True, slots=True)
class CornerAhead:
    """The next corner of the route at which the walker will be turned on the spot."""

    route_index: int
    distance_m: float
    """Arc length from the closest point to the corner."""
    bend: RelativeAngle
    """By how much the route bends there."""
    turn_m: float
    """So far before the corner the turn itself is due."""


@dataclass(frozen=True, slots=True)
class DecisionTrace:
    """Everything that went into one decision, so that every "stop" can be explained afterwards."""

    heading: WorldAngle | None = None
    """θ_c."""
    position: tuple[float, float] | None = None
    """Where the walker was, metres; None where nothing is known."""
    velocity_m_s: tuple[float, float] = (0.0, 0.0)
    """How fast the walker has been walking lately, and where to, in the world."""
    fastest_m_s: float = 0.0
    """How fast the walker has walked at most, on whatever route: so fast they may be again in a step or two."""
    lost_towards: WorldAngle | None = None
    """Where the walker faced when the pose was last lost in a turn to the route, until they walk: by the other side it
    holds."""
    expected: WorldAngle | None = None
    """θ_exp (Eq. 3)."""
    sub_goal: SubGoal | None = None
    """P_G (Eq. 2)."""
    closest_index: int | None = None
    """Index of P_cls in the route (Eq. 1)."""
    lost_index: int | None = None
    """P_cls when the pose was lost; None while it is known."""
    sure_count: int | None = None
    """Frames in a row with a sure pose since it was lost; None once they were enough, and while it was not."""
    lost_since_s: float | None = None
    """Since when the pose has been lost; None while it is known."""
    deviation_m: float | None = None
    """Distance from the route."""
    offset_m: float = 0.0
    """Road-centred: how far left of the road's middle the walker is led, round what stands on it."""
    goes_round: bool = False
    """The walker walks in a direction to which they were turned, round something, far aside from θ_exp."""
    rejoins: bool = False
    """Beside the road nothing was found that leads on: the walker is led back to the road first."""
    rejoined_from: tuple[float, float] | None = None
    """Where they stood then, the last time, metres."""
    remaining_m: float | None = None
    """Arc length from the closest point to the destination."""
    corner: CornerAhead | None = None
    """The next turn of the route, as far as it can be foreseen."""
    optimal: RelativeAngle | None = None
    """θ_opt (Eq. 4)."""
    candidates: tuple[CandidateDirection, ...] = ()
    """D."""
    nearest_ahead_m: float | None = None
    closing_m_s: float = 0.0
    """How fast what comes towards the walker comes; 0 where everything stands."""
    sonar_state: SonarState = SonarState.ABSENT
    sonar_m: float | None = None
    """d_ultra."""
    required_m: float | None = None
    """Clearance that a direction needed: δ, or the sub-goal and a margin where that is nearer."""
    free_frame_count: int = 0
    """Frames in a row, since a stop, in which the way was free."""
    stopped_since_s: float | None = None
    """Since when the walker has not been walking."""
    turn: TurnKind | None = None
    """Why the walker is turned; None unless they are."""
    look_target: WorldAngle | None = None
    """Where the walker turns to look for a way round what blocks the expected direction."""
    look_count: int = 0
    """Sides that have been looked at since the walker last walked."""
    reversals_count: int = 0
    """How often the walker was turned to the other side since they last walked."""
    uncertain_since_s: float | None = None
    """Since when the pose has not been sure; None while it is."""
    rule: str = ""
    """The rule that decided, in a few words."""
    decided: Rule | None = None
    """The check that decided; None in recordings that are older than this field."""
    among: tuple[RelativeAngle, ...] = ()
    """Those of D that are free as far as was required and lead where the walker is to go: θ_opt is one of them."""
    stop_m: float | None = None
    """Nothing may be nearer than this ahead; None where that was not looked at."""
    gate_m: float | None = None
    """An echo must be farther than this for the gate to open (Eq. 5); None where it was not asked."""
    sonar_bearing_rad: float = 0.0
    """Where the rangefinder looks, to the left of the camera."""
    valid_fraction: float | None = None
    """Share of the depth image's pixels that carry a depth, 0–1; None where no image was looked at."""

    @property
    def speed_m_s(self) -> float:
        """How fast the walker has been walking lately."""
        return math.hypot(*self.velocity_m_s)


@dataclass(frozen=True, slots=True)
class Guidance:
    """The result of one cycle (paper IV-C, Output)."""

    stamp_s: float
    action: Action
    direction: RelativeAngle | None
    """θ_walk (Eq. 5): where to walk or to turn to; None when stopped."""
    reason: Reason
    trace: DecisionTrace = field(default_factory=DecisionTrace)
    route_version: int = 0
    """Changes whenever the route does, so that what was remembered about the old one is dropped."""
