"""The agent in lock-step: real guidance, planning and cues on fake sensors in an empty hall."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_hall import EYE_HEIGHT_M, GRAPH, INTRINSICS, Rig, empty_hall, pose_at

from device_agent.adapters.clocks import FakeClock
from device_agent.adapters.fakes import FakeLocalizer, FakeOutput, FakeUplink, NoSonar
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.device_store import DeviceStore
from device_agent.locating import InLine
from device_agent.state import DeviceState, PreparedMap
from navcore.cues.table import Cue, CueKind
from navcore.errors import SensorError
from navcore.geometry import world_from_camera_at
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.site import Site, load_poi_graph, load_site, map_checksum, save_site
from navcore.types import Action, BearingState, Frame, Localization, LocalizationQuality, Reason
from navcore.wire import (
    ApplySettings,
    ClearDestination,
    GraphRunning,
    MapRunning,
    Pause,
    PublishGraph,
    Resume,
    RouteChanged,
    Say,
    SetDestination,
    SettingsRunning,
)


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_leads_from_the_start_to_arrived(rig: Rig) -> None:
    assert rig.cycles(1)[0].guidance.reason is Reason.NO_ROUTE
    rig.pose = pose_at(14.0)
    cycle = rig.lead_to()
    assert (cycle.guidance.action, cycle.guidance.reason) == (Action.WALK, Reason.OK)
    assert CueKind.WALK in rig.heard
    (route,) = rig.messages(RouteChanged)
    assert route.destination_id == "bar"
    assert route.stops[-1][0] == "Bar"
    for x_m in np.arange(14.0, 20.0, 0.1):
        rig.pose = pose_at(float(x_m))
        rig.cycles(1)
    state = rig.uplink.states[-1]
    assert (state.mode, state.reason, state.action, state.destination_id) == ("arrived", "arrived", "stop", "bar")
    assert CueKind.ARRIVED in rig.heard
    assert rig.events("arrived") == ["Arrived at Bar."]
    walking = [each.speed_m_s for each in rig.uplink.states if each.mode == "guiding" and each.speed_m_s]
    assert walking[-1] == pytest.approx(1.0, abs=0.05)


def test_whoever_has_arrived_is_not_led_on_after_losing_the_pose(rig: Rig) -> None:
    rig.pose = pose_at(19.5)
    rig.lead_to()
    assert rig.agent.state.mode == "arrived"
    rig.pose = None
    rig.cycles(5)
    rig.pose = pose_at(5.0)
    assert {cycle.guidance.action for cycle in rig.cycles(20)} == {Action.STOP}


def test_whoever_is_not_led_hears_that_once_and_nothing_of_the_sensors(rig: Rig) -> None:
    rig.cycles(10)
    assert rig.output.cues == []
    rig.pose = pose_at(19.5)
    rig.lead_to()
    rig.cycles(10)
    heard = len(rig.output.cues)
    assert rig.heard.count(CueKind.ARRIVED) == 1
    good = rig.spoil
    for _ in range(3):
        rig.spoil = lambda frame: SensorError("The camera delivers no pictures: check its cable.")
        rig.cycles(3)
        rig.clock.sleep_until(rig.clock.now_s() + 1.0)
        rig.cycles(3)
        rig.spoil = good
        rig.cycles(10)
    assert rig.output.cues[heard:] == []


def test_an_unreachable_or_unknown_place_is_refused_in_words(rig: Rig) -> None:
    for poi_id, word in (("attic", "Attic"), ("cellar", "cellar")):
        rig.lead_to(poi_id)
        assert rig.agent.state.mode is Mode.READY
        rig.cycles(30)
        refusal = rig.messages(RouteChanged)[-1].refusal
        assert word in refusal
        told = [cue.text for cue in rig.output.cues]
        assert refusal not in told, "what is to be done about the map is not the walker's to hear"
        assert {"attic": "No way leads to Attic yet. Choose another place.",
                "cellar": "This map does not have that place. Choose another one."}[poi_id] in told  # fmt: skip
        assert rig.events("route_refused")[-1] == refusal


def test_a_refused_change_of_destination_leads_on_to_the_old_one(rig: Rig) -> None:
    rig.lead_to("bar")
    cycle = rig.lead_to("attic")
    assert cycle.guidance.action is Action.WALK
    assert rig.agent.state.destination_id == "bar"
    last = rig.messages(RouteChanged)[-1]
    assert last.destination_id == "bar"
    assert "Attic" in last.refusal


def test_pause_stops_and_resume_goes_on(rig: Rig) -> None:
    rig.lead_to()
    rig.agent.submit(Pause())
    assert {cycle.guidance.reason for cycle in rig.cycles(3)} == {Reason.PAUSED}
    assert rig.uplink.states[-1].mode == "paused"
    rig.agent.submit(Resume())
    assert rig.cycles(6)[-1].guidance.action is Action.WALK


def test_a_cleared_destination_stops_the_walker_audibly(rig: Rig) -> None:
    rig.lead_to()
    heard = len(rig.output.cues)
    rig.agent.submit(ClearDestination())
    assert rig.cycles(1)[0].guidance.action is Action.STOP
    assert CueKind.STOP in rig.heard[heard:]
    assert rig.messages(RouteChanged)[-1].points_m == ()


def test_a_destination_waits_for_the_pose(rig: Rig) -> None:
    rig.pose = None
    assert rig.lead_to().guidance.reason is Reason.POSE_LOST
    assert rig.uplink.states[-1].mode is Mode.LOST
    rig.pose = pose_at(0.5)
    assert rig.cycles(6)[-1].guidance.action is Action.WALK


def test_a_new_way_is_planned_when_the_walker_has_left_the_road_for_good(rig: Rig) -> None:
    rig.lead_to()
    version = rig.agent.state.route_version
    rig.pose = pose_at(5.0, 3.0)
    hold_s = rig.agent.state.settings.planning.replan_hold_s
    rig.cycles(round(hold_s / 0.1) - 3)
    assert rig.agent.state.route_version == version
    rig.cycles(10)
    assert rig.agent.state.route_version == version + 1


def test_settings_take_effect_with_an_acknowledgement_or_not_at_all(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path / "state", tmp_path / "site")
    rig = Rig(store)
    rig.agent.submit(ApplySettings(7, {"follower.policy": "paper", "follower.sub_goal_distance_m": 1.5}))
    goal = rig.lead_to().guidance.trace.sub_goal
    assert goal is not None
    assert goal.x_m - 0.5 == pytest.approx(1.5, abs=0.2)
    assert rig.messages(SettingsRunning)[-1].revision == 7
    rig.agent.submit(ApplySettings(8, {"follower.sub_goal_distance_m": 999.0}))
    rig.cycles(1)
    answer = rig.messages(SettingsRunning)[-1]
    assert (answer.revision, answer.refused_revision) == (7, 8)
    assert "follower.sub_goal_distance_m" in answer.refusal
    rig.agent.settle()
    settings, revision = store.load_settings()
    assert (settings, revision) == (rig.agent.state.settings, 7)


def test_settings_that_no_longer_fit_give_way_to_the_defaults(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path, tmp_path / "site")
    (tmp_path / "settings.json").write_text('{"revision": 3, "values": {"gone.setting": 1}}')
    assert store.load_settings() == (Settings(), 0)


def test_a_graph_waits_until_the_walker_stops_and_is_kept(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    rig = Rig(DeviceStore(tmp_path / "state", tmp_path / "site"))
    rig.lead_to()
    graph = PoiGraph(9, GRAPH.pois, GRAPH.edges)
    rig.agent.submit(PublishGraph(graph))
    rig.cycles(5)
    assert rig.messages(GraphRunning) == []
    assert load_poi_graph(tmp_path / "site").version == 1
    rig.agent.submit(ClearDestination())
    rig.cycles(2)
    assert rig.messages(GraphRunning) == [GraphRunning(9)]
    rig.agent.settle()
    assert load_poi_graph(tmp_path / "site") == graph


def test_a_map_waits_until_the_walker_stops_and_moves_into_place(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    save_site(replace(small_site, name="A newer map"), tmp_path / "staging")
    checksum = map_checksum(tmp_path / "staging")
    rig = Rig(DeviceStore(tmp_path / "state", tmp_path / "site"))
    rig.lead_to()
    rig.agent.map_arrived(tmp_path / "staging", checksum)
    rig.cycles(5)
    assert rig.messages(MapRunning) == [MapRunning("old-map", waiting_checksum=checksum)]
    assert load_site(tmp_path / "site").name == "Small site"
    rig.agent.submit(ClearDestination())
    rig.cycles(2)
    assert rig.messages(MapRunning)[1:] == [MapRunning(checksum)]
    rig.agent.settle()
    assert load_site(tmp_path / "site").name == "A newer map"
    assert rig.agent.hello().map_checksum == checksum


def test_a_message_is_heard(rig: Rig) -> None:
    rig.agent.submit(Say("The lift is out of order."))
    rig.cycles(3)
    assert "The lift is out of order." in [cue.text for cue in rig.output.cues]
    assert any("The lift is out of order." in text for text in rig.events("cue"))


# ----------------------------------------------------------------------------------------------- when things fail
def test_a_dead_camera_stops_the_walker_says_so_and_recovers(rig: Rig) -> None:
    rig.lead_to()
    heard = len(rig.output.cues)
    good, rig.spoil = rig.spoil, lambda frame: SensorError("The camera delivers no pictures: check its cable.")
    rig.clock.sleep_until(rig.clock.now_s() + 0.1)
    cycle = rig.cycles(2)[-1]
    assert (cycle.guidance.action, cycle.guidance.reason) == (Action.STOP, Reason.SENSOR_STALE)
    stop = rig.output.cues[heard]
    assert stop.kind is CueKind.STOP
    assert len(stop.text) > 5
    assert rig.events("sensor") == ["The camera delivers no pictures: check its cable."]
    rig.spoil = good
    recovered = rig.cycles(15)
    assert recovered[3].guidance.action is Action.STOP
    assert recovered[-1].guidance.action is Action.WALK
    assert rig.events("sensor")[-1] == "The camera delivers again."
    assert CueKind.WALK in rig.heard[heard:]


def test_a_depth_image_of_nothing_stops_the_walker(rig: Rig) -> None:
    rig.lead_to()
    heard = len(rig.output.cues)
    rig.spoil = lambda frame: replace(frame, depth_m=np.full_like(frame.depth_m, np.nan))
    assert rig.cycles(1)[0].guidance.reason is Reason.DEPTH_INVALID
    assert CueKind.STOP in rig.heard[heard:]


def test_an_exception_in_localization_stops_the_walker_and_the_loop_goes_on(rig: Rig) -> None:
    rig.lead_to()
    heard = len(rig.output.cues)
    rig.locate_error = ZeroDivisionError("a bug")
    cycle = rig.cycles(3)[0]
    assert cycle.guidance.action is Action.STOP
    assert rig.heard[heard] is CueKind.STOP
    assert rig.heard[heard:].count(CueKind.STOP) == 1
    assert "ZeroDivisionError" in rig.events("watchdog")[0]
    assert "a bug" in rig.uplink.states[-1].rule
    rig.locate_error = None
    assert rig.cycles(15)[-1].guidance.action is Action.WALK
    assert CueKind.WALK in rig.heard[heard:]


def test_a_decision_that_took_too_long_is_a_stop(rig: Rig) -> None:
    rig.lead_to()

    slow_locate = rig.locate

    def locate(frame: Frame) -> Localization:
        rig.clock.sleep_until(rig.clock.now_s() + 0.8)
        return slow_locate(frame)

    rig.agent._locator = InLine(FakeLocalizer(locate))
    cycle = rig.cycles(1)[0]
    assert (cycle.guidance.action, cycle.guidance.reason) == (Action.STOP, Reason.SENSOR_STALE)
    assert "too old" in cycle.guidance.trace.rule


def test_stop_is_said_once_by_watchdog_and_loop_together(rig: Rig) -> None:
    rig.lead_to()
    heard = len(rig.output.cues)
    locate = rig.locate

    def slowly(frame: Frame) -> Localization:
        rig.clock.sleep_until(rig.clock.now_s() + 0.8)
        rig.agent.watchdog.check()
        return locate(frame)

    rig.agent._locator = InLine(FakeLocalizer(slowly))
    rig.cycles(1)
    rig.agent._locator = InLine(FakeLocalizer(locate))
    rig.cycles(15)
    instructions = (CueKind.STOP, CueKind.TURN, CueKind.WALK)
    assert [kind for kind in rig.heard[heard:] if kind in instructions] == [CueKind.STOP, CueKind.WALK]


def test_no_state_that_reaches_the_console_holds_what_is_no_number(rig: Rig) -> None:
    from navcore.wire import decode_from_device, encode

    rig.lead_to()
    rig.pose = None
    rig.cycles(3)
    for state in rig.uplink.states:
        assert decode_from_device(encode(state)) == state


def test_lock_step_runs_are_the_same_every_time() -> None:
    def run() -> list[object]:
        rig = Rig()
        rig.lead_to()
        for x_m in np.arange(0.5, 3.5, 0.1):
            rig.pose = pose_at(float(x_m))
            rig.cycles(1)
        return [rig.output.cues, [replace_times(state) for state in rig.uplink.states]]

    def replace_times(state):  # type: ignore[no-untyped-def]
        import msgspec

        return msgspec.structs.replace(state, cycle_ms=0.0, stages=())

    assert run() == run()


def test_orders_come_from_any_thread(rig: Rig) -> None:
    threads = [threading.Thread(target=rig.agent.submit, args=(Say(f"message {index}"),)) for index in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    rig.cycles(1)
    assert len([text for text in rig.events("cue") if text.startswith("Message: message")]) == 8


class AdvancingCamera:
    """A camera whose every frame is a tenth of a second of the clock."""

    intrinsics = INTRINSICS

    def __init__(self, clock: FakeClock) -> None:
        self._clock = clock
        self._depth_m = empty_hall(pose_at(0.5))

    def read(self) -> Frame:
        self._clock.advance(0.1)
        colour = np.zeros((INTRINSICS.height_px, INTRINSICS.width_px, 3), np.uint8)
        return Frame(self._clock.now_s(), colour, self._depth_m)

    def close(self) -> None:
        """Nothing is open."""


def test_a_loop_that_hangs_is_overruled_by_the_watchdogs_thread_and_goes_on_afterwards() -> None:
    clock, uplink = FakeClock(100.0), FakeUplink()
    hangs, release, stop_heard, walks = (threading.Event() for _ in range(4))
    located = 0

    def locate(frame: Frame) -> Localization:
        nonlocal located
        located += 1
        if located == 20:
            hangs.set()
            assert release.wait(20.0)
        return Localization(frame.stamp_s, LocalizationQuality.LOCALIZED, pose_at(0.5), np.eye(6) * 1e-4, 200)

    def heard(cue: Cue) -> None:
        if cue.kind is CueKind.STOP and hangs.is_set():
            stop_heard.set()
        if cue.kind is CueKind.WALK and release.is_set():
            walks.set()

    localizer = FakeLocalizer(locate)
    parts = DeviceParts(
        clock, AdvancingCamera(clock), NoSonar(clock), FakeOutput(heard), uplink, lambda *_: localizer
    )  # fmt: skip
    agent = DeviceAgent(parts, DeviceState(Settings(), GRAPH, "hall-site", "old-map"), localizer)
    agent.submit(SetDestination("bar"))
    stopped = threading.Event()
    loop = threading.Thread(target=agent.run, args=(stopped,), daemon=True)
    loop.start()
    assert hangs.wait(20.0)
    for _ in range(12):
        clock.wait_for_sleepers(1)
        clock.advance(0.051)
    assert stop_heard.wait(20.0)
    release.set()
    assert walks.wait(20.0)
    stopped.set()
    loop.join(20.0)
    clock.advance(1.0)
    assert any("No guidance" in text for _, kind, text in uplink.events if kind == "watchdog")


# ------------------------------------------------------------------------------------------ nothing ends the loop
class FailingOutput(FakeOutput):
    """An earphone that can be unplugged."""

    unplugged = False

    def play(self, cue: Cue) -> None:
        if self.unplugged:
            raise OSError("unplugged")
        super().play(cue)


def test_an_output_that_fails_ends_neither_the_loop_nor_the_watchdog_and_stop_is_heard_when_it_works_again() -> None:
    rig = Rig()
    output = FailingOutput()
    parts = replace(rig.agent._parts, output=output)
    rig.agent = DeviceAgent(parts, rig.agent.state, FakeLocalizer(rig.locate))
    rig.lead_to()
    assert CueKind.WALK in [cue.kind for cue in output.cues]
    output.unplugged = True
    rig.spoil = lambda frame: SensorError("no picture")
    assert all(cycle.guidance.action is Action.STOP for cycle in rig.cycles(3))
    rig.agent.submit(Say("Wait for me."))
    rig.cycles(3)
    output.unplugged = False
    before = len(output.cues)
    rig.clock.sleep_until(rig.clock.now_s() + 3.0)
    rig.cycles(1)
    assert CueKind.STOP in [cue.kind for cue in output.cues[before:]]


def test_an_order_that_cannot_be_carried_out_stops_the_walker_and_the_loop_goes_on(rig: Rig) -> None:
    rig.lead_to()
    broken = Site.__new__(Site)
    rig.agent.state = replace(rig.agent.state, mode=Mode.READY)
    rig.agent.submit(PreparedMap(Path("nowhere"), "sum", broken, FakeLocalizer(rig.locate)))
    rig.cycles(2)
    rig.agent.state = replace(rig.agent.state, waiting_map=None)
    rig.agent.submit(SetDestination("bar"))
    assert rig.cycles(15)[-1].guidance.action is Action.WALK


def test_after_the_watchdogs_stop_within_a_cycle_nobody_is_sent_on_in_the_same_cycle() -> None:
    rig = Rig()
    rig.lead_to()
    locate = rig.locate
    slow = [True]

    def hang(frame: Frame) -> Localization:
        # The picture came late, and finding the place takes a while: the decision itself is fresh enough.
        if slow.pop() if slow else False:
            rig.clock.sleep_until(rig.clock.now_s() + 0.45)
            rig.agent.watchdog.check()
        return locate(frame)

    rig.agent._locator = InLine(FakeLocalizer(hang))
    before = len(rig.output.cues)
    cycle = rig.cycles(1)[0]
    assert rig.heard[before] is CueKind.STOP
    assert not {CueKind.WALK, CueKind.TICK, CueKind.STEER} & set(rig.heard[before:])
    assert cycle.guidance.action is Action.STOP
    assert rig.cycles(15)[-1].guidance.action is Action.WALK


def test_the_end_of_the_loop_is_a_stop_for_whoever_is_being_led(rig: Rig) -> None:
    rig.lead_to()
    stopped = threading.Event()
    stopped.set()
    rig.agent.run(stopped)
    assert rig.output.cues[-1].kind is CueKind.STOP


def test_no_way_begins_at_a_place_that_is_not_sure(rig: Rig) -> None:
    sure = rig.locate

    uncertain = InLine(FakeLocalizer(lambda frame: replace(sure(frame), quality=LocalizationQuality.UNCERTAIN)))
    rig.agent._locator = uncertain
    cycle = rig.lead_to()
    assert (cycle.guidance.action, cycle.guidance.reason) == (Action.STOP, Reason.POSE_LOST)
    assert rig.agent.state.route is None
    rig.agent._locator = InLine(FakeLocalizer(sure))
    assert rig.cycles(6)[-1].guidance.action is Action.WALK


def test_an_order_that_has_waited_too_long_in_the_device_itself_is_not_carried_out() -> None:
    rig = Rig()
    rig.lead_to()
    rig.agent.submit(Pause(order_id=9), 2.0)
    rig.clock.sleep_until(rig.clock.now_s() + 3.0)
    rig.cycles(3)
    assert rig.agent.state.purpose is Mode.GUIDING
    assert rig.events("link") == ["Order 9 came too late and is not carried out: pause."]
    rig.agent.submit(Pause(order_id=10), 2.0)
    rig.cycles(2)
    assert rig.agent.state.purpose is Mode.PAUSED


def test_arriving_while_the_position_is_uncertain_is_told_with_that_reservation() -> None:
    for quality, expected in (
        (LocalizationQuality.LOCALIZED, "You have arrived: Bar."),
        (LocalizationQuality.UNCERTAIN, "You are probably at Bar. The position is uncertain."),
    ):
        rig = Rig()
        rig.pose = pose_at(18.0)
        rig.lead_to()
        rig.quality = quality
        rig.pose = pose_at(19.8)
        rig.cycles(6)
        assert rig.agent.state.mode is Mode.ARRIVED
        assert [cue.text for cue in rig.output.cues if cue.kind is CueKind.ARRIVED] == [expected]
        (event,) = rig.events("arrived")
        assert ("uncertain" in event) is (quality is LocalizationQuality.UNCERTAIN)


def test_a_pose_that_is_not_sure_and_too_low_makes_no_drop_of_the_floor() -> None:
    """Where the eye was above the floor is remembered from when the pose was sure."""
    rig = Rig()
    led = rig.lead_to()
    assert led.guidance.action is Action.WALK
    rig.quality = LocalizationQuality.UNCERTAIN
    rig.believed = world_from_camera_at((0.5, 0.0, EYE_HEIGHT_M - 0.2), 0.0, np.radians(13.0))
    unsure = rig.cycles(3)[-1]
    assert unsure.localization is not None
    assert unsure.localization.quality is LocalizationQuality.UNCERTAIN
    assert unsure.scan is not None
    assert set(unsure.scan.state.tolist()) == {BearingState.FREE}
    assert unsure.guidance.action is Action.WALK
