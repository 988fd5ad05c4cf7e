"""The calibration on disk: whole or refused, never lost, and every earlier one can be taken back."""

from __future__ import annotations

import contextlib
import json
import math
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.calibrate_command import calibration_lines
from device_agent.calibration_store import CalibrationStore, read_calibration_file
from device_agent.cli import main
from navcore.calibration import (
    Calibration,
    FisheyeCalibration,
    FloorCalibration,
    LensQuality,
    PinholeCalibration,
    SonarAlignment,
)
from navcore.errors import InputError
from navcore.types import CameraIntrinsics, FisheyeIntrinsics

QUALITY = LensQuality(5.0, 0.2, 12, 0.8)
FLOOR = FloorCalibration(5.0, 1.6, 0.01, 0.26, 0.004, 0.01, 0.003, 30, (0.01, -0.02, 0.0))
WHOLE = Calibration(
    FLOOR,
    PinholeCalibration(CameraIntrinsics(640, 480, 600.5, 601.0, 319.5, 239.5, (0.1, -0.2, 0.001, 0.0, 0.0)), QUALITY),
    FisheyeCalibration(
        FisheyeIntrinsics(640, 480, 210.0, 210.0, 319.5, 239.5, 0.01, 0.0, 0.0, 0.0, math.radians(95.0)), QUALITY,
        (0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 1.0),
    ),
    SonarAlignment(5.0, 0.05, 0.01, -0.02, 0.002, 0.01, 60),
)  # fmt: skip


def test_what_is_stored_is_read_back_whole(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path / "new" / "folder")
    assert store.load() is None
    assert store.store(WHOLE, 9.0).revision == 1
    loaded = CalibrationStore(tmp_path / "new" / "folder").load()
    assert loaded is not None
    assert (loaded.calibration, loaded.revision, loaded.stored_s) == (WHOLE, 1, 9.0)


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_one_changed_byte_is_refused_or_changes_nothing(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("calibration")
    store = CalibrationStore(folder)
    store.store(WHOLE, 9.0)
    whole = bytearray(store.path.read_bytes())
    at, value = data.draw(st.integers(0, len(whole) - 1)), data.draw(st.integers(0, 255))
    whole[at] = value
    store.path.write_bytes(whole)
    with contextlib.suppress(InputError):
        loaded = store.load()
        # White space between the values says nothing.
        assert loaded is not None
        assert loaded.calibration == WHOLE


@pytest.mark.parametrize("text", ["", "[]", "null", '{"format": "vbr-calibration"}', "{" * 100_000, "\0" * 50])
def test_what_is_no_calibration_is_refused_with_a_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(text)
    with pytest.raises(InputError, match="is damaged"):
        read_calibration_file(path)


def test_a_newer_file_is_refused_as_newer(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    store.store(WHOLE, 9.0)
    raw = json.loads(store.path.read_text())
    store.path.write_text(json.dumps({**raw, "schema_version": 99, "what": "is new"}))
    with pytest.raises(InputError, match="newer program"):
        store.load()


def test_numbers_that_no_glasses_have_are_refused_even_with_a_right_checksum(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="worn by nobody"):
        FloorCalibration(5.0, 0.4, 0.01, 0.26, 0.004, 0.01, 0.003, 30)
    with pytest.raises(InputError):
        FloorCalibration(5.0, math.nan, 0.01, 0.26, 0.004, 0.01, 0.003, 30)
    with pytest.raises(InputError, match="30° aside"):
        SonarAlignment(5.0, 1.0, 0.01, 0.0, 0.0, 0.0, 60)
    with pytest.raises(InputError, match="off by more"):
        SonarAlignment(5.0, 0.0, 0.01, -2.0, 0.0, 0.0, 60)


def test_every_revision_can_be_taken_back_even_from_a_damaged_file(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    store.store(Calibration(FLOOR), 1.0)
    store.store(WHOLE, 2.0)
    store.path.write_text("broken")
    restored = store.restore(1, 3.0)
    assert restored.revision == 3
    loaded = store.load()
    assert loaded is not None
    assert loaded.calibration == Calibration(FLOOR)
    assert [each.revision for each in store.history()] == [1, 2, 3]
    with pytest.raises(InputError, match=r"There is no calibration 9: .*1, 2, 3"):
        store.restore(9, 4.0)


def test_a_damaged_calibration_is_shown_with_what_is_kept_and_the_command_that_helps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "device's own"
    store = CalibrationStore(folder)
    store.store(Calibration(FLOOR), 1.0)
    store.store(WHOLE, 86_400.0)
    (store.history_folder / "0003.json").write_text("broken too")
    store.path.write_text("broken")
    assert main(["calibrate", "show", "--state", str(folder), "--json"]) == 1
    shown = json.loads(capsys.readouterr().out)
    assert (shown["stored"], [each["revision"] for each in shown["history"]]) == (None, [1, 2])
    assert main(["calibrate", "show", "--state", str(folder)]) == 1
    told, *kept = capsys.readouterr().out.splitlines()
    assert [line.strip() for line in kept] == [
        "kept: revision 1, 1970-01-01 00:00 UTC, floor",
        "kept: revision 2, 1970-01-02 00:00 UTC, floor, pinhole, fisheye, sonar",
    ]
    # The advice is typed as it stands.
    command = re.search(r"`vbr (.*)`", told)
    assert command is not None
    assert main(shlex.split(command[1])) == 0
    assert "counts once the device is started anew" in capsys.readouterr().out
    loaded = store.load()
    assert loaded is not None
    assert loaded.calibration == WHOLE


def test_where_nothing_is_kept_calibrating_again_is_the_advice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "calibration.json").write_text("broken")
    assert main(["calibrate", "show", "--state", str(tmp_path)]) == 1
    told = capsys.readouterr().out
    assert "calibrate again" in told
    assert "restore" not in told


@pytest.mark.parametrize(
    ("options", "least"),
    [(["floor", "--frames"], 10), (["sonar", "--frames"], 30), (["fisheye", "--board", "b", "--views"], 8)],
)
def test_fewer_frames_than_a_measurement_needs_are_refused_before_any_is_taken(
    options: list[str], least: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["calibrate", *options, str(least - 1), "--simulated"])
    assert f"give a whole number from {least} to" in capsys.readouterr().err


def test_nothing_is_minus_zero_and_times_say_their_zone() -> None:
    floor = replace(FLOOR, roll_rad=-1e-4, pitch_rad=-1e-4, made_s=1_800_000_000.0)
    sonar = SonarAlignment(5.0, 0.1, 0.01, -1e-5, 0.0, 0.0, 60)
    lines = " ".join(calibration_lines(Calibration(floor=floor, sonar=sonar)))
    assert "-0.0" not in lines
    assert "2027-01-15 08:00 UTC" in lines


def test_a_disk_that_takes_nothing_leaves_what_was_stored(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    store.store(WHOLE, 1.0)
    # A file where the history's folder belongs fails for every user, root included.
    store.history_folder.rename(tmp_path / "aside")
    store.history_folder.write_text("")
    with pytest.raises(InputError, match="cannot be kept"):
        store.store(Calibration(FLOOR), 2.0)
    loaded = store.load()
    assert loaded is not None
    assert loaded.calibration == WHOLE
