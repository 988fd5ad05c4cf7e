"""Where the rangefinder looks and what it is off by, from the simulator's own sonar before a bare wall."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.adapters.fakes import NoSonar
from device_agent.calibration_store import CalibrationStore
from device_agent.cli import main
from device_agent.simulation.bare_wall import WALL_X_M, bare_wall
from device_agent.simulation.sonar import SonarModel
from navcore.angles import relative_angle
from navcore.calibrating.sonar import expected_echo_m, measured_sonar, wall_plane
from navcore.calibration import SonarAlignment
from navcore.errors import InputError
from navcore.follower.gate import is_open
from navcore.geometry import Transform, rotation_from_rotvec, world_from_camera_at
from navcore.settings import GateSettings
from navcore.types import CameraIntrinsics, Frame, SonarReading, SonarState

CAMERA = CameraIntrinsics(160, 120, 116.4, 116.4, 79.5, 59.5)
HALF_FIELD_RAD = math.radians(7.5)
_ROWS, _COLS = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
_RAYS = np.stack(
    [(_COLS - CAMERA.cx_px) / CAMERA.fx_px, (_ROWS - CAMERA.cy_px) / CAMERA.fy_px, np.ones(_ROWS.shape)], -1
)
COLOUR = np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.uint8)


def head_at(away_m: float, turn_deg: float) -> Transform:
    return world_from_camera_at((WALL_X_M - away_m, 0.0, 1.6), math.radians(turn_deg), math.radians(15.0))


def depth_of_wall(head: Transform, rng: np.random.Generator) -> np.ndarray:
    directions = _RAYS @ head.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        wall = np.where(directions[..., 0] > 0, (WALL_X_M - head.translation[0]) / directions[..., 0], np.inf)
        floor = np.where(directions[..., 2] < 0, -head.translation[2] / directions[..., 2], np.inf)
    depth = np.minimum(wall, floor)
    depth += rng.normal(0.0, 1.0, depth.shape) * 0.0017 * np.minimum(depth, 9.0) ** 2
    depth[depth > 8.0] = np.nan
    return depth.astype(np.float32)


def sensed(
    bearing_deg: float, bias_m: float, spots: list[tuple[float, float]], seed: int = 0
) -> list[tuple[Frame, SonarReading | None]]:
    """Return what camera and rangefinder sense; the latter is turned to the left by so much, and off by so much."""
    building = bare_wall()
    model, rng, pairs = SonarModel(building.surfaces, (), seed), np.random.default_rng(seed), []
    turned = rotation_from_rotvec(np.array([0.0, -math.radians(bearing_deg), 0.0]))
    for number, (away_m, turn_deg) in enumerate(spots):
        head, stamp_s = head_at(away_m, turn_deg), 0.1 * number
        sonar = head @ Transform.from_rotation_translation(turned, np.zeros(3))
        reading = model.measure(stamp_s, sonar, number)
        if reading.distance_m is not None:
            reading = SonarReading(stamp_s, reading.state, reading.distance_m + bias_m)
        pairs.append((Frame(stamp_s, COLOUR, depth_of_wall(head, rng)), reading))
    return pairs


SPOTS = [(away_m, turn_deg) for away_m in (1.0, 1.5, 2.0, 2.5) for turn_deg in range(-28, 29, 4)]


@pytest.mark.parametrize(("bearing_deg", "bias_m"), [(0.0, 0.0), (6.0, 0.05), (-9.0, -0.08)])
def test_bearing_and_bias_are_found(bearing_deg: float, bias_m: float) -> None:
    found = measured_sonar(sensed(bearing_deg, bias_m, SPOTS), CAMERA, HALF_FIELD_RAD, 3.0)
    assert math.degrees(found.bearing_rad) == pytest.approx(bearing_deg, abs=1.5)
    assert found.bias_m == pytest.approx(bias_m, abs=0.02)
    assert found.residual_m < 0.04
    assert found.made_s == 3.0


def test_some_wild_echoes_do_no_harm() -> None:
    pairs = sensed(4.0, 0.03, SPOTS)
    for number in range(0, len(pairs), 10):
        pairs[number] = (pairs[number][0], SonarReading(pairs[number][0].stamp_s, SonarState.OK, 0.4))
    found = measured_sonar(pairs, CAMERA, HALF_FIELD_RAD, 0.0)
    assert math.degrees(found.bearing_rad) == pytest.approx(4.0, abs=2.0)
    assert found.bias_m == pytest.approx(0.03, abs=0.03)


@pytest.mark.parametrize(
    ("pairs", "sentence"),
    [
        ([], "A wall was seen in 0 of 0 frames"),
        (sensed(0.0, 0.0, [(6.5, turn) for turn in range(40)]), "face a bare, flat wall"),
        ([(frame, None) for frame, _ in sensed(0.0, 0.0, SPOTS)], "vbr doctor"),
        (sensed(0.0, 0.0, [(1.5, turn) for turn in np.linspace(-25, 25, 50)]), "walk slowly"),
        (sensed(0.0, 0.0, [(away, 0.0) for away in np.linspace(1, 2.5, 50)]), "turn slowly"),
        (sensed(0.0, 0.45, SPOTS), "does not agree"),
    ],
    ids=["nothing", "no wall", "no echo", "one distance", "no turn", "far off"],
)
def test_what_leaves_something_open_is_refused_with_what_to_do(
    pairs: list[tuple[Frame, SonarReading | None]], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        measured_sonar(pairs, CAMERA, HALF_FIELD_RAD, 0.0)


def test_the_floor_is_no_wall() -> None:
    head = world_from_camera_at((0.0, 0.0, 1.6), 0.0, math.radians(50.0))
    assert wall_plane(depth_of_wall(head, np.random.default_rng(0)), CAMERA) is None


@settings(deadline=None)
@given(st.floats(0.5, 4.0), st.floats(-0.5, 0.5), st.floats(-0.4, 0.4))
def test_within_the_cone_the_perpendicular_is_heard_and_never_less(wall_m: float, turn: float, bearing: float) -> None:
    normals = np.array([[-math.sin(turn), 0.0, math.cos(turn)]])
    echo_m = float(expected_echo_m(np.array([wall_m]), normals, HALF_FIELD_RAD, bearing, 0.0)[0])
    assert echo_m >= wall_m - 1e-9
    outside_rad = max(0.0, abs(turn - bearing) - HALF_FIELD_RAD)
    assert echo_m == pytest.approx(wall_m / math.cos(outside_rad))


@settings(deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-0.5, 0.5), st.floats(0.1, 4.0), st.sampled_from([0.01, 0.2]))
def test_the_gate_closes_about_where_the_rangefinder_looks(
    direction: float, bearing: float, echo_m: float, bias_m: float
) -> None:
    alignment = SonarAlignment(1.0, bearing, 0.0, bias_m, 0.0, 0.0, 60)
    reading = alignment.aligned(SonarReading(1.0, SonarState.OK, echo_m))
    inside = abs(direction - bearing) <= HALF_FIELD_RAD
    is_near = echo_m - bias_m <= 2.0
    assert is_open(relative_angle(direction), reading, 2.0, GateSettings()) == (not (inside and is_near))
    blind = alignment.aligned(NoSonar(_Still()).read())
    assert is_open(relative_angle(direction), blind, 2.0, GateSettings())


class _Still:
    def now_s(self) -> float:
        return 1.0

    def sleep_until(self, stamp_s: float) -> None: ...


def test_the_command_aligns_the_simulators_rangefinder(tmp_path: Path) -> None:
    assert main(["calibrate", "sonar", "--simulated", "--state", str(tmp_path)]) == 0
    stored = CalibrationStore(tmp_path).load()
    assert stored is not None
    assert stored.calibration.sonar is not None
    assert abs(math.degrees(stored.calibration.sonar.bearing_rad)) < 2.0
    assert abs(stored.calibration.sonar.bias_m) < 0.03
