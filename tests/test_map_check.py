"""The checker: each check finds the fault that was planted, and says nothing of the good map."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from corridor_cloud import box, corridor
from hypothesis import given, settings
from hypothesis import strategies as st

from console.map_geometry.clearance import path_clearance, place_clearance
from console.map_geometry.occupancy import occupancy_of
from navcore.geometry import FloatArray
from navcore.map_check.checker import CHECKS, findings_of
from navcore.map_check.clearance import Bound, PathClearance, PlaceClearance
from navcore.map_check.evidence import Announced, MapEvidence, RehearsedRoute, WeakPlace, path_of
from navcore.map_check.finding import Finding
from navcore.map_check.names import why_unspeakable
from navcore.map_check.sounds import confusable_pairs
from navcore.map_check.weak_localization import weak_places
from navcore.planning.edits import add_edge, add_poi, move_poi, propose_edges, set_edge, update_poi, validate
from navcore.planning.poi_graph import POI_KINDS, Edge, Poi, PoiGraph, Road
from navcore.planning.road_network import RoadNetwork
from navcore.settings import Settings
from navcore.site import load_site

LINES: tuple[FloatArray, ...] = (
    np.column_stack([np.linspace(0.5, 11.5, 111), np.zeros(111)]),
    np.column_stack([np.full(61, 6.0), np.linspace(0.0, 6.0, 61)]),
)
"""A corridor along x, and one from its middle upwards."""
NETWORK = RoadNetwork.from_roads(LINES)


def good_graph() -> PoiGraph:
    """Return Hall, Bar and Wash room at the three ends, and the junction in the middle, all joined."""
    graph = PoiGraph()
    for name, kind, x_m, y_m in (
        ("Hall", "hall", 0.6, 0.0), ("Bar", "bar", 11.4, 0.0), ("Wash room", "toilet", 6.0, 5.9),
        ("Junction 1", "junction", 6.0, 0.0),
    ):  # fmt: skip
        graph = add_poi(graph, NETWORK, name=name, kind=kind, x_m=x_m, y_m=y_m)
    return propose_edges(graph, NETWORK)


GRAPH = good_graph()
EDGES = {frozenset((edge.a, edge.b)): edge for edge in GRAPH.edges.values()}
HALL_EDGE, BAR_EDGE, WASH_EDGE = (EDGES[frozenset((key, "junction-1"))] for key in ("hall", "bar", "wash-room"))


def good_cloud() -> FloatArray:
    """Both corridors, with an opening where they meet."""
    along = corridor(door_m=(4.8, 7.2))
    across = np.column_stack([6.0 - corridor()[:, 1], corridor()[:, 0] + 1.2, corridor()[:, 2]])
    return np.vstack([along, across])


GOOD_CLOUD = good_cloud()


def measured(graph: PoiGraph, *things: FloatArray, cloud: FloatArray = GOOD_CLOUD) -> MapEvidence:
    """Return what the console would know of a graph in the good building, with things put into it."""
    occupancy = occupancy_of(np.vstack([cloud, *things]), LINES)
    return MapEvidence(
        graph,
        NETWORK,
        {key: path_clearance(occupancy, path_of(edge)) for key, edge in graph.edges.items()},
        {key: place_clearance(occupancy, poi.x_m, poi.y_m) for key, poi in graph.pois.items()},
    )


def codes(evidence: MapEvidence) -> list[str]:
    return sorted(finding.code for finding in findings_of(evidence))


def the(evidence: MapEvidence, code: str) -> Finding:
    """Return the only thing that is found, which must be of this code."""
    (found,) = findings_of(evidence)
    assert found.code == code, found
    assert found.text.endswith(".")
    assert found.action.endswith(".")
    return found


def with_edge(edge_id: str, **changes: Any) -> PoiGraph:
    edges = {**GRAPH.edges, edge_id: msgspec.structs.replace(GRAPH.edges[edge_id], **changes)}
    return PoiGraph(GRAPH.version, GRAPH.pois, edges)


def with_pois(*pois: Poi) -> PoiGraph:
    """Return the good graph with free-standing places beside it, which no edge need reach."""
    return PoiGraph(GRAPH.version, {**GRAPH.pois, **{poi.id: poi for poi in pois}}, GRAPH.edges)


def beside(name: str, spoken_name: str = "", kind: str = "room") -> Poi:
    return Poi(f"p{name.encode().hex()[:60]}", name, kind, 3.0, 0.5, on_road=False, spoken_name=spoken_name)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------- the good map
def test_nothing_is_found_on_the_good_map() -> None:
    validate(GRAPH)
    assert findings_of(replace(measured(GRAPH), routes=(rehearsed(5.0, 10.0, 14.0),))) == ()


def test_nothing_is_found_on_the_office_floor(office_site: Path) -> None:
    # A real map of the simulated building: noise, drift, furniture, and what the walk has not seen.
    site = load_site(office_site)
    walked = [road[:, :2] for road in site.roads_m]
    network, occupancy = RoadNetwork.from_roads(walked), occupancy_of(site.cloud_points_m, walked)
    graph = site.poi_graph
    evidence = MapEvidence(
        graph,
        network,
        {key: path_clearance(occupancy, path_of(edge)) for key, edge in graph.edges.items()},
        {key: place_clearance(occupancy, poi.x_m, poi.y_m) for key, poi in graph.pois.items()},
        weak_places(site.map_arrays, site.report, network.polylines(), Settings()),
    )
    assert evidence.paths
    assert [finding for finding in findings_of(evidence) if finding.severity == "error"] == []


# -------------------------------------------------------------------------------------------------- reachability
def test_a_place_without_an_edge_is_found() -> None:
    lonely = add_poi(GRAPH, NETWORK, name="Lounge", kind="lounge", x_m=3.0, y_m=0.0)
    found = the(MapEvidence(lonely, NETWORK), "unreachable_poi")
    assert found.severity == "error"
    assert found.poi_ids == ("lounge",)
    assert (found.x_m, found.y_m) == (pytest.approx(3.0, abs=0.05), pytest.approx(0.0, abs=0.05))


def test_a_closed_edge_cuts_a_place_off() -> None:
    closed = set_edge(GRAPH, WASH_EDGE.id, closed=True)
    assert the(MapEvidence(closed, NETWORK), "unreachable_poi").poi_ids == ("wash-room",)


def test_a_place_that_edges_only_lead_to_cannot_be_left() -> None:
    a, b = ("junction-1", "bar") if BAR_EDGE.a == "junction-1" else ("bar", "junction-1")
    one_way = set_edge(GRAPH, BAR_EDGE.id, one_way=True)
    found = the(MapEvidence(one_way, NETWORK), "unleavable_poi" if b == "bar" else "unreachable_poi")
    assert found.poi_ids == ("bar",)
    turned = with_edge(BAR_EDGE.id, one_way=True, a=b, b=a, path_m=BAR_EDGE.path_m[::-1])
    other = the(MapEvidence(turned, NETWORK), "unreachable_poi" if b == "bar" else "unleavable_poi")
    assert other.poi_ids == ("bar",)
    assert other.severity == "error"


def test_an_exit_need_not_let_anybody_in() -> None:
    out = update_poi(set_edge(GRAPH, BAR_EDGE.id, one_way=True), "bar", kind="exit")
    assert the(MapEvidence(out, NETWORK), "unleavable_poi" if BAR_EDGE.b == "bar" else "unreachable_poi").severity == (
        "warning"
    )


# --------------------------------------------------------------------------------------------------------- names
@pytest.mark.parametrize(("one", "other"), [("Room 12", "room  12"), ("Room 12", "Room-12"), ("Café", "CAFÉ")])
def test_two_places_of_one_name_are_found(one: str, other: str) -> None:
    found = the(MapEvidence(with_pois(beside(one), beside(other)), NETWORK), "duplicate_spoken_name")
    assert len(found.poi_ids) == 2


def test_spoken_names_clash_too() -> None:
    graph = with_pois(beside("Room 12", "Kitchen"), beside("Kitchen"))
    assert the(MapEvidence(graph, NETWORK), "duplicate_spoken_name").severity == "warning"
    silent = with_pois(beside("X", kind="junction"), beside("x", kind="junction"))
    assert the(MapEvidence(silent, NETWORK), "duplicate_name").severity == "note"
    apart = with_pois(beside("Kitchen", "Staff kitchen"), beside("kitchen", "Guest kitchen"))
    assert the(MapEvidence(apart, NETWORK), "duplicate_name").severity == "note"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Room 3308", "Room 3380"),
        ("Room 13", "Room 30"),
        ("Room 1116", "Room 1160"),
        ("Gate B", "Gate D"),
        ("Meeting room", "Meating room"),
        ("Lounge", "Lunge"),
        ("Reception", "Receptions"),
    ],
)
def test_names_that_sound_alike_are_found(one: str, other: str) -> None:
    graph = with_pois(beside(one), beside(other))
    evidence = MapEvidence(PoiGraph(1, {k: p for k, p in graph.pois.items() if k != "hall"}, {}), NETWORK)
    assert "confusable_names" in codes(evidence)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Room 3308", "Room 3309"), ("Room 3308", "Room 3311"), ("Hall", "Bar"), ("Gate A", "Gate B"),
        ("North wing", "South wing"), ("厕所", "酒吧"), ("Room 2", "Room 3"),
    ],
)  # fmt: skip
def test_names_that_are_told_apart_are_not(one: str, other: str) -> None:
    assert confusable_pairs({"one": one, "other": other}) == {}


def test_junctions_that_are_passed_in_silence_are_not_compared() -> None:
    silent = with_pois(beside("Kreuzung", kind="junction"), beside("Kreuzunk", kind="junction"))
    assert findings_of(MapEvidence(silent, NETWORK)) == ()
    spoken = with_pois(beside("X", "Crossing", kind="junction"), beside("Y", "Crosing", kind="junction"))
    assert codes(MapEvidence(spoken, NETWORK)) == ["confusable_names"]


@pytest.mark.parametrize("name", ["WC", "B12a", "Rm 3", "Dept. of Maths", "#4", "3308", "Room_3", "Room 12345", "→"])
def test_names_that_cannot_be_spoken_want_a_spoken_name(name: str) -> None:
    found = the(MapEvidence(with_pois(beside(name)), NETWORK), "missing_spoken_name")
    assert name in found.text
    assert findings_of(MapEvidence(with_pois(beside(name, "Whole words")), NETWORK)) == ()
    assert findings_of(MapEvidence(with_pois(beside(name, kind="junction")), NETWORK)) == ()


@pytest.mark.parametrize(
    "name", ["Room 3308", "Wash room", "O'Neill's", "Café & Bar", "EXIT", "厕所", "Größe", "Lift A"]
)
def test_names_that_can_be_spoken_are_left_alone(name: str) -> None:
    assert why_unspeakable(name) is None


def test_a_spoken_name_that_cannot_be_spoken_is_found() -> None:
    assert (
        "spoken name" in the(MapEvidence(with_pois(beside("Copy room", "CR_7")), NETWORK), "missing_spoken_name").text
    )


# --------------------------------------------------------------------------------------------------------- edges
@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"a": "nowhere"}, "does not exist"),
        ({"path_m": ()}, "has no path"),
        ({"path_m": ((6.0, 0.0), (8.0, 0.0))}, "does not end at"),
    ],
)
def test_a_dangling_edge_is_found(changes: dict[str, Any], reason: str) -> None:
    evidence = MapEvidence(with_edge(BAR_EDGE.id, **changes), NETWORK)
    dangling = [finding for finding in findings_of(evidence) if finding.code == "dangling_edge"]
    assert [finding.edge_ids for finding in dangling] == [(BAR_EDGE.id,)]
    assert reason in dangling[0].text


def test_an_edge_that_ends_a_step_before_its_place_dangles() -> None:
    graph = with_edge(BAR_EDGE.id, path_m=tuple(BAR_EDGE.path_m[:-3]))
    assert the(MapEvidence(graph, NETWORK), "dangling_edge").edge_ids == (BAR_EDGE.id,)


def test_an_edge_to_a_free_standing_place_dangles() -> None:
    bar = msgspec.structs.replace(GRAPH.pois["bar"], on_road=False)
    graph = PoiGraph(1, {**GRAPH.pois, "bar": bar}, GRAPH.edges)
    assert the(MapEvidence(graph, NETWORK), "dangling_edge").edge_ids == (BAR_EDGE.id,)


def test_an_edge_that_leaves_the_road_is_found() -> None:
    a, b = BAR_EDGE.path_m[0], BAR_EDGE.path_m[-1]
    over = ((a[0] + b[0]) / 2, 2.0)
    graph = with_edge(BAR_EDGE.id, path_m=(a, over, b))
    found = the(MapEvidence(graph, NETWORK), "edge_without_road")
    assert found.edge_ids == (BAR_EDGE.id,)
    assert (found.x_m, found.y_m) == (pytest.approx(over[0], abs=0.3), pytest.approx(2.0, abs=0.3))
    assert "2.0 m at most" in found.text


def test_without_any_road_every_edge_is_without_road() -> None:
    assert codes(MapEvidence(GRAPH, RoadNetwork.from_roads([]))) == ["edge_without_road"] * 3


def test_places_too_near_to_each_other_are_found() -> None:
    near = add_poi(GRAPH, NETWORK, name="Door", kind="door", x_m=1.4, y_m=0.0)
    near = add_edge(near, NETWORK, "hall", "door")
    assert the(MapEvidence(near, NETWORK), "short_edge").severity == "warning"
    assert findings_of(MapEvidence(move_poi(near, NETWORK, "door", 1.7, 0.0), NETWORK)) == ()


# ------------------------------------------------------------------------------------------------ ends of roads
def roads_apart(gap_m: float) -> tuple[MapEvidence, tuple[FloatArray, ...]]:
    lines = (np.array([[0.0, 0.0], [8.0, 0.0]]), np.array([[8.0 + gap_m, 0.0], [16.0, 0.0]]))
    roads = {f"r{n}": Road(f"r{n}", tuple(map(tuple, line.tolist()))) for n, line in enumerate(lines)}
    return MapEvidence(PoiGraph(1, {}, {}, roads), RoadNetwork.from_roads(lines)), lines


def test_ends_that_nearly_meet_are_found_once() -> None:
    found = the(roads_apart(1.5)[0], "nearly_joined_roads")
    assert found.road_ids == ("r0", "r1")
    assert (found.x_m, found.y_m) == (pytest.approx(8.75, abs=0.2), pytest.approx(0.0, abs=0.1))


def test_ends_that_are_far_apart_or_joined_are_not() -> None:
    assert findings_of(roads_apart(3.0)[0]) == ()
    assert findings_of(roads_apart(0.2)[0]) == ()


def test_an_end_that_nearly_reaches_the_side_of_a_road_is_found() -> None:
    lines = [np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([[5.0, 1.4], [5.0, 8.0]])]
    assert codes(MapEvidence(PoiGraph(), RoadNetwork.from_roads(lines))) == ["nearly_joined_roads"]


def test_a_hairpin_is_no_gap() -> None:
    hairpin = [np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.2], [1.5, 1.2]])]
    assert findings_of(MapEvidence(PoiGraph(), RoadNetwork.from_roads(hairpin))) == ()


# ----------------------------------------------------------------------------------------------------- passages
def test_an_edge_through_something_is_found_where_it_stands() -> None:
    found = the(measured(GRAPH, box((8.7, -0.1, 0.0), (9.3, 0.1, 1.0))), "edge_through_obstacle")
    assert found.severity == "error"
    assert found.edge_ids == (BAR_EDGE.id,)
    assert (found.x_m, found.y_m) == (pytest.approx(9.0, abs=0.2), pytest.approx(0.0, abs=0.1))


def test_a_passage_narrower_than_a_person_is_found_and_a_wider_one_is_not() -> None:
    def narrowed(half_m: float) -> MapEvidence:
        left, right = box((8.9, half_m, 0.0), (9.2, 1.2, 1.0)), box((8.9, -1.2, 0.0), (9.2, -half_m, 1.0))
        return measured(GRAPH, left, right)

    found = the(narrowed(0.25), "narrow_passage")
    assert found.edge_ids == (BAR_EDGE.id,)
    assert found.x_m == pytest.approx(9.05, abs=0.2)
    assert findings_of(narrowed(0.5)) == ()


def test_a_width_that_somebody_wrote_down_counts() -> None:
    assert the(MapEvidence(with_edge(BAR_EDGE.id, width_m=0.6), NETWORK), "narrow_passage").severity == "error"
    assert findings_of(MapEvidence(with_edge(BAR_EDGE.id, width_m=0.9), NETWORK)) == ()


def test_nobody_is_warned_of_a_closed_edge() -> None:
    closed = set_edge(GRAPH, BAR_EDGE.id, closed=True)
    assert codes(measured(closed, box((8.9, -0.1, 0.0), (9.1, 0.1, 1.0)))) == ["unreachable_poi"]


def test_where_no_floor_has_been_seen_that_is_said() -> None:
    unseen = (np.abs(GOOD_CLOUD[:, 2]) < 0.1) & (GOOD_CLOUD[:, 0] > 8.0) & (GOOD_CLOUD[:, 0] < 10.0)
    found = the(measured(GRAPH, cloud=GOOD_CLOUD[~unseen]), "unknown_passage")
    assert found.severity == "note"  # somebody has walked there
    occupancy = occupancy_of(GOOD_CLOUD[~unseen], [])
    path = path_clearance(occupancy, path_of(BAR_EDGE))
    nobody = MapEvidence(GRAPH, NETWORK, {BAR_EDGE.id: path})
    found = the(nobody, "unknown_passage")
    assert found.severity == "error", "unknown is never clear"
    assert found.edge_ids == (BAR_EDGE.id,)


def test_a_connection_along_a_drawn_road_beyond_the_cloud_is_an_error() -> None:
    drawn = Road("r9", ((11.5, 0.0), (16.0, 0.0)), "drawn")
    network = RoadNetwork.from_roads((*LINES, np.array(drawn.points_m)))
    graph = add_poi(GRAPH, network, name="Annexe", kind="room", x_m=15.5, y_m=0.0)
    path = ((11.4, 0.0), (15.5, 0.0))
    edge = Edge("e9", "bar", "annexe", path, 4.1)
    graph = msgspec.structs.replace(graph, edges={**GRAPH.edges, "e9": edge}, roads={drawn.id: drawn})
    found = [each for each in findings_of(replace(measured(graph), network=network)) if each.code == "unknown_passage"]
    assert [(each.severity, each.edge_ids, each.road_ids) for each in found] == [("error", ("e9",), ("r9",))]
    assert found[0].text == "The connection from Bar to Annexe leads where no floor has been seen."


def test_a_place_without_room_is_found() -> None:
    bar = GRAPH.pois["bar"]
    crowded = measured(GRAPH, box((bar.x_m, 0.2, 0.0), (bar.x_m + 0.1, 0.4, 1.0)))
    assert the(crowded, "no_clearance").poi_ids == ("bar",)


def test_a_place_where_no_floor_was_seen_is_unknown() -> None:
    evidence = MapEvidence(GRAPH, NETWORK, {}, {"bar": PlaceClearance(math.inf, False)})
    assert the(evidence, "unknown_clearance").poi_ids == ("bar",)


# ------------------------------------------------------------------------------------------------- localization
def map_arrays(xs_m: list[float], landmarks: int = 200, deviation_m: float = 0.02) -> dict[str, np.ndarray]:
    """Return key frames along the corridor, as the site's map has them; the last third may be unlike the others."""
    count = len(xs_m)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 3] = -np.array(xs_m)
    return {
        "camera_from_world": poses,
        "keyframe_covariance": np.tile(np.eye(6) * deviation_m**2, (count, 1, 1)),
        "feature_start": np.arange(count + 1, dtype=np.int64) * 300,
        "feature_landmark": np.tile(np.where(np.arange(300) < landmarks, 1, -1), count).astype(np.int32),
    }


