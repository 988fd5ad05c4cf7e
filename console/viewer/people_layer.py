"""What other people have selected, in the scene of one client: a ring round it, and their name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser

from console.edits import Thing
from console.presence import Present
from console.viewer import meshes
from console.viewer.appearance import PEOPLE, Rgb
from console.viewer.begun import FloorPoint, name_of
from console.viewer.labels import LabelSpot
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import PoiGraph

MAX_RINGS_COUNT = 12
"""More windows than this are named in the panel alone."""
_RING_M, _NAME_SCALE = 0.66, 0.85
_DOING = {"looking": "looks at", "editing": "edits", "dragging": "moves", "drawing": "draws"}


@dataclass(slots=True)
class _Ring:
    ring: viser.MeshHandle
    name: viser.LabelHandle


class PeopleLayer:
    """Draws other people's selections for one client; the nodes are made when they are first needed, and kept."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._rings: list[_Ring] = []

    @property
    def shown(self) -> list[tuple[str, FloorPoint]]:
        """The names that are drawn, and where."""
        return [
            (each.name.text, (float(each.ring.position[0]), float(each.ring.position[1])))
            for each in self._rings
            if each.ring.visible
        ]

    @property
    def spots(self) -> tuple[LabelSpot, ...]:
        """The names as other labels must keep clear of them."""
        return tuple(
            LabelSpot(f"person {number}", each.name.text, _as_place(each.name.position), 8, _NAME_SCALE)
            for number, each in enumerate(self._rings)
            if each.name.visible
        )

    def show(self, others: Sequence[Present], graph: PoiGraph) -> None:
        """Draw what they have selected."""
        spots = [(present, place_of(present.thing, graph)) for present in others]
        placed = [(present, place) for present, place in spots if place is not None][:MAX_RINGS_COUNT]
        with self._client.atomic():
            for number, (present, place) in enumerate(placed):
                if number == len(self._rings):
                    self._rings.append(self._add_ring(number))
                each = self._rings[number]
                each.ring.position = (*place, 0.05)
                each.name.position = (place[0], place[1] - _RING_M - 0.25, 0.05)
                each.ring.color = colour_of(present.user_name)
                each.name.text = present.user_name
                each.ring.visible = each.name.visible = True
            for each in self._rings[len(placed) :]:
                each.ring.visible = each.name.visible = False

    def _add_ring(self, number: int) -> _Ring:
        mesh = meshes.ring(_RING_M, 0.08)
        name = f"/people/{number}"
        return _Ring(
            self._client.scene.add_mesh_simple(
                name, mesh.vertices_m, mesh.faces, color=PEOPLE[0], side="double", cast_shadow=False,
                receive_shadow=False,
            ),
            self._client.scene.add_label(f"{name}_name", "", anchor="center-center", font_screen_scale=_NAME_SCALE),
        )  # fmt: skip


def _as_place(position: FloatArray) -> tuple[float, float, float]:
    x_m, y_m, z_m = (float(part) for part in position)
    return x_m, y_m, z_m


def colour_of(user_name: str) -> Rgb:
    """The same colour for the same name, in every window."""
    return PEOPLE[sum(user_name.encode()) % len(PEOPLE)]


def place_of(thing: Thing | None, graph: PoiGraph) -> FloorPoint | None:
    """Return where on the floor a thing is; None where there is none."""
    if thing is None:
        return None
    kind, key = thing
    if kind == "poi":
        poi = graph.pois.get(key)
        return None if poi is None else (poi.x_m, poi.y_m)
    line = graph.edges[key].path_m if kind == "edge" and key in graph.edges else None
    if kind == "road" and key in graph.roads:
        line = graph.roads[key].points_m
    return None if line is None else meshes.middle_of(np.array(line))


def words_of(present: Present, graph: PoiGraph) -> str:
    """Say what somebody does, as ``Ben moves Hall``."""
    where = " (tables)" if present.where == "tables" else ""
    if present.thing is None:
        doing = {"drawing": "is drawing a road", "editing": "is editing"}.get(present.doing, "is here")
        return f"{present.user_name} {doing}{where}"
    return f"{present.user_name} {_DOING[present.doing]} {_thing_words(present.thing, graph)}{where}"


def _thing_words(thing: Thing, graph: PoiGraph) -> str:
    kind, key = thing
    if kind == "poi":
        return name_of(graph, key)
    edge = graph.edges.get(key) if kind == "edge" else None
    if edge is not None:
        return f"{name_of(graph, edge.a)} – {name_of(graph, edge.b)}"
    return f"road {key.removeprefix('r')}" if kind == "road" else "a connection that is gone"
