"""One walk of the experiments, and many of them on all cores; what is done stays done."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from device_agent.experiments.course import with_course, with_people_starting
from device_agent.experiments.design import Trial
from device_agent.simulation.building import Building, renderer_of
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.renderer import Renderer
from device_agent.walk import run_walk
from device_agent.walk_measures import WalkResult
from navcore.geometry import FloatArray
from navcore.settings import Settings
from navcore.site import Site, load_site, map_checksum

SIZE_PX = (320, 240)
RATE_HZ = 10.0
"""The batch runs at half the resolution and at a third of the rate of the device's camera, so that it ends in hours."""
_MAX_S = 240.0
_PATH_STEP_M = 0.1


@dataclass(frozen=True, slots=True)
class Figures:
    """What is kept of a walk. Metres, seconds; None where a figure could not be had."""

    key: str
    experiment: int
    policy: str
    path: str
    sight: str
    seed: int
    arrived: bool
    outcome: str
    contacts: int
    deviation_max_m: float | None
    deviation_mean_m: float | None
    deviation_variance_m2: float | None
    seconds: float
    stopped_s: float
    """Of them, standing because guidance said so."""
    localized_share: float
    localization_rmse_m: float | None
    cycle_median_ms: float
    route_m: list[list[float]]
    path_m: list[list[float]]
    """Where the walker truly went; both in the building's frame."""


def digest(site_folder: Path, settings: Settings) -> str:
    """Return what a result depends on, in short: the code, the map and the settings. Results of others do not count."""
    content = hashlib.sha256(map_checksum(site_folder).encode())
    content.update(json.dumps(settings.values(), sort_keys=True).encode())
    root = Path(__file__).parents[2]
    for package in ("navcore", "device_agent"):
        for source in sorted((root / package).rglob("*.py")):
            content.update(source.read_bytes())
    return content.hexdigest()[:16]


def kept(folder: Path, trial: Trial, wanted: str) -> Figures | None:
    """Return the figures of a walk that was made before, with the same code, map and settings."""
    try:
        stored = json.loads((folder / f"{trial.key}.json").read_text(encoding="utf-8"))
        return Figures(**stored["figures"]) if stored["digest"] == wanted else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def run_all(
    todo: Sequence[Trial],
    site_folder: Path,
    folder: Path,
    settings: Settings,
    jobs: int,
    report: Callable[[Figures], None],
) -> None:
    """Make the walks, ``jobs`` at a time, and keep each as soon as it is done."""
    folder.mkdir(parents=True, exist_ok=True)
    stamp = digest(site_folder, settings)
    # A fresh process each: what OpenCV and Numba hold does not survive a fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_end_with_parent) as pool:
        waiting = {pool.submit(run_trial, trial, site_folder, settings): trial for trial in todo}
        try:
            for done in as_completed(waiting):
                figures = done.result()
                _keep(folder, figures, stamp)
                report(figures)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _end_with_parent() -> None:
    """Nothing is left walking when the command is killed, however that was done."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True, name="end-with-parent").start()


def run_trial(trial: Trial, site_folder: Path, settings: Settings) -> Figures:
    """Make one walk, in this process. The same arguments give the same figures, but for the times."""
    building, renderer = _stage(trial.path.name if trial.experiment == 2 else "")
    result = run_walk(
        _site(site_folder),
        with_people_starting(building, trial.seed),
        trial.path.start,
        trial.path.destination,
        settings=settings.changed({"follower.policy": trial.policy}),
        seed=trial.seed,
        walker=trial.walker(),
        max_s=_MAX_S,
        rate_hz=RATE_HZ,
        size_px=SIZE_PX,
        renderer=renderer,
    )
    return _figures(trial, result)


@cache
def _site(folder: Path) -> Site:
    return load_site(folder)


@cache
def _stage(path: str) -> tuple[Building, Renderer]:
    """Return the building as it is on a path of Experiment 2, or without obstacles; painting it takes seconds."""
    building = with_course(office_floor(), path) if path else office_floor()
    return building, renderer_of(building)


def _figures(trial: Trial, result: WalkResult) -> Figures:
    stopped = sum(count for reason, count in result.reasons.items() if reason not in ("ok", "off_road", "arrived"))
    return Figures(
        key=trial.key,
        experiment=trial.experiment,
        policy=trial.policy,
        path=trial.path.name,
        sight=trial.sight,
        seed=trial.seed,
        arrived=result.arrived,
        outcome=result.outcome,
        contacts=result.contacts,
        deviation_max_m=_finite(result.deviation_max_m),
        deviation_mean_m=_finite(result.deviation_mean_m),
        deviation_variance_m2=_finite(result.deviation_variance_m2),
        seconds=round(result.seconds, 1),
        stopped_s=round(stopped / RATE_HZ, 1),
        localized_share=round(result.localized_fraction, 4),
        localization_rmse_m=_finite(result.localization_rmse_m),
        cycle_median_ms=round(result.median_ms, 2),
        route_m=_thinned(_in_building(result.route_m, result)),
        path_m=_thinned(_in_building(result.path_m, result)),
    )


def _finite(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


def _in_building(points_m: FloatArray, result: WalkResult) -> FloatArray:
    """Return points of the map (n, 2) in the building; none where nobody knows how they lie to each other."""
    transform = result.map_from_building
    if np.isnan(transform).any():
        return np.zeros((0, 2))
    moved: FloatArray = (points_m - transform[:2, 2]) @ transform[:2, :2]
    return moved


def _thinned(path_m: FloatArray) -> list[list[float]]:
    """Return the points of a path that are at least a step apart; who stands needs one."""
    points: list[list[float]] = []
    for x_m, y_m in path_m:
        if not points or np.hypot(x_m - points[-1][0], y_m - points[-1][1]) >= _PATH_STEP_M:
            points.append([round(float(x_m), 2), round(float(y_m), 2)])
    return points


def _keep(folder: Path, figures: Figures, stamp: str) -> None:
    stored: dict[str, Any] = {"digest": stamp, "figures": asdict(figures)}
    fresh = folder / f"{figures.key}.new"
    fresh.write_text(json.dumps(stored), encoding="utf-8")
    os.replace(fresh, folder / f"{figures.key}.json")
