"""A whole walk in lock step: the real device on the simulated walker, as fast as the machine can.

Used by ``vbr demo --headless`` and by the experiments. Guidance sees the sensors alone; the truth is looked at only
afterwards, to measure.
"""

from __future__ import annotations

import numpy as np

from device_agent.adapters.fakes import FakeOutput, NoUplink
from device_agent.adapters.outputs import TeeOutput
from device_agent.agent import DeviceAgent, DeviceParts, LocalizerFactory
from device_agent.localization import make_localizer
from device_agent.places import find_place
from device_agent.ports import CueOutput, DisplayOutput
from device_agent.simulation.adapters import SimulatedCamera, SimulatedClock, SimulatedEar, SimulatedSonar
from device_agent.simulation.building import Building
from device_agent.simulation.live_scenario import live_stage
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.scenario import ORDINARY, Scenario
from device_agent.simulation.walker import WalkerParameters, drawn_walker
from device_agent.simulation.world import SimulatedWorld, start_at
from device_agent.single_core import use_one_core
from device_agent.state import DeviceState
from device_agent.walk_measures import Sample, WalkResult, measured
from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.settings import Settings
from navcore.site import Site
from navcore.wire import SetDestination

_AFTER_ARRIVAL_S = 2.0
"""The walker needs this long to come to a stand; a contact meanwhile counts."""
_NO_WAY_S = 10.0
"""Somebody who stands and has been shown no way for this long will not be shown one."""


def run_walk(
    site: Site,
    building: Building,
    start: str,
    destination: str,
    *,
    settings: Settings | None = None,
    seed: int = 1,
    walker: WalkerParameters | None = None,
    max_s: float = 300.0,
    rate_hz: float = 10.0,
    size_px: tuple[int, int] = (320, 240),
    output: CueOutput | None = None,
    display: DisplayOutput | None = None,
    renderer: Renderer | None = None,
    localizer_factory: LocalizerFactory = make_localizer,
    scenario: Scenario = ORDINARY,
) -> WalkResult:
    """Lead a simulated walker from one place to another and measure. The same arguments give the same walk.

    ``walker`` is drawn from the seed where it is None; ``output`` hears every cue besides the walker; ``display`` is
    shown what the glasses show; ``renderer`` may be shared by walks in the same building, for making one takes seconds;
    a ``scenario`` that changes the building has its own. Raises VbrError for unknown places.
    """
    use_one_core()
    settings = settings or Settings()
    goal = find_place(site.poi_graph, destination)
    stage = live_stage(building, start_at(building, start), scenario, seed)
    world = SimulatedWorld(
        stage.building,
        walker or drawn_walker(seed),
        stage.start,
        seed,
        size_px=size_px,
        renderer=renderer if stage.building is building else None,
        conditions=stage.conditions,
    )
    clock = SimulatedClock(world)
    camera = SimulatedCamera(world, clock, rate_hz)
    heard = FakeOutput()
    outputs: list[CueOutput] = [SimulatedEar(world, clock), heard, *([output] if output is not None else [])]
    parts = DeviceParts(
        clock, camera, SimulatedSonar(world, clock), TeeOutput(outputs), NoUplink(), localizer_factory, display=display
    )  # fmt: skip
    localizer = localizer_factory(site, camera.intrinsics, settings)
    agent = DeviceAgent(parts, DeviceState(settings, site.poi_graph, site.site_id), localizer)
    agent.submit(SetDestination(goal.id))
    samples = _walked(agent, world, max_s)
    return measured(samples, world.truth(), _place_m(building, goal.name), tuple(heard.cues))


def _place_m(building: Building, name: str) -> FloatArray | None:
    """Return the true position (2,) of a place, or None where the building knows none of this name."""
    try:
        place = building.place(name)
    except InputError:
        return None
    return np.array([place.x_m, place.y_m])


def _walked(agent: DeviceAgent, world: SimulatedWorld, max_s: float) -> list[Sample]:
    samples: list[Sample] = []
    begin_s = world.now_s()
    ended, end_s = False, begin_s + max_s
    while world.now_s() < end_s:
        cycle = agent.run_cycle()
        agent.watchdog.check()
        if agent.screen is not None:
            agent.screen.check()
        samples.append(Sample(cycle, np.array(world.true_head().translation[:2]), agent.state.mode, agent.state.route))
        if not ended and agent.state.mode in ("arrived", "idle"):
            ended, end_s = True, min(end_s, world.now_s() + _AFTER_ARRIVAL_S)
        if not ended and agent.state.route is None and world.now_s() > begin_s + _NO_WAY_S:
            break
    return samples
