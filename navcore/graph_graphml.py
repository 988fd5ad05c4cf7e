"""The PoI-graph as GraphML (http://graphml.graphdrawing.org): for Gephi, yEd, NetworkX, igraph.

Places are nodes, edges are directed edges from a to b, each property a ``data`` element of its own; the geometry of
an edge is the JSON text ``[[x, y], …]`` in metres. GraphML has no roads, so these are one JSON text of the graph.
``schema_version`` of the graph marks what this program wrote: it is read back exactly, or refused. Of any other file
nodes with coordinates and a name are read as places, and edges as links between them.

XML is read by expat, without a document type: no entity is ever expanded, nothing is fetched.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import msgspec

from navcore.errors import InputError
from navcore.foreign_map import ForeignLink, ForeignMap, ForeignPlace, is_on_map, place_of, shown, text_of
from navcore.misfit import words_of
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road

SCHEMA_VERSION = 1
MAX_THING_COUNT = 20_000
MAX_DEPTH = 32
_AGAIN = "export it again"
_NAMESPACE = "http://graphml.graphdrawing.org/xmlns"
_TYPES: Mapping[type, str] = {str: "string", float: "double", bool: "boolean", int: "int"}
_POI_KEYS: Mapping[str, type] = {
    "name": str, "kind": str, "x_m": float, "y_m": float, "on_road": bool, "spoken_name": str, "notes": str,
}  # fmt: skip
_EDGE_KEYS: Mapping[str, type] = {
    "length_m": float, "one_way": bool, "closed": bool, "cost_multiplier": float, "width_m": float,
    "caution_side": str, "path_m": str,
}  # fmt: skip
_GRAPH_KEYS: Mapping[str, type] = {
    "schema_version": int, "graph_version": int, "site_id": str, "site_name": str, "roads": str,
}  # fmt: skip
_Version = Annotated[int, msgspec.Meta(ge=0)]
_JSON_FIELDS = frozenset({"path_m", "roads"})
# What XML cannot hold, or would change (a carriage return), and the sign that says so.
_SPECIAL = re.compile(r"[\\\x00-\x09\x0b-\x1f\x7f-\x9f\ufffe\uffff]")
_ESCAPED = re.compile(r"\\u([0-9a-f]{4})")


# ------------------------------------------------------------------------------------------------------- writing
def encode(graph: PoiGraph, site_id: str, site_name: str) -> bytes:
    """Return the graph as a file; the same graph gives the same bytes."""
    about = {
        "schema_version": SCHEMA_VERSION,
        "graph_version": graph.version,
        "site_id": site_id,
        "site_name": site_name,
        "roads": list(graph.roads.values()),
    }
    lines = [
        "<?xml version='1.0' encoding='utf-8'?>",
        f'<graphml xmlns="{_NAMESPACE}">',
        *_key_lines("graph", _GRAPH_KEYS),
        *_key_lines("node", _POI_KEYS),
        *_key_lines("edge", _EDGE_KEYS),
        '<graph id="poi_graph" edgedefault="directed">',
        *_data_lines("graph", _GRAPH_KEYS, about),
    ]
    for poi in graph.pois.values():
        data = _data_lines("node", _POI_KEYS, msgspec.structs.asdict(poi))
        lines += [f"<node id={quoteattr(poi.id)}>", *data, "</node>"]
    for edge in graph.edges.values():
        data = _data_lines("edge", _EDGE_KEYS, msgspec.structs.asdict(edge))
        ends = f"source={quoteattr(edge.a)} target={quoteattr(edge.b)}"
        lines += [f"<edge id={quoteattr(edge.id)} {ends}>", *data, "</edge>"]
    return ("\n".join([*lines, "</graph>", "</graphml>"]) + "\n").encode()


def _key_lines(domain: str, keys: Mapping[str, type]) -> Iterator[str]:
    for name, kind in keys.items():
        yield f'<key id="{domain}.{name}" for="{domain}" attr.name="{name}" attr.type="{_TYPES[kind]}"/>'


def _data_lines(domain: str, keys: Mapping[str, type], values: Mapping[str, Any]) -> Iterator[str]:
    for name in keys:
        value = values[name]
        if value is None:
            continue
        # Numbers in JSON have as many digits as are needed to read the same number back.
        text = _escaped(value) if isinstance(value, str) else msgspec.json.encode(value).decode()
        yield f'<data key="{domain}.{name}">{escape(text)}</data>'


def _escaped(text: str) -> str:
    return _SPECIAL.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _unescaped(text: str) -> str:
    return _ESCAPED.sub(lambda found: chr(int(found[1], 16)), text)


# ------------------------------------------------------------------------------------------------------- reading
@dataclass(slots=True)
class _Element:
    """A node, an edge, or the graph, as it stands in the file."""

    what: str
    attributes: Mapping[str, str]
    data: dict[str, str] = field(default_factory=dict)
    """Text by the key's name."""


