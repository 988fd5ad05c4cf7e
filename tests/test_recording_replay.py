"""The loop comes to the same guidance again, bit for bit, on what was recorded of it."""

from __future__ import annotations

import argparse
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from recorded_walk import STORED_CUES, STORED_WALK, Walked, heard_again, record
from test_device_agent import GRAPH, INTRINSICS, Rig, pose_at

from device_agent.adapters.fakes import FakeLocalizer
from device_agent.cli import main
from device_agent.ports import CueOutput
from device_agent.recording import exact
from device_agent.recording.notes import CycleNotes, OrderTaken, Raised
from device_agent.recording.options import (
    RecordingOptions,
    add_recording_options,
    recording_flags,
    recording_options,
)
from device_agent.recording.reading import RecordedCycle, RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import ReplayedCycle, replay
from device_agent.recording.walk_files import parts_in
from device_agent.state import PreparedMap
from navcore.cues.table import Cue
from navcore.errors import InputError, SensorError
from navcore.geometry import Transform
from navcore.recording import depth_from_units, units_from_depth
from navcore.settings import Settings
from navcore.site import Site
from navcore.types import Action, FisheyeCamera, FisheyeImage, FisheyeIntrinsics, Frame, Reason
from navcore.wire import ApplySettings, ClearDestination, PublishGraph, Say, SetDestination


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Walked]:
    """A walk among boxes, recorded without pictures."""
    folder = tmp_path_factory.mktemp("walk")
    walked = record(folder)
    return parts_in(folder)[0], walked


def replayed(path: Path) -> list[ReplayedCycle]:
    return list(replay([RecordedPart(path)]))


# ---------------------------------------------------------------------------------------------- the same again
def test_guidance_and_cues_are_the_same_to_the_last_bit(walk: tuple[Path, Walked]) -> None:
    path, walked = walk
    assert walked.modes[-1] == "arrived"
    cycles = replayed(path)
    assert len(cycles) == len(walked.guidance)
    for then, now in zip(walked.guidance, cycles, strict=True):
        assert exact.same(then, now.cycle.guidance)
        assert now.differs_in == ()
    assert exact.same(walked.cues, tuple(cue for each in cycles for cue in each.cues))
    reasons = {each.reason for each in walked.guidance}
    assert {Reason.OK, Reason.PAUSED, Reason.POSE_LOST, Reason.ARRIVED} <= reasons


def test_the_stored_walk_is_still_guided_as_it_was() -> None:
    """A change of guidance shows here; where it is meant, tests/recorded_walk.py says how to renew the list."""
    stored = [json.loads(line) for line in STORED_CUES.read_text(encoding="utf-8").splitlines()]
    assert heard_again(STORED_WALK) == stored


def test_other_settings_come_to_something_else_and_it_is_said_where(walk: tuple[Path, Walked]) -> None:
    cycles = list(replay([RecordedPart(walk[0])], changes={"follower.policy": "paper"}))
    different = [each for each in cycles if each.differs_in]
    assert different
    assert {name for each in different for name in each.differs_in} <= {"guidance", "cues"}
    with pytest.raises(InputError, match="a recording with pictures"):
        list(replay([RecordedPart(walk[0])], changes={"obstacle.low_height_m": 0.2}))


class BrokenSpeaker:
    """An output that fails now and then."""

    def __init__(self, output: CueOutput, plays: set[int]) -> None:
        self._output, self._plays, self._count = output, plays, 0

    def play(self, cue: Cue) -> None:
        """Fail at the chosen cues."""
        self._count += 1
        if self._count in self._plays:
            raise OSError("the loudspeaker is gone")
        self._output.play(cue)

    def close(self) -> None:
        """Nothing is open."""


class BrokenOutputRecorder(WalkRecorder):
    """A recorder in front of an output that fails now and then."""

    def voice_output(self, output: CueOutput) -> CueOutput:
        return super().voice_output(BrokenSpeaker(output, {1, 3}))


