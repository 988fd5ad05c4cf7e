"""Every route of the application × everybody who may come: allowed exactly as the statement says.

Whoever is refused sends a request that would be carried out, and nothing in the console may have changed afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from asgi_calls import Answer
from authorization_room import COOKIE, DEVICE_ID, HOST, ORIGIN, Room, authorization_room, filled, requests_of
from authorization_statement import IN_GROUP, MAY
from fastapi import FastAPI
from starlette.routing import Mount, Route, WebSocketRoute, compile_path

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


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with authorization_room(tmp_path_factory.mktemp("room")) as room:
        yield room


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
    # What was done before is written down, and what is done from now on is seen.
    services.late_audit.write()
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


def served_by(app: FastAPI) -> set[tuple[str, str]]:
    """Return every method and path that the application answers."""
    found = set()
    for route in app.router.routes:
        assert isinstance(route, (Route, WebSocketRoute, Mount)), f"{route} is of a kind that the guard cannot see"
        methods = {"WS"} if isinstance(route, WebSocketRoute) else set(getattr(route, "methods", None) or {"GET"})
        found |= {(method, route.path) for method in methods - {"HEAD"}}
    return found


def test_the_application_answers_the_routes_of_the_statement_and_no_other(room: Room) -> None:
    assert served_by(room.app) == set(IN_GROUP)


@pytest.mark.parametrize("caller", MAY)
def test_each_role_may_do_exactly_what_the_statement_says(room: Room, caller: str) -> None:
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


@pytest.mark.parametrize("caller", ["nobody", "admin", "device"])
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
