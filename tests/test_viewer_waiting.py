"""What takes long in one window: everybody else's scene goes on, and its own input waits its turn."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from hardware_stand_ins import eventually
from viewer_client import FakeBrowser
from viewer_fixtures import scene_over, services_of_crossing

from console.edits import ProposeEdges
from console.model import ModelChange
from console.services import Services
from console.store import DATABASE_FILE
from console.viewer.scene import Scene

WAIT_S = 20.0


@pytest.fixture
def scene_and_services(tmp_path: Path) -> Iterator[tuple[Scene, Services]]:
    with services_of_crossing(tmp_path) as services, scene_over(services) as scene:
        yield scene, services


@pytest.fixture
def ada(scene_and_services: tuple[Scene, Services]) -> FakeBrowser:
    return FakeBrowser(scene_and_services[0], "editor", "Ada", client_id=1)


@pytest.fixture
def ben(scene_and_services: tuple[Scene, Services]) -> FakeBrowser:
    return FakeBrowser(scene_and_services[0], "editor", "Ben", client_id=2)


class LongEdit:
    """An edit that takes until it is let go on: a listener of the model holds up whoever makes it."""

    def __init__(self, services: Services) -> None:
        self.is_going_on, self._go_on = threading.Event(), threading.Event()
        services.model.subscribe(self._hold)

    def _hold(self, change: ModelChange) -> None:
        self.is_going_on.set()
        self._go_on.wait(WAIT_S)

    def end(self) -> None:
        """Let it come to its end."""
        self._go_on.set()


def draw_road(browser: FakeBrowser) -> None:
    browser.key("draw")
    for x_m, y_m in ((5.0, 0.2), (5.0, 6.0)):
        browser.click_floor(x_m, y_m)


def test_others_scenes_go_on_while_an_edit_takes_long_and_its_own_window_says_so(
    ada: FakeBrowser, ben: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    services = scene_and_services[1]
    draw_road(ada)
    version = services.model.graph.version
    long = LongEdit(services)
    accepted = ada.begin_key("accept")
    try:
        assert long.is_going_on.wait(WAIT_S)
        ben.click_poi("bar")
        ben.look()
        assert ben.view.editor.selected == ("poi", "bar")
        panel = ada.view.map_panel
        eventually(lambda: "Working…" in panel._hint.content)
        ada.look()
        assert "Working…" in panel._hint.content, "its own picture goes on as well"

        # What is done in this window meanwhile is done afterwards, in order.
        undone, redone = ada.begin_key("undo"), ada.begin_key("redo")
        assert not accepted.done()
        assert not undone.done()
    finally:
        long.end()
    for done in (accepted, undone, redone):
        done.result(WAIT_S)
    assert services.model.graph.version == version + 3
    assert len(services.model.graph.roads) == 3, "made, undone, and then made again"
    assert "Working…" not in panel._hint.content


def test_a_window_that_is_closed_during_a_long_edit_leaves_no_one_behind(
    ada: FakeBrowser, ben: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    draw_road(ada)
    long = LongEdit(scene_and_services[1])
    accepted = ada.begin_key("accept")
    assert long.is_going_on.wait(WAIT_S)
    ada.disconnect()
    long.end()
    accepted.result(WAIT_S)
    assert [present.user_name for present in scene_and_services[1].presence.windows()] == ["Ben"]
    assert len(scene_and_services[1].model.graph.roads) == 3, "what was accepted is made"


# ---------------------------------------------------------------------------------------------------- publishing
def test_waiting_for_what_was_published_before_anything_was_is_no_error(ada: FakeBrowser) -> None:
    ada.run(ada.view.published())


def test_whatever_keeps_a_draft_from_being_published_is_told(
    ada: FakeBrowser, scene_and_services: tuple[Scene, Services], tmp_path: Path
) -> None:
    model = scene_and_services[1].model
    published = model.published
    model.apply(ProposeEdges(), "Ben")
    with closing(sqlite3.connect(tmp_path / "data" / DATABASE_FILE)) as damaged:
        damaged.execute("DROP TABLE publications")
    ada.key("publish")
    ada.run(ada.view.published())
    assert ada.notices
    assert not any("are given" in notice for notice in ada.notices)
    assert model.published is published