EVERY_METRE = [float(x) for x in range(13)]


def weak(arrays: dict[str, np.ndarray]) -> tuple[WeakPlace, ...]:
    return weak_places(arrays, {}, [LINES[0]], Settings())


def test_a_good_map_is_nowhere_weak() -> None:
    assert weak(map_arrays(EVERY_METRE)) == ()
    assert weak({}) == ()


def test_a_road_that_no_key_frame_sees_is_weak() -> None:
    (found,) = weak(map_arrays([0.0, 1.0, 2.0]))
    assert found.length_m == pytest.approx(7.0, abs=0.5)
    assert found.x_m == pytest.approx(8.0, abs=0.5)
    assert "no view" in found.reason


def test_few_landmarks_and_an_uncertain_map_are_weak() -> None:
    assert "few landmarks" in weak(map_arrays(EVERY_METRE, landmarks=30))[0].reason
    assert "not sure" in weak(map_arrays(EVERY_METRE, deviation_m=0.4))[0].reason


def test_what_the_map_walk_was_warned_of_is_told_and_a_report_of_another_form_is_passed_over() -> None:
    stretch = {"from_m": 1.0, "length_m": 2.5, "x_m": 3.0, "y_m": 0.0, "kinds": ["too_dark"]}
    (found,) = weak_places({}, {"weak_stretches": [stretch, {"x_m": "?"}, None, 7]}, [], Settings())
    assert (found.x_m, found.length_m) == (3.0, 2.5)
    assert "too dark" in found.reason
    assert weak_places({}, {"weak_stretches": "many"}, [], Settings()) == ()


