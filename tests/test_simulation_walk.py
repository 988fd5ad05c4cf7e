"""The sighted person's walk: smooth, slow in turns, complete, and recorded as any other recording."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from device_agent.simulation.building import Building
from device_agent.simulation.gait import USUAL_GAIT, advance_phase, head_pose
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.walk import CAREFUL_WALK, head_trajectory, plan_walk
from device_agent.simulation.walk_recording import record_walk
from navcore.angles import wrap_rad
from navcore.errors import InputError
from navcore.geometry import heading_of_camera
from navcore.recording import open_recording, read_trajectory


def test_the_walk_is_within_its_limits(office: Building) -> None:
    plan = plan_walk(office.road_waypoints, seed=3)
    dt_s = plan.stamp_s[1] - plan.stamp_s[0]
    speeds = np.hypot(*np.diff(plan.position_m, axis=0).T) / dt_s
    yaw_rates = np.diff(plan.heading_rad) / dt_s
    assert plan.length_m <= 180.0
    assert speeds.max() <= CAREFUL_WALK.speed_mps * 1.1
    assert np.abs(yaw_rates).max() <= math.radians(45.0)
    assert np.abs(np.diff(plan.speed_mps)).max() / dt_s < 2 * CAREFUL_WALK.acceleration_mps2


def test_the_walk_ends_as_it_began(office: Building) -> None:
    plan = plan_walk(office.road_waypoints, seed=3)
    assert plan.position_m[0] == pytest.approx(plan.position_m[-1], abs=0.05)
    assert wrap_rad(plan.heading_rad[0] - plan.heading_rad[-1]) == pytest.approx(0.0, abs=0.02)


def test_the_walk_passes_every_waypoint(office: Building) -> None:
    positions = plan_walk(office.road_waypoints, seed=3).position_m[::5]
    for point in set(office.road_waypoints):
        assert np.hypot(*(positions - point).T).min() < 0.6 * CAREFUL_WALK.corner_radius_m


def test_walks_differ_by_seed_and_repeat(office: Building) -> None:
    plans = [plan_walk(office.road_waypoints, seed) for seed in (1, 1, 2)]
    assert np.array_equal(plans[0].position_m, plans[1].position_m)
    assert not np.array_equal(plans[0].position_m[:1000], plans[2].position_m[:1000])


def test_the_head_bobs_and_sways_while_walking_only() -> None:
    phase, heights, sides, idle = 0.0, [], [], []
    for number in range(400):
        time_s = number * 0.01
        phase = advance_phase(phase, 0.9, 0.01, USUAL_GAIT)
        pose = head_pose(0.0, 0.0, 0.0, time_s, phase, 0.9)
        sides.append(pose.translation[1])
        heights.append(pose.translation[2])
        idle.append(head_pose(0.0, 0.0, 0.0, time_s, 0.4, 0.0).translation[2])
    assert np.ptp(heights) == pytest.approx(2 * USUAL_GAIT.bob_m, rel=0.05)
    assert np.ptp(sides) > 2 * USUAL_GAIT.sway_m * 0.9
    assert np.ptp(idle) < 0.01
    # Twice as many bobs as sways.
    crossings = [np.count_nonzero(np.diff(np.sign(np.array(x) - np.mean(x)))) for x in (heights, sides)]
    assert crossings[0] == pytest.approx(2 * crossings[1], abs=3)


def test_the_head_looks_where_the_walk_goes(office: Building) -> None:
    plan = plan_walk(office.road_waypoints, seed=0)
    for stamp_s, pose in head_trajectory(plan, 1.0):
        sample = round(stamp_s / 0.01)
        assert abs(wrap_rad(heading_of_camera(pose) - plan.heading_rad[sample])) < math.radians(4)
        assert pose.rotation[2, 2] == pytest.approx(-math.sin(math.radians(15)), abs=0.04)


def test_a_recorded_walk_can_be_opened_and_repeats(tmp_path: Path, office_renderer: Renderer) -> None:
    steps: list[tuple[int, int]] = []
    for name, renderer in (("a", office_renderer), ("b", None)):
        record_walk(
            tmp_path / name, 5, (160, 120), 2.0, lambda *done: steps.append(done), 1.2, renderer=renderer
        )  # fmt: skip
    recording = open_recording(tmp_path / "a")
    stamps, poses = read_trajectory(tmp_path / "a" / "groundtruth.txt")
    assert len(recording) == len(poses) == steps[-1][0] > 4
    assert stamps.tolist() == pytest.approx([entry.stamp_s for entry in recording.entries])
    frame = recording.read(recording.entries[0])
    assert frame.colour_rgb.shape == (120, 160, 3)
    assert np.isfinite(frame.depth_m).mean() > 0.7
    for file in sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file()):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_impossible_walks_are_refused(office: Building) -> None:
    with pytest.raises(InputError, match="two way points"):
        plan_walk(((0.0, 0.0),), seed=0)
    with pytest.raises(InputError, match="seed"):
        plan_walk(office.road_waypoints, seed=-1)
    with pytest.raises(InputError, match="Hz"):
        head_trajectory(plan_walk(office.road_waypoints[:3], seed=0), 0.0)
