"""What one person is doing to the PoI-graph: mode, selection, a drag, a place or an edge about to be added.

No viser here: clicks and drags come in as points on the floor, and the scene draws what stands here. Every change goes
through the model; what the model refuses leaves everything as it was, and is told in its own sentence.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from console.edits import AddEdge, AddPoi, DeleteEdge, DeletePoi, Edit, MovePoi, ProposeEdges, SetEdge, UpdatePoi
from console.model import SiteModel
from console.roles import EDITING, SignedIn
from console.viewer.appearance import metres_text
from navcore.errors import VbrError
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, PoiKind

MAX_SNAP_M = 1.0
"""A click farther from the road than this is no tag on it."""
Tell = Callable[[str, str], None]
"""Shows a heading and a sentence to the person."""
FloorPoint = tuple[float, float]


class Mode(enum.Enum):
    """What a click does."""

    SELECT = "select"
    TAG = "tag"
    CONNECT = "connect"


@dataclass(frozen=True, slots=True)
class PendingEdge:
    """A piece of road between two places that is shown, and not yet accepted."""

    a: str
    b: str
    path_m: FloatArray
    length_m: float


class Editor:
    """The editing of one person in one browser window. Used from one thread: the scene's loop."""

    def __init__(self, model: SiteModel, person: SignedIn, tell: Tell) -> None:
        self._model = model
        self._who = person.user_name
        self.may_edit = person.role in EDITING
        self._tell = tell
        self.mode = Mode.SELECT
        self.poi_id: str | None = None
        self.edge_id: str | None = None
        self.moving_id: str | None = None
        self.connect_from: str | None = None
        self.pending_edge: PendingEdge | None = None
        self.pending_tag: FloorPoint | None = None
        self._moved: PoiGraph | None = None
        self._moved_to: FloorPoint | None = None
        self._refusal = ""

    # ------------------------------------------------------------------------------------------------ reading
    @property
    def graph(self) -> PoiGraph:
        """The graph to draw: the draft, or what it would be if the drag ended here."""
        return self._model.graph if self._moved is None else self._moved

    @property
    def poi(self) -> Poi | None:
        """The selected place, as long as it exists."""
        return self._model.graph.pois.get(self.poi_id or "")

    @property
    def edge(self) -> Edge | None:
        """The selected edge, as long as it exists."""
        return self._model.graph.edges.get(self.edge_id or "")

    @property
    def can_undo(self) -> bool:
        """Whether there is an own edit to take back."""
        return self._model.can_undo(self._who)

    @property
    def can_redo(self) -> bool:
        """Whether there is an edit to make again."""
        return self._model.can_redo(self._who)

    @property
    def hint(self) -> str:
        """What to do next, in one sentence."""
        if self.mode is Mode.TAG:
            return "Name the place, then add it." if self.pending_tag else "Click on the road where the place is."
        if self.mode is Mode.CONNECT:
            return self._connect_hint()
        if not self.may_edit:
            return "Click a place to see what it is."
        return "Click a place or a connection. Drag a place along the road."

    def _connect_hint(self) -> str:
        if self.pending_edge is not None:
            a, b = self._name(self.pending_edge.a), self._name(self.pending_edge.b)
            return f"{a} – {b}: {metres_text(self.pending_edge.length_m)} along the road. Press Enter to connect."
        if self.connect_from is not None:
            return f"From {self._name(self.connect_from)}: click the other place."
        return "Click the two places to connect."

    def _name(self, poi_id: str) -> str:
        poi = self._model.graph.pois.get(poi_id)
        return poi.name if poi is not None else "?"

    # --------------------------------------------------------------------------------------------- selecting
    def set_mode(self, mode: Mode) -> None:
        """Go over to another mode; what was begun is dropped."""
        self.mode = mode if self.may_edit else Mode.SELECT
        self._drop_begun()

    def escape(self) -> None:
        """Drop what was begun; else leave the mode; else select nothing."""
        if self._has_begun():
            self._drop_begun()
        elif self.mode is not Mode.SELECT:
            self.mode = Mode.SELECT
        else:
            self.poi_id = self.edge_id = None

    def select(self, poi_id: str | None = None, edge_id: str | None = None) -> None:
        """Select a place, an edge, or nothing."""
        self.poi_id, self.edge_id = poi_id, edge_id

    def pick_poi(self, poi_id: str) -> None:
        """A place was clicked."""
        if self.mode is Mode.CONNECT:
            self._pick_for_edge(poi_id)
        else:
            self._drop_begun()
            self.select(poi_id=poi_id)

    def pick_edge(self, edge_id: str) -> None:
        """An edge was clicked."""
        if self.mode is Mode.SELECT:
            self.select(edge_id=edge_id)

    def pick_floor(self, point_m: FloorPoint | None) -> None:
        """The floor was clicked, or nothing at all."""
        if self.mode is Mode.TAG and point_m is not None:
            self._begin_tag(point_m)
        elif self.mode is Mode.SELECT:
            self.select()

    # ---------------------------------------------------------------------------------------------- changing
    def add_pending_tag(self, name: str, kind: PoiKind) -> bool:
        """Add the place where the road was clicked; return whether it was taken."""
        if self.pending_tag is None:
            return False
        before = self._model.graph
        x_m, y_m = self.pending_tag
        if not self._apply(AddPoi(name.strip(), kind, x_m, y_m)):
            return False
        self.pending_tag = None
        self.select(poi_id=next(iter(self._model.graph.pois.keys() - before.pois.keys()), None))
        return True

    def rename(self, name: str) -> bool:
        """Give the selected place another name."""
        return self.poi is not None and self._apply(UpdatePoi(self.poi.id, name=name.strip()))

    def update_poi(self, edit: UpdatePoi) -> bool:
        """Change kind or spoken name of a place."""
        return self._apply(edit)

    def set_edge(self, edit: SetEdge) -> bool:
        """Change how an edge may be walked."""
        return self._apply(edit)

    def delete_selected(self) -> None:
        """Remove the selected place with its edges, or the selected edge."""
        if self.poi is not None:
            self._apply(DeletePoi(self.poi.id))
        elif self.edge is not None:
            self._apply(DeleteEdge(self.edge.id))

    def propose_edges(self) -> int:
        """Connect all neighbours along the road; return how many edges came of it."""
        before = len(self._model.graph.edges)
        return len(self._model.graph.edges) - before if self._apply(ProposeEdges()) else 0

    def undo(self) -> None:
        """Take back the own latest edit."""
        self._attempt(lambda: self._model.undo(self._who))

    def redo(self) -> None:
        """Make again what was taken back last."""
        self._attempt(lambda: self._model.redo(self._who))

    # ---------------------------------------------------------------------------------------------- dragging
    def drag_to(self, poi_id: str, point_m: FloorPoint | None) -> None:
        """The place is being dragged over this point of the floor: it slides along the road, its edges follow."""
        poi = self._model.graph.pois.get(poi_id)
        if poi is None or self.mode is Mode.CONNECT or not self.may_edit:
            self._end_drag()
            return
        if self.moving_id != poi_id:
            self._end_drag()
            self.select(poi_id=poi_id)
        self.moving_id = poi_id
        if point_m is None:
            return
        try:
            point_m = self._slid(poi, point_m)
            self._moved = self._model.preview(_move(poi, point_m))
        except VbrError as error:
            # Held at the last good place; said once, when the drag ends there.
            self._refusal = str(error)
        else:
            self._moved_to, self._refusal = point_m, ""

    def drop(self, poi_id: str, point_m: FloorPoint | None) -> None:
        """The drag has ended: one edit, which one undo takes back."""
        self.drag_to(poi_id, point_m)
        poi, target, refusal = self._model.graph.pois.get(poi_id), self._moved_to, self._refusal
        self._end_drag()
        if refusal:
            self._tell("Not moved that far", refusal)
        if poi is not None and target is not None:
            self._apply(_move(poi, target))

    def _slid(self, poi: Poi, point_m: FloorPoint) -> FloorPoint:
        """A place on the road stays on it, wherever the hand is."""
        return self._model.network.nearest(*point_m).xy_m if poi.on_road else point_m

    def _end_drag(self) -> None:
        self.moving_id = self._moved = self._moved_to = None
        self._refusal = ""

    # -------------------------------------------------------------------------------------------- connecting
    def _pick_for_edge(self, poi_id: str) -> None:
        if self.pending_edge is not None and poi_id == self.pending_edge.b:
            self.accept_edge()
        elif self.connect_from is None or poi_id == self.connect_from:
            self.connect_from, self.pending_edge = poi_id, None
        else:
            self._begin_edge(self.connect_from, poi_id)
        self.select(poi_id=poi_id)

    def _begin_edge(self, a: str, b: str) -> None:
        before = self._model.graph
        try:
            after = self._model.preview(AddEdge(a, b))
        except VbrError as error:
            self._tell("Not connected", str(error))
            return
        added = [after.edges[key] for key in after.edges.keys() - before.edges.keys()]
        if added:
            self.pending_edge = PendingEdge(a, b, np.array(added[0].path_m), added[0].length_m)

    def accept_edge(self) -> bool:
        """Add the piece of road that is shown."""
        pending = self.pending_edge
        if pending is None:
            return False
        before = self._model.graph
        accepted = self._apply(AddEdge(pending.a, pending.b))
        self._drop_begun()
        if accepted:
            self.select(edge_id=next(iter(self._model.graph.edges.keys() - before.edges.keys()), None))
        return accepted

    # --------------------------------------------------------------------------------------------- internals
    def _begin_tag(self, point_m: FloorPoint) -> None:
        try:
            place = self._model.network.nearest(*point_m)
        except VbrError as error:
            self._tell("No place here", str(error))
            return
        if place.distance_m > MAX_SNAP_M:
            self._tell("No place here", f"The road is {place.distance_m:.1f} m away: click on the yellow line.")
            return
        self.pending_tag = place.xy_m

    def _has_begun(self) -> bool:
        return any(begun is not None for begun in (self.connect_from, self.pending_edge, self.pending_tag))

    def _drop_begun(self) -> None:
        self.connect_from = self.pending_edge = self.pending_tag = None
        self._end_drag()

    def _apply(self, edit: Edit) -> bool:
        return self._attempt(lambda: self._model.apply(edit, self._who))

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


def _move(poi: Poi, point_m: FloorPoint) -> MovePoi:
    return MovePoi(poi.id, point_m[0], point_m[1], on_road=poi.on_road)
