"""The hard cases with the whole stack: rendered sensors, SLAM, planning, guidance, cues, and a walker who only hears.

    python -m benchmarks.hard_cases [--only NAME] [--seeds 1] [--policy paper] [--map DIR] [--json]

Each case of ``device_agent/experiments/hard_cases.py`` is walked in the office floor, by as many model walkers as
there are seeds, under both policies. Prints a Markdown table of what is expected and what happened, and one JSON object
with everything else; the exit status is 1 where something differs. ``--map`` keeps the map, which takes minutes.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from device_agent.demo_site import prepare_demo_site
from device_agent.experiments.course import glass_screen
from device_agent.experiments.design import POLICIES
from device_agent.experiments.hard_cases import HARD_CASES, HardCase, Outcome, differences, outcome_of
from device_agent.experiments.running import RATE_HZ, SIZE_PX
from device_agent.simulation.building import Building, Start, renderer_of
from device_agent.simulation.furniture import chair
from device_agent.simulation.obstacles import velvet_box
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.openings import with_hole
from device_agent.simulation.renderer import Renderer
from device_agent.simulation.scenario import ORDINARY, Scenario
from device_agent.simulation.shapes import Piece, box
from device_agent.simulation.staging import Actor, Mark, Oncomer, oncomer, person, thing
from device_agent.simulation.walker import drawn_walker
from device_agent.walk import Moment, run_walk
from device_agent.walk_measures import Sample
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.settings import Settings
from navcore.site import Site, load_site
from navcore.wire import SetDestination

X_M, Y_M = 15.0, 9.8
"""Where it happens: in the middle corridor, which is 2.4 m wide and leads from the hall (y = 2.6 m) to K (y = 14 m)."""
_THERE_M = 2.0


@dataclass(frozen=True)
class Scene:
    """Where a case is walked, in the building's frame."""

    start: Start = Start(15.0, 3.4, math.pi / 2)  # noqa: RUF009 - frozen
    goal: str = "K"
    goal_m: tuple[float, float] = (15.0, 14.0)
    pieces: tuple[Piece, ...] = ()
    hole_m: tuple[float, float, float, float] | None = None
    """In the floor: x0, y0, x1, y1."""
    actors: Callable[[], tuple[Actor | Oncomer, ...]] = tuple
    meanwhile: Callable[[Moment], None] = lambda moment: None
    scenario: Scenario = ORDINARY
    graph: Callable[[PoiGraph], PoiGraph] = lambda graph: graph
    limit_s: float = 60.0
    settings: dict[str, float] = field(default_factory=dict)


UP_TO_THE_FEET = {
    "obstacle.clearance_m": 1.2, "obstacle.narrow_clearance_m": 0.8, "obstacle.stop_distance_m": 0.7,
}  # fmt: skip
"""People are stopped so late that what is low has left the image by then."""


def _choose_another(moment: Moment) -> None:
    state = moment.agent.state
    if moment.world.truth().y_m > 8.5 and state.place_name(state.destination_id) != "Hall":
        hall = next(poi for poi in state.graph.pois.values() if poi.name == "Hall")
        moment.agent.submit(SetDestination(hall.id))


def _unplug(moment: Moment) -> None:
    if moment.world.truth().y_m > 7.0:
        moment.sonar.close()


def _frame() -> tuple[Piece, ...]:
    """A wall with a door way of 1.2 m across the corridor."""
    side = box((0.62, 0.12, 2.7), "paint/#d9c8a8", name="door frame")
    return side.moved(X_M - 0.91, Y_M), side.moved(X_M + 0.91, Y_M)


def _sliding_door() -> Actor:
    panel = box((1.2, 0.06, 2.1), "veneer/#8a5a30", front="poster/door", name="door")
    marks = (0.0, 1.3), (1.5, 0.0), (7.5, 0.0), (9.0, 1.3)
    return thing(panel, *(Mark(after_s, X_M + aside_m, Y_M) for after_s, aside_m in marks), cue_m=(X_M, Y_M, 3.0))


def _chair() -> Actor:
    marks = Mark(0.0, X_M + 0.93, Y_M, -90.0), Mark(0.8, X_M + 0.35, Y_M, -90.0)
    return thing(chair("#7a3f4d"), *marks, cue_m=(X_M, Y_M, 3.2))


def _low_board() -> Actor:
    """It lies across the way, and is taken away to the side once the walker has stood before it for a while."""
    board = box((2.3, 0.3, 0.25), "veneer/#b58a5a:carton", front="poster/carton", name="board")
    marks = Mark(0.0, 7.0, 15.0), Mark(20.0, 7.0, 15.0), Mark(21.0, 4.0, 15.0)
    return thing(board, *marks, cue_m=(7.0, 15.0, 1.6))


