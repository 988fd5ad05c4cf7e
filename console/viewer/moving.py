"""A place on its way: dragged, or nudged by the arrow keys. Nothing is changed before it is put down."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from console.edits import MovePoi
from console.model import SiteModel
from console.viewer.begun import FloorPoint
from navcore.errors import VbrError
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.planning.road_network import RoadNetwork

NUDGES_REST_S = 0.6
"""Nudges that follow each other sooner than this are one edit."""
Tell = Callable[[str, str], None]
"""Shows a heading and a sentence to the person."""
_STRAIGHT_ON = 0.05
"""A road that leads less than this (cosine) into the direction of an arrow is not followed."""


@dataclass(frozen=True, slots=True)
class Moving:
    """A place that is being moved: where it is now, and what the graph would be if it were put down there."""

    poi: Poi
    """As it was when it was taken up."""
    base_version: int
    """The draft's version then."""
    draft: PoiGraph
    """The draft that ``graph`` has been worked out on."""
    graph: PoiGraph
    place_m: FloorPoint
    refusal: str = ""
    """Why it is held back from where the hand is; empty where it is not."""

    @property
    def has_moved(self) -> bool:
        """Whether it is anywhere else than at the start."""
        return self.place_m != (self.poi.x_m, self.poi.y_m)

    @property
    def edit(self) -> MovePoi:
        """What putting it down changes."""
        return MovePoi(self.poi.id, *self.place_m, on_road=self.poi.on_road)


def taken_up(poi: Poi, model: SiteModel) -> Moving:
    """Begin to move a place."""
    graph = model.graph
    return Moving(poi, graph.version, graph, graph, (poi.x_m, poi.y_m))


def moved_to(moving: Moving, point_m: FloorPoint, model: SiteModel) -> Moving:
    """Move it: along the road where it stands on one, and no farther than its edges can follow."""
    try:
        place_m = model.network.nearest(*point_m).xy_m if moving.poi.on_road else point_m
        wanted = replace(moving, draft=model.graph, place_m=place_m, refusal="")
        return replace(wanted, graph=model.preview(wanted.edit))
    except VbrError as error:
        # Held at the last good place; said once, when the drag ends there.
        return replace(moving, refusal=str(error))


class Hand:
    """Moves one place at a time, for one editor; ``apply`` makes an edit over the version that was looked at."""

    def __init__(self, model: SiteModel, tell: Tell, apply: Callable[[MovePoi, int], object]) -> None:
        self._model = model
        self._tell = tell
        self._apply = apply
        self.moving: Moving | None = None
        self._nudged_at_s: float | None = None

    def drag_to(self, poi_id: str, point_m: FloorPoint | None) -> None:
        """Move a place to this point of the floor; None leaves it where it is."""
        if self._nudged_at_s is not None or (self.moving is not None and self.moving.poi.id != poi_id):
            self.put_down()
        poi = self._model.graph.pois.get(poi_id)
        if self.moving is None:
            if poi is None:
                return
            self.moving = taken_up(poi, self._model)
        if poi is None:
            self._let_go_of_deleted(self.moving)
        elif point_m is not None:
            self.moving = moved_to(self.moving, point_m, self._model)

    def nudge(self, poi: Poi, towards: FloorPoint, step_m: float, now_s: float) -> None:
        """Move a place by a step; it is put down when it has rested for a while, or when something else begins."""
        if self.moving is None or self.moving.poi.id != poi.id:
            self.put_down()
            self.moving = taken_up(poi, self._model)
        here = self.moving.place_m
        target = (here[0] + step_m * towards[0], here[1] + step_m * towards[1])
        if poi.on_road and not self._model.network.is_empty:
            target = stepped(self._model.network, here, towards, step_m)
        self._nudged_at_s = now_s
        self.moving = moved_to(self.moving, target, self._model)

    def rest(self, now_s: float) -> None:
        """Time goes by: nudges that have come to rest become an edit."""
        if self._nudged_at_s is not None and now_s - self._nudged_at_s >= NUDGES_REST_S:
            self.put_down()

    def put_down(self) -> None:
        """End the move where it is: an edit, where it has led anywhere."""
        moving = self.moving
        self.let_go()
        if moving is None:
            return
        if moving.refusal:
            self._tell("Not moved that far", moving.refusal)
        if moving.has_moved:
            self._apply(moving.edit, moving.base_version)

    def let_go(self) -> None:
        """End the move as if it had never begun."""
        self.moving = self._nudged_at_s = None

    def keep_up(self) -> None:
        """The draft has changed: the move goes on over what is there now, or ends where its place is gone."""
        moving, graph = self.moving, self._model.graph
        if moving is None:
            return
        if moving.poi.id not in graph.pois:
            self._let_go_of_deleted(moving)
        elif moving.draft is not graph:
            self.moving = moved_to(replace(moving, draft=graph, graph=graph), moving.place_m, self._model)

    def _let_go_of_deleted(self, moving: Moving) -> None:
        self.let_go()
        change = self._model.last_change(("poi", moving.poi.id))
        who = change.author if change is not None else "Somebody"
        self._tell("Let go", f"{who} has deleted {moving.poi.name} meanwhile: the move has ended.")


def stepped(network: RoadNetwork, place_m: FloorPoint, towards: FloorPoint, step_m: float) -> FloorPoint:
    """Return the place one step along the road, where it leads most into the unit direction ``towards``.

    At the end of the road, and where it leads nowhere near that direction, the step is shorter, or none.
    Raises PlanningError where there is no road.
    """
    start = network.nearest(*place_m)
    here, left_m = start.xy_m, step_m
    ends = [int(vertex) for vertex in network.segments[start.segment]]
    barred = {vertex for vertex in ends if math.dist(network.vertices_m[vertex], here) < 1e-6} or set(ends)
    ahead = [other for vertex in barred for other, _ in network.vertex_neighbours(vertex)] if len(barred) == 1 else ends
    # Once begun, a road is followed round its bends; only junctions are a choice.
    least = _STRAIGHT_ON
    while (vertex := _most_towards(network, here, ahead, towards, least)) is not None:
        x_m, y_m = network.vertices_m[vertex].tolist()
        length_m = math.dist(here, (x_m, y_m))
        if length_m >= left_m:
            share = left_m / length_m
            return here[0] + share * (x_m - here[0]), here[1] + share * (y_m - here[1])
        left_m -= length_m
        here, least = (x_m, y_m), -1.0
        ahead = [other for other, _ in network.vertex_neighbours(vertex) if other not in barred]
        barred = {vertex}
    return here


def _most_towards(
    network: RoadNetwork, here: FloorPoint, vertices: list[int], towards: FloorPoint, least: float
) -> int | None:
    best, found = least, None
    for vertex in vertices:
        x_m, y_m = network.vertices_m[vertex].tolist()
        length_m = math.dist(here, (x_m, y_m))
        if length_m < 1e-9:
            continue
        along = ((x_m - here[0]) * towards[0] + (y_m - here[1]) * towards[1]) / length_m
        if along > best:
            best, found = along, vertex
    return found