def test_whatever_fails_fails_again(tmp_path: Path) -> None:
    recorder = BrokenOutputRecorder(RecordingOptions(tmp_path, reserve_bytes=0))
    rig = Rig(tap=recorder)
    good = rig.spoil

    def sonar_gone() -> None:
        raise SensorError("The rangefinder is gone: plug it in.")

    def run(count: int) -> None:
        for _ in range(count):
            rig.cycles(1)
            recorder.check()

    rig.agent.submit(SetDestination("bar"))
    run(12)
    rig.spoil = lambda frame: SensorError("The camera delivers no pictures: check its cable.")
    run(4)
    rig.spoil = lambda frame: ZeroDivisionError("driver")
    run(2)
    rig.spoil = good
    run(15)
    rig.locate_error = ValueError("singular matrix")
    run(2)
    rig.locate_error, rig.pose = None, None
    run(8)
    rig.pose = pose_at(3.0)
    rig.spoil = lambda frame: replace(frame, depth_m=np.zeros((3,), np.float32))
    run(2)
    rig.spoil = good
    rig.sonar.close()
    run(12)
    rig.agent.submit(Say("Good-bye."))
    rig.agent.submit(ApplySettings(3, {"follower.sub_goal_distance_m": 999.0}))
    rig.agent.submit(ApplySettings(4, {"follower.sub_goal_distance_m": 1.5}))
    rig.agent.submit(SetDestination("attic"))
    run(12)
    # Guidance grows stale, and the watchdog speaks between two cycles.
    rig.clock.sleep_until(rig.clock.now_s() + 2.0)
    rig.agent.watchdog.check()
    run(15)
    rig.agent.submit(ClearDestination())
    run(3)
    recorder.close()
    cycles = replayed(parts_in(tmp_path)[0])
    assert [(each.notes.number, each.differs_in) for each in cycles if each.differs_in] == []
    noted = [each.notes for each in cycles]
    assert {each.camera_error.kind for each in noted if each.camera_error} == {"SensorError", "ZeroDivisionError"}
    assert any(each.localization_error for each in noted)
    assert any(each.scan_error for each in noted)
    assert sum(len(each.play_errors) for each in noted) == 2
    assert {each.cycle.guidance.action for each in cycles} == {Action.STOP, Action.WALK}


# ------------------------------------------------------------------------------------------------ with pictures
def wide_picture(stamp_s: float) -> FisheyeImage:
    lens = FisheyeIntrinsics(64, 48, 20.0, 20.0, 32.0, 24.0, 0.01, 0.0, 0.0, 0.0, 1.5)
    camera = FisheyeCamera(lens, Transform.from_rotation_translation(np.eye(3), np.array([0.05, 0.0, 0.01])))
    grey = np.random.default_rng(5).integers(0, 256, (48, 64), np.uint8)
    return FisheyeImage(stamp_s - 0.003, grey, camera)


def spoiled(frame: Frame) -> Frame:
    rng = np.random.default_rng(round(10 * frame.stamp_s))
    colour = rng.integers(0, 256, frame.colour_rgb.shape, np.uint8)
    depth = frame.depth_m if rng.random() < 0.5 else depth_from_units(units_from_depth(frame.depth_m, 1000.0), 1000.0)
    return replace(
        frame, colour_rgb=colour, depth_m=depth, fisheye=wide_picture(frame.stamp_s), gravity=rng.normal(size=3)
    )


@pytest.fixture
def pictured(tmp_path: Path) -> tuple[Path, list[Frame], Rig]:
    """A recording with pictures, the frames of then, and the device that made it."""
    recorder = WalkRecorder(RecordingOptions(tmp_path, pictures=True, reserve_bytes=0))
    frames: list[Frame] = []

    def keep(frame: Frame) -> Frame:
        frames.append(spoiled(frame))
        return frames[-1]

    rig = Rig(tap=recorder, spoil=keep)
    rehearsal = spoiled(Frame(99.0, np.zeros((120, 160, 3), np.uint8), np.full((120, 160), 2.0, np.float32)))
    recorder.rehearsed(rehearsal)
    rig.agent.submit(SetDestination("bar"))
    for _ in range(25):
        rig.cycles(1)
        recorder.check()
    recorder.close()
    return parts_in(tmp_path)[0], [rehearsal, *frames], rig


