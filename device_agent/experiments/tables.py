"""The figures of all walks as one table, beside the paper's Tables I and II: as CSV, and as Markdown to read."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from device_agent.experiments.design import EXPERIMENTS, PATHS, POLICIES, SIGHTS
from device_agent.experiments.running import RATE_HZ, SIZE_PX, Figures


@dataclass(frozen=True, slots=True)
class Printed:
    """A row of the paper: of the deviation from the path its maximum (m), mean (m) and variance (m²)."""

    max_m: float
    mean_m: float
    variance_m2: float


PAPER: dict[tuple[int, str, str], Printed] = {
    (1, "A→B", "partially sighted"): Printed(0.2622, 0.0967, 0.0054),
    (1, "A→B", "totally blind"): Printed(0.3045, 0.1523, 0.0086),
    (1, "D→C", "partially sighted"): Printed(0.3496, 0.1124, 0.0083),
    (1, "D→C", "totally blind"): Printed(0.4369, 0.1938, 0.0085),
    (1, "E→B", "partially sighted"): Printed(0.6991, 0.1152, 0.0127),
    (1, "E→B", "totally blind"): Printed(0.6991, 0.2249, 0.0162),
    (2, "A→B", "partially sighted"): Printed(1.1394, 0.1553, 0.0274),
    (2, "A→B", "totally blind"): Printed(0.9033, 0.2920, 0.0486),
    (2, "D→C", "partially sighted"): Printed(0.7609, 0.0984, 0.0185),
    (2, "D→C", "totally blind"): Printed(1.3431, 0.2960, 0.0434),
    (2, "E→B", "partially sighted"): Printed(1.0821, 0.1692, 0.0321),
    (2, "E→B", "totally blind"): Printed(1.0765, 0.2897, 0.0465),
}
"""Tables I and II: by experiment, path and walker."""


@dataclass(frozen=True, slots=True)
class Row:
    """All walks of one experiment, path, walker and policy. NaN: no walk had the figure."""

    experiment: int
    path: str
    sight: str
    policy: str
    walks: int
    arrived: int
    contacts: int
    largest_m: float
    """The largest deviation of any walk."""
    max_m: float
    """The mean of the walks' maxima: what one walk shows, as the paper's rows do."""
    mean_m: float
    variance_m2: float
    seconds: float
    stopped_s: float
    localization_rmse_m: float


def rows(figures: Iterable[Figures]) -> list[Row]:
    """Return a row for each combination that was walked, in the order of the paper's tables."""
    by_row: dict[tuple[int, str, str, str], list[Figures]] = {}
    for each in figures:
        by_row.setdefault((each.experiment, each.path, each.sight, each.policy), []).append(each)
    order = [
        (experiment, path.name, sight, policy)
        for experiment in EXPERIMENTS
        for path in PATHS
        for sight in SIGHTS
        for policy in POLICIES
    ]
    return [_row(key, by_row[key]) for key in order if key in by_row]


Forced = Mapping[tuple[str, str], float]
"""By path and walker: the mean distance, metres, that the course forces (:mod:`device_agent.experiments.least`)."""


def as_csv(table: Sequence[Row], forced: Forced) -> str:
    """Return the table, with the paper's figures, and what the courses force, in the last columns."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*Row.__slots__, "paper_max_m", "paper_mean_m", "paper_variance_m2", "forced_mean_m"])
    for row in table:
        printed = PAPER[row.experiment, row.path, row.sight]
        values = [getattr(row, name) for name in Row.__slots__]
        least_m = forced.get((row.path, row.sight), math.nan) if row.experiment == 2 else math.nan
        writer.writerow(
            [*map(_cell, values), printed.max_m, printed.mean_m, printed.variance_m2, _cell(least_m)]
        )  # fmt: skip
    return out.getvalue()


def as_markdown(table: Sequence[Row], forced: Forced, seeds: Sequence[int], command: str) -> str:
    """Return a page: how it was measured, a table for each experiment, and what went wrong."""
    parts = [_preface(seeds, command)]
    for experiment in EXPERIMENTS:
        chosen = [row for row in table if row.experiment == experiment]
        if chosen:
            parts.append(_section(experiment, chosen, forced if experiment == 2 else {}))
    return "\n".join(parts)


def _preface(seeds: Sequence[int], command: str) -> str:
    width, height = SIZE_PX
    return f"""# The paper's experiments, walked in the closed loop

