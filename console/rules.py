"""Who may call what: one table for every route. A route that is not in it is refused (and a test fails).

The method is the HTTP method, or ``WS``; the path is the route's own, with its parameters as written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from console.roles import EDITING, MANAGING, MAPPING, SIGNED_IN, TUNING, Role
from navcore.graph_import import MAX_GRAPH_FILE_BYTES
from navcore.site_archive import MAX_ARCHIVE_BYTES

MAX_BODY_BYTES = 256 << 10
"""A request's body is no larger, where its rule does not say otherwise."""


@dataclass(frozen=True, slots=True)
class Rule:
    """Who may call a route."""

    who: Literal["anyone", "people", "devices"]
    roles: frozenset[Role] = frozenset()
    """Of people."""
    max_body_bytes: int = MAX_BODY_BYTES
    """A larger body is refused, before it is read where it says how long it is."""

    def permits(self, role: Role | None) -> bool:
        """Say whether somebody of this role (None: not signed in) may call it."""
        return self.who == "anyone" or (self.who == "people" and role in self.roles)


ANYONE = Rule("anyone")
DEVICES = Rule("devices")
EVERYBODY = Rule("people", SIGNED_IN)
EDITORS = Rule("people", EDITING)
TECHNICIANS = Rule("people", TUNING)
MAPPERS = Rule("people", MAPPING)
ADMINS = Rule("people", MANAGING)

