"""The map editor by the keyboard alone: going from thing to thing, nudging, and clicking with the cross."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from viewer_client import FakeBrowser
from viewer_fixtures import scene_over, services_of_crossing
from viewer_site import crossing_roads

from console.edits import AddPoi
from console.model import SiteModel
from console.services import Services
from console.viewer.begun import Mode
from console.viewer.moving import NUDGES_REST_S, stepped
from console.viewer.scene import Scene
from navcore.planning.road_edits import network_of, recorded_roads
from navcore.planning.road_network import RoadNetwork

NETWORK = network_of(recorded_roads(crossing_roads()))


@pytest.fixture
def scene_and_services(tmp_path: Path) -> Iterator[tuple[Scene, Services]]:
    with services_of_crossing(tmp_path) as services, scene_over(services) as scene:
        yield scene, services


@pytest.fixture
def browser(scene_and_services: tuple[Scene, Services]) -> FakeBrowser:
    """A window whose camera looks along +y: an arrow to the right leads along +x."""
    return FakeBrowser(scene_and_services[0], "editor", "Ada")


@pytest.fixture
def model(scene_and_services: tuple[Scene, Services]) -> SiteModel:
    return scene_and_services[1].model


def rest(browser: FakeBrowser) -> None:
    """Let the nudges come to rest."""

    async def later() -> None:
        now_s = browser.scene._services.hub.now_s()
        browser.view.editor.rest(now_s + NUDGES_REST_S)
        browser.view.refresh()

    browser.run(later())


# -------------------------------------------------------------------------------------------------- steps on the road
@given(x_m=st.floats(0.6, 19.3), angle=st.floats(-math.pi, math.pi), step_m=st.sampled_from([0.1, 1.0, 3.0]))
@settings(max_examples=150, deadline=None)
def test_a_step_stays_on_the_road_and_is_as_long_as_asked_or_ends_where_the_road_does(
    x_m: float, angle: float, step_m: float
) -> None:
    towards = (math.cos(angle), math.sin(angle))
    x, y = stepped(NETWORK, (x_m, 0.0), towards, step_m)
    assert NETWORK.nearest(x, y).distance_m < 1e-6
    along_m = NETWORK.shortest_piece(NETWORK.nearest(x_m, 0.0), NETWORK.nearest(x, y)).length_m
    assert along_m <= step_m + 1e-6
    is_end = any(math.dist((x, y), end) < 1e-3 for end in ((0.5, 0.0), (19.5, 0.0), (10.0, -7.5), (10.0, 7.5)))
    ran_across = abs(towards[0]) < 0.06
    assert along_m == pytest.approx(step_m, abs=1e-6) or is_end or ran_across


def test_at_a_crossing_the_arrow_chooses_the_way() -> None:
    junction = min(
        (tuple(NETWORK.vertices_m[vertex]) for vertex in NETWORK.junctions()),
        key=lambda place: math.dist(place, (10.0, 0.0)),
    )
    for towards in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        x, y = stepped(NETWORK, junction, towards, 1.0)
        moved = np.array([x, y]) - junction
        assert float(moved @ towards) == pytest.approx(1.0, abs=0.06)


def test_a_step_follows_the_road_round_its_bends() -> None:
    bend = RoadNetwork.from_roads([np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]])])
    x, y = stepped(bend, (1.5, 0.0), (1.0, 0.0), 2.0)
    # The network cuts the corner a little.
    assert (x, y) == pytest.approx((2.0, 1.6), abs=0.2)


# ------------------------------------------------------------------------------------------------------------- nudging
def test_arrows_move_the_selected_place_along_the_road_and_are_one_undo(browser: FakeBrowser, model: SiteModel) -> None:
    version = model.graph.version
    browser.click_poi("hall")
    for action in ("right", "right", "right", "far_right"):
        browser.key(action)
    assert model.graph.version == version, "shown, and not yet an edit"
    assert browser.view.graph.tags["hall"].poi.x_m == pytest.approx(2.3, abs=0.01)
    rest(browser)
    assert model.graph.version == version + 1
    assert model.graph.pois["hall"].x_m == pytest.approx(2.3, abs=0.01)
    browser.key("undo")
    assert model.graph.pois["hall"].x_m == pytest.approx(1.0, abs=0.01)


def test_whatever_is_done_next_ends_the_nudges(browser: FakeBrowser, model: SiteModel) -> None:
    browser.click_poi("hall")
    browser.key("far_right")
    browser.key("next_place")
    assert model.graph.pois["hall"].x_m == pytest.approx(2.0, abs=0.01)
    browser.click_poi("hall")
    browser.key("far_right")
    browser.key("escape")
    assert model.graph.pois["hall"].x_m == pytest.approx(2.0, abs=0.01), "Escape takes them back"


def test_a_free_place_is_nudged_anywhere(browser: FakeBrowser, model: SiteModel) -> None:
    model.apply(AddPoi("Statue", "other", 4.0, 3.0, on_road=False), "Ada")
    browser.tick()
    browser.click_poi("statue")
    browser.key("far_up")
    browser.key("right")
    rest(browser)
    statue = model.graph.pois["statue"]
    assert (statue.x_m, statue.y_m) == pytest.approx((4.1, 4.0), abs=0.01)


# ------------------------------------------------------------------------------------------ every verb without a mouse
def test_keys_go_through_places_connections_and_roads_and_round(browser: FakeBrowser, model: SiteModel) -> None:
    seen = []
    for _ in range(5):
        browser.key("next_place")
        seen.append(browser.view.editor.poi.name)  # type: ignore[union-attr]
    assert seen == ["Bar", "Hall", "Junction", "Lift", "Bar"]
    browser.key("previous_place")
    assert browser.view.editor.poi.name == "Lift"  # type: ignore[union-attr]
    browser.key("next_connection")
    assert browser.view.editor.selected == ("edge", "e1")
    browser.key("next_road")
    browser.key("next_road")
    assert browser.view.editor.selected == ("road", "r2")


def test_a_place_is_tagged_with_the_cross(browser: FakeBrowser, model: SiteModel) -> None:
    browser.key("next_place")
    browser.key("next_place")
    browser.key("tag")
    browser.key("pick")
    assert browser.view.keyboard.cursor_m == pytest.approx((1.0, 0.0), abs=0.05), "the cross begins at what is selected"
    for _ in range(3):
        browser.key("far_right")
    assert browser.view.preview._cursor.visible
    browser.key("pick")
    browser.set_widget("Name", "Desk")
    browser.key("accept")
    (desk,) = [poi for poi in model.graph.pois.values() if poi.name == "Desk"]
    assert desk.x_m == pytest.approx(4.0, abs=0.05)


def test_two_places_are_connected_with_keys_alone(browser: FakeBrowser, model: SiteModel) -> None:
    browser.key("connect")
    browser.key("next_place")
    browser.key("pick")
    browser.key("next_place")
    browser.key("next_place")
    browser.key("pick")
    browser.key("accept")
    assert {frozenset((edge.a, edge.b)) for edge in model.graph.edges.values()} >= {frozenset(("bar", "junction"))}


def test_a_road_is_drawn_and_trimmed_with_keys_alone(browser: FakeBrowser, model: SiteModel) -> None:
    browser.key("draw")
    browser.key("next_place")
    browser.key("pick")
    for _ in range(4):
        browser.key("far_up")
    browser.key("pick")
    browser.key("accept")
    (road,) = [road for road in model.graph.roads.values() if road.origin == "drawn"]
    assert road.points_m[-1] == pytest.approx((19.0, 4.0), abs=0.05)
    browser.key("select")
    browser.view.editor.select(("road", road.id))
    browser.tick()
    browser.run(_refreshed(browser))
    browser.set_widget("Line", "Trim")
    browser.key("pick")
    browser.key("pick")
    assert browser.view.editor.begun is not None, "half a road is not trimmed to nothing"
    browser.key("far_up")
    browser.key("pick")
    assert browser.view.editor.mode is Mode.SELECT


async def _refreshed(browser: FakeBrowser) -> None:
    browser.view.refresh()


def test_two_places_are_merged_with_keys_alone(browser: FakeBrowser, model: SiteModel) -> None:
    model.apply(AddPoi("Aisle", "hall", 2.0, 0.0), "Ada")
    browser.tick()
    browser.key("next_place")
    browser.set_widget("Merge into…", True)
    browser.key("next_place")
    browser.key("next_place")
    browser.key("pick")
    assert "aisle" not in model.graph.pois
