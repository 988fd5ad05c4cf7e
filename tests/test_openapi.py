"""What the API says of itself is true: whatever is asked of it, the answer is one that is described, and never a 5xx.

``VBR_OPENAPI_EXAMPLES`` sets how many requests of each kind are made to each route; by hand, hundreds.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import hypothesis
import pytest
import schemathesis
from console_room import DEFAULTS, PICTURE, DialledDevice, Person, first_admin, hello_of, serving, until
from fastapi.routing import APIRoute
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from benchmarks.kills.sites import small_site
from console.server import ConsoleServer
from navcore.site import save_site
from navcore.wire import DepthImage, SettingsRunning, WalkerState, Welcome

EXAMPLES = int(os.environ.get("VBR_OPENAPI_EXAMPLES", "2"))
CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]
ENDS_THE_SESSION = "/api/sign-out"
"""All that is asked afterwards would be asked by nobody."""
NOT_COUNTED = ("access", "audit", "session")
"""Who has asked is written down, also where they are refused."""
EXTREMES: dict[str, tuple[object, ...]] = {
    "integer": (-1, 1 << 53, (1 << 63) - 1, 1 << 63, -(1 << 63) - 1, 10**30),
    "number": ("inf", "-inf", "nan", 1e308, -1e308, 10**30),
}


class Asked:
    """Somebody with every right, and a device, at a console with one walker."""

    def __init__(self, server: ConsoleServer, admin: Person, device: DialledDevice, token: str) -> None:
        self.server, self.admin, self.device = server, admin, device
        self._token = token
        self.document: dict[str, Any] = server.app.openapi()

    def sign_in(self) -> None:
        """Begin a new session, past the limit of signing in, which may have been asked for too often."""
        accounts = self.server.services.accounts
        (ada,) = (user for user in accounts.users() if user.name == "Ada")
        (cookie,) = self.admin.http.cookies
        self.admin.http.cookies.clear()
        self.admin.http.cookies.set(cookie, accounts.start_session(ada.id))

    def headers(self, path: str) -> dict[str, str]:
        """Return what a request carries besides its content."""
        if path.startswith("/api/device/"):
            return {"Authorization": f"Bearer {self._token}"}
        cookies = "; ".join(f"{name}={value}" for name, value in self.admin.http.cookies.items())
        return {"Origin": self.server.ready.url, "Cookie": cookies}

    def kept(self) -> list[tuple[str, int, float]]:
        """Return what the console keeps, by table: rows, and a sum that changes with any of them."""
        with closing(sqlite3.connect(next(self.server.services.config.data_folder.glob("*.sqlite*")))) as base:
            names = [row[0] for row in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
            return [
                (name, *base.execute(f"SELECT COUNT(*), TOTAL(rowid) FROM {name}").fetchone())
                for name in names
                if not name.startswith(NOT_COUNTED)
            ]


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Asked]:
    folder: Path = tmp_path_factory.mktemp("openapi")
    save_site(small_site(), folder / "site")
    with serving(folder / "site", folder / "data") as server:
        token = server.services.devices.create_token("Glasses", "test")
        device = DialledDevice(server.ready.url, token, hello_of(server))
        device.next(Welcome)
        device.send(SettingsRunning(0, DEFAULTS))
        device.send(DepthImage(1000.0, PICTURE))
        device.send(WalkerState(1000.0, "localized", "walk", "ok", pose=(1.0, 0.0, 1.6, 0.0)))
        until(server.services.hub, lambda known: known.state is not None)
        yield Asked(server, first_admin(server), device, token)


def test_every_route_of_the_api_is_described_with_what_checks_its_body(asked: Asked) -> None:
    routes = [each for each in asked.server.app.routes if isinstance(each, APIRoute) and each.path.startswith("/api/")]
    told = {(path, method) for path, operations in asked.document["paths"].items() for method in operations}
    assert told == {(each.path, method.lower()) for each in routes for method in each.methods}
    assert "HTTPValidationError" not in str(asked.document)
    for path in ("/api/edits", "/api/preview"):
        body = asked.document["paths"][path]["post"]["requestBody"]["content"]["application/json"]["schema"]
        tags = {each["properties"]["edit"]["enum"][0] for each in body["anyOf"]}
        assert {"add_poi", "draw_road", "set_edge"} <= tags


@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE])
def test_whatever_is_asked_is_answered_as_described_and_what_is_refused_changes_nothing(
    asked: Asked, mode: GenerationMode
) -> None:
    schema, taken = schemathesis.openapi.from_dict(asked.document), set[str]()
    for result in schema.get_all_operations():
        operation = result.ok()
        if operation.path == ENDS_THE_SESSION:
            continue

        @hypothesis.settings(
            max_examples=EXAMPLES, deadline=None, database=None, derandomize=True,
            phases=[hypothesis.Phase.generate], suppress_health_check=list(hypothesis.HealthCheck),
        )  # fmt: skip
        @hypothesis.given(operation.as_strategy(generation_mode=mode))
        def ask(case: schemathesis.Case) -> None:
            before = asked.kept()
            answer = case.call(base_url=asked.server.ready.url, headers=asked.headers(case.operation.path))
            case.validate_response(answer, checks=CHECKS)
            if answer.status_code < 300:
                taken.add(case.operation.label)
            if answer.status_code >= 400:
                assert asked.kept() == before, f"{answer.status_code} {answer.text}, and yet something has changed"
                assert answer.json()["error"][-1] in ".?!)", answer.text

        ask()
        if asked.admin.http.get("/api/session").status_code == 401:
            # They have changed their own account: what is left is asked by somebody as well.
            asked.sign_in()
    assert len(taken) >= 24, "most of it was asked by nobody"


def test_numbers_at_the_end_of_every_range_are_taken_or_refused(asked: Asked) -> None:
    """Each number of each route in turn: beyond the database, beyond floats, and none."""
    with httpx.Client(base_url=asked.server.ready.url, trust_env=False) as client:
        for path, method, operation in _operations(asked.document):
            for name, place, kind in _numbers(operation):
                for value in EXTREMES[kind]:
                    filled = path.replace("{" + name + "}", str(value)).replace("{", "").replace("}", "")
                    query = {each: "1" for each, at, _ in _numbers(operation) if at == "query"}
                    query |= {name: str(value)} if place == "query" else {}
                    answer = client.request(method, filled, params=query, headers=asked.headers(path))
                    assert answer.status_code < 500, (method, filled, query, answer.text)


def test_numbers_at_the_end_of_every_range_in_bodies_are_taken_or_refused(asked: Asked) -> None:
    bodies: dict[tuple[str, str], dict[str, Any]] = {
        ("POST", "/api/publish"): {"confirmed": True, "version": 1},
        ("POST", "/api/versions/1/roll-back"): {"base_version": 1},
        ("PATCH", "/api/devices/glasses/settings"): {"changes": {"gate.clearance_m": 2.0}, "seen_revision": 0},
        ("POST", "/api/devices/glasses/settings/back"): {"revision": 1, "trial_s": 60.0},
        ("POST", "/api/devices/glasses/settings/keep"): {"revision": 1},
        ("POST", "/api/settings/presets"): {"name": "x", "values": {"gate.clearance_m": 2.0}},
        ("POST", "/api/edits"): {"edit": "move_poi", "poi_id": "a", "x_m": 0.0, "y_m": 0.0},
        ("POST", "/api/preview"): {"edit": "smooth_road", "road_id": "a", "window_m": 1.0},
    }
    for (method, path), body in bodies.items():
        for where, put in _number_places(body):
            for value in (*EXTREMES["integer"], 1e308, -1e308, float("inf"), float("nan"), 5e-324):
                # As Python writes them; what is no JSON is refused as that.
                answer = asked.admin.http.request(
                    method, path, content=json.dumps(put(value)), headers={"Content-Type": "application/json"}
                )
                assert answer.status_code < 500, (path, where, value, answer.text)


@pytest.mark.parametrize(
    "content",
    [
        b"[" * 100_000, b'{"a":' * 50_000, b"\xff\xfe", b"", b"NaN", b"1e999", b"9" * 5000, b"null",
        b'{"token":' + b"9" * 5000 + b"}", b'{"token":"\\ud800"}', b'{"edit":"undo","edit":"redo"}',
        b'\xef\xbb\xbf{"token":1}',
    ],
    ids=range(12),
)  # fmt: skip
def test_what_is_no_body_is_refused_with_a_sentence(asked: Asked, content: bytes) -> None:
    for path in ("/api/first/look", "/api/edits", "/api/preview", "/api/devices/glasses/say", "/api/device/recordings"):
        for headers in ({"Content-Type": "application/json"}, {"Content-Type": "text/plain"}, {}):
            sent = asked.headers(path) | headers
            answer = httpx.post(asked.server.ready.url + path, content=content, headers=sent, trust_env=False)
            assert 400 <= answer.status_code < 500, (path, answer.text)
            assert answer.json()["error"].endswith("."), answer.text


def _operations(document: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            if path != ENDS_THE_SESSION:
                yield path, method.upper(), operation


def _numbers(operation: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Return name, place and type of each parameter that is a number."""
    found = []
    for each in operation.get("parameters", []):
        kinds = {option.get("type") for option in each["schema"].get("anyOf", [each["schema"]])}
        found += [(each["name"], each["in"], kind) for kind in EXTREMES if kind in kinds]
    return found


def _number_places(body: dict[str, Any]) -> Iterator[tuple[str, Callable[[object], dict[str, Any]]]]:
    for key, value in body.items():
        if isinstance(value, dict):
            for inner, put in _number_places(value):
                yield f"{key}.{inner}", lambda new, key=key, put=put: body | {key: put(new)}  # type: ignore[misc]
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield key, lambda new, key=key: body | {key: new}  # type: ignore[misc]
