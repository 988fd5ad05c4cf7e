"""Changes of the draft in words: for the history, the audit, and the difference between two versions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from console import edits
from console.graph_delta import GraphDelta, Thing
from console.graph_log import LogEntry
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road
from navcore.planning.projection import project_on_path

_GEOMETRY = ("path_m", "points_m")
_SAME_LINE_M = 0.01
_KINDS = {
    "seed": "Took over what the map came with",
    "undo": "Took back",
    "redo": "Made again",
    "import": "Imported",
    "rollback": "Went back to version",
}


def sentence_of(entry: LogEntry) -> str:
    """Return one change in a few words, as ``Moved Hall``."""
    if entry.edit is not None:
        return _edit_words(entry.edit, entry.delta)
    beginning = _KINDS.get(entry.kind, entry.kind)
    if entry.kind == "rollback":
        return f"{beginning} {entry.target_version}"
    if entry.kind in ("undo", "redo"):
        return f"{beginning} version {entry.target_version}: {_summary(entry.delta)}"
    return f"{beginning}: {entry.why or _summary(entry.delta)}"


def _edit_words(edit: edits.Edit, delta: GraphDelta) -> str:
    match edit:
        case edits.AddPoi(name):
            return f"Tagged {name}"
        case edits.MovePoi(poi_id):
            return f"Moved {_poi_name(delta, poi_id)}"
        case edits.UpdatePoi(poi_id):
            return f"Changed {_poi_name(delta, poi_id)}: {_changed_fields(delta, poi_id)}"
        case edits.DeletePoi(poi_id):
            return f"Deleted {_poi_name(delta, poi_id)}"
        case edits.MergePois(_, other_id):
            return f"Merged {_poi_name(delta, other_id)} into another place"
        case edits.ProposeEdges():
            return f"Joined neighbours: {len(delta.edges)} connections"
        case edits.AddEdge() | edits.DeleteEdge() | edits.SetEdge():
            return {"AddEdge": "Joined", "DeleteEdge": "Cut", "SetEdge": "Changed"}[type(edit).__name__] + (
                " a connection"
            )
        case edits.SplitEdge(name=name):
            return f"Tagged {name} on a connection"
        case _:
            return _ROAD_WORDS[type(edit)]


_ROAD_WORDS: dict[type, str] = {
    edits.DrawRoad: "Drew a road",
    edits.TrimRoad: "Trimmed a road",
    edits.SmoothRoad: "Smoothed a road",
    edits.SplitRoad: "Cut a road in two",
    edits.JoinRoads: "Joined two roads",
    edits.DeleteRoad: "Deleted a road",
}


def _poi_name(delta: GraphDelta, poi_id: str) -> str:
    before, after = delta.pois.get(poi_id, (None, None))
    poi = before or after
    return poi.name if poi is not None else poi_id


def _changed_fields(delta: GraphDelta, poi_id: str) -> str:
    before, after = delta.pois.get(poi_id, (None, None))
    return ", ".join(_fields(before, after)).replace("_", " ") or "nothing"


def _summary(delta: GraphDelta) -> str:
    counts = ((len(delta.pois), "place"), (len(delta.edges), "connection"), (len(delta.roads), "road"))
    words = [f"{count} {word}{'s' if count > 1 else ''}" for count, word in counts if count]
    return ", ".join(words) or "nothing"


def described(delta: GraphDelta, before: PoiGraph, after: PoiGraph) -> list[dict[str, Any]]:
    """Return a difference thing by thing, as plain data: what, its name, added, removed or changed, and the fields.

    Of a place that is added, where it lies as well: ``at_m``, x and y.
    """
    return [
        *(_described("poi", key, pair, before, after) for key, pair in delta.pois.items()),
        *(_described("edge", key, pair, before, after) for key, pair in delta.edges.items()),
        *(_described("road", key, pair, before, after) for key, pair in delta.roads.items()),
    ]


def _described(
    kind: str, key: str, pair: tuple[Thing | None, Thing | None], before: PoiGraph, after: PoiGraph
) -> dict[str, Any]:
    old, new = pair
    change = "added" if old is None else "removed" if new is None else "changed"
    graph, thing = (before, old) if new is None else (after, new)
    fields = _fields(old, new) if old is not None and new is not None else {}
    where = {"at_m": [new.x_m, new.y_m]} if old is None and isinstance(new, Poi) else {}
    return {"kind": kind, "id": key, "name": _name_of(thing, graph), "change": change, "fields": fields, **where}


def _name_of(thing: Thing | None, graph: PoiGraph) -> str:
    match thing:
        case Poi(name=name):
            return name
        case Edge(a=a, b=b):
            return " – ".join(graph.pois[end].name if end in graph.pois else end for end in (a, b))
        case Road(id=road_id):
            return f"Road {road_id.removeprefix('r')}"
        case _:
            return ""


def _fields(old: Thing | None, new: Thing | None) -> dict[str, Any]:
    """Return the fields that differ, each as [before, after]; of lines only that they differ."""
    if old is None or new is None:
        return {}
    first, second = msgspec.to_builtins(old), msgspec.to_builtins(new)
    differing = {name: [first[name], second[name]] for name in first if first[name] != second[name]}
    return {
        name: ["", ""] if name in _GEOMETRY else values
        for name, values in differing.items()
        if name not in _GEOMETRY or not _is_same_line(*values)
    }


def _is_same_line(old_m: Sequence[Sequence[float]], new_m: Sequence[Sequence[float]]) -> bool:
    """Whether no corner of either line lies off the other so far that anybody would see it."""
    pairs = (np.array(old_m), np.array(new_m))
    return all(_lies_on(line, other) for line, other in (pairs, pairs[::-1]))


def _lies_on(line_m: FloatArray, other_m: FloatArray) -> bool:
    return all(project_on_path(other_m, x, y).distance_m < _SAME_LINE_M for x, y in line_m)
