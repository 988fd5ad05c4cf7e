"""Two people at one map: conflicts in the scene, what is typed meanwhile, who is where, what a lost window leaves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from viewer_client import FakeBrowser
from viewer_fixtures import scene_over, services_of_crossing

from console.edits import AddPoi, DeletePoi, DrawRoad, MovePoi, SetEdge, SmoothRoad, UpdatePoi
from console.model import SiteModel
from console.services import Services
from console.view_requests import FlyToPoint
from console.viewer.scene import Scene


@pytest.fixture
def scene_and_services(tmp_path: Path) -> Iterator[tuple[Scene, Services]]:
    with services_of_crossing(tmp_path) as services, scene_over(services) as scene:
        yield scene, services


@pytest.fixture
def model(scene_and_services: tuple[Scene, Services]) -> SiteModel:
    return scene_and_services[1].model


@pytest.fixture
def ada(scene_and_services: tuple[Scene, Services]) -> FakeBrowser:
    return FakeBrowser(scene_and_services[0], "editor", "Ada", client_id=1)


@pytest.fixture
def ben(scene_and_services: tuple[Scene, Services]) -> FakeBrowser:
    return FakeBrowser(scene_and_services[0], "editor", "Ben", client_id=2)


def drag_bar(browser: FakeBrowser, *phases: str) -> None:
    for phase in phases:
        browser.drag_poi("bar", phase, 16.0, 0.3)


# ----------------------------------------------------------------------------------------------------- conflicts
def test_a_drop_on_a_place_that_somebody_has_moved_shows_both_versions_and_keeps_theirs(
    ada: FakeBrowser, ben: FakeBrowser, model: SiteModel
) -> None:
    drag_bar(ada, "start", "update")
    ben.drag_poi("bar", "start", 18.0, 0.0)
    ben.drag_poi("bar", "end", 18.0, 0.0)
    drag_bar(ada, "end")
    assert model.graph.pois["bar"].x_m == pytest.approx(18.0, abs=0.05), "nothing of Ben's is lost"
    conflict = ada.view.editor.conflict
    assert conflict is not None
    assert ("x m", "18.00", "16.00") in conflict.rows
    assert conflict.by == "Ben"
    ada.set_widget("Keep theirs", True)
    assert ada.view.editor.conflict is None
    assert model.graph.pois["bar"].x_m == pytest.approx(18.0, abs=0.05)


def test_mine_can_be_used_and_theirs_is_one_undo_away(ada: FakeBrowser, model: SiteModel) -> None:
    drag_bar(ada, "start", "update")
    model.apply(MovePoi("bar", 18.0, 0.0), "Ben")
    drag_bar(ada, "end")
    ada.set_widget("Use mine", True)
    assert model.graph.pois["bar"].x_m == pytest.approx(16.0, abs=0.05)
    ada.key("undo")
    assert model.graph.pois["bar"].x_m == pytest.approx(18.0, abs=0.05)


def test_what_changes_once_more_while_one_chooses_is_shown_again(ada: FakeBrowser, model: SiteModel) -> None:
    drag_bar(ada, "start", "update")
    model.apply(MovePoi("bar", 18.0, 0.0), "Ben")
    drag_bar(ada, "end")
    model.apply(MovePoi("bar", 17.0, 0.0), "Cleo")
    ada.set_widget("Use mine", True)
    conflict = ada.view.editor.conflict
    assert conflict is not None
    assert conflict.by == "Cleo"
    assert model.graph.pois["bar"].x_m == pytest.approx(17.0, abs=0.05)


def test_a_place_that_is_deleted_while_it_is_dragged_ends_the_drag_with_a_sentence(
    ada: FakeBrowser, model: SiteModel
) -> None:
    drag_bar(ada, "start", "update")
    model.apply(DeletePoi("bar"), "Ben")
    ada.tick()
    assert ada.view.editor.moving is None
    assert any("Ben has deleted Bar" in notice for notice in ada.notices)
    drag_bar(ada, "update", "end")
    assert "bar" not in model.graph.pois


def test_a_place_that_one_deletes_in_another_window_ends_the_drag_and_the_sentence_names_oneself(
    ada: FakeBrowser, model: SiteModel
) -> None:
    drag_bar(ada, "start", "update")
    model.apply(DeletePoi("bar"), "Ada")
    version = model.graph.version
    ada.tick()
    assert any("Ada has deleted Bar" in notice for notice in ada.notices)
    assert model.graph.version == version


def test_what_others_change_elsewhere_is_seen_during_a_drag(ada: FakeBrowser, model: SiteModel) -> None:
    drag_bar(ada, "start", "update")
    model.apply(UpdatePoi("lift", name="Lift A"), "Ben")
    ada.tick()
    assert ada.view.graph.tags["lift"].label.text == "Lift A"
    assert ada.view.graph.tags["bar"].poi.x_m == pytest.approx(16.0, abs=0.05), "the drag goes on"
    drag_bar(ada, "end")
    assert model.graph.pois["bar"].x_m == pytest.approx(16.0, abs=0.05)
    assert ada.view.editor.conflict is None


def test_a_window_that_is_lost_in_the_middle_of_a_drag_leaves_the_draft_as_it_was(
    ada: FakeBrowser, model: SiteModel
) -> None:
    before = model.graph
    drag_bar(ada, "start", "update")
    ada.disconnect()
    assert model.graph is before


def test_what_is_being_typed_stays_and_is_held_against_the_version_it_was_typed_over(
    ada: FakeBrowser, model: SiteModel
) -> None:
    ada.click_poi("bar")
    ada.set_widget("Name", "Coffee bar")
    model.apply(UpdatePoi("bar", name="Tea bar"), "Ben")
    ada.tick()
    assert ada.view.map_panel._place._name.value == "Coffee bar"
    ada.set_widget("Apply", True)
    assert model.graph.pois["bar"].name == "Tea bar"
    conflict = ada.view.editor.conflict
    assert conflict is not None
    assert ("name", "Tea bar", "Coffee bar") in conflict.rows
    ada.set_widget("Keep theirs", True)
    assert ada.view.map_panel._place._name.value == "Tea bar"


def test_a_form_in_which_nothing_is_typed_shows_what_others_change(ada: FakeBrowser, model: SiteModel) -> None:
    ada.click_poi("bar")
    model.apply(UpdatePoi("bar", name="Tea bar"), "Ben")
    ada.tick()
    assert ada.view.map_panel._place._name.value == "Tea bar"
    ada.set_widget("Name", "Wine bar")
    ada.set_widget("Apply", True)
    assert model.graph.pois["bar"].name == "Wine bar"


def test_a_connection_that_is_closed_by_both_is_no_conflict_of_the_forms(ada: FakeBrowser, model: SiteModel) -> None:
    ada.click_edge("e1")
    model.apply(SetEdge("e1", one_way=True), "Ben")
    ada.tick()
    ada.set_widget("Closed", True)
    assert (model.graph.edges["e1"].one_way, model.graph.edges["e1"].closed) == (True, True)


def test_interleaved_editing_loses_nothing_silently(ada: FakeBrowser, ben: FakeBrowser, model: SiteModel) -> None:
    """Both drag the same places again and again: each drop is made, or its window holds the conflict."""
    for number in range(12):
        for browser, x_m in ((ada, 2.0 + number / 4), (ben, 5.0 + number / 4)):
            browser.drag_poi("hall", "start", 1.0, 0.0)
            browser.drag_poi("hall", "update", x_m, 0.0)
        for browser, x_m in ((ben, 5.0 + number / 4), (ada, 2.0 + number / 4)):
            browser.drag_poi("hall", "end", x_m, 0.0)
            is_made = model.graph.pois["hall"].x_m == pytest.approx(x_m, abs=0.02)
            assert is_made or browser.view.editor.conflict is not None
        ada.view.editor.conflict = ben.view.editor.conflict = None


def test_what_somebody_has_changed_since_it_was_selected_is_deleted_only_by_choice(
    ada: FakeBrowser, model: SiteModel
) -> None:
    for answer, is_there in (("Keep theirs", True), ("Use mine", False)):
        ada.click_poi("bar")
        model.apply(UpdatePoi("bar", name=f"Tea bar, {answer}"), "Ben")
        ada.tick()
        ada.key("delete")
        assert "bar" in model.graph.pois, "what Ben has made of it is not deleted unseen"
        assert ada.view.editor.conflict is not None
        assert ada.view.editor.conflict.rows == (("", "changed by Ben", "deleted"),)
        ada.set_widget(answer, True)
        assert ("bar" in model.graph.pois) is is_there
    model.undo("Ada")
    ada.tick()
    ada.click_poi("bar")
    model.apply(UpdatePoi("bar", name="Wine bar"), "Ben")
    ada.key("delete")
    ada.set_widget("Keep theirs", True)
    ada.key("delete")
    assert "bar" not in model.graph.pois, "what was kept has been seen"


def test_what_somebody_has_changed_since_it_was_selected_is_merged_only_by_choice(
    ada: FakeBrowser, model: SiteModel
) -> None:
    ada.click_poi("bar")
    ada.set_widget("Merge into…", True)
    model.apply(UpdatePoi("bar", name="Tea bar"), "Ben")
    ada.click_poi("lift")
    assert "bar" in model.graph.pois
    ada.set_widget("Use mine", True)
    assert "bar" not in model.graph.pois
    assert ada.view.editor.begun is None


@pytest.mark.parametrize("verb", ["Split here", "Trim", "Join"])
def test_a_road_that_somebody_has_changed_since_it_was_selected_is_worked_on_only_by_choice(
    ada: FakeBrowser, model: SiteModel, verb: str
) -> None:
    model.apply(DrawRoad(((5.0, 0.0), (5.0, 2.0), (5.3, 3.0), (5.0, 4.0), (5.0, 6.0))), "Ada")
    model.apply(DrawRoad(((5.0, 6.3), (5.0, 8.0))), "Ada")
    ada.tick()
    ada.click_road("r3", 5.0, 1.0)
    ada.set_widget("Line" if verb == "Trim" else "Parts", verb)
    model.apply(SmoothRoad("r3"), "Ben")
    smooth = model.graph.roads
    match verb:
        case "Split here":
            ada.click_floor(5.0, 3.0)
        case "Trim":
            ada.click_floor(5.0, 1.0)
            ada.click_floor(5.0, 5.0)
        case "Join":
            ada.click_road("r4", 5.0, 7.0)
    assert model.graph.roads == smooth
    assert ada.view.editor.conflict is not None
    ada.set_widget("Use mine", True)
    assert model.graph.roads != smooth
    assert ada.view.editor.begun is None


def test_a_connection_that_somebody_has_changed_since_it_was_selected_is_cut_only_by_choice(
    ada: FakeBrowser, model: SiteModel
) -> None:
    ada.click_edge("e1")
    ada.set_widget("Edge", "Place on it")
    ada.click_floor(6.0, 0.0)
    model.apply(SetEdge("e1", closed=True), "Ben")
    ada.key("accept")
    assert model.graph.edges.keys() == {"e1"}
    ada.set_widget("Use mine", True)
    assert [edge.closed for edge in model.graph.edges.values()] == [True, True]
    assert ada.view.editor.begun is None


# ---------------------------------------------------------------------------------------------- what has been shown
def test_a_proposal_that_has_become_another_meanwhile_is_shown_again_before_it_is_accepted(
    ada: FakeBrowser, model: SiteModel
) -> None:
    ada.key("propose")
    model.apply(AddPoi("Chair", "other", 14.0, 0.0), "Ben")
    ada.key("accept")
    assert model.graph.edges.keys() == {"e1"}, "nobody has seen these"
    assert any("accept it once more" in notice for notice in ada.notices)
    assert "3 new connections" in ada.view.editor.hint
    ada.key("accept")
    assert len(model.graph.edges) == 4


def test_a_connection_that_has_become_another_meanwhile_is_shown_again_before_it_is_accepted(
    ada: FakeBrowser, model: SiteModel
) -> None:
    ada.key("connect")
    ada.click_poi("junction")
    ada.click_poi("bar")
    model.apply(MovePoi("bar", 17.0, 0.0), "Ben")
    ada.tick()
    ada.key("accept")
    assert model.graph.edges.keys() == {"e1"}
    assert "7.0 m" in ada.view.editor.hint
    ada.key("accept")
    assert [edge.length_m for edge in model.graph.edges.values()][1:] == pytest.approx([7.0], abs=0.1)


def test_what_changes_elsewhere_keeps_nobody_from_accepting_what_is_shown(ada: FakeBrowser, model: SiteModel) -> None:
    ada.key("propose")
    model.apply(UpdatePoi("bar", name="Tea bar"), "Ben")
    ada.key("accept")
    assert len(model.graph.edges) == 3


# ------------------------------------------------------------------------------------------------------ presence
def test_others_selections_are_ringed_and_named_and_forgotten_when_they_go(ada: FakeBrowser, ben: FakeBrowser) -> None:
    ben.click_poi("bar")
    ada.tick()
    assert ada.view.people.shown == [("Ben", pytest.approx((19.0, 0.0), abs=0.05))]
    assert "Ben edits Bar" in ada.view.map_panel._people.content
    ben.drag_poi("lift", "start", 10.0, 7.0)
    ada.tick()
    assert "Ben moves Lift" in ada.view.map_panel._people.content
    ben.disconnect()
    ada.tick()
    assert ada.view.people.shown == []
    assert not ada.view.map_panel._people.visible


def test_ones_own_windows_are_not_shown_to_oneself(
    ada: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    again = FakeBrowser(scene_and_services[0], "editor", "Ada", client_id=3)
    again.click_poi("bar")
    ada.tick()
    assert ada.view.people.shown == []


def test_a_name_of_somebody_is_never_markup(ada: FakeBrowser, scene_and_services: tuple[Scene, Services]) -> None:
    FakeBrowser(scene_and_services[0], "editor", "<img src=x>", client_id=4).click_poi("bar")
    ada.tick()
    assert "<img" not in ada.view.map_panel._people.content


# ---------------------------------------------------------------------------------------------------- the page asks
def test_the_page_flies_the_scene_to_a_point_and_selects_what_is_meant(
    ada: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    views = scene_and_services[1].views
    assert views.ask(ada.person.session_id, FlyToPoint(4.0, 1.0, ("edge", "e1"))) == 1
    ada.tick()
    assert tuple(ada.view.client.camera.look_at)[:2] == pytest.approx((4.0, 1.0))
    assert ada.view.editor.selected == ("edge", "e1")
    views.ask(ada.person.session_id, FlyToPoint(2.0, 1.0, ("road", "gone")))
    ada.tick()
    assert ada.view.editor.selected is None, "what is gone is not selected"
