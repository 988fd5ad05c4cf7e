"""Where a recorded walk was not seen well: from ``coverage.txt`` of its recording to stretches of the road."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from navcore.coverage import Advice
from navcore.errors import RecordingError
from navcore.geometry import FloatArray
from navcore.recorded_files import is_number

JOINED_WITHIN_S = 2.0
"""Troubles that follow each other this closely are one stretch."""
MIN_LENGTH_M = 0.5
"""What was wrong while somebody stood still is no stretch."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """One frame that was not seen well."""

    stamp_s: float
    kind: Advice


@dataclass(frozen=True, slots=True)
class WeakStretch:
    """A part of the walk that was not seen well."""

    from_m: float
    """Way from the beginning of the walk, along what was walked."""
    length_m: float
    x_m: float
    y_m: float
    """Where it begins, in the map."""
    kinds: tuple[str, ...]
    """What was wrong (:class:`navcore.coverage.Advice`)."""


def read_coverage(path: Path) -> tuple[Trouble, ...]:
    """Read ``coverage.txt``, lines of ``t kind``; empty where there is none. Raises RecordingError with the line."""
    if not path.exists():
        return ()
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read: remove it, or write lines of 't kind' in UTF-8.") from error
    kinds = {advice.value: advice for advice in Advice}
    troubles: list[Trouble] = []
    for number, line in enumerate(lines, 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if len(words) != 2 or not is_number(words[0]) or words[1] not in kinds:
            raise RecordingError(f"{path}, line {number}: expected 't kind', found {line.strip()!r}.")
        troubles.append(Trouble(float(words[0]), kinds[words[1]]))
    return tuple(sorted(troubles, key=lambda trouble: trouble.stamp_s))


def weak_stretches(
    troubles: Sequence[Trouble], stamps_s: FloatArray, positions_m: FloatArray
) -> tuple[WeakStretch, ...]:
    """Return the stretches of a walk that were not seen well, in order.

    Args:
        troubles: in the order of their stamps.
        stamps_s: (n,) ascending, of the mapped trajectory.
        positions_m: (n, ≥ 2), where the camera was then; between them it went straight.
    """
    if not troubles or not len(stamps_s):
        return ()
    steps_m = np.hypot(*np.diff(positions_m[:, :2], axis=0).T)
    walked_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    found: list[WeakStretch] = []
    for together in _together(troubles):
        first_s, last_s = together[0].stamp_s, together[-1].stamp_s
        from_m, to_m = np.interp([first_s, last_s], stamps_s, walked_m).tolist()
        x_m, y_m = (float(np.interp(first_s, stamps_s, positions_m[:, axis])) for axis in (0, 1))
        kinds = tuple(advice.value for advice in Advice if any(each.kind is advice for each in together))
        if to_m - from_m >= MIN_LENGTH_M:
            found.append(WeakStretch(from_m, to_m - from_m, x_m, y_m, kinds))
    return tuple(found)


def _together(troubles: Sequence[Trouble]) -> list[list[Trouble]]:
    groups = [[troubles[0]]]
    for before, trouble in itertools.pairwise(troubles):
        if trouble.stamp_s - before.stamp_s > JOINED_WITHIN_S:
            groups.append([])
        groups[-1].append(trouble)
    return groups
