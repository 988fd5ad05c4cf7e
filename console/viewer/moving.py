"""A place on its way: dragged, or nudged by the arrow keys. Nothing is changed before it is put down."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from console.edits import MovePoi
from console.model import SiteModel
from console.viewer.begun import FloorPoint
from navcore.errors import VbrError
from navcore.planning.poi_graph import Poi, PoiGraph
from navcore.planning.road_network import RoadNetwork

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
