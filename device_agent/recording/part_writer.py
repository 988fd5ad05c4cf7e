"""One file of a recording: an MCAP that is whole up to its last flush, whatever happens to the process."""

from __future__ import annotations

import contextlib
import os
import threading
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from mcap.writer import CompressionType, Writer

from device_agent.recording import exact
from device_agent.recording.channels import Channel, encoder_of, schema_of
from device_agent.recording.foxglove import nanoseconds
from device_agent.recording.notes import Opening
from navcore.walk_file import METADATA_NAME

LIBRARY = "virtual-blind-road"
OPENING_NAME, OPENING_TYPE = "opening", "application/msgpack"
OPENING_CRC = "opening_crc32"
"""MCAP's readers do not look at the checksums of attachments."""
_CHUNK_BYTES = 4 << 20
_MAX_SEQUENCE = 0xFFFF_FFFF


class PartWriter:
    """Writes messages of the table's channels to one file. Every method but :meth:`abandon` may raise OSError."""

    def __init__(self, file: BinaryIO, opening: Opening, description: dict[str, str]) -> None:
        """Begin a file with what a replay begins with; ``description`` is for people and for lists of files."""
        self._file = file
        self._writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._channel_ids: dict[str, int] = {}
        self._schema_ids: dict[str, int] = {}
        self._encoders: dict[str, Callable[[Any], bytes]] = {}
        self._unflushed_bytes = 0
        self._writer.start(library=LIBRARY)
        begins_with = exact.encode(opening)
        self._writer.add_metadata(METADATA_NAME, {**description, OPENING_CRC: checksum(begins_with)})
        self._writer.add_attachment(0, 0, OPENING_NAME, OPENING_TYPE, begins_with)

    @property
    def size_bytes(self) -> int:
        """How large the file is, about: what waits is not compressed yet."""
        return self._file.tell() + self._unflushed_bytes

    def write(self, channel: Channel, stamp_s: float, message: object, number: int = 0) -> None:
        """Add a message; it is in the file after the next flush."""
        channel_id = self._channel_ids.get(channel.topic) or self._declare(channel)
        data = self._encoders[channel.topic](message)
        time_ns = nanoseconds(stamp_s)
        self._writer.add_message(channel_id, time_ns, data, time_ns, number & _MAX_SEQUENCE)
        self._unflushed_bytes += len(data)

    def flush(self) -> None:
        """Hand everything to the operating system: from now on it outlives this process."""
        self._writer.flush()
        self._unflushed_bytes = 0

    def finish(self) -> None:
        """Write the index, and everything through to the disk, and close the file."""
        self._writer.finish()
        self._file.flush()
        sync(self._file)
        self._file.close()

    def abandon(self) -> None:
        """Close a file that cannot be written any more, as it is: it is read up to its last flush."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _declare(self, channel: Channel) -> int:
        schema_id = self._schema_ids.get(channel.schema_name)
        if schema_id is None:
            schema_id = self._writer.register_schema(channel.schema_name, channel.schema_encoding, schema_of(channel))
            self._schema_ids[channel.schema_name] = schema_id
        channel_id = self._writer.register_channel(channel.topic, channel.encoding, schema_id)
        self._channel_ids[channel.topic] = channel_id
        self._encoders[channel.topic] = encoder_of(channel)
        return channel_id


def checksum(data: bytes) -> str:
    """Return the CRC-32 of what a file begins with."""
    return f"{zlib.crc32(data):08x}"


def create(path: Path) -> BinaryIO:
    """Make a new file. Raises OSError, above all where there is one of this name."""
    return path.open("xb")


def sync(file: BinaryIO) -> None:
    """Write a file through to the disk, where it lies on one. Raises OSError."""
    os.fdatasync(file.fileno())


class DiskSync:
    """Writes a file through to the disk now and then, in a thread of its own: the disk may take its time.

    What has been handed to the operating system outlives the process; this is for the battery that is pulled out.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._busy = False

    def request(self, path: Path) -> None:
        """Write the file through soon; while one is being written, nothing more is asked of the disk."""
        with self._lock:
            if self._busy:
                return
            self._busy = True
        try:
            threading.Thread(target=self._sync, args=(path,), name="recording-sync", daemon=True).start()
        except RuntimeError:
            # No memory, or too many threads, just now: recording goes on, and the disk is asked again soon.
            with self._lock:
                self._busy = False

    def _sync(self, path: Path) -> None:
        try:
            with contextlib.suppress(OSError):
                # A descriptor of its own: the writer may close its file meanwhile.
                descriptor = os.open(path, os.O_RDONLY)
                try:
                    os.fdatasync(descriptor)
                finally:
                    os.close(descriptor)
        finally:
            with self._lock:
                self._busy = False
