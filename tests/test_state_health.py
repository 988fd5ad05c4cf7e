"""A folder of the device's own that is damaged or cannot be written: told at the start, and guidance goes on."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from device_console import TOKEN, Console

from device_agent.calibration_store import CalibrationStore
from device_agent.device_store import DeviceStore
from device_agent.doctor import machine
from device_agent.doctor.findings import Status
from device_agent.journal import EventJournal, refuse_damaged
from device_agent.link_state import LinkState
from device_agent.localization import make_localizer
from device_agent.map_walk.map_walks import DeviceMapWalks, WalkPlan
from device_agent.map_walk.walk_folder import new_walk, walks_in
from device_agent.orders import Order
from device_agent.sharing import Consent
from device_agent.state_health import _what_is_wrong, damages, refuse_unwritable
from navcore.calibration import Calibration, FloorCalibration
from navcore.errors import InputError
from navcore.settings import Settings
from navcore.types import CameraIntrinsics

FLOOR = FloorCalibration(5.0, 1.6, 0.01, 0.26, 0.004, 0.01, 0.003, 30)
START_S = 300.0
"""A busy machine takes its time to start a device with its simulated building."""
SPOKEN = "The device's storage has a fault. Guidance works. Let somebody look at it."


def test_a_folder_that_can_be_written_is_left_as_it_was(tmp_path: Path) -> None:
    refuse_unwritable(tmp_path / "new" / "state")
    assert list((tmp_path / "new" / "state").iterdir()) == []


def _rights(folder: Path) -> int:
    return folder.stat().st_mode & 0o7777


def test_what_is_kept_of_a_walker_is_for_the_devices_user_alone(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path / "state", tmp_path / "site")
    store.save_consent(Consent(walks=True, version=1))
    assert _rights(store.state_folder) == 0o700
    assert _rights(new_walk(tmp_path / "map-walks", "2026-01-01").parent) == 0o700
    for before, after in ((0o755, 0o700), (0o750, 0o750), (0o1777, 0o1777)):
        folder = tmp_path / f"{before:o}"
        folder.mkdir()
        folder.chmod(before)
        refuse_unwritable(folder)
        assert _rights(folder) == after


@pytest.mark.parametrize("below", ["", "state"])
def test_a_file_in_the_folders_place_is_told_with_its_name(tmp_path: Path, below: str) -> None:
    file = tmp_path / "glasses"
    file.write_text("")
    with pytest.raises(InputError, match=r"/glasses is a file, .*: name a folder with --state DIR\.$"):
        refuse_unwritable(file / below)


def test_a_folder_that_nobody_can_make_is_told() -> None:
    with pytest.raises(InputError, match=r"/proc/vbr cannot be written .*: name another folder with --state DIR\.$"):
        refuse_unwritable(Path("/proc/vbr"))


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (errno.EROFS, ": run `sudo mount -o remount,rw /"),
        (errno.ENOSPC, ": remove what is not needed; `sudo du -xh /"),
        (errno.EDQUOT, ": remove what is not needed"),
        (errno.EACCES, ": run `sudo chown -R "),
        (errno.EIO, ": name another folder with --state DIR"),
    ],
)
def test_each_fault_of_a_disk_has_its_own_advice(tmp_path: Path, number: int, told: str) -> None:
    assert told in _what_is_wrong(tmp_path / "state", OSError(number, os.strerror(number)))


@pytest.mark.parametrize(
    ("mount", "told"),
    [
        ("mount -t tmpfs -o ro none {0}", "can only be read: run `sudo mount -o remount,rw {0}`"),
        ("mount -t tmpfs -o size=16k none {0}; cat /dev/zero > {0}/zeros", "is full: remove what is not needed"),
    ],
)
def test_a_disk_that_is_really_full_or_read_only(tmp_path: Path, mount: str, told: str) -> None:
    """In a mount namespace of its own, where anybody may mount."""
    if subprocess.run(["unshare", "-rm", "true"], capture_output=True, check=False).returncode != 0:
        pytest.skip("this machine gives no mount namespace (unshare -rm)")
    look = (
        "import sys; from pathlib import Path; from device_agent.state_health import refuse_unwritable\n"
        "try: refuse_unwritable(Path(sys.argv[1]))\nexcept Exception as error: print(error)\n"
        "print(*sorted(path.name for path in Path(sys.argv[1]).iterdir()))"
    )
    script = f'({mount.format(tmp_path)}) 2>/dev/null; exec {sys.executable} -c "$0" {tmp_path}'
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", script, look], capture_output=True, text=True, timeout=60, check=True
    )
    said, left = done.stdout.splitlines()
    assert told.format(tmp_path) in said
    assert left in ("", "zeros"), "nothing half-written stays"


def damaged(folder: Path) -> DeviceStore:
    """Fill a folder as a device leaves it, and damage all that it has kept there."""
    store = DeviceStore(folder, folder / "site")
    refuse_unwritable(folder)
    store.save_settings(Settings(), 3)
    CalibrationStore(folder).store(Calibration(FLOOR), 1.0)
    CalibrationStore(folder).path.write_text("damaged")
    (folder / "settings.json").write_text('{"revision": 3')
    store.journal_path.write_bytes(b"SQLite format 3\x00" + bytes(4000))
    return store


def test_what_is_whole_is_not_complained_of_and_what_is_damaged_is_named(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path / "whole", tmp_path / "site")
    assert damages(store) == [], "nothing was ever kept"
    refuse_unwritable(store.state_folder)
    store.save_settings(Settings(), 3)
    store.save_link_state(LinkState())
    EventJournal(store.journal_path).close()
    assert damages(store) == []
    bad = damaged(tmp_path / "bad")
    assert [error.args[0].partition(" in ")[0].partition(str(tmp_path))[0] for error in damages(bad)] == [
        "The settings", "The event journal ",
    ]  # fmt: skip
    assert bad.load_settings() == (Settings(), 0)


def test_a_journal_is_examined_without_being_changed(tmp_path: Path) -> None:
    path = tmp_path / "events.sqlite"
    path.write_bytes(b"no database, and as long as one would be" * 100)
    before = path.read_bytes()
    with pytest.raises(InputError, match="is damaged"):
        refuse_damaged(path)
    assert (path.read_bytes(), [each.name for each in tmp_path.iterdir()]) == (before, ["events.sqlite"])


def test_events_without_a_disk_wait_in_memory(tmp_path: Path) -> None:
    journal = EventJournal(None)
    journal.append(1.0, "mode", "told")
    journal.flush()
    assert [event.text for event in journal.pending(0)] == ["told"]
    journal.close()
    assert list(tmp_path.iterdir()) == []


NOBODY = 65_534


@contextlib.contextmanager
def forbidden(folder: Path) -> Iterator[None]:
    """Let a folder be one that may not be entered: for root, who may enter any, as another user."""
    is_root = os.geteuid() == 0
    folder.chmod(0o000)
    if is_root:
        os.seteuid(NOBODY)
    try:
        with pytest.raises(PermissionError):
            os.stat(folder / "anything")
        yield
    finally:
        if is_root:
            os.seteuid(0)
        folder.chmod(0o700)


def full(folder: Path) -> DeviceStore:
    """Fill a folder with something of everything that a device keeps, all of it whole."""
    store = DeviceStore(folder, folder.with_name("site"))
    refuse_unwritable(folder)
    store.save_settings(Settings(), 3)
    CalibrationStore(folder).store(Calibration(FLOOR), 1.0)
    EventJournal(store.journal_path).close()
    new_walk(folder / "map-walks", "2026-11-29")
    return store


def test_a_folder_of_another_user_is_told_and_taken_for_empty(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    store, calibrations = full(folder), CalibrationStore(folder)
    plan = WalkPlan(folder / "map-walks", tmp_path / "site", beside=False)
    orders: list[Order] = []
    walks = DeviceMapWalks(plan, CameraIntrinsics(64, 48, 50.0, 50.0, 32.0, 24.0), make_localizer, orders.append)
    with forbidden(folder):
        with pytest.raises(InputError, match=r"may not be written by the user .*: run `sudo chown -R "):
            refuse_unwritable(folder)
        assert [str(error).partition(" in ")[0] for error in damages(store)] == [
            "The settings", "What is shared,", "Who has watched,",
        ]  # fmt: skip
        with pytest.raises(InputError, match="nothing is shared"):
            store.load_consent()
        assert store.load_settings() == (Settings(), 0)
        stored, error = calibrations.load_or_kept()
        assert stored is None
        assert "calibration.json cannot be read (Permission denied)" in str(error)
        with pytest.raises(InputError, match=r"events\.sqlite cannot be used"):
            EventJournal(store.journal_path)
        assert walks_in(plan.folder) == ()
        walks.take_up(Settings())
        assert orders == []
    assert damages(store) == [], "nothing was changed"
    assert len(walks_in(plan.folder)) == 1


def test_a_history_of_calibrations_that_cannot_be_listed_is_not_numbered_anew(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    store.store(Calibration(FLOOR), 1.0)
    with forbidden(store.history_folder):
        assert list(store.history()) == []
        for change in (lambda: store.store(Calibration(), 2.0), lambda: store.restore(1, 2.0)):
            with pytest.raises(InputError, match=r"calibration-history.* cannot be read .*: run this as the device's"):
                change()
    assert [kept.calibration for kept in store.history()] == [Calibration(FLOOR)]


def test_a_user_without_an_entry_is_named_by_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 54_321)
    told = _what_is_wrong(tmp_path / "state", PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
    assert "by the user 54321: run `sudo chown -R 54321 " in told


def test_a_link_to_a_folder_of_another_user_is_not_taken_for_a_file(tmp_path: Path) -> None:
    (tmp_path / "theirs" / "state").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "theirs" / "state")
    with forbidden(tmp_path / "theirs"), pytest.raises(InputError, match="may not be written by the user"):
        refuse_unwritable(tmp_path / "link")


def test_the_doctor_says_the_same(tmp_path: Path) -> None:
    store = damaged(tmp_path)
    finding = machine.check_disk(tmp_path, lambda folder: 10 << 30)
    assert finding.status is Status.WARNING
    assert f"{finding.found}: {finding.advice}." == str(damages(store)[0])
    (tmp_path / "settings.json").unlink()
    assert "journal" in machine.check_disk(tmp_path, lambda folder: 10 << 30).found


# ------------------------------------------------------------------------------------------------ the whole device
@pytest.fixture
def console() -> Iterator[Console]:
    console = Console()
    console.start()
    yield console
    console.close()


@pytest.mark.slow
@pytest.mark.parametrize("how", ["damaged", "a file", "another user's"])
def test_the_device_starts_says_what_is_wrong_and_works(how: str, tmp_path: Path, console: Console) -> None:
    state, token = tmp_path / "state", tmp_path / "token"
    token.write_text(TOKEN)
    may_less: list[str] = []
    if how == "damaged":
        damaged(state)
    elif how == "a file":
        state.write_text("")
    else:
        full(state)
        state.chmod(0o000)
        may_less = _without_roots_keys()
    command = [
        *may_less, sys.executable, "-m", "device_agent", "device", "--without-map", "--site", str(tmp_path / "site"),
        "--simulated", "--state", str(state), "--console", f"ws://127.0.0.1:{console.port}", "--token-file", str(token),
    ]  # fmt: skip
    with (tmp_path / "stderr").open("w") as stderr:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=stderr)
        try:
            # The loop runs, the walker hears of it, and the console as well: in this order or another.
            console.wait_for(lambda: SPOKEN in [event.text for event in console.stored if event.kind == "cue"], START_S)
        finally:
            process.send_signal(signal.SIGTERM)
            assert process.wait(START_S) == 0
    told = [event.text for event in console.stored if event.kind == "mode"]
    said = (tmp_path / "stderr").read_text()
    assert "Traceback" not in said
    expected = {
        "damaged": ["The settings in", "The event journal", "vbr calibrate restore 1 --state", "is kept as events"],
        "a file": ["is a file, and the device's own folder cannot be there: name a folder with --state DIR."],
        "another user's": ["may not be written by the user", "The settings in", "calibration.json cannot be read"],
    }[how]
    for words in expected:
        assert any(words in text for text in told), (words, told)
        assert words in said


def _without_roots_keys() -> list[str]:
    """Return what a command begins with that root too may enter no closed folder with; for others it is nothing."""
    if os.geteuid() != 0:
        return []
    if shutil.which("setpriv") is None:
        pytest.skip("root enters every folder, and there is no setpriv on this machine to take that from it")
    return ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]


@pytest.mark.slow
def test_a_warning_does_not_spoil_the_window_in_which_keys_are_pressed(tmp_path: Path, console: Console) -> None:
    state, token = tmp_path / "state", tmp_path / "token"
    token.write_text("a-token-that-the-console-refuses")
    command = [
        sys.executable, "-m", "device_agent", "device", "--without-map", "--site", str(tmp_path / "site"),
        "--simulated", "--state", str(state), "--console", f"ws://127.0.0.1:{console.port}", "--token-file", str(token),
        "--buttons", "keyboard",
    ]  # fmt: skip
    ours, theirs = os.openpty()
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True)
    os.close(theirs)
    window = b""
    try:
        # What the walker hears is printed; the refusal is a warning, in the log alone.
        while b"There is no map yet." not in window or not _logged(state, "refuses this device's token"):
            assert select.select([ours], [], [], START_S)[0], "nothing is printed"
            window += os.read(ours, 10_000)
            os.write(ours, b"m")
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(START_S) == 0
        os.close(ours)
    assert b"refuses" not in window
    assert b"WARNING" not in window


def _logged(state: Path, words: str) -> bool:
    path = state / "logs" / "device.jsonl"
    return path.exists() and words in path.read_text()
