"""Settings through the console: applied whole, tried out, locked, gone back to, and named; with devices that dial."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest
from console_room import DEFAULTS, DialledDevice, Person, hello_of, invited, until
from device_hall import Rig
from hypothesis import given, settings
from hypothesis import strategies as st
from link_processes import ConsoleProcess

from console.device_store import DeviceStore as ConsoleDevices
from console.hub import DeviceHub
from console.live_panel import device_view
from console.server import ConsoleServer
from console.settings_store import SettingsStore
from console.store import Store
from console.tuning import Confirmation, Tuning
from device_agent.adapters.clocks import SystemClock
from device_agent.device_store import DeviceStore
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.orders import carry_out
from device_agent.settings_trial import after_trial, running
from device_agent.state import DeviceState, StoreSettings
from navcore.errors import VbrError
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings, SettingValue
from navcore.wire import (
    PROTOCOL_VERSION,
    ApplySettings,
    ConsoleMessage,
    Hello,
    KeepSettings,
    SettingsRunning,
    WalkerState,
    Welcome,
)

DELTA = "gate.clearance_m"
SETTINGS = "/api/devices/glasses/settings"


@pytest.fixture
def device(server: ConsoleServer, admin: Person) -> Iterator[DialledDevice]:
    token = str(admin.http.post("/api/tokens", json={"name": "Lead glasses"}).raise_for_status().json()["token"])
    dialled = DialledDevice(server.ready.url, token, hello_of(server))
    with dialled.socket:
        dialled.next(Welcome)
        dialled.send(SettingsRunning(0, dict(DEFAULTS)))
        until(server.services.hub, lambda d: d.settings is not None)
        yield dialled


def change(person: Person, changes: dict[str, object], **more: object) -> httpx.Response:
    return person.http.patch(SETTINGS, json={"changes": changes, **more})


def revisions(person: Person) -> list[dict[str, Any]]:
    return list(person.http.get(SETTINGS).raise_for_status().json()["revisions"])


def tried_out(server: ConsoleServer, admin: Person, device: DialledDevice) -> ApplySettings:
    change(admin, {DELTA: 1.5}, confirmed=True, why="glass doors").raise_for_status()
    order = device.next(ApplySettings)
    device.send(SettingsRunning(order.revision, DEFAULTS | order.values, revert_at_s=1060.0))
    until(server.services.hub, lambda d: d.settings_revert_at_s is not None)
    return order


def test_what_safety_hangs_on_is_tried_out_and_kept_by_whoever_says_so(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    order = tried_out(server, admin, device)
    assert (order.revert_after_s, order.override_reason) == (60.0, "")
    shown = device_view(server.services.hub.device("glasses"), server.services.hub.now_s())
    assert 50.0 < shown["settings_trial_left_s"] <= 60.0
    assert revisions(admin)[0]["state"] == "trying"
    refused = change(admin, {"cues.announce_m": 8.0})
    assert refused.status_code == 409
    assert "keep it or give it up first" in refused.json()["error"]
    assert admin.http.post(f"{SETTINGS}/keep", json={"revision": order.revision + 1}).status_code == 409
    admin.http.post(f"{SETTINGS}/keep", json={"revision": order.revision}).raise_for_status()
    assert device.next(KeepSettings) == KeepSettings(order.revision)
    device.send(SettingsRunning(order.revision, DEFAULTS | order.values))
    kept = until(server.services.hub, lambda d: d.settings_revert_at_s is None)
    assert [command.state for command in kept.commands] == ["running", "running"]
    assert revisions(admin)[0]["state"] == "running"
    log = admin.http.get("/api/audit").json()
    assert "device_keep_settings" in json.dumps(log)


def test_what_was_not_kept_is_told_kept_in_the_log_and_never_asked_for_again(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    order = tried_out(server, admin, device)
    why = "Revision 1 of the settings was not kept in time: revision 0 runs again."
    device.send(SettingsRunning(0, dict(DEFAULTS), order.revision, why))
    until(server.services.hub, lambda d: d.settings_revert_at_s is None)
    (newest,) = revisions(admin)
    assert (newest["state"], newest["refusal"]) == ("reverted", why)
    assert "settings_reverted" in json.dumps(admin.http.get("/api/audit").json())
    assert server.services.settings.wanted_revision("glasses") is None
    late = admin.http.post(f"{SETTINGS}/keep", json={"revision": order.revision})
    assert (late.status_code, "apply it anew" in late.json()["error"]) == (409, True)


def test_a_trial_that_ended_while_nobody_looked_is_known_at_the_next_joining(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    tried_out(server, admin, device)
    device.socket.close()
    until(server.services.hub, lambda d: not d.connected)
    token = str(admin.http.post("/api/tokens", json={"name": "Lead glasses"}).json()["token"])
    again = DialledDevice(server.ready.url, token, hello_of(server))
    with again.socket:
        again.next(Welcome)
        again.send(SettingsRunning(0, dict(DEFAULTS)))
        until(server.services.hub, lambda d: d.connected and d.settings == DEFAULTS)
        assert revisions(admin)[0]["state"] == "reverted"


def test_an_order_that_was_lost_is_told_and_a_trial_is_never_asked_for_again(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    change(admin, {DELTA: 1.5}, confirmed=True).raise_for_status()
    assert revisions(admin)[0]["state"] == "sent"
    device.socket.close()
    until(server.services.hub, lambda d: not d.connected)
    assert revisions(admin)[0]["state"] == "unanswered"
    assert server.services.settings.wanted_revision("glasses") is None
    assert change(admin, {"cues.announce_m": 8.0}).status_code == 409, "the device is away"


def test_what_safety_hangs_on_is_locked_while_somebody_is_led_unless_it_is_said_why(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    device.send(WalkerState(1000.0, "localized", "walk", "ok", mode=Mode.GUIDING, destination_id="b"))
    until(server.services.hub, lambda d: d.leads_somebody)
    refused = change(admin, {DELTA: 1.5}, confirmed=True)
    assert (refused.status_code, "Somebody is being led" in refused.json()["error"]) == (409, True)
    assert change(admin, {DELTA: 1.5}, confirmed=True, override_reason="  ").status_code == 409
    change(admin, {"cues.announce_m": 8.0}).raise_for_status()
    order = device.next(ApplySettings)
    assert (order.revert_after_s, order.override_reason) == (0.0, "")
    device.send(SettingsRunning(order.revision, DEFAULTS | order.values))
    until(server.services.hub, lambda d: d.settings_revision == order.revision)
    change(admin, {DELTA: 1.5}, confirmed=True, override_reason="Rain.", trial_s=20).raise_for_status()
    order = device.next(ApplySettings)
    assert (order.revert_after_s, order.override_reason) == (20.0, "Rain.")
    assert revisions(admin)[0]["override_reason"] == "Rain."
    assert "though somebody is led (Rain.)" in json.dumps(admin.http.get("/api/audit").json())


def test_an_earlier_revision_is_gone_back_to_as_a_new_one_that_says_so(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    for announce_m in (8.0, 9.0):
        change(admin, {"cues.announce_m": announce_m}).raise_for_status()
        order = device.next(ApplySettings)
        device.send(SettingsRunning(order.revision, DEFAULTS | order.values))
        until(server.services.hub, lambda d, number=order.revision: d.settings_revision == number)
    same = admin.http.post(f"{SETTINGS}/back", json={"revision": 2})
    assert (same.status_code, "already" in same.json()["error"]) == (400, True)
    assert admin.http.post(f"{SETTINGS}/back", json={"revision": 77}).status_code == 404
    admin.http.post(f"{SETTINGS}/back", json={"revision": 1, "why": "Too late."}).raise_for_status()
    assert device.next(ApplySettings).values == {"cues.announce_m": 8.0}, "what is not changed is not sent"
    newest = revisions(admin)[0]
    assert (newest["revision"], newest["why"]) == (3, "Back to revision 1. Too late.")
    assert newest["changes"] == {"cues.announce_m": [9.0, 8.0]}


def test_presets_are_saved_exported_renamed_imported_and_deleted(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    url, http = "/api/settings/presets", admin.http
    built_in = {preset["name"]: preset for preset in http.get(url).json()["presets"]}
    assert built_in["Defaults"]["values"] == DEFAULTS
    assert built_in["Paper"]["values"]["follower.policy"] == "paper"
    http.post(url, json={"name": "Glass  hall", "device_id": "glasses"}).raise_for_status()
    assert http.post(url, json={"name": "glass hall", "device_id": "glasses"}).status_code == 409
    assert http.post(url, json={"name": "paper", "device_id": "glasses"}).status_code == 409
    http.patch(f"{url}/Glass hall", json={"name": "Glass doors"}).raise_for_status()
    exported = http.get(f"{url}/Glass doors").json()
    assert exported["values"] == DEFAULTS
    http.request("DELETE", f"{url}/glass DOORS").raise_for_status()
    assert http.get(f"{url}/Glass doors").status_code == 404
    assert http.request("DELETE", f"{url}/Defaults").status_code == 400
    http.post(f"{url}/import", json=exported | {"values": {DELTA: 1.5}}).raise_for_status()
    assert http.get(f"{url}/Glass doors").json()["values"] == {DELTA: 1.5}


@pytest.mark.parametrize(
    "wrong",
    [
        {"version": 2}, {"format": "other"}, {"more": 1}, {"values": {}}, {"values": {DELTA: 99}},
        {"values": {"no.such": 1}}, {"values": {DELTA: "far"}}, {"name": "a/b"}, {"name": "\x07"},
        {"values": {"obstacle.stop_distance_m": 2.0}},
    ],
)  # fmt: skip
def test_a_preset_is_read_strictly(admin: Person, wrong: dict[str, object]) -> None:
    right = {"format": "vbr-settings-preset", "version": 1, "name": "Mine", "values": {DELTA: 1.5}}
    answer = admin.http.post("/api/settings/presets/import", json=right | wrong)
    assert answer.status_code == 400
    assert answer.json()["error"].endswith(".")
    assert len(admin.http.get("/api/settings/presets").json()["presets"]) == 2


def test_only_who_may_tune_changes_anything(server: ConsoleServer, admin: Person, device: DialledDevice) -> None:
    editor = invited(admin, "Ed", "editor")
    assert change(editor, {"cues.announce_m": 8.0}).status_code == 403
    assert editor.http.post(f"{SETTINGS}/keep", json={"revision": 1}).status_code == 403
    assert change(invited(admin, "Tess", "technician"), {"cues.announce_m": 8.0}).status_code == 202


def test_the_device_goes_back_though_the_console_is_killed_and_the_console_knows_when_it_is_back(
    console: ConsoleProcess, tmp_path: Path
) -> None:
    """Everything is real: the console is killed with -9 while a smaller δ is tried out on a device that walks on."""
    admin = Person(f"http://127.0.0.1:{console.port}")
    admin.open_link(console.first_link, "Ada").raise_for_status()
    journal = EventJournal(tmp_path / "events.sqlite")
    times = {"first_pause_s": 0.02, "longest_pause_s": 0.1}
    link = ConsoleLink(
        LinkSettings(f"ws://127.0.0.1:{console.port}", console.token, tmp_path / "incoming", **times),  # type: ignore[arg-type]
        journal, SystemClock(),
    )  # fmt: skip
    rig = Rig(DeviceStore(tmp_path / "state", tmp_path / "own"), link=link)
    rig.agent.announce()
    link.start(rig.agent)

    def walks_until(holds: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + 60.0
        while not holds():
            rig.cycles(1)
            assert time.monotonic() < deadline_s, "it never came to be so"

    def known() -> dict[str, Any]:
        return dict(admin.http.get(SETTINGS).json())

    walks_until(lambda: known().get("told_by_device", False))
    change(admin, {DELTA: 1.5}, confirmed=True, trial_s=10).raise_for_status()
    walks_until(lambda: rig.agent.state.settings.gate.clearance_m == 1.5)
    tried_s = rig.clock.now_s()
    walks_until(lambda: known()["revisions"][0]["state"] == "trying")
    console.kill()
    walks_until(lambda: rig.agent.state.trial is None)
    assert 9.0 < rig.clock.now_s() - tried_s < 11.0, "by the device's own clock"
    assert rig.agent.state.settings == Settings()
    console.start()
    walks_until(lambda: known().get("told_by_device", False) and known()["revisions"][0]["state"] == "reverted")
    assert known()["values"][DELTA] == 2.0
    rig.cycles(30)
    assert rig.agent.state.settings == Settings(), "nobody asks for it again"
    link.stop()
    journal.close()


# ------------------------------------------------------------------------------------------------------------- a law
class Glasses:
    """A device's state behind a link that may be cut; what is on the way then is lost, as on a socket."""

    def __init__(self, hub: DeviceHub, store: SettingsStore) -> None:
        self.hub, self.store = hub, store
        self.state = DeviceState(Settings(), PoiGraph(), mode=Mode.READY)
        self.now_s, self.disk = 0.0, (Settings(), 0)
        self.orders: list[ConsoleMessage] = []
        self.joined = False

    def send(self, message: ConsoleMessage) -> None:
        """Queue an order."""
        self.orders.append(message)

    def close(self, code: int, reason: str) -> None:
        """Nobody ends this link but the test."""

    def join(self) -> None:
        """Call the console, tell what runs, and take what it wants to run."""
        if self.joined:
            return
        hello = Hello(PROTOCOL_VERSION, "glasses", "0", "s", "m", 1, self.state.settings_revision, self.now_s)
        self.hub.connect(hello, "Glasses", self)
        self.joined = True
        self.tell(running(self.state))
        order = self.store.order_at_joining("glasses", hello.settings_revision)
        if order is not None:
            self.send(order)

    def cut(self) -> None:
        """Lose the link, and what was on the way."""
        if not self.joined:
            return
        self.orders.clear()
        self.joined = False
        self.hub.disconnect("glasses", self)

    def tell(self, message: SettingsRunning) -> None:
        """Tell the console."""
        if self.joined:
            self.store.note_running("glasses", message)
            self.hub.receive("glasses", message)

    def step(self) -> None:
        """Take what was ordered, and look at the clock."""
        orders, self.orders = self.orders, []
        for order in orders:
            self._take(carry_out(self.state, order, self.now_s))  # type: ignore[arg-type]
        self._take(after_trial(self.state, self.now_s))

    def wait(self, time_s: float) -> None:
        """Let time pass."""
        self.now_s += time_s
        self.step()

    def restart(self) -> None:
        """Begin anew with what is on the disk."""
        self.cut()
        settings, revision = self.disk
        self.state = DeviceState(settings, PoiGraph(), settings_revision=revision, mode=Mode.READY)

    def _take(self, step: tuple[DeviceState, tuple[object, ...]]) -> None:
        self.state, effects = step
        for effect in effects:
            if isinstance(effect, StoreSettings):
                self.disk = effect.settings, effect.revision
            if isinstance(effect, SettingsRunning):
                self.tell(effect)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    store = Store.open(tmp_path_factory.mktemp("law"))
    devices = ConsoleDevices(store)
    devices.create_token("Glasses", "test")
    devices.take_in("glasses", "Glasses")
    yield store
    store.close()