`{command}` — {len(seeds)} walkers (seeds {min(seeds)} to {max(seeds)}), each on every path, as a totally blind and as a
partially sighted person, with both policies. The walkers are models (`device_agent/simulation/walker.py` names the
source of each parameter); the paper's rows are people, one walk each, in another building. What the device does is real
in every cycle: rendered colour and depth pictures with the sensors' noise, localization in a map that was built from
another walk, guidance, cues. So that a batch ends in hours, the pictures have {width}×{height} pixels, and there are
{RATE_HZ:g} in a second.

Deviations are distances of the true path from the planned one, in metres: for each walk the maximum, the mean and the
variance over time, then the mean of those over the walks; and the largest of all.
"""


def _section(experiment: int, table: Sequence[Row], forced: Forced) -> str:
    number, title = ("I", "without obstacles") if experiment == 1 else ("II", "with obstacles")
    lines = [
        f"## Experiment {experiment}: {title} (the paper's Table {number})",
        "",
        "| path | walker | policy | arrived | contacts | max | mean | variance | largest | time, standing |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for index, row in enumerate(table):
        if index == 0 or (table[index - 1].path, table[index - 1].sight) != (row.path, row.sight):
            printed = PAPER[experiment, row.path, row.sight]
            lines.append(
                f"| {row.path} | {row.sight} | *the paper* | | | {printed.max_m:.2f} m | {printed.mean_m:.3f} m |"
                f" {printed.variance_m2:.4f} m² | | |"
            )
            least_m = forced.get((row.path, row.sight), math.nan)
            if not math.isnan(least_m):
                lines.append(f"| {row.path} | {row.sight} | *forced* | | | | {least_m:.3f} m | | | |")
        lines.append(
            f"| {row.path} | {row.sight} | `{row.policy}` | {row.arrived} of {row.walks} | {row.contacts} |"
            f" {row.max_m:.2f} m | {row.mean_m:.3f} m | {row.variance_m2:.4f} m² | {row.largest_m:.2f} m |"
            f" {row.seconds:.0f} s, {row.stopped_s:.0f} s |"
        )
    if forced:
        lines += ["", _FORCED]
    return "\n".join([*lines, ""])


_FORCED = """*forced*: the mean that the course leaves to the same walkers if everything were known beforehand, and no
turn and no step were ever lost: the least line that keeps half of a person's corridor from all that stands there, and
the walkers' own sway on it, as they sway where nothing stands (`device_agent/experiments/least.py`). People who walk
are left out of it."""


def _row(key: tuple[int, str, str, str], walks: Sequence[Figures]) -> Row:
    experiment, path, sight, policy = key
    return Row(
        experiment,
        path,
        sight,
        policy,
        walks=len(walks),
        arrived=sum(walk.arrived for walk in walks),
        contacts=sum(walk.contacts for walk in walks),
        largest_m=max((walk.deviation_max_m for walk in walks if walk.deviation_max_m is not None), default=math.nan),
        max_m=_mean(walk.deviation_max_m for walk in walks),
        mean_m=_mean(walk.deviation_mean_m for walk in walks),
        variance_m2=_mean(walk.deviation_variance_m2 for walk in walks),
        seconds=_mean(walk.seconds for walk in walks),
        stopped_s=_mean(walk.stopped_s for walk in walks),
        localization_rmse_m=_mean(walk.localization_rmse_m for walk in walks),
    )


def _mean(values: Iterable[float | None]) -> float:
    known = [value for value in values if value is not None]
    return fmean(known) if known else math.nan


def _cell(value: object) -> object:
    return round(value, 4) if isinstance(value, float) else value
