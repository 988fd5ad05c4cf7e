"""Who may call what: every route of the application against the table, for every role, with real requests."""

from __future__ import annotations

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import httpx
import pytest
from console_room import Person, first_admin, invited, serving
from starlette.routing import Mount, Route, WebSocketRoute
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from console.config import ConsoleConfig
from console.pages import PAGES, static_folder
from console.roles import ROLES
from console.rules import RULES
from console.server import ConsoleServer
from navcore.site import Site, save_site

NOBODY = "nobody"
HTTP_RULES = [key for key, rule in RULES.items() if key[0] != "WS" and rule.who != "devices"]
CHANGING = [key for key in HTTP_RULES if key[0] not in ("GET",)]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, module_site: Site) -> Iterator[ConsoleServer]:
    folder = tmp_path_factory.mktemp("rules")
    save_site(module_site, folder / "site")
    with serving(folder / "site", folder / "data") as running:
        yield running


@pytest.fixture(scope="module")
def module_site() -> Site:
    import numpy as np

    from navcore.types import CameraIntrinsics

    road = np.stack([np.linspace(0.0, 6.0, 61), np.zeros(61), np.zeros(61)], axis=1)
    cloud = np.zeros((4, 3), np.float32)
    camera = CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0)
    return Site("rules", "Rules", camera, {}, (road,), cloud, np.zeros((4, 3), np.uint8))


@pytest.fixture(scope="module")
def people(server: ConsoleServer) -> dict[str, Person]:
    admin = first_admin(server)
    others = {role: invited(admin, role, role) for role in ROLES if role != "admin"}
    return {"admin": admin, **others, NOBODY: Person(server.ready.url)}


def filled(path: str) -> str:
    for name, value in (("{device_id}", "none"), ("{user_id}", "999"), ("{checksum}", "0")):
        path = path.replace(name, value)
    return "/static/style.css" if path == "/static" else path


def call(person: Person, method: str, path: str, **options: object) -> httpx.Response:
    # Signing out would end the session that the next case needs.
    body = b"{" if path == "/api/sign-out" else b""
    return person.http.request(method, filled(path), content=body, **options)  # type: ignore[arg-type]


def test_every_route_has_a_rule_and_every_rule_a_route(tmp_path: Path, module_site: Site) -> None:
    save_site(module_site, tmp_path / "site")
    server = ConsoleServer(ConsoleConfig(tmp_path / "site", tmp_path / "data", port=0))
    try:
        found = set()
        for route in server.app.router.routes:
            assert isinstance(route, (Route, WebSocketRoute, Mount)), f"{route} is of a kind that the guard cannot see"
            methods = {"WS"} if isinstance(route, WebSocketRoute) else set(getattr(route, "methods", None) or {"GET"})
            found |= {(method, route.path) for method in methods - {"HEAD"}}
        assert found == set(RULES)
    finally:
        server._stop_scene()
        server._socket.close()
        server.services.store.close()


@pytest.mark.parametrize("role", [NOBODY, *ROLES])
def test_each_role_reaches_exactly_what_its_rules_say(role: str, people: dict[str, Person]) -> None:
    for method, path in HTTP_RULES:
        if (method, path) == ("POST", "/api/sign-out") or path.startswith("/viewer/"):
            continue
        answer = call(people[role], method, path)
        permitted = RULES[method, path].permits(None if role == NOBODY else role)  # type: ignore[arg-type]
        refused = answer.status_code in (401, 403, 303)
        assert refused == (not permitted), f"{role} {method} {path}: {answer.status_code} {answer.text[:200]}"
        if role != NOBODY and refused and method == "GET" and not path.startswith("/api/"):
            assert "not for your role" in answer.text, "a page for people"
        if refused and path.startswith("/api/"):
            assert answer.status_code == (401 if role == NOBODY else 403)
            assert answer.json()["error"].endswith((".", "over."))