def acts(glasses: Glasses, tuning: Tuning) -> dict[str, Callable[[], object]]:
    """Return all that may happen, by name; what is refused raises."""
    sure, values = Confirmation(confirmed=True, override_reason="Because.", trial_s=10.0), iter(range(100))
    ben_saw = [0]

    def ben_looks() -> None:
        ben_saw[0] = running_number()

    def ben_applies(changes: dict[str, SettingValue]) -> None:
        tuning.change("glasses", changes, "Ben", sure, ben_saw[0])

    def running_number() -> int:
        return glasses.hub.device("glasses").settings_revision

    def turns(mode: Mode) -> None:
        glasses.state = replace(glasses.state, mode=mode)
        if glasses.joined:
            glasses.hub.receive("glasses", WalkerState(glasses.now_s, "localized", "stop", "ok", mode=mode))

    return {
        "apply": lambda: tuning.change("glasses", {DELTA: 1.0 + next(values) / 100}, "Ada", sure),
        "apply badly": lambda: tuning.change("glasses", {DELTA: 1.9}, "Ada"),
        "apply quietly": lambda: tuning.change("glasses", {"cues.announce_m": 5.0 + next(values) / 100}, "Ada"),
        "Ben looks": ben_looks,
        "Ben applies": lambda: ben_applies({"cues.announce_m": 8.0 + next(values) / 100}),
        "Ben applies another": lambda: ben_applies({"cues.turn_lead_s": 2.0 + next(values) / 100}),
        "keep": lambda: tuning.keep("glasses", running_number(), "Ada", keep=True),
        "give up": lambda: tuning.keep("glasses", running_number(), "Ada", keep=False),
        "go back": lambda: tuning.back_to("glasses", max(1, running_number() - 1), "Ada", sure),
        "take orders": glasses.step,
        "wait": lambda: glasses.wait(4.0),
        "time out": lambda: glasses.wait(10.0),
        "cut": glasses.cut,
        "join": glasses.join,
        "restart": glasses.restart,
        "walk": lambda: turns(Mode.GUIDING),
        "stand": lambda: turns(Mode.READY),
    }


