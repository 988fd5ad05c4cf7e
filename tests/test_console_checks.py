"""The checker at the console: who may begin it, of which version its result is, and what survives what."""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from console_room import Person, first_admin, invited, serving
from corridor_cloud import ROAD_M, box, corridor

from console.checks import CheckState, MapChecks
from console.edits import AddPoi, SetEdge, UpdatePoi
from console.errors import ConflictError
from console.floor_plans import FloorPlans
from console.graph_log import MemoryGraphLog
from console.map_geometry.floor_plan import FloorPlan, floor_plan
from console.model import SiteModel
from console.publishing import UnconfirmedError, publish
from console.server import ConsoleServer
from console.surveys import Surveys
from navcore.errors import MappingError
from navcore.map_check.evidence import Announced, RehearsedRoute
from navcore.planning.edits import add_poi, propose_edges
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_network import RoadNetwork
from navcore.rehearsal.every_leg import EveryLeg, all_routes_announced
from navcore.settings import Settings
from navcore.site import Site, map_checksum, save_site
from navcore.types import CameraIntrinsics

WAIT_S = 60.0


def corridor_site(*things: np.ndarray) -> Site:
    """Return a corridor with a hall and a bar at its ends, and things put into it."""
    cloud = np.vstack([corridor(), *things]).astype(np.float32)
    road = np.column_stack([ROAD_M, np.zeros(len(ROAD_M))])
    network, graph = RoadNetwork.from_roads([road]), PoiGraph()
    for name, kind, x_m in (("Hall", "hall", 0.6), ("Bar", "bar", 11.4)):
        graph = add_poi(graph, network, name=name, kind=kind, x_m=x_m, y_m=0.0)
    camera = CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0)
    colours = np.full(cloud.shape, 128, np.uint8)
    return Site("corridor", "Corridor", camera, {}, (road,), cloud, colours, propose_edges(graph, network))


POLE = box((6.0, 0.0, 0.0), (6.1, 0.1, 1.5))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A site with a pole on the road, in a folder."""
    folder = tmp_path_factory.mktemp("checks")
    save_site(corridor_site(POLE), folder / "site")
    return folder


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[ConsoleServer]:
    with serving(folder / "site", folder / "data") as running:
        yield running


@pytest.fixture(scope="module")
def ada(served: ConsoleServer) -> Person:
    return first_admin(served)


class Stage:
    """A model with its checks, outside any server."""

    def __init__(self, folder: Path, site: Site | None = None, **options: Any) -> None:
        save_site(site or corridor_site(), folder / "site")
        self.folder = folder
        self.model = SiteModel(site or corridor_site(), MemoryGraphLog())
        self.surveys = Surveys(folder / "site", map_checksum(folder / "site"), folder / "surveys")
        self.checks = MapChecks(self.model, self.surveys, **options)

    def checked(self) -> CheckState:
        """Check the draft, and wait for the end."""
        self.checks.start()
        state = self.checks.wait(WAIT_S)
        assert state.stage != "running"
        return state

    def close(self) -> None:
        self.surveys.close()
        self.checks.close()


@pytest.fixture
def unmeasured(tmp_path: Path) -> Iterator[Callable[..., Stage]]:
    """Stages whose map nobody has measured."""
    made: list[Stage] = []

    def make(site: Site | None = None, **options: Any) -> Stage:
        made.append(Stage(tmp_path, site, **options))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of surveys in which the corridor's lies: it is measured once for those whose matter that is not."""
    once = Stage(tmp_path_factory.mktemp("measured"))
    once.surveys.survey(WAIT_S)
    once.close()
    return once.folder / "surveys"


@pytest.fixture
def stage(tmp_path: Path, measured: Path, unmeasured: Callable[..., Stage]) -> Callable[..., Stage]:
    """Stages of the corridor, measured."""
    shutil.copytree(measured, tmp_path / "surveys")
    return unmeasured


