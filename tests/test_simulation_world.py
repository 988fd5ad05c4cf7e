"""The world behind the ports: time, freshness, hearing, truth for evaluation only, and the same bytes every time."""

from __future__ import annotations

import inspect
import math

import numpy as np
import pytest

from device_agent import ports
from device_agent.simulation.adapters import SimulatedCamera, SimulatedClock, SimulatedEar, SimulatedSonar
from device_agent.simulation.building import Building, Start
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.walker import WalkerParameters
from device_agent.simulation.world import SimulatedWorld, start_at
from navcore.cues.table import Cue, CueKind, CuePriority
from navcore.errors import InputError, SensorError
from navcore.types import SonarState

SIZE = (160, 120)


@pytest.fixture
def world(office: Building, office_renderer: Renderer) -> SimulatedWorld:
    return new_world(office, office_renderer)


def new_world(office: Building, renderer: Renderer, start_s: float = 100.0) -> SimulatedWorld:
    start = start_at(office, "Hall")
    return SimulatedWorld(office, WalkerParameters(), start, 3, size_px=SIZE, start_s=start_s, renderer=renderer)


def walk_cue(stamp_s: float) -> Cue:
    return Cue(stamp_s, CueKind.WALK, CuePriority.TURN, "Move", 0.0)


class ManualClock:
    """A clock of the machine, as the live demo has one: the world has no part in it."""

    def __init__(self, now_s: float) -> None:
        self.time_s = now_s

    def now_s(self) -> float:
        return self.time_s

    def sleep_until(self, stamp_s: float) -> None:
        self.time_s = max(self.time_s, stamp_s)


def test_adapters_have_what_the_ports_ask_for(world: SimulatedWorld) -> None:
    clock = SimulatedClock(world)
    pairs = (
        (ports.Clock, clock),
        (ports.DepthCamera, SimulatedCamera(world, clock)),
        (ports.Sonar, SimulatedSonar(world, clock)),
        (ports.CueOutput, SimulatedEar(world, clock)),
    )
    for port, adapter in pairs:
        wanted = {name for name, _ in inspect.getmembers(port) if not name.startswith("_")}
        offered = {name for name in dir(adapter) if not name.startswith("_")}
        # Nothing more than the port, so that no truth is at hand where guidance is made.
        assert offered == wanted, port


def test_in_lock_step_waiting_moves_the_world(world: SimulatedWorld) -> None:
    clock = SimulatedClock(world)
    camera = SimulatedCamera(world, clock, rate_hz=10.0)
    stamps = [camera.read().stamp_s for _ in range(5)]
    assert stamps == pytest.approx([100.0, 100.1, 100.2, 100.3, 100.4])
    clock.sleep_until(101.0)
    assert clock.now_s() == pytest.approx(101.0)
    clock.sleep_until(50.0)
    assert clock.now_s() == pytest.approx(101.0)
    assert camera.read().stamp_s == pytest.approx(101.0)
    assert camera.read().stamp_s == pytest.approx(101.1)


def test_with_the_machines_clock_the_world_follows(world: SimulatedWorld) -> None:
    clock = ManualClock(100.0)
    camera, sonar = SimulatedCamera(world, clock, rate_hz=10.0), SimulatedSonar(world, clock)
    camera.read()
    clock.time_s = 107.03
    frame = camera.read()
    assert frame.stamp_s == pytest.approx(107.03)
    clock.time_s = 107.05
    assert sonar.read().stamp_s == pytest.approx(107.05)
    assert camera.read().stamp_s == pytest.approx(107.1)


def test_what_is_played_is_heard_and_seen(world: SimulatedWorld) -> None:
    clock = SimulatedClock(world)
    camera, sonar, ear = SimulatedCamera(world, clock), SimulatedSonar(world, clock), SimulatedEar(world, clock)
    before = camera.read()
    start = world.truth()
    ear.play(walk_cue(clock.now_s()))
    for _ in range(30):
        after = camera.read()
        ear.play(Cue(clock.now_s(), CueKind.TICK, CuePriority.POI, frequency_hz=500.0, duration_s=0.05))
    moved = world.truth()
    assert moved.y_m - start.y_m > 1.0
    assert not np.array_equal(before.colour_rgb, after.colour_rgb)
    assert world.true_head().translation[2] == pytest.approx(1.6, abs=0.05)
    assert sonar.read().state in (SonarState.OK, SonarState.NO_ECHO)


def test_the_truth_log_holds_the_whole_way(world: SimulatedWorld) -> None:
    world.hear(walk_cue(100.0))
    world.advance(1.5)
    log = world.truth_log()
    assert log.stamp_s[0] == 100.0
    assert log.stamp_s[-1] == pytest.approx(101.5)
    assert np.all(np.diff(log.stamp_s) > 0)
    assert log.position_m.shape == (len(log.stamp_s), 2)
    assert log.position_m[-1] == pytest.approx((world.truth().x_m, world.truth().y_m))
    assert log.contacts[-1] == 0


def test_the_same_seed_and_calls_give_the_same_bytes(office: Building, office_renderer: Renderer) -> None:
    outcomes = []
    for _ in range(2):
        world = new_world(office, office_renderer)
        world.hear(walk_cue(100.0))
        world.advance(1.2)
        frame = world.capture()
        outcomes.append((frame.colour_rgb.tobytes(), frame.depth_m.tobytes(), world.ping(), world.truth()))
    assert outcomes[0] == outcomes[1]


def test_closed_sensors_say_so(world: SimulatedWorld) -> None:
    clock = SimulatedClock(world)
    camera, sonar = SimulatedCamera(world, clock), SimulatedSonar(world, clock)
    camera.close()
    sonar.close()
    with pytest.raises(SensorError):
        camera.read()
    with pytest.raises(SensorError):
        sonar.read()


def test_starts_face_the_road(office: Building) -> None:
    assert start_at(office, "Hall").heading_rad == pytest.approx(math.pi / 2)
    assert start_at(office, "Bar").heading_rad == pytest.approx(math.pi)
    assert start_at(office, "Room 3308").heading_rad == pytest.approx(-math.pi / 2)


def test_bad_starts_and_leaps_are_refused(office: Building, office_renderer: Renderer, world: SimulatedWorld) -> None:
    with pytest.raises(InputError, match="Nobody can stand"):
        SimulatedWorld(office, WalkerParameters(), Start(5.8, 14.0, 0.0), renderer=office_renderer)
    with pytest.raises(InputError, match="leap"):
        world.advance_to(1e9)
    with pytest.raises(InputError, match="Hz"):
        SimulatedCamera(world, SimulatedClock(world), rate_hz=0.0)