def test_weak_stretches_become_findings() -> None:
    evidence = MapEvidence(GRAPH, NETWORK, weak=(WeakPlace(3.0, 0.0, 2.5, "the views here show few landmarks"),))
    found = the(evidence, "weak_localization")
    assert (found.x_m, found.severity) == (3.0, "warning")


# --------------------------------------------------------------------------------------------------- rehearsals
def rehearsed(*at_m: float, ahead_m: float = 6.0, kind: str = "poi_ahead") -> RehearsedRoute:
    said = tuple(Announced(kind, "bar", each, ahead_m, each, 0.0) for each in at_m)
    return RehearsedRoute("hall", "bar", 20.0, 20.0, 0.0, said)


@pytest.mark.parametrize(("ahead_m", "found"), [(6.0, 0), (5.0, 0), (7.0, 0), (4.9, 1), (7.2, 1)])
def test_announcements_out_of_place_are_found_once(ahead_m: float, found: int) -> None:
    evidence = MapEvidence(GRAPH, NETWORK, routes=(rehearsed(5.0, 10.0, 14.0, ahead_m=ahead_m),) * 2)
    assert codes(evidence) == ["announcement_distance"] * found


def test_the_distance_of_a_reassurance_is_no_announcement_of_a_place() -> None:
    assert (
        findings_of(MapEvidence(GRAPH, NETWORK, routes=(rehearsed(9.0, 15.0, ahead_m=80.0, kind="reassurance"),))) == ()
    )


