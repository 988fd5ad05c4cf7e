"""All devices that are, or were, connected: what each says, and what is asked of it.

The link (``console.device_link``) hands every message in; pages and scene read :meth:`DeviceHub.devices` and
subscribe. Commands go out at once, and their fate is followed until the device answers.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Protocol

import msgspec

from console.clock_offset import ClockOffset
from console.command_fate import judge, superseded
from console.errors import ConflictError, NotFoundError, TooManyError
from console.live import COMMANDS_KEPT_COUNT, EVENTS_KEPT_COUNT, Command, CommandKind, LiveDevice
from console.overruled import as_heard
from navcore.planning.poi_graph import PoiGraph
from navcore.wire import (
    MESSAGES,
    ORDER_HOLDS_S,
    ApplySettings,
    AskColour,
    BeginMapWalk,
    ClearDestination,
    ColourImage,
    ConsoleMessage,
    DepthImage,
    DeviceMessage,
    EndMapWalk,
    Event,
    GraphRunning,
    Hello,
    KeepSettings,
    MapRunning,
    MapWalkRunning,
    MapWalkSeen,
    Order,
    Pause,
    Pong,
    PublishGraph,
    Repeat,
    Resume,
    RouteChanged,
    Say,
    SetDestination,
    SettingsRunning,
    SharingRunning,
    WalkerState,
    Watchers,
)
from navcore.wire_pace import Allowance, Allowances
from navcore.wire_row import Direction

_log = logging.getLogger(__name__)
_WAIT_S = 5.0
"""So long whoever has asked too often is told to wait."""
STOPPING: frozenset[type[ConsoleMessage]] = frozenset({Pause, ClearDestination})
STOPS_OF_PERSON_HZ = 2.0
FORGOTTEN_AFTER_S = 86_400.0
"""A device that has been away for so long is known no more than after a restart of the console."""
Listener = Callable[[LiveDevice], None]


def _nothing(device_id: str, command: Command) -> None:
    """Nobody keeps a log."""


class Outlet(Protocol):
    """The way to one connected device."""

    def send(self, message: ConsoleMessage) -> None:
        """Queue a message for the device; from any thread, never blocks."""
        ...

    def close(self, code: int, reason: str) -> None:
        """End the link; from any thread, never blocks."""
        ...


class DeviceHub:
    """The devices, latest state and commands. All methods may be called from any thread.

    ``now_s`` is the steady clock of ages, ``wall_s`` the clock of dates.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic, wall_s: Callable[[], float] = time.time) -> None:
        self.now_s = now_s
        self._wall_s = wall_s
        self._lock = threading.RLock()
        self._devices: dict[str, LiveDevice] = {}
        self._outlets: dict[str, Outlet] = {}
        self._clocks: dict[str, ClockOffset] = {}
        self._allowances: dict[str, Allowances] = {}
        """Of what people ask of each connected device: more than the table allows would end its link."""
        self._stops: dict[str, dict[tuple[str, type[ConsoleMessage]], Allowance]] = {}
        """Of what stops each connected walker, by who asks for it."""
        self._colours: dict[str, ColourImage] = {}
        """Beside the devices, so that nobody who keeps what they say keeps a colour picture with it."""
        self._ahead: set[str] = set()
        """Devices whose stamps are ahead of their clock as it was compared; the log tells of it once."""
        self._listeners: list[Listener] = []
        self._forgetting: list[Callable[[str], None]] = []
        self._command_ids = itertools.count(1)
        self.on_command: Callable[[str, Command], None] = _nothing
        """Called with device and command after it was sent, whoever asks: the audit log, which nobody waits for."""
        self.before_colour: Callable[[str, Command], None] = _nothing
        """Called before a walker is asked for a picture: what it raises keeps them from being asked."""

    # ------------------------------------------------------------------------------------------------ reading
    def devices(self) -> tuple[LiveDevice, ...]:
        """Every device that has connected since the console started, and not been away for a day since, by name."""
        with self._lock:
            return tuple(sorted(self._devices.values(), key=lambda device: (device.name, device.device_id)))

    def device(self, device_id: str) -> LiveDevice:
        """Return one device. Raises NotFoundError."""
        device = self._devices.get(device_id)
        if device is None:
            which = f"No device {device_id!r}" if device_id else "No walker's device"
            raise NotFoundError(f"{which} has connected since the console started: switch it on first.")
        return device

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Call ``listener`` after each message of a device, from whichever thread; return what ends that.

        The hub is locked meanwhile: note what changed, and return.
        """
        with self._lock:
            self._listeners.append(listener)

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return unsubscribe

    def subscribe_forgotten(self, listener: Callable[[str], None]) -> None:
        """Call ``listener`` with each device that is forgotten, so that nobody keeps anything of it."""
        self._forgetting.append(listener)

    # --------------------------------------------------------------------------------------------------- link
    def connect(self, hello: Hello, name: str, outlet: Outlet, events: tuple[Event, ...] = ()) -> LiveDevice:
        """Take a device in; an older link of the same device is closed. ``events`` are its latest stored ones."""
        now_s = self.now_s()
        with self._lock:
            older = self._outlets.get(hello.device_id)
            if older is not None:
                older.close(4409, "The same device has connected again.")
            clock = self._clocks[hello.device_id] = ClockOffset(hello.now_s, now_s)
            self._allowances[hello.device_id] = Allowances(MESSAGES, Direction.DOWN, now_s)
            self._stops[hello.device_id] = {}
            self._outlets[hello.device_id] = outlet
            known = self._devices.get(hello.device_id)
            device = LiveDevice(
                hello.device_id, name, hello, True, now_s, clock.offset_s,
                events=known.events if known else events,
                settings_revision=hello.settings_revision,
                graph_version=hello.graph_version,
                map_checksum=hello.map_checksum,
                settings=known.settings if known and known.settings_revision == hello.settings_revision else None,
                watchers=known.watchers if known else (),
                commands=known.commands if known else (),
            )  # fmt: skip
            self._put(device)
            outlet.send(Watchers(device.watchers))
            return device

    def disconnect(self, device_id: str, outlet: Outlet) -> None:
        """Note that a link has ended; a newer link of the same device stays."""
        with self._lock:
            if self._outlets.get(device_id) is not outlet:
                return
            del self._outlets[device_id], self._allowances[device_id], self._stops[device_id]
            device = self._devices[device_id]
            now_s = self.now_s()
            commands = tuple(
                replace(command, state="unanswered", took_s=now_s - command.asked_s)
                if command.state == "sent"
                else command
                for command in device.commands
            )
            self._colours.pop(device_id, None)
            self._put(replace(device, connected=False, commands=commands, colour_stamp_s=None))

    def forget_away(self, but_for: Collection[str] = ()) -> tuple[str, ...]:
        """Forget the devices that have been away for a day, but for some; return them."""
        with self._lock:
            oldest_s = self.now_s() - FORGOTTEN_AFTER_S
            gone = tuple(
                key
                for key, device in self._devices.items()
                if key not in self._outlets
                and key not in but_for
                and max(device.connected_at_s, device.state_arrival_s or 0.0) < oldest_s
            )
            for device_id in gone:
                del self._devices[device_id]
                self._clocks.pop(device_id, None)
                self._ahead.discard(device_id)
        for device_id in gone:
            for listener in self._forgetting:
                listener(device_id)
        return gone

    def receive(self, device_id: str, message: DeviceMessage) -> None:
        """Take in one message of a connected device."""
        now_s = self.now_s()
        with self._lock:
            device = self._updated(self._devices[device_id], message, now_s)
            commands = tuple(_dated(command, judge(command, message), now_s) for command in device.commands)
            self._put(replace(device, commands=commands))

    def send(self, device_id: str, message: ConsoleMessage) -> None:
        """Send what is no command of a person (maps, pings, confirmations); nothing where the device is away."""
        with self._lock:
            outlet = self._outlets.get(device_id)
        if outlet is not None:
            outlet.send(message)

    def offer_graph(self, graph: PoiGraph, map_checksum: str) -> None:
        """Give a published graph to every connected device that runs this map, and another version of the graph."""
        with self._lock:
            behind = [
                outlet
                for device_id, outlet in self._outlets.items()
                if self._devices[device_id].graph_version != graph.version
                and self._devices[device_id].map_checksum == map_checksum
            ]
        for outlet in behind:
            outlet.send(PublishGraph(graph))

    def require_connected(self, device_id: str) -> Outlet:
        """Return the way to a device. Raises NotFoundError or, where it is away, ConflictError."""
        device = self.device(device_id)
        outlet = self._outlets.get(device_id)
        if outlet is None:
            raise ConflictError(f"{device.name} is not connected: wait until it is back, then try again.")
        return outlet

    # ------------------------------------------------------------------------------------------------ privacy
    def connected_ids(self) -> tuple[str, ...]:
        """Return the devices that are connected now."""
        with self._lock:
            return tuple(self._outlets)

    def set_watchers(self, device_id: str, names: tuple[str, ...]) -> None:
        """Show who watches a device, and tell it, where that is news."""
        with self._lock:
            device = self._devices.get(device_id)
            if device is None or device.watchers == names:
                return
            self._put(replace(device, watchers=names))
            self.send(device_id, Watchers(names))

    def colour_image(self, device_id: str, who: str) -> ColourImage:
        """Return the newest colour picture, for the one whom the walker lets see it. Raises NotFoundError."""
        with self._lock:
            device, image = self.device(device_id), self._colours.get(device_id)
            allowed = device.sharing is not None and device.sharing.colour_for == who
            if image is None or not allowed or device.colour_left_s(self.now_s()) <= 0.0:
                raise NotFoundError("There is no picture that you may see: ask the walker first.")
            return image

    def forget_colours(self) -> None:
        """Forget the colour pictures that nobody may see any more, also where the device says nothing of it."""
        with self._lock:
            now_s = self.now_s()
            for device_id in [key for key in self._colours if self._devices[key].colour_left_s(now_s) <= 0.0]:
                del self._colours[device_id]
                self._put(replace(self._devices[device_id], colour_stamp_s=None))

    def keep_events(self, device_id: str, stored: tuple[Event, ...]) -> None:
        """Forget the events of a device that are no longer among the latest ``stored`` ones, nor newer."""
        kept = {event.sequence for event in stored}
        newest = max(kept, default=0)
        with self._lock:
            device = self._devices.get(device_id)
            if device is None:
                return
            events = tuple(each for each in device.events if each.sequence in kept or each.sequence > newest)
            self._put(replace(device, events=events))

    # ----------------------------------------------------------------------------------------------- commands
    def set_destination(self, device_id: str, poi_id: str, who: str) -> Command:
        """Lead the walker to a PoI. Raises NotFoundError, ConflictError or TooManyError, as all commands do."""
        return self._command(device_id, "set_destination", poi_id, who, SetDestination(poi_id, who[:120]))

    def clear(self, device_id: str, who: str) -> Command:
        """Stop leading."""
        return self._command(device_id, "clear", "", who, ClearDestination())

    def pause(self, device_id: str, who: str) -> Command:
        """Hold guidance: the walker stands."""
        return self._command(device_id, "pause", "", who, Pause())

    def resume(self, device_id: str, who: str) -> Command:
        """Go on after a pause."""
        return self._command(device_id, "resume", "", who, Resume())

    def repeat(self, device_id: str, who: str) -> Command:
        """Have the device say its last sentence again."""
        return self._command(device_id, "repeat", "", who, Repeat())

    def begin_map_walk(self, device_id: str, who: str) -> Command:
        """Have a map walk recorded, where nobody is led."""
        return self._command(device_id, "begin_map_walk", "", who, BeginMapWalk())

    def end_map_walk(self, device_id: str, who: str) -> Command:
        """End the map walk."""
        return self._command(device_id, "end_map_walk", "", who, EndMapWalk())

    def say(self, device_id: str, text: str, who: str) -> Command:
        """Speak a sentence to the walker."""
        return self._command(device_id, "say", text, who, Say(text))

    def ask_colour(self, device_id: str, why: str, who: str) -> Command:
        """Ask the walker to let somebody see colour pictures for a minute."""
        request_id = int(self._wall_s() * 1000)
        message = AskColour(request_id, who, why)
        return self._command(device_id, "ask_colour", str(request_id), who, message, first=self.before_colour)

    def apply_settings(self, device_id: str, order: ApplySettings, who: str) -> Command:
        """Have the device change its settings."""
        return self._command(device_id, "apply_settings", str(order.revision), who, order)

    def keep_settings(self, device_id: str, revision: int, who: str, *, keep: bool) -> Command:
        """Have the device keep the settings that it tries out, or give them up."""
        kind: CommandKind = "keep_settings" if keep else "give_up_settings"
        return self._command(device_id, kind, str(revision), who, KeepSettings(revision, keep))

    # ----------------------------------------------------------------------------------------------- internals
    def _command(
        self,
        device_id: str,
        kind: CommandKind,
        detail: str,
        who: str,
        message: ConsoleMessage,
        first: Callable[[str, Command], None] = _nothing,
    ) -> Command:
        with self._lock:
            device, outlet = self.device(device_id), self.require_connected(device_id)
            now_s = self.now_s()
            if not self._may_ask(device_id, type(message), who, now_s):
                raise TooManyError(f"{device.name} has been asked that too often: wait a few seconds.", _WAIT_S)
            command = Command(next(self._command_ids), kind, detail, who, self._wall_s(), asked_s=now_s)
            if isinstance(message, Order):
                expires_s = _expires_s(device, now_s)
                message = msgspec.structs.replace(message, order_id=command.id, expires_s=expires_s)
            kept = device.commands[-COMMANDS_KEPT_COUNT + 1 :]
            earlier = tuple(_dated(old, superseded(old, command), now_s) for old in kept)
            self._put(replace(device, commands=(*earlier, command)))
        first(device_id, command)
        outlet.send(message)
        self.on_command(device_id, command)
        return command

    def _may_ask(self, device_id: str, kind: type[ConsoleMessage], who: str, now_s: float) -> bool:
        if kind in STOPPING:
            # Whoever presses and presses keeps nobody else from stopping the walker.
            own = self._stops[device_id].setdefault((who, kind), Allowance(STOPS_OF_PERSON_HZ, now_s))
            if not own.take(now_s):
                return False
        return self._allowances[device_id].take(kind, now_s)

    def _put(self, device: LiveDevice) -> None:
        self._devices[device.device_id] = device
        for listener in tuple(self._listeners):
            try:
                listener(device)
            except Exception:
                _log.exception("A listener of the hub failed.")

    def _updated(self, device: LiveDevice, message: DeviceMessage, now_s: float) -> LiveDevice:
        match message:
            case WalkerState():
                self._look_at_stamp(device, message.stamp_s, now_s)
                return replace(device, state=as_heard(message, device.events), state_arrival_s=now_s)
            case DepthImage():
                return replace(device, depth_image=message, depth_arrival_s=now_s)
            case ColourImage():
                return self._with_colour(device, message, now_s)
            case RouteChanged():
                return replace(device, route=message)
            case Event():
                events = (*device.events, message)[-EVENTS_KEPT_COUNT:]
                return replace(device, events=events, state=device.state and as_heard(device.state, events))
            case MapWalkSeen():
                return replace(device, map_walk=message)
            case SharingRunning():
                return self._shares(device, message)
            case Pong():
                clock = self._clocks[device.device_id]
                clock.add(message.console_sent_s, message.device_received_s, message.device_sent_s, now_s)
                return replace(
                    device, clock_offset_s=clock.offset_s, clock_uncertainty_s=clock.uncertainty_s,
                    round_trip_s=clock.round_trip_s,
                )  # fmt: skip
            case Hello():
                return replace(device, hello=message)
            case SettingsRunning() | GraphRunning() | MapRunning() | MapWalkRunning():
                return _runs(device, message)

    def _look_at_stamp(self, device: LiveDevice, stamp_s: float, now_s: float) -> None:
        """Note in the log, once, that a device's clock is ahead of what was compared: its ages are counted from
        arrival."""
        ahead_s = stamp_s - device.clock_offset_s - now_s
        is_ahead = device.clock_uncertainty_s is not None and ahead_s > device.clock_uncertainty_s
        if is_ahead and device.device_id not in self._ahead:
            _log.warning(
                "%s stamps what it sends %.1f s ahead of its clock as it was compared: see whether its clock was set."
                " Ages are counted from arrival until it is right.", device.name, ahead_s,
            )  # fmt: skip
        (self._ahead.add if is_ahead else self._ahead.discard)(device.device_id)

    def _with_colour(self, device: LiveDevice, image: ColourImage, now_s: float) -> LiveDevice:
        if device.colour_left_s(now_s) <= 0.0:
            return device
        self._colours[device.device_id] = image
        return replace(device, colour_stamp_s=image.stamp_s)

    def _shares(self, device: LiveDevice, sharing: SharingRunning) -> LiveDevice:
        """What is no longer shared is no longer here."""
        before = device.sharing
        if before is None or not sharing.colour_for or sharing.colour_for != before.colour_for:
            self._colours.pop(device.device_id, None)
            device = replace(device, colour_stamp_s=None)
        depth_image = device.depth_image if sharing.silhouettes else None
        return replace(device, sharing=sharing, depth_image=depth_image)


def _runs(device: LiveDevice, message: SettingsRunning | GraphRunning | MapRunning | MapWalkRunning) -> LiveDevice:
    match message:
        case SettingsRunning():
            return replace(
                device, settings=dict(message.values), settings_revision=message.revision,
                settings_revert_at_s=message.revert_at_s,
            )  # fmt: skip
        case GraphRunning():
            return replace(device, graph_version=message.version, graph_refusal=message.refusal)
        case MapRunning():
            return replace(
                device, map_checksum=message.map_checksum, map_refusal=message.refusal,
                map_waiting=message.waiting_checksum,
            )  # fmt: skip
        case MapWalkRunning(is_running, refusal):
            # What another walk has seen is nothing of this one.
            seen = device.map_walk if is_running == device.map_walk_running or not is_running else None
            return replace(device, map_walk_running=is_running, map_walk_refusal=refusal, map_walk=seen)


def _expires_s(device: LiveDevice, now_s: float) -> float | None:
    """Return until when a device may carry out what is asked now, on its clock; never too early for clocks compared."""
    if device.clock_uncertainty_s is None:
        return None
    return now_s + device.clock_offset_s + device.clock_uncertainty_s + ORDER_HOLDS_S


def _dated(before: Command, after: Command, now_s: float) -> Command:
    """Return what has become of a command, with the time that it took where that is news."""
    return after if after.state == before.state else replace(after, took_s=now_s - after.asked_s)
