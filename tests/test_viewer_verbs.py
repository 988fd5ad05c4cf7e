"""Verbs of the map editor beyond tagging and connecting: roads, merging, splitting, free places, what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from viewer_client import FakeBrowser
from viewer_fixtures import scene_over, services_of_crossing

from console.edits import AddPoi, DrawRoad
from console.model import SiteModel
from console.services import Services
from console.viewer.begun import Drawing, NewEdges, NewPlace, TrimmedRoad
from console.viewer.scene import Scene
from console.viewer.shortcuts import SHORTCUTS, help_groups
from console.viewer.tag import pin
from navcore.planning.edits import validate


@pytest.fixture(scope="module")
def scene_and_services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Scene, Services]]:
    folder: Path = tmp_path_factory.mktemp("verbs")
    with services_of_crossing(folder) as services, scene_over(services) as scene:
        yield scene, services


@pytest.fixture
def model(scene_and_services: tuple[Scene, Services]) -> SiteModel:
    return scene_and_services[1].model


@pytest.fixture
def browser(
    scene_and_services: tuple[Scene, Services], model: SiteModel, request: pytest.FixtureRequest
) -> Iterator[FakeBrowser]:
    """An editor's window; what its test did to the draft is undone afterwards."""
    before, name = model.graph, request.node.name
    browser = FakeBrowser(scene_and_services[0], "editor", name, client_id=2000 + len(name))
    yield browser
    browser.disconnect()
    while model.can_undo(name):
        model.undo(name)
    assert (model.graph.pois, model.graph.edges, model.graph.roads) == (before.pois, before.edges, before.roads)


# --------------------------------------------------------------------------------------------------------- roads
def draw_side_road(browser: FakeBrowser) -> None:
    """Draw a road from the corridor (5, 0) up to (5, 6)."""
    browser.key("draw")
    for x_m, y_m in ((5.0, 0.2), (5.0, 3.0), (5.0, 6.0)):
        browser.click_floor(x_m, y_m)


def test_a_road_is_drawn_by_clicks_begins_on_the_road_and_is_shown_before_it_is_accepted(
    browser: FakeBrowser, model: SiteModel
) -> None:
    draw_side_road(browser)
    begun = browser.view.editor.begun
    assert isinstance(begun, Drawing)
    assert begun.points_m[0] == pytest.approx((5.0, 0.0), abs=0.01), "it has snapped to the road, visibly"
    assert browser.view.editor.snapped_m == (begun.points_m[0],)
    assert len(model.graph.roads) == 2, "shown, and not yet accepted"
    assert browser.view.preview._lines.visible
    browser.key("accept")
    (road,) = [road for road in model.graph.roads.values() if road.origin == "drawn"]
    assert road.points_m[0] == pytest.approx((5.0, 0.0), abs=0.01)
    assert browser.view.editor.selected == ("road", road.id)
    assert f"/road/{road.id}" in browser.node_names
    assert browser.view.roads.drawn == model.graph.roads


def test_a_drawn_road_is_picked_between_its_dashes_too(browser: FakeBrowser, model: SiteModel) -> None:
    draw_side_road(browser)
    browser.key("accept")
    (road,) = [road for road in model.graph.roads.values() if road.origin == "drawn"]
    browser.key("select")
    for y_m in np.arange(1.0, 5.0, 0.1):
        browser.key("escape")
        assert browser.view.editor.selected is None
        browser.click_floor(5.1, float(y_m))
        assert browser.view.editor.selected == ("road", road.id)
    browser.click_floor(5.6, 3.0)
    assert browser.view.editor.selected is None


def test_backspace_takes_the_last_point_back_and_escape_drops_the_line(browser: FakeBrowser, model: SiteModel) -> None:
    draw_side_road(browser)
    browser.key("take_back")
    begun = browser.view.editor.begun
    assert isinstance(begun, Drawing)
    assert len(begun.points_m) == 2
    version = model.graph.version
    browser.key("escape")
    assert browser.view.editor.begun is None
    assert not browser.view.preview._lines.visible
    assert model.graph.version == version


