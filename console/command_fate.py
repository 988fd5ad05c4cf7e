"""What became of a command, read from what the device says afterwards."""

from __future__ import annotations

from dataclasses import replace

from console.live import Command
from navcore.modes import Mode
from navcore.wire import (
    DeviceMessage,
    Event,
    MapWalkRunning,
    RouteChanged,
    SettingsRunning,
    SharingRunning,
    WalkerState,
    tells_expired,
)

_OPPOSITES = {
    "set_destination": "clear", "clear": "set_destination", "pause": "resume", "resume": "pause",
    "begin_map_walk": "end_map_walk", "end_map_walk": "begin_map_walk",
    "keep_settings": "give_up_settings", "give_up_settings": "keep_settings",
}  # fmt: skip


def judge(command: Command, message: DeviceMessage) -> Command:
    """Return the command as it stands after a message of its device."""
    if command.state != "sent":
        return command
    if isinstance(message, Event) and tells_expired(message, command.id):
        return replace(command, state="refused", refusal="It came too late: the device does not carry it out.")
    if isinstance(message, SettingsRunning):
        return _judge_settings(command, message)
    if isinstance(message, MapWalkRunning):
        return _judge_map_walk(command, message)
    if isinstance(message, SharingRunning):
        return _judge_colour(command, message)
    if isinstance(message, RouteChanged):
        return _judge_route(command, message)
    done = (isinstance(message, WalkerState) and _shown_by(command, message)) or (
        isinstance(message, Event) and _told_by(command, message)
    )
    return replace(command, state="running") if done else command


def superseded(command: Command, by: Command) -> Command:
    """Return a command that still waits, given a later one of the same matter: it will not be answered any more."""
    if (
        command.state == "sent"
        and command.kind not in ("say", "repeat", "ask_colour", "apply_settings")
        and by.kind in (command.kind, _OPPOSITES.get(command.kind))
    ):
        return replace(command, state="unanswered")
    return command


def _judge_settings(command: Command, message: SettingsRunning) -> Command:
    runs = str(message.revision) == command.detail
    if command.kind == "give_up_settings":
        return command if runs and message.revert_at_s is not None else replace(command, state="running")
    if command.kind not in ("apply_settings", "keep_settings"):
        return command
    if message.refused_revision is not None and str(message.refused_revision) == command.detail:
        return replace(command, state="refused", refusal=message.refusal)
    is_kept = message.revert_at_s is None
    return replace(command, state="running") if runs and (is_kept or command.kind == "apply_settings") else command


def _judge_route(command: Command, message: RouteChanged) -> Command:
    if command.kind == "clear":
        return replace(command, state="running") if message.destination_id is None else command
    if command.kind != "set_destination":
        return command
    if message.refusal:
        return replace(command, state="refused", refusal=message.refusal)
    return replace(command, state="running") if message.destination_id == command.detail else command


def _judge_map_walk(command: Command, message: MapWalkRunning) -> Command:
    if command.kind not in ("begin_map_walk", "end_map_walk"):
        return command
    if message.refusal:
        return replace(command, state="refused", refusal=message.refusal)
    is_done = message.is_running is (command.kind == "begin_map_walk")
    return replace(command, state="running") if is_done else command


def _judge_colour(command: Command, message: SharingRunning) -> Command:
    if command.kind != "ask_colour" or str(message.answered_id) != command.detail:
        return command
    return replace(command, state="refused" if message.refusal else "running", refusal=message.refusal)


def _told_by(command: Command, event: Event) -> bool:
    if command.kind == "say":
        return command.detail in event.text
    # Which sentence is said again, only the device knows.
    return command.kind == "repeat" and event.kind == "cue"


def _shown_by(command: Command, state: WalkerState) -> bool:
    match command.kind:
        case "set_destination":
            return state.destination_id == command.detail
        case "clear":
            return state.destination_id is None
        case "pause":
            return state.mode is Mode.PAUSED
        case "resume":
            return state.mode is not Mode.PAUSED
        case "say":
            return state.last_cue == command.detail
        case _:
            return False
