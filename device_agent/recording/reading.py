"""Reads from the files of a recording what a replay needs: what a file begins with, its cycles, and its pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from google.protobuf.wrappers_pb2 import BytesValue
from mcap.records import Attachment, Channel, Footer, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from device_agent.recording import channels, exact, foxglove
from device_agent.recording.notes import CycleNotes, FrameNotes, Opening
from device_agent.recording.part_writer import LIBRARY, OPENING_CRC, OPENING_NAME, checksum
from navcore.errors import InputError
from navcore.types import FisheyeImage, Frame
from navcore.walk_file import WalkFile

_PICTURES = frozenset({channels.COLOUR.topic, channels.DEPTH.topic, channels.FISHEYE.topic})


@dataclass(frozen=True, slots=True, eq=False)
class RecordedCycle:
    """One cycle from a file."""

    notes: CycleNotes
    frame: Frame | None
    """With its pictures; None where the file has none of it."""


class RecordedPart(WalkFile):
    """One file of a recorded walk, for a replay; damage is known once it has been read up to there."""

    def __init__(self, path: Path) -> None:
        """Open a file. Raises InputError with what is wrong and what to do."""
        super().__init__(path)
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

    def repair(self, target: Path) -> None:
        """Write what is whole to a new file, with an index. Raises InputError, OSError."""
        with target.open("xb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start(library=LIBRARY)
            schema_ids: dict[int, int] = {}
            channel_ids: dict[int, int] = {}
            for record in self.records():
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
        for record in self.records():
            if isinstance(record, Attachment) and record.name == OPENING_NAME:
                if checksum(record.data) != self.description.get(OPENING_CRC):
                    self.damage = "what it begins with has changed"
                    break
                return exact.decode(record.data, Opening)
            if isinstance(record, Message | Footer):
                break
        if self.damage:
            raise InputError(f"{self.path} is damaged where it begins ({self.damage}): nothing of it can be read.")
        raise InputError(
            f"{self.path} is an MCAP file, but no walk that was recorded here: name a file that `vbr walks list` shows."
        )


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
