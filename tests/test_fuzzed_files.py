"""Spoiled files of every kind: read, or refused in a sentence; in little memory and time, and nothing else happens.

What was found once, here or by ``.ci/fuzz``, lies in ``tests/data/corpus/TARGET`` and is read again for ever.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest
from fuzz import targets_wire
from fuzz.confined import ConfinedReader
from fuzz.mutations import spoiled
from fuzz.targets import TARGETS
from hypothesis import given, settings
from hypothesis import strategies as st

CORPUS = Path(__file__).resolve().parent / "data" / "corpus"
MAX_KEPT_BYTES = 1 << 16


@pytest.fixture(scope="module")
def reader() -> Iterator[ConfinedReader]:
    confined = ConfinedReader()
    yield confined
    confined.close()


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_valid_is_read(reader: ConfinedReader, name: str) -> None:
    for seed in TARGETS[name].seeds:
        assert reader.read(name, seed).outcome == "read"


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=80, deadline=None)
@given(random=st.randoms(use_true_random=False), which=st.integers(0, 3))
def test_what_is_spoiled_is_read_or_refused(reader: ConfinedReader, name: str, random: Random, which: int) -> None:
    target = TARGETS[name]
    data = spoiled(target.seeds[which % len(target.seeds)], target.form, random)
    answer = reader.read(name, data)
    assert answer.outcome != "fault", f"{answer.text}\n\nof {data[:3000]!r}"


@pytest.mark.parametrize("name", TARGETS)
def test_what_was_found_once_is_never_found_again(reader: ConfinedReader, name: str) -> None:
    for path in sorted((CORPUS / name).glob("*")):
        answer = reader.read(name, path.read_bytes())
        assert answer.outcome != "fault", f"{path.name}: {answer.text}"


def test_the_corpus_is_small_and_of_targets_that_there_are() -> None:
    files = [path for path in CORPUS.rglob("*") if path.is_file()]
    assert {path.parent.name for path in files} <= {*TARGETS, *targets_wire.TARGETS}
    assert not [path.name for path in files if path.stat().st_size > MAX_KEPT_BYTES]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("hoards", "MiB of memory"), ("demands", "MemoryError"), ("never_ends", "too much of the processor"),
        ("breaks", "aborted"), ("leaks", "KeyError"), ("mumbles", "is no sentence"),
    ],
)  # fmt: skip
def test_a_reader_with_a_fault_is_found_out(name: str, told: str) -> None:
    reader = ConfinedReader("fuzz.traps", cpu_s=1)
    assert reader.read(name, b"good").outcome != "fault"
    answer = reader.read(name, b"bad")
    assert (answer.outcome, told in answer.text) == ("fault", True), answer.text
    assert reader.read(name, b"good").outcome != "fault", "the next file is read"
    reader.close()
