"""The rules over real sockets, and what the pages hold; test_authorization_matrix has the rules themselves."""

from __future__ import annotations

from collections.abc import Iterator
from html.parser import HTMLParser

import pytest
from console_room import Person, first_admin, invited, serving
from websockets.exceptions import InvalidStatus

from console.pages import PAGES, static_folder
from console.roles import ROLES
from console.rules import RULES
from console.server import ConsoleServer
from navcore.site import Site, save_site

NOBODY = "nobody"


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


@pytest.mark.parametrize("role", [NOBODY, *ROLES])
def test_the_stream_is_for_everybody_who_is_signed_in(role: str, people: dict[str, Person]) -> None:
    if role == NOBODY:
        with pytest.raises(InvalidStatus) as refused:
            people[role].live()
        assert refused.value.response.status_code == 403
    else:
        with people[role].live() as socket:
            assert b"devices" in bytes(socket.recv(timeout=20), "utf-8")  # type: ignore[arg-type]


def test_a_page_for_another_role_says_so_to_people_and_a_stranger_signs_in_first(people: dict[str, Person]) -> None:
    answer = people["viewer"].http.get("/admin")
    assert answer.status_code == 403
    assert "not for your role" in answer.text
    assert people[NOBODY].http.get("/admin").headers["location"] == "/signin?next=/admin"
    assert (
        people["viewer"].http.get("/api/users").json()["error"]
        == "Your role (viewer) does not permit this: ask an admin."
    )


def test_a_stream_from_another_page_is_refused(people: dict[str, Person]) -> None:
    with pytest.raises(InvalidStatus) as refused:
        people["admin"].live(origin="https://evil.example")
    assert refused.value.response.status_code == 403


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
