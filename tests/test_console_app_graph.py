"""The draft: edits, undo, publishing, and what of it survives a restart."""

from __future__ import annotations

import sqlite3
import threading
from pathlib import Path

import msgspec
import numpy as np
import pytest
from console_room import first_admin, invited, serving
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import console.model
from console.edit_conflict import EditConflictError
from console.edits import (
    AddEdge,
    AddPoi,
    DeleteEdge,
    DeletePoi,
    DeleteRoad,
    DrawRoad,
    Edit,
    JoinRoads,
    MergePois,
    MovePoi,
    ProposeEdges,
    SetEdge,
    SmoothRoad,
    SplitEdge,
    SplitRoad,
    TrimRoad,
    UpdatePoi,
    evaluate,
    touched,
)
from console.errors import ConflictError, NotFoundError
from console.graph_delta import apply_delta, changed_by, difference
from console.graph_log import LogEntry, MemoryGraphLog
from console.graph_store import StoredGraphLog
from console.model import SiteModel
from console.store import DATABASE_FILE, Store
from console.view_requests import FlyToPoint
from navcore.errors import InputError, VbrError
from navcore.planning.edits import validate
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_edits import network_of, without_road
from navcore.planning.road_network import RoadNetwork
from navcore.site import Site, load_poi_graph, save_site

PEOPLE = ("Ada", "Bob")


def floor_site() -> Site:
    """Return a site with a road of two corridors, and no place yet."""
    t = np.linspace(0.0, 1.0, 81)[:, None]
    ends = [np.array(p, dtype=np.float64) for p in ((0, 0, 0), (8, 0, 0), (8, 8, 0))]
    road = np.vstack([ends[0] + t * (ends[1] - ends[0]), (ends[1] + t * (ends[2] - ends[1]))[1:]])
    from navcore.types import CameraIntrinsics

    camera = CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0)
    return Site("floor", "Floor", camera, {}, (road,), np.zeros((4, 3), np.float32), np.zeros((4, 3), np.uint8))


SITE = floor_site()
IDS = st.sampled_from(["door", "door-2", "bar", "lift", "e1", "e2", "e3"])
ROADS = st.sampled_from(["r1", "r2", "r3", "r4"])
PLACES = st.tuples(st.floats(-1, 9), st.floats(-1, 9))


def road_edits() -> st.SearchStrategy[Edit]:
    return st.one_of(
        st.builds(lambda a, b: DrawRoad((a, b)), PLACES, PLACES),
        st.builds(TrimRoad, ROADS, PLACES, PLACES),
        st.builds(SmoothRoad, ROADS),
        st.builds(SplitRoad, ROADS, PLACES),
        st.builds(JoinRoads, ROADS, ROADS),
        st.builds(DeleteRoad, ROADS),
    )


@st.composite
def edits(draw: st.DrawFn) -> Edit:
    kind = draw(
        st.sampled_from(
            [
                "add",
                "add",
                "add",
                "move",
                "move",
                "name",
                "delete",
                "join",
                "cut",
                "set",
                "all",
                "all",
                "merge",
                "split",
                "road",
                "road",
            ]
        )
    )
    x_m, y_m = draw(PLACES)
    match kind:
        case "add":
            return AddPoi(draw(st.sampled_from(["Door", "Bar", "Lift"])), "door", x_m, y_m, draw(st.booleans()))
        case "move":
            return MovePoi(draw(IDS), x_m, y_m, draw(st.booleans()))
        case "name":
            return UpdatePoi(draw(IDS), name=draw(st.sampled_from(["Door", "Exit"])))
        case "delete":
            return DeletePoi(draw(IDS))
        case "join":
            return AddEdge(draw(IDS), draw(IDS))
        case "cut":
            return DeleteEdge(draw(IDS))
        case "set":
            return SetEdge(draw(IDS), closed=draw(st.booleans()), turned=draw(st.booleans()))
        case "merge":
            return MergePois(draw(IDS), draw(IDS))
        case "split":
            return SplitEdge(draw(IDS), x_m, y_m, "Lift")
        case "road":
            return draw(road_edits())
        case _:
            return ProposeEdges()


