"""A device on a real link that tells where its walker is when it is asked to, and does what it is told."""

from __future__ import annotations

import itertools
import threading
from typing import Literal

from console_room import DEFAULTS, DialledDevice, hello_of
from websockets.exceptions import ConnectionClosed

from console.server import ConsoleServer
from navcore.modes import Mode
from navcore.wire import (
    ApplySettings,
    ClearDestination,
    ConsoleMessage,
    Event,
    Ping,
    Pong,
    Repeat,
    RouteChanged,
    Say,
    SetDestination,
    SettingsRunning,
    WalkerState,
    decode_from_console,
)

_REASONS = {
    Mode.PAUSED: "paused", Mode.LOST: "pose_lost", Mode.ARRIVED: "arrived", Mode.FAULT: "sensor_stale",
}  # fmt: skip


class WalkingDevice:
    """A device on a real link that does what it is told."""

    def __init__(self, server: ConsoleServer) -> None:
        token = server.services.devices.create_token("Glasses of Ada", "test")
        self.link = DialledDevice(server.ready.url, token, hello_of(server))
        self.now_s = server.services.hub.now_s
        self._sequence = itertools.count(1)
        self.link.send(SettingsRunning(0, dict(DEFAULTS)))
        self.send_state()
        self._thread = threading.Thread(target=self._answer_all, daemon=True)
        self._thread.start()

    def send_state(self, destination_id: str | None = None, mode: Mode | None = None) -> None:
        """Tell where the walker is."""
        mode = mode or (Mode.READY if destination_id is None else Mode.GUIDING)
        action, reason = ("walk", "ok") if mode is Mode.GUIDING else ("stop", _REASONS.get(mode, "no_route"))
        state = WalkerState(
            self.now_s(), "localized", action, reason, mode=mode, destination_id=destination_id, sonar_state="no_echo"
        )  # fmt: skip
        self.link.send(state)

    def tell(self, kind: Literal["cue", "watchdog"], text: str) -> None:
        """Tell of something that has happened."""
        self.link.send(Event(next(self._sequence), self.now_s(), kind, text))

    def vanish(self) -> None:
        """Break the link."""
        self.link.socket.close()
        self._thread.join()

    def _answer_all(self) -> None:
        try:
            for data in self.link.socket:
                self._answer(decode_from_console(bytes(data)))  # type: ignore[arg-type]
        except ConnectionClosed:
            return

    def _answer(self, message: ConsoleMessage) -> None:
        match message:
            case Ping(console_sent_s):
                self.link.send(Pong(console_sent_s, self.now_s(), self.now_s()))
            case ApplySettings(revision, values):
                self.link.send(SettingsRunning(revision, DEFAULTS | values))
            case ClearDestination():
                self.link.send(RouteChanged(self.now_s()))
                self.send_state()
            case Say(text):
                self.tell("cue", text)
            case SetDestination(poi_id):
                self.link.send(RouteChanged(self.now_s(), ((0.0, 0.0), (6.0, 0.0)), (("Bar", 6.0),), poi_id))
                self.send_state(poi_id)
            case Repeat():
                self.tell("cue", "Move forward.")
