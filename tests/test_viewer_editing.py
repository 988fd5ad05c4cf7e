"""The map editor in the scene: what a person does with mouse, keys and panel, and what becomes of the PoI-graph."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from viewer_client import FakeBrowser
from viewer_fixtures import scene_over, services_of_crossing

from console.edits import DeleteEdge, DeletePoi, ProposeEdges, UpdatePoi
from console.services import Services
from console.viewer.begun import Mode, NewEdges
from console.viewer.scene import Scene


@pytest.fixture(scope="module")
def scene_and_services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Scene, Services]]:
    folder: Path = tmp_path_factory.mktemp("editing")
    with services_of_crossing(folder) as services, scene_over(services) as scene:
        yield scene, services


@pytest.fixture
def scene(scene_and_services: tuple[Scene, Services]) -> Scene:
    return scene_and_services[0]


@pytest.fixture
def services(scene_and_services: tuple[Scene, Services]) -> Services:
    return scene_and_services[1]


@pytest.fixture
def browser(scene: Scene, services: Services, request: pytest.FixtureRequest) -> Iterator[FakeBrowser]:
    """An editor's window; what its test did to the graph is undone afterwards."""
    name = request.node.name
    before = services.model.graph
    browser = FakeBrowser(scene, "editor", name, client_id=1000 + len(name) + abs(hash(name)) % 100_000)
    yield browser
    browser.disconnect()
    while services.model.can_undo(name):
        services.model.undo(name)
    assert (services.model.graph.pois, services.model.graph.edges) == (before.pois, before.edges)


def test_a_click_near_the_road_in_tag_mode_makes_a_place_on_the_road(browser: FakeBrowser, services: Services) -> None:
    browser.press("Tag a place")
    browser.click_floor(5.02, 0.4)
    browser.set_widget("Name", "Room 3308")
    browser.set_widget("Kind", "Wash room")
    browser.set_widget("Add place (Enter)", True)
    (poi,) = [poi for poi in services.model.graph.pois.values() if poi.name == "Room 3308"]
    assert poi.kind == "toilet"
    assert (poi.x_m, poi.y_m) == pytest.approx((5.02, 0.0), abs=0.01)
    assert browser.view.editor.selected == ("poi", poi.id)
    assert f"/graph/poi/{poi.id}/head" in browser.node_names


def test_a_click_far_from_the_road_says_so_and_makes_nothing(browser: FakeBrowser, services: Services) -> None:
    version = services.model.graph.version
    browser.press("Tag a place")
    browser.click_floor(4.0, 3.0)
    assert browser.view.editor.begun is None
    assert any("3.0 m away" in notice for notice in browser.notices)
    assert services.model.graph.version == version


def test_a_dragged_place_slides_along_the_road_with_its_edge_and_is_one_undo(
    browser: FakeBrowser, services: Services
) -> None:
    version = services.model.graph.version
    browser.drag_poi("hall", "start", 1.0, 0.0)
    lengths = []
    for x_m in np.linspace(1.2, 4.0, 8):
        browser.drag_poi("hall", "update", float(x_m), 0.9)
        shown = browser.view.editor.graph
        assert shown.pois["hall"].y_m == pytest.approx(0.0, abs=0.01)
        (edge,) = shown.edges.values()
        assert browser.view.graph.length_labels[edge.id].text == f"{edge.length_m:.1f} m"
        assert browser.view.graph.tags["hall"].poi.x_m == pytest.approx(x_m, abs=0.05)
        lengths.append(edge.length_m)
    assert services.model.graph.version == version, "a drag is committed at its end alone"
    browser.drag_poi("hall", "end", 4.0, 0.9)
    assert services.model.graph.version == version + 1
    assert services.model.graph.pois["hall"].x_m == pytest.approx(4.0, abs=0.05)
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[-1] == pytest.approx(6.0, abs=0.05)
    browser.press("Undo")
    assert services.model.graph.pois["hall"].x_m == pytest.approx(1.0, abs=0.05)
    assert browser.view.graph.tags["hall"].poi.x_m == pytest.approx(1.0, abs=0.05)
    browser.press("Redo")
    assert services.model.graph.pois["hall"].x_m == pytest.approx(4.0, abs=0.05)


def test_a_place_that_somebody_deletes_during_a_drag_is_let_go(browser: FakeBrowser, services: Services) -> None:
    browser.drag_poi("lift", "start", 10.0, 7.0)
    browser.drag_poi("lift", "update", 10.0, 6.0)
    services.model.apply(DeletePoi("lift"), "somebody else")
    browser.drag_poi("lift", "update", 10.0, 5.0)
    browser.drag_poi("lift", "end", 10.0, 5.0)
    assert "lift" not in services.model.graph.pois
    assert browser.view.editor.moving_id is None
    services.model.undo("somebody else")


def test_two_clicks_show_the_piece_of_road_and_enter_accepts_it(browser: FakeBrowser, services: Services) -> None:
    browser.press("Connect two places")
    browser.click_poi("junction")
    browser.click_poi("bar")
    begun = browser.view.editor.begun
    assert isinstance(begun, NewEdges)
    assert begun.edges[0].length_m == pytest.approx(9.0, abs=0.1)
    assert "9.0 m" in browser.view.editor.hint
    assert len(services.model.graph.edges) == 1, "shown, and not yet accepted"
    browser.press("Accept what is shown")
    added = services.model.graph.edges.keys() - {"e1"}
    assert len(services.model.graph.edges) == 2
    assert browser.view.editor.selected == ("edge", *added)
    browser.press("Delete what is selected")
    assert len(services.model.graph.edges) == 1