def same_frame(one: Frame, other: Frame) -> bool:
    assert one.fisheye is not None
    assert other.fisheye is not None
    return (
        one.stamp_s == other.stamp_s
        and np.array_equal(one.colour_rgb, other.colour_rgb)
        and one.depth_m.dtype == other.depth_m.dtype
        and np.array_equal(one.depth_m, other.depth_m, equal_nan=True)
        and exact.same(one.fisheye, other.fisheye)
        and exact.same(one.gravity, other.gravity)
    )


def test_a_replay_from_pictures_sees_the_frames_of_then(pictured: tuple[Path, list[Frame], Rig]) -> None:
    path, frames, rig = pictured
    seen: list[Frame] = []

    def locate(frame: Frame) -> object:
        seen.append(frame)
        return rig.locate(frame)

    cycles = list(replay([RecordedPart(path)], lambda intrinsics, settings: FakeLocalizer(locate)))  # type: ignore[arg-type]
    assert [each.differs_in for each in cycles] == [()] * 25
    assert len(seen) == len(frames)
    assert all(same_frame(then, now) for then, now in zip(frames, seen, strict=True))


def test_from_pictures_the_walk_begins_with_its_first_file_and_none_is_missing(tmp_path: Path) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path, pictures=True, max_part_bytes=300_000, reserve_bytes=0))
    rig = Rig(tap=recorder)
    rig.agent.submit(SetDestination("bar"))
    for _ in range(40):
        rig.cycles(1)
        recorder.check()
    recorder.close()
    parts = [RecordedPart(path) for path in parts_in(tmp_path)]
    assert len(parts) > 2

    def localizer(intrinsics: object, settings: object) -> FakeLocalizer:
        return FakeLocalizer(rig.locate)

    cycles = list(replay(parts, localizer))
    assert [each.notes.number for each in cycles if not each.differs_in] == list(range(1, 41))
    with pytest.raises(InputError, match="from 001 on"):
        list(replay(parts[1:], localizer))
    with pytest.raises(InputError, match="does not follow"):
        list(replay([parts[0], parts[2]], localizer))


def test_without_pictures_there_is_nothing_to_see(walk: tuple[Path, Walked]) -> None:
    path, _ = walk
    assert all(each.frame is None for each in RecordedPart(path).cycles())
    topics = {channel.topic for channel, _ in RecordedPart(path).messages()}
    assert not {topic for topic in topics if topic.startswith(("/camera/colour", "/camera/depth", "/fisheye"))}
    with pytest.raises(InputError, match="no pictures"):
        list(replay([RecordedPart(path)], lambda intrinsics, settings: FakeLocalizer(Rig().locate)))


# --------------------------------------------------------------------------------------------------- exactness
NUMBERS = arrays.arrays(
    st.sampled_from([np.float64, np.float32, np.int64, np.int8, np.uint16, np.bool_]),
    arrays.array_shapes(min_dims=1, max_dims=3, max_side=5),
)


@given(NUMBERS, st.booleans())
@settings(deadline=None, max_examples=60)
def test_arrays_keep_every_bit_and_their_order_in_memory(values: np.ndarray, turned: bool) -> None:
    values = values.T if turned else values
    back = exact.decode(exact.encode(values), np.ndarray)
    assert (back.dtype, back.shape, back.tobytes()) == (values.dtype, values.shape, values.tobytes())
    assert back.strides == values.strides or values.size <= 1 or 1 in values.shape


@given(st.floats(), st.floats())
def test_numbers_keep_every_bit(one: float, other: float) -> None:
    assert np.array([exact.decode(exact.encode(one), float)]).tobytes() == np.array([one]).tobytes()
    assert exact.same(one, other) == (np.array([one]).tobytes() == np.array([other]).tobytes())


@pytest.mark.parametrize(
    "value",
    [
        ("|O8", "C", (1,), b"12345678"), ("<f8", "C", (10**12,), b"12345678"), ("<f8", "K", (1,), b"12345678"),
        ("nonsense", "C", (1,), b"1"), ("<f8", "C", (1,)), ("<f8", "C", "x", b"12345678"), 5, None,
    ],
)  # fmt: skip
def test_no_array_is_made_that_its_bytes_do_not_fill(value: object) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        exact.decode(exact.encode(value), np.ndarray)


