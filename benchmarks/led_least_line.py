"""What the model walkers make of the paper's courses when led by somebody who knows everything.

    python -m benchmarks.led_least_line --walks DIR [--seeds 20] [--first-seed 5200] [--path EB] [--roomier-m 0.03]

DIR is what ``vbr experiments --out DIR`` has written: the planned routes are taken from its walks. Each path's least
line (:mod:`device_agent.experiments.least`: as near to the road as can be, and never nearer than half of a person's
corridor to anything) is the road here. The same walkers are led along it by the same guidance and cues, with their true
pose, and with a scan in which all is free: nobody is ever stopped. Their bodies meet what stands there, and who sees
goes round it by themselves. Prints a Markdown table: the mean distance from the planned route over time, as in the
experiments, with its standard error, and how often something was touched; without the people who walk there, and with
them, who give way as they do in the experiments, and whom nobody tells the walkers of.

So it tells what is left to the walkers alone, who react late and err with every turn. Where that is more than a target,
or is reached by touching things, better eyes would not reach it.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean, stdev
from typing import cast

import numpy as np

from device_agent.experiments.course import with_course, with_people_starting
from device_agent.experiments.design import PATHS, SIGHTS
from device_agent.experiments.design import Path as Way
from device_agent.experiments.least import course_of, least_line_m, stations_of
from device_agent.simulation.building import Building
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.walker import WalkerParameters, drawn_partially_sighted_walker, drawn_walker
from device_agent.simulation.world import SimulatedWorld, start_at
from navcore.cues.memory import CueMemory
from navcore.cues.speech import cues_for
from navcore.deviation import distance_to_polyline_m
from navcore.geometry import FloatArray, world_from_camera_at
from navcore.guide import guide
from navcore.obstacle.scan import scan
from navcore.planning.projection import arc_lengths_m
from navcore.planning.road_joining import evenly_spaced
from navcore.settings import Settings
from navcore.types import (
    Action,
    CameraIntrinsics,
    Localization,
    LocalizationQuality,
    ObstacleScan,
    Reason,
    Route,
    RouteStop,
    SonarReading,
    SonarState,
)

EYE_M, PITCH_RAD = 1.6, math.radians(15.0)
CAMERA = CameraIntrinsics(160, 120, 116.4, 116.4, 79.5, 59.5)
_FRAME_S, _LATENCY_S, _LONGEST_S = 0.1, 0.04, 240.0
_NO_PICTURES = cast("Renderer", object())
"""Nobody looks."""
_UNTIL_END_STATIONS = 9
"""Who has arrived is stopped before the end, which may lie nearer to a wall than a person needs."""
_ROOMIER_M = (0.0, 0.1)
"""How much more than half of a person's corridor the lines keep from everything."""


@dataclass(frozen=True)
class Led:
    """What came of one walk."""

    mean_m: float
    contacts: int


def _free_scan(settings: Settings) -> ObstacleScan:
    """Return what a camera shows of a floor with nothing on it."""
    rows = (np.arange(CAMERA.height_px) - CAMERA.cy_px) / CAMERA.fy_px
    down = rows * math.cos(PITCH_RAD) + math.sin(PITCH_RAD)
    with np.errstate(divide="ignore"):
        depth_m = np.where(down > 0.0, EYE_M / down, np.nan)
    depth_m[depth_m > 8.0] = np.nan
    image = np.repeat(depth_m[:, None], CAMERA.width_px, axis=1).astype(np.float32)
    return scan(image, CAMERA, world_from_camera_at((0.0, 0.0, EYE_M), 0.0, PITCH_RAD), settings.obstacle)


