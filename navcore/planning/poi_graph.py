"""The PoI-graph (paper IV-A): places of interest on the virtual blind road, the pieces of road between them, the road.

Values only: a graph is never changed, an edit makes a new one (see :mod:`navcore.planning.edits`). A PoI snaps to
the road, unless it says that it is free-standing. An edge *is* a piece of the road; its length is the real one.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

PoiKind = Literal[
    "room", "toilet", "bar", "lounge", "hall", "junction", "lift", "stairs", "door", "entrance", "exit", "other"
]
POI_KINDS: tuple[str, ...] = PoiKind.__args__  # type: ignore[attr-defined]  # a Literal's own

CautionSide = Literal["none", "left", "right", "both"]
CAUTION_SIDES: tuple[str, ...] = CautionSide.__args__  # type: ignore[attr-defined]  # a Literal's own
RoadOrigin = Literal["recorded", "drawn"]

Identifier = Annotated[str, msgspec.Meta(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_-]+$")]
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=80)]
Metres = Annotated[float, msgspec.Meta(ge=-100_000.0, le=100_000.0)]
WidthMetres = Annotated[float, msgspec.Meta(ge=0.3, le=50.0)]


class Poi(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A place of interest: a node of the PoI-graph."""

    id: Identifier
    name: Name
    kind: PoiKind
    x_m: Metres
    y_m: Metres
    on_road: bool = True
    """Snapped to the virtual blind road; a free-standing PoI is shown as such and is no destination."""
    spoken_name: Annotated[str, msgspec.Meta(max_length=80)] = ""
    """What the walker hears; the name where this is empty. A junction without one is passed in silence."""
    notes: Annotated[str, msgspec.Meta(max_length=2000)] = ""


class Edge(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A piece of the virtual blind road between two PoIs."""

    id: Identifier
    a: Identifier
    b: Identifier
    path_m: tuple[tuple[Metres, Metres], ...]
    """The road's own geometry from a to b, points (n, 2), n ≥ 2."""
    length_m: Annotated[float, msgspec.Meta(ge=0.0)]
    """Real length of the piece: the paper's weight."""
    one_way: bool = False
    """Only from a to b."""
    closed: bool = False
    cost_multiplier: Annotated[float, msgspec.Meta(ge=1.0, le=100.0)] = 1.0
    """1.0 is the paper's shortest path; never below, so that the straight line stays a lower bound for A*."""
    width_m: WidthMetres | None = None
    """Free width of the passage, as somebody has measured it; None where nobody has."""
    caution_side: CautionSide = "none"
    """On which side, walking from a to b, something asks for caution: an open stairwell, a row of doors."""


class Road(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A line of the virtual blind road, as it was recorded and edited, or drawn by hand."""

    id: Identifier
    points_m: tuple[tuple[Metres, Metres], ...]
    """Points (n, 2), n ≥ 2."""
    origin: RoadOrigin = "recorded"
    """Nobody has walked what is drawn: it is shown as such, and the map may not know it."""


class PoiGraph(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All PoIs and edges of a site, by identifier."""

    version: Annotated[int, msgspec.Meta(ge=0, le=1 << 53)] = 0
    """Grows with every edit; the device acknowledges the one that it runs."""
    pois: dict[str, Poi] = {}
    edges: dict[str, Edge] = {}
    roads: dict[str, Road] = {}
    """The lines that PoIs and edges lie on, where the graph is edited; devices walk along edges, and are given none."""

    def loose_edge(self) -> Edge | None:
        """Return an edge that does not join two different places of this graph; None where all do."""
        for edge in self.edges.values():
            if edge.a == edge.b or edge.a not in self.pois or edge.b not in self.pois:
                return edge
        return None