STEPS = st.lists(st.tuples(st.sampled_from(PEOPLE), st.one_of(edits(), st.sampled_from(["undo", "redo"]))), max_size=25)


def things(graph: PoiGraph) -> tuple[object, ...]:
    return graph.pois, graph.edges, graph.roads


def play(model: SiteModel, steps: list[tuple[str, Edit | str]]) -> None:
    for who, step in steps:
        before = model.graph
        try:
            if isinstance(step, str):
                model.undo(who) if step == "undo" else model.redo(who)
            else:
                model.apply(step, who)
        except VbrError:
            assert model.graph == before, "what is refused changes nothing"
        else:
            assert model.graph.version == before.version + (model.graph is not before)
        validate(model.graph)
        assert without_road(model.graph, model.network, model.graph.pois, model.graph.edges) is None


def test_a_refused_redo_comes_back_after_a_restart_and_is_refused_again() -> None:
    log = MemoryGraphLog()
    model = SiteModel(SITE, log)
    model.apply(AddPoi("Door", "door", 0.0, 0.0, on_road=False), "Ada")
    model.undo("Ada")
    model.apply(AddPoi("Door", "door", 1.0, 0.0, on_road=False), "Bob")
    for each in (model, SiteModel(SITE, log)):
        before = each.graph
        with pytest.raises(ConflictError, match="changed meanwhile"):
            each.redo("Ada")
        assert each.graph == before
        assert not each.can_redo("Ada")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(STEPS)
def test_whatever_two_people_do_the_graph_stays_valid_and_the_log_gives_it_back(
    steps: list[tuple[str, Edit | str]],
) -> None:
    log = MemoryGraphLog()
    model = SiteModel(SITE, log)
    play(model, steps)
    again = SiteModel(SITE, log)
    assert again.graph == model.graph
    for who in PEOPLE:
        # What was refused for a conflict is off the stack until a restart, where it is offered, and refused, once more.
        assert not model.can_redo(who) or again.can_redo(who)
        assert not model.can_undo(who) or again.can_undo(who)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(edits(), max_size=15))
def test_one_persons_undo_leads_back_to_the_start_and_redo_to_the_end(steps: list[Edit]) -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    start = model.graph
    play(model, [("Ada", step) for step in steps])
    end, count = model.graph, 0
    while model.can_undo("Ada"):
        model.undo("Ada")
        count += 1
    assert things(model.graph) == things(start)
    for _ in range(count):
        model.redo("Ada")
    assert things(model.graph) == things(end)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(edits(), max_size=12))
def test_a_difference_leads_there_and_its_inverse_back(steps: list[Edit]) -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    before = model.graph
    play(model, [("Ada", step) for step in steps])
    delta = difference(before, model.graph)
    there = apply_delta(before, delta, model.graph.version)
    assert there == model.graph
    assert apply_delta(there, delta.inverse(), before.version) == before


def test_an_undo_never_takes_away_what_others_built_on_it() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    for name, x_m in (("Door", 1.0), ("Bar", 6.0)):
        model.apply(AddPoi(name, "door", x_m, 0.0), "Ada")
    model.apply(MovePoi("bar", 5.0, 0.0), "Bob")
    model.apply(AddEdge("door", "bar"), "Bob")
    with pytest.raises(ConflictError, match="Bar"):
        model.undo("Ada")
    with pytest.raises(ConflictError, match="The connection Door – Bar was drawn since"):
        model.undo("Ada")
    assert set(model.graph.pois) == {"door", "bar"}
    assert len(model.graph.edges) == 1


