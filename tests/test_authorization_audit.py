"""Whoever changes something is written down, with what and when; and no secret is ever in what is written down."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import msgspec
import pytest
from authorization_room import DEVICE_ID, HOST, ORIGIN, Room, authorization_room
from authorization_statement import IN_GROUP
from console_room import DEFAULTS, PASSWORD, token_of

from navcore.modes import Mode
from navcore.recording_upload import RecordingOffer
from navcore.wire import ApplySettings, SettingsRunning, WalkerState

RECORDING = b"no recording at all"
SHA256 = hashlib.sha256(RECORDING).hexdigest()
WRONG_PASSWORD = "a password in the wrong field"
SENTENCE = "Your daughter is at the door."
DEVICE = f"/api/devices/{DEVICE_ID}"
NOT_WRITTEN_DOWN = {
    "POST /api/presence": "where a window is, forgotten within seconds",
    "POST /api/view": "moves one's own camera",
    "POST /api/view/past": "one's own view; who looked at which walk is in the log of accesses",
    "DELETE /api/view/past": "one's own view",
    "POST /api/preview": "changes nothing",
    "POST /api/rehearsals": "changes nothing",
    "POST /api/check": "measures, and changes nothing",
    "POST /api/first/look": "reads whose link it is",
    "POST /api/what-if": "computes; whose walk was looked at is in the log of accesses",
    "DELETE /api/what-if/{run_id}": "gives up a computation",
    "POST /api/device/recordings": "no person: what is kept names the device that sent it",
    "PUT /api/device/recordings/{sha256}": "no person: what is kept names the device that sent it",
}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with authorization_room(tmp_path_factory.mktemp("audit")) as room:
        yield room


Step = tuple[str, Callable[[Room], str], Callable[[Room], Any]]


def step(route: str, body: Any = None, path: str | Callable[[Room], str] | None = None) -> Step:
    """Return a route to call, how its path comes about, and its body."""
    at = path if path is not None else route.split()[1].replace("/api/devices/{device_id}", DEVICE)
    return route, at if callable(at) else lambda _: str(at), body if callable(body) else lambda _: body


def _found(room: Room, path: str) -> Any:
    return json.loads(room.call(room.callers["admin"], "GET", path).body)


def _user_id(room: Room) -> int:
    return next(each.id for each in room.services.accounts.users() if each.name == "Vera")


def _alert_id(room: Room) -> str:
    return room.services.alerts.active()[0].record.alert_id


def _incident_id(room: Room) -> str:
    for _ in range(2):
        room.services.incidents.write()
        room.clock.s += 60.0
    return str(_found(room, "/api/incidents")["incidents"][0]["incident_id"])


def _changed_graph(room: Room) -> bytes:
    exported = room.call(room.callers["admin"], "GET", "/api/export/graph.geojson").body
    return exported.replace(b"Lounge", b"Salon")


def _import_path(room: Room) -> str:
    preview = room.call(room.callers["admin"], "POST", "/api/import/graph", _changed_graph(room))
    assert preview.status == 200, preview.body
    token = json.loads(preview.body)["token"]
    return f"/api/import/graph?name=map&confirm={token}"


def _site_archive(room: Room) -> bytes:
    return room.call(room.callers["admin"], "GET", "/api/export/site.zip").body


def _versions(room: Room) -> dict[str, int]:
    version = room.services.model.graph.version
    return {"base_version": version}


def _runs(room: Room, trial_s: float | None) -> int:
    """The device says that it runs what it was asked to run, and for how long; return the revision."""
    order = next(message for message in reversed(room.outlet.sent) if isinstance(message, ApplySettings))
    values = room.services.tuning.running_values(room.services.hub.device(DEVICE_ID)) | order.values
    revert_at_s = None if trial_s is None else room.clock.s + trial_s
    told = SettingsRunning(order.revision, values, revert_at_s=revert_at_s)
    room.services.settings.note_running(DEVICE_ID, told)
    room.services.hub.receive(DEVICE_ID, told)
    return order.revision


def _keeping(room: Room) -> dict[str, Any]:
    return {"revision": _runs(room, 60.0), "keep": True}


def _other_settings(room: Room) -> dict[str, Any]:
    _runs(room, None)
    return {"changes": {"follower.lead_s": 0.9}, "confirmed": True}


def _earlier_settings(room: Room) -> dict[str, Any]:
    _runs(room, None)
    return {"revision": 1, "confirmed": True}


def _walker_goes(room: Room) -> str:
    """A device leads somebody, and falls silent: an alert is raised."""
    hub, alerts = room.services.hub, room.services.alerts
    for _ in range(4):
        room.clock.s += 0.5
        hub.receive(DEVICE_ID, WalkerState(room.clock.s, "localized", "walk", "ok", mode=Mode.GUIDING,
                                           destination_id="bar"))  # fmt: skip
        alerts.check()
    hub.disconnect(DEVICE_ID, room.outlet)
    room.clock.s += 60.0
    alerts.check()
    alerts.write()
    return f"/api/alerts/{_alert_id(room)}/shelve"


STEPS: tuple[Step, ...] = (
    step("POST /api/edits", {"edit": "add_poi", "name": "Lounge", "kind": "lounge", "x_m": 5.0, "y_m": 0.0}),
    step("POST /api/undo"),
    step("POST /api/redo"),
    step("POST /api/versions", {"name": "Monday"}),
    step("POST /api/publish", lambda room: {"confirmed": True, "version": room.services.model.graph.version}),
    step("POST /api/import/graph", _changed_graph, _import_path),
    step("POST /api/versions/{version}/roll-back", _versions,
         lambda room: f"/api/versions/{room.services.model.graph.version - 1}/roll-back"),
    step("POST /api/import/site", _site_archive),
    step("POST /api/devices/{device_id}/destination", {"poi_id": "bar"}),
    step("POST /api/devices/{device_id}/pause"),
    step("POST /api/devices/{device_id}/resume"),
    step("POST /api/devices/{device_id}/repeat"),
    step("POST /api/devices/{device_id}/clear"),
    step("POST /api/devices/{device_id}/say", {"text": SENTENCE}),
    step("POST /api/devices/{device_id}/colour", {"why": "which door"}),
    step("POST /api/devices/{device_id}/map-walk/begin"),
    step("POST /api/devices/{device_id}/map-walk/end"),
    step("PATCH /api/devices/{device_id}/settings", {"changes": {"follower.lead_s": 0.8}, "confirmed": True}),
    step("POST /api/devices/{device_id}/settings/keep", _keeping),
    step("PATCH /api/devices/{device_id}/settings", _other_settings),
    step("POST /api/devices/{device_id}/settings/back", _earlier_settings),
    step("POST /api/devices/{device_id}/keep"),
    step("DELETE /api/incidents/{incident_id}", None, lambda room: f"/api/incidents/{_incident_id(room)}"),
    step("POST /api/alerts/{alert_id}/shelve", {"minutes": 5, "reason": "known"}, _walker_goes),
    step("POST /api/alerts/{alert_id}/unshelve", None, lambda room: f"/api/alerts/{_alert_id(room)}/unshelve"),
    step("POST /api/alerts/{alert_id}/acknowledge", {"note": "seen"},
         lambda room: f"/api/alerts/{_alert_id(room)}/acknowledge"),
    step("POST /api/devices/{device_id}/end_watch", {"why": "gone home"}),
    step("POST /api/settings/presets", {"name": "Mine", "values": {"follower.lead_s": 0.8}}),
    step("POST /api/settings/presets/import",
         {"format": "vbr-settings-preset", "version": 1, "name": "Theirs", "values": {"follower.lead_s": 0.8}}),
    step("PATCH /api/settings/presets/{name}", {"name": "Ours"}, "/api/settings/presets/Mine"),
    step("DELETE /api/settings/presets/{name}", None, "/api/settings/presets/Theirs"),
    step("POST /api/recordings/{sha256}/map", None, f"/api/recordings/{SHA256}/map"),
    step("POST /api/users", {"name": "Vera", "role": "viewer"}),
    step("PATCH /api/users/{user_id}", {"role": "editor"}, lambda room: f"/api/users/{_user_id(room)}"),
    step("POST /api/users/{user_id}/link", None, lambda room: f"/api/users/{_user_id(room)}/link"),
    step("POST /api/tokens", {"name": "Other glasses"}),
    step("POST /api/tokens/revoke", {"name": "Other glasses"}),
    step("POST /api/privacy/days", {"days": 5}),
    step("POST /api/privacy/delete"),
    step("POST /api/sign-out"),
    step("POST /api/sign-in", {"name": "admin", "password": PASSWORD}),
)  # fmt: skip


def test_whoever_changes_something_is_written_down_and_no_secret_is(
    room: Room, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    tried, secrets = set(NOT_WRITTEN_DOWN) | {"POST /api/first"}, [PASSWORD, WRONG_PASSWORD, SENTENCE]
    sent = room.services.recordings
    sent.offer(RecordingOffer("recording", "hall", len(RECORDING), SHA256), "Lead")
    sent.add(SHA256, 0, RECORDING)
    room.services.hub.receive(DEVICE_ID, SettingsRunning(0, DEFAULTS))
    admin = room.session("admin")
    for route, path_of, body_of in STEPS:
        path, body = path_of(room), body_of(room)
        room.clock.s += 1.0
        before = room.services.store.latest_audit(1)[0].id
        answer = room.call(admin, route.split()[0], path, body)
        assert 200 <= answer.status < 300, f"{route}: {answer.status} {answer.body[:300]!r}"
        room.services.late_audit.write()
        newest = [row for row in room.services.store.latest_audit(3) if row.id > before]
        assert newest, f"{route} is not written down"
        assert {(row.who, row.at_s) for row in newest} == {("admin", room.clock.s)}, route
        tried.add(route)
        said = msgspec.json.decode(answer.body) if answer.body.startswith(b"{") else {}
        secrets += [said["token"]] if route == "POST /api/tokens" else []
        secrets += [token_of(said["link"])] if "link" in said else []
    changing = {f"{method} {path}" for method, path in IN_GROUP if method not in ("GET", "WS")}
    assert tried == changing, "a route that changes something is written down, or the table says why not"
    link = room.services.accounts.new_admin_link_token("command line")
    for name, password in (("admin", WRONG_PASSWORD), (WRONG_PASSWORD, "x"), ("disabled", PASSWORD)):
        room.call({"Host": HOST, "Origin": ORIGIN}, "POST", "/api/sign-in", {"name": name, "password": password})
    chosen = {"token": link, "name": "Newest", "password": PASSWORD}
    assert room.call({"Host": HOST, "Origin": ORIGIN}, "POST", "/api/first", chosen).status == 200
    rows = [(row.who, row.action) for row in room.services.store.latest_audit(5)]
    assert rows[1:] == [
        ("disabled", "sign_in_failed"), ("unknown name", "sign_in_failed"), ("admin", "sign_in_failed"),
        ("command line", "admin_link"),
    ]  # fmt: skip
    assert rows[0] == ("Newest", "password_chosen")
    secrets += [
        link,
        *(headers["Cookie"].partition("=")[2] for headers in room.callers.values() if "Cookie" in headers),
    ]
    _assert_kept_nowhere(room, secrets, caplog.text)


def _assert_kept_nowhere(room: Room, secrets: list[str], log: str) -> None:
    assert len(secrets) > 10
    with closing(room.services.store._engine.raw_connection()) as connection:
        stored = "\n".join(connection.driver_connection.iterdump())  # type: ignore[union-attr]
    files = b"".join(each.read_bytes() for each in room.services.config.data_folder.rglob("*") if each.is_file())
    for secret in secrets:
        assert secret not in log
        assert secret not in stored
        assert secret.encode() not in files
