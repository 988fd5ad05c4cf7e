"""Opens the files of a recording with care: what is foreign, damaged or of another version is said in a sentence.

A file that ends in the middle (a crash, a battery) is read up to there, and so is one that is damaged: what stands
before the damage is checked by its checksums. No length in a file is believed beyond what the reader is ready to hold.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import zstandard
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from google.protobuf.wrappers_pb2 import BytesValue
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from device_agent.recording import channels, exact, foxglove
from device_agent.recording.notes import CycleNotes, FrameNotes, Opening
from device_agent.recording.part_writer import LIBRARY, METADATA_NAME, OPENING_CRC, OPENING_NAME, checksum
from device_agent.recording.walk_files import FORMAT_VERSION
from navcore.errors import InputError
from navcore.types import FisheyeImage, Frame

MAX_RECORD_BYTES = 128 << 20
"""No chunk that is written here comes near it."""
_DAMAGE = (McapError, ValueError, struct.error, zstandard.ZstdError, DecodeError, OverflowError, MemoryError, KeyError)
_PICTURES = frozenset({channels.COLOUR.topic, channels.DEPTH.topic, channels.FISHEYE.topic})


@dataclass(frozen=True, slots=True, eq=False)
class RecordedCycle:
    """One cycle from a file."""

    notes: CycleNotes
    frame: Frame | None
    """With its pictures; None where the file has none of it."""


class RecordedPart:
    """One file of a recorded walk; damage is known once it has been read up to there."""

    def __init__(self, path: Path) -> None:
        """Open a file. Raises InputError with what is wrong and what to do."""
        self.path = path
        self.damage = ""
        """What is wrong with the file behind what was read; empty where nothing is."""
        self.description: dict[str, str] = {}
        """What the file says of itself, for people."""
        self.opening = self._opened()

    def cycles(self) -> Iterator[RecordedCycle]:
        """Read the cycles in order, up to the end or to a damage. Raises InputError for what we never wrote."""
        pictures: dict[str, bytes] = {}
        for channel, message in self.messages():
            if channel.topic in _PICTURES:
                pictures[channel.topic] = message.data
            elif channel.topic == channels.REPLAY.topic:
                notes = exact.decode(_bytes_value(message.data), CycleNotes)
                frame = _frame(notes.frame, pictures) if notes.pictures and notes.frame is not None else None
                yield RecordedCycle(notes, frame)
                pictures = {}

    def rehearsal(self) -> Frame | None:
        """Return the frame that the localizer had seen before the first cycle; None where it had seen none."""
        if self.opening.rehearsal is None:
            return None
        pictures: dict[str, bytes] = {}
        for channel, message in self.messages():
            if channel.topic in _PICTURES and channel.topic not in pictures:
                pictures[channel.topic] = message.data
            elif channel.topic == channels.REPLAY.topic:
                break
        return _frame(self.opening.rehearsal, pictures)

    def messages(self) -> Iterator[tuple[Channel, Message]]:
        """Read the messages of all channels in the order in which they were written, up to the end or to a damage."""
        known: dict[int, Channel] = {}
        for record in self._records():
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
        return max(0, end_ns - begin_ns) / foxglove.NS_PER_S

    def repair(self, target: Path) -> None:
        """Write what is whole to a new file, with an index. Raises InputError, OSError."""
        with target.open("xb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start(library=LIBRARY)
            schema_ids: dict[int, int] = {}
            channel_ids: dict[int, int] = {}
            for record in self._records():
                if isinstance(record, Metadata):
                    writer.add_metadata(record.name, record.metadata)
                elif isinstance(record, Attachment):
                    writer.add_attachment(
                        record.create_time, record.log_time, record.name, record.media_type, record.data
                    )
                elif isinstance(record, Schema) and record.id not in schema_ids:
                    schema_ids[record.id] = writer.register_schema(record.name, record.encoding, record.data)
                elif isinstance(record, Channel) and record.id not in channel_ids:
                    channel_ids[record.id] = writer.register_channel(
                        record.topic, record.message_encoding, schema_ids.get(record.schema_id, 0), record.metadata
                    )
                elif isinstance(record, Message) and record.channel_id in channel_ids:
                    writer.add_message(
                        channel_ids[record.channel_id], record.log_time, record.data, record.publish_time,
                        record.sequence,
                    )  # fmt: skip
            writer.finish()

    def _opened(self) -> Opening:
        for record in self._records():
            if isinstance(record, Metadata) and record.name == METADATA_NAME:
                self.description = dict(record.metadata)
                self._refuse_newer()
            elif isinstance(record, Attachment) and record.name == OPENING_NAME and self.description:
                if checksum(record.data) != self.description.get(OPENING_CRC):
                    self.damage = "what it begins with has changed"
                    break
                return exact.decode(record.data, Opening)
            elif isinstance(record, Message | Footer):
                break
        if self.damage:
            raise InputError(f"{self.path} is damaged where it begins ({self.damage}): nothing of it can be read.")
        raise InputError(
            f"{self.path} is an MCAP file, but no walk that was recorded here: name a file that `vbr walks list` shows."
        )

    def _refuse_newer(self) -> None:
        version = self.description.get("format_version", "")
        if version != str(FORMAT_VERSION):
            raise InputError(
                f"{self.path} has the format {version or 'of no version'}, and this program reads {FORMAT_VERSION}:"
                " use the version of the program that recorded it."
            )

    def _records(self) -> Iterator[McapRecord]:
        """Read the records of the data section, those in chunks too, and end at the first damage."""
        self.damage = ""
        try:
            file = self.path.open("rb")
        except OSError as error:
            raise InputError(f"{self.path} cannot be read ({error.strerror}): name a file of a walk.") from error
        with file:
            if not MCAP0_MAGIC.startswith(file.read(len(MCAP0_MAGIC))):
                raise InputError(f"{self.path} is no MCAP file: name a file that `vbr walks list` shows.")
            file.seek(0)
            try:
                yield from _unpacked(StreamReader(file, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES))
            except OSError as error:
                raise InputError(f"{self.path} cannot be read ({error.strerror}): copy it elsewhere.") from error
            except _DAMAGE as error:
                self.damage = str(error) or "it ends in the middle"


def _unpacked(reader: StreamReader) -> Iterator[McapRecord]:
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        if record.compression not in ("", "zstd"):
            raise ValueError(f"its compression {record.compression!r} is none of ours")
        sizes = [record.uncompressed_size]
        if record.compression == "zstd":
            # The size that the packed data claims for itself is what would be allocated.
            sizes.append(zstandard.frame_content_size(record.data))
        if max(sizes) > MAX_RECORD_BYTES:
            raise ValueError("a part of it claims to be too large")
        yield from breakup_chunk(record, validate_crc=True)


def _bytes_value(data: bytes) -> bytes:
    try:
        return BytesValue.FromString(data).value
    except DecodeError as error:
        raise InputError("A cycle of the recording is damaged: repair the file with `vbr walks repair`.") from error


def _frame(notes: FrameNotes, pictures: dict[str, bytes]) -> Frame:
    """Return a frame from its pictures. Raises InputError where one is missing or damaged."""
    try:
        colour = RawImage.FromString(pictures[channels.COLOUR.topic])
        depth = RawImage.FromString(pictures[channels.DEPTH.topic])
        wide = RawImage.FromString(pictures[channels.FISHEYE.topic]) if notes.fisheye_camera else None
    except (KeyError, DecodeError) as error:
        raise InputError(
            "Pictures of the recording are missing or damaged: replay it without --site, from poses and scans."
        ) from error
    fisheye = None
    if wide is not None and notes.fisheye_camera is not None and notes.fisheye_stamp_s is not None:
        fisheye = FisheyeImage(notes.fisheye_stamp_s, foxglove.pixels_of(wide), notes.fisheye_camera)
    return Frame(notes.stamp_s, foxglove.pixels_of(colour), foxglove.depths_of(depth), fisheye, notes.gravity)