def test_an_undo_never_takes_the_road_from_under_what_others_put_there() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    model.apply(DrawRoad(((0.0, 0.0), (0.0, 4.0))), "Ada")
    model.apply(AddPoi("Bar", "bar", 0.0, 3.0), "Bob")
    before = model.graph
    with pytest.raises(ConflictError, match="Bar would be left without a road"):
        model.undo("Ada")
    assert model.graph == before


# ------------------------------------------------------------------------------------------------ two at one thing
def test_who_changes_what_another_has_changed_meanwhile_is_shown_both_versions() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    seen = model.apply(AddPoi("Door", "door", 1.0, 0.0), "Ada").version
    model.apply(UpdatePoi("door", name="Front door"), "Bob", seen)
    before = model.graph
    with pytest.raises(EditConflictError, match="Bob has changed this place “Front door” meanwhile") as caught:
        model.apply(UpdatePoi("door", name="Glass door"), "Ada", seen)
    assert model.graph == before
    conflict = caught.value.details()["conflict"]
    assert (conflict["by"], conflict["theirs"]["name"], conflict["yours"]["name"]) == (
        "Bob",
        "Front door",
        "Glass door",
    )
    model.apply(UpdatePoi("door", name="Glass door"), "Ada", conflict["version"])
    assert model.graph.pois["door"].name == "Glass door", "who has seen theirs may decide"


def test_what_was_deleted_meanwhile_is_said_so_and_other_things_do_not_clash() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    model.apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    seen = model.apply(AddPoi("Bar", "bar", 6.0, 0.0), "Ada").version
    model.apply(MovePoi("bar", 5.0, 0.0), "Bob", seen)
    model.apply(UpdatePoi("door", notes="Opens inwards"), "Ada", seen)
    model.apply(DeletePoi("door"), "Bob", model.graph.version)
    with pytest.raises(EditConflictError, match="Bob has deleted this place") as caught:
        model.apply(UpdatePoi("door", notes="Heavy"), "Ada", seen)
    assert caught.value.details()["conflict"]["theirs"] is None


def test_what_somebody_decided_is_not_hidden_by_what_merely_follows_ones_own_edit() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    for name, x_m in (("Door", 1.0), ("Bar", 6.0)):
        model.apply(AddPoi(name, "door", x_m, 0.0), "Ada")
    seen = model.apply(AddEdge("door", "bar"), "Ada").version
    model.apply(SetEdge("e1", closed=True), "Bob", seen)
    model.apply(MovePoi("bar", 5.0, 0.0), "Ada", model.graph.version)
    with pytest.raises(EditConflictError, match="Bob has changed this connection"):
        model.apply(SetEdge("e1", closed=False), "Ada", seen)
    seen = model.graph.version
    model.apply(MovePoi("bar", 4.0, 0.0), "Bob", seen)
    model.apply(SetEdge("e1", cost_multiplier=2.0), "Ada", seen)
    assert model.graph.edges["e1"].closed, "a connection that merely followed is nobody's decision"
    last = model.last_change(("poi", "bar"))
    assert last is not None
    assert last.author == "Bob"


def test_an_undo_that_cannot_be_written_can_be_tried_again() -> None:
    class FullDisk(MemoryGraphLog):
        is_full = False

        def append(self, entry: LogEntry) -> None:
            if self.is_full:
                raise OSError(28, "No space left on device")
            super().append(entry)

    log = FullDisk()
    model = SiteModel(SITE, log)
    before = model.graph
    model.apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    log.is_full = True
    with pytest.raises(OSError, match="No space"):
        model.undo("Ada")
    log.is_full = False
    assert things(model.undo("Ada")) == things(before)


