"""What every answer carries to the browser: policies as they were decided, nothing private kept, no way out."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator

import pytest
from authorization_room import DEVICE_ID, Room, authorization_room, filled
from authorization_statement import IN_GROUP

from console.api_walks import figures_csv
from console.pages import static_folder
from console.past_walks import PastWalk
from console.walk_figures import Deviation, WalkFigures
from navcore.wire import ColourImage, DepthImage, SharingRunning

PAGE_POLICY = {
    "default-src 'none'", "script-src 'self'", "style-src 'self'", "img-src 'self' data: blob:", "media-src 'self'",
    "connect-src 'self'", "frame-src 'self'", "manifest-src 'self'", "form-action 'self'", "base-uri 'none'",
    "frame-ancestors 'none'",
}  # fmt: skip
SCENE_POLICY = {
    "default-src 'none'", "script-src 'sha256-H' 'sha256-H' 'strict-dynamic' 'wasm-unsafe-eval'", "worker-src blob:",
    "style-src 'unsafe-inline'", "img-src 'self' data: blob:", "font-src data:", "connect-src 'self' data: blob:",
    "base-uri 'none'", "form-action 'none'", "frame-ancestors 'self'",
}  # fmt: skip
MAY_BE_KEPT = {"/static/style.css": "no-cache", "/viewer/scene/": "private, no-cache"}
"""All else is never kept by a browser, or by anything on the way."""
TRAVERSALS = (
    "/static/../console/rules.py", "/static/%2e%2e/console/rules.py", "/static/..%2fconsole/rules.py",
    "/static/....//console/rules.py", "/static//etc/passwd", "/static/..\\console\\rules.py", "/static/style.css/..",
    "/static/\x00style.css", "/static/", "/static/./../pyproject.toml",
)  # fmt: skip
MARKUP = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with authorization_room(tmp_path_factory.mktemp("answers")) as room:
        hub = room.services.hub
        sharing = SharingRunning(silhouettes=True, walks=True, colour_for="admin", colour_until_s=hub.now_s() + 60.0)
        for message in (sharing, DepthImage(hub.now_s(), b"\xff\xd8"), ColourImage(hub.now_s(), b"\xff\xd8")):
            hub.receive(DEVICE_ID, message)
        yield room


def policy(text: str) -> set[str]:
    return set(re.sub(r"sha256-[A-Za-z0-9+/=]+", "sha256-H", text).split("; "))


def test_every_answer_to_everybody_carries_the_policies(room: Room) -> None:
    paths = [filled(path) for method, path in IN_GROUP if method == "GET"]
    for caller in ("nobody", "viewer", "admin", "device"):
        for path in (*paths, "/nothing", "/api/nothing", "/static/nothing"):
            answer = room.call(room.callers[caller], "GET", path)
            is_scene = path == "/viewer/scene/" and answer.status == 200
            headers = answer.headers
            assert policy(headers["content-security-policy"]) == (SCENE_POLICY if is_scene else PAGE_POLICY), path
            assert headers["x-content-type-options"] == "nosniff"
            assert headers["referrer-policy"] == "no-referrer"
            assert headers["cross-origin-opener-policy"] == headers["cross-origin-resource-policy"] == "same-origin"
            kept = MAY_BE_KEPT.get(path, "no-store") if answer.status == 200 else "no-store"
            assert headers["cache-control"] == kept, f"{path} to {caller}"


def test_pictures_of_a_walker_are_kept_nowhere(room: Room) -> None:
    for picture in ("depth.jpg", "colour.jpg"):
        answer = room.call(room.callers["admin"], "GET", f"/api/devices/{DEVICE_ID}/{picture}")
        assert (answer.status, answer.body, answer.headers["cache-control"]) == (200, b"\xff\xd8", "no-store")
        assert room.call(room.callers["nobody"], "GET", f"/api/devices/{DEVICE_ID}/{picture}").status == 401
    assert room.call(room.callers["editor"], "GET", f"/api/devices/{DEVICE_ID}/colour.jpg").status == 404, "not asked"


@pytest.mark.parametrize("path", TRAVERSALS)
def test_no_path_leads_out_of_the_folder_of_the_pages(room: Room, path: str) -> None:
    for caller in ("nobody", "admin"):
        answer = room.call(room.callers[caller], "GET", path)
        assert answer.status in (401, 403, 404), f"{answer.status} {answer.body[:80]!r}"


@pytest.mark.parametrize(
    "path", ["//evil.example", "/\\evil.example", "/%0d%0aSet-Cookie: a=b", "/http://evil.example"]
)
def test_no_answer_leads_to_another_site(room: Room, path: str) -> None:
    answer = room.call(room.callers["nobody"], "GET", path)
    assert answer.status in (303, 404)
    location = answer.headers.get("location", "/")
    assert location.startswith("/")
    assert not location.startswith(("//", "/\\"))
    assert "\n" not in location
    assert "set-cookie" not in answer.headers


@pytest.mark.parametrize(
    "query",
    [
        "websocket=wss://evil.example", "playbackPath=https://evil.example/x.viser", "playbackPath=data:,x",
        "%70laybackPath=data:,x", "fixedDpr=1&playbackPath=x", "&", "x", "playbackPath", "initialCameraPosition=1,2,3",
    ],
)  # fmt: skip
def test_the_scene_shows_nothing_that_its_address_leads_to(room: Room, query: str) -> None:
    answer = room.call(room.callers["viewer"], "GET", f"/viewer/scene/?{query}")
    plain = "/viewer/scene/?fixedDpr=1" if "fixedDpr" in query else "/viewer/scene/"
    assert (answer.status, answer.headers["location"]) == (303, plain)
    assert room.call(room.callers["viewer"], "GET", plain).status == 200


def test_what_is_downloaded_has_a_plain_name_whatever_the_site_is_called(room: Room) -> None:
    services = room.services
    object.__setattr__(services.model.site, "name", 'x"\r\nSet-Cookie: a=b; filename="../../evil')
    for what in ("graph.geojson", "graph.graphml", "cloud.ply", "road.tum"):
        answer = room.call(room.callers["admin"], "GET", f"/api/export/{what}")
        name = re.fullmatch(r'attachment; filename="([a-z0-9.-]+)"', answer.headers["content-disposition"])
        assert answer.status == 200
        assert name is not None
        assert ".." not in name.group(1)
        assert "set-cookie" not in answer.headers


@pytest.mark.parametrize("sign", ["=", "+", "-", "@", "\t=", "\r=", "\n=", "＝", "＋", "－", "＠"])
def test_a_table_holds_no_formula_whatever_a_device_or_a_place_is_called(sign: str) -> None:
    text = f"{sign}HYPERLINK('http://evil.example')"
    walk = PastWalk(text, text, "site", "", 0.0, 1.0, (), False, "0.1", 1, "0" * 64, 1)
    nothing = Deviation(None, None, None)
    figures = WalkFigures(text, text, False, text, 1.0, 0.0, 1.0, None, nothing, 0, 0.0, 0.0, 0.0, ())
    (_, row) = csv.reader(io.StringIO(figures_csv([(walk, figures)]), newline=""))
    assert [cell for cell in row if cell.endswith(text)] == [f"'{text}"] * 5
    assert not [cell for cell in row if cell.startswith(sign)]


def test_markup_in_names_stays_text_in_what_is_exported(room: Room) -> None:
    edit = {"edit": "add_poi", "name": MARKUP, "kind": "room", "x_m": 5.0, "y_m": 0.0}
    assert room.call(room.callers["editor"], "POST", "/api/edits", edit).status == 200
    answer = room.call(room.callers["admin"], "GET", "/api/export/graph.graphml")
    assert b"<img" not in answer.body
    assert b"&lt;img" in answer.body
    for path, kind in (("/api/export/graph.geojson", "application/geo+json"), ("/api/graph", "application/json")):
        assert room.call(room.callers["admin"], "GET", path).headers["content-type"] == kind, "never taken for HTML"


def test_bodies_are_bounded_before_they_are_read(room: Room) -> None:
    large = {"POST /api/import/graph", "POST /api/import/site"}
    for (method, path), group in IN_GROUP.items():
        if method in ("GET", "WS") or f"{method} {path}" in large:
            continue
        caller = "device" if group == "be-a-device" else "admin"
        headers = room.session("admin") if path == "/api/sign-out" else room.callers[caller]
        answer = room.call({**headers, "Content-Length": str(300 << 10)}, method, filled(path), b"x" * (300 << 10))
        assert answer.status == 413, f"{method} {path}: {answer.status}"


def test_pages_make_no_markup_of_text() -> None:
    """The pages build elements; none of the ways in which a text becomes markup, or a program, is in them."""
    ways = re.compile(
        r"innerHTML|outerHTML|insertAdjacentHTML|setHTML|srcdoc|document\.write|createContextualFragment|DOMParser"
        r"|\beval\(|new Function|javascript:|setTimeout\(\s*[\"'`]"
    )
    scripts = sorted(static_folder().rglob("*.js"))
    assert len(scripts) > 20
    assert [each.name for each in scripts if ways.search(each.read_text(encoding="utf-8"))] == []
