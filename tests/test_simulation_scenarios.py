"""Hard walks: people who keep clear and are seen as often as wanted, darkness, a covered lens, other furniture."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from device_agent.cli import main
from device_agent.simulation.blank_corridor import blank_corridor
from device_agent.simulation.building import Building, push_from_solids, touchable
from device_agent.simulation.floors import FLOORS, floor_named
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.passers_by import SHOWN_SHARE
from device_agent.simulation.people import BODY_RADIUS_M
from device_agent.simulation.refurnishing import refurnished
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.routes import kidnapped_route, lengthened
from device_agent.simulation.scenario import Scenario
from device_agent.simulation.simulated_walk import Shot, StagedWalk, shots, staged_walk
from device_agent.simulation.walk import plan_walk
from navcore.errors import InputError
from navcore.geometry import heading_of_camera
from navcore.recording import open_recording

SIZE = (80, 60)


def walked(staged: StagedWalk, renderer: Renderer, every: int = 1) -> list[Shot]:
    thinned = replace(
        staged,
        stamp_s=staged.stamp_s[::every],
        position_m=staged.position_m[::every],
        heads=staged.heads[::every],
        yaw_rate_rad_s=staged.yaw_rate_rad_s[::every],
    )
    return list(shots(thinned, 3, SIZE, renderer))


@pytest.fixture(scope="module")
def crowded(office: Building) -> StagedWalk:
    return staged_walk(office, seed=4, scenario=Scenario(people_share=0.3), rate_hz=5.0, max_length_m=40.0)


def test_people_are_seen_in_about_the_wanted_share_of_frames(crowded: StagedWalk, office_renderer: Renderer) -> None:
    seen = [shot.people_share >= SHOWN_SHARE for shot in walked(crowded, office_renderer)]
    assert np.mean(seen) == pytest.approx(0.3, abs=0.03)


def test_people_touch_neither_walls_nor_the_walker(crowded: StagedWalk, office: Building) -> None:
    solids = touchable(office.solids)
    met = 0
    for stamp_s, walker in zip(crowded.stamp_s, crowded.position_m, strict=True):
        for placement in crowded.building.placements_at(float(stamp_s)):
            if placement is not None:
                met += 1
                assert push_from_solids(solids, placement.x_m, placement.y_m)[0] > BODY_RADIUS_M - 0.05
                assert math.dist((placement.x_m, placement.y_m), walker) > 0.6
    assert met > 20


def test_people_walk_at_a_walking_pace_and_face_their_way(crowded: StagedWalk) -> None:
    stamps = np.arange(0.0, float(crowded.stamp_s[-1]), 0.1)
    for person in crowded.building.movers:
        placed = [person.placement_at(float(stamp_s)) for stamp_s in stamps]
        for before, after in itertools.pairwise(placed):
            if before is not None and after is not None:
                step = np.array([after.x_m - before.x_m, after.y_m - before.y_m])
                assert np.hypot(*step) < 0.25
                if np.hypot(*step) > 0.04:
                    assert step @ (math.cos(before.yaw_rad), math.sin(before.yaw_rad)) > 0.5 * np.hypot(*step)


def test_the_same_seed_stages_the_same_walk(office: Building, office_renderer: Renderer) -> None:
    scenario = Scenario(0.0, 0.0, (2.0, 5.0), (3.0, 1.0), True)
    walks = [
        walked(staged_walk(office, seed=seed, scenario=scenario, max_length_m=6.0), office_renderer, 24)
        for seed in (5, 5, 6)
    ]
    frames = [[shot.frame for shot in walk] for walk in walks]
    assert all(
        np.array_equal(a.colour_rgb, b.colour_rgb) and np.array_equal(a.depth_m, b.depth_m, equal_nan=True)
        for a, b in zip(frames[0], frames[1], strict=True)
    )
    assert not np.array_equal(frames[0][0].colour_rgb, frames[2][0].colour_rgb)


def test_the_same_seed_brings_the_same_people(office: Building) -> None:
    people = [
        staged_walk(office, seed=seed, scenario=Scenario(0.1), rate_hz=2.0, max_length_m=15.0).building.movers
        for seed in (1, 1, 2)
    ]
    placed = [[person.placement_at(t) for t in np.arange(0.0, 20.0, 0.5) for person in movers] for movers in people]
    assert placed[0] == placed[1] != placed[2]


def test_switched_off_lights_take_the_picture_and_leave_the_depth(office: Building, office_renderer: Renderer) -> None:
    light, dark = (
        walked(staged_walk(office, seed=3, scenario=scenario, max_length_m=16.0), office_renderer, 10)
        for scenario in (Scenario(), Scenario(dark_m=(3.0, 11.0)))
    )
    # The brightest pixels see a lit room at the end of the dark stretch; the median does not.
    pairs = [(np.median(a.frame.colour_rgb), np.median(b.frame.colour_rgb)) for a, b in zip(light, dark, strict=True)]
    medians = np.array(pairs)
    assert (medians[:, 1] < 0.3 * medians[:, 0]).sum() >= 5
    assert any(np.array_equal(a.frame.colour_rgb, b.frame.colour_rgb) for a, b in zip(light, dark, strict=True))
    for a, b in zip(light, dark, strict=True):
        assert np.array_equal(a.frame.depth_m, b.frame.depth_m, equal_nan=True)


def test_a_covered_camera_sees_nothing_meanwhile(office: Building, office_renderer: Renderer) -> None:
    staged = staged_walk(office, seed=3, scenario=Scenario(covered_s=(2.0, 3.0)), max_length_m=6.0)
    for shot in walked(staged, office_renderer, 5):
        is_covered = 2.0 <= shot.frame.stamp_s < 5.0
        assert np.isnan(shot.frame.depth_m).all() == is_covered
        assert (shot.frame.colour_rgb.mean() < 20.0) == is_covered


def test_a_kidnapped_walk_begins_beside_the_road_facing_anywhere(office: Building) -> None:
    solids = touchable(office.solids)
    headings = []
    for seed in range(12):
        route, heading_rad = kidnapped_route(office, office.road_waypoints, seed)
        assert math.dist(route[0], office.road_waypoints[0]) > 3.0
        assert route[0] not in office.road_waypoints
        for x_m, y_m in plan_walk(route[:4], seed, start_heading_rad=heading_rad).position_m[::20]:
            assert push_from_solids(solids, float(x_m), float(y_m))[0] > 0.25
        staged = staged_walk(office, seed=seed, scenario=Scenario(kidnapped=True), max_length_m=0.5)
        assert np.allclose(staged.position_m[0], route[0], atol=0.02)
        assert math.cos(heading_of_camera(staged.heads[0]) - heading_rad) > 0.99
        headings.append(heading_rad)
    assert np.ptp(headings) > math.pi


def test_changed_furniture_leaves_the_ways_passable(office: Building) -> None:
    changed = refurnished(office, 0.5, seed=2)
    gone = set(office.solids) - set(changed.solids)
    new = set(changed.solids) - set(office.solids)
    assert len(gone) > 10
    assert len(new) > 5
    assert not any(solid.name.startswith(("wall", "window", "pillar", "counter")) for solid in gone)
    solids = touchable(changed.solids)
    for x_m, y_m in plan_walk(office.road_waypoints, seed=1).position_m[::20]:
        assert push_from_solids(solids, float(x_m), float(y_m))[0] > 0.45
    assert refurnished(office, 0.5, seed=2) == changed
    assert refurnished(office, 0.0, seed=2).solids == office.solids


def test_new_furniture_stands_in_nothing(office: Building) -> None:
    changed = refurnished(office, 0.6, seed=9)
    before = set(office.solids)
    for piece in changed.movable:
        if not before.intersection(piece.solids):
            others = touchable(tuple(s for s in changed.solids if s not in piece.solids))
            for solid in piece.solids:
                assert push_from_solids(others, solid.x_m, solid.y_m)[0] > 0.0


def test_a_walk_goes_on_until_it_is_long_enough(office: Building) -> None:
    route = lengthened(office.road_waypoints, 0, 160.0)
    assert route[: len(office.road_waypoints)] == office.road_waypoints
    assert 160.0 <= plan_walk(route, 0).length_m < 175.0
    assert lengthened(office.road_waypoints, 0, 100.0) == office.road_waypoints


def test_impossible_scenarios_are_refused(office: Building) -> None:
    for changes in ({"people_share": 1.5}, {"dark_m": (5.0, 2.0)}, {"covered_s": (1.0, 0.0)}):
        with pytest.raises(InputError):
            Scenario(**changes)
    with pytest.raises(InputError, match="choose a share"):
        staged_walk(office, scenario=Scenario(people_share=0.9), max_length_m=5.0)
    with pytest.raises(InputError, match="too long"):
        lengthened(office.road_waypoints, 0, 5000.0)


def test_a_scenario_is_recorded_by_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "walk"
    options = "--rate-hz 2 --max-length-m 10 --people 0.2 --cover 2:1 --seed 4"
    assert main(["sim", "record", str(folder), *options.split()]) == 0
    assert "people in" in capsys.readouterr().out
    table = np.loadtxt(folder / "people.txt")
    recording = open_recording(folder)
    assert len(table) == len(recording)
    assert 0.1 < np.mean(table[:, 1] >= SHOWN_SHARE) < 0.4
    with pytest.raises(SystemExit):
        main(["sim", "record", str(tmp_path / "other"), "--dark", "5"])


@pytest.mark.parametrize("name", FLOORS)
def test_every_floor_can_be_walked(name: str) -> None:
    floor = floor_named(name)
    solids = touchable(floor.solids)
    assert floor.road_waypoints[0] in {(place.x_m, place.y_m) for place in floor.places.values()}
    for x_m, y_m in plan_walk(floor.road_waypoints, seed=1).position_m[::20]:
        assert push_from_solids(solids, float(x_m), float(y_m))[0] > 0.5
        assert any(room.x0_m < x_m < room.x1_m and room.y0_m < y_m < room.y1_m for room in floor.rooms)


def test_an_unknown_floor_is_refused() -> None:
    with pytest.raises(InputError, match="office"):
        floor_named("cellar")


def test_the_blank_corridor_is_blank(office_renderer: Renderer) -> None:
    floor = blank_corridor()
    staged = staged_walk(floor, rate_hz=1.0, max_length_m=16.0)
    corners = [
        cv2.goodFeaturesToTrack(cv2.cvtColor(shot.frame.colour_rgb, cv2.COLOR_RGB2GRAY), 500, 0.01, 4)
        for shot in shots(staged, 0, (320, 240))
    ]
    counts = [0 if found is None else len(found) for found in corners]
    office = [
        len(cv2.goodFeaturesToTrack(cv2.cvtColor(shot.frame.colour_rgb, cv2.COLOR_RGB2GRAY), 500, 0.01, 4))
        for shot in shots(staged_walk(office_floor(), rate_hz=0.5, max_length_m=5.0), 0, (320, 240), office_renderer)
    ]
    assert np.median(counts[-6:]) < 0.3 * np.median(office)