NAMES = (
    "apply", "apply badly", "apply quietly", "keep", "give up", "go back", "take orders", "wait", "time out", "cut",
    "join", "restart", "walk", "stand", "Ben looks", "Ben applies", "Ben applies another",
)  # fmt: skip


@settings(max_examples=40, deadline=None)
@given(st.lists(st.sampled_from(NAMES), max_size=14))
def test_whatever_happens_the_console_shows_what_the_device_runs_and_the_device_runs_what_it_acknowledged(
    stored: Store, names: list[str]
) -> None:
    with stored.writing() as session:
        for table in ("settings_trials", "settings_revisions"):
            session.connection().exec_driver_sql(f"DELETE FROM {table}")
    hub, store = DeviceHub(now_s=lambda: 0.0), SettingsStore(stored)
    glasses = Glasses(hub, store)
    glasses.join()
    may_happen = acts(glasses, Tuning(store, hub))
    assert set(may_happen) == set(NAMES)
    for name in names:
        with contextlib.suppress(VbrError):
            may_happen[name]()
    glasses.join()
    glasses.step()
    glasses.wait(10.0)
    shown = hub.device("glasses")
    assert shown.settings == glasses.state.settings.values()
    assert (shown.settings_revision, shown.settings_revert_at_s) == (glasses.state.settings_revision, None)
    assert glasses.disk == (glasses.state.settings, glasses.state.settings_revision)
    for revision in store.revisions("glasses", 50):
        assert revision.state != "trying", "time is up for all of them"
        if revision.revision == shown.settings_revision:
            assert (revision.state, dict(revision.values)) == ("running", shown.settings)
    assert told_by_log(store) == shown.settings, "what one technician changed is undone by none who did not see it"


