"""What the side panel shows of all devices at one instant, as plain data for JSON.

Ages are those at the instant of sending; the page counts them on, so that a frozen picture never looks live.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from console.live import Command, LiveDevice
from console.trace_view import trace_view
from navcore.cues.texts import TEXTS
from navcore.types import Reason

EVENTS_SHOWN_COUNT = 30
COMMANDS_SHOWN_COUNT = 6
OFF_ROAD_SETTING = "follower.off_road_distance_m"
_STATE_FIELDS = (
    "quality", "action", "rule", "pose", "position_std_m", "inlier_count", "direction_rad", "deviation_m",
    "remaining_m", "nearest_ahead_m", "sonar_state", "sonar_m", "speed_m_s", "last_cue", "cycle_ms", "frame_rate_hz",
    "mode", "destination_id", "destination_by", "load_level", "eye_m", "tilt_rad", "battery_percent",
    "is_charging", "temperature_c",
)  # fmt: skip
_OF_THE_DEVICE = ("apply_settings", "keep_settings", "give_up_settings", "begin_map_walk", "end_map_walk")
"""Orders that tell nothing of where its walker goes, or of what they are told."""


def device_view(device: LiveDevice, now_s: float, alerts: Sequence[dict[str, Any]] = ()) -> dict[str, Any]:
    """Return one device with its alerts (as of ``Alerts.views``); ``now_s`` is the console's monotonic clock."""
    return changing_view(device, now_s) | {
        "route": route_view(device, now_s),
        "events": events_view(device, now_s),
        "commands": commands_view(device, now_s),
        "alerts": alerts,
    }


def changing_view(device: LiveDevice, now_s: float, *, is_watched: bool = True) -> dict[str, Any]:
    """Return what may change with each message of a device, and what is small.

    Who does not watch it, or is not counted yet, is told that it is there, and nothing of its walker: ``is_told`` tells
    that from a device that has sent nothing.
    """
    return {
        "id": device.device_id,
        "name": device.name,
        "software": device.hello.software_version,
        "connected": device.connected,
        "is_told": is_watched and device.has_told(now_s),
        "freshness": device.freshness(now_s).value,
        "age_s": device.age_s(now_s),
        "link_delay_s": device.round_trip_s / 2 if device.round_trip_s is not None else None,
        "age_uncertainty_s": device.clock_uncertainty_s,
        "mode": None if device.state is None else device.state.mode,
        "state": _state_view(device, now_s) if is_watched else None,
        "off_road_m": (device.settings or {}).get(OFF_ROAD_SETTING),
        "depth_stamp_s": device.depth_image.stamp_s if device.depth_image and is_watched else None,
        "depth_age_s": device.depth_age_s(now_s) if is_watched else None,
        "watchers": _watchers_view(device),
        "sharing": _sharing_view(device, now_s),
        "settings_revision": device.settings_revision,
        "settings_trial_left_s": device.trial_left_s(now_s),
        "leads_somebody": device.leads_somebody,
        "graph_version": device.graph_version,
        "graph_refusal": device.graph_refusal,
        "map_checksum": device.map_checksum,
        "map_refusal": device.map_refusal,
        "map_waiting": device.map_waiting,
        "map_walk": {
            "running": device.map_walk_running,
            "refusal": device.map_walk_refusal,
            "seen": _map_walk_view(device, now_s),
        },
    }


def events_view(device: LiveDevice, now_s: float) -> list[dict[str, Any]]:
    """Return the latest events, the newest first."""
    return [
        {"sequence": e.sequence, "kind": e.kind, "text": e.text, "age_s": device.age_of(e.stamp_s, now_s)}
        for e in device.events[: -EVENTS_SHOWN_COUNT - 1 : -1]
    ]


def commands_view(device: LiveDevice, now_s: float) -> list[dict[str, Any]]:
    """Return what was asked of a device last, the oldest first."""
    return [_command_view(command, now_s) for command in device.commands[-COMMANDS_SHOWN_COUNT:]]


def own_commands_view(device: LiveDevice, now_s: float) -> list[dict[str, Any]]:
    """Return of these what tells nothing of its walker."""
    commands = [_command_view(each, now_s) for each in device.commands if each.kind in _OF_THE_DEVICE]
    return commands[-COMMANDS_SHOWN_COUNT:]


def _watchers_view(device: LiveDevice) -> list[dict[str, Any]]:
    """Who watches, and whether the device has said that the walker has heard so."""
    told = device.sharing.told if device.sharing is not None else ()
    return [{"name": name, "told": name in told} for name in device.watchers]


def _sharing_view(device: LiveDevice, now_s: float) -> dict[str, Any] | None:
    sharing, stamp_s = device.sharing, device.colour_stamp_s
    if sharing is None:
        return None
    left_s = device.colour_left_s(now_s)
    return {
        "silhouettes": sharing.silhouettes,
        "walks": sharing.walks,
        "colour_for": sharing.colour_for if left_s > 0.0 else "",
        "colour_left_s": left_s,
        "colour_ended": sharing.colour_ended,
        "colour_stamp_s": stamp_s if left_s > 0.0 else None,
        "colour_age_s": device.age_of(stamp_s, now_s) if stamp_s is not None and left_s > 0.0 else None,
    }


def _state_view(device: LiveDevice, now_s: float) -> dict[str, Any] | None:
    state = device.state
    if state is None:
        return None
    view = {name: getattr(state, name) for name in _STATE_FIELDS}
    cue_stamp_s = state.last_cue_stamp_s
    view["reason"] = reason_sentence(state.reason)
    view["mode_label"], view["mode_sentence"] = state.mode.label, state.mode.sentence
    view["trace"] = trace_view(state)
    view["last_cue_age_s"] = device.age_of(cue_stamp_s, now_s) if cue_stamp_s is not None else None
    return view


def _map_walk_view(device: LiveDevice, now_s: float) -> dict[str, Any] | None:
    seen = device.map_walk
    if seen is None:
        return None
    told_s = seen.last_advice_stamp_s
    return {
        "age_s": device.age_of(seen.stamp_s, now_s),
        "recorded_s": seen.recorded_s,
        "frame_count": seen.frame_count,
        "place_count": seen.place_count,
        "landmark_count": seen.landmark_count,
        "loop_count": seen.loop_count,
        "weak_s": seen.weak_s,
        "troubles": [advice_sentence(each) for each in seen.troubles],
        "last_advice": advice_sentence(seen.last_advice) if seen.last_advice else "",
        "last_advice_age_s": None if told_s is None else device.age_of(told_s, now_s),
    }


def advice_sentence(advice: str) -> str:
    """Return an advice of the wire in words; one that this program does not know as it came."""
    return TEXTS["en"].get(f"map_walk_{advice}", advice)


def _command_view(command: Command, now_s: float) -> dict[str, Any]:
    view: dict[str, Any] = msgspec.to_builtins(command)
    return view | {"age_s": now_s - command.asked_s}


def route_view(device: LiveDevice, now_s: float) -> dict[str, Any] | None:
    """Return the way that the walker is led; None where none was told."""
    route = device.route
    if route is None:
        return None
    return {
        "stops": route.stops,
        "destination_id": route.destination_id,
        "refusal": route.refusal,
        "age_s": device.age_of(route.stamp_s, now_s),
    }


def reason_sentence(reason: str) -> str:
    """Return a reason of the wire in plain words; one that this program does not know as it came."""
    try:
        return Reason(reason).sentence
    except ValueError:
        return reason
