"""The PoI-graph as GeoJSON: a FeatureCollection (RFC 7946) whose coordinates are metres of the map, not degrees.

::

    {"type": "FeatureCollection",
     "vbr_poi_graph": {"schema_version": 1, "graph_version": 12, "site_id": …, "frame": "local", "unit": "metre", …},
     "features": [
       {"type": "Feature", "id": "place:hall", "geometry": {"type": "Point", …}, "properties": {"what": "place", …}},
       {"type": "Feature", "id": "edge:e1", "geometry": {"type": "LineString", …}, "properties": {"what": "edge", …}},
       {"type": "Feature", "id": "road:r1", "geometry": {"type": "LineString", …}, "properties": {"what": "road", …}}]}

The member ``vbr_poi_graph`` marks what this program wrote: it is read back exactly, or refused. Any other GeoJSON is
read as far as it goes, as a :class:`navcore.foreign_map.ForeignMap`.
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from navcore.errors import InputError
from navcore.foreign_map import ForeignLine, ForeignMap, ForeignPlace, is_on_map, place_of, shown, text_of
from navcore.misfit import words_of
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road

SCHEMA_VERSION = 1
MAX_FEATURE_COUNT = 20_000
_MAX_OBJECT_COUNT = 10 * MAX_FEATURE_COUNT
"""Looked at before anything is read, for each object takes memory."""
_NOTE = "Coordinates are metres in the frame of the site's map (x, y; floor at z = 0), not longitude and latitude."
_AGAIN = "export it again"
_ABSENT = msgspec.Raw(b"null")
_Numbers = Annotated[list[float], msgspec.Meta(min_length=2)]


class _Marker(msgspec.Struct, frozen=True):
    """The foreign member that says whose file this is."""

    schema_version: int
    graph_version: Annotated[int, msgspec.Meta(ge=0)]


class _Geometry(msgspec.Struct, frozen=True):
    type: Any = None
    coordinates: msgspec.Raw = _ABSENT


class _Feature(msgspec.Struct, frozen=True):
    """A feature of which nothing is believed yet."""

    id: Any = None
    geometry: msgspec.Raw = _ABSENT
    properties: msgspec.Raw = _ABSENT


class _Collection(msgspec.Struct, frozen=True):
    features: list[_Feature]
    type: Any = None
    vbr_poi_graph: msgspec.Raw = _ABSENT


def encode(graph: PoiGraph, site_id: str, site_name: str) -> bytes:
    """Return the graph as a file; the same graph gives the same bytes."""
    marker = {
        "schema_version": SCHEMA_VERSION,
        "graph_version": graph.version,
        "site_id": site_id,
        "site_name": site_name,
        "frame": "local",
        "unit": "metre",
        "note": _NOTE,
    }
    features = [
        *(_feature("place", poi, "Point", (poi.x_m, poi.y_m), ("x_m", "y_m")) for poi in graph.pois.values()),
        *(_feature("edge", edge, "LineString", edge.path_m, ("path_m",)) for edge in graph.edges.values()),
        *(_feature("road", road, "LineString", road.points_m, ("points_m",)) for road in graph.roads.values()),
    ]
    head = msgspec.json.encode({"type": "FeatureCollection", "vbr_poi_graph": marker})
    # A feature a line: so a difference between two files can be read.
    return head[:-1] + b',"features":[\n' + b",\n".join(map(msgspec.json.encode, features)) + b"\n]}\n"


def _feature(
    what: str, thing: Poi | Edge | Road, geometry: str, coordinates: object, left_out: tuple[str, ...]
) -> dict[str, Any]:
    properties = {"what": what, **msgspec.to_builtins(thing)}
    for name in left_out:
        del properties[name]
    return {
        "type": "Feature",
        "id": f"{what}:{thing.id}",
        "geometry": {"type": geometry, "coordinates": coordinates},
        "properties": properties,
    }


def decode(text: bytes) -> PoiGraph | ForeignMap:
    """Return the graph of a file that this program wrote, or what another one's says.

    The graph has the form of one; its laws are looked at elsewhere (:func:`navcore.planning.edits.validate`). Raises
    InputError, saying what is wrong.
    """
    if text.count(b"{") > _MAX_OBJECT_COUNT:
        raise InputError(f"The GeoJSON file holds more than {MAX_FEATURE_COUNT} features: import a part of it.")
    try:
        collection = msgspec.json.decode(text, type=_Collection)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"The file is no GeoJSON FeatureCollection ({words_of(error)}): {_AGAIN}.") from error
    if collection.type != "FeatureCollection":
        raise InputError("The GeoJSON file is no FeatureCollection: export one from the program that made it.")
    if len(collection.features) > MAX_FEATURE_COUNT:
        raise InputError(f"The GeoJSON file holds more than {MAX_FEATURE_COUNT} features: import a part of it.")
    if bytes(collection.vbr_poi_graph) == bytes(_ABSENT):
        return _foreign(collection.features)
    return _own(collection.features, _marker(collection.vbr_poi_graph))


# ------------------------------------------------------------------------------------------------------- our own
def _marker(raw: msgspec.Raw) -> _Marker:
    try:
        version = msgspec.json.decode(raw, type=dict[str, Any]).get("schema_version")
        if isinstance(version, int) and version > SCHEMA_VERSION:
            raise InputError(
                f"The GeoJSON file was written by a newer program (schema {version}, this one knows {SCHEMA_VERSION}):"
                " update this program."
            )
        return msgspec.json.decode(raw, type=_Marker)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"The GeoJSON file's vbr_poi_graph cannot be read ({words_of(error)}): {_AGAIN}.") from error


def _own(features: list[_Feature], marker: _Marker) -> PoiGraph:
    pois: dict[str, Poi] = {}
    edges: dict[str, Edge] = {}
    roads: dict[str, Road] = {}
    for number, feature in enumerate(features, 1):
        thing = _own_thing(number, feature)
        match thing:
            case Poi():
                known = pois.setdefault(thing.id, thing) is thing
            case Edge():
                known = edges.setdefault(thing.id, thing) is thing
            case Road():
                known = roads.setdefault(thing.id, thing) is thing
        if not known:
            raise InputError(f"Feature {number} has the identifier {thing.id!r} of another one: give it another.")
    return PoiGraph(marker.graph_version, pois, edges, roads)


def _own_thing(number: int, feature: _Feature) -> Poi | Edge | Road:
    try:
        properties = msgspec.json.decode(feature.properties, type=dict[str, Any])
        geometry = msgspec.json.decode(feature.geometry, type=_Geometry)
        match (properties.pop("what", None), geometry.type):
            case ("place", "Point"):
                x_m, y_m = msgspec.json.decode(geometry.coordinates, type=_Numbers)[:2]
                return msgspec.convert({**properties, "x_m": x_m, "y_m": y_m}, Poi)
            case ("edge", "LineString"):
                return msgspec.convert({**properties, "path_m": _line(geometry)}, Edge)
            case ("road", "LineString"):
                return msgspec.convert({**properties, "points_m": _line(geometry)}, Road)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(
            f"Feature {number} of the GeoJSON file cannot be read ({words_of(error)}): {_AGAIN}."
        ) from error
    raise InputError(f"Feature {number} of the GeoJSON file is neither place, edge nor road: {_AGAIN}.")


def _line(geometry: _Geometry) -> list[list[float]]:
    return [numbers[:2] for numbers in msgspec.json.decode(geometry.coordinates, type=list[_Numbers])]


# ---------------------------------------------------------------------------------------------------- of others
def _foreign(features: list[_Feature]) -> ForeignMap:
    places: list[ForeignPlace] = []
    lines: list[ForeignLine] = []
    unused: list[str] = []
    for number, feature in enumerate(features, 1):
        found = _foreign_thing(number, feature)
        match found:
            case ForeignPlace():
                places.append(found)
            case ForeignLine():
                lines.append(found)
            case str():
                unused.append(found)
    return ForeignMap(tuple(places), tuple(lines), (), tuple(unused))


def _foreign_thing(number: int, feature: _Feature) -> ForeignPlace | ForeignLine | str:
    """Return what a feature is, or a sentence that says why it is nothing here."""
    label = f"Feature {number}"
    try:
        properties = msgspec.json.decode(feature.properties, type=dict[str, Any] | None) or {}
        label = _label(number, feature, properties)
        geometry = msgspec.json.decode(feature.geometry, type=_Geometry | None)
        if geometry is None:
            return f"{label}: it has no geometry."
        if geometry.type == "Point":
            return _foreign_place(label, feature, properties, geometry)
        if geometry.type == "LineString":
            points = tuple((x, y) for x, y in _line(geometry))
            if len(points) < 2 or not all(map(is_on_map, points)):
                return f"{label}: its line has fewer than two points, or some that are not within 100 km."
            return ForeignLine(label, points)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        return f"{label}: it cannot be read ({words_of(error)})."
    return f"{label}: a {shown(str(geometry.type))} is neither a place nor a road."


def _foreign_place(
    label: str, feature: _Feature, properties: dict[str, Any], geometry: _Geometry
) -> ForeignPlace | str:
    x_m, y_m = msgspec.json.decode(geometry.coordinates, type=_Numbers)[:2]
    if not is_on_map((x_m, y_m)):
        return f"{label}: it is farther than 100 km from the map's origin."
    key = feature.id if isinstance(feature.id, str) else ""
    return place_of(key, properties, (x_m, y_m)) or f"{label}: a point without a name is no place."


def _label(number: int, feature: _Feature, properties: dict[str, Any]) -> str:
    name = text_of(properties, "name", "title", "label") or (feature.id if isinstance(feature.id, (str, int)) else "")
    return f"Feature {number} ({shown(str(name))})" if name != "" else f"Feature {number}"