def decode(text: bytes) -> PoiGraph | ForeignMap:
    """Return the graph of a file that this program wrote, or what another one's says.

    The graph has the form of one; its laws are looked at elsewhere (:func:`navcore.planning.edits.validate`). Raises
    InputError, saying what is wrong.
    """
    reader = _Reader()
    try:
        reader.read(text)
    except expat.ExpatError as error:
        raise InputError(f"The GraphML file is damaged ({error}): {_AGAIN}.") from error
    if reader.graph is None:
        raise InputError("The XML file holds no graph: export it as GraphML from the program that made it.")
    version = reader.graph.data.get("schema_version")
    if version is None or "graph_version" not in reader.graph.data:
        return _foreign(reader.things)
    if version != str(SCHEMA_VERSION):
        raise InputError(
            f"The GraphML file was written by a newer program (schema {shown(version)}, this one knows"
            f" {SCHEMA_VERSION}): update this program."
        )
    return _own(reader.graph, reader.things)


class _Reader:
    """Takes the elements of a GraphML file; nested graphs, ports and hyperedges are refused."""

    def __init__(self) -> None:
        self.graph: _Element | None = None
        self.things: list[_Element] = []
        self._key_names: dict[str, str] = {}
        self._open: _Element | None = None
        self._key = ""
        self._text: list[str] | None = None
        self._depth = 0

    def read(self, text: bytes) -> None:
        # One encoding, whatever the file says of itself.
        parser = expat.ParserCreate("utf-8")
        parser.StartDoctypeDeclHandler = _refuse_document_type
        parser.EntityDeclHandler = _refuse_document_type
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._characters
        parser.Parse(text, True)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        name = tag.rpartition(":")[2]
        if self._depth > MAX_DEPTH:
            raise InputError("The GraphML file is nested deeper than a graph is: export it again without groups.")
        if self._depth == 1 and name != "graphml":
            raise InputError("The XML file is no GraphML: export it as GraphML from the program that made it.")
        match name:
            case "key":
                self._key_names[attributes.get("id", "")] = attributes.get("attr.name", attributes.get("id", ""))
            case "graph" if self.graph is None:
                self.graph = self._open = _Element("graph", attributes)
            case "node" | "edge":
                self._begin(_Element(name, attributes))
            case "graph" | "hyperedge" | "port":
                raise InputError(f"The GraphML file holds a {name} inside a graph: export it without groups and ports.")
            case "data" if self._open is not None:
                self._key, self._text = attributes.get("key", ""), []

    def _begin(self, thing: _Element) -> None:
        if self._open is not self.graph or self.graph is None:
            raise InputError(f"The GraphML file holds a {thing.what} where none can be: {_AGAIN}.")
        if len(self.things) == MAX_THING_COUNT:
            raise InputError(
                f"The GraphML file holds more than {MAX_THING_COUNT} nodes and edges: import a part of it."
            )
        self.things.append(thing)
        self._open = thing

    def _end(self, tag: str) -> None:
        self._depth -= 1
        name = tag.rpartition(":")[2]
        if name in ("node", "edge"):
            self._open = self.graph
        elif name == "data" and self._text is not None and self._open is not None:
            key = self._key_names.get(self._key, self._key)
            if key in self._open.data:
                raise InputError(f"The GraphML file gives {shown(key)} twice for one {self._open.what}: {_AGAIN}.")
            self._open.data[key] = "".join(self._text)
            self._text = None

    def _characters(self, text: str) -> None:
        if self._text is not None:
            self._text.append(text)


