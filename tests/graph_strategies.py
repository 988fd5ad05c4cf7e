"""Any valid PoI-graph with everything that its types allow, for properties."""

from __future__ import annotations

import math
from itertools import combinations, pairwise

from hypothesis import strategies as st

from navcore.planning.poi_graph import CAUTION_SIDES, POI_KINDS, Edge, Poi, PoiGraph, Road

IDS = st.text("abcXYZ019_-", min_size=1, max_size=8)
NUMBERS_M = st.floats(-1000.0, 1000.0)
POINTS_M = st.tuples(NUMBERS_M, NUMBERS_M)
# Whatever a keyboard gives, and what it does not.
TEXTS = st.text(st.characters(exclude_categories=("Cs",)), max_size=20)
NAMES = TEXTS.map(lambda text: text + "N")


@st.composite
def graphs(draw: st.DrawFn) -> PoiGraph:
    """Return a graph that keeps all laws."""
    pois = {key: _poi(draw, key) for key in draw(st.lists(IDS, max_size=5, unique=True))}
    on_road = [poi for poi in pois.values() if poi.on_road]
    pairs = list(combinations(on_road, 2))
    chosen = (
        draw(st.lists(st.sampled_from(pairs), max_size=4, unique_by=lambda pair: (pair[0].id, pair[1].id)))
        if pairs
        else []
    )
    keys = draw(st.lists(IDS, min_size=len(chosen), max_size=len(chosen), unique=True))
    edges = {key: _edge(draw, key, a, b) for key, (a, b) in zip(keys, chosen, strict=True)}
    roads = {
        key: Road(
            key, tuple(draw(st.lists(POINTS_M, min_size=2, max_size=5))), draw(st.sampled_from(["recorded", "drawn"]))
        )
        for key in draw(st.lists(IDS, max_size=3, unique=True))
    }
    return PoiGraph(draw(st.integers(0, 1 << 40)), pois, edges, roads)


def _poi(draw: st.DrawFn, key: str) -> Poi:
    x_m, y_m = draw(POINTS_M)
    return Poi(
        key, draw(NAMES), draw(st.sampled_from(POI_KINDS)), x_m, y_m, draw(st.booleans()), draw(TEXTS), draw(TEXTS)
    )  # type: ignore[arg-type]


def _edge(draw: st.DrawFn, key: str, a: Poi, b: Poi) -> Edge:
    a, b = (a, b) if draw(st.booleans()) else (b, a)
    path = ((a.x_m, a.y_m), *draw(st.lists(POINTS_M, max_size=4)), (b.x_m, b.y_m))
    length_m = sum(math.dist(p, q) for p, q in pairwise(path))
    return Edge(
        key, a.id, b.id, path, length_m, draw(st.booleans()), draw(st.booleans()),
        draw(st.floats(1.0, 100.0)), draw(st.none() | st.floats(0.3, 50.0)), draw(st.sampled_from(CAUTION_SIDES)),
    )  # type: ignore[arg-type]  # fmt: skip
