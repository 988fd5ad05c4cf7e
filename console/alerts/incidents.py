"""Incidents: what a device sent from half a minute before something happened until half a minute after it.

::

    FOLDER/ID/
      manifest.json     what, when, of which device and versions (:class:`Incident`)
      messages.vbrlog   the messages (console.message_log)

The messages are written as they come, so whoever kills the console finds what there was until then: what was being
written is closed as cut off when the console starts again, and what was only begun, or half deleted, goes then. What is
kept has no picture in colours.
"""

from __future__ import annotations

import contextlib
import logging
import re
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import msgspec

from console.alerts.message_ring import MessageRing
from console.errors import ConflictError, NoRoomError, NotFoundError
from console.hub import DeviceHub
from console.live import LiveDevice
from console.message_log import MessageLogWriter, TimedMessage, WireRecord, read_messages
from console.recordings import RESERVE_BYTES
from console.retention import UndeletedError
from navcore.errors import InputError
from navcore.folder_swap import sync_path
from navcore.site_files import clear_half_written, write_whole
from navcore.wire import PROTOCOL_VERSION, DeviceMessage, encode

BEFORE_S = 30.0
AFTER_S = 30.0
LONGEST_S = 300.0
"""What happens while an incident is being kept belongs to it, up to this length."""
MANIFEST_FILE = "manifest.json"
MESSAGES_FILE = "messages.vbrlog"
_log = logging.getLogger(__name__)


class Cause(msgspec.Struct, frozen=True):
    """Why an incident is kept."""

    at_s: float
    """Unix time."""
    kind: str
    """An AlertKind, or ``asked``."""
    sentence: str
    alert_id: str = ""
    who: str = ""
    """Who has asked for it; empty for an alert."""


class Versions(msgspec.Struct, frozen=True):
    """What ran when it happened."""

    software: str
    protocol: int
    map_checksum: str
    graph_version: int
    settings_revision: int


class Incident(msgspec.Struct, frozen=True):
    """The manifest of an incident."""

    incident_id: str
    device_id: str
    device_name: str
    causes: tuple[Cause, ...]
    began_at_s: float
    """Unix time at which what is kept begins, at the earliest."""
    ends_at_s: float
    """Unix time at which it ends, or is going to."""
    steady_at_began_s: float
    """The same instant as ``began_at_s`` on the clock of the messages' arrival."""
    versions: Versions
    state: Literal["keeping", "complete", "cut_off"] = "keeping"
    """``cut_off``: the console ended meanwhile, or the disk was full."""
    message_count: int = 0
    size_bytes: int = 0


class _Keeping:
    """An incident that is being written."""

    def __init__(self, incident: Incident, writer: MessageLogWriter, next_number: int, ends_s: float) -> None:
        self.incident, self.writer, self.next_number = incident, writer, next_number
        self.began_s, self.ends_s = incident.steady_at_began_s, ends_s