def _refuse_document_type(*_: object) -> None:
    raise InputError("The XML file has a document type or entities, which are not read: export it again without.")


# ------------------------------------------------------------------------------------------------------- our own
def _own(about: _Element, things: Iterable[_Element]) -> PoiGraph:
    values = _values(about, "The graph", _GRAPH_KEYS)
    version = _converted("The version of the graph", values["graph_version"], _Version)
    pois: dict[str, Poi] = {}
    edges: dict[str, Edge] = {}
    for thing in things:
        # NetworkX moves an edge's identifier among its data.
        key = thing.attributes.get("id") or thing.data.get("id", "")
        label = f"The {thing.what} {shown(key)!r}"
        if thing.what == "node":
            poi = _converted(label, {"id": key, **_values(thing, label, _POI_KEYS)}, Poi)
            known = pois.setdefault(key, poi) is poi
        else:
            ends = {"a": thing.attributes.get("source"), "b": thing.attributes.get("target")}
            edge = _converted(label, {"id": key, **ends, **_values(thing, label, _EDGE_KEYS)}, Edge)
            known = edges.setdefault(key, edge) is edge
        if not known:
            raise InputError(f"{label} stands twice in the GraphML file: give one another identifier.")
    return PoiGraph(version, pois, edges, _roads(values.get("roads", [])))


def _roads(raw: object) -> dict[str, Road]:
    lines = _converted("The list of roads", raw, list[Road])
    roads = {road.id: road for road in lines}
    if len(roads) != len(lines):
        raise InputError("Two roads of the GraphML file have the same identifier: give one another.")
    return roads


def _values(element: _Element, label: str, keys: Mapping[str, type]) -> dict[str, Any]:
    """Return the data of an element as values of their types; unknown ones are passed over."""
    values: dict[str, Any] = {}
    for name, kind in keys.items():
        text = element.data.get(name)
        if text is None:
            continue
        if kind is str and name not in _JSON_FIELDS:
            values[name] = _unescaped(text)
            continue
        # NetworkX writes True for true.
        values[name] = _from_json(label, name, text.lower() if kind is bool else text)
    return values


def _from_json(label: str, name: str, text: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise InputError(f"{name} of {_inside(label)} in the GraphML file cannot be read: {_AGAIN}.") from error


def _converted(label: str, raw: object, kind: Any) -> Any:
    try:
        return msgspec.convert(raw, kind)
    except (msgspec.MsgspecError, RecursionError) as error:
        sentence = f"{label} of the GraphML file cannot be read ({words_of(error)}): {_AGAIN}."
        raise InputError(sentence) from error


def _inside(label: str) -> str:
    return label[:1].lower() + label[1:]


# ---------------------------------------------------------------------------------------------------- of others
def _foreign(things: Iterable[_Element]) -> ForeignMap:
    places: list[ForeignPlace] = []
    links: list[ForeignLink] = []
    unused: list[str] = []
    for thing in things:
        found = _foreign_place(thing) if thing.what == "node" else _foreign_link(thing)
        match found:
            case ForeignPlace():
                places.append(found)
            case ForeignLink():
                links.append(found)
            case str():
                unused.append(found)
    return ForeignMap(tuple(places), (), tuple(links), tuple(unused))


def _foreign_place(node: _Element) -> ForeignPlace | str:
    key = node.attributes.get("id", "")
    label = f"Node {shown(text_of(node.data, 'name', 'title', 'label') or key)}"
    place_m = _number(node.data, "x_m", "x"), _number(node.data, "y_m", "y")
    if place_m[0] is None or place_m[1] is None or not is_on_map((place_m[0], place_m[1])):
        return f"{label}: it has no coordinates x and y in metres, within 100 km."
    return place_of(key, node.data, (place_m[0], place_m[1])) or f"{label}: a node without a name is no place."


def _foreign_link(edge: _Element) -> ForeignLink:
    a, b = edge.attributes.get("source", ""), edge.attributes.get("target", "")
    name = text_of(edge.data, "name", "label") or edge.attributes.get("id") or f"{a} – {b}"
    return ForeignLink(f"Edge {shown(name)}", a, b)


def _number(data: Mapping[str, str], *names: str) -> float | None:
    for name in names:
        try:
            return float(data[name])
        except (KeyError, ValueError):
            continue
    return None
