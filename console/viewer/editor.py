"""What one person is doing to the PoI-graph: mode, selection, a move, something that was begun, a conflict.

No viser here: clicks and drags come in as things and points on the floor, and the scene draws what stands here. Every
change goes through the model; what the model refuses leaves everything as it was, and is told in its own sentence.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from console import edits
from console.edit_conflict import EditConflictError
from console.edits import Edit, Thing, ThingKind
from console.model import SiteModel
from console.roles import EDITING, SignedIn
from console.viewer.begun import (
    Begun,
    CutRoad,
    Drawing,
    EdgeFrom,
    FloorPoint,
    JoinedRoad,
    MergePlace,
    Mode,
    NewEdges,
    NewPlace,
    PlaceOnEdge,
    TrimmedRoad,
    hint_of,
    things_gone,
)
from console.viewer.conflict import Conflict
from console.viewer.moving import Hand, Moving, Tell
from navcore.errors import VbrError
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road
from navcore.planning.projection import project_on_path
from navcore.planning.road_edits import MEET_M

MAX_SNAP_M = 1.0
"""A click farther from the road than this is no tag on it."""
PICK_ROAD_M = 0.2
"""A click on the floor this near to a road means the road: between the dashes of a drawn one nothing else is hit."""


class Editor:
    """The editing of one person in one browser window. Used by one thread at a time; any may read meanwhile."""

    def __init__(self, model: SiteModel, person: SignedIn, tell: Tell) -> None:
        self._model = model
        self._who = person.user_name
        self.may_edit = person.role in EDITING
        self._tell = tell
        self.mode = Mode.SELECT
        self.selected: Thing | None = None
        self._seen_version = model.graph.version
        """The draft's version when the person decided on what is selected, or chose between two versions of it."""
        self.begun: Begun | None = None
        self._hand = Hand(model, tell, self._apply)
        self.conflict: Conflict | None = None
        self._refused: Begun | None = None
        """What was begun and has led to the conflict."""
        self.is_free = False
        """Whether new places stand where they are put, off the road."""

    # ------------------------------------------------------------------------------------------------ reading
    @property
    def graph(self) -> PoiGraph:
        """The graph to draw: the draft, or what it would be if the move ended here."""
        moving = self.moving
        return self._model.graph if moving is None else moving.graph

    @property
    def moving(self) -> Moving | None:
        """The move that is going on."""
        return self._hand.moving

    @property
    def moving_id(self) -> str | None:
        """The place that is being moved."""
        moving = self.moving
        return None if moving is None else moving.poi.id

    @property
    def poi(self) -> Poi | None:
        """The selected place, as long as it exists."""
        return self._model.graph.pois.get(self._selected("poi"))

    @property
    def edge(self) -> Edge | None:
        """The selected edge, as long as it exists."""
        return self._model.graph.edges.get(self._selected("edge"))

    @property
    def road(self) -> Road | None:
        """The selected road, as long as it exists."""
        return self._model.graph.roads.get(self._selected("road"))

    def _selected(self, kind: str) -> str:
        selected = self.selected
        return selected[1] if selected is not None and selected[0] == kind else ""

    @property
    def version(self) -> int:
        """The version of the draft that is there now."""
        return self._model.graph.version

    @property
    def can_undo(self) -> bool:
        """Whether there is an own edit to take back."""
        return self._model.can_undo(self._who)

    @property
    def can_redo(self) -> bool:
        """Whether there is an edit to make again."""
        return self._model.can_redo(self._who)

    @property
    def wants_floor(self) -> bool:
        """Whether a click means a place of the floor, whatever stands there."""
        waits_for_place = isinstance(self.begun, PlaceOnEdge | TrimmedRoad | CutRoad)
        return waits_for_place or self.mode in (Mode.TAG, Mode.DRAW)

    @property
    def hint(self) -> str:
        """What to do next, in one sentence."""
        if self.conflict is not None:
            return "Two people have changed the same thing: choose which version stays."
        if self.begun is not None:
            return self.begun.hint(self._model.graph)
        return hint_of(self.mode, self._model.graph, may_edit=self.may_edit, is_free=self.is_free)

    # --------------------------------------------------------------------------------------------- selecting
    def set_mode(self, mode: Mode) -> None:
        """Go over to another mode; what was begun is dropped."""
        self.put_down()
        self.mode = mode if self.may_edit else Mode.SELECT
        self.begun = None

    def begin(self, begun: Begun) -> None:
        """Begin something that takes a click."""
        self.put_down()
        if self.may_edit:
            self.mode, self.begun = Mode.SELECT, begun

    def escape(self) -> None:
        """Drop what was begun or is being moved; else leave the mode; else select nothing."""
        if self.begun is not None or self.moving is not None:
            self.begun = None
            self._hand.let_go()
        elif self.mode is not Mode.SELECT:
            self.mode = Mode.SELECT
        else:
            self.selected = None

    def _select(self, thing: Thing | None) -> None:
        self.selected, self._seen_version = thing, self.version

    def select(self, thing: Thing | None = None) -> None:
        """Select a thing, or nothing."""
        self.put_down()
        self._select(thing)

    def pick(self, thing: Thing) -> None:
        """A thing was clicked."""
        self.put_down()
        kind, key = thing
        if kind == "poi" and self.wants_floor:
            poi = self._model.graph.pois.get(key)
            if poi is not None:
                self.pick_floor((poi.x_m, poi.y_m))
        elif kind == "poi" and isinstance(self.begun, MergePlace):
            self._merge(self.begun.poi_id, key)
        elif kind == "road" and isinstance(self.begun, JoinedRoad):
            self._join(self.begun.road_id, key)
        elif kind == "poi" and self.mode is Mode.CONNECT:
            self._pick_for_edge(key)
        elif self.mode is Mode.SELECT and not self.wants_floor:
            self.begun = None
            self._select(thing)

    def pick_floor(self, point_m: FloorPoint | None, is_free: bool = False) -> None:
        """The floor was clicked, or nothing at all; ``is_free``: off the road, if a place comes of it."""
        self.put_down()
        if point_m is None:
            return
        road_id = None if self.wants_floor else self._road_at(point_m)
        if road_id is not None:
            self.pick(("road", road_id))
            return
        match self.begun:
            case PlaceOnEdge(edge_id):
                self._begin_on_edge(edge_id, point_m)
            case TrimmedRoad(road_id, start_m):
                self._trim(road_id, start_m, point_m)
            case CutRoad(road_id):
                if self._near_road(road_id, point_m):
                    self._finish(edits.SplitRoad(road_id, point_m))
            case _ if self.mode is Mode.TAG:
                self._begin_place(point_m, is_free or self.is_free)
            case _ if self.mode is Mode.DRAW:
                drawn = self.begun.points_m if isinstance(self.begun, Drawing) else ()
                self.begun = Drawing((*drawn, self._met(point_m)))
            case None if self.mode is Mode.SELECT:
                self.selected = None

    # ------------------------------------------------------------------------------------------------- places
    def add_place(self, edit: edits.AddPoi) -> bool:
        """Add the place that has been begun, with the name, kind and so on of ``edit``; return whether it was taken."""
        begun = self.begun
        if not isinstance(begun, NewPlace):
            return False
        x_m, y_m = begun.place_m
        before = self._model.graph.pois.keys()
        whole: Edit = edits.AddPoi(
            edit.name, edit.kind, x_m, y_m, on_road=begun.on_road, spoken_name=edit.spoken_name, notes=edit.notes
        )
        if begun.edge_id is not None:
            whole = edits.SplitEdge(begun.edge_id, x_m, y_m, edit.name, edit.kind)
        if not self._finish(whole):
            return False
        self._select_new("poi", before)
        return True

    def set_on_road(self, on_road: bool) -> None:
        """Put the selected place on the road, or let it stand free where it is."""
        if self.poi is not None:
            self.apply(edits.MovePoi(self.poi.id, self.poi.x_m, self.poi.y_m, on_road=on_road), self._seen_version)

    def _begin_place(self, point_m: FloorPoint, is_free: bool) -> None:
        if is_free:
            self.begun = NewPlace(point_m, on_road=False)
            return
        try:
            place = self._model.network.nearest(*point_m)
        except VbrError as error:
            self._tell("No place here", str(error))
            return
        if place.distance_m > MAX_SNAP_M:
            self._tell(
                "No place here",
                f"The road is {place.distance_m:.1f} m away: click on it, or hold Shift to put the place off the road.",
            )
            return
        self.begun = NewPlace(place.xy_m)

    def _begin_on_edge(self, edge_id: str, point_m: FloorPoint) -> None:
        edge = self._model.graph.edges.get(edge_id)
        if edge is None:
            self.begun = None
            return
        place = project_on_path(np.array(edge.path_m), *point_m)
        if place.distance_m > MAX_SNAP_M:
            self._tell("No place here", f"The connection is {place.distance_m:.1f} m away: click on it.")
            return
        self.begun = NewPlace((place.x_m, place.y_m), edge_id=edge_id)

    def _merge(self, other_id: str, poi_id: str) -> None:
        if self._finish(edits.MergePois(poi_id, other_id)):
            self._select(("poi", poi_id))

    # ------------------------------------------------------------------------------------------- connections
    def propose(self) -> None:
        """Show the connections that would join all neighbours along the road."""
        self.set_mode(Mode.SELECT)
        self._begin_edges(edits.ProposeEdges(), is_proposal=True)

    def accept_edges(self) -> bool:
        """Add the pieces of road that are shown."""
        begun = self.begun
        if not isinstance(begun, NewEdges):
            return False
        edit = edits.ProposeEdges() if begun.is_proposal else edits.AddEdge(begun.edges[0].a, begun.edges[0].b)
        if begun.version != self.version and not self._is_still(begun, edit):
            return False
        before = self._model.graph.edges.keys()
        if not self._finish(edit):
            return False
        if not begun.is_proposal:
            self._select_new("edge", before)
        return True

    def _pick_for_edge(self, poi_id: str) -> None:
        begun = self.begun
        if isinstance(begun, NewEdges) and poi_id == begun.edges[0].b:
            self.accept_edges()
            return
        if isinstance(begun, EdgeFrom) and poi_id != begun.poi_id:
            self._begin_edges(edits.AddEdge(begun.poi_id, poi_id))
        else:
            self.begun = EdgeFrom(poi_id)
        self._select(("poi", poi_id))

    def _begin_edges(self, edit: edits.AddEdge | edits.ProposeEdges, is_proposal: bool = False) -> None:
        begun = self._new_edges(edit, is_proposal)
        if begun is not None:
            self.begun = begun

    def _new_edges(self, edit: edits.AddEdge | edits.ProposeEdges, is_proposal: bool) -> NewEdges | None:
        """What an edit would add now; None, and a sentence, where that is nothing."""
        before = self._model.graph
        try:
            after = self._model.preview(edit)
        except VbrError as error:
            self._tell("Nothing to connect" if is_proposal else "Not connected", str(error))
            return None
        added = tuple(edge for key, edge in after.edges.items() if key not in before.edges)
        return NewEdges(added, before.version, is_proposal) if added else None

    def _is_still(self, shown: NewEdges, edit: edits.AddEdge | edits.ProposeEdges) -> bool:
        """Whether the draft, which has changed, still gives what is shown; if not, what it gives is shown."""
        now = self._new_edges(edit, shown.is_proposal)
        if now is not None and now.is_like(shown):
            return True
        self.begun = now
        if now is not None:
            self._tell("Look again", "The map was changed meanwhile, and this would be added now: accept it once more.")
        return False

    # ------------------------------------------------------------------------------------------------- roads
    def accept_drawing(self) -> bool:
        """Make a road of the line that was drawn."""
        if not isinstance(self.begun, Drawing):
            return False
        before = self._model.graph.roads.keys()
        if len(self.begun.points_m) < 2:
            self._tell("No road yet", "A road needs two points: click where it goes on.")
            return False
        if not self._finish(edits.DrawRoad(self.begun.points_m)):
            return False
        self._select_new("road", before)
        return True

    def take_back(self) -> None:
        """Take the last point of what is being drawn back."""
        if isinstance(self.begun, Drawing):
            self.begun = Drawing(self.begun.points_m[:-1]) if len(self.begun.points_m) > 1 else None
        elif isinstance(self.begun, TrimmedRoad) and self.begun.start_m is not None:
            self.begun = TrimmedRoad(self.begun.road_id)

    @property
    def snapped_m(self) -> tuple[FloorPoint, ...]:
        """The ends of what is being drawn that lie on a road."""
        network = self._model.network
        if not isinstance(self.begun, Drawing) or network.is_empty:
            return ()
        ends = {self.begun.points_m[0]: None, self.begun.points_m[-1]: None}
        return tuple(end for end in ends if network.nearest(*end).distance_m < 1e-6)

    def _met(self, point_m: FloorPoint) -> FloorPoint:
        """A point near a road lies on it: what is drawn begins and ends on roads."""
        network = self._model.network
        if network.is_empty:
            return point_m
        place = network.nearest(*point_m)
        return place.xy_m if place.distance_m < MEET_M else point_m

    def _trim(self, road_id: str, start_m: FloorPoint | None, point_m: FloorPoint) -> None:
        if not self._near_road(road_id, point_m):
            return
        if start_m is None:
            place = project_on_path(self._road_path(road_id), *point_m)
            self.begun = TrimmedRoad(road_id, (place.x_m, place.y_m))
        else:
            self._finish(edits.TrimRoad(road_id, start_m, point_m))

    def _join(self, road_id: str, other_id: str) -> None:
        if self._finish(edits.JoinRoads(road_id, other_id)):
            self._select(("road", road_id))

    def _near_road(self, road_id: str, point_m: FloorPoint) -> bool:
        if road_id not in self._model.graph.roads:
            self.begun = None
            return False
        distance_m = project_on_path(self._road_path(road_id), *point_m).distance_m
        if distance_m > MAX_SNAP_M:
            self._tell("Not on the road", f"The road is {distance_m:.1f} m away: click on the one that is highlighted.")
        return distance_m <= MAX_SNAP_M

    def _road_at(self, point_m: FloorPoint) -> str | None:
        distances_m = {
            road_id: project_on_path(self._road_path(road_id), *point_m).distance_m
            for road_id in self._model.graph.roads
        }
        nearest = min(distances_m, key=distances_m.__getitem__, default=None)
        return nearest if nearest is not None and distances_m[nearest] <= PICK_ROAD_M else None

    def _road_path(self, road_id: str) -> FloatArray:
        return np.array(self._model.graph.roads[road_id].points_m)

    # ----------------------------------------------------------------------------------------------- changing
    def apply(self, edit: Edit, base_version: int | None = None) -> bool:
        """Make an edit; ``base_version`` is the version that was looked at. Return whether it was made."""
        self.put_down()
        done = self._apply(edit, base_version)
        if done and base_version is not None:
            self._seen_version = max(self._seen_version, base_version)
        return done

    def delete_selected(self) -> None:
        """Remove the selected place with its edges, the selected edge, or the selected road."""
        self.escape_move()
        if self.poi is not None:
            self._apply(edits.DeletePoi(self.poi.id), self._seen_version)
        elif self.edge is not None:
            self._apply(edits.DeleteEdge(self.edge.id), self._seen_version)
        elif self.road is not None:
            self._apply(edits.DeleteRoad(self.road.id), self._seen_version)

    def undo(self) -> None:
        """Take back the own latest edit."""
        self.put_down()
        self._attempt(lambda: self._model.undo(self._who))

    def redo(self) -> None:
        """Make again what was taken back last."""
        self.put_down()
        self._attempt(lambda: self._model.redo(self._who))

    def use_mine(self) -> None:
        """Make the edit that was refused, over the version of somebody else."""
        conflict, self.conflict = self.conflict, None
        if conflict is not None:
            self._seen_version = conflict.version
            if self._apply(conflict.edit, conflict.version) and self.begun is self._refused:
                self.begun = None

    def keep_theirs(self) -> None:
        """Leave the version of somebody else as it is."""
        conflict, self.conflict = self.conflict, None
        if conflict is not None:
            self._seen_version = conflict.version

    # ----------------------------------------------------------------------------------------------- moving
    def drag_to(self, poi_id: str, point_m: FloorPoint | None) -> None:
        """The place is being dragged over this point of the floor: it slides along the road, its edges follow."""
        if not self.may_edit or self.mode is not Mode.SELECT:
            return
        if self.moving_id != poi_id and poi_id in self._model.graph.pois:
            self._select(("poi", poi_id))
            self.begun = None
        self._hand.drag_to(poi_id, point_m)

    def drop(self, poi_id: str, point_m: FloorPoint | None) -> None:
        """The drag has ended: one edit, which one undo takes back."""
        if self.moving_id == poi_id:
            self.drag_to(poi_id, point_m)
            self.put_down()

    def nudge(self, towards: FloorPoint, step_m: float, now_s: float) -> None:
        """Move the selected place by a step in a direction: along the road, or freely where it stands free."""
        if self.poi is not None and self.may_edit:
            self._hand.nudge(self.poi, towards, step_m, now_s)

    def rest(self, now_s: float) -> None:
        """Time goes by: nudges that have come to rest become an edit."""
        self._hand.rest(now_s)

    def put_down(self) -> None:
        """End a move where it is: an edit, where it has led anywhere."""
        self._hand.put_down()

    def escape_move(self) -> None:
        """End a move as if it had never begun."""
        self._hand.let_go()

    def keep_up(self) -> None:
        """The draft has changed, by whomever: what is shown here and no longer there is let go of."""
        if self.begun is not None and things_gone(self.begun, self._model.graph):
            self.begun = None
        if self.selected is not None and self.poi is None and self.edge is None and self.road is None:
            self.selected = None
        self._hand.keep_up()

    # --------------------------------------------------------------------------------------------- internals
    def _finish(self, edit: Edit) -> bool:
        """Make the edit that was begun; where it is refused, it stays begun."""
        done = self._apply(edit, self._seen_version)
        if done:
            self.begun = None
        elif self.conflict is not None:
            self._refused = self.begun
        return done

    def _select_new(self, kind: ThingKind, before: Collection[str]) -> None:
        graph = self._model.graph
        of_kind: dict[ThingKind, Collection[str]] = {"poi": graph.pois, "edge": graph.edges, "road": graph.roads}
        new = next((key for key in of_kind[kind] if key not in before), None)
        self._select((kind, new) if new is not None else None)

    def _apply(self, edit: Edit, base_version: int | None = None) -> bool:
        def make() -> None:
            try:
                self._model.apply(edit, self._who, base_version)
            except EditConflictError as error:
                self.conflict = Conflict.of(edit, error)
                raise

        return self._attempt(make)

    def _attempt(self, action: Callable[[], object]) -> bool:
        if not self.may_edit:
            self._tell("Not changed", "Your role may look at the map, and not change it: ask an editor.")
            return False
        try:
            action()
        except VbrError as error:
            self._tell("Not changed", str(error))
            return False
        return True
