"""A recording as one stream of bytes, which can be read from any byte on: for sending it, without a second copy of it.

A folder is read as a tar archive (USTAR) whose bytes follow from its files alone, so the same recording has the same
checksum after every restart. A single file is read as it is.
"""

from __future__ import annotations

import bisect
import hashlib
import os
import re
import tarfile
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from navcore.errors import RecordingError

MAX_FILE_COUNT = 200_000
"""An hour and a half of pictures, depth images and those of a fisheye camera, at 10 Hz each, is fewer."""
_BLOCK_BYTES = tarfile.BLOCKSIZE
_PIECE_BYTES = 1 << 20
_MEMBER_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*(/[A-Za-z0-9_][A-Za-z0-9_.+-]*){0,2}")
_LONGEST_NAME = 100
"""USTAR holds no longer one in a header of one block."""


@dataclass(frozen=True, slots=True)
class _Part:
    """A run of bytes of the stream: a header with the padding before it, or the contents of a file."""

    begin: int
    size_bytes: int
    data: bytes = b""
    file: Path | None = None


class RecordingArchive:
    """A recording as a stream of bytes. Its files must stay as they are."""

    def __init__(self, source: Path, leave_out: Collection[str] = ()) -> None:
        """``source`` is a folder, or a file; ``leave_out`` names files of the folder that are no part of it.

        Names that begin with a dot are none either (:func:`recording_files`).

        Raises RecordingError where there is nothing, or a name that an archive does not hold.
        """
        self._parts = _parts_of_folder(source, leave_out) if source.is_dir() else _parts_of_file(source)
        self._begins = [part.begin for part in self._parts]
        self.size_bytes = self._parts[-1].begin + self._parts[-1].size_bytes
        """All of it."""

    def read(self, offset: int, count: int) -> bytes:
        """Return up to ``count`` bytes from ``offset`` on; fewer only at the end.

        Raises RecordingError where a file is not what it was.
        """
        pieces: list[bytes] = []
        index = max(0, bisect.bisect_right(self._begins, offset) - 1)
        while count > 0 and index < len(self._parts):
            part = self._parts[index]
            piece = _read_part(part, offset - part.begin, count)
            pieces.append(piece)
            offset, count, index = offset + len(piece), count - len(piece), index + 1
        return b"".join(pieces)

    def sha256(self) -> str:
        """Return the checksum of the whole stream. Raises RecordingError."""
        hashing = self.hashing()
        while (sha256 := hashing()) is None:
            pass
        return sha256

    def hashing(self) -> Callable[[], str | None]:
        """Return what reads the next piece at each call, and returns the checksum of the whole once all is read.

        For whoever has something else to do in between. The calls raise RecordingError.
        """
        digest, offsets = hashlib.sha256(), iter(range(0, self.size_bytes, _PIECE_BYTES))

        def read_next() -> str | None:
            if (offset := next(offsets, None)) is None:
                return digest.hexdigest()
            digest.update(self.read(offset, _PIECE_BYTES))
            return None

        return read_next


def recording_files(folder: Path, leave_out: Collection[str] = ()) -> list[Path]:
    """Return the files that a recording consists of, in order: ``leave_out`` names those that are no part of it.

    Nor is what begins with a dot: so is called what a device that was killed had begun to write
    (:func:`navcore.site_files.write_whole`), and what other programs leave behind. Raises OSError.
    """
    inside = (path.relative_to(folder) for path in folder.rglob("*"))
    seen = sorted(name for name in inside if not any(part.startswith(".") for part in name.parts))
    return [folder / name for name in seen if name.name not in leave_out and (folder / name).is_file()]


def _parts_of_file(path: Path) -> list[_Part]:
    try:
        size_bytes = path.stat().st_size
    except OSError as error:
        raise RecordingError(
            f"There is no recording at {path}: name a recorded walk, or a recording's folder."
        ) from error
    if size_bytes == 0:
        raise RecordingError(f"{path} is empty: record again.")
    return [_Part(0, size_bytes, file=path)]


