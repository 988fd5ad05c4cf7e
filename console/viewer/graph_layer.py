"""The PoI-graph in the scene of one client: tags with names, edges with their real lengths.

``show`` takes whole graphs and changes only what differs from what it drew last. While a tag is being dragged, its own
edges are drawn by a light layer of their own, so that the others need not be sent again.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
import viser

from console.viewer import appearance as look
from console.viewer import meshes
from console.viewer.appearance import DARK, Rgb, Theme
from console.viewer.meshes import Placements
from console.viewer.preview_layer import show_lines
from console.viewer.tag import Tag
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import Edge, Poi, PoiGraph

_EDGE_Z_M, _HALO_Z_M = 0.07, 0.04
_EDGE_RADIUS_M = 0.08
_MOVING_Z_M = 0.12
_ARROW_SPACING_M = 1.6
_NEW_TAGS_COUNT = 40
"""Tags that are added at once: many take so long that other windows would wait for them."""
_MOST_LENGTHS_COUNT = 150
"""With more edges than this, lengths are shown at the selected edge and while dragging alone."""

ScreenPos = tuple[float, float]
PickPoi = Callable[[str, ScreenPos], Awaitable[None]]
DragPoi = Callable[[str, viser.SceneNodeDragEvent], Awaitable[None]]  # type: ignore[type-arg]


@dataclass(frozen=True, slots=True)
class Highlight:
    """What stands out: the selected place or edge, and a place that is being dragged."""

    poi_id: str | None = None
    edge_id: str | None = None
    moving_id: str | None = None


@dataclass(frozen=True, slots=True)
class GraphHandlers:
    """What happens when something is picked; ``drag_poi`` is None for who may not edit."""

    pick_poi: PickPoi
    pick_edge: PickPoi
    drag_poi: DragPoi | None = None


class GraphLayer:
    """Draws PoI-graphs for one client."""

    def __init__(self, client: viser.ClientHandle, handlers: GraphHandlers) -> None:
        self._client = client
        self._handlers = handlers
        self._theme = DARK
        self._tags: dict[str, Tag] = {}
        self._lengths: dict[str, viser.LabelHandle] = {}
        self._labelled: dict[str, Edge] = {}
        self._drawn_edges: tuple[Edge, ...] = ()
        self._drawn_selection: str | None = None
        self._pieces: dict[str, tuple[Edge, list[Placements]]] = {}
        self.instances: list[str] = []
        self.is_complete = False
        """Whether all tags are there; else the next ``show`` adds more of them."""
        self._tubes: viser.BatchedMeshHandle | None = None
        self._arrows: viser.BatchedMeshHandle | None = None
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._moving = client.scene.add_line_segments(
            "/graph/moving", nothing, DARK.preview, thickness=6.0, thickness_units="screen", visible=False
        )
        halo = meshes.ring(0.5, 0.1)
        self._halo = client.scene.add_mesh_simple(
            "/graph/halo", halo.vertices_m, halo.faces, color=DARK.ring, side="double", visible=False,
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    @property
    def tags(self) -> dict[str, Tag]:
        """The tags as drawn, by PoI."""
        return self._tags

    @property
    def length_labels(self) -> dict[str, viser.LabelHandle]:
        """The labels with lengths as drawn, by edge."""
        return self._lengths

    def set_theme(self, theme: Theme) -> None:
        """Draw in other colours from now on; what is there is drawn anew by the next ``show``."""
        self._theme = theme
        self._moving.colors = np.array(theme.preview, dtype=np.uint8)
        self._halo.color = theme.ring
        self._drawn_edges, self._drawn_selection = (), None

    def show(self, graph: PoiGraph, highlight: Highlight) -> None:
        """Draw a graph."""
        moving_id = highlight.moving_id
        moving = [e for e in graph.edges.values() if moving_id in (e.a, e.b)] if moving_id is not None else []
        still = tuple(e for e in graph.edges.values() if moving_id not in (e.a, e.b)) if moving else (
            tuple(graph.edges.values())
        )  # fmt: skip
        with self._client.atomic():
            self._show_tags(graph)
            self.is_complete = len(self._tags) == len(graph.pois)
            self._show_halo(graph.pois.get(moving_id or highlight.poi_id or ""))
            self._show_still(still, highlight.edge_id)
            show_lines(self._moving, [np.array(edge.path_m) for edge in moving], _MOVING_Z_M)
            self._show_lengths(graph, highlight, moving)

    # -------------------------------------------------------------------------------------------------- tags
    def _show_tags(self, graph: PoiGraph) -> None:
        for poi_id in self._tags.keys() - graph.pois.keys():
            self._tags.pop(poi_id).remove()
        room = _NEW_TAGS_COUNT
        for poi in graph.pois.values():
            tag = self._tags.get(poi.id)
            if tag is None and room == 0:
                continue
            if tag is None:
                room -= 1
                self._tags[poi.id] = Tag(self._client, poi, self._handlers.pick_poi, self._handlers.drag_poi)
            else:
                tag.show(poi)

    def _show_halo(self, poi: Poi | None) -> None:
        self._halo.visible = poi is not None
        if poi is not None:
            self._halo.position = (poi.x_m, poi.y_m, _HALO_Z_M)

    # ------------------------------------------------------------------------------------------------- edges
    def _show_still(self, edges: tuple[Edge, ...], selected_id: str | None) -> None:
        if edges == self._drawn_edges and selected_id == self._drawn_selection:
            return
        if edges == self._drawn_edges and self._tubes is not None:
            self._drawn_selection = selected_id
            self._tubes.batched_colors = self._colours(edges, selected_id)
            return
        self._drawn_edges, self._drawn_selection = edges, selected_id
        self._draw_tubes(edges, selected_id)
        self._draw_arrows([edge for edge in edges if edge.one_way])

    def _draw_tubes(self, edges: tuple[Edge, ...], selected_id: str | None) -> None:
        pieces = [(edge.id, placed) for edge in edges for placed in self._placed(edge)]
        self.instances = [edge_id for edge_id, placed in pieces for _ in placed.positions_m]
        if not pieces:
            if self._tubes is not None:
                self._tubes.remove()
                self._tubes = None
            return
        tube = meshes.unit_cylinder()
        self._tubes = self._client.scene.add_batched_meshes_simple(
            "/graph/edges", tube.vertices_m, tube.faces,
            np.vstack([placed.quats_wxyz for _, placed in pieces]),
            np.vstack([placed.positions_m for _, placed in pieces]),
            batched_scales=np.vstack([placed.scales for _, placed in pieces]),
            batched_colors=self._colours(edges, selected_id),
            lod="off", material="toon3", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self._tubes.on_click(self._on_edge_click)

    def _placed(self, edge: Edge) -> list[Placements]:
        """Return where the pieces of an edge stand, worked out once."""
        known = self._pieces.get(edge.id)
        if known is None or known[0] is not edge:
            placed = [meshes.along(piece, _EDGE_RADIUS_M, _EDGE_Z_M) for piece in _cut(edge)]
            known = self._pieces[edge.id] = edge, [each for each in placed if len(each.positions_m)]
        return known[1]

    async def _on_edge_click(self, event: viser.SceneNodePointerEvent) -> None:  # type: ignore[type-arg]
        if event.instance_index is not None and 0 <= event.instance_index < len(self.instances):
            await self._handlers.pick_edge(self.instances[event.instance_index], event.screen_pos)

    def _colours(self, edges: tuple[Edge, ...], selected_id: str | None) -> np.ndarray:
        colour_of = {edge.id: _edge_colour(edge, selected_id, self._theme) for edge in edges}
        return np.array([colour_of[edge_id] for edge_id in self.instances], dtype=np.uint8)

    def _draw_arrows(self, edges: list[Edge]) -> None:
        if self._arrows is not None:
            self._arrows.remove()
            self._arrows = None
        spots = [meshes.spaced(np.array(edge.path_m), _ARROW_SPACING_M, _ARROW_SPACING_M / 2) for edge in edges]
        spots = [(points, directions) for points, directions in spots if len(points)]
        if not spots:
            return
        points, directions = np.vstack([p for p, _ in spots]), np.vstack([d for _, d in spots])
        cone, count = meshes.unit_cone(), len(points)
        self._arrows = self._client.scene.add_batched_meshes_simple(
            "/graph/arrows", cone.vertices_m, cone.faces,
            meshes.quats_from_z_to(np.column_stack([directions, np.zeros(count)])),
            np.column_stack([points, np.full(count, _EDGE_Z_M)]),
            batched_scales=np.tile((0.15, 0.15, 0.34), (count, 1)), batched_colors=self._theme.arrow,
            lod="off", material="toon3",
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    # ----------------------------------------------------------------------------------------------- lengths
    def _show_lengths(self, graph: PoiGraph, highlight: Highlight, moving: list[Edge]) -> None:
        few = len(graph.edges) <= _MOST_LENGTHS_COUNT
        shown = {e.id: e for e in graph.edges.values() if few or e.id == highlight.edge_id or e in moving}
        for edge_id in self._lengths.keys() - shown.keys():
            self._lengths.pop(edge_id).remove()
            self._labelled.pop(edge_id, None)
        for edge in shown.values():
            label = self._lengths.get(edge.id)
            if label is not None and self._labelled.get(edge.id) is edge:
                continue
            self._labelled[edge.id] = edge
            x_m, y_m = meshes.middle_of(np.array(edge.path_m))
            if label is None:
                label = self._lengths[edge.id] = self._client.scene.add_label(
                    f"/graph/length/{edge.id}", "", font_screen_scale=0.75, anchor="center-center"
                )
            label.text = _edge_words(edge)
            label.position = (x_m, y_m, 0.25)


def _edge_words(edge: Edge) -> str:
    words = [look.metres_text(edge.length_m)]
    if edge.closed:
        words.append("closed")
    if edge.cost_multiplier > 1.0:
        words.append(f"× {edge.cost_multiplier:g}")
    if edge.width_m is not None:
        words.append(f"{edge.width_m:g} m wide")
    if edge.caution_side != "none":
        words.append("caution")
    return " · ".join(words)


def _edge_colour(edge: Edge, selected_id: str | None, theme: Theme) -> Rgb:
    if edge.id == selected_id:
        return theme.selected
    return theme.edge_closed if edge.closed else theme.edge


def _cut(edge: Edge) -> list[FloatArray]:
    """Return the pieces that are drawn: the whole path, or dashes where the edge is closed."""
    path = meshes.simplified(np.array(edge.path_m))
    return meshes.dashes(path, 0.35, 0.3) if edge.closed else [path]