def _led(
    line: Route, planned_m: FloatArray, building: Building, way: Way, walker: WalkerParameters, seed: int,
    settings: Settings, free: ObstacleScan,
) -> Led:  # fmt: skip
    start = start_at(building, way.start)
    world = SimulatedWorld(building, walker, start, seed, renderer=_NO_PICTURES)
    guidance, memory, away_m = None, CueMemory(), []
    while world.now_s() < _LONGEST_S:
        now_s, body = world.now_s(), world.truth()
        pose = world_from_camera_at((body.x_m, body.y_m, EYE_M), body.heading_rad, PITCH_RAD)
        located = Localization(now_s, LocalizationQuality.LOCALIZED, pose)
        silence = SonarReading(now_s, SonarState.NO_ECHO)
        guidance = guide(now_s, located, line, free, silence, guidance, settings)
        cues, memory = cues_for(guidance, memory, line, settings, now_s)
        away_m.append(distance_to_polyline_m(np.array([body.x_m, body.y_m]), planned_m))
        world.advance_to(now_s + _LATENCY_S)
        for cue in cues:
            world.hear(cue)
        world.advance_to(now_s + _FRAME_S)
        if guidance.reason is Reason.ARRIVED and guidance.action is Action.STOP and world.truth().speed_mps == 0.0:
            return Led(fmean(away_m), world.truth().contacts)
    raise SystemExit(f"Walker {seed} never arrived: the least line cannot be walked.")


def _line(way: Way, planned_m: FloatArray, needed_m: float) -> Route | None:
    """Return the least line of a path as a route; None where there is none so far from everything."""
    stations, left = stations_of(planned_m)
    count = len(stations) - _UNTIL_END_STATIONS
    offset_m = least_line_m(stations[:count], left[:count], course_of(way.name), needed_m)
    if offset_m is None:
        return None
    stations[:count] += offset_m[:, None] * left[:count]
    points = evenly_spaced(stations, 0.1)
    arcs = arc_lengths_m(points)
    return Route(points, arcs, (RouteStop("goal", way.destination, float(arcs[-1])),))


def _planned_m(folder: Path, way: Way) -> FloatArray:
    """Return the planned route of a path, in the building's frame."""
    for file in sorted((folder / "walks").glob(f"e?-*-{way.name.replace('→', '')}-*.json")):
        route_m = json.loads(file.read_text(encoding="utf-8"))["figures"]["route_m"]
        if len(route_m) > 1:
            return np.array(route_m)
    raise SystemExit(f"{folder} has no walk on {way.name}: run vbr experiments --out {folder} first.")


def _mean(walks: list[Led]) -> str:
    """Return the mean deviation of some walks, with its standard error."""
    means_m = [walk.mean_m for walk in walks]
    error_m = stdev(means_m) / math.sqrt(len(means_m)) if len(means_m) > 1 else math.nan
    return f"{fmean(means_m):.3f} ± {error_m:.3f} m"


def _rows(folder: Path, seeds: range, paths: list[Way], roomier_m: list[float]) -> Iterator[str]:
    settings = Settings()
    half_m, free = settings.obstacle.person_width_m / 2.0, _free_scan(settings)
    building = office_floor()
    for way in paths:
        planned_m, course = _planned_m(folder, way), with_course(building, way.name)
        for needed_m in (half_m + more_m for more_m in roomier_m):
            line = _line(way, planned_m, needed_m)
            if line is None:
                yield f"| {way.name} | all | {needed_m:.2f} m | there is no such line | | | |"
                continue
            for sight in SIGHTS:
                drawn = drawn_walker if sight == "totally blind" else drawn_partially_sighted_walker
                cells = []
                for alone in (True, False):
                    walks = []
                    for seed in seeds:
                        there = replace(course, movers=()) if alone else with_people_starting(course, seed)
                        walks.append(_led(line, planned_m, there, way, drawn(seed), seed, settings, free))
                    cells += [_mean(walks), str(sum(walk.contacts for walk in walks))]
                yield f"| {way.name} | {sight} | {needed_m:.2f} m | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--walks", type=Path, required=True, metavar="DIR", help="a batch of vbr experiments")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=5200)
    names = {way.name.replace("→", ""): way for way in PATHS}
    parser.add_argument("--path", choices=names, help="one path alone")
    parser.add_argument(
        "--roomier-m",
        type=float,
        nargs="+",
        default=_ROOMIER_M,
        metavar="M",
        help="how much more than half of a corridor the lines keep from everything",
    )
    arguments = parser.parse_args()
    paths = list(PATHS) if arguments.path is None else [names[arguments.path]]
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    print("| path | walker | from everything | mean | contacts | with people: mean | contacts |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for row in _rows(arguments.walks, seeds, paths, list(arguments.roomier_m)):
        print(row, flush=True)


if __name__ == "__main__":
    main()
