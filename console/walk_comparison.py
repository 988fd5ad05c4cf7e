"""A walk beside the earlier ones from and to the same places: what differs, and where it is going."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from console.past_walks import PastWalk
from console.walk_figures import WalkFigures

LEAST_FOR_TREND = 3
"""Two walks make no trend."""


class Line(msgspec.Struct, frozen=True):
    """One walk in the table."""

    walk_id: str
    began_at_s: float
    figures: WalkFigures


class Difference(msgspec.Struct, frozen=True):
    """This walk minus the mean of the earlier ones."""

    seconds: float | None
    standing_s: float | None
    stop_count: float | None
    mean_m: float | None
    max_m: float | None


class Compared(msgspec.Struct, frozen=True):
    """A walk and the earlier ones, oldest first; the walk itself is the last line."""

    lines: tuple[Line, ...]
    difference: Difference | None
    """None for the first walk of its way."""
    trend_m: float | None
    """By how much the mean deviation changes from one walk to the next (least squares); None for fewer than three."""


def compared_with(walk: PastWalk, others: Sequence[tuple[PastWalk, WalkFigures]]) -> Compared | None:
    """Return a walk beside the earlier ones of its way among ``others``, which holds it too; None where it does not."""
    own = next((figures for each, figures in others if each.walk_id == walk.walk_id), None)
    if own is None:
        return None
    way = (walk.site_id, own.from_place, own.to_place)
    same = [
        Line(each.walk_id, each.began_at_s, figures)
        for each, figures in others
        if (each.site_id, figures.from_place, figures.to_place) == way
        and (each.began_at_s, each.walk_id) < (walk.began_at_s, walk.walk_id)
    ]
    earlier = sorted(same, key=lambda line: (line.began_at_s, line.walk_id))
    lines = (*earlier, Line(walk.walk_id, walk.began_at_s, own))
    difference = _difference(own, [line.figures for line in earlier]) if earlier else None
    return Compared(lines, difference, _trend_m([line.figures.deviation.mean_m for line in lines]))


def _difference(own: WalkFigures, earlier: list[WalkFigures]) -> Difference:
    return Difference(
        seconds=_apart(own.seconds, [each.seconds for each in earlier]),
        standing_s=_apart(own.standing_s, [each.standing_s for each in earlier]),
        stop_count=_apart(own.stop_count, [each.stop_count for each in earlier]),
        mean_m=_apart(own.deviation.mean_m, [each.deviation.mean_m for each in earlier]),
        max_m=_apart(own.deviation.max_m, [each.deviation.max_m for each in earlier]),
    )


def _apart(own: float | None, earlier: Sequence[float | None]) -> float | None:
    known = [value for value in earlier if value is not None]
    return None if own is None or not known else own - sum(known) / len(known)


def _trend_m(means_m: Sequence[float | None]) -> float | None:
    known = [value for value in means_m if value is not None]
    if len(known) < LEAST_FOR_TREND:
        return None
    return float(np.polyfit(np.arange(len(known)), known, 1)[0])
