"""A camera that has moved stops guidance, says so, and is told from a head that nods."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_hall import EYE_HEIGHT_M, Rig, empty_hall, pose_at
from device_room import END, START, small_room
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.adapters.fakes import FakeLocalizer
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import replay
from device_agent.recording.walk_files import parts_in
from device_agent.simulation.building import Building, Start, renderer_of
from device_agent.simulation.gait import USUAL_MOUNT
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.walker import drawn_walker
from device_agent.simulation.world import SimulatedWorld
from device_agent.state import DeviceState
from device_agent.walk import Moment, lead
from navcore.calibrating.floor import calibrated_floor
from navcore.calibration import Calibration, FloorCalibration, SonarAlignment
from navcore.geometry import world_from_camera_at
from navcore.modes import Mode
from navcore.obstacle.mounting import LOOK_EVERY_S, FloorDifference, MountingWatch, watched
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.settings import CalibrationSettings, Settings
from navcore.types import Action, Frame, Localization, LocalizationQuality, Reason

UPRIGHT = Calibration(FloorCalibration(1.0, EYE_HEIGHT_M, 0.0, math.radians(15.0), 0.0, 0.0, 0.0, 30))
TURNED_DEG = 8.0
AGREES = FloorDifference(0.0, 0.0, (0.0, 0.0, 0.0))
LIMITS = CalibrationSettings()


def posture(degrees: float) -> tuple[float, float, float]:
    """Return the offset of a floor's normal that is pitched otherwise by so many degrees."""
    pitch_rad = math.radians(15.0)
    turned_rad = pitch_rad + math.radians(degrees)
    return 0.0, math.cos(pitch_rad) - math.cos(turned_rad), math.sin(pitch_rad) - math.sin(turned_rad)


def nodding(frame: Frame, at_s: float, pitch_deg: float) -> Frame:
    """Return the frame as the turned camera shows it: the pose of the localizer does not follow."""
    pose = world_from_camera_at((0.5 + 0.1 * at_s, 0.0, EYE_HEIGHT_M), 0.0, math.radians(pitch_deg))
    return replace(frame, depth_m=empty_hall(pose))


# ------------------------------------------------------------------------------------------------------- laws
def after(watch: MountingWatch, differences: list[FloorDifference | None], begin_s: float = 0.0) -> MountingWatch:
    for number, difference in enumerate(differences):
        watch = watched(watch, difference, begin_s + number * LOOK_EVERY_S, LIMITS)
    return watch


@settings(deadline=None)
@given(st.lists(st.floats(-5.9, 5.9), max_size=80))
def test_what_is_within_the_tolerance_never_counts(tilts_deg: list[float]) -> None:
    looks: list[FloorDifference | None] = [
        FloorDifference(tilt / 30.0, abs(math.radians(tilt)), posture(tilt)) for tilt in tilts_deg
    ]
    assert not after(MountingWatch(), looks).moved


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), max_size=8))
def test_a_head_that_comes_up_again_and_again_is_no_camera_that_has_moved(looks: list[tuple[int, int]]) -> None:
    """Looks at one's feet of two seconds, and places where no floor is in view."""
    low = FloorDifference(0.0, 0.0, posture(25.0))
    seen: list[FloorDifference | None] = [AGREES] * 4
    for low_count, unseen_count in looks:
        seen += [*[low] * low_count, *[None] * unseen_count, *[AGREES] * 8]
    assert not after(MountingWatch(), seen).moved


def test_each_kind_of_disagreement_counts_after_its_time() -> None:
    agreed = after(MountingWatch(), [AGREES] * 3)
    cases = {
        "height": (FloorDifference(-0.3, 0.0, (0.0, 0.0, 0.0)), LIMITS.moved_after_s),
        "tilt": (FloorDifference(0.0, math.radians(8.0), posture(8.0)), LIMITS.moved_after_s),
        "posture": (FloorDifference(0.0, 0.0, posture(8.0)), LIMITS.posture_after_s),
        "no number": (FloorDifference(math.nan, None, (0.0, 0.0, 0.0)), LIMITS.moved_after_s),
    }
    for name, (difference, patience_s) in cases.items():
        count = round(patience_s / LOOK_EVERY_S)
        assert not after(agreed, [difference] * (count - 1), 1.5).moved, name
        # The mean over a stride takes its time to follow.
        assert after(agreed, [difference] * (count + 6 if name == "posture" else count), 1.5).moved, name


def test_before_the_floor_has_ever_agreed_there_is_less_patience() -> None:
    turned: list[FloorDifference | None] = [FloorDifference(0.0, None, posture(8.0))] * 5
    assert after(MountingWatch(), turned).moved
    assert not after(after(MountingWatch(), [AGREES]), turned, 0.5).moved


