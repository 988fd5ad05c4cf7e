"""Sensors' own clocks put on the device's, and gravity from what an accelerometer feels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from device_agent.adapters.clocks import SteppedClock
from device_agent.adapters.gravity import FRESH_FOR_S, GravityFilter
from device_agent.adapters.sensor_clock import WINDOW_S, SensorClock

DELAYS_S = st.lists(st.floats(0.0, 0.2), min_size=1, max_size=40)


@given(DELAYS_S, st.floats(-1e6, 1e6))
def test_stamps_are_never_of_the_future_never_go_back_and_are_off_by_the_shortest_delay(
    delays_s: list[float], origin_s: float
) -> None:
    clock = SteppedClock(1000.0)
    sensor = SensorClock(clock)
    stamps, shortest_s = [], math.inf
    for index, delay_s in enumerate(delays_s):
        taken_s = 1000.0 + 0.05 * index
        clock.sleep_until(taken_s + delay_s)
        shortest_s = min(shortest_s, clock.now_s() - taken_s)
        stamps.append(sensor.stamp_s(origin_s + 0.05 * index))
        assert stamps[-1] <= clock.now_s() + 1e-6
        assert stamps[-1] == pytest.approx(taken_s + shortest_s, abs=1e-6)
    assert (np.diff(stamps) > -1e-6).all()


def test_what_has_waited_in_a_buffer_is_old() -> None:
    clock = SteppedClock(100.0)
    sensor = SensorClock(clock)
    assert sensor.stamp_s(7.0) == 100.0
    clock.sleep_until(105.0)
    assert sensor.stamp_s(7.1) == pytest.approx(100.1)


def test_a_sensor_whose_time_begins_anew_is_old_until_the_window_has_passed() -> None:
    clock = SteppedClock(100.0)
    sensor = SensorClock(clock)
    sensor.stamp_s(5000.0)
    clock.sleep_until(101.0)
    assert sensor.stamp_s(0.0) < 0.0
    for passed_s in (WINDOW_S + 2.0, 2 * WINDOW_S + 4.0):
        clock.sleep_until(100.0 + passed_s)
        stamp_s = sensor.stamp_s(passed_s - 1.0)
    assert stamp_s == pytest.approx(clock.now_s())


def test_where_the_sensors_clock_can_be_read_the_age_is_exact() -> None:
    clock = SteppedClock(100.0)
    sensor = SensorClock(clock, lambda: clock.now_s() + 1e6)
    assert sensor.stamp_s(1e6 + 99.9) == pytest.approx(99.9)
    clock.sleep_until(103.0)
    assert sensor.stamp_s(1e6 + 101.0) == pytest.approx(101.0)
    assert sensor.stamp_s(1e6 + 109.0) == 103.0, "not of the future"
    assert math.isnan(sensor.stamp_s(float("nan")))


def test_where_stamps_are_of_another_clock_than_they_ought_to_be_the_shortest_delay_counts() -> None:
    clock = SteppedClock(100.0)
    sensor = SensorClock(clock, lambda: clock.now_s() + 1e6)
    assert sensor.stamp_s(3.0) == 100.0
    clock.sleep_until(101.0)
    assert sensor.stamp_s(3.5) == pytest.approx(100.5)
    assert math.isnan(sensor.stamp_s(float("inf")))


# ----------------------------------------------------------------------------------------------------- gravity
def test_at_rest_gravity_is_opposite_to_what_is_felt() -> None:
    gravity = GravityFilter()
    gravity.add(1.0, np.array([0.0, -9.81 * math.cos(0.26), -9.81 * math.sin(0.26)]))
    down = gravity.down(1.0)
    assert down is not None
    assert down == pytest.approx([0.0, math.cos(0.26), math.sin(0.26)])


def test_steps_hardly_change_where_down_is() -> None:
    gravity, worst_deg = GravityFilter(), 0.0
    for index in range(400):
        at_s = index / 100
        step = np.array([1.0 * math.sin(2 * math.pi * 1.0 * at_s), 3.0 * math.sin(2 * math.pi * 2.0 * at_s), 1.0])
        gravity.add(at_s, np.array([0.0, -9.81, 0.0]) + step)
        down = gravity.down(at_s)
        if down is not None and at_s > 2.0:
            worst_deg = max(worst_deg, math.degrees(math.acos(min(1.0, down[1]))))
    assert worst_deg < 8.0


@pytest.mark.parametrize("felt", [[0.0, 0.0, 0.0], [0.0, -30.0, 0.0], [0.0, -2.0, 0.0]])
def test_what_is_no_gravity_tells_nothing(felt: list[float]) -> None:
    gravity = GravityFilter()
    gravity.add(1.0, np.array(felt))
    assert gravity.down(1.0) is None


def test_what_is_old_or_no_number_tells_nothing() -> None:
    gravity = GravityFilter()
    assert gravity.down(0.0) is None
    gravity.add(1.0, np.array([0.0, np.nan, 0.0]))
    gravity.add(float("nan"), np.array([0.0, -9.81, 0.0]))
    assert gravity.down(1.0) is None
    gravity.add(2.0, np.array([0.0, -9.81, 0.0]))
    gravity.add(1.5, np.array([-9.81, 0.0, 0.0]))
    assert gravity.down(2.0) == pytest.approx([0.0, 1.0, 0.0])
    assert gravity.down(2.0 + FRESH_FOR_S + 0.1) is None
    # After a gap the mean begins anew.
    gravity.add(9.0, np.array([-9.81, 0.0, 0.0]))
    assert gravity.down(9.0) == pytest.approx([1.0, 0.0, 0.0])