class Incidents:
    """The incidents in a folder, and what they are made from. All methods may be called from any thread."""

    def __init__(
        self,
        folder: Path,
        hub: DeviceHub,
        wall_s: Callable[[], float] = time.time,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        """``folder`` is made when it is needed; ``free_bytes`` tells the room on its disk."""
        self.folder, self._hub = folder, hub
        self._wall_s, self._free_bytes = wall_s, free_bytes
        self._lock = threading.RLock()
        self._rings: dict[str, MessageRing] = {}
        self._keeping: dict[str, _Keeping] = {}
        for each in _folders(folder):
            clear_half_written(each)
            _delete_half(each)
        for path in folder.glob(f"*/{MANIFEST_FILE}"):
            self._close_cut_off(path)

    # ------------------------------------------------------------------------------------------------ in and out
    def heard(self, device_id: str, kind: type[DeviceMessage], data: bytes) -> None:
        """Take in what a device has just sent."""
        offset_s = self._hub.device(device_id).clock_offset_s
        self._rings.setdefault(device_id, MessageRing()).add(kind, WireRecord(self._hub.now_s(), offset_s, data))

    def forget_device(self, device_id: str) -> None:
        """Hold nothing any more of what a device sent; incidents stay."""
        self._rings.pop(device_id, None)

    def keep(self, device_id: str, cause: Cause) -> str:
        """Keep what was heard of a device before now, and what will be; return the incident's id.

        What happens while one is being kept is added to it. Raises NotFoundError, NoRoomError.
        """
        device = self._hub.device(device_id)
        with self._lock:
            running = self._keeping.get(device_id)
            if running is None:
                running = self._keeping[device_id] = self._begun(device, cause)
            else:
                self._extend(running, cause)
            return running.incident.incident_id

    def write(self) -> None:
        """Write what has come since the last call, and end what is complete; to be called several times a second."""
        with self._lock:
            for ring in tuple(self._rings.values()):
                ring.let_pass(self._hub.now_s())
            for device_id, running in tuple(self._keeping.items()):
                try:
                    self._write(running)
                except OSError as error:
                    _log.error("The incident %s is cut off: %s", running.incident.incident_id, error)
                    self._end(device_id, "cut_off")
                    continue
                if self._hub.now_s() >= running.ends_s or running.writer.is_full:
                    self._end(device_id, "cut_off" if running.writer.is_full else "complete")

    def close(self) -> None:
        """Write what there is, and end what is being kept: the console stops."""
        with self._lock:
            self.write()
            for device_id in tuple(self._keeping):
                self._end(device_id, "cut_off")

    # --------------------------------------------------------------------------------------------------- reading
    def all(self) -> tuple[Incident, ...]:
        """Return every incident, the newest first."""
        found = [each for path in self.folder.glob(f"*/{MANIFEST_FILE}") if (each := _read(path)) is not None]
        return tuple(sorted(found, key=lambda incident: incident.began_at_s, reverse=True))

    def named(self, incident_id: str) -> Incident:
        """Return an incident. Raises NotFoundError."""
        found = _read(self.folder / incident_id / MANIFEST_FILE) if _is_id(incident_id) else None
        if found is None:
            raise NotFoundError("There is no such incident: it may have been deleted.")
        return found

    def messages_file(self, incident_id: str) -> Path:
        """Return where the messages of an incident are. Raises NotFoundError."""
        self.named(incident_id)
        return self.folder / incident_id / MESSAGES_FILE

    def messages(self, incident_id: str) -> Iterator[TimedMessage]:
        """Read the messages of an incident. Raises NotFoundError, MessageLogError, WireError."""
        return read_messages(self.messages_file(incident_id))

    # -------------------------------------------------------------------------------------------------- deleting
    def delete(self, incident_id: str) -> None:
        """Delete an incident. Raises NotFoundError, ConflictError while it is being kept."""
        with self._lock:
            self.named(incident_id)
            if incident_id in self._kept_now():
                raise ConflictError("This incident is still being kept: wait until it is complete.")
            _delete(self.folder / incident_id)

    def delete_before(self, wall_s: float) -> int:
        """Delete the incidents that ended before this Unix time; return how many.

        What nobody describes, for its manifest is damaged or was never written, goes when it was written before then.
        Raises UndeletedError where some could not be deleted.
        """
        deleted, troubles = 0, list[str]()
        with self._lock:
            kept_now = self._kept_now()
            for folder in [each for each in _folders(self.folder) if each.name not in kept_now]:
                try:
                    if _ended_at_s(folder) < wall_s:
                        _delete(folder)
                        deleted += 1
                except OSError as error:
                    troubles.append(f"{folder} ({error.strerror})")
        if troubles:
            raise UndeletedError(f"delete by hand, or see who may write there: {', '.join(troubles)}.", deleted)
        return deleted

    def _kept_now(self) -> set[str]:
        return {running.incident.incident_id for running in self._keeping.values()}

    # ------------------------------------------------------------------------------------------------- internals
    def _begun(self, device: LiveDevice, cause: Cause) -> _Keeping:
        now_s, wall_s = self._hub.now_s(), self._wall_s()
        incident = Incident(
            secrets.token_hex(8), device.device_id, device.name, (cause,), wall_s - BEFORE_S, wall_s + AFTER_S,
            now_s - BEFORE_S, _versions(device),
        )  # fmt: skip
        folder = self.folder / incident.incident_id
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            if self._free_bytes(self.folder) < RESERVE_BYTES:
                raise NoRoomError("There is no room for an incident on the console's machine: free its disk.")
            folder.mkdir(mode=0o700)
            writer = MessageLogWriter(folder / MESSAGES_FILE)
            before, next_number = self._ring(device.device_id).from_time(incident.steady_at_began_s)
            writer.append([WireRecord(device.connected_at_s, device.clock_offset_s, encode(device.hello)), *before])
            # The manifest comes last: what could not be begun is no incident that would be kept for ever.
            write_whole(folder / MANIFEST_FILE, msgspec.json.encode(incident))
            sync_path(folder)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise NoRoomError(
                f"The incident cannot be kept on the console's machine ({error.strerror}): free its disk."
            ) from error
        return _Keeping(incident, writer, next_number, now_s + AFTER_S)

    def _extend(self, running: _Keeping, cause: Cause) -> None:
        now_s = self._hub.now_s()
        running.ends_s = max(running.ends_s, min(now_s + AFTER_S, running.began_s + LONGEST_S))
        incident = running.incident
        running.incident = msgspec.structs.replace(
            incident,
            causes=(*incident.causes, cause),
            ends_at_s=incident.began_at_s + running.ends_s - running.began_s,
        )
        self._write_manifest(running.incident)

    def _ring(self, device_id: str) -> MessageRing:
        return self._rings.setdefault(device_id, MessageRing())

    def _write(self, running: _Keeping) -> None:
        records, next_number = self._ring(running.incident.device_id).since(running.next_number)
        running.writer.append(record for record in records if record.arrival_s <= running.ends_s)
        running.next_number = next_number

    def _end(self, device_id: str, state: Literal["complete", "cut_off"]) -> None:
        running = self._keeping.pop(device_id)
        writer = running.writer
        try:
            writer.close()
        except OSError as error:
            _log.error("The incident %s could not be ended well: %s", running.incident.incident_id, error)
        ends_at_s = running.incident.ends_at_s if state == "complete" else self._wall_s()
        self._write_manifest(
            msgspec.structs.replace(
                running.incident,
                state=state,
                ends_at_s=ends_at_s,
                message_count=writer.message_count,
                size_bytes=writer.size_bytes,
            )
        )

    def _write_manifest(self, incident: Incident) -> None:
        try:
            write_whole(self.folder / incident.incident_id / MANIFEST_FILE, msgspec.json.encode(incident))
        except OSError as error:
            _log.error("The manifest of the incident %s cannot be written: %s", incident.incident_id, error)

    def _close_cut_off(self, manifest: Path) -> None:
        incident = _read(manifest)
        if incident is None or incident.state != "keeping":
            return
        log = manifest.parent / MESSAGES_FILE
        count, size_bytes, ends_at_s = _readable_count(log), log.stat().st_size, log.stat().st_mtime
        self._write_manifest(
            msgspec.structs.replace(
                incident, state="cut_off", ends_at_s=ends_at_s, message_count=count, size_bytes=size_bytes
            )
        )


def _versions(device: LiveDevice) -> Versions:
    return Versions(
        device.hello.software_version, PROTOCOL_VERSION, device.map_checksum, device.graph_version,
        device.settings_revision,
    )  # fmt: skip


def _is_id(name: str) -> bool:
    return re.fullmatch(r"[0-9a-f]{16}", name) is not None


def _folders(folder: Path) -> list[Path]:
    return [each for each in folder.iterdir() if each.is_dir()] if folder.is_dir() else []


def _ended_at_s(folder: Path) -> float:
    """Return when an incident ended (Unix time); of what nobody describes, when it was written last."""
    incident = _read(folder / MANIFEST_FILE)
    if incident is not None:
        return incident.ends_at_s
    return max(path.stat().st_mtime for path in (folder, *folder.iterdir()))


def _delete(folder: Path) -> None:
    """Delete an incident, its manifest last, so that what could not be deleted is found again."""
    manifest = folder / MANIFEST_FILE
    for path in [each for each in folder.iterdir() if each != manifest]:
        path.unlink()
    manifest.unlink(missing_ok=True)
    folder.rmdir()


def _delete_half(folder: Path) -> None:
    """Delete what a console that was killed had only begun to keep, or had begun to delete: one of its files is gone.

    Nobody was told that it is kept, or somebody wanted it gone; and it tells of a walker.
    """
    is_whole = (folder / MANIFEST_FILE).exists() and (folder / MESSAGES_FILE).exists()
    if is_whole or not _is_id(folder.name):
        return
    try:
        _delete(folder)
    except OSError as error:
        _log.error("%s is half an incident, and cannot be deleted: %s", folder, error)


def _readable_count(log: Path) -> int:
    count = 0
    with contextlib.suppress(InputError):
        for _ in read_messages(log):
            count += 1
    return count


def _read(manifest: Path) -> Incident | None:
    try:
        incident = msgspec.json.decode(manifest.read_bytes(), type=Incident)
        if incident.incident_id != manifest.parent.name:
            raise msgspec.ValidationError("it is of another folder")
        return incident
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        _log.warning("%s is passed over, for it cannot be read: %s", manifest, error)
        return None
