"""The clocks' offset: wrong by no more than it says, whatever the network and the clocks do."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from console.clock_offset import DRIFT_S_PER_S, RESOLUTION_S, WINDOW_COUNT, ClockOffset

trip = st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.floats(0.0, 1.0))
"""The way there, the way back, and the time at the device, in seconds."""


def exchanged(
    clock: ClockOffset, now_s: float, offset_s: float, trip: tuple[float, float, float], drift: float = 0.0
) -> float:
    """Let a ping go and come back; return the console's time at the end."""
    there_s, back_s, held_s = trip

    def device(console_s: float) -> float:
        return console_s * (1.0 + drift) + offset_s

    came_s, went_s = now_s + there_s, now_s + there_s + held_s
    clock.add(now_s, device(came_s), device(went_s), went_s + back_s)
    return went_s + back_s


@given(st.floats(-1e6, 1e6), st.lists(trip, min_size=1, max_size=30))
def test_the_error_is_bounded_by_half_of_the_best_way_there_and_back(
    offset_s: float, trips: list[tuple[float, float, float]]
) -> None:
    clock = ClockOffset(offset_s, 0.0)
    now_s = 100.0
    for each in trips:
        now_s = exchanged(clock, now_s, offset_s, each) + 2.0
    best_s = min(there_s + back_s for there_s, back_s, _ in trips[-WINDOW_COUNT:])
    assert clock.round_trip_s == pytest.approx(best_s, abs=3 * RESOLUTION_S)
    assert clock.uncertainty_s is not None
    assert abs(clock.offset_s - offset_s) <= clock.uncertainty_s + RESOLUTION_S
    longest_s = WINDOW_COUNT * 13.0
    assert clock.uncertainty_s <= best_s / 2 + longest_s * DRIFT_S_PER_S + 3 * RESOLUTION_S


@given(st.floats(-0.5, 0.5), st.lists(trip, min_size=1, max_size=30))
def test_clocks_that_come_apart_stay_within_what_is_told(share: float, trips: list[tuple[float, float, float]]) -> None:
    drift = share * DRIFT_S_PER_S
    clock, now_s = ClockOffset(0.0, 0.0), 0.0
    for each in trips:
        now_s = exchanged(clock, now_s, 50.0, each, drift) + 2.0
        assert clock.uncertainty_s is not None
        true_s = 50.0 + drift * (now_s - 2.0)
        assert abs(clock.offset_s - true_s) <= clock.uncertainty_s + RESOLUTION_S


def test_the_worst_asymmetry_is_told_as_uncertainty() -> None:
    clock = ClockOffset(0.0, 0.0)
    exchanged(clock, 100.0, 7.0, (0.4, 0.0, 0.0))
    assert clock.offset_s - 7.0 == pytest.approx(0.2, abs=1e-9)
    assert clock.uncertainty_s == pytest.approx(0.2, abs=1e-3)


def test_the_answer_that_was_least_on_the_way_is_believed() -> None:
    clock = ClockOffset(0.0, 0.0)
    for each in ((0.5, 0.1, 0.0), (0.01, 0.01, 0.3), (0.1, 0.9, 0.0)):
        exchanged(clock, 100.0, 7.0, each)
    assert clock.offset_s == pytest.approx(7.0, abs=1e-9)
    assert clock.round_trip_s == pytest.approx(0.02, abs=1e-9)


def test_a_clock_that_jumps_is_believed_at_the_first_answer_that_proves_it() -> None:
    clock = ClockOffset(0.0, 0.0)
    for count in range(5):
        exchanged(clock, 100.0 + count, 7.0, (0.01, 0.01, 0.0))
    exchanged(clock, 110.0, 9.0, (0.3, 0.3, 0.0))
    assert clock.offset_s == pytest.approx(9.0, abs=1e-9)


@pytest.mark.parametrize("times_s", [(10.0, 20.0, 19.0, 10.1), (10.0, 20.0, 20.0, 9.0), (10.0, 20.0, 25.0, 11.0)])
def test_an_answer_that_cannot_be_true_changes_nothing(times_s: tuple[float, float, float, float]) -> None:
    clock = ClockOffset(12.0, 2.0)
    clock.add(*times_s)
    assert (clock.offset_s, clock.uncertainty_s, clock.round_trip_s) == (10.0, None, None)
