"""A map walk ordered from the console: obeyed while nobody is led, heard by whoever wears the glasses, and shown."""

from __future__ import annotations

from pathlib import Path

import pytest
from map_walk_rig import MapRig, covered, walk_frames

from device_agent.map_walk.map_walks import DeviceMapWalks, WalkPlan
from device_agent.map_walk.walk_folder import read_state
from device_agent.orders import carry_out
from device_agent.ports import Button, PressKind
from device_agent.simulation.sensors import head_camera
from device_agent.state import DeviceState, MapWalkTold, Notice
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.recording import read_marks
from navcore.settings import Settings
from navcore.types import Frame
from navcore.wire import BeginMapWalk, ConsoleMessage, EndMapWalk, MapWalkRunning, MapWalkSeen


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return walk_frames(max_length_m=3.0)


def ordered(rig: MapRig, order: ConsoleMessage, frame: Frame) -> list[str]:
    rig.agent.submit(order)
    return [cue.text for cue in rig.show(frame) if cue.text]


def answers(rig: MapRig) -> list[MapWalkRunning]:
    return [message for message in rig.uplink.messages if isinstance(message, MapWalkRunning)]


def test_the_console_begins_and_ends_a_map_walk_and_whoever_wears_it_hears_so(
    tmp_path: Path, frames: list[Frame]
) -> None:
    rig = MapRig(tmp_path, owns_map=False)
    said = ordered(rig, BeginMapWalk(), frames[0])
    assert TEXTS["en"]["map_begun_console"] in said
    assert rig.agent.state.mode is Mode.MAPPING
    rig.walk(frames)
    said = ordered(rig, EndMapWalk(), frames[-1])
    assert TEXTS["en"]["map_ended_console"] in said
    assert rig.agent.state.mode is Mode.LOCALIZING
    assert answers(rig) == [MapWalkRunning(True), MapWalkRunning(False)]
    assert read_state(rig.walk_folder).stage == "handed_over"


def test_the_walker_can_end_what_the_console_began(tmp_path: Path, frames: list[Frame]) -> None:
    rig = MapRig(tmp_path, owns_map=False)
    ordered(rig, BeginMapWalk(), frames[0])
    rig.walk(frames[:5])
    rig.press(Button.MAIN, PressKind.LONG, frames[5])
    assert rig.agent.state.mode is not Mode.MAPPING
    assert answers(rig)[-1] == MapWalkRunning(False)
    ordered(rig, EndMapWalk(), frames[5])
    assert answers(rig)[-1].refusal, "there is none to be ended any more"


@pytest.mark.parametrize("mode", list(Mode))
def test_only_where_nobody_is_led_and_the_device_is_on_duty_is_it_begun(mode: Mode) -> None:
    beneath = Mode.GUIDING if mode is Mode.FAULT else None
    state = DeviceState(Settings(), PoiGraph(), mode=mode, beneath=beneath, destination_id="bar")
    after, effects = carry_out(state, BeginMapWalk(), 1.0)
    (answer,) = [effect for effect in effects if isinstance(effect, MapWalkRunning)]
    if mode in (Mode.LOCALIZING, Mode.READY, Mode.ARRIVED):
        assert after.purpose is Mode.MAPPING
        assert answer == MapWalkRunning(True)
    else:
        assert after.mode is mode
        assert answer.refusal == state.purpose.sentence
        assert answer.is_running is (mode is Mode.MAPPING)
        assert any(isinstance(effect, Notice) for effect in effects), "the refusal is heard as well"


def map_walks(tmp_path: Path, told: list[MapWalkTold], shown: list[MapWalkSeen]) -> DeviceMapWalks:
    plan = WalkPlan(tmp_path / "map-walks", tmp_path / "site", owns_map=False, beside=False)
    return DeviceMapWalks(
        plan, head_camera(320, 240), lambda *_: None, told.append, show=shown.append  # type: ignore[arg-type, return-value]
    )  # fmt: skip


def test_what_is_seen_of_the_building_is_shown_as_it_comes(tmp_path: Path, frames: list[Frame]) -> None:
    told: list[MapWalkTold] = []
    shown: list[MapWalkSeen] = []
    walks = map_walks(tmp_path, told, shown)
    walks.begin(Settings())
    for frame in frames[:10]:
        walks.take(frame)
    walks.mark("Place 1")
    assert shown[-1].troubles == ()
    assert shown[-1].landmark_count > 30
    assert shown[-1].recorded_s == pytest.approx(frames[9].stamp_s - frames[0].stamp_s)
    for frame in map(covered, frames[10:]):
        walks.take(frame)
    assert shown[-1].troubles[0] == shown[-1].last_advice == "covered"
    assert shown[-1].place_count == 1
    assert 0.0 < shown[-1].weak_s < shown[-1].recorded_s
    assert len(shown) == len(frames)


def test_a_place_marked_while_the_place_is_lost_is_said_to_be_unsure(tmp_path: Path, frames: list[Frame]) -> None:
    told: list[MapWalkTold] = []
    walks = map_walks(tmp_path, told, [])
    walks.begin(Settings())
    for frame in frames[:10]:
        walks.take(frame)
    walks.mark("Place 1")
    assert not told
    elsewhere = walk_frames(waypoints_m=((9.0, 0.5), (9.0, 1.5)), max_length_m=0.3)[0]
    for number in range(5):
        walks.take(Frame(frames[9].stamp_s + 0.1 * (number + 1), elsewhere.colour_rgb, elsewhere.depth_m))
    walks.mark("Place 2")
    unsure = [each for each in told if each.phrases[0].key == "map_place_unsure"]
    assert [each.text("en") for each in unsure] == [
        "Place 2 may not come into the map: mark it again once the place is found."
    ]
    assert unsure[0].kind is CueKind.MAP_ADVICE
    walks.end()
    (walk,) = (tmp_path / "map-walks").iterdir()
    assert [mark.name for mark in read_marks(walk / "marks.txt")] == ["Place 1", "Place 2"], "it is kept all the same"