@pytest.mark.parametrize("role", [NOBODY, *ROLES])
def test_the_stream_is_for_everybody_who_is_signed_in(role: str, people: dict[str, Person]) -> None:
    if role == NOBODY:
        with pytest.raises(InvalidStatus) as refused:
            people[role].live()
        assert refused.value.response.status_code == 403
    else:
        with people[role].live() as socket:
            assert b"devices" in bytes(socket.recv(timeout=20), "utf-8")  # type: ignore[arg-type]


@pytest.mark.parametrize("origin", [None, "", "null", "https://evil.example", "http://127.0.0.1:1"])
def test_what_changes_something_must_come_from_our_own_page(origin: str | None, people: dict[str, Person]) -> None:
    for method, path in CHANGING:
        person = people["admin"]
        request = person.http.build_request(method, filled(path), content=b"{}")
        del request.headers["Origin"]
        if origin is not None:
            request.headers["Origin"] = origin
        answer = person.http.send(request)
        assert answer.status_code == 403, f"{method} {path} from {origin}: {answer.text[:200]}"
    assert people["admin"].http.get("/api/session").status_code == 200


def test_a_stream_from_another_page_is_refused(people: dict[str, Person]) -> None:
    with pytest.raises(InvalidStatus) as refused:
        people["admin"].live(origin="https://evil.example")
    assert refused.value.response.status_code == 403


def test_another_host_name_is_refused(people: dict[str, Person]) -> None:
    person = people["admin"]
    answer = person.http.get("/api/graph", headers={"Host": "evil.example:80", "Origin": "http://evil.example:80"})
    assert answer.status_code == 403
    assert "address that it printed" in answer.json()["error"]


def test_devices_need_a_token_and_people_are_none(server: ConsoleServer, people: dict[str, Person]) -> None:
    admin = people["admin"].http
    token = admin.post("/api/tokens", json={"name": "revoked"}).json()["token"]
    admin.post("/api/tokens/revoke", json={"name": "revoked"}).raise_for_status()
    cookie = "; ".join(f"{name}={value}" for name, value in admin.cookies.items())
    for headers in ({}, {"Authorization": "Basic QTpC"}, {"Authorization": f"Bearer {token}"}, {"Cookie": cookie}):
        with pytest.raises(InvalidStatus) as refused:
            connect(server.ready.url.replace("http", "ws") + "/device", additional_headers=headers, proxy=None)
        assert refused.value.response.status_code == 403
        path = server.services.package.packed().path
        assert httpx.get(server.ready.url + path, headers=headers, trust_env=False).status_code == 401


def test_a_route_without_a_rule_is_refused(tmp_path: Path, module_site: Site) -> None:
    save_site(module_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        server.app.add_api_route("/surprise", lambda: "open", methods=["GET"])
        answer = first_admin(server).http.get("/surprise")
        assert answer.status_code == 403
        assert "no rule" in answer.json()["error"]


def test_every_answer_carries_the_headers(people: dict[str, Person]) -> None:
    for path in (*PAGES, "/api/graph", "/static/style.css", "/nothing"):
        headers = people["admin"].http.get(path).headers
        assert "script-src 'self'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"


class _Inline(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = {name for name, _ in attrs}
        if tag == "style" or (tag == "script" and "src" not in names) or "style" in names:
            self.found.append(tag)
        self.found += [name for name in names if name.startswith("on")]


def test_pages_hold_nothing_inline_that_the_policy_would_block() -> None:
    for file in PAGES.values():
        reader = _Inline()
        reader.feed((static_folder() / file).read_text(encoding="utf-8"))
        assert reader.found == [], file


@pytest.mark.parametrize("role", ROLES)
def test_the_header_offers_a_role_exactly_the_pages_that_open_for_it(role: str, people: dict[str, Person]) -> None:
    offered = people[role].http.get("/api/session").json()["pages"]
    header = (static_folder() / "shell.js").read_text(encoding="utf-8")
    for path in PAGES:
        if RULES["GET", path].who == "people":
            assert people[role].http.get(path).is_success is (path in offered), path
            assert f'["{path}", ' in header, f"no way leads to {path}"
