"""What the forms of the map editor ask: places by distances along the road, and edits seen before they are made."""

from __future__ import annotations

import pytest
from console_room import Person

from console.server import ConsoleServer


def place(admin: Person, **asked: object) -> tuple[int, dict[str, object]]:
    answer = admin.http.get("/api/roads/place", params=asked)  # type: ignore[arg-type]
    return answer.status_code, answer.json()


def test_a_place_is_found_so_many_metres_from_one_towards_another(admin: Person) -> None:
    status, found = place(admin, from_id="a", towards_id="b", distance_m=1.5)
    assert (status, found["x_m"]) == (200, pytest.approx(1.5))
    status, found = place(admin, from_id="a", towards_id="b", distance_m=7)
    assert status == 400
    assert "6.00 m" in str(found["error"])
    assert place(admin, from_id="a", towards_id="nowhere", distance_m=1)[0] == 404
    assert place(admin, from_id="a", towards_id="b", distance_m="nan")[0] == 400
    assert place(admin, from_id="a", towards_id="b")[0] == 400
    along = admin.http.get("/api/roads/r1/place", params={"distance_m": 2.5})
    assert along.json()["x_m"] == pytest.approx(2.5)
    assert admin.http.get("/api/roads/r9/place", params={"distance_m": 2.5}).status_code == 404


def test_a_preview_says_what_an_edit_would_change_and_changes_nothing(admin: Person, server: ConsoleServer) -> None:
    before = server.services.model.graph
    asked = {"edit": "split_edge", "edge_id": "a-b", "x_m": 2.0, "y_m": 0.0, "name": "Corner"}
    answer = admin.http.post("/api/preview", json=asked).raise_for_status().json()
    assert [(one["kind"], one["change"]) for one in answer["changes"]] == [
        ("poi", "added"), ("edge", "changed"), ("edge", "added"),
    ]  # fmt: skip
    assert sorted(answer["lengths_m"].values()) == [pytest.approx(2.0), pytest.approx(4.0)]
    refused = admin.http.post("/api/preview", json={"edit": "propose_edges"})
    assert refused.status_code == 400
    assert "joined already" in refused.json()["error"]
    assert admin.http.post("/api/preview", content=b"{").status_code == 400
    assert server.services.model.graph == before
