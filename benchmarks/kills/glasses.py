"""A device on its link while the console is killed: its events, and the settings that it takes, tries out and keeps."""

from __future__ import annotations

import random
import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
from websockets.sync.client import ClientConnection, connect

from benchmarks.kills.nursery import must
from console.store import DATABASE_FILE
from device_agent.orders import carry_out
from device_agent.settings_trial import after_trial, running
from device_agent.state import DeviceState
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.wire import (
    PROTOCOL_VERSION,
    ApplySettings,
    ConsoleMessage,
    DeviceMessage,
    Event,
    EventConfirmed,
    Hello,
    KeepSettings,
    Ping,
    Pong,
    SettingsRunning,
    Welcome,
    decode_from_console,
    encode,
)

WAIT_S = 20.0
"""A console that answers nothing for so long has failed."""
_TUNED, _TUNED_RANGE = "planning.replan_hold_s", (0.5, 30.0)
"""A setting that nobody's safety hangs on."""
_TRIED, _TRIED_RANGE = "gate.clearance_m", (1.0, 1.9)
"""One that is tried out before it is kept."""
_SETTINGS_SHARE, _TRIED_SHARE, _LAPSED_SHARE = 0.3, 0.5, 0.3


class Glasses:
    """Events are confirmed once they are stored; what becomes of settings is decided by the device's own code."""

    def __init__(self, http: httpx.Client, dice: random.Random, token: str, checksum: str, data: Path) -> None:
        self.http, self.dice, self._token, self._checksum, self._data = http, dice, token, checksum, data
        self.confirmed = self.sent = 0
        self._state = DeviceState(Settings(), PoiGraph())
        self._fates: dict[int, str] = {}
        """What has become of each revision that was ordered."""
        self._told_revision = 0
        """The one that the console is known to have heard of last."""
        self._unheard: set[int] = set()
        """What the console may never have heard of: its time ran out on the device while the console was dead."""
        self._values: dict[int, tuple[float, float]] = {}
        self._socket: ClientConnection | None = None
        self.done_count = 0

    def check(self) -> None:
        """Connect anew: everything that was confirmed is there, in order, once; and every revision of the settings."""
        if self._state.trial is not None and self.dice.random() < _LAPSED_SHARE:
            # Nobody is there to be told: that it went back is known by what runs.
            if self._state.settings_revision != self._told_revision:
                self._unheard.add(self._state.settings_revision)
            self._lapse()
        url = str(self.http.base_url).rstrip("/").replace("http", "ws") + "/device"
        self._socket = connect(url, additional_headers={"Authorization": f"Bearer {self._token}"}, proxy=None)
        revision = self._state.settings_revision
        self._send(Hello(PROTOCOL_VERSION, "glasses", "0.1.0", "small", self._checksum, 0, revision, time.monotonic()))
        self._send(running(self._state))
        welcome = self._until(Welcome)
        must(welcome.last_event_sequence >= self.confirmed, "events were lost:", welcome, self.confirmed)
        self.confirmed = welcome.last_event_sequence
        with closing(sqlite3.connect(f"file:{self._data / DATABASE_FILE}?mode=ro", uri=True)) as base:
            stored = base.execute("SELECT sequence, text FROM device_events ORDER BY id").fetchall()
        wanted = [(number, f"event {number}") for number in range(1, self.confirmed + 1)]
        must(stored == wanted, "events are missing, doubled or out of order:", stored[-3:], wanted[-3:])
        self.sent = self.confirmed
        self._event()
        self._check_revisions()

    def turn(self) -> None:
        """Tell of an event, or have settings changed, kept, given up, or let their time run out."""
        if self.dice.random() >= _SETTINGS_SHARE:
            self._event()
        elif self._state.trial is None:
            self._change_settings()
        elif self.dice.random() < _LAPSED_SHARE:
            self._send(self._lapse())
            self._event()
        else:
            self._decide()
        self.done_count += 1

    def _check_revisions(self) -> None:
        """What the device runs has been told once more, so each revision stands as the device has left it."""
        told = self.http.get("/api/devices/glasses/settings").raise_for_status().json()["revisions"]
        found = {each["revision"]: each for each in told}
        for number in sorted(self._fates)[-10:]:
            must(number in found, "a revision of the settings is gone:", number, list(found))
            fates = {self._fates[number]} | ({"unanswered"} if number in self._unheard else set())
            must(found[number]["state"] in fates, "another fate:", found[number]["state"], number, fates)
        for number, each in found.items():
            values = each["values"][_TUNED], each["values"][_TRIED]
            must(self._values.setdefault(number, values) == values, "a revision was changed:", number, values)
            must(number in self._fates or each["state"] == "unanswered", "it was never ordered:", each)

    def _change_settings(self) -> None:
        is_tried = self.dice.random() < _TRIED_SHARE
        key, limits = (_TRIED, _TRIED_RANGE) if is_tried else (_TUNED, _TUNED_RANGE)
        body = {"changes": {key: round(self.dice.uniform(*limits), 2)}, "confirmed": True}
        answer = self.http.patch("/api/devices/glasses/settings", json=body)
        if answer.status_code != 202:
            must(answer.status_code < 500, "settings:", answer.status_code, answer.text)
            return
        order = self._until(ApplySettings)
        self._carry_out(order)
        runs = self._state.settings.values()
        must(self._state.settings_revision == order.revision, "an order that the device refuses:", order)
        self._values[order.revision] = float(runs[_TUNED]), float(runs[_TRIED])
        self._event()

    def _decide(self) -> None:
        """Keep what is tried out, or give it up."""
        revision, keep = self._state.settings_revision, self.dice.random() < _TRIED_SHARE
        body = {"revision": revision, "keep": keep}
        answer = self.http.post("/api/devices/glasses/settings/keep", json=body)
        must(answer.status_code == 202, "what is tried out cannot be kept:", answer.status_code, answer.text)
        self._carry_out(self._until(KeepSettings))
        must(self._fates[revision] == ("running" if keep else "reverted"), "not as asked for:", body, self._fates)
        self._event()

    def _carry_out(self, order: ApplySettings | KeepSettings) -> None:
        self._state, effects = carry_out(self._state, order, time.monotonic())
        (told,) = [effect for effect in effects if isinstance(effect, SettingsRunning)]
        self._note(told)
        self._send(told)

    def _lapse(self) -> SettingsRunning:
        """Let the time of a trial run out; return what the device tells of it."""
        assert self._state.trial is not None
        self._state, effects = after_trial(self._state, self._state.trial.until_s)
        (told,) = [effect for effect in effects if isinstance(effect, SettingsRunning)]
        self._note(told)
        return told

    def _note(self, told: SettingsRunning) -> None:
        if told.refused_revision is not None:
            self._fates[told.refused_revision] = "reverted"
        if told.revision > 0:
            self._fates[told.revision] = "running" if told.revert_at_s is None else "trying"

    def _event(self) -> None:
        self.sent += 1
        self._send(Event(self.sent, 1.0, "cue", f"event {self.sent}"))
        must(self._until(EventConfirmed).sequence == self.sent, "another event was confirmed:", self.sent)
        self.confirmed = self.sent
        # It came after what was told of the settings.
        self._told_revision = self._state.settings_revision

    def _send(self, message: DeviceMessage) -> None:
        assert self._socket is not None
        self._socket.send(encode(message))

    def _until(self, kind: type[Any]) -> Any:
        assert self._socket is not None
        while True:
            message: ConsoleMessage = decode_from_console(bytes(self._socket.recv(timeout=WAIT_S)))  # type: ignore[arg-type]
            if isinstance(message, Ping):
                self._send(Pong(message.console_sent_s, time.monotonic(), time.monotonic()))
            if isinstance(message, kind):
                return message
            must(not isinstance(message, ApplySettings | KeepSettings), "nobody has asked for this now:", message)
