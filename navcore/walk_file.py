"""Opens one file of a recorded walk (MCAP) with care.

What is foreign, damaged or of another version is said in a sentence.
A file that ends in the middle (a crash, a battery) is read up to there, and so is one that is damaged: what stands
before the damage is checked by its checksums. No length in a file is believed beyond what the reader is ready to hold.
Device and console read walks through this; what a replay needs besides is the device's own affair.
"""

from __future__ import annotations

import calendar
import re
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from navcore.errors import InputError

FORMAT_VERSION = 1
METADATA_NAME = "walk"
"""Of the record that says of a file what :class:`WalkPart` reads."""
MAX_RECORD_BYTES = 128 << 20
"""No chunk that is written here comes near it."""
MAX_CHUNK_RECORD_COUNT = 100_000
MAX_RECORD_COUNT = 2_000_000
"""In a chunk, and in a file: twenty times what ten minutes hold. Some bytes can be unpacked into millions of records of
nothing, and each is read by itself."""
NS_PER_S = 1_000_000_000
_DAMAGE = (McapError, ValueError, struct.error, zstandard.ZstdError, DecodeError, OverflowError, MemoryError, KeyError)
_PLAIN_ID = re.compile(r"[A-Za-z0-9_-]{1,120}")
_RUN_BEGAN = re.compile(r"[0-9]{8}T[0-9]{6}Z")


@dataclass(frozen=True, slots=True)
class WalkPart:
    """What a file says of itself."""

    recording_id: str
    """The run of the device that recorded it; its files are numbered on. Empty where it is none of ours."""
    walk_number: int
    """Which walk of that run; 0 in files of a version that did not tell walks apart."""
    part: int
    """Which file of that walk, from 1."""
    is_walk: bool
    """Somebody was led; False for what lies between two walks."""
    device_id: str
    site_id: str
    map_checksum: str
    has_pictures: bool
    software_version: str
    graph_version: int
    """Of the PoI-graph that it began with; 0 where the file does not say so."""
    began_at_s: float
    """Unix time; of the run where the file does not say its own."""

    @property
    def walk_id(self) -> str:
        """Names the walk."""
        return f"{self.recording_id}-w{self.walk_number}" if self.walk_number else self.recording_id

    @staticmethod
    def of(description: dict[str, str]) -> WalkPart:
        """Return what the record in a file says; what an earlier version did not say yet has its default."""
        recording_id = description.get("walk_id", "")
        if not _PLAIN_ID.fullmatch(recording_id):
            recording_id = ""
        number = _whole(description.get("walk_number"), 0)
        return WalkPart(
            recording_id, number, _whole(description.get("walk_part" if number else "part"), 1),
            description.get("walking", "yes") == "yes", description.get("device_id", ""),
            description.get("site_id", ""), description.get("map_checksum", ""), description.get("pictures") == "yes",
            description.get("software_version", ""), _whole(description.get("graph_version"), 0),
            _seconds(description.get("began_at_unix_s")) or _run_began_s(recording_id),
        )  # fmt: skip