def test_unknown_neither_clears_nor_confirms() -> None:
    moved = after(MountingWatch(), [FloorDifference(0.4, None, (0.0, 0.0, 0.0))] * 6)
    assert moved.moved
    assert after(moved, [None] * 100, 3.0).moved
    assert not after(moved, [AGREES] * 6, 3.0).moved
    assert not after(after(MountingWatch(), [AGREES]), [None] * 100, 1.0).moved


# ---------------------------------------------------------------------------------------------------- the agent
def test_the_walker_is_stopped_and_told_and_led_on_once_it_agrees() -> None:
    rig = Rig(calibration=UPRIGHT)
    assert rig.lead_to().guidance.action is Action.WALK
    assert all(cycle.guidance.action is Action.WALK for cycle in rig.cycles(30))
    rig.spoil = lambda frame: nodding(frame, 0.0, 15.0 + TURNED_DEG)
    rig.cycles(round(10 * LIMITS.moved_after_s) + 6)
    stopped = rig.cycles(1)[0].guidance
    assert (stopped.action, stopped.reason) == (Action.STOP, Reason.CAMERA_MOVED)
    assert "8°" in stopped.trace.rule
    assert rig.agent.state.mode is Mode.FAULT
    assert "Stop. The camera has moved." in [cue.text for cue in rig.output.cues]
    assert any("vbr calibrate floor" in text for text in rig.events("sensor"))
    rig.spoil = lambda frame: frame
    rig.cycles(30)
    # The turned camera took the floor for something in the way: that is looked round for, and then walked past.
    assert rig.cycles(1)[0].guidance.action is not Action.STOP
    assert rig.agent.state.mode is Mode.GUIDING
    assert "The camera sees the floor as it was calibrated again." in rig.events("sensor")


def test_at_the_start_nobody_is_led_off_by_a_camera_that_has_moved() -> None:
    rig = Rig(calibration=UPRIGHT)
    rig.pose = world_from_camera_at((0.5, 0.0, EYE_HEIGHT_M - 0.5), 0.0, math.radians(15.0))
    rig.cycles(25)
    assert "The camera has moved. Hold your head level and straighten the glasses." in [
        cue.text for cue in rig.output.cues
    ]
    rig.lead_to()
    assert all(cycle.guidance.action is Action.STOP for cycle in rig.cycles(40))


def test_without_a_calibration_nothing_is_compared() -> None:
    rig = Rig()
    rig.spoil = lambda frame: nodding(frame, 0.0, 15.0 + TURNED_DEG)
    rig.lead_to()
    rig.cycles(100)
    assert rig.agent.state.mounting == MountingWatch()


def test_a_nod_of_a_head_with_gravity_or_pose_is_none() -> None:
    rig = Rig(calibration=UPRIGHT)
    rig.lead_to()
    for number in range(120):
        rig.pose = world_from_camera_at(
            (0.5, 0.0, EYE_HEIGHT_M), 0.0, math.radians(15.0 + 14.0 * math.sin(number / 6.0))
        )
        assert rig.cycles(1)[0].guidance.reason is not Reason.CAMERA_MOVED


def test_whoever_looks_at_their_feet_for_long_is_stopped_told_to_look_ahead_and_led_on_when_they_do() -> None:
    rig = Rig(calibration=UPRIGHT)
    rig.lead_to()
    rig.cycles(20)
    rig.pose = world_from_camera_at((0.5, 0.0, EYE_HEIGHT_M), 0.0, math.radians(15.0 + 20.0))
    stopped = rig.cycles(round(10 * (LIMITS.posture_after_s + 3.5)))[-1].guidance
    assert (stopped.action, stopped.reason) == (Action.STOP, Reason.LOOKS_AWAY)
    assert "Stop. Look ahead, or straighten the glasses." in [cue.text for cue in rig.output.cues]
    rig.pose = pose_at(0.5)
    rig.cycles(60)
    assert rig.cycles(1)[0].guidance.action is not Action.STOP
    assert not rig.agent.state.mounting.by_posture


def test_gravity_tells_a_turned_camera_where_the_pose_turns_with_it() -> None:
    """An accelerometer on the glasses' frame: the camera turns, its gravity does not."""
    floor = UPRIGHT.floor
    assert floor is not None
    rig = Rig(calibration=Calibration(replace(floor, up_from_gravity_rad=(0.0, 0.0, 0.0))))
    down = -pose_at(0.0).rotation[2]
    rig.spoil = lambda frame: replace(frame, gravity=down)
    rig.lead_to()
    rig.cycles(20)
    rig.pose = world_from_camera_at((0.5, 0.0, EYE_HEIGHT_M), 0.0, math.radians(15.0 + TURNED_DEG))
    reasons = [cycle.guidance.reason for cycle in rig.cycles(round(10 * LIMITS.moved_after_s) + 10)]
    assert reasons[-1] is Reason.CAMERA_MOVED