# -------------------------------------------------------------------------------------------------- over HTTP
def test_an_editor_checks_the_draft_and_everybody_sees_what_was_found(served: ConsoleServer, ada: Person) -> None:
    editor, viewer = invited(ada, "Bea", "editor"), invited(ada, "Vic", "viewer")
    assert viewer.http.post("/api/check").status_code == 403
    before = viewer.http.get("/api/check").raise_for_status().json()
    assert before["stage"] == "none"
    assert "not been checked" in before["sentence"]
    begun = editor.http.post("/api/check").raise_for_status().json()
    assert begun["stage"] in ("running", "done")
    assert served.services.checks.wait(WAIT_S).stage == "done"
    found = viewer.http.get("/api/check").raise_for_status().json()
    (pole,) = found["findings"]
    assert (pole["code"], pole["severity"]) == ("edge_through_obstacle", "error")
    assert (pole["x_m"], pole["y_m"]) == (pytest.approx(6.05, abs=0.15), pytest.approx(0.0, abs=0.1))
    assert (found["version"], found["is_stale"]) == (found["draft_version"], False)
    assert found["sentence"].startswith("Found 1 error. Checked for a person 0.7 m wide,")


def when_measured(person: Person, path: str, **options: Any) -> Any:
    """Return an answer as the page gets it: it asks again while the map is being measured."""
    deadline_s = time.monotonic() + WAIT_S
    while (answer := person.http.get(path, **options)).status_code == 409 and time.monotonic() < deadline_s:
        time.sleep(0.05)
    return answer.raise_for_status()


def test_the_floor_plan_is_for_all_who_are_signed_in(served: ConsoleServer, ada: Person) -> None:
    assert Person(ada.url).http.get("/api/floor-plan.png").status_code == 401
    assert ada.http.get("/api/floor-plan.png", params={"theme": "pink"}).status_code == 400
    pictures = []
    for theme in ("light", "dark"):
        answer = when_measured(ada, "/api/floor-plan.png", params={"theme": theme})
        assert answer.headers["content-type"] == "image/png"
        picture = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)
        width_m = picture.shape[1] * float(answer.headers["x-metres-per-pixel"])
        assert 12.0 < width_m < 16.0
        assert float(answer.headers["x-left-metres"]) < 0.0
        pictures.append(picture)
    assert pictures[0].mean() > pictures[1].mean()
    drawing = when_measured(ada, "/api/floor-plan.svg")
    assert drawing.headers["content-type"].startswith("image/svg+xml")
    assert ">Hall</text>" in drawing.text


# --------------------------------------------------------------------------------------------------- versions
def test_the_widest_person_whom_a_device_leads_must_find_room(stage: Callable[..., Stage]) -> None:
    widths_m = [0.6]
    here = stage(device_settings=lambda: [{"obstacle.person_width_m": width_m} for width_m in widths_m])
    (edge_id,) = here.model.graph.edges
    here.model.apply(SetEdge(edge_id, width_m=0.8), "Ada")
    usual = here.checked()
    assert "narrow_passage" not in {each.code for each in usual.findings}
    assert "0.7 m wide" in usual.sentence, "never narrower than the usual"
    widths_m.append(0.9)
    wider = here.checked()
    assert "narrow_passage" in {each.code for each in wider.findings}
    assert "0.9 m wide" in wider.sentence


def test_a_result_is_of_its_version_alone(stage: Callable[..., Stage]) -> None:
    here = stage()
    assert here.checked().sentence.startswith("Nothing was found that is wrong.")
    version = here.model.graph.version
    assert here.checks.unconfirmed_errors(version) == ()
    here.model.apply(AddPoi("Lounge", "lounge", 3.0, 0.0), "Ada")
    state = here.checks.state()
    assert (state.version, state.draft_version, state.is_stale) == (version, version + 1, True)
    assert state.sentence == f"This is of version {version}; the draft is version {version + 1} now: check again."
    assert [finding.code for finding in here.checks.unconfirmed_errors(version + 1)] == ["not_checked"]
    assert [finding.code for finding in here.checked().findings] == ["unreachable_poi"]
    assert [finding.code for finding in here.checks.unconfirmed_errors(version + 1)] == ["unreachable_poi"]


def test_nothing_that_was_never_checked_is_clear(stage: Callable[..., Stage]) -> None:
    (found,) = stage().checks.unconfirmed_errors(1)
    assert (found.code, found.severity) == ("not_checked", "error")


def test_warnings_need_no_confirmation(stage: Callable[..., Stage]) -> None:
    here = stage()
    here.model.apply(UpdatePoi("bar", name="WC"), "Ada")
    assert [finding.severity for finding in here.checked().findings] == ["warning"]
    assert here.checks.unconfirmed_errors(here.model.graph.version) == ()


