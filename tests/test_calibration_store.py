"""The calibration on disk: whole or refused, never lost, and every earlier one can be taken back."""

from __future__ import annotations

import contextlib
import json
import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.calibration_store import CalibrationStore, read_calibration_file
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
