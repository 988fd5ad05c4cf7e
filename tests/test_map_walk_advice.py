"""What the sighted person hears in a simulated building: the right advice for what they do wrong, else nothing."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from map_walk_rig import MapRig, covered, darkened, paced, walk_frames

from device_agent.simulation.blank_corridor import blank_corridor
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.errors import SensorError
from navcore.modes import Mode
from navcore.types import Action, Frame

GUIDING_KINDS = {
    CueKind.WALK, CueKind.TURN, CueKind.STEER, CueKind.TICK, CueKind.OBSTACLE_BEEP, CueKind.ARRIVED,
    CueKind.HAZARD_AHEAD, CueKind.CAUTION_SIDE, CueKind.NARROW_PASSAGE, CueKind.TURN_AHEAD, CueKind.REASSURANCE,
    CueKind.POI_AHEAD, CueKind.DEVIATION,
}  # fmt: skip


def words(name: str) -> str:
    return TEXTS["en"][f"map_walk_{name}"]


@pytest.fixture(scope="module")
def good_walk() -> list[Frame]:
    """Seven metres through the room, and a look at its end."""
    return walk_frames(max_length_m=7.0)


def advice_on(folder: Path, frames: list[Frame]) -> list[str]:
    rig = MapRig(folder)
    rig.begin(frames[0])
    rig.walk(frames)
    assert {cue.kind for cue in rig.output.cues}.isdisjoint(GUIDING_KINDS)
    rig.walks.close()
    return rig.said(CueKind.MAP_ADVICE)


def test_a_good_walk_hears_nothing(tmp_path: Path, good_walk: list[Frame]) -> None:
    assert advice_on(tmp_path, good_walk) == []


def test_a_walk_too_quick_is_asked_to_slow_down(tmp_path: Path, good_walk: list[Frame]) -> None:
    said = advice_on(tmp_path, paced(good_walk[::3]))
    assert words("slow_down") in said


def test_whoever_looks_at_the_floor_is_asked_to_look_ahead(tmp_path: Path) -> None:
    frames = walk_frames(
        max_length_m=5.0, turned=lambda stamp_s: math.radians(min(55.0, max(0.0, 40.0 * (stamp_s - 1.5))))
    )
    assert set(advice_on(tmp_path, frames)) == {words("look_ahead")}


def test_a_blank_stretch_is_called_weak(tmp_path: Path) -> None:
    frames = walk_frames(blank_corridor(), ((4.0, 1.2), (13.0, 1.2)), max_length_m=8.0)
    rig = MapRig(tmp_path)
    rig.begin(frames[0])
    rig.walk(frames)
    assert set(rig.said(CueKind.MAP_ADVICE)) == {words("weak")}
    noted = (rig.walk_folder / "coverage.txt").read_text(encoding="utf-8")
    assert {line.split()[1] for line in noted.splitlines()} == {"weak"}
    rig.walks.close()


def test_a_covered_camera_and_the_dark_are_told_apart(tmp_path: Path, good_walk: list[Frame]) -> None:
    begin = good_walk[:10]
    assert set(advice_on(tmp_path / "covered", [*begin, *map(covered, good_walk[10:40])])) == {words("covered")}
    assert set(advice_on(tmp_path / "dark", [*begin, *map(darkened, good_walk[10:45])])) == {words("dark")}


def test_a_place_that_was_lost_is_found_again_where_it_was_known(tmp_path: Path, good_walk: list[Frame]) -> None:
    elsewhere = walk_frames(blank_corridor(), ((20.8, 14.4), (20.8, 13.0)), max_length_m=0.5)[0]
    rig = MapRig(tmp_path)
    rig.begin(good_walk[0])
    rig.walk([*good_walk[:25], *[elsewhere] * 45, *good_walk[20:25], *[good_walk[25]] * 15])
    assert words("lost") in rig.said(CueKind.MAP_ADVICE)
    assert rig.said(CueKind.MAP_NEWS) == [words("found")]
    rig.walks.close()


def test_nothing_can_guide_in_a_map_walk_whatever_happens(tmp_path: Path, good_walk: list[Frame]) -> None:
    rig = MapRig(tmp_path)
    rig.begin(good_walk[0])
    for number, frame in enumerate(good_walk[:40]):
        rig.show(SensorError("The camera delivers no pictures.") if number % 20 == 5 else frame)
        assert rig.agent.state.purpose is Mode.MAPPING
        assert rig.agent.state.guidance is not None
        assert rig.agent.state.guidance.action is Action.STOP
    assert TEXTS["en"]["map_no_picture"] in rig.said(CueKind.MAP_ADVICE), "silence would mean that all is well"
    assert {cue.kind for cue in rig.output.cues}.isdisjoint(GUIDING_KINDS)
    rig.walks.close()