def test_an_edit_while_the_check_runs_makes_its_result_stale(stage: Callable[..., Stage]) -> None:
    begun, edited = threading.Event(), threading.Event()

    def rehearse(graph: PoiGraph, settings: Settings) -> EveryLeg:
        begun.set()
        assert edited.wait(WAIT_S)
        return EveryLeg((), (), ())

    here = stage(rehearse=rehearse)
    version = here.model.graph.version
    here.checks.start()
    assert begun.wait(WAIT_S)
    running = here.checks.start()  # a second one is the same one
    assert (running.stage, running.version) == ("running", None)
    assert 80 <= running.percent <= 100
    here.model.apply(AddPoi("Lounge", "lounge", 3.0, 0.0), "Ada")
    edited.set()
    state = here.checks.wait(WAIT_S)
    assert (state.version, state.is_stale, state.findings) == (version, True, ())


def test_what_was_said_in_rehearsals_is_checked(stage: Callable[..., Stage]) -> None:
    said = Announced("poi_ahead", "bar", 2.0, 9.0, 2.0, 0.0)
    route = RehearsedRoute("hall", "bar", 10.8, 11.4, 0.0, (said,))
    here = stage(rehearse=lambda graph, settings: EveryLeg((route,), ("e1",), ("Nobody arrives at Bar.",)))
    found = here.checked().findings
    assert [finding.code for finding in found] == ["rehearsal_failed", "announcement_distance", "not_rehearsed"]


def test_the_draft_is_rehearsed_as_it_is_checked(stage: Callable[..., Stage]) -> None:
    here = stage()
    assert "not_rehearsed" not in [finding.code for finding in here.checked().findings]
    here.model.apply(SetEdge("e1", one_way=True, cost_multiplier=100.0), "Ada")
    codes = [finding.code for finding in here.checked().findings]
    assert "unreachable_poi" in codes


def test_errors_are_published_only_by_whoever_has_seen_them(stage: Callable[..., Stage]) -> None:
    here = stage()
    here.model.apply(SetEdge("e1", closed=True), "Ada")
    with pytest.raises(UnconfirmedError, match="publish all the same") as refused:
        publish(here.model, here.checks, "Ada")
    assert here.model.published.version != here.model.graph.version
    assert {finding.severity for finding in refused.value.details()["findings"]} == {"error"}
    version = refused.value.details()["version"]
    seen = here.model.graph
    here.model.apply(AddPoi("Lounge", "lounge", 3.0, 0.0), "Bob")
    with pytest.raises(ConflictError, match="changed meanwhile"):
        publish(here.model, here.checks, "Ada", confirmed_version=version)
    here.model.undo("Bob")
    assert here.model.graph.edges == seen.edges
    version = here.model.graph.version
    assert publish(here.model, here.checks, "Ada", confirmed_version=version) is here.model.graph
    here.model.undo("Ada")
    assert publish(here.model, here.checks, "Ada").version == here.model.graph.version, "checked, and nothing is wrong"


def test_a_draft_that_is_changed_while_it_is_checked_is_not_published_unseen(stage: Callable[..., Stage]) -> None:
    def rehearse(graph: PoiGraph, settings: Settings) -> EveryLeg:
        here.model.apply(AddPoi("Lounge", "lounge", 3.0, 0.0), "Bob")
        return EveryLeg((), (), ())

    here = stage(rehearse=rehearse)
    here.model.apply(SetEdge("e1", width_m=2.0), "Ada")
    with pytest.raises(ConflictError, match="changed meanwhile"):
        publish(here.model, here.checks, "Ada")


# -------------------------------------------------------------------------------------------------- the survey
def test_a_survey_outlives_the_console_and_is_not_made_again(unmeasured: Callable[..., Stage]) -> None:
    first = unmeasured(corridor_site(POLE))
    found = first.checked().findings
    (kept,) = (first.folder / "surveys").iterdir()
    made_ns = kept.stat().st_mtime_ns
    first.close()
    second = unmeasured(corridor_site(POLE))
    assert second.checked().findings == found
    assert kept.stat().st_mtime_ns == made_ns