def test_an_error_comes_back_as_what_the_loop_takes_for_the_same() -> None:
    for error in (SensorError("cable"), ValueError("no"), KeyError("k")):
        again = Raised.of(error).error()
        assert isinstance(again, SensorError) == isinstance(error, SensorError)
        assert (type(again).__name__, str(again)) == (type(error).__name__, str(error))
    assert isinstance(Raised("no name", "text").error(), Exception)


def test_an_order_of_an_unknown_kind_is_refused_in_words(walk: tuple[Path, Walked]) -> None:
    class Knock:
        """No order of ours."""

    assert OrderTaken.of(Knock()) == OrderTaken("Knock")  # type: ignore[arg-type]
    part = RecordedPart(walk[0])
    first = next(part.cycles())
    notes = CycleNotes(**{**{name: getattr(first.notes, name) for name in CycleNotes.__struct_fields__},
                          "orders": (OrderTaken("Knock"),)})  # fmt: skip
    part.cycles = lambda: iter([RecordedCycle(notes, None)])  # type: ignore[method-assign]
    with pytest.raises(InputError, match="Knock"):
        list(replay([part]))


# ------------------------------------------------------------------------------------------------ the commands
def test_every_difference_that_is_shown_can_be_seen(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["walks", "replay", str(STORED_WALK), "--set", "follower.reaction_s=1.5", "--json"]) == 1
    same_words = [each for each in json.loads(capsys.readouterr().out)["first"] if each["then"] == each["now"]]
    assert same_words, "one of them comes to the same words by other values"
    for each in same_words:
        assert each["values"]
        assert all(then != now for then, now in each["values"].values())
    assert main(["walks", "replay", str(STORED_WALK), "--set", "follower.reaction_s=1.5"]) == 1
    for line in capsys.readouterr().out.splitlines():
        then, arrow, now = line.rpartition(": ")[2].partition(" → ")
        assert not arrow or then != now, line


def test_a_file_that_is_named_twice_is_not_replayed_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(STORED_WALK.read_bytes())
    for other in (STORED_WALK, copy):
        assert main(["walks", "replay", str(STORED_WALK), str(other)]) == 2
        assert "name each file of a walk once" in capsys.readouterr().err


def test_a_folder_without_walks_says_so_and_a_walk_is_shown_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["walks", "list", str(tmp_path)]) == 0
    assert "holds no recorded walks: name the folder that was given to --record" in capsys.readouterr().out
    (tmp_path / "my walk.mcap").write_bytes(STORED_WALK.read_bytes())
    assert main(["walks", "list", str(tmp_path)]) == 0
    command = re.search(r"`vbr (.*)`", capsys.readouterr().out)
    assert command is not None
    assert main(shlex.split(command[1])) == 0
    shown = capsys.readouterr().out
    assert "decisions  walk 64% (53), stop 25% (21), turn 11% (9)" in shown
    assert "arrived 14% (12), pose lost 8% (7)" in shown
    assert "2.40 s  “Stop. Paused.”" in shown
    assert not re.search(r"[{}_]", shown), "no raw fields"