def told_by_log(store: SettingsStore) -> dict[str, SettingValue]:
    """What must run by the log: every change that was kept, from what it was to what it is."""
    values = Settings().values()
    for revision in reversed(store.revisions("glasses", 50)):
        for key, (before, after) in revision.changes.items() if revision.state == "running" else ():
            assert values[key] == before, f"revision {revision.revision} says that it changed what ran"
            values[key] = after
    return values


@pytest.mark.parametrize("order", [("Ada", "Ben"), ("Ben", "Ada")])
def test_of_two_who_change_at_once_one_is_told_that_something_else_runs_by_now(
    server: ConsoleServer, admin: Person, device: DialledDevice, order: tuple[str, str]
) -> None:
    people = {"Ada": admin, "Ben": invited(admin, "Ben", "technician")}
    changes: dict[str, dict[str, object]] = {"Ada": {"cues.announce_m": 8.0}, "Ben": {"cues.direction_style": "clock"}}
    for name in order:
        change(people[name], changes[name], seen_revision=0).raise_for_status()
    first, second = device.next(ApplySettings), device.next(ApplySettings)
    assert (first.values, first.base_revision) == (changes[order[0]], 0)
    assert (second.values, second.base_revision) == (changes[order[1]], 0)
    glasses = DeviceState(Settings(), PoiGraph(), mode=Mode.READY)
    for each in (first, second):
        glasses, effects = carry_out(glasses, each, 0.0)
        for effect in effects:
            if isinstance(effect, SettingsRunning):
                device.send(effect)
    shown = until(server.services.hub, lambda d: d.commands[-1].state == "refused")
    assert shown.settings == DEFAULTS | first.values
    assert [command.state for command in shown.commands] == ["running", "refused"]
    assert "look at what runs, and apply it anew" in revisions(admin)[0]["refusal"]
    late = change(people[order[1]], changes[order[1]], seen_revision=0)
    assert (late.status_code, "runs revision 1 by now" in late.json()["error"]) == (409, True)
    change(people[order[1]], changes[order[1]], seen_revision=1).raise_for_status()


