"""Every route of the application × everybody who may come: allowed exactly as the tables below say.

The tables are written from docs/architecture.md ("Who may do what"), and do not read ``console.rules`` or
``console.roles``: a route that is added there, or a role that is given more, fails here until somebody has decided it.
Whoever is refused sends a request that would be carried out, and nothing in the console may have changed afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from asgi_calls import Answer
from authorization_room import COOKIE, DEVICE_ID, HOST, ORIGIN, ROLES, Room, authorization_room, requests_of
from fastapi import FastAPI
from starlette.routing import Mount, Route, WebSocketRoute, compile_path

# ------------------------------------------------------------------------------- the statement of what roles may do
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
WITHOUT_RIGHTS = (
    "forged cookie", "expired session", "session not used for a day", "signed-out session", "disabled account",
    "role lowered after sign-in", "password changed after sign-in", "an admin's session as a device token",
    "a device token as a cookie", "revoked device token", "replaced device token", "forged device token",
)  # fmt: skip
GUARDS_WORDS = (
    b"Sign in first: nobody is signed in here", b"Your role (", b"This device token is not valid", b"not for your role",
)  # fmt: skip
FOREIGN_ORIGINS = (
    None, "", "null", "https://evil.example", "http://localhost:8766", f"{ORIGIN}.evil.example", "http://[",
    f"http://evil.example/{HOST}", "http://localhost", f"http://user@{HOST}",
)  # fmt: skip
FOREIGN_HOSTS = ("evil.example:8765", "", "localhost.evil.example", "[::1", "localhost:port")
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "PROPFIND", "WS")


def _routes(text: str) -> set[tuple[str, str]]:
    return {(method, path) for method, path in (each.split() for each in text.split(","))}


IN_GROUP = {key: group for group, text in GROUPS.items() for key in _routes(text)}
VALUES = {
    "{device_id}": DEVICE_ID, "{user_id}": "999", "{version}": "0", "{what}": "none", "{sha256}": "0" * 64,
    "{alert_id}": "none", "{incident_id}": "none", "{walk_id}": "none", "{run_id}": "none", "{name}": "none",
    "{key}": "none", "{road_id}": "none",
}  # fmt: skip


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with authorization_room(tmp_path_factory.mktemp("room")) as room:
        yield room


def filled(path: str) -> str:
    """Return a path with values in the place of its parameters."""
    for name, value in VALUES.items():
        path = path.replace(name, value)
    return "/static/style.css" if path == "/static" else path


def wanted(room: Room) -> dict[tuple[str, str], tuple[str, Any]]:
    """Return of every route the request that whoever may not make it tries."""
    valid = requests_of(room)
    return {key: valid.get(" ".join(key), (filled(key[1]), None)) for key in IN_GROUP}


def is_refused(answer: Answer) -> bool:
    """Whether somebody was turned away: for want of a right, or to the page that signs in."""
    to_sign_in = answer.status == 303 and answer.headers.get("location", "").startswith("/signin")
    return answer.status in (401, 403) or to_sign_in


def is_refused_by_the_guard(answer: Answer) -> bool:
    """Whether the guard did so, before a route that refuses as well was asked: one of the two may be forgotten."""
    return is_refused(answer) and (answer.status == 303 or any(each in answer.body for each in GUARDS_WORDS))


def state_of(room: Room) -> tuple[Any, ...]:
    """Return all that a refused request might have changed."""
    services = room.services
    people = [(u.name, u.role, u.disabled) for u in services.accounts.users()]
    tokens = [(t.name, t.revoked, t.created_at_s) for t in services.devices.tokens()]
    audit = [row.id for row in services.store.latest_audit(1)]
    recordings = [each.entry for each in services.recordings.all()]
    presets = [(each.name, each.values) for each in services.presets.all()]
    windows = services.presence.windows()
    return (
        people, tokens, audit, recordings, presets, windows, services.model.graph, services.model.published,
        services.model.named_versions(), list(room.outlet.sent), services.retention.days, services.access.latest(5),
        services.hub.device(DEVICE_ID).commands,
    )  # fmt: skip


def routes_of(app: FastAPI) -> set[tuple[str, str]]:
    """Return every method and path that the application answers."""
    found = set()
    for route in app.router.routes:
        assert isinstance(route, (Route, WebSocketRoute, Mount)), f"{route} is of a kind that the guard cannot see"
        methods = {"WS"} if isinstance(route, WebSocketRoute) else set(getattr(route, "methods", None) or {"GET"})
        found |= {(method, route.path) for method in methods - {"HEAD"}}
    return found


def test_every_route_stands_in_one_group_and_every_group_is_of_routes(room: Room) -> None:
    assert routes_of(room.app) == set(IN_GROUP)
    assert sum(len(_routes(text)) for text in GROUPS.values()) == len(IN_GROUP)


@pytest.mark.parametrize("caller", MAY)
def test_each_role_may_do_exactly_what_the_table_says(room: Room, caller: str) -> None:
    may = MAY[caller].split()
    tried, before = wanted(room), state_of(room)
    for key, (path, body) in tried.items():
        if IN_GROUP[key] not in may:
            answer = room.call(room.callers[caller], key[0], path, body)
            assert is_refused_by_the_guard(answer), f"{caller} {key}: {answer.status} {answer.body[:200]!r}"
    assert state_of(room) == before, f"{caller} was refused, and yet something changed"
    for method, path in IN_GROUP:
        if IN_GROUP[method, path] in may:
            headers = room.session(caller) if path == "/api/sign-out" else room.callers[caller]
            answer = room.call(headers, method, filled(path), b"{")
            assert not is_refused(answer) or path == "/api/sign-in", f"{caller} {method} {path}: {answer.body[:200]!r}"


@pytest.mark.parametrize("caller", WITHOUT_RIGHTS)
def test_who_had_rights_or_forges_them_is_nobody(room: Room, caller: str) -> None:
    tried, before = wanted(room), state_of(room)
    for key, (path, body) in tried.items():
        if IN_GROUP[key] != "open":
            answer = room.call(room.callers[caller], key[0], path, body)
            assert is_refused_by_the_guard(answer), f"{caller} {key}: {answer.status} {answer.body[:200]!r}"
            assert key[0] == "WS" or answer.status in (401, 303), "they are told to sign in, not that they may not"
    assert state_of(room) == before


@pytest.mark.parametrize("origin", FOREIGN_ORIGINS)
def test_what_changes_something_and_every_socket_must_come_from_our_own_page(room: Room, origin: str | None) -> None:
    tried, before = wanted(room), state_of(room)
    headers = {name: value for name, value in room.callers["admin"].items() if name != "Origin"}
    headers |= {} if origin is None else {"Origin": origin}
    for key, (path, body) in tried.items():
        if IN_GROUP[key] == "be-a-device" or (key[0] == "GET" and origin is not None):
            continue
        answer = room.call(headers, key[0], path, body)
        if key[0] != "GET":
            assert answer.status == 403, f"{key} from {origin!r}: {answer.status} {answer.body[:200]!r}"
        else:
            assert not is_refused(answer), f"{key}: a browser sends no Origin with it"
    looked = state_of(room)
    assert (*looked[:11], looked[12]) == (*before[:11], before[12]), "all but that somebody has looked"


@pytest.mark.parametrize("host", FOREIGN_HOSTS)
def test_no_route_answers_by_another_name(room: Room, host: str) -> None:
    tried, before = wanted(room), state_of(room)
    for key, (path, body) in tried.items():
        caller = "device" if IN_GROUP[key] == "be-a-device" else "admin"
        headers = room.callers[caller] | {"Host": host, "Origin": f"http://{host}"}
        answer = room.call(headers, key[0], path, body)
        assert answer.status == 403, f"{key} as {host!r}: {answer.status} {answer.body[:200]!r}"
    assert state_of(room) == before


@pytest.mark.parametrize("caller", ["nobody", "viewer", "admin", "device"])
def test_other_methods_and_other_paths_are_nothing(room: Room, caller: str) -> None:
    before = state_of(room)
    paths = {path for _, path in IN_GROUP}
    strange = {"/api", "/api/", "/device/", "/live/", "/viewer", "//admin", "/admin/", "/ADMIN", "/api/users/"}
    patterns = [(method, compile_path(path)[0]) for method, path in IN_GROUP] + [("HEAD", compile_path("/static")[0])]
    for path in sorted(paths | strange):
        for method in METHODS:
            if any(method == other and pattern.match(path) for other, pattern in patterns):
                continue
            answer = room.call(room.callers[caller], method, filled(path), None)
            assert answer.status in (401, 403, 404, 405), f"{caller} {method} {path}: {answer.status}"
    assert state_of(room) == before


def test_a_route_without_a_rule_is_refused_to_everybody(room: Room) -> None:
    room.app.add_api_route("/surprise", lambda: "open", methods=["GET"])
    try:
        for caller in room.callers:
            answer = room.call(room.callers[caller], "GET", "/surprise")
            assert answer.status == 403
            assert b"no rule" in answer.body
    finally:
        room.app.router.routes.pop()


def test_a_session_of_another_name_is_none(room: Room) -> None:
    """Browsers share the cookies of a host between its ports: each console has a name of its own."""
    token = room.session("admin")["Cookie"].partition("=")[2]
    for name in ("vbr_session", "vbr_session_8766", "session", f"__Host-{COOKIE}"):
        headers = {"Host": HOST, "Origin": ORIGIN, "Cookie": f"{name}={token}"}
        assert room.call(headers, "GET", "/api/session").status == 401
    assert set(MAY) - {"nobody", "device"} == set(ROLES)
