"""Who may do what, stated independently of the console: every role, and every route by what it is for.

Written from docs/architecture.md ("Who may do what"); it reads neither ``console.rules`` nor ``console.roles``. A route
that is added there, or a role that is given more, fails the tests until somebody has decided it here.
"""

from __future__ import annotations

MAY = {
    "nobody":     "open",
    "viewer":     "open look watch",
    "editor":     "open look watch map edit lead",
    "technician": "open look watch map tune",
    "admin":      "open look watch map edit lead tune manage",
    "device":     "open be-a-device",
}  # fmt: skip
GROUPS = {
    # Signing in, and files that hold nothing secret.
    "open": """
        GET /signin, GET /first, GET /static, GET /favicon.ico, GET /healthz,
        POST /api/sign-in, POST /api/first/look, POST /api/first
        """,
    # The pages, and what everybody who is signed in may see of the map, of walkers and of what is kept of them.
    "look": """
        GET /, GET /overview, GET /pois, GET /versions, GET /checks, GET /rehearse, GET /exchange, GET /settings,
        GET /alerts, GET /walks, GET /privacy, GET /viewer/scene/, WS /viewer/scene, WS /live, WS /live/overview,
        WS /live/alerts, GET /api/session, POST /api/sign-out, GET /api/graph, GET /api/history, GET /api/versions,
        GET /api/versions/{version}/difference, GET /api/roads/place, GET /api/roads/{road_id}/place,
        GET /api/shortcuts, GET /api/check, GET /api/floor-plan.png, GET /api/floor-plan.svg,
        POST /api/presence, POST /api/view, POST /api/view/past, DELETE /api/view/past,
        POST /api/rehearsals, GET /api/rehearsals/sounds/{key},
        GET /api/settings, GET /api/devices/{device_id}/settings, GET /api/privacy,
        GET /api/devices/{device_id}/depth.jpg, GET /api/devices/{device_id}/colour.jpg,
        GET /api/alerts, GET /api/incidents, GET /api/incidents/{incident_id},
        GET /api/incidents/{incident_id}/instants, GET /api/incidents/{incident_id}/depth.jpg,
        GET /api/incidents/{incident_id}/bundle.zip, GET /api/walks, GET /api/walks/{walk_id},
        GET /api/walks/{walk_id}/instants, GET /api/walks/{walk_id}/depth.jpg, GET /api/walk-overlays,
        GET /api/walk-figures.csv
        """,
    # The monitor acknowledges alerts, speaks to the walker, and asks to see; it leads nobody.
    "watch": """
        POST /api/alerts/{alert_id}/acknowledge, POST /api/alerts/{alert_id}/shelve,
        POST /api/alerts/{alert_id}/unshelve, POST /api/devices/{device_id}/say, POST /api/devices/{device_id}/repeat,
        POST /api/devices/{device_id}/colour, POST /api/devices/{device_id}/keep
        """,
    # Map walks, maps that are built of them, and files that leave or enter the console whole.
    "map": """
        GET /map-walks, POST /api/devices/{device_id}/map-walk/begin, POST /api/devices/{device_id}/map-walk/end,
        GET /api/recordings, POST /api/recordings/{sha256}/map, GET /api/export/{what}, POST /api/import/site
        """,
    # The PoI-graph.
    "edit": """
        POST /api/edits, POST /api/preview, POST /api/undo, POST /api/redo, POST /api/publish, POST /api/versions,
        POST /api/versions/{version}/roll-back, POST /api/import/graph, POST /api/check
        """,
    # Where the walker goes.
    "lead": """
        POST /api/devices/{device_id}/destination, POST /api/devices/{device_id}/clear,
        POST /api/devices/{device_id}/pause, POST /api/devices/{device_id}/resume,
        POST /api/devices/{device_id}/end_watch
        """,
    "tune": """
        PATCH /api/devices/{device_id}/settings, POST /api/devices/{device_id}/settings/back,
        POST /api/devices/{device_id}/settings/keep, GET /api/settings/presets, GET /api/settings/presets/{name},
        POST /api/settings/presets, POST /api/settings/presets/import, PATCH /api/settings/presets/{name},
        DELETE /api/settings/presets/{name}, GET /api/what-if/walks, POST /api/what-if, GET /api/what-if/{run_id},
        DELETE /api/what-if/{run_id}
        """,
    # People, devices, and what is deleted for good.
    "manage": """
        GET /admin, GET /api/users, POST /api/users, PATCH /api/users/{user_id}, POST /api/users/{user_id}/link,
        GET /api/tokens, POST /api/tokens, POST /api/tokens/revoke, GET /api/audit,
        POST /api/privacy/days, POST /api/privacy/delete, DELETE /api/incidents/{incident_id}
        """,
    "be-a-device": """
        WS /device, GET /api/device/map/{sha256}, POST /api/device/recordings, PUT /api/device/recordings/{sha256}
        """,
}


def routes_of(group: str) -> set[tuple[str, str]]:
    """Return the method and the path of every route of a group."""
    return {(method, path) for method, path in (each.split() for each in GROUPS[group].split(","))}


IN_GROUP = {route: group for group in GROUPS for route in routes_of(group)}
"""The group of each route."""
