"""An incident as others can use it: a zip that needs no program of ours."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from typing import Any, BinaryIO, cast

import msgspec

from console.alerts.alert_store import AlertRecord
from console.alerts.incidents import MANIFEST_FILE, MESSAGES_FILE, Incidents
from console.exports import ExportedFile
from console.message_log import TimedMessage
from console.recordings import plain_name
from navcore.wire import DepthImage

_README = """What a device sent around an incident, as the console kept it.

manifest.json    what, when, of which device and versions
alerts.json      the alerts that it belongs to
messages.jsonl   the messages, one a line; arrival_s is the console's steady clock (steady_at_began_s in the manifest is
                 the same instant as began_at_s), offset_s the device's clock minus the console's
silhouettes/     the depth camera's view, named by arrival; no picture in colours is kept
messages.vbrlog  the same messages as they came (console/message_log.py)
"""


def bundle(incidents: Incidents, incident_id: str, alerts: list[AlertRecord]) -> ExportedFile:
    """Return an incident as a zip. Raises NotFoundError, MessageLogError, WireError."""
    incident = incidents.named(incident_id)
    file = cast("BinaryIO", tempfile.TemporaryFile(dir=incidents.folder))  # noqa: SIM115  # closed when it is sent
    try:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("README.txt", _README)
            archive.writestr(MANIFEST_FILE, _pretty(incident))
            archive.writestr("alerts.json", _pretty(alerts))
            archive.write(incidents.messages_file(incident_id), MESSAGES_FILE)
            lines = list(_lines(archive, incidents.messages(incident_id)))
            archive.writestr("messages.jsonl", b"".join(lines))
        size_bytes = file.tell()
        file.seek(0)
    except BaseException:
        file.close()
        raise
    name = f"incident-{plain_name(incident.device_name, 'device')}-{incident_id}.zip"
    return ExportedFile(name, "application/zip", file, size_bytes)


def _lines(archive: zipfile.ZipFile, messages: Iterable[TimedMessage]) -> Iterator[bytes]:
    for timed in messages:
        message: Any = msgspec.to_builtins(timed.message)
        if isinstance(timed.message, DepthImage):
            picture = f"silhouettes/{timed.arrival_s:.3f}.jpg"
            archive.writestr(picture, timed.message.jpeg)
            message = message | {"jpeg": picture}
        line = {"arrival_s": timed.arrival_s, "offset_s": timed.offset_s, "message": message}
        yield msgspec.json.encode(line) + b"\n"


def _pretty(value: Any) -> bytes:
    return msgspec.json.format(msgspec.json.encode(value), indent=2)