def test_escape_lets_go_of_a_piece_of_road_that_is_only_shown(browser: FakeBrowser, services: Services) -> None:
    browser.press("Connect two places")
    browser.click_poi("junction")
    browser.click_poi("lift")
    browser.press("Let go of what was begun")
    assert not isinstance(browser.view.editor.begun, NewEdges)
    assert browser.view.editor.mode is Mode.CONNECT
    browser.press("Let go of what was begun")
    assert browser.view.editor.mode is Mode.SELECT
    assert len(services.model.graph.edges) == 1


def test_connecting_what_is_connected_is_refused_with_a_sentence(browser: FakeBrowser) -> None:
    browser.press("Connect two places")
    browser.click_poi("hall")
    browser.click_poi("junction")
    assert not isinstance(browser.view.editor.begun, NewEdges)
    assert any("joined already" in notice for notice in browser.notices)


def test_an_edge_is_picked_and_closed_and_made_one_way(browser: FakeBrowser, services: Services) -> None:
    (edge,) = services.model.graph.edges.values()
    browser.click_edge(edge.id)
    assert browser.view.editor.selected == ("edge", edge.id)
    browser.set_widget("Closed", True)
    browser.set_widget("One way", True)
    changed = services.model.graph.edges[edge.id]
    assert (changed.closed, changed.one_way) == (True, True)
    assert "closed" in browser.view.graph.length_labels[edge.id].text
    assert "/graph/arrows" in browser.node_names


def test_a_name_and_a_kind_are_changed_in_the_panel(browser: FakeBrowser, services: Services) -> None:
    browser.click_poi("bar")
    browser.set_widget("Name", "Coffee bar")
    browser.set_widget("Apply", True)
    browser.set_widget("Kind", "Lounge")
    assert services.model.graph.pois["bar"].name == "Coffee bar"
    assert services.model.graph.pois["bar"].kind == "lounge"
    assert browser.view.graph.tags["bar"].label.text == "Coffee bar"


def test_a_bad_name_is_refused_and_the_old_one_stays(browser: FakeBrowser, services: Services) -> None:
    browser.click_poi("bar")
    browser.set_widget("Name", "x" * 300)
    browser.set_widget("Apply", True)
    assert services.model.graph.pois["bar"].name == "Bar"
    assert browser.notices


def test_a_click_beside_everything_selects_nothing(browser: FakeBrowser) -> None:
    browser.click_poi("bar")
    assert browser.view.editor.selected == ("poi", "bar")
    browser.click_floor(3.0, 5.0)
    assert browser.view.editor.selected is None


def test_proposed_edges_join_all_neighbours(browser: FakeBrowser, services: Services) -> None:
    browser.press("Propose connections between neighbours")
    assert len(services.model.graph.edges) == 1, "proposed, and not yet accepted"
    assert "2 new connections" in browser.view.editor.hint
    browser.press("Accept what is shown")
    joined = {frozenset((edge.a, edge.b)) for edge in services.model.graph.edges.values()}
    expected = {frozenset(pair) for pair in (("hall", "junction"), ("junction", "bar"), ("junction", "lift"))}
    assert joined == expected
    browser.press("Undo")
    assert len(services.model.graph.edges) == 1


def test_an_edit_elsewhere_is_drawn_at_the_next_tick(browser: FakeBrowser, scene: Scene, services: Services) -> None:
    services.model.apply(UpdatePoi("lift", name="Lift A"), "somebody else")

    async def tick() -> None:
        scene.tick()

    browser.run(tick())
    assert browser.view.graph.tags["lift"].label.text == "Lift A"
    services.model.undo("somebody else")


def test_publishing_gives_the_draft_to_the_devices(browser: FakeBrowser, services: Services) -> None:
    services.model.apply(ProposeEdges(), browser.person.user_name)
    browser.press("Publish the map")
    browser.run(browser.view.published())
    assert services.model.published.version == services.model.graph.version
    assert any("given version" in notice for notice in browser.notices)


def test_a_draft_with_errors_is_not_published_from_the_scene(browser: FakeBrowser, services: Services) -> None:
    services.model.apply(DeleteEdge("e1"), browser.person.user_name)
    browser.press("Publish the map")
    browser.run(browser.view.published())
    assert services.model.published.version != services.model.graph.version
    assert any("See the page Checks" in notice for notice in browser.notices)


def test_a_viewer_has_no_editor_and_can_change_nothing(scene: Scene, services: Services) -> None:
    version = services.model.graph.version
    browser = FakeBrowser(scene, "viewer", "Vic", client_id=77)
    try:
        labels = {
            command._impl.props.label for command in browser.view.client.gui._command_handle_from_uuid.values()
        }  # fmt: skip
        assert "Delete what is selected" not in labels
        browser.drag_poi("hall", "start", 1.0, 0.0)
        browser.drag_poi("hall", "end", 5.0, 0.0)
        browser.click_poi("hall")
        assert browser.view.editor.selected == ("poi", "hall")
        browser.run(_call(browser.view.editor.delete_selected))
        browser.run(_call(browser.view.publish))
        assert services.model.graph.version == version
        assert any("ask an editor" in notice for notice in browser.notices)
    finally:
        browser.disconnect()


def test_one_window_cannot_reach_the_nodes_of_another(scene: Scene, browser: FakeBrowser) -> None:
    other = FakeBrowser(scene, "editor", "Mallory", client_id=78)
    try:
        other.click_node("/graph/poi/bar/head", (19.0, 0.0, 0.7), owner=browser.client_id)
        assert browser.view.editor.selected is None
        other.click_node("/graph/poi/bar/head", (19.0, 0.0, 0.7))
        assert (other.view.editor.selected, browser.view.editor.selected) == (("poi", "bar"), None)
    finally:
        other.disconnect()


async def _call(action: object) -> None:
    assert callable(action)
    action()
