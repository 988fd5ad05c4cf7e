"""What a file that another program has drawn says of a building: places, lines and links, not yet a PoI-graph.

:mod:`navcore.graph_import` makes of it what can be made; what cannot be used is told by name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from navcore.planning.poi_graph import POI_KINDS

MAX_SHOWN_LENGTH = 80
MAX_COORDINATE_M = 100_000.0
Point = tuple[float, float]


class ForeignPlace(NamedTuple):
    """A point with a name."""

    key: str
    """By which links of the same file name it; may be empty."""
    name: str
    place_m: Point
    kind: str = ""
    """A kind of place that is known here, or empty."""
    spoken_name: str = ""
    notes: str = ""


class ForeignLine(NamedTuple):
    """A line: a road, and an edge where it leads from one place to another."""

    label: str
    points_m: tuple[Point, ...]


class ForeignLink(NamedTuple):
    """Two places that are said to be joined, by their keys."""

    label: str
    a: str
    b: str


@dataclass(frozen=True, slots=True)
class ForeignMap:
    """All of it."""

    places: tuple[ForeignPlace, ...] = ()
    lines: tuple[ForeignLine, ...] = ()
    links: tuple[ForeignLink, ...] = ()
    unused: tuple[str, ...] = ()
    """A sentence for each thing that cannot be used, beginning with what it is."""


def place_of(key: str, properties: Mapping[str, Any], place_m: Point) -> ForeignPlace | None:
    """Return a place with what its properties say, in the words that other programs use; None without a name."""
    name = text_of(properties, "name", "title", "label")
    if not name:
        return None
    kind = text_of(properties, "kind", "type").lower()
    return ForeignPlace(
        key,
        name[:80],
        place_m,
        kind if kind in POI_KINDS else "",
        text_of(properties, "spoken_name")[:80],
        text_of(properties, "notes", "description")[:2000],
    )


def text_of(properties: Mapping[str, Any], *names: str) -> str:
    """Return the first of the properties that is a text, or a number, without blanks around it; else nothing."""
    for name in names:
        value = properties.get(name)
        if isinstance(value, (str, int, float)) and not isinstance(value, bool) and (text := str(value).strip()):
            return text
    return ""


def is_on_map(values: tuple[float, ...]) -> bool:
    """Whether these are coordinates in metres that a map can have."""
    return all(math.isfinite(value) and abs(value) <= MAX_COORDINATE_M for value in values)


def shown(text: str) -> str:
    """Return a text from a file as it may stand in a sentence."""
    plain = "".join(char if char.isprintable() else " " for char in text[: MAX_SHOWN_LENGTH + 1]).strip()
    return plain if len(plain) <= MAX_SHOWN_LENGTH else plain[: MAX_SHOWN_LENGTH - 1] + "…"