def test_drawn_and_recorded_roads_differ_in_form_not_in_colour_alone(browser: FakeBrowser, model: SiteModel) -> None:
    model.apply(DrawRoad(((5.0, 0.0), (5.0, 6.0))), browser.person.user_name)
    browser.tick()
    bands = browser.view.roads._bands
    whole, dashed = bands["r1"].mesh.vertices, bands["r3"].mesh.vertices
    # A straight band is one quad; dashes are many.
    assert len(whole) == 4
    assert len(dashed) > 20


def test_a_road_is_cut_trimmed_joined_smoothed_and_deleted_by_the_panel(browser: FakeBrowser, model: SiteModel) -> None:
    draw_side_road(browser)
    browser.key("accept")
    road_id = browser.view.editor.road.id  # type: ignore[union-attr]
    browser.set_widget("Parts", "Split here")
    browser.click_floor(5.0, 4.0)
    other_id = next(iter(model.graph.roads.keys() - {"r1", "r2", road_id}))
    assert model.graph.roads[road_id].points_m[-1] == pytest.approx((5.0, 4.0), abs=0.05)

    browser.click_road(other_id, 5.0, 5.0)
    assert browser.view.editor.selected == ("road", other_id)
    browser.set_widget("Line", "Trim")
    browser.click_floor(5.0, 4.5)
    assert isinstance(browser.view.editor.begun, TrimmedRoad)
    browser.click_floor(5.0, 5.5)
    assert [point[1] for point in model.graph.roads[other_id].points_m] == pytest.approx([4.5, 5.5], abs=0.05)

    browser.set_widget("Parts", "Join")
    browser.click_road(road_id, 5.0, 2.0)
    assert road_id not in model.graph.roads
    assert model.graph.roads[other_id].points_m[-1] == pytest.approx((5.0, 0.0), abs=0.05)
    browser.set_widget("Line", "Smooth")
    browser.key("delete")
    assert model.graph.roads.keys() == {"r1", "r2"}
    validate(model.graph)


def test_a_road_with_places_on_it_is_not_deleted_and_the_sentence_says_why(
    browser: FakeBrowser, model: SiteModel
) -> None:
    browser.click_road("r2", 10.0, 3.0)
    browser.key("delete")
    assert "r2" in model.graph.roads
    assert any("Lift" in notice for notice in browser.notices)


def test_roads_are_sent_again_only_when_they_change(browser: FakeBrowser, model: SiteModel) -> None:
    meshes = [band.mesh for band in browser.view.roads._bands.values()]
    browser.click_poi("bar")
    model.apply(AddPoi("Chair", "other", 3.0, 0.0), browser.person.user_name)
    browser.tick()
    assert [band.mesh for band in browser.view.roads._bands.values()] == meshes


# -------------------------------------------------------------------------------------------------------- places
def test_a_place_is_put_off_the_road_by_shift_click_and_has_another_form(
    browser: FakeBrowser, model: SiteModel
) -> None:
    browser.key("tag")
    browser.click_floor(4.0, 3.0, "shift")
    assert browser.view.editor.begun == NewPlace(pytest.approx((4.0, 3.0), abs=0.01), on_road=False)
    browser.set_widget("Name", "Statue")
    browser.key("accept")
    (statue,) = [poi for poi in model.graph.pois.values() if poi.name == "Statue"]
    assert not statue.on_road
    assert "off the road" in browser.view.graph.tags[statue.id].label.text
    assert not np.array_equal(pin("ball", True).vertices_m, pin("ball", False).vertices_m)


