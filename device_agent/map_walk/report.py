"""What is said of a new map: the figures that its site keeps, in a few words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from device_agent.state import MapWalkTold, Phrase
from navcore.cues.table import CueKind


def report_told(report: Mapping[str, Any]) -> MapWalkTold:
    """Return the sentence on a map from its site's report."""
    figures: dict[str, int | str] = {
        "metres": round(report["road_m"]), "places": report["places"], "loops": report["loops_closed"],
    }  # fmt: skip
    lost = report.get("places_lost", "")
    told = (Phrase("map_places_lost", {"names": lost}),) if lost else ()
    return MapWalkTold(CueKind.MAP_NEWS, (Phrase("map_built", figures), *told, _weak(report["weak_stretches"])))


def _weak(stretches: list[dict[str, Any]]) -> Phrase:
    if not stretches:
        return Phrase("map_built_good")
    longest = max(stretches, key=lambda stretch: float(stretch["length_m"]))
    return Phrase(
        "map_built_weak",
        {"count": len(stretches), "metres": round(longest["length_m"]), "from_m": round(longest["from_m"])},
    )
