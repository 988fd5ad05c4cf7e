"""What is said of coverage: what lasts is said, nothing nags, and a good walk is not talked into."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from navcore.coverage import APART_S, GOOD_NEWS, HOLD_S, Advice, Coverage, Sight, advise, troubles_in
from navcore.cues.texts import TEXTS
from navcore.settings import MapWalkSettings

SETTINGS = MapWalkSettings()
GOOD = {"tracked": True, "landmark_count": 250, "tilt_rad": math.radians(-15.0)}
TROUBLES = {
    Advice.COVERED: {"valid_depth_share": 0.0, "brightness": 0.0, "contrast": 0.0},
    Advice.DARK: {"brightness": 0.03},
    Advice.LOST: {"tracked": False, "landmark_count": 0},
    Advice.SLOW_DOWN: {"turn_rad_s": math.radians(120.0)},
    Advice.LOOK_AHEAD: {"tilt_rad": math.radians(-60.0)},
    Advice.WEAK: {"landmark_count": 30},
}


def sights(seconds: float, begin_s: float = 0.0, **changes: object) -> list[Sight]:
    return [Sight(begin_s + k / 10.0, **{**GOOD, **changes}) for k in range(round(10 * seconds))]


def told(walk: Iterable[Sight]) -> list[tuple[float, Advice]]:
    coverage, found = Coverage(), []
    for sight in walk:
        advice, coverage = advise(sight, coverage, SETTINGS)
        if advice is not None:
            found.append((sight.stamp_s, advice))
    return found


def test_every_advice_has_words_in_both_languages() -> None:
    for language in ("en", "zh"):
        assert all(TEXTS[language][f"map_walk_{advice.value}"] for advice in Advice)
    assert set(HOLD_S) == set(TROUBLES) == set(Advice) - GOOD_NEWS


def test_a_good_walk_is_not_talked_into() -> None:
    assert told(sights(60.0)) == []


@pytest.mark.parametrize("advice", TROUBLES)
def test_a_trouble_is_said_once_it_has_lasted_and_again_only_after_a_while(advice: Advice) -> None:
    found = told(sights(25.0, **TROUBLES[advice]))
    assert {each for _, each in found} == {advice}
    times_s = [stamp_s for stamp_s, _ in found]
    assert times_s[0] == pytest.approx(HOLD_S[advice], abs=0.11)
    assert len(times_s) == 3
    assert all(b - a == pytest.approx(SETTINGS.repeat_s, abs=0.11) for a, b in itertools.pairwise(times_s))


@pytest.mark.parametrize("advice", TROUBLES)
def test_a_moment_of_trouble_is_not_said(advice: Advice) -> None:
    walk = [*sights(5.0), *sights(HOLD_S[advice] - 0.1, 5.0, **TROUBLES[advice]), *sights(10.0, 5.0 + HOLD_S[advice])]
    assert told(walk) == []


def test_short_gaps_do_not_hide_a_trouble_that_comes_and_goes() -> None:
    flickering = [
        Sight(k / 10.0, **{**GOOD, "landmark_count": 30 if k % 5 else 200}) for k in range(60)
    ]  # fmt: skip
    assert [advice for _, advice in told(flickering)] == [Advice.WEAK]


def test_the_cause_is_said_and_not_what_follows_from_it() -> None:
    dark_and_lost = {**TROUBLES[Advice.LOST], **TROUBLES[Advice.DARK]}
    assert {advice for _, advice in told(sights(20.0, **dark_and_lost))} == {Advice.DARK}
    at_the_floor = {**TROUBLES[Advice.WEAK], **TROUBLES[Advice.LOOK_AHEAD]}
    assert {advice for _, advice in told(sights(20.0, **at_the_floor))} == {Advice.LOOK_AHEAD}


def test_few_far_features_are_seen_without_an_accelerometer() -> None:
    near = Sight(0.0, **{**GOOD, "tilt_rad": None, "far_share": 0.0})
    assert troubles_in(near, SETTINGS) == {Advice.LOOK_AHEAD}


def test_good_news_come_once_when_a_loop_closes_and_when_the_place_is_found_again() -> None:
    assert [a for _, a in told([*sights(5.0), *sights(5.0, 5.0, loop_count=1)])] == [Advice.LOOP]
    walk = [*sights(2.0), *sights(6.0, 2.0, **TROUBLES[Advice.LOST]), *sights(6.0, 8.0)]
    assert [a for _, a in told(walk)] == [Advice.LOST, Advice.FOUND]


def test_what_makes_the_map_worse_is_noted_as_long_as_it_lasts() -> None:
    coverage, noted = Coverage(), []
    for sight in [*sights(3.0), *sights(5.0, 3.0, landmark_count=30), *sights(5.0, 8.0)]:
        _, coverage = advise(sight, coverage, SETTINGS)
        noted += [sight.stamp_s] if coverage.gaps else []
    assert min(noted) == pytest.approx(5.0, abs=0.11)
    assert 7.9 <= max(noted) <= 9.0


@given(st.lists(st.sampled_from([None, *TROUBLES]), min_size=1, max_size=60))
def test_whatever_happens_there_is_time_between_two_sentences(seconds: list[Advice | None]) -> None:
    walk = [
        sight for k, advice in enumerate(seconds) for sight in sights(1.0, float(k), **TROUBLES.get(advice, {}))
    ]  # fmt: skip
    found = told(walk)
    pairs = list(itertools.pairwise(found))
    assert all(b[0] - a[0] >= APART_S - 1e-6 for a, b in pairs if b[1] not in GOOD_NEWS)
    for advice in TROUBLES:
        times_s = [stamp_s for stamp_s, each in found if each is advice]
        assert all(b - a >= SETTINGS.repeat_s - 1e-6 for a, b in itertools.pairwise(times_s))