def test_nobody_waits_for_an_edit_of_the_road_that_takes_long() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    begun, done = threading.Event(), threading.Event()
    evaluated = console.model.evaluate

    def slow(edit: Edit, graph: PoiGraph, network: RoadNetwork) -> PoiGraph:
        if isinstance(edit, SmoothRoad) and not done.is_set():
            begun.set()
            assert done.wait(20)
        return evaluated(edit, graph, network)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(console.model, "evaluate", slow)
        smoothing = threading.Thread(target=model.apply, args=(SmoothRoad("r1"), "Ada"))
        smoothing.start()
        assert begun.wait(20)
        model.apply(AddPoi("Door", "door", 1.0, 0.0), "Bob")
        assert "door" in model.graph.pois, "while the other edit is still worked out"
        done.set()
        smoothing.join(20)
    kinds = [entry.author for entry in model.history(2)]
    assert kinds == ["Ada", "Bob"]
    assert "door" in model.graph.pois, "the slow edit is of the draft as it was when it was made"


def test_an_edge_drawn_meanwhile_to_a_place_is_not_deleted_with_it_unseen() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    model.apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    seen = model.apply(AddPoi("Bar", "bar", 6.0, 0.0), "Ada").version
    model.apply(AddEdge("door", "bar"), "Bob", seen)
    with pytest.raises(EditConflictError, match="Bob has changed this connection"):
        model.apply(DeletePoi("door"), "Ada", seen)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.sampled_from(PEOPLE), edits(), st.integers(0, 4)), max_size=20))
def test_two_editors_lose_nothing_silently(steps: list[tuple[str, Edit, int]]) -> None:
    """Each edit is of a version some steps old: it is made as asked, or refused, and nothing of the other's changes."""
    model = SiteModel(SITE, MemoryGraphLog())
    last_by: dict[object, dict[str, int]] = {}
    for who, edit, steps_old in steps:
        before = model.graph
        base = max(0, before.version - steps_old)
        theirs = {
            thing for thing, by in last_by.items() if any(author != who and at > base for author, at in by.items())
        }
        clashes = theirs & set(touched(edit, before))
        try:
            after = model.apply(edit, who, base)
        except VbrError:
            assert model.graph == before
            continue
        assert not clashes
        assert things(after) == things(evaluate(edit, before, model_network(before)))
        for thing in changed_by(difference(before, after)):
            last_by.setdefault(thing, {})[who] = after.version


def model_network(graph: PoiGraph) -> RoadNetwork:
    return network_of(graph.roads)


# -------------------------------------------------------------------------------------------------------- versions
def test_a_named_version_can_be_gone_back_to_and_that_be_undone(tmp_path: Path) -> None:
    log = StoredGraphLog(Store.open(tmp_path), "floor", "Floor")
    model = SiteModel(SITE, log)
    model.apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    model.apply(DrawRoad(((0.0, 0.0), (0.0, 4.0))), "Bob")
    named = model.name_version("Before the works", "Ada")
    good = model.graph
    with pytest.raises(ConflictError, match="name already"):
        model.name_version("Before the works", "Bob")
    model.apply(DeletePoi("door"), "Ada")
    model.apply(AddPoi("Bar", "bar", 0.0, 2.0), "Bob")
    worse = model.graph
    with pytest.raises(ConflictError, match="changed meanwhile"):
        model.roll_back(named.version, "Ada", worse.version - 1)
    assert things(model.roll_back(named.version, "Ada", worse.version)) == things(good)
    assert model.graph.version == worse.version + 1, "nothing of what was is taken out of the log"
    again = SiteModel(SITE, log)
    assert again.graph == model.graph
    assert again.named_versions() == (named,)
    assert things(again.undo("Ada")) == things(worse)
    with pytest.raises(NotFoundError, match="no version 99"):
        again.roll_back(99, "Ada")


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(STEPS)
def test_every_version_there_was_can_be_looked_at(steps: list[tuple[str, Edit | str]]) -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    seen = {model.graph.version: model.graph}
    model.subscribe(lambda change: seen.update({change.graph.version: change.graph}))
    play(model, steps)
    assert all(model.graph_at(version) == graph for version, graph in seen.items())


