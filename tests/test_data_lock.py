"""The lock of a console's folder: taken by root in a folder of another user's, it is a file of its own or none."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from console.data_lock import LOCK_FILE, BusyDataError, DataLock
from console.store import Store
from navcore.errors import InputError

NOBODY = 65_534


def owned_folder(path: Path) -> Path:
    """Return a new folder; root makes it another user's."""
    path.mkdir()
    if os.geteuid() == 0:
        os.chown(path, NOBODY, NOBODY)
    return path


def link_softly(lock: Path, secret: Path) -> None:
    lock.symlink_to(secret)


def link_to_nothing(lock: Path, secret: Path) -> None:
    lock.symlink_to(secret.with_name("passwd"))


def link_hard(lock: Path, secret: Path) -> None:
    lock.hardlink_to(secret)


def make_pipe(lock: Path, secret: Path) -> None:
    os.mkfifo(lock)


@pytest.mark.parametrize("plant", [link_softly, link_to_nothing, link_hard, make_pipe])
def test_a_lock_that_is_another_file_is_refused_and_that_file_is_left_alone(
    tmp_path: Path, plant: Callable[[Path, Path], None]
) -> None:
    folder, secret = owned_folder(tmp_path / "data"), tmp_path / "secret"
    secret.write_text("of root alone")
    secret.chmod(0o600)
    before = secret.stat()
    plant(folder / LOCK_FILE, secret)
    for alone in (False, True):
        with pytest.raises(OSError, match=LOCK_FILE):
            DataLock(folder, alone=alone)
    with pytest.raises(InputError, match="cannot be opened"):
        Store.open(folder)
    after = secret.stat()
    assert (after.st_uid, after.st_gid, after.st_mode) == (before.st_uid, before.st_gid, before.st_mode)
    assert secret.read_text() == "of root alone"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "secret"]


def test_a_lock_that_is_made_is_of_whom_the_folder_is_and_one_that_is_there_stays_as_it_is(tmp_path: Path) -> None:
    folder = owned_folder(tmp_path / "data")
    with DataLock(folder), DataLock(folder), pytest.raises(BusyDataError):
        DataLock(folder, alone=True)
    lock = folder / LOCK_FILE
    assert lock.stat().st_uid == folder.stat().st_uid
    assert lock.stat().st_mode & 0o777 == 0o600
    os.chown(lock, os.geteuid(), os.getegid())
    DataLock(folder, alone=True).close()
    assert lock.stat().st_uid == os.geteuid()
