"""The PoI-graph as GeoJSON and GraphML: it comes back exactly, and what is broken is refused with a sentence."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from typing import Any

import msgspec
import networkx as nx
import numpy as np
import pytest
from graph_strategies import graphs
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from navcore.errors import InputError
from navcore.foreign_map import ForeignMap
from navcore.graph_geojson import MAX_FEATURE_COUNT
from navcore.graph_import import (
    GRAPH_FORMS,
    MAX_FOREIGN_COUNT,
    MAX_GRAPH_FILE_BYTES,
    MAX_POINT_COUNT,
    imported,
    read_graph,
)
from navcore.planning.edits import validate
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road
from navcore.planning.road_edits import recorded_roads

FORMS = sorted(GRAPH_FORMS)
GRAPH = PoiGraph(
    7,
    {"a": Poi("a", "Hall", "hall", 0.0, 0.0), "b": Poi("b", "Bar", "bar", 6.0, 0.0, notes="to the <left> & \\ up\r\n")},
    {"e1": Edge("e1", "a", "b", ((0.0, 0.0), (6.0, 0.0)), 6.0, width_m=0.9, caution_side="left")},
    {"r1": Road("r1", ((0.0, 0.0), (6.0, 0.0)), "drawn")},
)
CORRIDOR = [np.column_stack([np.linspace(0.0, 20.0, 201), np.zeros(201), np.zeros(201)])]
DRAFT = PoiGraph(4, {"hall": Poi("hall", "Hall", "hall", 0.0, 0.0)}, {}, recorded_roads(CORRIDOR))


def file_of(form: str, graph: PoiGraph = GRAPH) -> bytes:
    return GRAPH_FORMS[form](graph, "small", "Small <site> & more")


def refusal(data: bytes) -> str:
    with pytest.raises(InputError) as caught:
        imported(data, DRAFT)
    return str(caught.value)


# ----------------------------------------------------------------------------------------------------- as it was
@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=150, deadline=None)
@given(graph=graphs())
def test_any_graph_comes_back_exactly(form: str, graph: PoiGraph) -> None:
    data = file_of(form, graph)
    back = read_graph(data)
    assert back == graph
    assert isinstance(back, PoiGraph)
    # Dictionaries are equal in any order; people see one.
    assert [list(back.pois), list(back.edges), list(back.roads)] == [
        list(graph.pois),
        list(graph.edges),
        list(graph.roads),
    ]
    assert file_of(form, back) == data


@settings(max_examples=80, deadline=None)
@given(graph=graphs())
def test_networkx_reads_graphml_and_what_it_writes_of_it_is_the_same_graph(graph: PoiGraph) -> None:
    theirs = nx.read_graphml(io.BytesIO(file_of("graphml", graph)))
    assert set(theirs.nodes) == set(graph.pois)
    assert {(a, b) for a, b in theirs.edges()} == {(edge.a, edge.b) for edge in graph.edges.values()}
    out = io.BytesIO()
    nx.write_graphml(theirs, out)
    assert read_graph(out.getvalue()) == graph


def test_geojson_is_geojson_with_the_frame_named() -> None:
    raw = json.loads(file_of("geojson"))
    assert raw["type"] == "FeatureCollection"
    assert (raw["vbr_poi_graph"]["frame"], raw["vbr_poi_graph"]["unit"]) == ("local", "metre")
    assert {(f["type"], f["geometry"]["type"]) for f in raw["features"]} == {
        ("Feature", "Point"),
        ("Feature", "LineString"),
    }
    edge = next(f for f in raw["features"] if f["id"] == "edge:e1")
    assert (edge["properties"]["width_m"], edge["properties"]["caution_side"]) == (0.9, "left")


@pytest.mark.parametrize("form", FORMS)
def test_a_whole_graph_takes_the_drafts_place_one_version_on(form: str) -> None:
    found = imported(file_of(form), DRAFT)
    assert found.is_whole
    assert found.graph == PoiGraph(5, GRAPH.pois, GRAPH.edges, GRAPH.roads)


# ------------------------------------------------------------------------------------------------ of other programs
def geojson(*features: Any) -> bytes:
    return json.dumps({"type": "FeatureCollection", "features": list(features)}).encode()


def point(name: str | None, x: float, y: float, **more: Any) -> dict[str, Any]:
    properties = {"name": name, **more} if name is not None else more
    return {"type": "Feature", "geometry": {"type": "Point", "coordinates": [x, y, 3]}, "properties": properties}


def line(name: str, *points: tuple[float, float]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": "LineString", "coordinates": points}, "properties": {"name": name}}


def test_points_with_a_name_become_places_and_lines_roads_and_edges() -> None:
    found = imported(
        geojson(
            point("Lift", 10.0, 0.4, kind="lift", description="beside the plant"),
            point("Terrace", 10.2, 8.0),
            line("Way to the terrace", (10.0, 0.0), (10.0, 8.0)),
        ),
        DRAFT,
    )
    validate(found.graph)
    assert (found.is_whole, found.unused) == (False, ())
    lift = found.graph.pois["lift"]
    assert (lift.kind, lift.notes, lift.on_road) == ("lift", "beside the plant", True)
    (edge,) = found.graph.edges.values()
    assert {edge.a, edge.b} == {"lift", "terrace"}
    assert edge.length_m == pytest.approx(8.0, abs=0.7)
    assert sorted(road.origin for road in found.graph.roads.values()) == ["drawn", "recorded"]
    assert found.graph.pois["hall"] == DRAFT.pois["hall"]


def test_whoever_brings_a_file_is_told_what_to_look_at() -> None:
    assert "metres of this map" in imported(geojson(point("Lift", 10.0, 0.0)), DRAFT).notes[0]
    assert imported(file_of("geojson"), DRAFT).notes == ()
    elsewhere = own(lambda raw: raw["features"][3]["geometry"].update(coordinates=[[50.0, 0.0], [60.0, 0.0]]))
    assert imported(elsewhere, DRAFT).notes[0].startswith("Hall lies on no road here")
    aside = msgspec.structs.replace(GRAPH.edges["e1"], path_m=((0.0, 0.0), (3.0, 4.0), (6.0, 0.0)), length_m=10.0)
    notes = imported(file_of("geojson", msgspec.structs.replace(GRAPH, edges={"e1": aside})), DRAFT).notes
    assert notes[0].startswith("Hall – Bar lies on no road here")


def test_roads_too_far_apart_to_be_one_site_are_not_taken() -> None:
    far = {**GRAPH.roads, "r2": Road("r2", ((5000.0, 5000.0), (5003.0, 5000.0)))}
    assert "a site of its own" in refusal(file_of("geojson", msgspec.structs.replace(GRAPH, roads=far)))


def test_the_same_file_again_changes_nothing() -> None:
    data = geojson(point("Lift", 10.0, 0.0), line("Way", (10.0, 0.0), (10.0, 8.0)))
    first = imported(data, DRAFT).graph
    again = imported(data, first).graph
    assert (again.pois, again.edges, again.roads) == (first.pois, first.edges, first.roads)


def test_what_cannot_be_used_is_listed_by_name() -> None:
    found = imported(
        geojson(
            {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": []}, "properties": {"name": "Room 3"}},
            point(None, 1.0, 0.0),
            point("Moon", 4e8, 0.0),
            point("Cellar", 5.0, 40.0),
            {"type": "Feature", "geometry": None, "properties": {"title": "Idea"}},
            {"type": "Feature", "id": 9, "geometry": {"type": "Point", "coordinates": ["a", 1]}, "properties": None},
            line("Dot", (1.0, 1.0)),
            line("Step", (1.0, 1.0), (1.1, 1.0)),
        ),
        DRAFT,
    )
    told = "\n".join(found.unused)
    for name in ("Room 3", "Feature 2:", "Moon", "Idea", "Feature 6 (9)", "Dot", "Step"):
        assert name in told
    # Far from any road it is a place, but no destination.
    assert not found.graph.pois["cellar"].on_road


def test_a_place_known_by_name_is_moved_and_keeps_what_the_file_does_not_say() -> None:
    draft = PoiGraph(1, {"x": Poi("x", "Lift", "lift", 2.0, 0.0, spoken_name="the lift")}, {}, DRAFT.roads)
    found = imported(geojson(point("LIFT", 5.0, 0.0)), draft)
    lift = found.graph.pois["x"]
    assert (lift.x_m, lift.name, lift.kind, lift.spoken_name) == (pytest.approx(5.0), "Lift", "lift", "the lift")


def test_graphml_of_others_gives_places_and_links() -> None:
    theirs = nx.Graph()
    theirs.add_node("1", label="Lift", x=2.0, y=0.0)
    theirs.add_node("2", label="Bar", x=9.0, y=0.1)
    theirs.add_node("3", label="Nowhere")
    theirs.add_edge("1", "2")
    theirs.add_edge("1", "3")
    out = io.BytesIO()
    nx.write_graphml(theirs, out)
    found = imported(out.getvalue(), DRAFT)
    validate(found.graph)
    (edge,) = found.graph.edges.values()
    assert (edge.a, edge.b) == ("lift", "bar")
    assert [text.split(":")[0] for text in found.unused] == ["Node Nowhere", "Edge 1 – 3"]


# ------------------------------------------------------------------------------------------------------- refused
@pytest.mark.parametrize("form", FORMS)
def test_wherever_it_is_cut_it_is_refused(form: str) -> None:
    data = file_of(form).rstrip()
    for cut in range(len(data)):
        assert refusal(data[:cut])


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_whatever_is_written_over_it_it_is_refused_or_makes_a_valid_graph(form: str, data: st.DataObject) -> None:
    text = bytearray(file_of(form))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text) - 1))
        text[at : at + data.draw(st.integers(0, 4))] = data.draw(
            st.sampled_from(
                [b"", b"1e999", b"NaN", b"null", b'"', b"<", b"}", b"\xff", b"99999999999999999999", b"-", b"[" * 9]
            )
        )
    try:
        found = imported(bytes(text), DRAFT)
    except InputError:
        return
    validate(found.graph)


def own(change: Callable[[dict[str, Any]], None]) -> bytes:
    raw = json.loads(file_of("geojson"))
    change(raw)
    return json.dumps(raw).encode()


def set_coordinates(value: str) -> bytes:
    return file_of("geojson").replace(b"[6.0,0.0]},", f"[{value},0.0]}},".encode(), 1)


@pytest.mark.parametrize("number", ["NaN", "1e999", "Infinity", "1e300", "9" * 400, '"6"', "null", "[]", "true"])
def test_numbers_that_are_nowhere_are_refused(number: str) -> None:
    assert "cannot be read" in refusal(set_coordinates(number)) or "no GeoJSON" in refusal(set_coordinates(number))
    graphml = file_of("graphml").replace(b'<data key="node.x_m">6.0<', f'<data key="node.x_m">{number}<'.encode())
    assert "cannot be read" in refusal(graphml)


def test_text_that_is_not_utf8_is_refused() -> None:
    for form in FORMS:
        assert "UTF-8" in refusal(file_of(form).replace(b"Hall", b"H\xe4ll"))
        assert "UTF-8" in refusal(file_of(form).decode().encode("utf-16"))
    latin = b"<?xml version='1.0' encoding='latin-1'?>" + file_of("graphml").split(b"?>", 1)[1].replace(
        b"Hall", "Hälle".encode()
    )
    found = read_graph(latin)
    assert isinstance(found, PoiGraph)
    assert found.pois["a"].name == "Hälle"


BOMB = """<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">{more}]>
<graphml><graph><node id="&{last};"/></graph></graphml>"""


@pytest.mark.parametrize(
    "text",
    [
        BOMB.format(more="".join(f'<!ENTITY {chr(c + 1)} "{f"&{chr(c)};" * 10}">' for c in range(98, 110)), last="n"),
        '<!DOCTYPE graphml SYSTEM "file:///etc/passwd"><graphml/>',
        '<!DOCTYPE graphml [<!ENTITY % x SYSTEM "http://127.0.0.1:9/x.dtd"> %x;]><graphml/>',
    ],
)
def test_no_entity_is_ever_expanded_and_nothing_is_fetched(text: str) -> None:
    assert "document type or entities" in refusal(text.encode())


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<svg/>", "no GraphML"),
        ("<graphml/>", "holds no graph"),
        ("<graphml><graph><node id='1'><graph/></node></graph></graphml>", "without groups"),
        ("<graphml><graph><hyperedge/></graph></graphml>", "hyperedge"),
        ("<graphml><graph><node id='1'><node id='2'/></node></graph></graphml>", "where none can be"),
        ("<graphml>" + "<a>" * 100_000, "nested deeper"),
        ("<graphml><graph>" + "<node/>" * 20_001, "more than 20000"),
        ("hello", "neither GeoJSON nor GraphML"),
        ("", "neither GeoJSON nor GraphML"),
        ("{" * 100_000, "GeoJSON"),
        ('{"a":' + "[" * 100_000, "GeoJSON"),
        ('{"type":"Feature"}', "FeatureCollection"),
        ('{"type":"FeatureCollection","features":[1]}', "FeatureCollection"),
        ('{"type":"FeatureCollection","features":{}}', "FeatureCollection"),
    ],
)  # fmt: skip
def test_what_is_something_else_is_refused_saying_so(text: str, told: str) -> None:
    assert told in refusal(text.encode())


def test_a_million_features_are_refused_before_they_are_read() -> None:
    many = b'{"type":"FeatureCollection","features":[' + b"{}," * 999_999 + b"{}]}"
    assert f"more than {MAX_FEATURE_COUNT} features" in refusal(many)
    assert "more than" in refusal(b'{"type":"FeatureCollection","features":[' + b"{}," * 30_000 + b"{}]}")
    assert "MiB" in refusal(b"{" + b" " * MAX_GRAPH_FILE_BYTES)
    # One feature may hold as many.
    inside = b'{"type":"FeatureCollection","features":[{"properties":{"x":[' + b"{}," * 200_000 + b"{}]}}]}"
    assert f"more than {MAX_FEATURE_COUNT} features" in refusal(inside)
    assert "points" in refusal(b'{"type":"FeatureCollection","features":[{"x":[' + b"[]," * MAX_POINT_COUNT + b"[]]}]}")
    crowd = geojson(*(point(f"P{n}", 0.0, 0.0) for n in range(MAX_FOREIGN_COUNT + 1)))
    assert f"more than {MAX_FOREIGN_COUNT} places" in refusal(crowd)
    assert "see that its unit is metres" in refusal(geojson(line("Around the world", (0.0, 0.0), (90_000.0, 0.0))))


def test_a_newer_schema_says_so() -> None:
    newer = own(lambda raw: raw["vbr_poi_graph"].update(schema_version=2, graph_version="x"))
    assert "written by a newer program (schema 2" in refusal(newer)
    assert "newer program (schema 2" in refusal(
        file_of("graphml").replace(b'"graph.schema_version">1<', b'"graph.schema_version">2<')
    )


def test_the_first_fault_of_a_graph_is_named() -> None:
    def stretch(raw: dict[str, Any]) -> None:
        raw["features"][2]["properties"]["length_m"] = 9.0

    assert "length of edge e1" in refusal(own(stretch))
    assert "edge e1 does not join" in refusal(own(lambda raw: raw["features"].pop(1)))
    assert "Feature 2" in refusal(own(lambda raw: raw["features"][1]["properties"].update(kind="palace")))
    assert "identifier 'a'" in refusal(own(lambda raw: raw["features"].insert(1, raw["features"][0])))
    assert "a name" in refusal(own(lambda raw: raw["features"][0]["properties"].update(name="  ")))
    twice = file_of("graphml").replace(b"</graph>", b'<node id="a"/></graph>')
    assert "node 'a'" in refusal(twice)
    assert "twice" in refusal(file_of("graphml").replace(b"</node>", b'<data key="node.name">X</data></node>', 1))


def test_foreign_files_never_break_a_law() -> None:
    found = read_graph(geojson(point("A", 1, 1)))
    assert isinstance(found, ForeignMap)
    places = [point(f"P{n}", (n * 37) % 21, ((n * 11) % 5) - 2.0) for n in range(40)]
    lines = [line(f"L{n}", (n % 20, 0.0), ((n * 7) % 20, 3.0), (n % 9, -2.0)) for n in range(20)]
    validate(imported(geojson(*places, *lines), DRAFT).graph)
