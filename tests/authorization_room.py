"""A console without a socket, one caller of each kind at its door, and a valid request for each of its routes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import msgspec
from asgi_calls import Answer, AsgiCalls
from console_room import PASSWORD, HandClock
from fastapi import FastAPI
from viewer_fixtures import RecordingOutlet, connect_device
from viewer_site import crossing_corridors

from console.accounts import SESSION_IDLE_S, SESSION_LONGEST_S
from console.app import app_of
from console.config import ConsoleConfig
from console.edits import AddEdge, AddPoi
from console.graph_store import StoredGraphLog
from console.hub import DeviceHub
from console.model import SiteModel
from console.roles import Role
from console.security import visitor_of
from console.services import Services, build_services
from console.store import Store
from console.viewer.embedded import SUBPROTOCOL
from console.viewer.scene import install
from navcore.recording_upload import RecordingOffer
from navcore.site import save_site

HOST = "localhost:8765"
ORIGIN = f"http://{HOST}"
COOKIE = "vbr_session_8765"
DEVICE_ID = "glasses"
SHA256 = "a" * 64
VALUES = {
    "{device_id}": DEVICE_ID, "{user_id}": "999", "{version}": "0", "{what}": "none", "{sha256}": "0" * 64,
    "{alert_id}": "none", "{incident_id}": "none", "{walk_id}": "none", "{run_id}": "none", "{name}": "none",
    "{key}": "none", "{road_id}": "none",
}  # fmt: skip
ROLES: tuple[Role, ...] = get_args(Role)


@dataclass
class Room:
    """The console, and what was made for the callers."""

    services: Services
    app: FastAPI
    calls: AsgiCalls
    clock: HandClock
    outlet: RecordingOutlet
    """What is sent to the one device that is connected."""
    user_ids: dict[str, int]
    callers: dict[str, dict[str, str]]
    """Headers by the name of who sends them."""

    def session(self, name: str) -> dict[str, str]:
        """Return the headers of a fresh session of somebody, as our own page sends them."""
        token = self.services.accounts.start_session(self.user_ids[name])
        return {"Host": HOST, "Origin": ORIGIN, "Cookie": f"{COOKIE}={token}"}

    def call(self, headers: Mapping[str, str], method: str, path: str, body: Any = None) -> Answer:
        """Make a request to a route, with a body that is JSON unless it is bytes."""
        raw = body if isinstance(body, bytes) else b"" if body is None else json.dumps(body).encode()
        sent = {**headers, "Content-Type": "application/json"}
        if method == "WS":
            sent["Sec-WebSocket-Protocol"] = SUBPROTOCOL
        return self.calls.call(method, path, sent, raw)


@contextmanager
def authorization_room(folder: Path) -> Iterator[Room]:
    """Open a console over the crossing corridors, with its scene, and somebody of every kind."""
    save_site(crossing_corridors(200), folder / "site")
    config, clock = ConsoleConfig(folder / "site", folder / "data"), HandClock()
    store = Store.open(config.data_folder, clock)
    site = crossing_corridors(200)
    model = SiteModel(site, StoredGraphLog(store, "key", site.name), config.site_folder, clock)
    services = build_services(config, store, model, DeviceHub(clock, clock))
    for name, x_m in (("Hall", 1.0), ("Bar", 19.0)):
        model.apply(AddPoi(name, "hall", x_m, 0.0), "setup")
    model.apply(AddEdge("hall", "bar"), "setup")
    model.publish("setup")
    app = app_of(services)
    scene = install(app, services, visitor_of)
    try:
        with AsgiCalls(app) as calls:
            room = Room(services, app, calls, clock, connect_device(services, DEVICE_ID), {}, {})
            _invite(room)
            _gather(room)
            yield room
    finally:
        scene.stop()
        services.what_ifs.close()
        services.surveys.close()
        services.checks.close()
        services.builds.close()
        store.close()


def _invite(room: Room) -> None:
    accounts = room.services.accounts
    first = accounts.first_admin_link_token()
    assert first is not None
    room.user_ids["admin"] = accounts.use_link(first, "admin", PASSWORD).id
    for name in ("viewer", "editor", "technician", "disabled", "lowered", "renewed"):
        role: Role = name if name in ROLES else "admin"  # type: ignore[assignment]
        _, link = accounts.invite(name, role, "admin")
        room.user_ids[name] = accounts.use_link(link, name, PASSWORD).id


def _gather(room: Room) -> None:
    """One caller of each kind; those that may do nothing were admins, or hold an admin's secrets."""
    accounts, devices, clock = room.services.accounts, room.services.devices, room.clock
    base = {"Host": HOST, "Origin": ORIGIN}
    expired = room.session("admin")
    clock.s += SESSION_LONGEST_S - SESSION_IDLE_S / 2
    for _ in range(3):
        accounts.signed_in(expired["Cookie"].partition("=")[2])
    unused = room.session("admin")
    clock.s += SESSION_IDLE_S + 1.0
    signed_out, disabled, lowered, renewed = (room.session(n) for n in ("admin", "disabled", "lowered", "renewed"))
    room.call(signed_out, "POST", "/api/sign-out")
    accounts.change(room.user_ids["disabled"], "admin", disabled=True)
    accounts.change(room.user_ids["lowered"], "admin", role="viewer")
    accounts.use_link(accounts.new_password_link(room.user_ids["renewed"], "admin"), "", PASSWORD + "!")
    token, revoked, replaced = (devices.create_token(name, "admin") for name in ("Lead", "Gone", "Lead 2"))
    devices.create_token("Lead 2", "admin")
    devices.revoke_token("Gone", "admin")
    by_token = {name: base | {"Authorization": f"Bearer {value}"} for name, value in
                {"device": token, "revoked device token": revoked, "replaced device token": replaced,
                 "forged device token": "x" * 43}.items()}  # fmt: skip
    admin = room.session("admin")
    as_bearer = base | {"Authorization": f"Bearer {admin['Cookie'].partition('=')[2]}"}
    device_cookie = base | {"Cookie": f"{COOKIE}={token}"}
    room.callers |= {
        "nobody": base, "forged cookie": base | {"Cookie": f"{COOKIE}={'x' * 43}"}, "expired session": expired,
        "session not used for a day": unused, "signed-out session": signed_out, "disabled account": disabled,
        "role lowered after sign-in": lowered, "password changed after sign-in": renewed,
        "an admin's session as a device token": as_bearer, "a device token as a cookie": device_cookie,
        **by_token, **{role: room.session(role) for role in ROLES},
    }  # fmt: skip