class WalkFile:
    """One file of a recorded walk; damage is known once it has been read up to there."""

    def __init__(self, path: Path) -> None:
        """Open a file. Raises InputError with what is wrong and what to do."""
        self.path = path
        self.damage = ""
        """What is wrong with the file behind what was read; empty where nothing is."""
        self.description: dict[str, str] = self._described()
        """What the file says of itself, for people."""

    @property
    def part(self) -> WalkPart:
        """What the file says of itself."""
        return WalkPart.of(self.description)

    def messages(self) -> Iterator[tuple[Channel, Message]]:
        """Read the messages of all channels in the order in which they were written, up to the end or to a damage."""
        known: dict[int, Channel] = {}
        for record in self.records():
            if isinstance(record, Channel):
                known[record.id] = record
            elif isinstance(record, Message) and record.channel_id in known:
                yield known[record.channel_id], record

    def length_s(self) -> float | None:
        """Return how much time the file covers, by its index alone; None where it was not completed."""
        try:
            with self.path.open("rb") as file:
                summary = SeekingReader(file, record_size_limit=MAX_RECORD_BYTES).get_summary()
        except (OSError, *_DAMAGE):
            return None
        if summary is None or summary.statistics is None:
            return None
        begin_ns, end_ns = summary.statistics.message_start_time, summary.statistics.message_end_time
        return max(0, end_ns - begin_ns) / NS_PER_S

    def records(self) -> Iterator[McapRecord]:
        """Read the records of the data section, those in chunks too, and end at the first damage. Raises InputError."""
        for _, records in self.blocks():
            yield from records

    def blocks(self) -> Iterator[tuple[int, list[McapRecord]]]:
        """Read records as they lie together (a chunk's, or a single one), each with the byte at which they begin.

        Ends at the first damage. Raises InputError.
        """
        self.damage = ""
        with _opened(self.path) as file:
            if not MCAP0_MAGIC.startswith(file.read(len(MCAP0_MAGIC))):
                raise InputError(f"{self.path} is no MCAP file: name a file that `vbr walks list` shows.")
            file.seek(0)
            yield from self._until_damaged(file)

    def _until_damaged(self, file: BinaryIO) -> Iterator[tuple[int, list[McapRecord]]]:
        reader = StreamReader(file, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
        offset, count = file.tell(), 0
        try:
            for record in reader.records:
                records = unpacked(record)
                count += len(records)
                if count > MAX_RECORD_COUNT:
                    raise ValueError(f"it holds more than {MAX_RECORD_COUNT} records")
                yield offset, records
                offset = file.tell()
        except OSError as error:
            raise InputError(f"{self.path} cannot be read ({error.strerror}): copy it elsewhere.") from error
        except _DAMAGE as error:
            self.damage = str(error) or "it ends in the middle"

    def _described(self) -> dict[str, str]:
        for record in self.records():
            if isinstance(record, Metadata) and record.name == METADATA_NAME:
                self._refuse_newer(record.metadata)
                return dict(record.metadata)
            if isinstance(record, Message | Footer):
                break
        if self.damage:
            raise InputError(f"{self.path} is damaged where it begins ({self.damage}): nothing of it can be read.")
        raise InputError(
            f"{self.path} is an MCAP file, but no walk that was recorded here: name a file that `vbr walks list` shows."
        )

    def _refuse_newer(self, description: dict[str, str]) -> None:
        version = description.get("format_version", "")
        if version != str(FORMAT_VERSION):
            raise InputError(
                f"{self.path} has the format {version or 'of no version'}, and this program reads {FORMAT_VERSION}:"
                " use the version of the program that recorded it."
            )


def block_at(path: Path, offset: int) -> list[McapRecord]:
    """Return the records that lie together at a byte that :meth:`WalkFile.blocks` told.

    None where it is damaged now. Raises InputError where the file is gone.
    """
    with _opened(path) as file:
        file.seek(offset)
        try:
            reader = StreamReader(file, skip_magic=True, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
            return unpacked(next(reader.records))
        except (OSError, StopIteration, *_DAMAGE):
            return []


def _opened(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): name a file of a walk.") from error


def unpacked(record: McapRecord) -> list[McapRecord]:
    """Return the records in a chunk, checked by its checksum; any other record by itself."""
    if not isinstance(record, Chunk):
        return [record]
    if record.compression not in ("", "zstd"):
        raise ValueError(f"its compression {record.compression!r} is none of ours")
    sizes = [record.uncompressed_size]
    if record.compression == "zstd":
        # The size that the packed data claims for itself is what would be allocated.
        sizes.append(zstandard.frame_content_size(record.data))
    if max(sizes) > MAX_RECORD_BYTES:
        raise ValueError("a part of it claims to be too large")
    stream, size_bytes = get_chunk_data_stream(record, validate_crc=True)
    found: list[McapRecord] = []
    while stream.count < size_bytes:
        if len(found) == MAX_CHUNK_RECORD_COUNT:
            raise ValueError(f"a part of it holds more than {MAX_CHUNK_RECORD_COUNT} records")
        found.append(_next_record(stream))
    return found


def _next_record(stream: ReadDataStream) -> McapRecord:
    opcode, length = stream.read1(), stream.read8()
    record: McapRecord
    match opcode:
        case Opcode.MESSAGE:
            record = Message.read(stream, length)
        case Opcode.CHANNEL:
            record = Channel.read(stream)
        case Opcode.SCHEMA:
            record = Schema.read(stream)
        case _:
            raise ValueError(f"a part of it holds a record of the unknown kind {opcode}")
    return record


def _whole(text: str | None, otherwise: int) -> int:
    return int(text) if text and re.fullmatch(r"[0-9]{1,6}", text) else otherwise


def _seconds(text: str | None) -> float | None:
    return float(text) if text and re.fullmatch(r"[0-9]{1,11}(\.[0-9]{1,9})?", text) else None


def _run_began_s(recording_id: str) -> float:
    """Return when a run began, which its name says; 0 where it does not."""
    found = _RUN_BEGAN.match(recording_id)
    try:
        return float(calendar.timegm(time.strptime(found[0], "%Y%m%dT%H%M%SZ"))) if found else 0.0
    except ValueError:
        return 0.0