def test_the_switch_puts_places_off_the_road_and_the_form_puts_them_back(
    browser: FakeBrowser, model: SiteModel
) -> None:
    browser.key("tag")
    browser.set_widget("Free position", True)
    browser.click_floor(4.0, 0.6)
    browser.set_widget("Name", "Bench")
    browser.set_widget("Spoken", "a bench")
    browser.set_widget("Notes", "wobbles")
    browser.set_widget("Add place (Enter)", True)
    (bench,) = [poi for poi in model.graph.pois.values() if poi.name == "Bench"]
    assert (bench.on_road, bench.spoken_name, bench.notes) == (False, "a bench", "wobbles")
    browser.key("select")
    browser.set_widget("Off the road", False)
    assert model.graph.pois[bench.id].on_road
    assert model.graph.pois[bench.id].y_m == pytest.approx(0.0, abs=0.01)


def test_a_free_place_is_dragged_anywhere(browser: FakeBrowser, model: SiteModel) -> None:
    model.apply(AddPoi("Statue", "other", 4.0, 3.0, on_road=False), browser.person.user_name)
    browser.tick()
    browser.drag_poi("statue", "start", 4.0, 3.0)
    browser.drag_poi("statue", "update", 6.0, 4.0)
    browser.drag_poi("statue", "end", 6.0, 4.0)
    statue = model.graph.pois["statue"]
    assert (statue.x_m, statue.y_m) == pytest.approx((6.0, 4.0), abs=0.01)


def test_two_places_become_one_and_its_edges_lead_to_the_other(browser: FakeBrowser, model: SiteModel) -> None:
    model.apply(AddPoi("Lobby", "hall", 2.0, 0.0), browser.person.user_name)
    browser.tick()
    browser.click_poi("hall")
    browser.set_widget("Merge into…", True)
    assert "becomes part of" in browser.view.editor.hint
    browser.click_poi("lobby")
    assert "hall" not in model.graph.pois
    (edge,) = model.graph.edges.values()
    assert {edge.a, edge.b} == {"lobby", "junction"}
    assert browser.view.editor.selected == ("poi", "lobby")


def test_a_place_on_an_edge_cuts_it_in_two(browser: FakeBrowser, model: SiteModel) -> None:
    browser.click_edge("e1")
    browser.set_widget("Edge", "Place on it")
    browser.click_floor(6.0, 0.3)
    browser.set_widget("Name", "Corner")
    browser.key("accept")
    (corner,) = [poi for poi in model.graph.pois.values() if poi.name == "Corner"]
    assert len(model.graph.edges) == 2
    assert all(corner.id in (edge.a, edge.b) for edge in model.graph.edges.values())
    browser.key("undo")
    assert len(model.graph.edges) == 1, "one edit, one undo"


def test_an_edge_has_a_width_a_cost_a_side_of_caution_and_is_turned_around(
    browser: FakeBrowser, model: SiteModel
) -> None:
    before = model.graph.edges["e1"]
    browser.click_edge("e1")
    browser.set_widget("Width m", 0.85)
    browser.set_widget("Caution", "left")
    browser.set_widget("Cost ×", 2.5)
    browser.set_widget("Edge", "Turn around")
    after = model.graph.edges["e1"]
    assert (after.width_m, after.cost_multiplier) == (0.85, 2.5)
    assert (after.a, after.b, after.caution_side) == (before.b, before.a, "right")
    words = browser.view.graph.length_labels["e1"].text
    assert "0.85 m wide" in words
    assert "caution" in words


def test_proposed_edges_are_shown_and_counted_and_escape_drops_them(browser: FakeBrowser, model: SiteModel) -> None:
    browser.key("propose")
    begun = browser.view.editor.begun
    assert isinstance(begun, NewEdges)
    assert len(begun.edges) == 2
    assert browser.view.preview._lines.visible
    browser.key("escape")
    assert len(model.graph.edges) == 1
    browser.key("propose")
    browser.set_widget("Accept (Enter)", True)
    assert len(model.graph.edges) == 3


