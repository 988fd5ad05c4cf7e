"""Directions in words: never the wrong side, never nothing, and no style so coarse that a turn would never end."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from navcore.cues.directions import (
    CLOCK_DEG,
    SIZES_DEG,
    hour,
    move_text,
    told_move_deg,
    told_turn_deg,
    turn_text,
)
from navcore.settings import Settings

STYLES = ("degrees", "clock", "sides")
SETTLED_DEG = Settings().follower.turn_settled_deg
directions_deg = st.floats(-180, 180).filter(lambda degrees: abs(degrees) > 1e-3)


@pytest.mark.parametrize("style", STYLES)
@given(direction_deg=directions_deg)
def test_a_turn_is_told_to_its_side_about_as_far_and_the_same_mirrored(style: str, direction_deg: float) -> None:
    told = told_turn_deg(math.radians(direction_deg), style)
    assert told * direction_deg > 0
    assert abs(told) <= 180
    assert abs(told - direction_deg) <= {"degrees": 10.0, "clock": 15.0, "sides": 22.5}[style] + 1e-9
    assert told_turn_deg(math.radians(-direction_deg), style) == -told
    for language, left, right in (("en", "left", "right"), ("zh", "左", "右")):
        text, mirrored = (turn_text(angle, style, language) for angle in (told, -told))
        if style != "clock" or abs(told) < 30.0 or abs(told) >= 155.0:
            assert (left in text) == (told > 0), "the side is said"
            assert mirrored == text.replace(*((left, right) if told > 0 else (right, left)))


@pytest.mark.parametrize("style", STYLES)
@given(direction_deg=directions_deg, gain=st.floats(0.93, 1.07))
def test_whoever_turns_as_told_is_settled_after_at_most_three_turns(
    style: str, direction_deg: float, gain: float
) -> None:
    """A turn that falls short or goes too far is told again; what is left gets smaller until nothing is told."""
    left_deg = direction_deg
    for _ in range(3):
        if abs(left_deg) <= SETTLED_DEG:
            break
        left_deg -= gain * told_turn_deg(math.radians(left_deg), style)
    assert abs(left_deg) <= SETTLED_DEG


@pytest.mark.parametrize("style", STYLES)
@given(direction_deg=st.floats(-90, 90), straight_deg=st.floats(2, 30))
def test_a_movement_is_told_straight_or_to_its_side(style: str, direction_deg: float, straight_deg: float) -> None:
    told = told_move_deg(math.radians(direction_deg), straight_deg, style)
    if abs(direction_deg) < straight_deg - 1e-6:
        assert told == 0.0
    elif abs(direction_deg) > straight_deg + 1e-6:
        assert told * direction_deg > 0
    assert (move_text(told, style, "en") == "Move forward.") == (told == 0.0)


@given(st.floats(10, 180))
def test_degrees_are_told_in_steps_of_five_to_the_nearest(degrees: float) -> None:
    for told in (told_turn_deg(math.radians(degrees), "degrees"), told_move_deg(math.radians(degrees), 5.0, "degrees")):
        assert told % 5.0 == 0.0
        assert abs(told - degrees) <= 2.5 + 1e-9


@pytest.mark.parametrize(("style", "angles"), [("clock", CLOCK_DEG), ("sides", tuple(SIZES_DEG.values()))])
@given(degrees=st.floats(0.1, 180))
def test_the_other_styles_tell_the_nearest_of_their_angles(
    style: str, angles: tuple[float, ...], degrees: float
) -> None:
    nearest_deg = min(abs(angle - degrees) for angle in angles)
    for told in (told_turn_deg(math.radians(degrees), style), told_move_deg(math.radians(degrees), 0.05, style)):
        assert told in angles
        assert abs(told - degrees) == pytest.approx(nearest_deg, abs=1e-6)


def test_the_angles_are_those_of_the_documents() -> None:
    assert CLOCK_DEG == (15.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
    assert tuple(SIZES_DEG.values()) == (15.0, 45.0, 90.0, 135.0, 180.0)
    assert told_turn_deg(math.radians(3.0), "degrees") == 10.0
    assert [turn_text(angle, "degrees", "en") for angle in (150.0, 155.0, -155.0)] == [
        "Turn left 150 degrees.", "Turn around to the left.", "Turn around to the right.",
    ]  # fmt: skip


@given(st.floats(-180, 180))
def test_the_clock_says_the_nearest_hour(angle_deg: float) -> None:
    said_deg = -30.0 * (hour(angle_deg) % 12)
    assert abs((said_deg - angle_deg + 180.0) % 360.0 - 180.0) <= 15.0 + 1e-9
    assert hour(0.0) == 12
    assert (hour(30.0), hour(-30.0), hour(90.0), hour(-90.0), hour(180.0)) == (11, 1, 9, 3, 6)


def test_the_words_of_each_style() -> None:
    assert turn_text(30.0, "degrees", "en") == "Turn left 30 degrees."
    assert turn_text(30.0, "clock", "en") == "Turn to 11 o'clock."
    assert turn_text(-90.0, "clock", "zh") == "转向3点钟方向。"
    assert turn_text(-15.0, "clock", "en") == "Turn slightly right."
    assert turn_text(-135.0, "sides", "en") == "Turn sharp right."
    assert turn_text(90.0, "sides", "zh") == "向左转。"
    assert move_text(15.0, "sides", "en") == "Move slightly left."
    assert {turn_text(180.0, style, "en") for style in STYLES} == {"Turn around to the left."}


@hypothesis_settings(deadline=None)
@given(directions_deg)
def test_an_angle_that_is_told_is_the_angle_of_the_words(direction_deg: float) -> None:
    """What the walker makes of the words alone is what the cue carries."""
    for style in STYLES:
        told = told_turn_deg(math.radians(direction_deg), style)
        text = turn_text(told, style, "en")
        assert understood_deg(text, told) == told, text


def understood_deg(text: str, around_deg: float) -> float:
    """Read a sentence as a listener does; "around" is as far as it is, up to half a turn."""
    sign = -1.0 if "right" in text else 1.0
    if "around" in text:
        return sign * abs(around_deg) if abs(around_deg) >= 155.0 else math.nan
    if match := re.search(r"(\d+) degrees", text):
        return sign * float(match[1])
    if match := re.search(r"(\d+) o'clock", text):
        hours = int(match[1])
        return 30.0 * (12 - hours) if hours > 6 else -30.0 * hours
    words = {"slightly": "slightly", "half": "half", "sharp": "sharp"}
    size = next((words[word] for word in words if word in text), "full")
    return sign * SIZES_DEG[size]


def test_the_smallest_word_is_finer_than_a_turn_needs_to_be() -> None:
    assert CLOCK_DEG[0] == SIZES_DEG["slightly"] < 2 * SETTLED_DEG
