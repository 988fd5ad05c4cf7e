"""What an edit changed in the PoI-graph: before and after, thing by thing.

One small value serves undo (the inverse), the log on disk (replay gives the same graph) and conflicts (what is there
now is not what the change left behind).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal, TypeVar

import msgspec

from console.errors import ConflictError
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road

Thing = Poi | Edge | Road
Item = TypeVar("Item", Poi, Edge, Road)


class GraphDelta(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The PoIs, edges and roads that differ, each as (before, after); None where there was, or is, none."""

    pois: dict[str, tuple[Poi | None, Poi | None]] = {}
    edges: dict[str, tuple[Edge | None, Edge | None]] = {}
    roads: dict[str, tuple[Road | None, Road | None]] = {}

    @property
    def is_empty(self) -> bool:
        """Whether nothing differs."""
        return not self.pois and not self.edges and not self.roads

    def inverse(self) -> GraphDelta:
        """Return the change that takes this one back."""
        return GraphDelta(
            {key: (after, before) for key, (before, after) in self.pois.items()},
            {key: (after, before) for key, (before, after) in self.edges.items()},
            {key: (after, before) for key, (before, after) in self.roads.items()},
        )


def difference(before: PoiGraph, after: PoiGraph) -> GraphDelta:
    """Return what leads from one graph to another."""
    return GraphDelta(
        _differing(before.pois, after.pois),
        _differing(before.edges, after.edges),
        {} if before.roads is after.roads else _differing(before.roads, after.roads),
    )


def apply_delta(graph: PoiGraph, delta: GraphDelta, version: int) -> PoiGraph:
    """Return the graph with the change made, as ``version``.

    Raises ConflictError where the graph does not hold what the change starts from, or would no longer be whole.
    """
    roads = _with(graph.roads, delta.roads, graph) if delta.roads else graph.roads
    changed = PoiGraph(version, _with(graph.pois, delta.pois, graph), _with(graph.edges, delta.edges, graph), roads)
    for edge in changed.edges.values():
        if edge.a not in changed.pois or edge.b not in changed.pois:
            raise ConflictError(f"{_label(edge, graph)} was drawn since: delete it first.")
    return changed


def changed_by(delta: GraphDelta) -> Iterator[tuple[Literal["poi", "edge", "road"], str]]:
    """Return the things that a change is about, by kind and identifier.

    A connection of which only the geometry differs has merely followed a place or the road: it is computed anew each
    time, and nobody's decision about it is lost.
    """
    yield from (("poi", key) for key in delta.pois)
    yield from (("edge", key) for key, (before, after) in delta.edges.items() if not _has_followed(before, after))
    yield from (("road", key) for key in delta.roads)


def _has_followed(before: Edge | None, after: Edge | None) -> bool:
    if before is None or after is None:
        return False
    return msgspec.structs.replace(before, path_m=after.path_m, length_m=after.length_m) == after


def _differing(before: Mapping[str, Item], after: Mapping[str, Item]) -> dict[str, tuple[Item | None, Item | None]]:
    keys = [*before, *(key for key in after if key not in before)]
    pairs = ((key, before.get(key), after.get(key)) for key in keys)
    # Most things are the very same: only the others are compared.
    return {key: (old, new) for key, old, new in pairs if old is not new and old != new}


def _with(
    items: Mapping[str, Item], changes: Mapping[str, tuple[Item | None, Item | None]], graph: PoiGraph
) -> dict[str, Item]:
    result = dict(items)
    for key, (before, after) in changes.items():
        if result.get(key) != before:
            raise ConflictError(f"{_label(result.get(key) or before, graph)} was changed meanwhile: change it by hand.")
        if after is None:
            result.pop(key, None)
        else:
            result[key] = after
    return result


def _label(item: Thing | None, graph: PoiGraph) -> str:
    match item:
        case Poi(name=name):
            return f"The place “{name}”"
        case Edge(a=a, b=b):
            ends = (graph.pois[end].name if end in graph.pois else end for end in (a, b))
            return f"The connection {' – '.join(ends)}"
        case Road(id=road_id):
            return f"Road {road_id.removeprefix('r')}"
        case _:
            return "Something"