def test_what_a_device_runs_is_not_changed_before_it_has_told_it(server: ConsoleServer, admin: Person) -> None:
    token = str(admin.http.post("/api/tokens", json={"name": "Lead glasses"}).raise_for_status().json()["token"])
    dialled = DialledDevice(server.ready.url, token, hello_of(server, settings_revision=7))
    with dialled.socket:
        dialled.next(Welcome)
        until(server.services.hub, lambda d: d.connected)
        refused = change(admin, {"cues.announce_m": 8.0})
        assert (refused.status_code, "has not told yet what it runs" in refused.json()["error"]) == (409, True)
        assert (
            admin.http.post("/api/settings/presets", json={"name": "Mine", "device_id": "glasses"}).status_code == 409
        )
        dialled.send(SettingsRunning(7, DEFAULTS | {DELTA: 1.5}))
        until(server.services.hub, lambda d: d.settings is not None)
        change(admin, {"cues.announce_m": 8.0}).raise_for_status()
        order = dialled.next(ApplySettings)
        assert (order.values, order.base_revision) == ({"cues.announce_m": 8.0}, 7), "δ is not set to its default"


def test_a_device_that_lost_what_was_kept_is_asked_for_it_again_and_for_nothing_that_it_never_acknowledged(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    tried_out(server, admin, device)
    kept = DEFAULTS | {DELTA: 1.5}
    device.send(SettingsRunning(1, kept))
    until(server.services.hub, lambda d: d.settings_revert_at_s is None)
    change(admin, {"cues.announce_m": 8.0}).raise_for_status()
    device.socket.close()
    until(server.services.hub, lambda d: not d.connected)
    token = str(admin.http.post("/api/tokens", json={"name": "Lead glasses"}).json()["token"])
    again = DialledDevice(server.ready.url, token, hello_of(server))
    with again.socket:
        order = again.next(ApplySettings)
        assert order == ApplySettings(1, kept, base_revision=0, kept_before=True)
        assert revisions(admin)[0]["state"] == "unanswered"
