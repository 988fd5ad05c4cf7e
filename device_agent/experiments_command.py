"""``vbr experiments``: the paper's section V, walked by model walkers in the closed loop."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from device_agent.experiments.design import Trial
    from device_agent.experiments.running import Figures
    from navcore.settings import Settings

_MEMORY_OF_A_WALK_BYTES = 1.5e9


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr experiments``."""
    parser = subparsers.add_parser(
        "experiments",
        help="the paper's experiments in simulation: table and pictures",
        description="Walk the paper's paths with model walkers, with and without obstacles, with both policies. A walk"
        " takes about ten seconds; what is done is kept, and a batch that is stopped goes on where it was.",
    )
    parser.add_argument("--seeds", type=_count, default=20, metavar="N", help="walkers (default: %(default)s)")
    parser.add_argument("--first-seed", type=int, default=None, metavar="N", help="seed of the first (default: 12100)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where table, pictures and walks go")
    parser.add_argument("--jobs", type=_count, default=None, metavar="N", help="walks at a time (default: one a core)")
    parser.add_argument("--policy", choices=("paper", "road_centred"), help="only this policy")
    parser.add_argument("--experiment", type=int, choices=(1, 2), help="only without (1) or with (2) obstacles")
    parser.add_argument("--path", choices=("AB", "DC", "EB"), help="only this path")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="change a setting")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from device_agent.demo_site import prepare_demo_site
    from device_agent.experiments.design import FIRST_REPORTING_SEED, trials
    from device_agent.experiments.running import RATE_HZ, SIZE_PX, digest, kept, run_all
    from device_agent.progress import progress_bar
    from navcore.settings import Settings, parse_assignment

    settings = Settings().changed(dict(parse_assignment(text) for text in arguments.set))
    first = FIRST_REPORTING_SEED if arguments.first_seed is None else arguments.first_seed
    seeds = range(first, first + arguments.seeds)
    out: Path = arguments.out
    site = prepare_demo_site(out / "map", SIZE_PX, RATE_HZ)
    wanted = [trial for trial in trials(seeds) if _is_asked_for(trial, arguments)]
    stamp, walks = digest(site, settings), out / "walks"
    done = {trial.key: figures for trial in wanted if (figures := kept(walks, trial, stamp)) is not None}
    todo = [trial for trial in wanted if trial.key not in done]
    with progress_bar(f"{len(wanted)} walks") as report:

        def take(figures: Figures) -> None:
            done[figures.key] = figures
            report(len(done), len(wanted))

        run_all(todo, site, walks, settings, arguments.jobs or _jobs(), take)
    _write(out, [done[trial.key] for trial in wanted], list(seeds), _command(arguments, first), settings)
    return 0


def _write(out: Path, figures: list[Figures], seeds: list[int], command: str, settings: Settings) -> None:
    from device_agent.experiments.least import forced_means_m
    from device_agent.experiments.pictures import draw_all
    from device_agent.experiments.tables import as_csv, as_markdown, rows

    table = rows(figures)
    forced = forced_means_m(figures, settings.obstacle.person_width_m / 2.0)
    (out / "experiments.csv").write_text(as_csv(table, forced), encoding="utf-8")
    (out / "experiments.md").write_text(as_markdown(table, forced, seeds, command), encoding="utf-8")
    pictures = draw_all(figures, out)
    failed = [walk for walk in figures if not walk.arrived or walk.contacts]
    for walk in failed:
        print(f"{walk.key}: {walk.contacts} contacts, {walk.outcome}")  # noqa: T201 - the command's answer
    print(  # noqa: T201 - the command's answer
        f"{len(figures)} walks, {len(failed)} of them with a contact or without arrival;"
        f" {out / 'experiments.md'}, experiments.csv and {len(pictures)} pictures beside it."
    )


def _is_asked_for(trial: Trial, arguments: argparse.Namespace) -> bool:
    return (
        arguments.policy in (None, trial.policy)
        and arguments.experiment in (None, trial.experiment)
        and arguments.path in (None, trial.path.name.replace("→", ""))
    )


def _command(arguments: argparse.Namespace, first: int) -> str:
    changes = "".join(f" --set {text}" for text in arguments.set)
    return f"vbr experiments --seeds {arguments.seeds} --first-seed {first}{changes} --out {arguments.out.name}"


def _jobs() -> int:
    """As many as there are cores, and memory for."""
    memory_bytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return max(1, min(len(os.sched_getaffinity(0)), int(memory_bytes / _MEMORY_OF_A_WALK_BYTES)))


def _count(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of one or more")
    return value
