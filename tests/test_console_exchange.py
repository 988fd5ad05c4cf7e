"""Export and import over a real server: what comes out goes in again, and what is broken changes nothing."""

from __future__ import annotations

import io
import json
import socket
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import numpy as np
import pytest
from console_room import Person, first_admin, invited, serving
from link_processes import ConsoleProcess

from console.errors import ConflictError
from console.exports import Exports
from console.server import ConsoleServer
from console.site_imports import SiteImports
from navcore.cloud_files import read_cloud
from navcore.graph_import import MAX_GRAPH_FILE_BYTES, read_graph
from navcore.recording import read_trajectory
from navcore.site import Site, load_site, save_site
from navcore.site_archive import MAX_ARCHIVE_BYTES
from navcore.slam.road import build_roads

FILES = ("site.zip", "graph.geojson", "graph.graphml", "cloud.ply", "cloud.pcd", "road.tum")
FOREIGN = {
    "type": "FeatureCollection",
    "features": [
        {"geometry": {"type": "Point", "coordinates": [3.0, 0.1]}, "properties": {"name": "Lift", "kind": "lift"}},
        {"geometry": {"type": "Polygon", "coordinates": []}, "properties": {"name": "Room 3"}},
    ],
}


@pytest.fixture
def editor(admin: Person) -> Person:
    return invited(admin, "Eve", "editor")


def export(person: Person, what: str, **query: Any) -> bytes:
    return person.http.get(f"/api/export/{what}", params=query).raise_for_status().content


def import_graph(person: Person, data: bytes, **query: str) -> httpx.Response:
    return person.http.post("/api/import/graph", content=data, params=query)


def import_site(person: Person, data: bytes | Iterator[bytes]) -> httpx.Response:
    return person.http.post("/api/import/site", content=data)


def disk(server: ConsoleServer) -> dict[str, bytes]:
    """Return all files that an import could touch: the site that is served, and those beside it."""
    folders = server.services.config.site_folder, server.services.site_imports.folder
    files = (path for folder in folders for path in folder.rglob("*") if path.is_file())
    return {str(path): path.read_bytes() for path in files}


def audit(admin: Person) -> list[tuple[str, str]]:
    return [(row["who"], row["action"]) for row in admin.http.get("/api/audit").json()["audit"]]


# ------------------------------------------------------------------------------------------------------- export
def test_every_file_has_a_good_name_and_its_length(server: ConsoleServer, editor: Person, admin: Person) -> None:
    editor.edit("add_poi", name="Lift", kind="lift", x_m=3.0, y_m=0.0).raise_for_status()
    version = editor.graph()["version"]
    for what in FILES:
        answer = editor.http.get(f"/api/export/{what}").raise_for_status()
        stem, ending = what.split(".")
        of = version if stem in ("graph", "road") else version - 1
        assert answer.headers["content-disposition"] == f'attachment; filename="small-site-{stem}-v{of}.{ending}"'
        assert int(answer.headers["content-length"]) == len(answer.content) > 0
        assert answer.headers["x-content-type-options"] == "nosniff"
    assert audit(admin).count(("Eve", "export")) == len(FILES)
    assert editor.http.get("/api/export/passwords.txt").status_code == 404
    assert [path.name for path in server.services.config.data_folder.glob("tmp*")] == []


def test_what_is_exported_is_what_is_there(server: ConsoleServer, editor: Person, tmp_path: Path) -> None:
    model = server.services.model
    editor.edit("add_poi", name="Lift", kind="lift", x_m=3.0, y_m=0.0).raise_for_status()
    for what in ("graph.geojson", "graph.graphml"):
        assert read_graph(export(editor, what)) == model.graph
        assert read_graph(export(editor, what, published="true")) == model.published != model.graph
    for what in ("cloud.ply", "cloud.pcd"):
        (tmp_path / what).write_bytes(export(editor, what))
        back = read_cloud(tmp_path / what)
        np.testing.assert_array_equal(back.points_m, model.site.cloud_points_m)
        np.testing.assert_array_equal(back.colours_rgb, model.site.cloud_colours_rgb)


def test_the_road_can_be_walked_through_as_a_trajectory(server: ConsoleServer, editor: Person, tmp_path: Path) -> None:
    editor.edit("draw_road", points_m=[[3.0, 0.0], [3.0, 5.0]]).raise_for_status()
    (tmp_path / "road.tum").write_bytes(export(editor, "road.tum"))
    assert "0.85 m/s" in (tmp_path / "road.tum").read_text().splitlines()[0]
    stamps_s, poses = read_trajectory(tmp_path / "road.tum")
    assert (np.diff(stamps_s) > 0).all()
    roads = build_roads(stamps_s, np.array([pose.translation for pose in poses]))
    assert [len(roads), *(pytest.approx(road[-1], abs=0.05) for road in roads)] == [2, roads[0][-1], roads[1][-1]]
    assert roads[0][-1][:2] == pytest.approx([6.0, 0.0], abs=0.05)
    assert roads[1][-1][:2] == pytest.approx([3.0, 5.0], abs=0.05)
    assert poses[-1].rotation @ np.array([1.0, 0.0, 0.0]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)