def _people_across() -> tuple[Actor, ...]:
    return tuple(
        person(((X_M + x, Y_M), (X_M + x, 14.0 + x / 2), (21.0, 14.0 + x / 2)), 1.2, (X_M, Y_M, 3.2), after_s=8.0)
        for x in (-0.8, 0.0, 0.8)
    )


def _side_by_side(graph: PoiGraph) -> PoiGraph:
    """Return a road up the corridor and down again, 0.9 m beside itself, in the map's frame."""
    corners = {"up": (14.55, 7.4), "junction": (14.55, 12.8), "junction-2": (15.45, 12.8), "down": (15.45, 7.4)}
    places = {key: _in_map(graph, xy) for key, xy in corners.items()}
    pois = {key: Poi(key, key, "other", *xy) for key, xy in places.items()}
    edges = {}
    for a, b in itertools.pairwise(corners):
        edges[f"{a}_{b}"] = Edge(f"{a}_{b}", a, b, (places[a], places[b]), math.dist(places[a], places[b]))
    return PoiGraph(graph.version + 1, pois, edges)


def _in_map(graph: PoiGraph, place_m: tuple[float, float]) -> tuple[float, float]:
    """Return where a place of the building lies in the map, by the PoIs that both know."""
    by_name = {poi.name: poi for poi in graph.pois.values()}
    known = [(place, by_name[place.name]) for place in office_floor().places.values() if place.name in by_name]
    here = np.array([(place.x_m, place.y_m) for place, _ in known])
    there = np.array([(poi.x_m, poi.y_m) for _, poi in known])
    u, _, vt = np.linalg.svd((here - here.mean(axis=0)).T @ (there - there.mean(axis=0)))
    turn = vt.T @ np.diag([1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    x_m, y_m = turn @ (np.array(place_m) - here.mean(axis=0)) + there.mean(axis=0)
    return float(x_m), float(y_m)


_ACROSS = box((2.3, 0.4, 1.4), "veneer/#b58a5a:carton", front="poster/carton", name="crates")
SCENES = {
    "u-turn": Scene(Start(15.0, 8.5, -math.pi / 2)),
    "facing a wall": Scene(Start(15.5, 8.5, 0.0)),
    "destination behind": Scene(meanwhile=_choose_another, goal_m=(15.0, 2.6)),
    "blocked for a while": Scene(actors=_people_across),
    "blocked, another way": Scene(pieces=(_ACROSS.moved(X_M, Y_M),), limit_s=150.0),
    "blocked, no other way": Scene(
        Start(7.0, 11.0, math.pi / 2), "Room 3311", (7.0, 16.9), (_ACROSS.moved(7.0, 15.0),), limit_s=60.0
    ),
    "gone from the feet": Scene(
        Start(7.0, 11.0, math.pi / 2), "Room 3311", (7.0, 16.9), actors=lambda: (_low_board(),), limit_s=120.0,
        settings=UP_TO_THE_FEET,
    ),
    "person coming": Scene(actors=lambda: (oncomer(X_M, 13.6, -90.0, 0.85),)),
    "door closing": Scene(pieces=_frame(), actors=lambda: (_sliding_door(),)),
    "glass door": Scene(pieces=(glass_screen(X_M, Y_M, 0.0, 2.36),), limit_s=150.0),
    "stairs down": Scene(hole_m=(X_M - 1.18, Y_M - 0.5, X_M + 1.18, Y_M + 0.5), limit_s=150.0),
    "bag that absorbs": Scene(pieces=(velvet_box(X_M + 0.35, Y_M),)),
    "chair pulled out": Scene(actors=lambda: (_chair(),)),
    "legs side by side": Scene(Start(14.55, 7.4, math.pi / 2), "down", (15.45, 7.4), graph=_side_by_side, limit_s=90.0),
    "lost mid-corridor": Scene(scenario=Scenario(covered_s=(6.0, 4.0))),
    "sonar unplugged": Scene(meanwhile=_unplug),
}  # fmt: skip
"""Each case of the table, in its order."""


@cache
def _floor(name: str) -> tuple[Building, Renderer]:
    """Return the floor with what stands there in a case; painting it takes seconds."""
    pieces, hole_m = SCENES[name].pieces, SCENES[name].hole_m
    if not pieces and hole_m is None:
        return _bare()
    building = office_floor().with_pieces(*pieces)
    if hole_m is not None:
        building = with_hole(building, hole_m)
    return building, renderer_of(building)


@cache
def _bare() -> tuple[Building, Renderer]:
    building = office_floor()
    return building, renderer_of(building)


def walked(site: Site, name: str, policy: str, seed: int) -> Outcome:
    """Walk a case once and return what happened."""
    scene, (building, renderer) = SCENES[name], _floor(name)
    actors = scene.actors()
    building = replace(building, movers=actors)
    moments: list[Sample] = []
    bodies = []

    def meanwhile(moment: Moment) -> None:
        body, state = moment.world.truth(), moment.agent.state
        for actor in actors:
            actor.watch(body.time_s, body.x_m, body.y_m)
        scene.meanwhile(moment)
        moments.append(Sample(moment.cycle, np.array([body.x_m, body.y_m]), state.purpose, state.route))
        bodies[:] = [body]

    result = run_walk(
        replace(site, poi_graph=scene.graph(site.poi_graph)), building, scene.start, scene.goal,
        settings=Settings().changed({"follower.policy": policy, **scene.settings}),
        seed=seed, walker=drawn_walker(seed), max_s=scene.limit_s, rate_hz=RATE_HZ, size_px=SIZE_PX,
        renderer=renderer.with_movers(building.mover_surfaces), scenario=scene.scenario, meanwhile=meanwhile,
    )  # fmt: skip
    distance_m = math.dist((bodies[0].x_m, bodies[0].y_m), scene.goal_m)
    return outcome_of(moments, result.cues, bodies[0], is_there=distance_m <= _THERE_M)


@dataclass(frozen=True)
class Row:
    """One walk."""

    case: HardCase
    policy: str
    seed: int
    outcome: Outcome

    @property
    def differs(self) -> tuple[str, ...]:
        """In what it differs from what is expected."""
        return differences(self.case.expected, self.outcome)


def as_markdown(rows: list[Row]) -> str:
    """Return the table: a line for each case and policy."""
    heads = ("case", "what happens", "expected", "policy", "as expected", "happened")
    lines = [_line(heads), _line(["---"] * len(heads))]
    for case in HARD_CASES:
        for policy in POLICIES:
            mine = [row for row in rows if row.case is case and row.policy == policy]
            if not mine:
                continue
            well = sum(not row.differs for row in mine)
            wrong = "; ".join(f"seed {row.seed}: {', '.join(row.differs)}" for row in mine if row.differs)
            seconds = " / ".join(f"{row.outcome.seconds:.0f}" for row in mine)
            what = wrong or f"as expected, {sum(row.outcome.contacts for row in mine)} contacts, {seconds} s"
            lines.append(_line((case.name, case.what_happens, case.outcome, policy, f"{well} of {len(mine)}", what)))
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _as_json(row: Row) -> dict[str, Any]:
    outcome = row.outcome
    return {
        "case": row.case.name, "policy": row.policy, "seed": row.seed, "differs": list(row.differs),
        "arrived": outcome.arrived, "contacts": outcome.contacts, "seconds": round(outcome.seconds, 1),
        "stopped_for": sorted(reason.value for reason in outcome.stopped_for),
        "turned": sorted(turn.value for turn in outcome.turned), "routes": outcome.routes,
        "leap_m": round(outcome.leap_m, 2), "texts": list(outcome.texts),
    }  # fmt: skip


def _rows(site: Site, names: list[str], policies: list[str], seeds: range) -> Iterator[Row]:
    for case in HARD_CASES:
        for policy in policies if case.name in names else ():
            for seed in seeds:
                row = Row(case, policy, seed, walked(site, case.name, policy, seed))
                told = ", ".join(row.differs) or "as expected"
                print(f"{case.name}, {policy}, seed {seed}: {told}", file=sys.stderr, flush=True)
                yield row


def main() -> int:
    """Walk the cases; 1 where one came to something else than expected."""
    names = [case.name for case in HARD_CASES]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=names, metavar="NAME", help="only this case")
    parser.add_argument("--policy", action="append", choices=POLICIES, help="only this policy")
    parser.add_argument("--seeds", type=int, default=1, help="walkers for each case and policy")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--map", type=Path, metavar="DIR", help="where the map is kept, or made")
    parser.add_argument("--json", action="store_true", help="JSON alone, on one line")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        site = load_site(prepare_demo_site(arguments.map or Path(folder) / "map", SIZE_PX, RATE_HZ))
    seeds = range(arguments.first_seed, arguments.first_seed + max(1, arguments.seeds))
    rows = list(_rows(site, arguments.only or names, arguments.policy or list(POLICIES), seeds))
    if not arguments.json:
        print(as_markdown(rows))
    print(json.dumps({"walks": [_as_json(row) for row in rows]}, indent=None if arguments.json else 1))
    return int(any(row.differs for row in rows))


if __name__ == "__main__":
    sys.exit(main())