def test_a_long_silence_is_found_in_the_middle_and_at_both_ends() -> None:
    def silences(*at_m: float) -> list[float]:
        evidence = MapEvidence(GRAPH, NETWORK, routes=(rehearsed(*at_m),))
        return [finding.x_m for finding in findings_of(evidence)]

    assert silences(9.0, 19.0) == []
    assert silences(2.0, 14.0) == [14.0]
    assert silences(12.0) == [12.0]
    assert silences(4.0, 8.0) == [20.0]
    assert silences() == [20.0]


# --------------------------------------------------------------------------------------------------------- laws
def test_findings_come_by_severity_and_then_by_place() -> None:
    graph = with_pois(beside("WC"), beside("Rm 4"))
    graph = add_poi(graph, NETWORK, name="Lounge", kind="lounge", x_m=9.0, y_m=0.0)
    graph = add_poi(graph, NETWORK, name="Library", kind="room", x_m=2.0, y_m=0.0)
    found = findings_of(MapEvidence(graph, NETWORK))
    assert [(finding.severity, round(finding.x_m)) for finding in found] == [
        ("error", 2), ("error", 9), ("warning", 3), ("warning", 3),
    ]  # fmt: skip


IDENTIFIERS = st.sampled_from(["a", "b", "c", "d", "e"])
METRES = st.one_of(st.floats(-10.0, 20.0), st.floats(-1e5, 1e5), st.sampled_from([0.0, 1e5, -1e5]))
POINTS = st.tuples(METRES, METRES)
TEXTS = st.one_of(
    st.text(min_size=1, max_size=80), st.sampled_from(["Hall", "Hal", "Room 3308", "Room 3380", "B", "D"])
)
POIS = st.builds(
    Poi, IDENTIFIERS, TEXTS, st.sampled_from(POI_KINDS), METRES, METRES, st.booleans(), st.text(max_size=80)
)
EDGE_VALUES = st.builds(
    Edge,
    IDENTIFIERS,
    IDENTIFIERS,
    IDENTIFIERS,
    st.lists(POINTS, max_size=4).map(tuple),
    st.floats(0.0, 1e6),
    st.booleans(),
    st.booleans(),
    st.floats(1.0, 100.0),
    st.one_of(st.none(), st.floats(0.3, 50.0)),
)
ROADS = st.builds(Road, IDENTIFIERS, st.lists(POINTS, max_size=3).map(tuple))
FINITE = st.floats(-1e6, 1e6)
ROUTES = st.builds(
    RehearsedRoute,
    IDENTIFIERS,
    IDENTIFIERS,
    st.floats(0.0, 1e4),
    FINITE,
    FINITE,
    st.lists(
        st.builds(Announced, st.sampled_from(["poi_ahead", "turn"]), IDENTIFIERS, FINITE, FINITE, FINITE, FINITE),
        max_size=3,
    ).map(tuple),
)


