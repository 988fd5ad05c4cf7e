"""A whole walk in lock step: the real device on the simulated walker, as fast as the machine can.

Used by ``vbr demo --headless`` and by the experiments. Guidance sees the sensors alone; the truth is looked at only
afterwards, to measure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from device_agent.adapters.fakes import FakeOutput, NoUplink
from device_agent.adapters.outputs import TeeOutput
from device_agent.agent import DeviceAgent, DeviceParts, LocalizerFactory
from device_agent.cycle import Cycle
from device_agent.localization import make_localizer
from device_agent.orders import Lead
from device_agent.places import find_place
from device_agent.ports import CueOutput, DisplayOutput, LocalizerPort
from device_agent.recording.tap import Tap
from device_agent.simulation.adapters import SimulatedCamera, SimulatedClock, SimulatedEar, SimulatedSonar
from device_agent.simulation.building import Building, Start
from device_agent.simulation.live_scenario import live_stage
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.scenario import ORDINARY, Scenario
from device_agent.simulation.walker import WalkerParameters, drawn_walker
from device_agent.simulation.world import SimulatedWorld, start_at
from device_agent.single_core import use_one_core
from device_agent.state import DeviceState
from device_agent.walk_measures import Sample, WalkResult, measured
from navcore.cues.table import Cue
from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.settings import Settings
from navcore.site import Site

_AFTER_ARRIVAL_S = 2.0
"""The walker needs this long to come to a stand; a contact meanwhile counts."""
_NO_WAY_S = 60.0
"""Somebody who has been shown no way for this long, having looked round, will not be shown one."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What is there after a cycle, for whoever stages something while the walk goes on."""

    agent: DeviceAgent
    world: SimulatedWorld
    sonar: SimulatedSonar
    cycle: Cycle


Meanwhile = Callable[[Moment], None]
"""Called after each cycle: a door may begin to close, a plug be pulled, an order come in."""


def run_walk(
    site: Site,
    building: Building,
    start: str | Start,
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
    tap: Tap | None = None,
    meanwhile: Meanwhile = lambda moment: None,
) -> WalkResult:
    """Lead a simulated walker from one place to another and measure. The same arguments give the same walk.

    ``start`` is a place of the road, left as the road leaves it, or any spot and heading. ``walker`` is drawn from the
    seed where it is None; ``output`` hears every cue besides the walker; ``display`` is shown what the glasses show;
    ``renderer`` may be shared by walks in the same building, for making one takes seconds; a ``scenario`` that changes
    the building has its own; ``tap`` listens in on the loop (a recorder). Raises VbrError for unknown places.
    """
    use_one_core()
    settings = settings or Settings()
    goal = find_place(site.poi_graph, destination)
    begin = start if isinstance(start, Start) else start_at(building, start)
    stage = live_stage(building, begin, scenario, seed)
    world = SimulatedWorld(
        stage.building,
        walker or drawn_walker(seed),
        stage.start,
        seed,
        size_px=size_px,
        renderer=renderer if stage.building is building else None,
        conditions=stage.conditions,
    )
    localizer = localizer_factory(site, world.camera, settings)
    state = DeviceState(settings, site.poi_graph, site.site_id)
    samples, cues = lead(
        world, state, localizer, goal.id, max_s=max_s, rate_hz=rate_hz, output=output, display=display,
        tap=tap, meanwhile=meanwhile,
    )  # fmt: skip
    return measured(samples, world.truth(), _place_m(building, goal.name), cues)


def lead(
    world: SimulatedWorld,
    state: DeviceState,
    localizer: LocalizerPort,
    destination_id: str,
    *,
    max_s: float = 300.0,
    rate_hz: float = 10.0,
    output: CueOutput | None = None,
    display: DisplayOutput | None = None,
    tap: Tap | None = None,
    meanwhile: Meanwhile = lambda moment: None,
) -> tuple[list[Sample], tuple[Cue, ...]]:
    """Lead whoever walks in a world to a PoI of the state's graph; return every cycle, and every cue."""
    clock = SimulatedClock(world)
    camera, sonar = SimulatedCamera(world, clock, rate_hz), SimulatedSonar(world, clock)
    heard = FakeOutput()
    outputs: list[CueOutput] = [SimulatedEar(world, clock), heard, *([output] if output is not None else [])]
    tap = tap or Tap()
    parts = DeviceParts(
        clock, camera, sonar, TeeOutput(outputs), NoUplink(), lambda *_: localizer, display=display, tap=tap
    )
    agent = DeviceAgent(parts, state, localizer)
    agent.submit(Lead(destination_id))
    samples = _walked(agent, world, sonar, max_s, tap, meanwhile)
    return samples, tuple(heard.cues)


def _place_m(building: Building, name: str) -> FloatArray | None:
    """Return the true position (2,) of a place, or None where the building knows none of this name."""
    try:
        place = building.place(name)
    except InputError:
        return None
    return np.array([place.x_m, place.y_m])


def _walked(
    agent: DeviceAgent, world: SimulatedWorld, sonar: SimulatedSonar, max_s: float, tap: Tap, meanwhile: Meanwhile
) -> list[Sample]:
    samples: list[Sample] = []
    begin_s = world.now_s()
    ended, end_s = False, begin_s + max_s
    while world.now_s() < end_s:
        cycle = agent.run_cycle()
        agent.watchdog.check()
        if agent.screen is not None:
            agent.screen.check()
        tap.check()
        state, head_m = agent.state, np.array(world.true_head().translation[:2])
        samples.append(Sample(cycle, head_m, state.purpose, state.route))
        meanwhile(Moment(agent, world, sonar, cycle))
        if not ended and not agent.state.leading:
            ended, end_s = True, min(end_s, world.now_s() + _AFTER_ARRIVAL_S)
        if not ended and agent.state.route is None and world.now_s() > begin_s + _NO_WAY_S:
            break
    return samples
