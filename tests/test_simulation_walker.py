"""The walker moves by what it hears, and by nothing else."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device_agent.simulation.building import Building, SolidArrays, push_from_solids, touchable
from device_agent.simulation.shapes import Solid
from device_agent.simulation.walker import (
    Motion,
    WalkerBody,
    WalkerParameters,
    drawn_partially_sighted_walker,
    drawn_walker,
    hear,
    step,
)
from navcore.cues.table import Cue, CueKind, CuePriority

EXACT = WalkerParameters(turn_gain_sigma=0.0, tone_sigma_deg=0.0, veer_deg_per_sqrt_m=0.0)
NOTHING = touchable(())
DT_S = 0.02


def cue(kind: CueKind, angle_deg: float | None = None, text: str = "") -> Cue:
    return Cue(0.0, kind, CuePriority.TURN, text, angle_deg, duration_s=0.1)


class Walk:
    """Drives the pure functions, as the world does."""

    def __init__(self, walker: WalkerParameters = EXACT, solids: SolidArrays = NOTHING, seed: int = 0) -> None:
        self.walker, self.solids = walker, solids
        self.rng = np.random.default_rng(seed)
        self.body = WalkerBody(0.0, 0.0, 0.0, 0.0)

    def hear(self, *args: object, **kwargs: object) -> None:
        self.body = hear(self.body, cue(*args, **kwargs), self.walker, self.rng)  # type: ignore[arg-type]

    def wait(self, seconds: float, *, ticking: bool = False) -> None:
        for number in range(round(seconds / DT_S)):
            if ticking and number % 40 == 0:
                self.hear(CueKind.TICK)
            self.body = step(self.body, self.walker, self.solids, NOTHING, DT_S, self.rng)


def test_without_a_cue_nobody_moves() -> None:
    walk = Walk()
    walk.wait(5.0)
    walk.hear(CueKind.TICK)
    walk.hear(CueKind.STEER, 20.0)
    walk.hear(CueKind.MESSAGE, text="Hello, this is the console")
    walk.wait(3.0)
    assert (walk.body.x_m, walk.body.y_m, walk.body.heading_rad) == (0.0, 0.0, 0.0)


def test_walk_begins_after_the_reaction_and_reaches_its_speed() -> None:
    walk = Walk()
    walk.hear(CueKind.WALK)
    walk.wait(EXACT.reaction_min_s - 0.04, ticking=True)
    assert walk.body.x_m == 0.0
    walk.wait(4.0, ticking=True)
    assert walk.body.speed_mps == pytest.approx(EXACT.speed_mps)
    assert walk.body.x_m > 1.5
    assert walk.body.y_m == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("kind", [CueKind.STOP, CueKind.ARRIVED])
def test_stop_stops_within_reaction_and_braking(kind: CueKind) -> None:
    for seed in range(10):
        walk = Walk(seed=seed)
        walk.hear(CueKind.WALK)
        walk.wait(4.0, ticking=True)
        before_m = walk.body.x_m
        walk.hear(kind)
        walk.wait(4.0, ticking=True)
        longest_m = EXACT.speed_mps * (EXACT.reaction_max_s + 0.02) + EXACT.speed_mps**2 / (2 * EXACT.braking_mps2)
        assert 0.2 < walk.body.x_m - before_m <= longest_m + 0.02
        assert walk.body.motion is Motion.STANDING
        assert walk.body.speed_mps == 0.0


def test_stop_cuts_off_what_was_still_to_be_done() -> None:
    walk = Walk()
    walk.hear(CueKind.TURN, 90.0, text="Turn left ninety degrees and then wait for more")
    walk.hear(CueKind.STOP)
    walk.wait(6.0)
    assert walk.body.heading_rad == 0.0


def test_who_hears_stop_again_and_again_does_not_stop_later_for_it() -> None:
    person = Walk(replace(EXACT, reaction_min_s=0.8, reaction_max_s=0.8))
    person.hear(CueKind.WALK)
    person.wait(4.0, ticking=True)
    assert person.body.speed_mps > 0.5
    person.hear(CueKind.TURN, 40.0)
    for kind in (CueKind.STOP, CueKind.STOP, CueKind.STOP, CueKind.STOP):
        person.wait(0.3)
        person.hear(kind)
    person.wait(0.5)
    assert person.body.speed_mps == 0.0


def test_silence_is_never_go() -> None:
    walk = Walk()
    walk.hear(CueKind.WALK)
    walk.wait(1.4)
    assert walk.body.speed_mps > 0.0
    walk.wait(2.0)
    assert walk.body.speed_mps == 0.0
    stood_m = walk.body.x_m
    walk.hear(CueKind.MESSAGE, text="A message is no go")
    walk.wait(2.0)
    assert walk.body.x_m == stood_m
    walk.hear(CueKind.TICK)
    walk.wait(1.5)
    assert walk.body.x_m > stood_m


def test_a_tick_does_not_lift_a_stop() -> None:
    walk = Walk()
    walk.hear(CueKind.WALK)
    walk.wait(3.0, ticking=True)
    walk.hear(CueKind.STOP)
    walk.wait(2.5, ticking=True)
    stood_m = walk.body.x_m
    walk.wait(3.0, ticking=True)
    assert walk.body.x_m == stood_m


@given(st.floats(-179.0, 179.0))
@settings(max_examples=25, deadline=None)
def test_turn_is_on_the_spot_by_the_angle(angle_deg: float) -> None:
    walk = Walk()
    walk.hear(CueKind.TURN, angle_deg, text="Turn")
    walk.wait(6.0)
    assert (walk.body.x_m, walk.body.y_m) == (0.0, 0.0)
    assert math.degrees(walk.body.heading_rad) == pytest.approx(angle_deg, abs=1e-6)
    assert walk.body.motion is Motion.STANDING


def test_turn_first_brings_a_walker_to_a_stand() -> None:
    walk = Walk()
    walk.hear(CueKind.WALK)
    walk.wait(3.0, ticking=True)
    walk.hear(CueKind.TURN, -90.0, text="Turn right")
    walk.wait(6.0)
    assert walk.body.y_m == pytest.approx(0.0, abs=0.02)
    assert math.degrees(walk.body.heading_rad) == pytest.approx(-90.0)


def test_steer_bends_the_way_without_stopping() -> None:
    walk = Walk()
    walk.hear(CueKind.WALK)
    walk.wait(3.0, ticking=True)
    for _ in range(2):
        # The same tone twice, while the turn has not begun: it names the same place, not twice the angle.
        walk.hear(CueKind.STEER, 20.0)
    walk.wait(2.0, ticking=True)
    assert math.degrees(walk.body.heading_rad) == pytest.approx(20.0)
    assert walk.body.speed_mps == pytest.approx(EXACT.speed_mps)


def test_turning_errs_by_a_few_percent_and_walking_veers() -> None:
    turned, ends = [], []
    for seed in range(24):
        walk = Walk(WalkerParameters(), seed=seed)
        walk.hear(CueKind.TURN, 90.0)
        walk.wait(4.0)
        turned.append(math.degrees(walk.body.heading_rad))
        walk = Walk(WalkerParameters(), seed=seed)
        walk.hear(CueKind.WALK)
        walk.wait(12.0, ticking=True)
        ends.append(walk.body.y_m)
    assert 1.0 < np.std(turned) < 8.0
    assert np.mean(turned) == pytest.approx(90.0, abs=2.5)
    assert 0.05 < np.std(ends) < 1.0


def test_persons_are_drawn_from_the_ranges() -> None:
    people = [drawn_walker(seed) for seed in range(50)]
    assert all(0.6 <= person.speed_mps <= 1.1 for person in people)
    assert len({person.speed_mps for person in people}) == 50
    assert drawn_walker(7) == drawn_walker(7)


def test_a_wall_is_touched_once_and_not_walked_through() -> None:
    wall = touchable((Solid("wall", 2.0, 0.0, 0.1, 5.0),))
    walk = Walk(solids=wall)
    walk.hear(CueKind.WALK, 20.0)
    walk.wait(8.0, ticking=True)
    assert walk.body.contacts == 1
    assert walk.body.x_m <= 2.0 - 0.1 - EXACT.body_radius_m + 1e-6
    assert walk.body.y_m > 1.0, "the body slides along the wall"
    walk.hear(CueKind.STOP)
    walk.wait(3.0)
    walk.hear(CueKind.TURN, 160.0)
    walk.wait(5.0)
    walk.hear(CueKind.WALK)
    walk.wait(3.0, ticking=True)
    assert walk.body.contacts == 1
    assert not walk.body.is_touching


@given(st.lists(st.tuples(st.sampled_from(list(CueKind)), st.floats(-180, 180), st.floats(0.0, 2.5)), max_size=12))
@settings(max_examples=20, deadline=None)
def test_whatever_is_said_the_body_stays_out_of_solids(
    office: Building, said: list[tuple[CueKind, float, float]]
) -> None:
    solids = touchable(office.solids)
    walk = Walk(WalkerParameters(), solids, seed=1)
    walk.body = WalkerBody(0.0, 7.0, 10.0, 0.0)
    for kind, angle_deg, pause_s in said:
        walk.hear(kind, angle_deg)
        walk.wait(pause_s, ticking=True)
        distance_m, _ = push_from_solids(solids, walk.body.x_m, walk.body.y_m)
        assert distance_m >= WalkerParameters().body_radius_m - 0.02


def walk_ahead(person: WalkerParameters, solids: SolidArrays) -> WalkerBody:
    walk = Walk(replace(person, veer_deg_per_sqrt_m=0.0, veer_bias_deg_per_m=0.0), solids)
    walk.hear(CueKind.WALK, 0.0)
    walk.wait(10.0, ticking=True)
    return walk.body


def test_somebody_partially_sighted_goes_round_what_a_blind_walker_touches() -> None:
    carton = touchable((Solid("carton", 4.0, 0.1, 0.25, 0.25, high_m=0.9),))
    assert walk_ahead(drawn_walker(3), carton).contacts == 1
    sighted = walk_ahead(drawn_partially_sighted_walker(3), carton)
    assert sighted.contacts == 0
    assert sighted.x_m > 4.5


def test_somebody_partially_sighted_does_not_walk_into_a_wall() -> None:
    wall = touchable((Solid("wall", 4.0, 0.0, 0.1, 10.0),))
    assert walk_ahead(drawn_walker(1), wall).contacts == 1
    assert walk_ahead(drawn_partially_sighted_walker(1), wall).contacts == 0
