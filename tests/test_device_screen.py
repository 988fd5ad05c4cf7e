"""The screen beside the loop: at a bounded rate, never with old guidance, and never in the loop's way."""

from __future__ import annotations

import math
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_device_agent import GRAPH, INTRINSICS, Rig, pose_at

from device_agent.adapters.clocks import FakeClock, SteppedClock
from device_agent.adapters.displays import PngDisplay
from device_agent.adapters.fakes import FakeDisplay
from device_agent.agent import DeviceAgent
from device_agent.cycle import Cycle
from device_agent.screen import RATE_HZ, Screen, head_of
from navcore.angles import relative_angle
from navcore.cues.overlay import Overlay
from navcore.errors import InputError
from navcore.settings import Settings
from navcore.types import Action, Guidance, Reason

SETTINGS = Settings()


def walking(stamp_s: float) -> Cycle:
    return Cycle(stamp_s, Guidance(stamp_s, Action.WALK, relative_angle(0.1), Reason.OK))


def test_pictures_come_at_a_bounded_rate_however_often_it_is_asked() -> None:
    clock, display = SteppedClock(10.0), FakeDisplay()
    screen = Screen(display, clock, SETTINGS)
    for _ in range(100):
        screen.offer(walking(clock.now_s()), SETTINGS)
        screen.check()
        clock.sleep_until(clock.now_s() + 0.02)
    assert 19 <= len(display.overlays) <= 2.0 * RATE_HZ + 1
    assert not any(overlay.is_stop for overlay in display.overlays)


def test_before_the_first_cycle_and_after_the_last_it_is_stop() -> None:
    clock, display = SteppedClock(10.0), FakeDisplay()
    screen = Screen(display, clock, SETTINGS)
    screen.check()
    clock.sleep_until(10.2)
    screen.offer(walking(10.2), SETTINGS)
    screen.check()
    for _ in range(10):
        clock.sleep_until(clock.now_s() + 0.1)
        screen.check()
    shown = [overlay.is_stop for overlay in display.overlays]
    assert shown[0] is True
    assert shown[1] is False
    last_walk_s = max(overlay.stamp_s for overlay in display.overlays if not overlay.is_stop)
    assert last_walk_s <= 10.2 + SETTINGS.watchdog.guidance_timeout_s
    assert shown[-3:] == [True] * 3


def test_whom_the_watchdog_stops_sees_it() -> None:
    clock, display, alarmed = SteppedClock(10.0), FakeDisplay(), [False]
    screen = Screen(display, clock, SETTINGS, lambda: alarmed[0])
    for alarm in (False, True, False):
        alarmed[0] = alarm
        clock.sleep_until(clock.now_s() + 0.2)
        screen.offer(walking(clock.now_s()), SETTINGS)
        screen.check()
    assert [overlay.is_stop for overlay in display.overlays] == [False, True, False]


def test_a_display_that_fails_is_tried_again_and_harms_nothing(caplog: pytest.LogCaptureFixture) -> None:
    broken = [True]

    def show(overlay: Overlay) -> None:
        if broken[0]:
            raise OSError("unplugged")

    clock = SteppedClock(10.0)
    screen = Screen(FakeDisplay(show), clock, SETTINGS)
    for _ in range(5):
        assert not screen.check()
        clock.sleep_until(clock.now_s() + 0.2)
    assert caplog.text.count("could not be shown") == 1
    broken[0] = False
    assert screen.check()


def test_its_thread_shows_stop_when_the_loop_hangs() -> None:
    clock, stopped_seen = FakeClock(10.0), threading.Event()
    display = FakeDisplay(lambda overlay: stopped_seen.set() if overlay.is_stop and overlay.stamp_s > 10.3 else None)
    screen = Screen(display, clock, SETTINGS)
    screen.offer(walking(10.0), SETTINGS)
    screen.start()
    screen.start()
    for _ in range(12):
        clock.wait_for_sleepers(1)
        clock.advance(0.1)
    assert stopped_seen.wait(10.0)
    screen.stop()
    clock.advance(1.0)
    assert not display.overlays[0].is_stop


def test_a_head_whose_place_is_not_known_is_held_level() -> None:
    assert head_of(None, None).eye_m == pytest.approx(1.6)
    assert math.isfinite(head_of(None, None).display_from_level.sum())


@pytest.fixture
def seeing_rig() -> tuple[Rig, FakeDisplay]:
    rig, display = Rig(), FakeDisplay()
    parts = rig.agent._parts
    with_display = type(parts)(
        **{name: getattr(parts, name) for name in parts.__dataclass_fields__ if name != "display"}, display=display
    )
    rig.agent = DeviceAgent(with_display, rig.agent.state, rig.localizer)
    return rig, display


def test_the_agent_shows_what_it_says(seeing_rig: tuple[Rig, FakeDisplay]) -> None:
    rig, display = seeing_rig
    screen = rig.agent.screen
    assert screen is not None

    def shown(cycles: int) -> list[bool]:
        before = len(display.overlays)
        for _ in range(cycles):
            rig.cycles(1)
            screen.check()
        return [overlay.is_stop for overlay in display.overlays[before:]]

    assert all(shown(3)), "nobody is led"
    rig.pose = pose_at(3.0)
    rig.lead_to()
    assert shown(5) == [False] * 5
    rig.pose = None
    assert shown(8)[-1] is True
    rig.pose = pose_at(3.0)
    assert shown(40)[-1] is False
    rig.locate_error = RuntimeError("broken")
    assert all(shown(5))
    assert INTRINSICS.width_px > 0
    assert GRAPH.pois


def test_without_a_display_nothing_is_drawn() -> None:
    assert Rig().agent.screen is None


def test_pictures_on_disk_are_those_that_were_shown(tmp_path: Path) -> None:
    display = PngDisplay(tmp_path / "eyes")
    rgba = np.zeros((display.geometry.height_px, display.geometry.width_px, 4), np.uint8)
    rgba[10, 20] = (255, 200, 50, 255)
    display.show(Overlay(12.3, rgba, rgba[:, ::-1].copy(), False))
    display.close()
    left, right = (
        cv2.imread(str(tmp_path / "eyes" / eye / "00012.300.png"), cv2.IMREAD_UNCHANGED) for eye in ("left", "right")
    )
    np.testing.assert_array_equal(cv2.cvtColor(left, cv2.COLOR_BGRA2RGBA), rgba)
    np.testing.assert_array_equal(left, right[:, ::-1])


def test_a_folder_that_cannot_be_written_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "eyes").write_text("")
    with pytest.raises(InputError, match="name another folder"):
        PngDisplay(tmp_path / "eyes")