def requests_of(room: Room) -> dict[str, tuple[str, Any]]:
    """Return a request that each route which may change something can carry out: its path, and its body."""
    version = room.services.model.graph.version
    device = f"/api/devices/{DEVICE_ID}"
    cloud = msgspec.json.encode(RecordingOffer("walk", "walk", 10, SHA256))
    geojson = b'{"type": "FeatureCollection", "features": []}'
    admin = room.services.accounts
    link = admin.new_admin_link_token("command line")
    change = {"changes": {"follower.lead_s": 0.8}, "confirmed": True}
    return {
        "POST /api/sign-in": ("/api/sign-in", {"name": "viewer", "password": PASSWORD}),
        "POST /api/first/look": ("/api/first/look", {"token": "unknown"}),
        "POST /api/first": ("/api/first", {"token": link, "name": "New", "password": PASSWORD}),
        "POST /api/sign-out": ("/api/sign-out", None),
        "POST /api/versions": ("/api/versions", {"name": "Monday"}),
        "POST /api/versions/{version}/roll-back": (f"/api/versions/{version - 1}/roll-back", {"base_version": version}),
        "POST /api/presence": ("/api/presence", {"window": "w"}),
        "POST /api/edits": ("/api/edits", {"edit": "add_poi", "name": "Lounge", "kind": "lounge", "x_m": 5, "y_m": 0}),
        "POST /api/preview": ("/api/preview", {"edit": "add_poi", "name": "L", "kind": "lounge", "x_m": 5, "y_m": 0}),
        "POST /api/undo": ("/api/undo", None),
        "POST /api/redo": ("/api/redo", None),
        "POST /api/publish": ("/api/publish", {"confirmed": True, "version": version}),
        "POST /api/view": ("/api/view", {"camera": "overview"}),
        "POST /api/view/past": ("/api/view/past", {"walk": "none", "at_s": 0, "clock": "12:00:00"}),
        "DELETE /api/view/past": ("/api/view/past", None),
        "POST /api/import/graph": ("/api/import/graph", geojson),
        "POST /api/import/site": ("/api/import/site", b"no archive"),
        "POST /api/rehearsals": ("/api/rehearsals", {"start": "hall", "destination": "bar"}),
        "POST /api/check": ("/api/check", None),
        "POST /api/devices/{device_id}/destination": (f"{device}/destination", {"poi_id": "bar"}),
        "POST /api/devices/{device_id}/say": (f"{device}/say", {"text": "Hello."}),
        "POST /api/devices/{device_id}/colour": (f"{device}/colour", {"why": "which door"}),
        "POST /api/devices/{device_id}/end_watch": (f"{device}/end_watch", {"why": "gone home"}),
        "POST /api/privacy/days": ("/api/privacy/days", {"days": 5}),
        "PATCH /api/devices/{device_id}/settings": (f"{device}/settings", change),
        "POST /api/devices/{device_id}/settings/back": (f"{device}/settings/back", {"revision": 1, "confirmed": True}),
        "POST /api/devices/{device_id}/settings/keep": (f"{device}/settings/keep", {"revision": 1}),
        "POST /api/alerts/{alert_id}/acknowledge": ("/api/alerts/none/acknowledge", {"note": "seen"}),
        "POST /api/alerts/{alert_id}/shelve": ("/api/alerts/none/shelve", {"minutes": 5, "reason": "known"}),
        "POST /api/alerts/{alert_id}/unshelve": ("/api/alerts/none/unshelve", None),
        "POST /api/settings/presets": ("/api/settings/presets", {"name": "Mine", "values": {"follower.lead_s": 0.8}}),
        "POST /api/settings/presets/import": (
            "/api/settings/presets/import",
            {"format": "vbr-settings-preset", "version": 1, "name": "Theirs", "values": {"follower.lead_s": 0.8}},
        ),
        "PATCH /api/settings/presets/{name}": ("/api/settings/presets/Mine", {"name": "Ours"}),
        "DELETE /api/settings/presets/{name}": ("/api/settings/presets/Theirs", None),
        "POST /api/what-if": ("/api/what-if", {"walk_id": "none", "changes": {"follower.lead_s": 0.8}}),
        "POST /api/users": ("/api/users", {"name": "Vera", "role": "viewer"}),
        "PATCH /api/users/{user_id}": (f"/api/users/{room.user_ids['lowered']}", {"role": "editor"}),
        "POST /api/users/{user_id}/link": (f"/api/users/{room.user_ids['lowered']}/link", None),
        "POST /api/tokens": ("/api/tokens", {"name": "New glasses"}),
        "POST /api/tokens/revoke": ("/api/tokens/revoke", {"name": "New glasses"}),
        "POST /api/device/recordings": ("/api/device/recordings", cloud),
        "PUT /api/device/recordings/{sha256}": (f"/api/device/recordings/{SHA256}?offset=0", b"piece"),
    }  # fmt: skip


def filled(path: str) -> str:
    """Return a path with values in the place of its parameters."""
    for name, value in VALUES.items():
        path = path.replace(name, value)
    return "/static/style.css" if path == "/static" else path
