"""The calibration on disk: one file with a version and a checksum, and every earlier one beside it.

``calibration.json`` in the device's own folder is what runs. Each version that was ever stored is kept as
``calibration-history/0001.json`` and so on, the newest fifty of them, so that a bad calibration can be taken back. A
crash while one is stored leaves the old file or the new one.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from navcore.calibration import Calibration
from navcore.errors import InputError
from navcore.site_files import write_whole

FORMAT = "vbr-calibration"
SCHEMA_VERSION = 1
MAX_BYTES = 1 << 20
_KEPT_COUNT = 50
_CALIBRATE_AGAIN = "calibrate again (`vbr calibrate --help`)"


class StoredCalibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a calibration file holds."""

    format: str
    schema_version: int
    revision: int
    """Counts the calibrations of this device, from 1."""
    stored_s: float
    """When it was stored, seconds since 1970 (Unix time)."""
    calibration: Calibration
    sha256: str = ""
    """Of the whole, with this left empty."""


class CalibrationStore:
    """The calibration files in a device's own folder."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "calibration.json"
        """What runs."""
        self.history_folder = folder / "calibration-history"

    def load(self) -> StoredCalibration | None:
        """Return what is stored; None where nothing has been yet. Raises InputError where it is damaged or newer."""
        return read_calibration_file(self.path, self._advice) if self._is_there() else None

    def load_or_kept(self) -> tuple[StoredCalibration | None, InputError | None]:
        """Return what is stored or, where that cannot be read, the newest that is kept, and why."""
        try:
            return self.load(), None
        except InputError as error:
            return self._newest_kept(), error

    def store(self, calibration: Calibration, now_s: float) -> StoredCalibration:
        """Keep a calibration as the next revision, and the earlier ones in the history.

        Args:
            calibration: all of it: what is not to change is the same as in the stored one.
            now_s: the present time, seconds since 1970.

        Raises:
            InputError: where the folder cannot be read or written; what was stored before stays then.
        """
        earlier = self._history()
        revision = int(earlier[-1].stem) + 1 if earlier else 1
        fresh = _sealed(StoredCalibration(FORMAT, SCHEMA_VERSION, revision, now_s, calibration))
        data = msgspec.json.format(msgspec.json.encode(fresh), indent=1)
        try:
            self.history_folder.mkdir(parents=True, exist_ok=True)
            # The history comes first: whatever runs can then be found there.
            write_whole(self.history_folder / f"{fresh.revision:04d}.json", data)
            write_whole(self.path, data)
        except OSError as error:
            raise InputError(
                f"The calibration cannot be kept in {self.path.parent} ({error.strerror}): free the disk, or name"
                " another folder with --state."
            ) from error
        for path in earlier[: 1 - _KEPT_COUNT]:
            with contextlib.suppress(OSError):
                path.unlink()
        return fresh

    def history(self) -> Iterator[StoredCalibration]:
        """Return the calibrations that are kept, oldest first; those that cannot be read are left out."""
        try:
            paths = self._history()
        except InputError:
            return
        for path in paths:
            with contextlib.suppress(InputError):
                yield read_calibration_file(path)

    def restore(self, revision: int, now_s: float) -> StoredCalibration:
        """Make an earlier calibration the newest one. Raises InputError where there is none with that number."""
        kept = {int(path.stem): path for path in self._history()}
        if revision not in kept:
            numbers = ", ".join(map(str, kept)) or "none"
            raise InputError(f"There is no calibration {revision}: choose one of those that are kept ({numbers}).")
        return self.store(read_calibration_file(kept[revision]).calibration, now_s)

    def _is_there(self) -> bool:
        try:
            return self.path.exists()
        except OSError as error:
            raise _not_readable(self.path, error) from error

    def _newest_kept(self) -> StoredCalibration | None:
        return max(self.history(), key=lambda kept: kept.revision, default=None)

    def _advice(self) -> str:
        """Return what to do about a damaged calibration: a command as it is to be typed, where one helps."""
        kept = self._newest_kept()
        if kept is None:
            return _CALIBRATE_AGAIN
        folder = shlex.quote(str(self.path.parent))
        return f"take the newest one that is kept with `vbr calibrate restore {kept.revision} --state {folder}`"

    def _history(self) -> list[Path]:
        """Return the files of the history, oldest first. Raises InputError where the folder cannot be listed.

        Taken for empty, it would be numbered anew, and what is there overwritten.
        """
        try:
            found = list(self.history_folder.iterdir())
        except (FileNotFoundError, NotADirectoryError):
            return []
        except OSError as error:
            raise _not_readable(self.history_folder, error) from error
        numbered = [path for path in found if path.suffix == ".json" and path.stem.isdecimal()]
        return sorted(numbered, key=lambda path: int(path.stem))


def _not_readable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path} cannot be read ({error.strerror}): run this as the device's user.")


def read_calibration_file(path: Path, advice: Callable[[], str] = lambda: _CALIBRATE_AGAIN) -> StoredCalibration:
    """Read and check a calibration file. Raises InputError with what is wrong and what to do (``advice``)."""
    try:
        data = path.read_bytes() if path.stat().st_size <= MAX_BYTES else b""
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): {advice()}.") from error
    try:
        raw = json.loads(data)
        _refuse_newer(path, raw)
        stored = msgspec.convert(raw, StoredCalibration)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is damaged ({error}): {advice()}.") from error
    if stored.format != FORMAT or stored.schema_version < 1 or stored.sha256 != _checksum(stored):
        raise InputError(f"{path} is damaged (its checksum is another): {advice()}.")
    return stored


def _refuse_newer(path: Path, raw: object) -> None:
    """A newer file may have another form: its version is looked at before anything else."""
    version = raw.get("schema_version") if isinstance(raw, dict) and raw.get("format") == FORMAT else None
    if isinstance(version, int) and version > SCHEMA_VERSION:
        raise InputError(
            f"{path} was written by a newer program (schema {version}, this one knows {SCHEMA_VERSION}): update this"
            " program, or calibrate again."
        )


def _sealed(stored: StoredCalibration) -> StoredCalibration:
    return msgspec.structs.replace(stored, sha256=_checksum(stored))


def _checksum(stored: StoredCalibration) -> str:
    plain = msgspec.structs.replace(stored, sha256="")
    return hashlib.sha256(msgspec.json.encode(plain, order="deterministic")).hexdigest()