def test_the_walk_of_a_moved_camera_is_replayed_to_the_last_bit(tmp_path: Path) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path))
    rig = Rig(calibration=UPRIGHT, tap=recorder)
    rig.lead_to()
    rig.spoil = lambda frame: nodding(frame, 0.0, 15.0 + TURNED_DEG)
    rig.cycles(60)
    recorder.check()
    recorder.close()
    again = list(replay(RecordedPart(path) for path in parts_in(tmp_path)))
    assert not [cycle.differs_in for cycle in again if cycle.differs_in]
    assert again[-1].cycle.guidance.reason is Reason.CAMERA_MOVED


def test_the_rangefinders_alignment_reaches_the_gate() -> None:
    aligned = Rig(calibration=Calibration(sonar=SonarAlignment(1.0, 0.0, 0.0, -0.3, 0.0, 0.0, 60)))
    plain = Rig()
    for rig in (aligned, plain):
        rig.lead_to()
        rig.sonar.echo(1.8)
    heard = [rig.agent.run_cycle().guidance for rig in (aligned, plain)]
    assert [guidance.trace.sonar_m for guidance in heard] == [pytest.approx(2.1), pytest.approx(1.8)]
    assert [guidance.action for guidance in heard] == [Action.WALK, Action.STOP]


# ------------------------------------------------------------------------------------------------ the simulator
@pytest.fixture(scope="module")
def room() -> tuple[Building, Renderer]:
    building = small_room()
    return building, renderer_of(building)


GRAPH = PoiGraph(
    1,
    {"a": Poi("a", START.name, "hall", START.x_m, START.y_m), "b": Poi("b", END.name, "bar", END.x_m, END.y_m)},
    {"ab": Edge("ab", "a", "b", ((START.x_m, START.y_m), (END.x_m, END.y_m)), END.x_m - START.x_m)},
)


def world_in(room: tuple[Building, Renderer]) -> SimulatedWorld:
    return SimulatedWorld(room[0], drawn_walker(2), Start(START.x_m, START.y_m, 0.0), 2, renderer=room[1])


def calibrated_in(room: tuple[Building, Renderer]) -> Calibration:
    world = world_in(room)
    frames = []
    for _ in range(12):
        world.advance(0.1)
        frames.append(world.capture())
    return Calibration(calibrated_floor(frames, world.camera, 0.0))


def led(room: tuple[Building, Renderer], knocked_after_s: float) -> list[Moment]:
    world, moments = world_in(room), []
    turned = replace(USUAL_MOUNT, pitch_down_deg=USUAL_MOUNT.pitch_down_deg - TURNED_DEG)

    def located(frame: Frame) -> Localization:
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, world.true_head(), np.eye(6) * 1e-4, 200)

    def meanwhile(moment: Moment) -> None:
        moments.append(moment)
        if world.now_s() >= knocked_after_s:
            world.knock(turned)

    state = DeviceState(Settings(), GRAPH, "room", calibration=calibrated_in(room))
    lead(world, state, FakeLocalizer(located), "b", max_s=22.0, meanwhile=meanwhile)
    return moments


def test_in_the_simulator_a_camera_turned_by_8_degrees_on_the_way_stops_the_walk(
    room: tuple[Building, Renderer],
) -> None:
    moments = led(room, knocked_after_s=0.8)
    reasons = [moment.cycle.guidance.reason for moment in moments]
    assert reasons[7] is Reason.OK
    # Its pose is tilted with it: only the posture tells, and that may be the head's.
    assert reasons[-1] is Reason.LOOKS_AWAY
    first = reasons.index(Reason.LOOKS_AWAY)
    since_s = moments[first].cycle.stamp_s - 0.8
    assert since_s < LIMITS.posture_after_s + 3.5
    assert all(moment.cycle.guidance.action is Action.STOP for moment in moments[first:])


def test_in_the_simulator_a_walker_whose_camera_stays_hears_nothing_of_it(room: tuple[Building, Renderer]) -> None:
    moments = led(room, knocked_after_s=math.inf)
    assert moments[-1].agent.state.purpose is Mode.ARRIVED
    assert moments[-1].agent.state.mounting.has_agreed
    assert not {Reason.CAMERA_MOVED, Reason.LOOKS_AWAY} & {moment.cycle.guidance.reason for moment in moments}