def test_another_graph_in_its_place_is_one_change_and_keeps_the_roads_there_are() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    model.apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    before = model.graph
    imported = PoiGraph(7, {"lift": msgspec.structs.replace(before.pois["door"], id="lift", name="Lift")})
    after = model.replace(imported, "Ada", "places.geojson")
    assert (list(after.pois), after.roads, after.version) == (["lift"], before.roads, before.version + 1)
    assert things(model.undo("Ada")) == things(before)
    with pytest.raises(InputError, match="filed under"):
        model.replace(PoiGraph(1, {"x": before.pois["door"]}), "Ada")


def test_a_database_of_the_first_version_is_brought_up_to_date(tmp_path: Path) -> None:
    store = Store.open(tmp_path)
    SiteModel(SITE, StoredGraphLog(store, "floor", "Floor")).apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    store.close()
    with sqlite3.connect(tmp_path / DATABASE_FILE) as old:
        old.execute("drop table version_names")
        old.execute("update schema_info set version = 1")
    model = SiteModel(SITE, StoredGraphLog(Store.open(tmp_path), "floor", "Floor"))
    assert list(model.graph.pois) == ["door"]
    model.name_version("Now", "Ada")


def test_versions_conflicts_and_presence_through_the_api(tmp_path: Path) -> None:
    save_site(SITE, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        ada = first_admin(server)
        bob = invited(ada, "Bob", "editor")
        seen = ada.edit("add_poi", name="Door", kind="door", x_m=1, y_m=0).json()["version"]
        assert ada.http.post("/api/versions", json={"name": "First"}).status_code == 201
        bob.edit("update_poi", poi_id="door", name="Front door").raise_for_status()
        late = ada.http.post(
            f"/api/edits?base_version={seen}", json={"edit": "update_poi", "poi_id": "door", "name": "Glass door"}
        )
        assert (late.status_code, late.json()["conflict"]["theirs"]["name"]) == (409, "Front door")
        rows = ada.http.get("/api/versions").json()["versions"]
        assert [(row["version"], row["name"]) for row in rows] == [(seen, "First"), (1, None)]
        (change,) = ada.http.get(f"/api/versions/{seen}/difference").json()["changes"]
        assert (change["change"], change["fields"]) == ("changed", {"name": ["Door", "Front door"]})
        back = bob.http.post(f"/api/versions/{seen}/roll-back").json()
        assert back["pois"][0]["name"] == "Door"
        words = [line["words"] for line in ada.http.get("/api/history").json()["history"]]
        assert words[:3] == [f"Went back to version {seen}", "Changed Door: name", "Tagged Door"]
        said = ada.http.post("/api/presence", json={"window": "w1", "doing": "editing", "kind": "poi", "id": "door"})
        assert said.json() == {"others": []}
        (other,) = bob.http.post("/api/presence", json={"window": "w1"}).json()["others"]
        assert (other["user_name"], other["thing"], "session" in str(other)) == ("Ada", ["poi", "door"], False)
        assert ada.http.get("/api/versions/77/difference").status_code == 404


def test_listeners_hear_every_change_in_order_and_one_that_fails_stops_nobody() -> None:
    model = SiteModel(SITE, MemoryGraphLog())
    heard: list[tuple[str, int]] = []

    def fail(_: object) -> None:
        raise RuntimeError("a broken listener")

    model.subscribe(fail)
    unsubscribe = model.subscribe(lambda change: heard.append((change.kind, change.graph.version)))
    first = model.graph.version
    model.apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    model.undo("Ada")
    model.redo("Ada")
    model.publish("Ada")
    model.publish("Ada")
    unsubscribe()
    model.apply(DeletePoi("door"), "Ada")
    assert heard == [("edit", first + 1), ("undo", first + 2), ("redo", first + 3), ("publish", first + 3)]


def test_an_answered_edit_is_in_the_database_before_anybody_hears_of_it(tmp_path: Path) -> None:
    store, other = Store.open(tmp_path), Store.open(tmp_path)
    model = SiteModel(SITE, StoredGraphLog(store, "floor", "Floor"))
    seen: list[int] = []
    model.subscribe(lambda _: seen.append(max(e.version for e in StoredGraphLog(other, "floor", "Floor").entries())))
    graph = model.apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    assert seen == [graph.version]


def test_a_second_console_on_the_same_site_is_refused_not_mixed(tmp_path: Path) -> None:
    models = [SiteModel(SITE, StoredGraphLog(Store.open(tmp_path), "floor", "Floor")) for _ in range(2)]
    models[0].apply(AddPoi("Door", "door", 1.0, 0.0), "Ada")
    with pytest.raises(ConflictError, match="Another console"):
        models[1].apply(AddPoi("Bar", "bar", 2.0, 0.0), "Bob")
    assert models[1].graph.pois == {}


def test_editing_through_the_api_and_over_a_restart(tmp_path: Path) -> None:
    save_site(SITE, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        admin = first_admin(server)
        assert admin.graph()["version"] == admin.graph()["published_version"] == 1
        for name, x_m in (("Hall", 0.5), ("Wash room", 6.0), ("Room 3308", 7.9)):
            admin.edit("add_poi", name=name, kind="room", x_m=x_m, y_m=0.3).raise_for_status()
        graph = admin.edit("propose_edges").raise_for_status().json()
        assert [edge["length_m"] for edge in graph["edges"]] == pytest.approx([5.5, 1.9], abs=0.3)
        admin.edit("update_poi", poi_id="hall", name="Great hall").raise_for_status()
        admin.http.post("/api/undo").raise_for_status()
        assert graph["published_version"] == 1
        assert not graph["destinations"]
    with serving(tmp_path / "site", tmp_path / "data") as server:
        admin.__init__(server.ready.url)  # type: ignore[misc]
        admin.sign_in("Ada").raise_for_status()
        again = admin.graph()
        assert {poi["name"] for poi in again["pois"]} == {"Hall", "Wash room", "Room 3308"}
        assert len(again["edges"]) == 2
        assert again["version"] == 7
        assert again["can_redo"]
        assert admin.http.post("/api/redo").json()["pois"][0]["name"] == "Great hall"
        assert not admin.http.post("/api/undo").json()["pois"][0]["name"].startswith("Great")
        assert admin.http.post("/api/undo").json()["edges"] == []
        refused = admin.http.post("/api/publish")
        assert (refused.status_code, refused.json()["findings"][0]["code"]) == (409, "unreachable_poi")
        assert admin.http.post("/api/publish", json={"confirmed": True}).status_code == 400
        confirmed = {"confirmed": True, "version": refused.json()["version"]}
        published = admin.http.post("/api/publish", json=confirmed).json()
        assert published["published_version"] == published["version"]
        assert len(published["destinations"]) == 3
        assert load_poi_graph(tmp_path / "site") == server.services.model.for_devices
        assert [line["kind"] for line in admin.http.get("/api/history").json()["history"]][:4] == [
            "undo",
            "undo",
            "redo",
            "undo",
        ]
    with serving(tmp_path / "site", tmp_path / "data") as server:
        assert server.services.model.published.version == published["version"]


def test_the_graph_of_the_site_is_where_the_draft_begins(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        assert server.services.model.graph.pois == small_site.poi_graph.pois
        assert server.services.model.for_devices == small_site.poi_graph


def test_a_map_that_was_built_anew_begins_from_its_own_graph(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        server.services.model.apply(DeletePoi("a"), "Ada")
    import dataclasses

    fresh = dataclasses.replace(small_site, cloud_points_m=small_site.cloud_points_m + 1, poi_graph=PoiGraph())
    save_site(fresh, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        assert server.services.model.graph.pois == {}


BAD_EDITS = [
    (b"", "cannot be made"),
    (b"{", "cannot be made"),
    (b"[" * 50_000, "cannot be made"),
    (b'{"edit": "explode"}', "explode"),
    (b'{"edit": "add_poi", "name": "", "kind": "room", "x_m": 0, "y_m": 0}', "cannot be made"),
    (b'{"edit": "add_poi", "name": "A", "kind": "palace", "x_m": 0, "y_m": 0}', "palace"),
    (b'{"edit": "add_poi", "name": "A", "kind": "room", "x_m": 1e300, "y_m": 0}', "cannot be made"),
    (b'{"edit": "add_poi", "name": "A", "kind": "room", "x_m": NaN, "y_m": 0}', "cannot be made"),
    (b'{"edit": "add_poi", "name": "A", "kind": "room", "x_m": 50, "y_m": 50}', "from the road"),
    (b'{"edit": "add_poi", "name": "A\\ud800", "kind": "room", "x_m": 1, "y_m": 0}', "cannot be made"),
    (b'{"edit": "add_edge", "a": "a", "b": "a"}', "twice"),
    (b'{"edit": "add_edge", "a": "a", "b": "b"}', "joined already"),
    (b'{"edit": "delete_poi", "poi_id": "nowhere"}', "nowhere"),
    (b'{"edit": "set_edge", "edge_id": "a-b", "cost_multiplier": 0.1}', "cannot be made"),
    (b'{"edit": "delete_poi", "poi_id": "a", "also": 1}', "also"),
    (b'{"edit": "delete_poi", "poi_id": "' + b"a" * 300_000 + b'"}', "too large"),
]


def test_bad_edits_get_a_sentence_and_change_nothing(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        admin = first_admin(server)
        for body, words in BAD_EDITS:
            answer = admin.http.post("/api/edits", content=body)
            assert 400 <= answer.status_code < 500, body[:80]
            assert words in answer.json()["error"], (body[:80], answer.text)
        for path in ("/api/undo", "/api/redo"):
            answer = admin.http.post(path)
            assert (answer.status_code, answer.json()["error"][:20]) == (409, "There is nothing to ")
        assert admin.graph()["version"] == 1


def test_a_flight_reaches_the_scenes_of_the_same_session_only(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        admin = first_admin(server)
        viewer = invited(admin, "Vera", "viewer")
        heard: dict[str, list[object]] = {"Ada": [], "Vera": []}
        for person, name in ((admin, "Ada"), (viewer, "Vera")):
            token = next(iter(person.http.cookies.values()))
            signed_in = server.services.accounts.signed_in(token)
            assert signed_in is not None
            server.services.views.subscribe(signed_in.session_id, heard[name].append)
        assert viewer.http.post("/api/view", json={"fly_to": "b"}).json() == {"scenes": 1}
        assert (len(heard["Vera"]), len(heard["Ada"])) == (1, 0)
        assert viewer.http.post("/api/view", json={"fly_to": "zzz"}).status_code == 404
        assert viewer.http.post("/api/view", json={}).status_code == 400
        point = {"point": [1.5, -2.0], "kind": "edge", "id": "e1"}
        assert viewer.http.post("/api/view", json=point).json() == {"scenes": 1}
        assert heard["Vera"][-1] == FlyToPoint(1.5, -2.0, ("edge", "e1"))
        assert viewer.http.post("/api/view", json={"point": [1.5, -2.0]}).json() == {"scenes": 1}
        assert heard["Vera"][-1] == FlyToPoint(1.5, -2.0)
        for bad in ({"point": [1.5]}, {"point": ["x", 0]}, {"point": [1e9, 0]}, {"point": [0, 0], "fly_to": "b"},
                    {"point": [0, 0], "kind": "wall"}):  # fmt: skip
            assert viewer.http.post("/api/view", json=bad).status_code == 400
