"""What somebody has begun in the scene and not yet accepted. Values; each says what to do next."""

from __future__ import annotations

import enum
import itertools
import math
from dataclasses import dataclass

from console.viewer.appearance import metres_text
from navcore.planning.poi_graph import Edge, PoiGraph

FloorPoint = tuple[float, float]


class Mode(enum.Enum):
    """What a click does."""

    SELECT = "select"
    TAG = "tag"
    CONNECT = "connect"
    DRAW = "draw"


@dataclass(frozen=True, slots=True)
class NewPlace:
    """A place that waits for its name."""

    place_m: FloorPoint
    on_road: bool = True
    edge_id: str | None = None
    """The connection that it cuts in two; None where it cuts none."""

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        where = "" if self.on_road else " It stands free of the road, and is no destination."
        return f"Name the place, then press Enter.{where}"


@dataclass(frozen=True, slots=True)
class PlaceOnEdge:
    """A place on a connection is wanted: where?"""

    edge_id: str

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        return "Click on the connection where the new place is."


@dataclass(frozen=True, slots=True)
class EdgeFrom:
    """One end of a connection is chosen."""

    poi_id: str

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        return f"From {name_of(graph, self.poi_id)}: click the other place."


@dataclass(frozen=True, slots=True)
class NewEdges:
    """Pieces of road that would become connections: the one between two places, or all that are proposed."""

    edges: tuple[Edge, ...]
    version: int
    """The version of the draft that they have been worked out on."""
    is_proposal: bool = False

    def is_like(self, other: NewEdges) -> bool:
        """Whether both are the same pieces of road between the same places, whatever they will be called."""
        return {(edge.a, edge.b, edge.path_m) for edge in self.edges} == {
            (edge.a, edge.b, edge.path_m) for edge in other.edges
        }

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        length_m = sum(edge.length_m for edge in self.edges)
        if self.is_proposal:
            count = len(self.edges)
            many = f"{count} new connections" if count > 1 else "1 new connection"
            return f"{many}, {metres_text(length_m)} of road, shown in the scene. Press Enter to add."
        a, b = (name_of(graph, end) for end in (self.edges[0].a, self.edges[0].b))
        return f"{a} – {b}: {metres_text(length_m)} along the road. Press Enter to connect."


@dataclass(frozen=True, slots=True)
class MergePlace:
    """A place is to become part of another one: which?"""

    poi_id: str

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        return f"Click the place that {name_of(graph, self.poi_id)} becomes part of."


@dataclass(frozen=True, slots=True)
class TrimmedRoad:
    """A road is to be trimmed to what lies between two places on it."""

    road_id: str
    start_m: FloorPoint | None = None

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        if self.start_m is None:
            return "Click where the part of the road begins that you want to keep."
        return "Click where it ends. What lies outside goes."


@dataclass(frozen=True, slots=True)
class CutRoad:
    """A road is to be cut in two: where?"""

    road_id: str

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        return "Click on the road where it is to be cut in two."


@dataclass(frozen=True, slots=True)
class JoinedRoad:
    """A road is to be joined with another one: which?"""

    road_id: str

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        return "Click the other road: the nearest ends are joined."


@dataclass(frozen=True, slots=True)
class Drawing:
    """A line of road that is being drawn, as clicked; ends that lie near a road are on it already."""

    points_m: tuple[FloorPoint, ...]

    @property
    def length_m(self) -> float:
        """How long it is by now."""
        return sum(itertools.starmap(math.dist, itertools.pairwise(self.points_m)))

    def hint(self, graph: PoiGraph) -> str:
        """What to do next."""
        if len(self.points_m) < 2:
            return "Click where the road goes on. Backspace takes a point back."
        return f"{metres_text(self.length_m)} drawn. Enter accepts, Backspace takes a point back, Esc drops it."


Begun = NewPlace | PlaceOnEdge | EdgeFrom | NewEdges | MergePlace | TrimmedRoad | CutRoad | JoinedRoad | Drawing


def hint_of(mode: Mode, graph: PoiGraph, *, may_edit: bool, is_free: bool) -> str:
    """Return what to do next while nothing is begun; an empty map says how to begin."""
    match mode:
        case Mode.TAG:
            where = "on the floor" if is_free else "on the road"
            return f"Click {where} where the place is. Shift+click puts it off the road."
        case Mode.CONNECT:
            return "Click the two places to connect."
        case Mode.DRAW:
            return "Click on the floor where the road begins. Near another road it begins on it."
    if not may_edit:
        return "Click a place to see what it is."
    if not graph.roads:
        return "There is no road yet. Press 4 and draw one, or build the map from a recorded walk."
    if not graph.pois:
        return "No places yet. Press 2 and click on the road where the first one is."
    if not graph.edges and len(graph.pois) > 1:
        return "Nothing is connected yet. “Propose” joins all neighbours along the road."
    return "Click a place, a connection or a road. Drag a place to move it. ? shows the keys."


def name_of(graph: PoiGraph, poi_id: str) -> str:
    """Return the name of a place, for a sentence."""
    poi = graph.pois.get(poi_id)
    return poi.name if poi is not None else "a place that is gone"


def things_gone(begun: Begun, graph: PoiGraph) -> bool:
    """Whether what was begun is about something that is no longer there."""
    match begun:
        case PlaceOnEdge(edge_id):
            return edge_id not in graph.edges
        case NewPlace(edge_id=str(edge_id)):
            return edge_id not in graph.edges
        case EdgeFrom(poi_id) | MergePlace(poi_id):
            return poi_id not in graph.pois
        case NewEdges(edges):
            return any(end not in graph.pois for edge in edges for end in (edge.a, edge.b))
        case TrimmedRoad(road_id) | CutRoad(road_id) | JoinedRoad(road_id):
            return road_id not in graph.roads
        case _:
            return False