# ---------------------------------------------------------------------------------------------------------- roles
def test_a_viewers_widgets_change_nothing_whatever_is_sent(
    scene_and_services: tuple[Scene, Services], model: SiteModel
) -> None:
    """Viser does not enforce that a widget is disabled: a browser can be made to send its value all the same."""
    before = model.graph
    viewer = FakeBrowser(scene_and_services[0], "viewer", "Vic", client_id=99)
    try:
        viewer.click_edge("e1")
        for label, value in (("Closed", True), ("One way", True), ("Width m", 2.0), ("Caution", "left")):
            viewer.set_widget(label, value)
        viewer.click_poi("bar")
        for label, value in (("Off the road", True), ("Kind", "Lounge")):
            viewer.set_widget(label, value)
        viewer.click_road("r1", 3.0, 0.0)
        assert viewer.view.editor.road is not None, "looking is free"
        assert model.graph is before
        labels = {command._impl.props.label for command in viewer.view.client.gui._command_handle_from_uuid.values()}
        assert labels == {each.words for each in SHORTCUTS if not each.is_editing}
    finally:
        viewer.disconnect()


# ---------------------------------------------------------------------------------------------------------- laws
def test_every_action_of_the_table_does_something_and_is_in_the_help(browser: FakeBrowser) -> None:
    labels = [command._impl.props.label for command in browser.view.client.gui._command_handle_from_uuid.values()]
    assert sorted(labels) == sorted(each.words for each in SHORTCUTS)
    keys = [(each.key, each.modifier) for each in SHORTCUTS if each.key is not None]
    assert len(keys) == len(set(keys)), "no key has two meanings"
    listed = {words for _, rows in help_groups(True) for _, words in rows}
    assert {each.together or each.words for each in SHORTCUTS if each.key is not None} <= listed


def test_the_help_opens_and_closes(browser: FakeBrowser) -> None:
    browser.key("help")
    assert browser.view._help is not None
    browser.key("help")
    assert browser.view._help is None


def test_an_empty_map_says_what_to_do(tmp_path: Path) -> None:
    with services_of_crossing(tmp_path) as services, scene_over(services) as scene:
        model = services.model
        browser = FakeBrowser(scene, "editor", "Ada")
        for poi_id in tuple(model.graph.pois):
            browser.click_poi(poi_id)
            browser.key("delete")
        assert "No places yet" in browser.view.editor.hint
        for road_id in tuple(model.graph.roads):
            browser.run(_select(browser, road_id))
            browser.key("delete")
        assert "There is no road yet" in browser.view.editor.hint
        browser.key("draw")
        browser.click_floor(1.0, 1.0)
        browser.click_floor(4.0, 1.0)
        browser.key("accept")
        assert [road.origin for road in model.graph.roads.values()] == ["drawn"]


async def _select(browser: FakeBrowser, road_id: str) -> None:
    browser.view.editor.select(("road", road_id))


def test_any_sequence_of_actions_keeps_the_draft_valid_and_the_scene_in_line_with_it(
    browser: FakeBrowser, model: SiteModel
) -> None:
    rng = np.random.default_rng(6)
    actions = [each.action for each in SHORTCUTS if each.action not in ("publish", "help")]
    for _ in range(250):
        if rng.random() < 0.4:
            x_m, y_m = ((rng.uniform(0, 20), rng.normal(0, 0.5)) if rng.random() < 0.7
                        else (rng.uniform(8, 12), rng.uniform(-8, 8)))  # fmt: skip
            browser.click_floor(float(x_m), float(y_m), "shift" if rng.random() < 0.1 else None)
        else:
            browser.key(str(rng.choice(actions)))
    browser.key("escape")
    browser.key("escape")
    browser.tick()
    validate(model.graph)
    assert browser.view.roads.drawn == model.graph.roads
    assert {key: tag.poi for key, tag in browser.view.graph.tags.items()} == model.graph.pois
