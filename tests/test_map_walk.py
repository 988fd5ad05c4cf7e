"""Map walks from the first press to the map that is put in use, and what becomes of them when something fails."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_room import small_room
from map_walk_rig import MapRig, walk_frames

from device_agent.cli import main
from device_agent.device_store import previous_site, restore_previous
from device_agent.localization import make_localizer
from device_agent.map_walk.map_walks import MAX_ATTEMPTS, DeviceMapWalks, WalkPlan
from device_agent.map_walk.recorder import RESERVE_BYTES, WalkRecording
from device_agent.map_walk.report import report_told
from device_agent.map_walk.tracker import WalkTracker
from device_agent.map_walk.walk_folder import (
    STATE_FILE,
    WalkState,
    handed_over,
    new_walk,
    read_state,
    write_state,
)
from device_agent.orders import Order
from device_agent.ports import Button, PressKind
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import replay
from device_agent.recording.walk_files import parts_in
from device_agent.simulation.sensors import head_camera
from device_agent.state import MapWalkTold, PreparedMap
from device_agent.walk import run_walk
from navcore.coverage import Sight
from navcore.cues.table import CueKind
from navcore.cues.texts import TEXTS
from navcore.errors import InputError, RecordingError
from navcore.live_recording import mend_recording
from navcore.modes import Mode
from navcore.recording import Mark, RecordingWriter, open_recording, read_marks
from navcore.settings import Settings
from navcore.site import load_site, map_checksum
from navcore.types import Frame, LocalizationQuality

TESTS = Path(__file__).parent
DEADLINE_S = 120.0


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return walk_frames(max_length_m=4.5)


class FailingTracker(WalkTracker):
    def see(self, frame: Frame) -> Sight:
        raise ZeroDivisionError


def said(rig: MapRig) -> list[str]:
    return [cue.text for cue in rig.output.cues if cue.text]


def walked(rig: MapRig, frames: list[Frame], mark_at: tuple[int, ...] = (4, 48)) -> None:
    """Walk through all frames by the buttons alone; a place is marked at some of them."""
    rig.begin(frames[0])
    for number, frame in enumerate(frames):
        if number in mark_at:
            rig.press(Button.MAIN, PressKind.SHORT, frame)
        else:
            rig.show(frame)
    rig.end(frames[-1])


# ------------------------------------------------------------------------------------------------ the whole of it
def test_from_the_first_press_to_a_guided_walk_in_the_new_map(tmp_path: Path, frames: list[Frame]) -> None:
    rig = MapRig(tmp_path)
    walked(rig, frames)
    assert rig.agent.state.mode is Mode.LOCALIZING
    for _ in range(40):
        rig.show(frames[-1])
    assert rig.agent.state.mode is Mode.READY, "the new map is in use, and the device knows where it is"
    assert rig.agent.state.located is not None
    assert rig.agent.state.located.quality is LocalizationQuality.LOCALIZED
    heard = said(rig)
    for key in ("map_offered", "map_begun", "map_ended"):
        assert TEXTS["en"][key] in heard
    assert "Place 1 is marked." in heard
    assert any(text.startswith("The new map is in use. Road: 4 metres. Places: 2. Loops: 0.") for text in heard)
    assert any(text.startswith("Building the map: 50") for text in rig.uplink_texts)

    site = load_site(rig.site)
    assert {poi.name for poi in site.poi_graph.pois.values()} == {"Place 1", "Place 2"}
    assert site.report["places"] == 2
    assert site.report["weak_stretches"] == []
    assert (site.sessions[0].name, site.sessions[0].date) == ("walk-0001", "2026-11-29")
    assert read_state(rig.walk_folder).stage == "built"
    result = run_walk(site, small_room(), "Start", "Place 2", seed=3, max_s=40.0)
    assert result.arrived, result.outcome
    assert result.contacts == 0


def test_the_map_is_taken_between_walks_only_and_the_one_before_can_be_restored(
    tmp_path: Path, frames: list[Frame], capsys: pytest.CaptureFixture[str]
) -> None:
    rig = MapRig(tmp_path)
    walked(rig, frames[:30], ())
    rig.show(frames[0])
    first = map_checksum(rig.site)
    rig.begin(frames[0])
    rig.walk(frames)
    # The map is ready before the state is left, as one may be that was begun earlier.
    rig.walks.end()
    rig.walk(frames[:3])
    assert rig.agent.state.waiting_map is not None
    assert map_checksum(rig.site) == first, "a map that is ready waits while one is recorded"
    rig.end(frames[0])
    second = map_checksum(rig.site)
    assert second != first
    assert map_checksum(previous_site(rig.site)) == first
    assert main(["map", "restore", str(rig.site)]) == 0
    assert (map_checksum(rig.site), map_checksum(previous_site(rig.site))) == (first, second)
    load_site(rig.site)
    assert main(["map", "restore", str(tmp_path / "nowhere")]) == 2
    assert "No earlier map" in capsys.readouterr().err


def test_a_recorded_map_walk_is_replayed_to_the_last_word(tmp_path: Path, frames: list[Frame]) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path / "mcap", False, reserve_bytes=0))
    rig = MapRig(tmp_path, Settings().changed({"map_walk.build_here": False}), tap=recorder)
    walked(rig, [*frames[:15], *frames[15:40:3]])
    rig.walk(frames[:30])
    recorder.close()
    cycles = list(replay([RecordedPart(path) for path in parts_in(tmp_path / "mcap")]))
    assert all(not cycle.differs_in for cycle in cycles)
    again = [cue.text for cycle in cycles for cue in cycle.cues if cue.text]
    assert again == said(rig)
    assert any("Recorded" in text for text in again)


# --------------------------------------------------------------------------------------------------- handing over
def test_where_the_map_is_built_elsewhere_the_recording_is_left_with_checksums(
    tmp_path: Path, frames: list[Frame]
) -> None:
    rig = MapRig(tmp_path, owns_map=False)
    walked(rig, frames[:30], (4,))
    rig.walk(frames[:30])
    walk = rig.walk_folder
    assert read_state(walk).stage == "handed_over"
    assert TEXTS["en"]["map_handed_over"].format(places=1) in said(rig)
    copy = tmp_path / "copied"
    shutil.copytree(walk, copy)
    check = ["sha256sum", "--check", "--quiet", "SHA256SUMS"]
    assert subprocess.run(check, cwd=copy).returncode == 0
    assert len(open_recording(copy)) == 31
    (mark,) = read_marks(copy / "marks.txt")
    assert mark.name == "Place 1"
    picture = next((copy / "depth").iterdir())
    picture.write_bytes(picture.read_bytes()[:-1])
    assert subprocess.run(check, cwd=copy, capture_output=True).returncode != 0


# ------------------------------------------------------------------------------------------------------- failures
def test_a_device_that_is_killed_loses_seconds_at_most_and_what_is_left_is_built_at_the_next_start(
    tmp_path: Path,
) -> None:
    taken: list[tuple[int, float]] = []
    victim = subprocess.Popen(
        [sys.executable, str(TESTS / "map_walk_victim.py"), str(tmp_path)],
        stdout=subprocess.PIPE, text=True, cwd=TESTS, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert victim.stdout is not None
    try:
        for line in victim.stdout:
            number, at_s = line.split()
            taken.append((int(number), float(at_s)))
            if len(taken) == 40:
                break
    finally:
        victim.send_signal(signal.SIGKILL)
        victim.wait()
    walk = tmp_path / "map-walks" / "walk-0001"
    last_s = float((walk / "associations.txt").read_bytes().decode().splitlines()[-1].split()[0])
    # A busy machine may hold up whoever writes, and whoever reads here: then what came later is kept as well.
    assert -60.0 < taken[-1][1] - last_s < 3.0
    assert read_state(walk).stage == "recording"

    orders: list[Order] = []
    arrived = threading.Event()

    def submit(order: Order) -> None:
        orders.append(order)
        if isinstance(order, PreparedMap):
            arrived.set()

    plan = WalkPlan(tmp_path / "map-walks", tmp_path / "site")
    walks = DeviceMapWalks(plan, head_camera(320, 240), make_localizer, submit)
    walks.take_up(Settings())
    assert arrived.wait(DEADLINE_S), orders
    walks.close()
    told = [order.text("en") for order in orders if isinstance(order, MapWalkTold)]
    assert told[0] == TEXTS["en"]["map_unfinished"]
    (prepared,) = [order for order in orders if isinstance(order, PreparedMap)]
    assert [poi.name for poi in prepared.site.poi_graph.pois.values()] == ["Place 1"]
    # A device that ended before the map was taken gives it to the next agent, and builds nothing again.
    orders.clear()
    arrived.clear()
    again = DeviceMapWalks(plan, head_camera(320, 240), make_localizer, submit)
    again.take_up(Settings())
    assert arrived.wait(DEADLINE_S)
    again.close()
    assert [type(order) for order in orders] == [PreparedMap]


def test_a_full_disk_ends_the_walk_with_a_sentence_and_what_was_recorded_is_kept(
    tmp_path: Path, frames: list[Frame]
) -> None:
    room = [RESERVE_BYTES * 2]
    rig = MapRig(tmp_path, Settings().changed({"map_walk.build_here": False}), free_bytes=lambda folder: room[0])
    rig.begin(frames[0])
    rig.walk(frames[:20])
    room[0] = RESERVE_BYTES - 1
    rig.walk(frames[20:35])
    assert rig.agent.state.purpose is Mode.LOCALIZING
    assert rig.said(CueKind.MAP_ADVICE) == [TEXTS["en"]["map_disk_full"]]
    assert read_state(rig.walk_folder).stage == "handed_over"
    count = len(open_recording(rig.walk_folder))
    assert 20 <= count <= 32
    rig.press(Button.MAIN, PressKind.LONG, frames[0])
    rig.walk(frames[:30])
    assert rig.agent.state.mode is Mode.OFF_DUTY, "the device goes on"


def test_a_disk_that_refuses_in_the_middle_of_a_picture_leaves_a_sound_recording(
    tmp_path: Path, frames: list[Frame]
) -> None:
    """The system's own limit on a file's size stands for a full disk: pictures fail, lines do not."""
    import resource

    told: list[MapWalkTold] = []
    walk = new_walk(tmp_path, "")
    recording = WalkRecording(
        walk, head_camera(320, 240), Settings(), told.append, beside=False, free_bytes=lambda folder: 1 << 40
    )
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        for frame in frames[:10]:
            recording.take(frame)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
        for frame in frames[10:15]:
            recording.take(frame)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert recording.finish() == 10
    assert len([each for each in told if each.failed]) == 1
    assert len(list(open_recording(walk).frames())) == 10


def test_a_folder_that_cannot_be_made_ends_the_walk_with_a_sentence(tmp_path: Path, frames: list[Frame]) -> None:
    rig = MapRig(tmp_path)
    (tmp_path / "state" / "map-walks").write_text("in the way", encoding="utf-8")
    for button, kind in ((Button.MAIN, PressKind.LONG), (Button.MAIN, PressKind.LONG), (Button.NEXT, PressKind.SHORT)):
        rig.press(button, kind, frames[0])
    rig.walk(frames[:3])
    assert rig.agent.state.mode is Mode.LOCALIZING
    assert TEXTS["en"]["map_not_recorded"] in said(rig)


def test_a_map_that_cannot_be_built_is_told_and_the_old_one_stays(tmp_path: Path, frames: list[Frame]) -> None:
    rig = MapRig(tmp_path)
    walked(rig, frames[:3], ())
    rig.walk(frames[:30])
    assert TEXTS["en"]["map_not_built"] in said(rig)
    state = read_state(rig.walk_folder)
    assert state.stage == "failed"
    assert "only" in state.reason
    assert not rig.site.exists()
    assert len(open_recording(rig.walk_folder)) == 4, "the recording is kept"


def test_a_walk_of_a_few_steps_makes_no_map_that_takes_the_place_of_another(
    tmp_path: Path, frames: list[Frame]
) -> None:
    """Buttons pressed by mistake, the wearer standing."""
    rig = MapRig(tmp_path)
    standing = [replace(frames[0], stamp_s=frames[0].stamp_s + 0.1 * number) for number in range(20)]
    walked(rig, standing, ())
    rig.walk([replace(frame, stamp_s=frame.stamp_s + 10.0) for frame in frames[:30]])
    assert TEXTS["en"]["map_too_short"] in said(rig)
    assert "Only 0.0 m were walked" in read_state(rig.walk_folder).reason
    assert not rig.site.exists()
    assert not list(rig.site.parent.glob(f".{rig.site.name}-walk-*"))


def test_what_takes_the_device_down_is_not_begun_for_ever(tmp_path: Path, frames: list[Frame]) -> None:
    walk = new_walk(tmp_path, "")
    writer = RecordingWriter(walk, head_camera(320, 240))
    for frame in frames[:5]:
        writer.add(frame)
    writer.close()
    write_state(walk, WalkState("recorded", attempts=MAX_ATTEMPTS))
    orders: list[Order] = []
    plan = WalkPlan(tmp_path, tmp_path / "site", beside=False)
    DeviceMapWalks(plan, head_camera(320, 240), make_localizer, orders.append).take_up(Settings())
    assert read_state(walk).stage == "failed"
    assert "vbr map build" in read_state(walk).reason


@pytest.mark.parametrize(
    "damage",
    [b'{"stage":"recorded","date":"\xff"}', b"\xff" * 40, b'{"x":' + b"[" * 100_000, b"", bytes(40)],
    ids=["no UTF-8 in a text", "no UTF-8", "too deep", "empty", "zeros"],
)
def test_a_damaged_state_of_a_walk_stops_no_start_and_no_other_walk(tmp_path: Path, damage: bytes) -> None:
    damaged, other = new_walk(tmp_path, ""), new_walk(tmp_path, "")
    (damaged / STATE_FILE).write_bytes(damage)
    assert read_state(damaged) == WalkState("failed")
    write_state(other, WalkState("recorded", attempts=MAX_ATTEMPTS))
    plan = WalkPlan(tmp_path, tmp_path / "site", beside=False)
    orders: list[Order] = []
    DeviceMapWalks(plan, head_camera(320, 240), make_localizer, orders.append).take_up(Settings())
    assert read_state(other).reason, "it had its turn"
    assert (damaged / STATE_FILE).read_bytes() == damage, "it is left alone"
    write_state(other, WalkState("handed_over"))
    assert handed_over(tmp_path) == (other,)


def test_the_recording_goes_on_where_the_tracker_fails(tmp_path: Path, frames: list[Frame]) -> None:
    told: list[MapWalkTold] = []
    walk, camera = new_walk(tmp_path, ""), head_camera(320, 240)
    recording = WalkRecording(
        walk, camera, Settings(), told.append, beside=False, free_bytes=lambda folder: 1 << 40,
        make_tracker=lambda executor: FailingTracker(camera, Settings()),
    )  # fmt: skip
    for frame in frames[:6]:
        recording.take(frame)
    assert [each.text("en") for each in told] == [TEXTS["en"]["map_no_feedback"]]
    assert recording.finish() == 6


# ------------------------------------------------------------------------------------------------- torn recordings
def _tear_table(walk: Path) -> None:
    table = walk / "associations.txt"
    table.write_bytes(table.read_bytes()[:-7])


def _zero_tail(walk: Path) -> None:
    table = walk / "associations.txt"
    data = table.read_bytes()
    table.write_bytes(data[:-30] + bytes(30))


def _empty_last_picture(walk: Path) -> None:
    max((walk / "depth").iterdir()).write_bytes(b"")


@pytest.mark.parametrize("tear", [_tear_table, _zero_tail, _empty_last_picture])
def test_what_a_power_cut_tears_is_cut_off(tmp_path: Path, frames: list[Frame], tear: Callable[[Path], None]) -> None:
    walk = new_walk(tmp_path, "")
    recording = WalkRecording(
        walk, head_camera(320, 240), Settings(), lambda told: None, beside=False, free_bytes=lambda folder: 1 << 40
    )
    for frame in frames[:8]:
        recording.take(frame)
    recording.mark("Place 1")
    recording.finish()
    tear(walk)
    assert mend_recording(walk) == 7
    read = list(open_recording(walk).frames())
    assert len(read) == 7
    assert np.array_equal(np.isfinite(read[-1].depth_m), np.isfinite(frames[6].depth_m))
    assert [mark.name for mark in read_marks(walk / "marks.txt")] == ["Place 1"]
    (walk / "associations.txt").write_bytes(b"half a li")
    with pytest.raises(RecordingError, match="record again"):
        mend_recording(walk)


def test_what_is_recorded_live_is_what_a_recording_is(tmp_path: Path, frames: list[Frame]) -> None:
    walk = new_walk(tmp_path / "live", "")
    live = WalkRecording(
        walk, head_camera(320, 240), Settings(), lambda told: None, beside=True, free_bytes=lambda folder: 1 << 40
    )
    usual = RecordingWriter(tmp_path / "usual", head_camera(320, 240))
    live.mark("Place 1")
    for frame in frames[:6]:
        live.take(frame)
        usual.add(frame)
    live.mark("Place 2")
    usual.mark(Mark(frames[0].stamp_s, "other", "Place 1"))
    usual.mark(Mark(frames[5].stamp_s, "other", "Place 2"))
    live.finish()
    usual.close()
    for name in ("associations.txt", "calib.txt", "marks.txt"):
        assert (walk / name).read_text(encoding="utf-8") == (tmp_path / "usual" / name).read_text(encoding="utf-8")


# ------------------------------------------------------------------------------------------------------- the report
def test_the_report_names_the_longest_weak_stretch() -> None:
    stretches = [
        {"from_m": 3.2, "length_m": 1.4, "x_m": 0.0, "y_m": 0.0, "kinds": ["weak"]},
        {"from_m": 12.1, "length_m": 4.6, "x_m": 0.0, "y_m": 0.0, "kinds": ["dark"]},
    ]
    told = report_told({"road_m": 31.4, "places": 3, "loops_closed": 1, "weak_stretches": stretches})
    assert told.text("en") == (
        "The new map is in use. Road: 31 metres. Places: 3. Loops: 1."
        " Weak stretches: 2. The longest: 5 metres, 12 metres from the beginning."
    )
    assert "5米" in told.text("zh")
    lost = {"road_m": 5, "places": 1, "places_lost": "Place 2, Place 4", "loops_closed": 0, "weak_stretches": []}
    assert (
        report_told(lost)
        .text("en")
        .endswith(
            "Places: 1. Loops: 0. Not in the map, for nobody knows where they were marked: Place 2, Place 4."
            " No weak stretch."
        )
    )


def test_a_map_cannot_be_restored_where_none_was_kept(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No earlier map"):
        restore_previous(tmp_path / "site")


def test_a_device_that_ends_while_a_map_is_built_goes_on_with_it_at_the_next_start(
    tmp_path: Path, frames: list[Frame]
) -> None:
    walk = new_walk(tmp_path / "map-walks", "2026-11-29")
    recording = WalkRecording(
        walk, head_camera(320, 240), Settings(), lambda told: None, beside=False, free_bytes=lambda folder: 1 << 40
    )
    for frame in frames:
        recording.take(frame)
    recording.finish()
    under_way, arrived = threading.Event(), threading.Event()

    def submit(order: Order) -> None:
        if isinstance(order, PreparedMap):
            arrived.set()
        elif isinstance(order, MapWalkTold) and order.phrases[0].key == "map_building":
            under_way.set()

    plan = WalkPlan(tmp_path / "map-walks", tmp_path / "site")
    walks = DeviceMapWalks(plan, head_camera(320, 240), make_localizer, submit)
    walks.take_up(Settings())
    assert under_way.wait(DEADLINE_S)
    walks.close()
    assert not arrived.is_set()
    assert read_state(walk) == WalkState("recorded", "2026-11-29")
    again = DeviceMapWalks(plan, head_camera(320, 240), make_localizer, submit)
    again.take_up(Settings())
    assert arrived.wait(DEADLINE_S)
    again.close()
    assert read_state(walk).stage == "built"
