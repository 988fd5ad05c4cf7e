"""What the live stream tells of each device: made and encoded once, for all pages that show it.

A picture is made anew with each message of its device. Its :data:`PARTS`, the greater part of its bytes, change a few
times a minute: each page is told them once, and again when they change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import msgspec

from console.alerts.alerts import Alert
from console.live import LiveDevice
from console.live_panel import changing_view, commands_view, events_view, own_commands_view, route_view

REUSED_S = 0.05
"""So long a picture is told again of a device that has told nothing since: nobody sees how much older it is."""
_CLOCK_MOVED_S = 0.02
"""Ages in a part are right as long as the device's clock is known to no other offset than this."""
_ViewOf = Callable[[LiveDevice, float], object]
PARTS: Mapping[str, _ViewOf] = MappingProxyType({"events": events_view, "commands": commands_view, "route": route_view})
"""The parts that seldom change, each made of the device's field of that name; beside them the ``alerts``."""
UNWATCHED_PARTS: Mapping[str, _ViewOf] = MappingProxyType(
    {"events": lambda device, now_s: [], "commands": own_commands_view, "route": lambda device, now_s: None}
)


class ShownAlerts(Protocol):
    """What is asked of the alerts."""

    def active(self, device_id: str | None = None) -> tuple[Alert, ...]:
        """Return those of a device that are not done with."""
        ...

    def views(self, device_id: str | None = None) -> list[dict[str, Any]]:
        """Return them as plain data for JSON."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A part as it is told; another object only where it is another part."""

    source: object
    clock_offset_s: float
    encoded: msgspec.Raw
    """``{"now_s": …, "value": …}``: the ages in the value are those at that time, on the console's clock."""

    def is_of(self, source: object, clock_offset_s: float) -> bool:
        """Say whether it tells this, dated as the device's clock is known now."""
        is_same = self.source is source or self.source == source
        return is_same and abs(self.clock_offset_s - clock_offset_s) <= _CLOCK_MOVED_S


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One device at one instant."""

    device: LiveDevice
    made_s: float
    """The ages in ``changing`` are those at that time, on the console's clock."""
    changing: msgspec.Raw
    parts: Mapping[str, Part]


class LivePictures:
    """The pictures of all devices. For one thread: the loop that serves the pages."""

    def __init__(self, alerts: ShownAlerts) -> None:
        self._alerts = alerts
        self._pictures: dict[tuple[str, bool], Picture] = {}

    def of(self, device: LiveDevice, now_s: float, *, is_watched: bool) -> Picture:
        """Return a device as it is shown to who watches it, or to who does not."""
        key = device.device_id, is_watched
        known, alerts = self._pictures.get(key), self._alerts.active(device.device_id)
        before = known.parts if known is not None else {}
        parts = {name: _part(before.get(name), device, name, now_s, view) for name, view in _views(is_watched).items()}
        parts["alerts"] = self._alerts_part(before.get("alerts"), alerts, device.device_id, now_s)
        if known is not None and known.device is device and now_s - known.made_s < REUSED_S:
            picture = Picture(device, known.made_s, known.changing, parts)
        else:
            view = changing_view(device, now_s, is_watched=is_watched)
            picture = Picture(device, now_s, msgspec.Raw(msgspec.json.encode(view)), parts)
        self._pictures[key] = picture
        return picture

    def forget(self, device_id: str) -> None:
        """Keep nothing any more of a device that the hub has forgotten."""
        for is_watched in (True, False):
            self._pictures.pop((device_id, is_watched), None)

    def _alerts_part(self, known: Part | None, alerts: tuple[Alert, ...], device_id: str, now_s: float) -> Part:
        if known is not None and known.is_of(alerts, 0.0):
            return known
        return Part(alerts, 0.0, _dated(now_s, self._alerts.views(device_id)))


@dataclass(slots=True)
class Told:
    """Which parts one page has been told."""

    _parts: dict[tuple[str, str], Part] = field(default_factory=dict)

    def news(self, pictures: list[Picture]) -> dict[str, Any]:
        """Return ``{"parts": {device id: {name: part}}}`` of those that are news to the page; empty where none is."""
        now = {(each.device.device_id, name): part for each in pictures for name, part in each.parts.items()}
        news: dict[str, dict[str, msgspec.Raw]] = {}
        for key, part in now.items():
            if self._parts.get(key) is not part:
                news.setdefault(key[0], {})[key[1]] = part.encoded
        self._parts = now
        return {"parts": news} if news else {}


def _views(is_watched: bool) -> Mapping[str, _ViewOf]:
    return PARTS if is_watched else UNWATCHED_PARTS


def _part(known: Part | None, device: LiveDevice, name: str, now_s: float, view: _ViewOf) -> Part:
    source = getattr(device, name)
    if known is not None and known.is_of(source, device.clock_offset_s):
        return known
    return Part(source, device.clock_offset_s, _dated(now_s, view(device, now_s)))


def _dated(now_s: float, value: object) -> msgspec.Raw:
    return msgspec.Raw(msgspec.json.encode({"now_s": now_s, "value": value}))
