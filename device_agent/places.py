"""Finding a place by what a person calls it."""

from __future__ import annotations

import difflib

from navcore.errors import InputError
from navcore.planning.poi_graph import Poi, PoiGraph


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
    names = sorted(poi.name for poi in graph.pois.values())
    near = difflib.get_close_matches(text, names, 3, 0.5) or names[:12]
    raise InputError(f"There is no place {text!r} in this site: choose {' / '.join(near) or 'none, it has no places'}.")
