"""Place recognition: the right image first, repeatable, and stored without loss."""

from __future__ import annotations

import numpy as np
import pytest

from navcore.slam.place_recognition import WORD_COUNT, PlaceIndex, Vocabulary


def noisy(descriptors: np.ndarray, rng: np.random.Generator, share: float = 0.06) -> np.ndarray:
    bits = np.unpackbits(descriptors, axis=1)
    return np.packbits(bits ^ (rng.random(bits.shape) < share), axis=1)


@pytest.fixture(scope="module")
def places() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (300, 32), dtype=np.uint8) for _ in range(40)]


@pytest.fixture(scope="module")
def index(places: list[np.ndarray]) -> PlaceIndex:
    index = PlaceIndex(Vocabulary.train(np.concatenate(places), seed=3))
    for k, descriptors in enumerate(places):
        index.add(100 + k, descriptors)
    return index


def test_a_noisy_part_of_an_image_finds_it_again(places: list[np.ndarray], index: PlaceIndex) -> None:
    rng = np.random.default_rng(1)
    found = 0
    for k, descriptors in enumerate(places):
        ids, scores = index.query(noisy(descriptors[rng.permutation(300)[:200]], rng), 5)
        assert np.all(np.diff(scores) <= 0)
        found += int(100 + k in ids)
    assert found >= 38


def test_an_image_is_most_like_itself(places: list[np.ndarray], index: PlaceIndex) -> None:
    ids, scores = index.query(places[7], 1)
    assert ids[0] == 107
    assert scores[0] == pytest.approx(1.0)


def test_excluded_images_are_not_answered(places: list[np.ndarray], index: PlaceIndex) -> None:
    ids, _ = index.query(places[7], 40, excluded=np.array([107, 108], np.int32))
    assert 107 not in ids
    assert 108 not in ids


def test_training_is_repeatable_and_depends_on_the_seed(places: list[np.ndarray]) -> None:
    descriptors = np.concatenate(places[:5])
    assert np.array_equal(Vocabulary.train(descriptors, 1).centres, Vocabulary.train(descriptors, 1).centres)
    assert not np.array_equal(Vocabulary.train(descriptors, 1).centres, Vocabulary.train(descriptors, 2).centres)


def test_words_are_in_range_and_few_descriptors_suffice() -> None:
    descriptors = np.random.default_rng(2).integers(0, 256, (3, 32), dtype=np.uint8)
    vocabulary = Vocabulary.train(descriptors)
    words = vocabulary.words(descriptors)
    assert np.all((words >= 0) & (words < WORD_COUNT))
    assert len(np.unique(words)) == 3


def test_what_is_stored_answers_the_same(places: list[np.ndarray], index: PlaceIndex) -> None:
    stored = {name: array.copy() for name, array in index.arrays().items()}
    again = PlaceIndex.from_arrays(stored)
    for descriptors in places[:5]:
        before, after = index.query(descriptors, 5), again.query(descriptors, 5)
        assert np.array_equal(before[0], after[0])
        assert np.array_equal(before[1], after[1])
    again.add(999, places[0])
    assert len(again) == len(index) + 1


@pytest.mark.parametrize("name", ["vocabulary", "image_end", "image_words"])
def test_damaged_arrays_are_refused(index: PlaceIndex, name: str) -> None:
    damaged = index.arrays()
    damaged[name] = damaged[name][:-1]
    with pytest.raises(ValueError, match="place index"):
        PlaceIndex.from_arrays(damaged)


def test_an_empty_index_answers_nothing(places: list[np.ndarray], index: PlaceIndex) -> None:
    ids, scores = PlaceIndex(index.vocabulary).query(places[0], 5)
    assert len(ids) == len(scores) == 0
