"""Two people at the same thing: what the one asked for, and what the other has made of it meanwhile."""

from __future__ import annotations

from typing import Any

import msgspec

from console.edits import Thing
from console.errors import ConflictError
from console.graph_log import LogEntry
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road

_WORDS = {"poi": "place", "edge": "connection", "road": "road"}


class EditConflictError(ConflictError):
    """Somebody else has changed the thing since it was looked at: both versions are shown, and nothing is changed.

    ``yours`` is the graph that the edit would make; None where it can no longer be made.
    """

    def __init__(self, thing: Thing, entry: LogEntry, theirs: PoiGraph, yours: PoiGraph | None) -> None:
        kind, key = thing
        there = thing_of(theirs, thing)
        name = f" “{there.name}”" if isinstance(there, Poi) else ""
        done = "deleted" if there is None else "changed"
        super().__init__(
            f"{entry.author} has {done} this {_WORDS[kind]}{name} meanwhile: look at both versions, and choose."
        )
        self.thing = thing
        self._details = {
            "kind": kind,
            "id": key,
            "by": entry.author,
            "at_s": entry.at_s,
            "version": theirs.version,
            "theirs": _shown(there),
            "yours": _shown(thing_of(yours, thing)) if yours is not None else None,
        }

    def details(self) -> dict[str, Any]:
        """Return both versions."""
        return {"conflict": self._details}


def thing_of(graph: PoiGraph, thing: Thing) -> Poi | Edge | Road | None:
    """Return a thing of a graph; None where it is not there."""
    kind, key = thing
    if kind == "poi":
        return graph.pois.get(key)
    return graph.edges.get(key) if kind == "edge" else graph.roads.get(key)


def _shown(value: Poi | Edge | Road | None) -> dict[str, Any] | None:
    if value is None:
        return None
    shown: dict[str, Any] = msgspec.to_builtins(value)
    # Where a line runs is shown in the scene, and would make the answer long.
    for geometry in ("path_m", "points_m"):
        shown.pop(geometry, None)
    return shown
