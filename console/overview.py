"""Many devices at once, each as a small row of plain data, and what differs between two lists of rows. Pure.

A row holds the time of what it tells on the console's clock, and no age: a device that stands still costs nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from console.live import LiveDevice
from console.live_panel import reason_sentence
from console.place_words import PlaceWords
from navcore.planning.poi_graph import PoiGraph
from navcore.wire import WalkerState

Row = Mapping[str, Any]
"""Every row has the same fields: what is not known any more is told as None."""
_OF_THE_STATE = (
    "mode", "mode_label", "mode_sentence", "action", "reason", "quality", "direction_rad", "place", "destination",
    "remaining_m", "battery_percent", "leads_somebody",
)  # fmt: skip


def overview_row(device: LiveDevice, graph: PoiGraph, places: PlaceWords, *, is_watched: bool = True) -> Row:
    """Return one device; ``captured_s`` is on the console's monotonic clock, and None before its first state.

    Who does not watch it, or is not counted yet, is told that it is there, and nothing of its walker: ``is_told`` tells
    that from a device that has sent nothing.
    """
    state = device.state if is_watched else None
    return {
        "name": device.name,
        "connected": device.connected,
        "is_told": is_watched,
        "captured_s": _rounded(device.captured_s if state is not None else None, 3),
        "uncertainty_s": _rounded(device.clock_uncertainty_s, 4),
        "link_delay_s": _rounded(device.round_trip_s / 2 if device.round_trip_s is not None else None, 3),
        **(_state_row(state, graph, places) if state is not None else dict.fromkeys(_OF_THE_STATE)),
    }


def _state_row(state: WalkerState, graph: PoiGraph, places: PlaceWords) -> Row:
    destination = graph.pois.get(state.destination_id or "")
    return {
        "mode": state.mode.value,
        "mode_label": state.mode.label,
        "mode_sentence": state.mode.sentence,
        "action": state.action,
        "reason": reason_sentence(state.reason),
        "quality": state.quality,
        "direction_rad": _rounded(state.direction_rad, 1),
        "place": places.at(*state.pose[:2]) if state.pose is not None else "",
        "destination": destination.name if destination is not None else state.destination_id,
        "remaining_m": _rounded(state.remaining_m, 0),
        "battery_percent": _rounded(state.battery_percent, 0),
        "leads_somebody": state.leads_somebody,
    }


def differences(before: Mapping[str, Row], now: Mapping[str, Row]) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Return what to change in the rows ``before`` to have those of ``now``, and the ids that are gone."""
    changed = {
        key: fields
        for key, row in now.items()
        if (fields := {name: value for name, value in row.items() if before.get(key, {}).get(name, _NEW) != value})
    }
    return changed, [key for key in before if key not in now]


_NEW = object()


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