def _parts_of_folder(folder: Path, leave_out: Collection[str]) -> list[_Part]:
    files = recording_files(folder, leave_out)
    if not files:
        raise RecordingError(f"{folder} holds nothing: name the folder of a recording.")
    parts: list[_Part] = []
    begin, padding = 0, b""
    for path in files:
        size_bytes = path.stat().st_size
        header = padding + _header(path.relative_to(folder).as_posix(), size_bytes)
        parts += [_Part(begin, len(header), header), _Part(begin + len(header), size_bytes, file=path)]
        begin += len(header) + size_bytes
        padding = bytes(-size_bytes % _BLOCK_BYTES)
    end = padding + bytes(2 * _BLOCK_BYTES)
    return [*parts, _Part(begin, len(end), end)]


def _header(name: str, size_bytes: int) -> bytes:
    if len(name) > _LONGEST_NAME or _MEMBER_NAME.fullmatch(name) is None:
        raise RecordingError(f"The recording holds a file called {name!r}: give it a plain name, or remove it.")
    info = tarfile.TarInfo(name)
    info.size = size_bytes
    return info.tobuf(tarfile.USTAR_FORMAT)


def _read_part(part: _Part, offset: int, count: int) -> bytes:
    count = min(count, part.size_bytes - offset)
    if part.file is None or count == 0:
        return part.data[offset : offset + count]
    try:
        with part.file.open("rb") as file:
            file.seek(offset)
            piece = file.read(count)
    except OSError as error:
        raise RecordingError(f"{part.file} cannot be read ({error.strerror}): see to the disk.") from error
    if len(piece) != count:
        raise RecordingError(f"{part.file} has become shorter while it was read: leave recordings as they are.")
    return piece


def unpack_recording(archive: Path, folder: Path, max_bytes: int, max_file_count: int = MAX_FILE_COUNT) -> None:
    """Unpack what :class:`RecordingArchive` makes of a folder into a new one: plain files below it, and nothing else.

    Raises RecordingError where it is damaged, larger than ``max_bytes``, holds more than ``max_file_count`` files, or
    anything else; OSError.
    """
    folder.mkdir(parents=True)
    unpacked_bytes = file_count = 0
    with archive.open("rb") as stream:
        while (header := stream.read(_BLOCK_BYTES)) != bytes(_BLOCK_BYTES):
            info = _member(header)
            unpacked_bytes, file_count = unpacked_bytes + info.size, file_count + 1
            if unpacked_bytes > max_bytes:
                raise RecordingError("The recording is larger than is taken: record less at a time.")
            if file_count > max_file_count:
                raise RecordingError(f"The recording holds more than {max_file_count} files: record less at a time.")
            target = folder / info.name
            target.parent.mkdir(parents=True, exist_ok=True)
            with target.open("xb") as out:
                _copy(stream, out, info.size)
            stream.seek(-info.size % _BLOCK_BYTES, os.SEEK_CUR)


def _member(header: bytes) -> tarfile.TarInfo:
    """Return what a header says. It is read by itself: what else a tar archive may hold would be taken into memory."""
    try:
        info = tarfile.TarInfo.frombuf(header, "ascii", "strict")
    except (tarfile.TarError, ValueError) as error:
        raise RecordingError(f"The recording cannot be unpacked ({error}): send it again.") from error
    if info.size < 0:
        raise RecordingError(f"The recording holds {info.name[:100]!r} of a size below nothing: send it again.")
    if not info.isreg() or len(info.name) > _LONGEST_NAME or _MEMBER_NAME.fullmatch(info.name) is None:
        raise RecordingError(f"The recording holds {info.name[:100]!r}, which is no file of a recording: record again.")
    return info


def _copy(stream: BinaryIO, out: BinaryIO, count: int) -> None:
    while count > 0:
        piece = stream.read(min(count, _PIECE_BYTES))
        if not piece:
            raise RecordingError("The recording ends too early: send it again.")
        out.write(piece)
        count -= len(piece)