@st.composite
def graphs(draw: st.DrawFn) -> PoiGraph:
    """Any graph that a file may hold, whether the laws of edits hold for it or not."""
    parts = (st.lists(POIS, max_size=5), st.lists(EDGE_VALUES, max_size=5), st.lists(ROADS, max_size=3))
    pois, edges, roads = ({value.id: value for value in draw(part)} for part in parts)
    return PoiGraph(1, pois, edges, roads)


@st.composite
def clearances(draw: st.DrawFn) -> PathClearance:
    count = draw(st.integers(0, 6))
    sides = [np.array(draw(st.lists(st.floats(0.0, 3.0), min_size=count, max_size=count))) for _ in range(2)]
    bounds = [
        np.array(draw(st.lists(st.sampled_from(Bound), min_size=count, max_size=count)), np.int8) for _ in range(2)
    ]
    return PathClearance(np.zeros((count, 2)), np.arange(count) * 0.1, *sides, *bounds)


@settings(max_examples=150, deadline=None)
@given(
    graph=graphs(),
    network=st.sampled_from([NETWORK, RoadNetwork.from_roads([])]),
    paths=st.dictionaries(IDENTIFIERS, clearances(), max_size=3),
    places=st.dictionaries(IDENTIFIERS, st.builds(PlaceClearance, st.floats(0.0, 9.0), st.booleans()), max_size=3),
    routes=st.lists(ROUTES, max_size=2),
)
def test_no_check_ever_raises_and_the_order_of_the_graph_does_not_matter(
    graph: PoiGraph,
    network: RoadNetwork,
    paths: dict[str, PathClearance],
    places: dict[str, PlaceClearance],
    routes: list[RehearsedRoute],
) -> None:
    evidence = MapEvidence(graph, network, paths, places, routes=routes)
    found = findings_of(evidence)
    assert found == findings_of(evidence)
    turned = PoiGraph(
        graph.version, dict(reversed(graph.pois.items())), dict(reversed(graph.edges.items())), graph.roads
    )
    assert found == findings_of(replace(evidence, graph=turned))
    for finding in found:
        assert msgspec.json.decode(msgspec.json.encode(finding), type=Finding) == finding
        assert finding.text
        assert finding.action
        assert set(finding.poi_ids) <= set(graph.pois)
        assert set(finding.edge_ids) <= set(graph.edges)


def test_every_check_is_on_the_list() -> None:
    import inspect

    from navcore.map_check import edges, names, passages, reachability, rehearsals, road_ends, weak_localization

    modules = (edges, names, passages, reachability, rehearsals, road_ends, weak_localization)
    written = {
        function
        for module in modules
        for name, function in vars(module).items()
        if inspect.isfunction(function) and function.__module__ == module.__name__ and not name.startswith("_")
        and list(inspect.signature(function).parameters) == ["evidence"]
    }  # fmt: skip
    assert set(CHECKS) == written
