"""Who may call what, row by row: ``console.rules`` and ``console.roles`` against one statement that reads neither.

Pure, so that a fault in any row can be put in and looked for within milliseconds (.ci/mutants); that the guard does
what the rows say is shown by real requests elsewhere.
"""

from __future__ import annotations

import pytest

from console.roles import EDITING, MANAGING, MAPPING, ROLES, SIGNED_IN, TUNING
from console.rules import MAX_BODY_BYTES, RULES
from navcore.graph_import import MAX_GRAPH_FILE_BYTES
from navcore.site_archive import MAX_ARCHIVE_BYTES

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

LARGE_BODIES = {
    ("POST", "/api/import/graph"): MAX_GRAPH_FILE_BYTES, ("POST", "/api/import/site"): MAX_ARCHIVE_BYTES,
}  # fmt: skip


def _routes(text: str) -> set[tuple[str, str]]:
    return {(method, path) for method, path in (each.split() for each in text.split(","))}


IN_GROUP = {key: group for group, text in GROUPS.items() for key in _routes(text)}


def test_every_rule_stands_in_one_group() -> None:
    assert set(RULES) == set(IN_GROUP)
    assert sum(len(_routes(text)) for text in GROUPS.values()) == len(IN_GROUP)


@pytest.mark.parametrize("role", [None, *ROLES])
def test_each_role_may_do_exactly_what_the_statement_says(role: str | None) -> None:
    may = MAY[role or "nobody"].split()
    wrong = {key for key, group in IN_GROUP.items() if RULES[key].permits(role) != (group in may)}  # type: ignore[arg-type]
    assert not wrong


def test_devices_have_their_own_routes_and_no_other() -> None:
    asked_for_a_device_token = {key for key, rule in RULES.items() if rule.who == "devices"}
    assert asked_for_a_device_token == {key for key, group in IN_GROUP.items() if group == "be-a-device"}


def test_the_sets_of_roles_are_those_of_the_statement() -> None:
    """Forms, and the scene, ask them directly."""
    assert set(ROLES) == set(MAY) - {"nobody", "device"}
    for group, roles in {
        "look": SIGNED_IN,
        "edit": EDITING,
        "tune": TUNING,
        "map": MAPPING,
        "manage": MANAGING,
    }.items():
        assert roles == {role for role in ROLES if group in MAY[role].split()}, group


def test_only_imports_have_large_bodies() -> None:
    assert MAX_BODY_BYTES == 1 << 18
    assert {key: RULES[key].max_body_bytes for key in RULES} == dict.fromkeys(RULES, MAX_BODY_BYTES) | LARGE_BODIES
