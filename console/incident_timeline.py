"""An incident as a timeline, for the player of past walks. Times are the console's steady clock: silence is in it."""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass

import msgspec
import numpy as np

from console.alerts.incident_replay import replayed
from console.alerts.incidents import Incident, Incidents
from console.errors import NotFoundError
from console.live import LiveDevice
from console.message_log import TimedMessage
from console.timeline import ColumnsBuilder, Timeline
from console.walk_marks import Mark, marks_of
from navcore.errors import VbrError
from navcore.wire import DepthImage, Event, RouteChanged, WalkerState

_TROUBLES = {
    "keeping": "This incident is still being kept: open it again when it is complete.",
    "cut_off": "This incident was cut off: the console ended meanwhile, or its disk was full.",
}


@dataclass(frozen=True, slots=True, eq=False)
class IncidentTimeline(Timeline):
    """What a device sent around something that happened, as the console heard it."""

    incident: Incident
    _devices: tuple[tuple[float, LiveDevice], ...]
    """The device after each message, with the time at which it came."""
    _depths: tuple[tuple[float, bytes], ...]

    @property
    def ended_s(self) -> float:
        """Where the incident ends; silence until then belongs to it. Of one without its end, the last message."""
        incident, last_s = self.incident, self._devices[-1][0]
        whole_s = incident.steady_at_began_s + incident.ends_at_s - incident.began_at_s
        return max(last_s, whole_s) if incident.state == "complete" else last_s

    @property
    def began_at_s(self) -> float:
        """Unix time of the first cycle."""
        return self.incident.began_at_s + self.began_s - self.incident.steady_at_began_s

    def state_at(self, index: int) -> WalkerState | None:
        """Return the state of a cycle."""
        return self.device_at(float(self.stamps_s[index])).state

    def device_at(self, stamp_s: float) -> LiveDevice:
        """Return the device as the console knew it then."""
        found = bisect_right(self._devices, stamp_s, key=lambda each: each[0])
        return self._devices[max(0, found - 1)][1]

    def depth_stamp_s(self, stamp_s: float) -> float | None:
        """Return when the depth silhouette came that was the newest then; None where there was none."""
        found = bisect_right(self._depths, stamp_s, key=lambda each: each[0])
        return self._depths[found - 1][0] if found else None

    def depth_jpeg(self, stamp_s: float) -> bytes:
        """Return the depth silhouette that was the newest then. Raises NotFoundError."""
        found = bisect_right(self._depths, stamp_s, key=lambda each: each[0])
        if not found:
            raise NotFoundError("No depth silhouette had come until then.")
        return self._depths[found - 1][1]

    @property
    def has_pictures(self) -> bool:
        """Whether depth silhouettes are in it."""
        return bool(self._depths)

    def marks(self) -> tuple[Mark, ...]:
        """Return what stands out, the causes of the incident among it, by time."""
        incident = self.incident
        causes = (
            Mark("alert", max(0.0, cause.at_s - self.began_at_s), 0.0, cause.sentence) for cause in incident.causes
        )
        return tuple(sorted((*marks_of(self), *causes), key=lambda mark: (mark.at_s, mark.kind)))


def incident_timeline(incident: Incident, messages: Iterable[TimedMessage]) -> IncidentTimeline:
    """Return an incident as a timeline: up to where its messages can be read. Raises NotFoundError where none can."""
    stamps_s, columns, events = [], ColumnsBuilder(), dict[int, Event]()
    devices: list[tuple[float, LiveDevice]] = []
    routes: list[RouteChanged] = []
    depths: list[tuple[float, bytes]] = []
    troubles = [_TROUBLES[incident.state]] if incident.state in _TROUBLES else []
    try:
        for timed, device in replayed(messages, incident.device_name):
            message, at_s = timed.message, timed.arrival_s
            devices.append((at_s, device))
            if isinstance(message, WalkerState):
                stamps_s.append(at_s)
                columns.add(message)
            elif isinstance(message, Event):
                events[message.sequence] = msgspec.structs.replace(message, stamp_s=message.stamp_s - timed.offset_s)
            elif isinstance(message, RouteChanged):
                routes.append(msgspec.structs.replace(message, stamp_s=at_s))
            elif isinstance(message, DepthImage):
                depths.append((at_s, message.jpeg))
    except VbrError as error:
        troubles.append(str(error))
    if not stamps_s:
        why = " ".join(troubles) or "The device had told no state."
        raise NotFoundError(f"There is nothing to play in this incident. {why}")
    return IncidentTimeline(
        stamps_s=np.array(stamps_s, np.float64), columns=columns.columns(), events=tuple(events.values()), orders=(),
        routes=tuple(routes), places=(), roads=(), troubles=tuple(troubles), incident=incident,
        _devices=tuple(devices), _depths=tuple(depths),
    )  # fmt: skip


class IncidentTimelines:
    """Keeps the timeline that was asked for last: a page asks for it in pieces. May be used from any thread."""

    def __init__(self, incidents: Incidents) -> None:
        self._incidents = incidents
        self._lock = threading.Lock()
        self._key: tuple[Incident, int] | None = None
        self._timeline: IncidentTimeline | None = None

    def named(self, incident_id: str) -> IncidentTimeline:
        """Return an incident's timeline. Raises NotFoundError."""
        incident = self._incidents.named(incident_id)
        with self._lock:
            try:
                key = incident, self._incidents.messages_file(incident_id).stat().st_size
            except OSError as error:
                raise NotFoundError("The messages of this incident are gone: it may have been deleted.") from error
            if self._timeline is None or self._key != key:
                self._timeline, self._key = incident_timeline(incident, self._incidents.messages(incident_id)), key
            return self._timeline

    def forget_deleted(self) -> None:
        """Forget an incident that was deleted."""
        here = {incident.incident_id for incident in self._incidents.all()}
        with self._lock:
            if self._timeline is not None and self._timeline.incident.incident_id not in here:
                self._timeline = self._key = None
