"""The walker in the scene: drawn as the device says, grey and dated when that is old; orders and settings by role."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import cv2
import msgspec
import numpy as np
import pytest
from viewer_client import FakeBrowser
from viewer_fixtures import RecordingOutlet, connect_device, scene_over, services_of_crossing

from console.live import LiveDevice
from console.roles import Role
from console.services import Services
from console.view_requests import EndPast, FlyToPoi, MoveCamera, ShowPast, ViewRequest
from console.viewer import appearance as look
from console.viewer.live_layer import trail_colours
from console.viewer.live_view import LiveView, Trail
from console.viewer.past_playback import SILENCE_S
from console.viewer.scan_points import UNKNOWN_AT_M, scan_points
from console.viewer.scene import Scene, decoded
from console.viewer.view_panel import CameraMode
from console.viewer.walker_panel import status
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.wire import (
    ApplySettings,
    ClearDestination,
    DepthImage,
    Hello,
    KeepSettings,
    Pause,
    Repeat,
    RouteChanged,
    SetDestination,
    SettingsRunning,
    WalkerState,
)
from navcore.wire_trace import WireCandidate


def state_at(stamp_s: float, x_m: float = 2.0, y_m: float = 0.5, heading_rad: float = 0.0) -> WalkerState:
    return WalkerState(
        stamp_s, "localized", "walk", "ok", pose=(x_m, y_m, 1.6, heading_rad), position_std_m=0.05,
        direction_rad=0.2, sub_goal=(5.0, 0.0), sub_goal_case=1, sonar_state="ok", sonar_m=1.5,
        candidates=(WireCandidate(-0.2, 3.0), WireCandidate(0.3, 2.0)), last_cue="Go straight.",
        last_cue_stamp_s=stamp_s - 1.0, mode=Mode.GUIDING, destination_id="bar",
    )  # fmt: skip


def view_of(device: LiveDevice, now_s: float) -> LiveView:
    return LiveView(device, now_s, None, np.array([[1.0, 0.0], [2.0, 0.5]]))


@pytest.fixture(scope="module")
def scene_and_services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Scene, Services]]:
    folder: Path = tmp_path_factory.mktemp("live")
    with services_of_crossing(folder) as services, scene_over(services) as scene:
        yield scene, services


@pytest.fixture(params=["viewer"])
def browser(scene_and_services: tuple[Scene, Services], request: pytest.FixtureRequest) -> Iterator[FakeBrowser]:
    browser = FakeBrowser(scene_and_services[0], request.param, "Ada", client_id=500)
    yield browser
    browser.disconnect()


@pytest.fixture
def device() -> LiveDevice:
    """A device that sent one state at second 100 of both clocks."""
    hello = Hello(1, "glasses", "0.1", "crossing", "x", 1, 0, 100.0)
    route = RouteChanged(100.0, tuple((x / 10, 0.0) for x in range(100)), (), "bar")
    return LiveDevice("glasses", "Glasses", hello, True, 100.0, 0.0, 0.001, None, state_at(100.0), 100.0, route)


def draw(browser: FakeBrowser, view: LiveView) -> None:
    async def show() -> None:
        browser.view.live.show(view)

    browser.run(show())


def node(browser: FakeBrowser, name: str):
    return browser.view.client.scene.get_handle_by_name(name)


def test_the_walker_stands_where_the_device_says_and_looks_where_it_heads(
    browser: FakeBrowser, device: LiveDevice
) -> None:
    turned = dataclasses.replace(device, state=state_at(100.0, 3.0, 1.0, math.pi / 2))
    draw(browser, view_of(turned, 100.1))
    assert tuple(node(browser, "/walker").position) == pytest.approx((3.0, 1.0, 0.0))
    assert tuple(node(browser, "/walker").wxyz) == pytest.approx((math.sqrt(0.5), 0, 0, math.sqrt(0.5)))
    assert tuple(node(browser, "/live/sub_goal").position)[:2] == pytest.approx((5.0, 0.0))
    assert tuple(node(browser, "/live/closest").position)[:2] == pytest.approx((3.0, 0.0))
    assert tuple(node(browser, "/live/position").position)[:2] == pytest.approx((3.0, 1.0))


def test_candidates_are_as_long_as_they_are_clear(browser: FakeBrowser, device: LiveDevice) -> None:
    draw(browser, view_of(device, 100.1))
    ends = node(browser, "/walker/fan").points[:, 1, :2]
    assert np.linalg.norm(ends, axis=1) == pytest.approx([3.0, 2.0], abs=1e-3)
    assert np.arctan2(ends[:, 1], ends[:, 0]) == pytest.approx([-0.2, 0.3], abs=1e-3)
    assert node(browser, "/walker/sonar").scale == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("age_s", "word", "details_shown"), [(0.2, "", True), (2.0, "DELAYED", True), (7.0, "STALE", False)]
)
def test_what_is_old_is_grey_and_dated_and_ever_less_certain(
    browser: FakeBrowser, device: LiveDevice, age_s: float, word: str, details_shown: bool
) -> None:
    fresh = view_of(device, 100.0)
    draw(browser, fresh)
    live_colour = node(browser, "/walker/figure/body").color
    old = view_of(device, 100.0 + age_s)
    draw(browser, old)
    text = node(browser, "/walker/cue").text
    assert text.startswith(word) if word else text == "“Go straight.”"
    assert (node(browser, "/walker/figure/body").color == live_colour) is (not word)
    assert node(browser, "/walker/fan").visible is details_shown
    assert node(browser, "/walker/sonar").visible is details_shown
    assert old.uncertainty_m >= fresh.uncertainty_m
    assert (old.uncertainty_m > 5.0) is (not details_shown)


JPEG = cv2.imencode(".jpg", np.full((12, 16), 90, np.uint8))[1].tobytes()
SCAN = SimpleNamespace(
    first_rad=-0.2, step_rad=0.1, states=(0, 1, 3, 2, 4), nearest_cm=(0, 150, 0, 200, 120), unseen=((90, 100),)
)


def test_nothing_that_was_seen_or_decided_is_drawn_once_it_is_stale(browser: FakeBrowser, device: LiveDevice) -> None:
    seen = dataclasses.replace(device, depth_image=DepthImage(100.0, JPEG))
    parts = ("/walker/fan", "/walker/sonar", "/walker/camera", "/walker/chosen", "/live/off", "/live/sub_goal")
    silhouette = decoded(JPEG)

    def drawn(now_s: float) -> tuple[set[str], bool, tuple[int, ...], set[tuple[int, ...]]]:
        draw(browser, dataclasses.replace(view_of(seen, now_s), silhouette_rgb=silhouette))
        route, trail = (np.asarray(node(browser, f"/live/{name}").colors) for name in ("route", "trail"))
        visible = {name for name in parts if node(browser, name).visible}
        has_silhouette = node(browser, "/walker/camera").image is not None
        return visible, has_silhouette, tuple(route.reshape(-1)), {tuple(c) for c in trail.reshape(-1, 3).tolist()}

    assert drawn(100.2) == (set(parts), True, look.ROUTE, {look.TRAIL})
    assert drawn(106.0) == (set(), False, look.WALKER_STALE, {look.WALKER_STALE})
    # The state goes on, and the depth image, which comes more rarely, does not.
    seen = dataclasses.replace(seen, state=state_at(107.0), state_arrival_s=107.0)
    visible, has_silhouette, _, _ = drawn(107.1)
    assert (visible, has_silhouette) == (set(parts), False)


def test_the_trail_is_the_stronger_the_farther_it_led_off_the_route(device: LiveDevice) -> None:
    trail = Trail()
    for x_m, off_m in ((0.0, 0.0), (0.5, 0.5), (1.0, 2.0), (1.5, None)):
        trail.add(msgspec.structs.replace(state_at(100.0, x_m, 0.0), deviation_m=off_m))
    colours = trail_colours(LiveView(device, 100.1, None, trail.points_m, trail.deviations_m))
    ends = [*colours[:, 0].tolist(), colours[-1, 1].tolist()]
    assert ends[0] == ends[3] == list(look.TRAIL), "on the route, and where there is no route"
    assert ends[2] == list(look.SONAR_NEAR)
    assert ends[1] not in (ends[0], ends[2])


def test_a_scan_shows_what_stands_there_and_what_is_unknown_and_leaves_out_only_what_is_free() -> None:
    points, colours = scan_points(SCAN)
    assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx([1.5, UNKNOWN_AT_M, 2.0, 1.2, 1.0])
    assert np.arctan2(points[:, 1], points[:, 0]) == pytest.approx([-0.1, 0.0, 0.1, 0.2, math.pi / 2])
    assert len({tuple(colour) for colour in colours.tolist()}) == 5, "each of them looks different"


def test_other_walkers_stand_there_with_their_names_and_dated_where_they_are_old(
    browser: FakeBrowser, device: LiveDevice
) -> None:
    other = dataclasses.replace(device, device_id="b", name="Glasses of Ben", state=state_at(100.0, 7.0, 1.0))
    for age_s, words in (
        (0.1, "Glasses of Ben"), (7.0, "Glasses of Ben, STALE, seen 7.0 s ago"),
        (60.0, "Glasses of Ben, LOST, seen 60 s ago"), (601.0, None),
    ):  # fmt: skip
        draw(browser, dataclasses.replace(view_of(device, 100.0 + age_s), others=(other,)))
        root = node(browser, "/others/0")
        assert root.visible is (words is not None)
        if words is not None:
            assert tuple(root.position) == pytest.approx((7.0, 1.0, 0.0))
            assert node(browser, "/others/0/name").text == words


def test_the_scene_tells_its_own_time_to_the_page_around_it(browser: FakeBrowser) -> None:
    for now_s in (100.3, 107.9):
        draw(browser, LiveView(None, now_s))
        assert 0.0 <= now_s - node(browser, "/live/beat").position[0] < 0.5 + 1e-9


def test_a_device_that_is_gone_is_never_shown_as_live(browser: FakeBrowser, device: LiveDevice) -> None:
    gone = view_of(dataclasses.replace(device, connected=False), 100.1)
    draw(browser, gone)
    assert node(browser, "/walker/cue").text.startswith("LOST")
    assert "LOST" in status(gone, PoiGraph(), is_there=True)


def test_a_lost_pose_shows_no_walker_at_all(browser: FakeBrowser, device: LiveDevice) -> None:
    draw(browser, view_of(device, 100.1))
    lost = dataclasses.replace(device, state=WalkerState(100.2, "lost", "stop", "pose_lost", mode=Mode.LOST))
    draw(browser, view_of(lost, 100.3))
    assert not node(browser, "/walker").visible
    assert not node(browser, "/live/position").visible
    assert "The place in the map is not known." in status(view_of(lost, 100.3), PoiGraph(), is_there=True)


def test_an_unchanged_view_sends_nothing(browser: FakeBrowser, device: LiveDevice) -> None:
    draw(browser, view_of(device, 100.1))
    before = len(browser.outbox)
    draw(browser, view_of(device, 100.1))
    assert len(browser.outbox) == before


def test_words_of_a_device_are_escaped_in_the_panel(device: LiveDevice) -> None:
    evil = dataclasses.replace(device, name="<img src=x onerror=1>", state=None)
    assert "<img" not in status(view_of(evil, 100.0), PoiGraph(), is_there=True)
    spoken = state_at(100.0)
    state = WalkerState(**{f: getattr(spoken, f) for f in spoken.__struct_fields__} | {"last_cue": "<script>"})
    assert "<script>" not in status(view_of(dataclasses.replace(device, state=state), 100.0), PoiGraph(), is_there=True)


def test_a_trail_grows_with_the_walk_and_starts_anew_after_a_jump() -> None:
    trail = Trail()
    for x in np.arange(0.0, 5.0, 0.1):
        trail.add(state_at(float(x), float(x), 0.0))
    steps = np.linalg.norm(np.diff(trail.points_m, axis=0), axis=1)
    assert steps.min() >= 0.25 - 1e-9
    trail.add(state_at(9.0, 15.0, 0.0))
    assert trail.points_m.tolist() == [[15.0, 0.0]]


@pytest.mark.parametrize("jpeg", [b"", b"nonsense", b"\xff\xd8\xff\xe0broken"])
def test_a_broken_silhouette_is_no_picture(jpeg: bytes) -> None:
    assert decoded(jpeg) is None


# -------------------------------------------------------------------------------------------------------- orders
def watch_tuned_device(browser: FakeBrowser, services: Services) -> RecordingOutlet:
    """Connect a device that tells its settings, and show it: its walker has been told who watches."""
    outlet = connect_device(services)
    services.hub.receive("glasses", SettingsRunning(1, Settings().values()))
    browser.tick()  # finds the device
    browser.tick()  # says that it shows it
    services.watching.look()
    outlet.sent.clear()
    browser.tick()
    return outlet


def wait_for_settled(browser: FakeBrowser, services: Services, device_id: str) -> None:
    """Let the panel find its sliders let go, by its own clock."""
    panel = browser.view.tuning_panel
    assert panel is not None
    panel._moved_s = -1e9
    browser.tick()


@pytest.mark.parametrize("browser", ["editor"], indirect=True)
def test_an_editor_guides_the_walker_from_the_panel_of_a_place(
    browser: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    outlet = connect_device(scene_and_services[1])
    browser.tick()
    browser.click_poi("bar")
    browser.set_widget("Guide the walker here", True)
    browser.set_widget("Guidance", "Pause")
    browser.set_widget("Guidance", "Stop")
    browser.set_widget("Guidance", "Repeat")
    first = outlet.sent[0]
    assert isinstance(first, SetDestination)
    assert (first.poi_id, first.who) == ("bar", "Ada")
    assert [type(message) for message in outlet.sent[1:]] == [Pause, ClearDestination, Repeat]


@pytest.mark.parametrize("browser", ["editor"], indirect=True)
def test_who_is_on_their_way_is_led_elsewhere_or_no_more_only_after_a_question(
    browser: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    services = scene_and_services[1]
    outlet = connect_device(services)
    led = WalkerState(0.1, "localized", "walk", "ok", mode=Mode.GUIDING, destination_id="lift", destination_by="Bea")
    services.hub.receive("glasses", led)
    browser.tick()
    browser.click_poi("bar")
    names = {key: poi.name for key, poi in services.model.published.pois.items()}
    for answer, sent in ((f"Keep {names['lift']}", 0), (f"Guide to {names['bar']}", 1)):
        browser.set_widget("Guide the walker here", True)
        assert len(outlet.sent) == 0, "it is asked first"
        browser.set_widget(answer, True)
        assert len([each for each in outlet.sent if isinstance(each, SetDestination)]) == sent
    browser.set_widget("Guidance", "Stop")
    browser.key("escape")
    assert not any(isinstance(each, ClearDestination) for each in outlet.sent)
    browser.set_widget("Guidance", "Stop")
    browser.set_widget("Stop guiding", True)
    assert isinstance(outlet.sent[-1], ClearDestination)
    services.hub.receive("glasses", msgspec.structs.replace(led, destination_id="bar"))
    browser.set_widget("Guide the walker here", True)
    assert len([each for each in outlet.sent if isinstance(each, SetDestination)]) == 2, "they are on the way there"


@pytest.mark.parametrize("browser", ["viewer", "technician"], indirect=True)
def test_who_may_only_watch_cannot_guide(browser: FakeBrowser, scene_and_services: tuple[Scene, Services]) -> None:
    outlet = connect_device(scene_and_services[1])
    browser.tick()

    async def try_anyway() -> None:
        browser.view.walker_panel.guide_to("bar")

    browser.run(try_anyway())
    assert outlet.sent == []
    assert any("ask an editor" in notice for notice in browser.notices)


@pytest.mark.parametrize("browser", ["technician"], indirect=True)
def test_a_slider_is_sent_when_it_is_let_go_and_shows_what_became_of_it(
    browser: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    services = scene_and_services[1]
    outlet = watch_tuned_device(browser, services)
    for value in (3.2, 3.6, 4.0):
        browser.set_widget("Sub goal distance, m", value)
    assert outlet.sent == [], "not before it is let go"
    wait_for_settled(browser, services, "glasses")
    (order,) = outlet.sent
    assert isinstance(order, ApplySettings)
    assert order.values["follower.sub_goal_distance_m"] == 4.0
    panel = browser.view.tuning_panel
    assert panel is not None
    assert "waiting" in panel._words.content
    services.hub.receive("glasses", SettingsRunning(1, Settings().values(), order.revision, "Not while walking."))
    browser.tick()
    assert "Refused: Not while walking." in panel._words.content
    assert panel._widgets["follower.sub_goal_distance_m"].value == 3.0


@pytest.mark.parametrize("browser", ["technician"], indirect=True)
def test_what_safety_hangs_on_is_sent_only_once_confirmed(
    browser: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    services = scene_and_services[1]
    outlet = watch_tuned_device(browser, services)
    browser.set_widget("Stop distance, m", 1.0)
    wait_for_settled(browser, services, "glasses")
    assert outlet.sent == []
    browser.set_widget("Send it", True)
    (order,) = outlet.sent
    assert isinstance(order, ApplySettings)
    assert (order.values["obstacle.stop_distance_m"], order.revert_after_s) == (1.0, 60.0)
    panel = browser.view.tuning_panel
    assert panel is not None
    browser.tick()
    assert not panel._trial.visible
    until_s = services.hub.now_s() + 60.0 + services.hub.device("glasses").clock_offset_s
    services.hub.receive("glasses", SettingsRunning(order.revision, order.values, revert_at_s=until_s))
    browser.tick()
    assert panel._trial.visible
    browser.set_widget("Keep it", True)
    assert outlet.sent[-1] == KeepSettings(order.revision)
    services.hub.receive("glasses", SettingsRunning(order.revision, order.values))
    browser.tick()
    assert not panel._trial.visible


@pytest.mark.parametrize("browser", ["technician"], indirect=True)
def test_a_forged_value_out_of_range_is_refused_and_taken_back(
    browser: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    services = scene_and_services[1]
    outlet = watch_tuned_device(browser, services)
    browser.set_widget("Sub goal distance, m", 99.0)
    wait_for_settled(browser, services, "glasses")
    assert outlet.sent == []
    assert any("from 0.5 to 10" in notice for notice in browser.notices)
    panel = browser.view.tuning_panel
    assert panel is not None
    browser.tick()
    assert panel._widgets["follower.sub_goal_distance_m"].value == 3.0


@pytest.mark.parametrize("role", ["viewer", "editor"])
def test_only_who_may_tune_has_sliders(scene_and_services: tuple[Scene, Services], role: Role) -> None:
    browser = FakeBrowser(scene_and_services[0], role, "Eve", client_id=501)
    try:
        assert browser.view.tuning_panel is None
    finally:
        browser.disconnect()


# ----------------------------------------------------------------------------------- what the page around asks for
def test_the_page_around_can_fly_the_scene_of_its_own_session_to_a_place(
    browser: FakeBrowser, scene_and_services: tuple[Scene, Services]
) -> None:
    services = scene_and_services[1]
    other = FakeBrowser(scene_and_services[0], "viewer", "Bob", client_id=502)
    try:
        assert services.views.ask(browser.person.session_id, FlyToPoi("lift")) == 1
        browser.tick()
        lift = services.model.graph.pois["lift"]
        assert tuple(browser.view.client.camera.look_at)[:2] == pytest.approx((lift.x_m, lift.y_m))
        assert (browser.view.editor.selected, other.view.editor.selected) == (("poi", "lift"), None)
    finally:
        other.disconnect()
    assert services.views.ask(other.person.session_id, FlyToPoi("lift")) == 0, "a closed window hears nothing"
    for to, mode in (("walker", CameraMode.FOLLOW), ("overview", CameraMode.FREE)):
        services.views.ask(browser.person.session_id, MoveCamera(to))  # type: ignore[arg-type]
        browser.tick()
        assert browser.view.view_panel.mode is mode


def test_following_moves_the_camera_along_with_the_walker(browser: FakeBrowser, device: LiveDevice) -> None:
    async def follow(x_m: float) -> None:
        browser.view.view_panel.tick(view_of(dataclasses.replace(device, state=state_at(100.0, x_m)), 100.1))

    async def begin() -> None:
        browser.view.view_panel.follow()

    browser.run(begin())
    browser.run(follow(2.0))
    before = browser.view.client.camera.position.copy()
    browser.run(follow(4.0))
    assert browser.view.client.camera.position - before == pytest.approx([2.0, 0.0, 0.0], abs=1e-6)
    assert tuple(browser.view.client.camera.look_at)[:2] == pytest.approx((4.0, 0.5))


def test_a_window_can_hide_a_layer_for_itself(browser: FakeBrowser) -> None:
    def visible(name: str) -> bool:
        return bool(node(browser, name).visible)

    assert (visible("/map/cloud"), visible("/map/ceiling")) == (True, False)
    browser.set_widget("Ceiling", True)
    browser.set_widget("Point cloud", False)
    assert (visible("/map/cloud"), visible("/map/ceiling")) == (False, True)
    shared = browser.scene.embedded.server.scene
    assert shared.get_handle_by_name("/map/cloud").visible, "the others still see it"


@pytest.mark.parametrize("mode", Mode)
def test_every_state_of_a_device_has_a_clear_label_in_the_scenes_panel(mode: Mode) -> None:
    action = "walk" if mode is Mode.GUIDING else "stop"
    state = WalkerState(100.0, "localized", action, "ok", direction_rad=0.0, mode=mode)
    hello = Hello(2, "glasses", "0.1", "site", "x", 1, 0, 100.0)
    device = LiveDevice("glasses", "Glasses", hello, True, 100.0, 0.0, state=state)
    shown = status(view_of(device, 100.0), PoiGraph(), is_there=True)
    assert mode.label in shown
    assert f">{mode.value}<" not in shown, "people read no identifiers"


def test_a_past_walk_in_the_scene_is_never_taken_for_live_and_ends_by_itself(
    browser: FakeBrowser, device: LiveDevice, scene_and_services: tuple[Scene, Services]
) -> None:
    view, hub = browser.view, scene_and_services[1].hub
    live = view_of(device, hub.now_s())
    words = "PAST WALK 12:03:10"
    long_ago = dataclasses.replace(device, state=state_at(7.0, 4.0, 1.0))
    past = ShowPast(long_ago, 7.0, words, np.array([[3.0, 1.0], [4.0, 1.0]]))

    async def drawn(request: ViewRequest | None, after_s: float = 0.0) -> LiveView:
        if request is not None:
            view.take(request)
        ticked_s.append(hub.now_s())
        view.tick(dataclasses.replace(live, now_s=ticked_s[-1] + after_s, others=(device,)))
        return view.past.view(live)

    ticked_s: list[float] = []
    browser.run(drawn(past))
    assert tuple(node(browser, "/walker").position) == pytest.approx((4.0, 1.0, 0.0))
    assert node(browser, "/walker/cue").text == words, "no word of then is heard now"
    assert node(browser, "/walker/past").visible
    assert node(browser, "/walker/figure/body").color == look.WALKER_STALE
    trail, route = (np.asarray(node(browser, f"/live/{name}").colors).reshape(-1, 3) for name in ("trail", "route"))
    assert {tuple(each) for each in (*trail.tolist(), *route.tolist())} == {look.WALKER_STALE}
    assert ticked_s[-1] - node(browser, "/live/beat").position[0] < 1.0, "the scene itself is not old"
    others = [node(browser, f"/others/{number}") for number in range(1)]
    assert not any(each is not None and each.visible for each in others), "nothing of now stands beside it"
    for end in (drawn(EndPast()), drawn(past), drawn(None, SILENCE_S + 0.1)):
        shown = browser.run(end)
    assert shown.past is None
    assert not node(browser, "/walker/past").visible
    assert node(browser, "/walker/cue").text != words
