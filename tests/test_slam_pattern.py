"""The descriptor's comparisons, and how they are chosen."""

import numpy as np

from benchmarks import train_pattern
from navcore.slam.corners import BORDER_PX
from navcore.slam.descriptors import turned_pattern
from navcore.slam.pattern import comparison_pattern


def test_turned_points_and_what_is_summed_around_them_lie_in_the_image() -> None:
    assert np.abs(turned_pattern()).max() + 2 <= BORDER_PX


def test_comparisons_differ_from_each_other() -> None:
    pairs = comparison_pattern().reshape(256, 4)
    assert len(np.unique(pairs, axis=0)) == 256
    assert np.hypot(*(pairs[:, :2] - pairs[:, 2:]).T.astype(float)).min() >= train_pattern.MIN_APART_PX


def _separation(pairs: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Return how far the distances of same and of different points lie apart, in units of their spread."""
    numbers = {tuple(point): i for i, point in enumerate(train_pattern.patch_points().tolist())}
    one, other = (np.array([numbers[tuple(point)] for point in pairs[:, k].tolist()]) for k in (0, 1))
    bits, again = (values[:, one] < values[:, other] for values in (first, second))
    same = np.count_nonzero(bits != again, axis=1)
    different = np.count_nonzero(bits != np.roll(again, len(again) // 2 + 1, axis=0), axis=1)
    return float((different.mean() - same.mean()) / np.sqrt(different.var() + same.var()))


def test_chosen_comparisons_tell_points_apart_better_than_random_ones_on_new_pictures() -> None:
    first, second = train_pattern.pairs_of_patches(seed=99, images=8)
    assert len(first) > 300
    points = train_pattern.patch_points()
    rng = np.random.default_rng(5)
    by_chance = [_separation(points[rng.integers(0, len(points), (256, 2))], first, second) for _ in range(5)]
    assert _separation(comparison_pattern(), first, second) > 1.05 * max(by_chance)


def test_selection_takes_what_says_something_new() -> None:
    rng = np.random.default_rng(6)
    count = 400
    columns = rng.random((count, 300)) < 0.5
    copies = np.repeat(columns[:, :1], 300, axis=1)
    different = np.concatenate([columns, copies], axis=1).astype(np.float32)
    same = (rng.random((count, 600)) < 0.1).astype(np.float32)
    taken = train_pattern.select(same, different)
    assert len(set(taken)) == 256
    assert np.count_nonzero(np.array(taken) >= 300) < 10
