"""The live simulation under a scenario: strollers, other furniture, darkness, a covered lens, an unexpected start."""

from __future__ import annotations

import numpy as np
import pytest

from device_agent.simulation.building import Building, Start, push_from_solids, touchable
from device_agent.simulation.conditions import EASY
from device_agent.simulation.live_scenario import live_stage, strollers
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.scenario import Scenario
from device_agent.simulation.walker import WalkerParameters
from device_agent.simulation.world import SimulatedWorld, start_at

SIZE = (80, 60)


def test_strollers_walk_the_ways_and_touch_nothing(office: Building) -> None:
    people = strollers(office, 5, seed=2)
    solids = touchable(office.solids)
    assert len(people) == 5
    for person in people:
        placed = [person.placement_at(float(t)) for t in np.arange(0.0, 40.0, 0.5)]
        assert np.ptp([(p.x_m, p.y_m) for p in placed], axis=0).max() > 2.0
        assert len({p.pose for p in placed}) > 4
        assert all(push_from_solids(solids, p.x_m, p.y_m)[0] > 0.2 for p in placed)


def test_the_ordinary_scenario_changes_nothing(office: Building) -> None:
    start = start_at(office, "Hall")
    stage = live_stage(office, start)
    assert (stage.building, stage.start, stage.conditions) == (office, start, EASY)


def test_a_kidnapped_walker_stands_elsewhere_and_free(office: Building) -> None:
    start = start_at(office, "Hall")
    stage = live_stage(office, start, Scenario(changed_furniture_share=0.4, kidnapped=True), seed=3)
    assert stage.start != start
    clear_m = push_from_solids(touchable(stage.building.solids), stage.start.x_m, stage.start.y_m)[0]
    assert clear_m > WalkerParameters().body_radius_m


def test_the_worlds_camera_is_covered_and_uncovered(office: Building, office_renderer: Renderer) -> None:
    stage = live_stage(office, Start(15.0, 4.0, 1.57), Scenario(covered_s=(1.0, 2.0), dark_m=(0.0, 1.0)))
    world = SimulatedWorld(
        stage.building,
        WalkerParameters(),
        stage.start,
        size_px=SIZE,
        start_s=50.0,
        renderer=office_renderer,
        conditions=stage.conditions,
    )
    frames = []
    for stamp_s in (50.5, 51.5, 53.5):
        world.advance_to(stamp_s)
        frames.append(world.capture())
    assert [bool(np.isfinite(frame.depth_m).any()) for frame in frames] == [True, False, True]
    assert frames[0].stamp_s == pytest.approx(50.5)
    light = SimulatedWorld(office, WalkerParameters(), stage.start, size_px=SIZE, renderer=office_renderer).capture()
    assert frames[0].colour_rgb.mean() < 0.8 * light.colour_rgb.mean()
