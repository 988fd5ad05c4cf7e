"""Which key frames look like this image: a bag of binary words, trained on the map itself.

The vocabulary is a tree of 16 × 16 × 16 words; a word's centre is the bitwise majority of its descriptors (k-majority,
the binary counterpart of k-means). Images are compared as DBoW2 does (Gálvez-López and Tardós 2012): weights tf · idf,
score Σ min(v, w) over L1-normalized vectors, 1 for equal images and 0 for images without a common word.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navcore.compiled import kernel
from navcore.geometry import FloatArray
from navcore.slam.descriptors import WordArray, as_words, bit_distance
from navcore.slam.keyframes import ByteArray, IntArray

BRANCHES = 16
"""Children of each node."""
LEVELS = 3
"""Levels of the tree below its root."""
WORD_COUNT = BRANCHES**LEVELS
TRAINING_LIMIT = 40_000
"""Descriptors that are enough to train on; of more, a random sample is taken."""
_ROUNDS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Vocabulary:
    """A tree of binary words. Immutable; written and read as one array."""

    centres: ByteArray
    """(16 + 256 + 4096, 32): centres level by level; children of node n of a level are 16 n … 16 n + 15 of the next."""

    @staticmethod
    def train(descriptors: ByteArray, seed: int = 0) -> Vocabulary:
        """Train on descriptors (n, 32), n ≥ 1; the same input and seed give the same words."""
        rng = np.random.default_rng(seed)
        if len(descriptors) > TRAINING_LIMIT:
            descriptors = descriptors[np.sort(rng.permutation(len(descriptors))[:TRAINING_LIMIT])]
        words = as_words(descriptors)
        levels: list[WordArray] = []
        node_of = np.zeros(len(words), np.int64)
        for level in range(LEVELS):
            order = rng.permutation(len(words))
            centres = _train_level(words, node_of, order, BRANCHES**level)
            node_of = _descend(words, node_of, centres)
            levels.append(centres)
        return Vocabulary(np.concatenate(levels).view(np.uint8).reshape(-1, 32))

    def words(self, descriptors: ByteArray) -> IntArray:
        """Return the word (n,) of each descriptor (n, 32)."""
        return _quantize(as_words(descriptors), as_words(self.centres))

    def bag(self, descriptors: ByteArray) -> tuple[IntArray, IntArray]:
        """Return the words that occur, ascending, and how often each does."""
        found, counts = np.unique(self.words(descriptors), return_counts=True)
        return found.astype(np.int32), counts.astype(np.int32)


class PlaceIndex:
    """The images seen so far, as bags of words; grows image by image."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self._ids: list[int] = []
        self._words = np.zeros(0, np.int32)
        self._counts = np.zeros(0, np.int32)
        self._end = np.zeros(1, np.int64)
        self._images_with_word = np.zeros(WORD_COUNT, np.int64)
        self._idf = np.zeros(WORD_COUNT)
        self._weights = np.zeros(0, np.float64)
        self._weighted = 0

    def __len__(self) -> int:
        return len(self._ids)

    @property
    def ids(self) -> IntArray:
        """The identifiers (n,) of the images, in the order in which they were added."""
        return np.array(self._ids, dtype=np.int32)

    def add(self, image_id: int, descriptors: ByteArray) -> None:
        """Add an image by its descriptors (n, 32)."""
        words, counts = self.vocabulary.bag(descriptors)
        start = int(self._end[len(self._ids)])
        end = start + len(words)
        if end > len(self._words):
            self._words = _grown(self._words, 2 * end)
            self._counts = _grown(self._counts, 2 * end)
        if len(self._ids) + 2 > len(self._end):
            self._end = np.concatenate([self._end, np.zeros(len(self._end), np.int64)])
        self._words[start:end] = words
        self._counts[start:end] = counts
        self._ids.append(image_id)
        self._end[len(self._ids)] = end
        self._images_with_word[words] += 1

    def scores(self, descriptors: ByteArray) -> FloatArray:
        """Return the likeness (n,) of each image, in the order of ``ids``, to the descriptors (m, 32): 0 to 1."""
        self._weigh()
        words, counts = self.vocabulary.bag(descriptors)
        weights = np.zeros(WORD_COUNT)
        weights[words] = counts * self._idf[words]
        total = weights.sum()
        if total <= 0.0:
            return np.zeros(len(self._ids))
        return _scores(weights / total, self._words, self._weights, self._end[: len(self._ids) + 1])

    def _weigh(self) -> None:
        """Weigh the words of all images by their rarity, anew only when the index has grown by a tenth."""
        count = len(self._ids)
        if count > 1.1 * self._weighted or count < self._weighted:
            # A word that no image has yet is as rare as one that a single image has.
            self._idf = np.log((1.0 + count) / np.maximum(self._images_with_word, 1))
            self._weighted = count
            self._weights = np.zeros(0)
        start, end = len(self._weights), int(self._end[count])
        if start < end:
            first = int(np.searchsorted(self._end[: count + 1], start))
            fresh = _image_weights(self._words, self._counts, self._end[first : count + 1], self._idf)
            self._weights = np.concatenate([self._weights, fresh])

    def query(self, descriptors: ByteArray, k: int, excluded: IntArray | None = None) -> tuple[IntArray, FloatArray]:
        """Return the k images most like the descriptors (m, 32), best first, and their scores; of equals the older."""
        scores = self.scores(descriptors)
        ids = self.ids
        if excluded is not None and len(excluded):
            keep = ~np.isin(ids, excluded)
            ids, scores = ids[keep], scores[keep]
        order = np.argsort(-scores, kind="stable")[:k]
        order = order[scores[order] > 0.0]
        return ids[order], scores[order]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything as arrays, to be stored."""
        count = len(self._ids)
        end = int(self._end[count])
        return {
            "vocabulary": self.vocabulary.centres,
            "image_ids": self.ids,
            "image_end": self._end[: count + 1].copy(),
            "image_words": self._words[:end].copy(),
            "image_word_counts": self._counts[:end].copy(),
        }

    @staticmethod
    def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> PlaceIndex:
        """Read back what :meth:`arrays` gave. Raises KeyError for a missing array, ValueError for a wrong shape."""
        centres = np.ascontiguousarray(arrays["vocabulary"], dtype=np.uint8)
        words, counts = arrays["image_words"], arrays["image_word_counts"]
        end, ids = arrays["image_end"], arrays["image_ids"]
        expected = sum(BRANCHES ** (level + 1) for level in range(LEVELS))
        consistent = (
            len(end) == len(ids) + 1
            and end[0] == 0
            and np.all(np.diff(end) >= 0)
            and end[-1] == len(words) == len(counts)
        )
        if centres.shape != (expected, 32) or not consistent:
            raise ValueError("the arrays of the place index do not fit together")
        if len(words) and (words.min() < 0 or words.max() >= WORD_COUNT):
            raise ValueError("the place index names words that the vocabulary does not have")
        index = PlaceIndex(Vocabulary(centres))
        index._ids = [int(i) for i in ids]
        index._words = np.array(words, dtype=np.int32)
        index._counts = np.array(counts, dtype=np.int32)
        index._end = np.array(end, dtype=np.int64)
        index._images_with_word = np.bincount(index._words, minlength=WORD_COUNT).astype(np.int64)
        return index


def _grown(array: IntArray, capacity: int) -> IntArray:
    grown = np.zeros(capacity, np.int32)
    grown[: len(array)] = array
    return grown


# --------------------------------------------------------------------------------------------------- kernels
@kernel
def _nearest(word: WordArray, centres: WordArray, first: int) -> int:
    best, best_distance = first, 1 << 20
    for c in range(first, first + BRANCHES):
        d = bit_distance(word, centres[c])
        if d < best_distance:
            best, best_distance = c, d
    return best


@kernel
def _descend(words: WordArray, node_of: NDArray[np.int64], centres: WordArray) -> NDArray[np.int64]:
    """Return the child (n,) of its node that each descriptor is nearest to."""
    out = np.empty_like(node_of)
    for i in range(len(words)):
        out[i] = _nearest(words[i], centres, node_of[i] * BRANCHES)
    return out


@kernel
def _train_level(words: WordArray, node_of: NDArray[np.int64], order: NDArray[np.int64], nodes: int) -> WordArray:
    """Return the centres (16 · nodes, 4) of the children of each node."""
    centres = _first_centres(words, node_of, order, nodes)
    ones = np.zeros((len(centres), 256), np.int32)
    members = np.zeros(len(centres), np.int32)
    for _ in range(_ROUNDS):
        ones[:] = 0
        members[:] = 0
        for i in range(len(words)):
            child = _nearest(words[i], centres, node_of[i] * BRANCHES)
            members[child] += 1
            for w in range(4):
                value = words[i, w]
                for b in range(64):
                    ones[child, 64 * w + b] += np.int32((value >> np.uint64(b)) & np.uint64(1))
        _take_majority(ones, members, centres)
    return centres


@kernel
def _first_centres(words: WordArray, node_of: NDArray[np.int64], order: NDArray[np.int64], nodes: int) -> WordArray:
    """Start every child at a random descriptor of its node; a node with fewer descriptors repeats them."""
    centres = np.zeros((nodes * BRANCHES, 4), np.uint64)
    started = np.zeros(nodes, np.int64)
    for i in order:
        node = node_of[i]
        if started[node] < BRANCHES:
            centres[node * BRANCHES + started[node]] = words[i]
            started[node] += 1
    for node in range(nodes):
        distinct = max(started[node], 1)
        for c in range(distinct, BRANCHES):
            centres[node * BRANCHES + c] = centres[node * BRANCHES + c % distinct]
    return centres


@kernel
def _take_majority(ones: IntArray, members: IntArray, centres: WordArray) -> None:
    """Set each centre that has members to the majority of their bits."""
    for child in range(len(centres)):
        if members[child] == 0:
            continue
        for w in range(4):
            value = np.uint64(0)
            for b in range(64):
                if 2 * ones[child, 64 * w + b] > members[child]:
                    value |= np.uint64(1) << np.uint64(b)
            centres[child, w] = value


@kernel
def _quantize(words: WordArray, centres: WordArray) -> IntArray:
    out = np.empty(len(words), np.int32)
    for i in range(len(words)):
        node, level_start, level_size = 0, 0, BRANCHES
        for _ in range(LEVELS):
            node = _nearest(words[i], centres, level_start + node * BRANCHES) - level_start
            level_start += level_size
            level_size *= BRANCHES
        out[i] = node
    return out


@kernel
def _image_weights(words: IntArray, counts: IntArray, end: NDArray[np.int64], idf: FloatArray) -> FloatArray:
    """Return the weights of the words of successive images, each image's adding up to 1."""
    out = np.zeros(end[-1] - end[0])
    for image in range(len(end) - 1):
        total = 0.0
        for e in range(end[image], end[image + 1]):
            total += counts[e] * idf[words[e]]
        for e in range(end[image], end[image + 1]):
            if total > 0.0:
                out[e - end[0]] = counts[e] * idf[words[e]] / total
    return out


@kernel
def _scores(query: FloatArray, words: IntArray, weights: FloatArray, end: NDArray[np.int64]) -> FloatArray:
    scores = np.zeros(len(end) - 1)
    for image in range(len(end) - 1):
        common = 0.0
        for e in range(end[image], end[image + 1]):
            common += min(query[words[e]], weights[e])
        scores[image] = common
    return scores


def warm_up() -> None:
    """Compile this module's kernels."""
    descriptors = np.arange(64 * 32, dtype=np.uint8).reshape(64, 32)
    index = PlaceIndex(Vocabulary.train(descriptors))
    index.add(0, descriptors[:32])
    index.query(descriptors[:8], 1)
