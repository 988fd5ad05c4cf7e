"""Finding a place by what a person calls it."""

from __future__ import annotations

import difflib

from navcore.errors import InputError
from navcore.planning.poi_graph import Poi, PoiGraph

_NAMED_COUNT = 20


def find_place(graph: PoiGraph, text: str) -> Poi:
    """Return the PoI with this identifier, name or spoken name, in any case. Raises InputError, naming what is near."""
    wanted = " ".join(text.split()).casefold()
    if text in graph.pois:
        return graph.pois[text]
    matches = [poi for poi in graph.pois.values() if wanted in (poi.name.casefold(), poi.spoken_name.casefold())]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise InputError(f"Several places are called {text!r}: rename all but one, or give the identifier.")
    # Junctions last: nobody is on the way to one.
    pois = sorted(graph.pois.values(), key=lambda poi: (poi.kind == "junction", poi.name))
    names = [poi.name for poi in pois]
    near = difflib.get_close_matches(text, names, 3, 0.5) or names[:_NAMED_COUNT]
    raise InputError(f"There is no place {text!r} in this site: choose {' / '.join(near) or 'none, it has no places'}.")
