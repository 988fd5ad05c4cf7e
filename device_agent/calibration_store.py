"""The calibration on disk: one file with a version and a checksum, and every earlier one beside it.

``calibration.json`` in the device's own folder is what runs. Each version that was ever stored is kept as
``calibration-history/0001.json`` and so on, the newest fifty of them, so that a bad calibration can be taken back. A
crash while one is stored leaves the old file or the new one.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import msgspec

from navcore.calibration import Calibration
from navcore.errors import InputError
from navcore.site_files import write_whole

FORMAT = "vbr-calibration"
SCHEMA_VERSION = 1
MAX_BYTES = 1 << 20
_KEPT_COUNT = 50
_ADVICE = "take an earlier one with `vbr calibrate restore`, or calibrate again"


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
        return read_calibration_file(self.path) if self.path.exists() else None

    def store(self, calibration: Calibration, now_s: float) -> StoredCalibration:
        """Keep a calibration as the next revision, and the earlier ones in the history.

        Args:
            calibration: all of it: what is not to change is the same as in the stored one.
            now_s: the present time, seconds since 1970.

        Raises:
            InputError: where the folder cannot be written; what was stored before stays then.
        """
        revisions = [int(path.stem) for path in self._history()]
        fresh = _sealed(StoredCalibration(FORMAT, SCHEMA_VERSION, max(revisions, default=0) + 1, now_s, calibration))
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
        for path in self._history()[:-_KEPT_COUNT]:
            with contextlib.suppress(OSError):
                path.unlink()
        return fresh

    def history(self) -> Iterator[StoredCalibration]:
        """Return the calibrations that are kept, oldest first; those that are damaged are left out."""
        for path in self._history():
            with contextlib.suppress(InputError):
                yield read_calibration_file(path)

    def restore(self, revision: int, now_s: float) -> StoredCalibration:
        """Make an earlier calibration the newest one. Raises InputError where there is none with that number."""
        path = self.history_folder / f"{revision:04d}.json"
        if not path.exists():
            kept = ", ".join(str(int(each.stem)) for each in self._history()) or "none"
            raise InputError(f"There is no calibration {revision}: choose one of those that are kept ({kept}).")
        return self.store(read_calibration_file(path).calibration, now_s)

    def _history(self) -> list[Path]:
        found = self.history_folder.glob("*.json")
        return sorted((path for path in found if path.stem.isdecimal()), key=lambda path: int(path.stem))


def read_calibration_file(path: Path) -> StoredCalibration:
    """Read and check a calibration file. Raises InputError with what is wrong and what to do."""
    try:
        data = path.read_bytes() if path.stat().st_size <= MAX_BYTES else b""
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): {_ADVICE}.") from error
    try:
        raw = json.loads(data)
        _refuse_newer(path, raw)
        stored = msgspec.convert(raw, StoredCalibration)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is damaged ({error}): {_ADVICE}.") from error
    if stored.format != FORMAT or stored.schema_version < 1 or stored.sha256 != _checksum(stored):
        raise InputError(f"{path} is damaged (its checksum is another): {_ADVICE}.")
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