def test_who_watches_gets_no_files_and_changes_nothing(admin: Person) -> None:
    for role in ("viewer", "technician"):
        person = invited(admin, role, role)
        assert person.http.get("/api/export/site.zip").status_code == (403 if role == "viewer" else 200)
        assert import_graph(person, b"{}").status_code == 403
    assert import_site(invited(admin, "Vic", "viewer"), b"PK").status_code == 403


def test_a_full_disk_is_told_before_anything_is_made(server: ConsoleServer, tmp_path: Path, editor: Person) -> None:
    services = server.services
    full = Exports(services.model, services.config.site_folder, tmp_path, free_bytes=lambda _: 1000)
    object.__setattr__(services, "exports", full)
    object.__setattr__(services, "site_imports", SiteImports(tmp_path / "maps", free_bytes=lambda _: 1000))
    for answer in (editor.http.get("/api/export/cloud.ply"), import_site(editor, b"PK")):
        assert answer.status_code == 507
        assert "free its disk" in answer.json()["error"]


# ----------------------------------------------------------------------------------------------------- the graph
def test_a_graph_is_shown_first_and_then_taken_as_one_step(editor: Person, admin: Person) -> None:
    saved = export(editor, "graph.geojson")
    before = editor.graph()
    editor.edit("delete_poi", poi_id="b").raise_for_status()
    editor.edit("add_poi", name="Lift", kind="lift", x_m=3.0, y_m=0.0).raise_for_status()
    there = editor.graph()

    preview = import_graph(editor, saved, name="plan <1>.geojson").raise_for_status().json()
    assert (preview["applied"], preview["whole"], preview["unused"]) == (False, True, [])
    told = {(row["change"], row["kind"], row["name"]) for row in preview["changes"]}
    assert told == {("added", "poi", "Bar"), ("added", "edge", "Hall – Bar"), ("removed", "poi", "Lift")}
    assert editor.graph() == there, "a preview changes nothing"

    done = import_graph(editor, saved, name="plan <1>.geojson", confirm=preview["token"]).raise_for_status().json()
    assert done["applied"]
    after = editor.graph()
    assert (after["pois"], after["edges"]) == (before["pois"], before["edges"])
    assert done["draft_version"] == after["version"] == there["version"] + 1
    editor.http.post("/api/undo").raise_for_status()
    assert editor.graph()["pois"] == there["pois"], "one undo takes it back"
    assert ("Eve", "graph_import") in audit(admin)


def test_a_file_of_another_program_adds_and_says_what_it_could_not_use(editor: Person) -> None:
    data = json.dumps(FOREIGN).encode()
    preview = import_graph(editor, data).raise_for_status().json()
    assert not preview["whole"]
    assert [(row["change"], row["name"]) for row in preview["changes"]] == [("added", "Lift")]
    assert preview["unused"] == ["Feature 2 (Room 3): a Polygon is neither a place nor a road."]
    import_graph(editor, data, confirm=preview["token"]).raise_for_status()
    assert [poi["name"] for poi in editor.graph()["pois"]] == ["Hall", "Bar", "Lift"]


def test_who_heard_no_answer_asks_again_and_the_graph_is_imported_once(editor: Person, admin: Person) -> None:
    data = json.dumps(FOREIGN).encode()
    token = import_graph(editor, data).json()["token"]
    once = import_graph(editor, data, confirm=token).raise_for_status().json()
    again = import_graph(editor, data, confirm=token).raise_for_status().json()
    assert once["applied"]
    assert again["applied"]
    assert again["draft_version"] == once["draft_version"] == editor.graph()["version"]
    assert [poi["name"] for poi in editor.graph()["pois"]] == ["Hall", "Bar", "Lift"]
    assert import_graph(admin, data, confirm=token).status_code == 409, "the preview was somebody else's"


def test_what_was_changed_since_the_preview_is_not_lost(editor: Person, admin: Person) -> None:
    data = json.dumps(FOREIGN).encode()
    token = import_graph(editor, data).json()["token"]
    admin.edit("add_poi", name="Exit", kind="exit", x_m=5.0, y_m=0.0).raise_for_status()
    there = editor.graph()["pois"]
    refused = import_graph(editor, data, confirm=token)
    assert (refused.status_code, "changed since the preview" in refused.json()["error"]) == (409, True)
    assert import_graph(editor, data + b" ", confirm=import_graph(editor, data).json()["token"]).status_code == 409
    assert import_graph(editor, data, confirm="nonsense").status_code == 400
    assert editor.graph()["pois"] == there