def test_a_survey_that_was_damaged_is_made_again(unmeasured: Callable[..., Stage]) -> None:
    here = unmeasured()
    (here.folder / "surveys").mkdir()
    here.surveys._file.write_bytes(b"PK\x03\x04 nothing of the kind")
    (here.folder / "surveys" / f".{here.surveys._file.name}.77").write_bytes(b"what a process that was killed has left")
    assert here.checked().stage == "done"
    assert [file.name for file in (here.folder / "surveys").iterdir()] == [here.surveys._file.name]
    assert here.surveys._file.stat().st_size > 1000


def test_another_map_in_the_folder_is_not_measured_for_this_one(unmeasured: Callable[..., Stage]) -> None:
    here = unmeasured()
    save_site(corridor_site(POLE), here.folder / "site")
    state = here.checked()
    assert state.stage == "failed"
    assert "another map" in state.sentence
    assert [finding.code for finding in here.checks.unconfirmed_errors(here.model.graph.version)] == ["not_checked"]


def test_a_survey_that_was_killed_is_told_and_tried_again(unmeasured: Callable[..., Stage]) -> None:
    here = unmeasured()
    stopped = threading.Event()
    original = here.surveys._follow

    def kill(process: Any) -> None:
        if not stopped.is_set():
            os.kill(process.pid, signal.SIGKILL)
            stopped.set()
        original(process)

    here.surveys._follow = kill  # type: ignore[method-assign]  # the moment at which it is killed
    with pytest.raises(MappingError, match="-9"):
        here.surveys.survey(WAIT_S)
    assert here.surveys.survey(WAIT_S).occupancy.is_occupied.any()


def test_who_does_not_want_to_wait_hears_how_far_it_is(unmeasured: Callable[..., Stage]) -> None:
    here = unmeasured()
    with pytest.raises(ConflictError, match="being measured"):
        here.surveys.survey(timeout_s=0.0)
    assert here.surveys.survey(WAIT_S).walls_m.shape[1:] == (2, 2)


def test_the_plan_is_never_waited_for_and_drawn_once_for_a_version(
    unmeasured: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = unmeasured()
    plans = FloorPlans(here.model, here.surveys)
    with pytest.raises(ConflictError, match=r"\d %"):
        plans.picture("light")
    here.surveys.survey(WAIT_S)
    begun, may_end = threading.Event(), threading.Event()

    def slowly(*shown: Any) -> FloorPlan:
        begun.set()
        assert may_end.wait(WAIT_S)
        return floor_plan(*shown)

    monkeypatch.setattr("console.floor_plans.floor_plan", slowly)
    first = threading.Thread(target=plans.picture, args=("light",))
    first.start()
    assert begun.wait(WAIT_S)
    with pytest.raises(ConflictError, match="being drawn"):
        plans.picture("dark")
    may_end.set()
    first.join(WAIT_S)
    drawn = plans.picture("light")
    assert plans.picture("light") is drawn
    here.model.apply(AddPoi("Desk", "room", 3.0, 0.0), "Ada")
    assert plans.picture("light") is not drawn


def test_a_console_that_ends_gives_up_the_check(stage: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()

    def every_leg(graph: PoiGraph, settings: Settings, *, cancelled: Callable[[], bool]) -> EveryLeg:
        begun.set()
        deadline_s = time.monotonic() + WAIT_S
        while time.monotonic() < deadline_s:
            all_routes_announced(graph, settings, cancelled=cancelled)
        return EveryLeg((), (), ())

    monkeypatch.setattr("console.checks.all_routes_announced", every_leg)
    running = stage()
    running.checks.start()
    assert begun.wait(WAIT_S)
    running.close()
    assert running.checks.state().stage == "failed"
    with pytest.raises(ConflictError, match="ending"):
        running.checks.start()


def test_a_console_that_ends_ends_the_survey(unmeasured: Callable[..., Stage]) -> None:
    here = unmeasured()
    held: list[Any] = []
    begun = threading.Event()
    original = here.surveys._follow

    def hold(process: Any) -> None:
        os.kill(process.pid, signal.SIGSTOP)
        held.append(process)
        begun.set()
        original(process)

    here.surveys._follow = hold  # type: ignore[method-assign]  # a survey that would never end by itself
    here.checks.start()
    assert begun.wait(WAIT_S)
    here.close()
    assert held[0].returncode == -signal.SIGKILL
    assert here.checks.state().stage == "failed"
    with pytest.raises(ConflictError, match="ending"):
        here.checks.start()