def test_walks_are_listed_shown_and_replayed(walk: tuple[Path, Walked], capsys: pytest.CaptureFixture[str]) -> None:
    path, walked = walk
    assert main(["walks", "list", str(path.parent), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["file"], row["pictures"], row["state"]) == (path.name, "no", "whole")
    assert row["seconds"] == pytest.approx(walked.guidance[-1].stamp_s - walked.guidance[0].stamp_s, abs=0.2)
    assert main(["walks", "show", str(path), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["cycles"] == len(walked.guidance)
    assert [text for _, text in shown["heard"]] == [cue.text for cue in walked.cues if cue.text]
    assert main(["walks", "list", str(path.parent)]) == 0
    assert main(["walks", "show", str(path)]) == 0
    assert main(["walks", "replay", str(path)]) == 0
    assert f"{len(walked.guidance)} cycles replayed, 0 of them differ." in capsys.readouterr().out


def test_a_replay_under_another_setting_says_what_it_would_have_changed(
    walk: tuple[Path, Walked], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = walk
    cues = tmp_path / "cues.jsonl"
    changed = ["--set", "follower.policy=paper", "--cues", str(cues)]
    assert main(["walks", "replay", str(path), *changed, "--json"]) == 1
    figures = json.loads(capsys.readouterr().out)
    assert 0 < figures["different"] <= figures["cycles"]
    assert figures["first"][0]["then"]
    assert any(name.startswith("trace.") for name in figures["first"][0]["values"])
    assert all(json.loads(line)["kind"] for line in cues.read_text(encoding="utf-8").splitlines())
    assert main(["walks", "replay", str(path), "--set", "nothing.of_the_kind=1"]) == 2


def test_settings_of_then_are_the_ones_that_run(walk: tuple[Path, Walked]) -> None:
    opening = RecordedPart(walk[0]).opening
    assert opening.state.settings == Settings()
    assert opening.intrinsics.width_px == INTRINSICS.width_px


# ------------------------------------------------------------------------------------ maps, graphs, and the flags
def test_maps_and_graphs_that_are_taken_on_the_way_are_taken_again(tmp_path: Path, small_site: Site) -> None:
    """A map that waits for a stop waits over the beginning of a file as well."""
    recorder = WalkRecorder(RecordingOptions(tmp_path, max_part_bytes=60_000, reserve_bytes=0))
    rig = Rig(tap=recorder)

    def run(count: int) -> None:
        for _ in range(count):
            rig.cycles(1)
            recorder.check()

    rig.agent.submit(SetDestination("bar"))
    run(5)
    rig.agent.submit(PublishGraph(msgspec.structs.replace(GRAPH, version=4)))
    run(3)
    rig.agent.submit(PreparedMap(tmp_path, "new-map", small_site, FakeLocalizer(rig.locate)))
    run(40)
    rig.agent.submit(ClearDestination())
    run(3)
    assert (rig.agent.state.map_checksum, rig.agent.state.site_id) == ("new-map", "small")
    rig.agent.submit(SetDestination("bar"))
    run(6)
    recorder.close()
    parts = [RecordedPart(path) for path in parts_in(tmp_path)]
    assert any(part.opening.waiting_map is not None for part in parts)
    for part in parts:
        cycles = list(replay([part]))
        assert [(each.notes.number, each.differs_in) for each in cycles if each.differs_in] == []
    assert cycles[-1].cycle.guidance.trace.remaining_m is not None


def test_a_map_that_changes_ends_a_replay_from_pictures_in_words(tmp_path: Path, small_site: Site) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path, pictures=True, reserve_bytes=0))
    rig = Rig(tap=recorder)
    rig.agent.submit(PreparedMap(tmp_path, "new-map", small_site, FakeLocalizer(rig.locate)))
    rig.cycles(2)
    recorder.close()
    with pytest.raises(InputError, match="map was changed"):
        list(replay([RecordedPart(parts_in(tmp_path)[0])], lambda camera, settings: FakeLocalizer(rig.locate)))


def flags(*words: str) -> RecordingOptions | None:
    parser = argparse.ArgumentParser()
    add_recording_options(parser)
    return recording_options(parser.parse_args(words), "cane")


def test_nothing_is_recorded_unless_it_is_asked_for() -> None:
    assert flags() is None
    assert recording_flags(None) == []
    options = flags("--record", "walks")
    assert options == RecordingOptions(Path("walks"), pictures=False, device_id="cane")


@pytest.mark.parametrize("words", [[], ["--record-pictures"], ["--record-gb", "0.7", "--record-days", "1.5"]])
def test_the_flags_reach_another_process_as_they_are(words: list[str]) -> None:
    options = flags("--record", "walks", *words)
    assert flags(*recording_flags(options)) == options


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--record-pictures"], "needs a folder"),
        (["--record", str(STORED_CUES)], "is a file"),
        (["--record", "x", "--record-gb", "nan"], "--record-gb"),
        (["--record", "x", "--record-gb", "0"], "--record-gb"),
        (["--record", "x", "--record-days", "-1"], "--record-days"),
    ],
)
def test_flags_that_make_no_sense_are_refused_in_words(words: list[str], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        flags(*words)