def test_what_somebody_changes_while_a_file_is_read_is_not_lost(server: ConsoleServer, editor: Person) -> None:
    model = server.services.model
    seen = model.graph
    editor.edit("add_poi", name="Exit", kind="exit", x_m=5.0, y_m=0.0).raise_for_status()
    there = model.graph
    with pytest.raises(ConflictError):
        model.replace(seen, "Bob", base_version=seen.version)
    assert model.graph is there


def test_an_imported_graph_outlives_the_console(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    data = json.dumps(FOREIGN).encode()
    with serving(tmp_path / "site", tmp_path / "data") as server:
        person = first_admin(server)
        token = import_graph(person, data).json()["token"]
        import_graph(person, data, name="plan.geojson", confirm=token).raise_for_status()
    with serving(tmp_path / "site", tmp_path / "data") as server:
        assert [poi.name for poi in server.services.model.graph.pois.values()] == ["Hall", "Bar", "Lift"]
        assert server.services.model.history(1)[0].why == "plan.geojson"


BROKEN_GRAPHS = {
    "nothing": b"",
    "text": b"Dear console",
    "half": b'{"type": "FeatureCollection", "features": [{"ty',
    "latin": b'{"type": "FeatureCollection", "features": [], "name": "\xe4"}',
    "not a number": b'{"type":"FeatureCollection","features":[],"x":NaN}',
    "deep": b'{"a":' + b"[" * 100_000,
    "entities": b'<!DOCTYPE a [<!ENTITY b "ha">]><graphml>&b;</graphml>',
    "many": b'{"type":"FeatureCollection","features":[' + b"{}," * 999_999 + b"{}]}",
    "newer": b'{"type":"FeatureCollection","features":[],"vbr_poi_graph":{"schema_version":99,"graph_version":1}}',
    "archive": b"PK\x03\x04" + bytes(100),
}


@pytest.mark.parametrize("name", BROKEN_GRAPHS)
def test_a_broken_graph_is_refused_and_the_draft_stays(server: ConsoleServer, editor: Person, name: str) -> None:
    draft, files = server.services.model.graph, disk(server)
    for confirm in ("", "0" * 64):
        answer = import_graph(editor, BROKEN_GRAPHS[name], confirm=confirm)
        assert answer.status_code == 400
        assert answer.json()["error"].endswith(".")
    assert server.services.model.graph is draft
    assert disk(server) == files


def test_a_graph_that_breaks_a_law_is_refused_naming_the_fault(server: ConsoleServer, editor: Person) -> None:
    draft = server.services.model.graph
    answer = import_graph(editor, export(editor, "graph.geojson").replace(b'"length_m":6.0', b'"length_m":5.0'))
    assert (answer.status_code, "length of edge a-b" in answer.json()["error"]) == (400, True)
    assert server.services.model.graph is draft


def test_more_than_is_taken_is_refused_before_it_is_read(server: ConsoleServer, editor: Person) -> None:
    files = disk(server)
    assert status_without_body(editor, "/api/import/graph", MAX_GRAPH_FILE_BYTES + 1) == 413
    assert status_without_body(editor, "/api/import/site", MAX_ARCHIVE_BYTES + 1) == 413
    assert status_without_body(editor, "/api/edits", 1 << 20) == 413
    # Also where nothing says how long it is.
    endless = (b" " * (1 << 20) for _ in range((MAX_GRAPH_FILE_BYTES >> 20) + 2))
    assert editor.http.post("/api/import/graph", content=endless).status_code == 413
    assert disk(server) == files


def status_without_body(person: Person, path: str, length: int) -> int:
    """Announce a body, send none of it, and return the status of the answer."""
    address = urlsplit(person.url)
    cookies = "; ".join(f"{name}={value}" for name, value in person.http.cookies.items())
    with socket.create_connection((address.hostname, address.port), timeout=20.0) as plain:
        plain.sendall(
            f"POST {path} HTTP/1.1\r\nHost: {address.netloc}\r\nOrigin: {person.url}\r\nCookie: {cookies}\r\n"
            f"Content-Length: {length}\r\n\r\n".encode()
        )
        return int(plain.recv(4096).split(b" ", 2)[1])


# ------------------------------------------------------------------------------------------------------ the site
def test_a_site_that_was_exported_becomes_another_that_can_be_served(
    server: ConsoleServer, editor: Person, admin: Person, tmp_path: Path
) -> None:
    in_use = disk(server)
    data = export(editor, "site.zip")
    answer = import_site(editor, data)
    assert answer.status_code == 201
    told = answer.json()
    folder = Path(told["site"])
    assert (told["name"], told["serve"]) == ("Small site", f"vbr console --site {folder}")
    assert folder.parent == server.services.builds.folder.resolve()
    assert load_site(folder).poi_graph == load_site(server.services.config.site_folder).poi_graph
    # Never over one that is there: the same again is another folder.
    assert import_site(editor, data).json()["site"] != told["site"]
    assert in_use.items() <= disk(server).items()
    assert [path.name for path in folder.parent.iterdir() if path.name.startswith(".")] == []
    assert ("Eve", "import_site") in audit(admin)
    with serving(folder, tmp_path / "other") as second:
        assert export(first_admin(second), "site.zip") == data


def with_member(data: bytes, name: str, content: bytes) -> bytes:
    out = io.BytesIO(data)
    with zipfile.ZipFile(out, "a") as archive:
        archive.writestr(name, content)
    return out.getvalue()


def test_a_broken_archive_is_refused_and_the_disk_stays(server: ConsoleServer, editor: Person) -> None:
    data = export(editor, "site.zip")
    files = disk(server)
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 0xFF
    broken = {
        "nothing": b"",
        "half": data[: len(data) // 2],
        "flipped": bytes(flipped),
        "outside": with_member(data, "../../evil", b"x"),
        "extra": with_member(data, "site/map/evil.npy", b"x"),
        "graph": export(editor, "graph.geojson"),
    }
    for name, each in broken.items():
        answer = import_site(editor, each)
        assert (name, answer.status_code) == (name, 400)
        assert answer.json()["error"].endswith(".")
        assert str(server.services.config.data_folder) not in answer.json()["error"]
    assert disk(server) == files
    assert not list(server.services.config.data_folder.rglob("evil*"))
    folder = server.services.site_imports.folder
    assert not folder.exists() or not list(folder.iterdir())


def test_one_who_goes_away_in_the_middle_leaves_nothing_and_makes_room(server: ConsoleServer, editor: Person) -> None:
    data = export(editor, "site.zip")
    imports = server.services.site_imports
    address = urlsplit(editor.url)
    cookies = "; ".join(f"{name}={value}" for name, value in editor.http.cookies.items())
    with socket.create_connection((address.hostname, address.port)) as plain:
        plain.sendall(
            f"POST /api/import/site HTTP/1.1\r\nHost: {address.netloc}\r\nOrigin: {editor.url}\r\nCookie: {cookies}\r\n"
            f"Content-Length: {len(data)}\r\nExpect: 100-continue\r\n\r\n".encode()
        )
        # The console asks for the body only once the place is taken.
        assert b"100 Continue" in plain.recv(4096)
        plain.sendall(data[:1000])
        busy = import_site(editor, data)
        assert (busy.status_code, "Another site is being imported" in busy.json()["error"]) == (409, True)
    assert imports._busy.acquire(timeout=20.0)
    imports._busy.release()
    assert list(imports.folder.iterdir()) == []
    assert import_site(editor, data).status_code == 201


def test_what_a_killed_console_had_begun_is_cleared_away(tmp_path: Path) -> None:
    (tmp_path / "maps" / ".importing-x").mkdir(parents=True)
    (tmp_path / "maps" / "built-1").mkdir()
    SiteImports(tmp_path / "maps")
    assert [path.name for path in (tmp_path / "maps").iterdir()] == ["built-1"]


def test_a_console_that_is_killed_keeps_what_it_confirmed_and_clears_away_the_rest(
    tmp_path: Path, small_site: Site
) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        archive = export(first_admin(server), "site.zip")
    process = ConsoleProcess(tmp_path / "site", tmp_path)
    try:
        person = Person(f"http://127.0.0.1:{process.port}")
        person.sign_in("Ada").raise_for_status()
        data = json.dumps(FOREIGN).encode()
        token = import_graph(person, data).json()["token"]
        import_graph(person, data, confirm=token).raise_for_status()
        kept = Path(import_site(person, archive).raise_for_status().json()["site"])

        def until_killed() -> Iterator[bytes]:
            yield archive[:1000]
            while not list(kept.parent.glob(".importing-*/archive.zip")):
                yield b" "
            process.kill()
            yield archive[1000:]

        with pytest.raises(httpx.HTTPError):
            import_site(person, until_killed())
        assert len(list(kept.parent.iterdir())) == 2
        process.start()
        person.sign_in("Ada").raise_for_status()
        assert [poi["name"] for poi in person.graph()["pois"]] == ["Hall", "Bar", "Lift"]
        assert list(kept.parent.iterdir()) == [kept]
        assert load_site(kept).name == small_site.name
    finally:
        process.kill()