RULES: Mapping[tuple[str, str], Rule] = {
    # Pages and their files; they hold nothing that is secret, and what they show they ask the API for.
    ("GET", "/signin"): ANYONE,
    ("GET", "/first"): ANYONE,
    ("GET", "/static"): ANYONE,
    ("GET", "/favicon.ico"): ANYONE,
    ("GET", "/healthz"): ANYONE,
    ("GET", "/"): EVERYBODY,
    ("GET", "/overview"): EVERYBODY,
    ("GET", "/pois"): EVERYBODY,
    ("GET", "/versions"): EVERYBODY,
    ("GET", "/checks"): EVERYBODY,
    ("GET", "/rehearse"): EVERYBODY,
    ("GET", "/exchange"): EVERYBODY,
    ("GET", "/settings"): EVERYBODY,
    ("GET", "/alerts"): EVERYBODY,
    ("GET", "/walks"): EVERYBODY,
    ("GET", "/privacy"): EVERYBODY,
    ("GET", "/map-walks"): MAPPERS,
    ("GET", "/admin"): ADMINS,
    # Signing in and out.
    ("POST", "/api/sign-in"): ANYONE,
    ("POST", "/api/first/look"): ANYONE,
    ("POST", "/api/first"): ANYONE,
    ("POST", "/api/sign-out"): EVERYBODY,
    ("GET", "/api/session"): EVERYBODY,
    # The PoI-graph.
    ("GET", "/api/graph"): EVERYBODY,
    ("GET", "/api/history"): EVERYBODY,
    ("GET", "/api/versions"): EVERYBODY,
    ("POST", "/api/versions"): EDITORS,
    ("GET", "/api/versions/{version}/difference"): EVERYBODY,
    ("POST", "/api/versions/{version}/roll-back"): EDITORS,
    ("POST", "/api/presence"): EVERYBODY,
    ("POST", "/api/edits"): EDITORS,
    ("POST", "/api/preview"): EDITORS,
    ("GET", "/api/roads/place"): EVERYBODY,
    ("GET", "/api/roads/{road_id}/place"): EVERYBODY,
    ("POST", "/api/undo"): EDITORS,
    ("POST", "/api/redo"): EDITORS,
    ("POST", "/api/publish"): EDITORS,
    ("POST", "/api/view"): EVERYBODY,
    ("POST", "/api/view/past"): EVERYBODY,
    ("DELETE", "/api/view/past"): EVERYBODY,
    ("GET", "/api/shortcuts"): EVERYBODY,
    # Export and import.
    ("GET", "/api/export/{what}"): MAPPERS,
    ("POST", "/api/import/graph"): Rule("people", EDITING, MAX_GRAPH_FILE_BYTES),
    ("POST", "/api/import/site"): Rule("people", MAPPING, MAX_ARCHIVE_BYTES),
    ("POST", "/api/rehearsals"): EVERYBODY,
    ("GET", "/api/rehearsals/sounds/{key}"): EVERYBODY,
    ("GET", "/api/check"): EVERYBODY,
    ("POST", "/api/check"): EDITORS,
    ("GET", "/api/floor-plan.png"): EVERYBODY,
    ("GET", "/api/floor-plan.svg"): EVERYBODY,
    # The 3D scene.
    ("GET", "/viewer/scene/"): EVERYBODY,
    ("WS", "/viewer/scene"): EVERYBODY,
    # Devices, seen by people.
    ("WS", "/live"): EVERYBODY,
    ("WS", "/live/overview"): EVERYBODY,
    ("GET", "/api/devices/{device_id}/depth.jpg"): EVERYBODY,
    ("POST", "/api/devices/{device_id}/destination"): EDITORS,
    ("POST", "/api/devices/{device_id}/clear"): EDITORS,
    ("POST", "/api/devices/{device_id}/pause"): EDITORS,
    ("POST", "/api/devices/{device_id}/resume"): EDITORS,
    ("POST", "/api/devices/{device_id}/repeat"): EVERYBODY,
    ("POST", "/api/devices/{device_id}/say"): EVERYBODY,
    # Who sees the walkers, and how long what is kept of them stays.
    ("POST", "/api/devices/{device_id}/colour"): EVERYBODY,
    ("GET", "/api/devices/{device_id}/colour.jpg"): EVERYBODY,
    ("GET", "/api/privacy"): EVERYBODY,
    ("POST", "/api/privacy/days"): ADMINS,
    ("POST", "/api/privacy/delete"): ADMINS,
    ("GET", "/api/settings"): EVERYBODY,
    ("GET", "/api/devices/{device_id}/settings"): EVERYBODY,
    ("PATCH", "/api/devices/{device_id}/settings"): TECHNICIANS,
    # Alerts, and the incidents that are kept around them.
    ("WS", "/live/alerts"): EVERYBODY,
    ("GET", "/api/alerts"): EVERYBODY,
    ("POST", "/api/alerts/{alert_id}/acknowledge"): EVERYBODY,
    ("POST", "/api/alerts/{alert_id}/shelve"): EVERYBODY,
    ("POST", "/api/alerts/{alert_id}/unshelve"): EVERYBODY,
    ("GET", "/api/incidents"): EVERYBODY,
    ("GET", "/api/incidents/{incident_id}"): EVERYBODY,
    ("GET", "/api/incidents/{incident_id}/instants"): EVERYBODY,
    ("GET", "/api/incidents/{incident_id}/depth.jpg"): EVERYBODY,
    ("GET", "/api/incidents/{incident_id}/bundle.zip"): EVERYBODY,
    ("DELETE", "/api/incidents/{incident_id}"): ADMINS,
    ("POST", "/api/devices/{device_id}/keep"): EVERYBODY,
    ("POST", "/api/devices/{device_id}/end_watch"): EDITORS,
    # Past walks of devices.
    ("GET", "/api/walks"): EVERYBODY,
    ("GET", "/api/walks/{walk_id}"): EVERYBODY,
    ("GET", "/api/walks/{walk_id}/instants"): EVERYBODY,
    ("GET", "/api/walks/{walk_id}/depth.jpg"): EVERYBODY,
    ("GET", "/api/walk-overlays"): EVERYBODY,
    ("GET", "/api/walk-figures.csv"): EVERYBODY,
    ("POST", "/api/devices/{device_id}/settings/back"): TECHNICIANS,
    ("POST", "/api/devices/{device_id}/settings/keep"): TECHNICIANS,
    ("GET", "/api/settings/presets"): TECHNICIANS,
    ("GET", "/api/settings/presets/{name}"): TECHNICIANS,
    ("POST", "/api/settings/presets"): TECHNICIANS,
    ("POST", "/api/settings/presets/import"): TECHNICIANS,
    ("PATCH", "/api/settings/presets/{name}"): TECHNICIANS,
    ("DELETE", "/api/settings/presets/{name}"): TECHNICIANS,
    # What other settings would have changed in past walks.
    ("GET", "/api/what-if/walks"): TECHNICIANS,
    ("POST", "/api/what-if"): TECHNICIANS,
    ("GET", "/api/what-if/{run_id}"): TECHNICIANS,
    ("DELETE", "/api/what-if/{run_id}"): TECHNICIANS,
    # Map walks, and what was recorded of them.
    ("POST", "/api/devices/{device_id}/map-walk/begin"): MAPPERS,
    ("POST", "/api/devices/{device_id}/map-walk/end"): MAPPERS,
    ("GET", "/api/recordings"): MAPPERS,
    ("POST", "/api/recordings/{sha256}/map"): MAPPERS,
    # People and devices, managed.
    ("GET", "/api/users"): ADMINS,
    ("POST", "/api/users"): ADMINS,
    ("PATCH", "/api/users/{user_id}"): ADMINS,
    ("POST", "/api/users/{user_id}/link"): ADMINS,
    ("GET", "/api/tokens"): ADMINS,
    ("POST", "/api/tokens"): ADMINS,
    ("POST", "/api/tokens/revoke"): ADMINS,
    ("GET", "/api/audit"): ADMINS,
    # Devices themselves.
    ("WS", "/device"): DEVICES,
    ("GET", "/api/device/map/{sha256}"): DEVICES,
    ("POST", "/api/device/recordings"): DEVICES,
    ("PUT", "/api/device/recordings/{sha256}"): DEVICES,
}
