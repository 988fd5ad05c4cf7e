"""A rehearsal says what the device would say: laws over many maps, and the office floor's own."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import wave
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from closed_loop import BoxWorld, NoisyTruth, box
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from device_agent.cli import main
from device_agent.simulation.building import Start
from device_agent.simulation.walker import WalkerParameters
from device_agent.state import DeviceState
from device_agent.walk import lead
from navcore.cues.table import CueKind, is_said
from navcore.errors import InputError
from navcore.map_check.checker import findings_of
from navcore.map_check.evidence import MapEvidence
from navcore.planning.poi_graph import CAUTION_SIDES, Edge, Poi, PoiGraph
from navcore.planning.road_network import RoadNetwork
from navcore.planning.way_finding import WayFinder
from navcore.rehearsal.every_leg import all_routes_announced
from navcore.rehearsal.rehearsing import CancelledError, Rehearsal, Utterance, rehearse
from navcore.settings import Settings
from navcore.site import load_poi_graph

MIRRORED = {"none": "none", "left": "right", "right": "left", "both": "both"}
TOLD_OF_PLACES = (CueKind.POI_AHEAD, CueKind.HAZARD_AHEAD)


def chain(places_m: list[tuple[float, float]], sides: list[str] | None = None, **changes: object) -> PoiGraph:
    """A graph of places p0, p1, … joined by straight edges e0, e1, …"""
    pois = {f"p{i}": Poi(f"p{i}", f"Room {i}", "room", x_m, y_m) for i, (x_m, y_m) in enumerate(places_m)}
    edges = {}
    for i, (a, b) in enumerate(itertools.pairwise(places_m)):
        side = "none" if sides is None else sides[i]
        edges[f"e{i}"] = Edge(f"e{i}", f"p{i}", f"p{i + 1}", (a, b), math.dist(a, b), caution_side=side, **changes)
    return PoiGraph(1, pois, edges)


def with_edge(graph: PoiGraph, edge: Edge) -> PoiGraph:
    return PoiGraph(graph.version + 1, graph.pois, {**graph.edges, edge.id: edge})


def with_changes(graph: PoiGraph, edge_id: str, **changes: object) -> PoiGraph:
    return with_edge(graph, msgspec.structs.replace(graph.edges[edge_id], **changes))


def of_kind(rehearsal: Rehearsal, *kinds: CueKind) -> list[Utterance]:
    return [each for each in rehearsal.utterances if each.kind in kinds]


@st.composite
def ways(draw: st.DrawFn) -> tuple[list[tuple[float, float]], list[str]]:
    """Places one after the other, with every bend and length that a building may have, and sides to beware of."""
    heading_rad, places_m = 0.0, [(0.0, 0.0)]
    for _ in range(draw(st.integers(1, 5))):
        heading_rad += draw(st.floats(-2.9, 2.9))
        length_m = draw(st.floats(0.3, 10.0))
        x_m, y_m = places_m[-1]
        places_m.append((x_m + length_m * math.cos(heading_rad), y_m + length_m * math.sin(heading_rad)))
    count = len(places_m) - 1
    return places_m, draw(st.lists(st.sampled_from(CAUTION_SIDES), min_size=count, max_size=count))


@st.composite
def manners(draw: st.DrawFn) -> Settings:
    """How the walker is spoken to and led."""
    return Settings().changed(
        {
            "cues.direction_style": draw(st.sampled_from(["degrees", "clock", "sides"])),
            "cues.verbosity": draw(st.sampled_from(["brief", "normal", "full"])),
            "follower.policy": draw(st.sampled_from(["paper", "road_centred"])),
        }
    )


@hypothesis_settings(deadline=None, max_examples=25)
@given(ways(), manners())
def test_every_way_ends_with_arrival_and_is_told_in_order(
    way: tuple[list[tuple[float, float]], list[str]], settings: Settings
) -> None:
    places_m, sides = way
    goal = f"p{len(places_m) - 1}"
    done = rehearse(chain(places_m, sides), "p0", goal, settings)
    assert (done.arrived, done.refusal) == (True, "")
    assert done.edge_ids == tuple(f"e{i}" for i in range(len(sides)))
    last = done.utterances[-1]
    assert (last.kind, last.poi_id) == (CueKind.ARRIVED, goal)
    assert [each.kind for each in done.utterances].count(CueKind.ARRIVED) == 1
    stamps = [each.stamp_s for each in done.utterances]
    assert stamps == sorted(stamps)
    assert done.total_s >= stamps[-1] + last.lasts_s
    assert all(is_said(each.kind, settings.cues.verbosity) for each in done.utterances)
    # Walking speed, and never through a wall: who is led stays by the road.
    assert done.total_s >= (done.length_m - 2.0) / 0.85
    assert math.dist((last.x_m, last.y_m), places_m[-1]) <= settings.follower.arrival_distance_m + 1e-6


@hypothesis_settings(deadline=None, max_examples=20)
@given(ways(), manners().filter(lambda settings: settings.cues.direction_style != "clock"))
def test_a_mirrored_map_mirrors_left_and_right(
    way: tuple[list[tuple[float, float]], list[str]], settings: Settings
) -> None:
    """To the last cue in Chinese, in which *left* and *right* take the same time to be said."""
    places_m, sides = way
    goal = f"p{len(places_m) - 1}"
    here = rehearse(chain(places_m, sides), "p0", goal, settings, "zh")
    mirrored = chain([(x_m, -y_m) for x_m, y_m in places_m], [MIRRORED[side] for side in sides])
    there = rehearse(mirrored, "p0", goal, settings, "zh")
    swapped = str.maketrans("左右", "右左")
    assert [(each.stamp_s, each.kind, each.text.translate(swapped)) for each in here.utterances] == [
        (each.stamp_s, each.kind, each.text) for each in there.utterances
    ]
    for one, other in zip(here.utterances, there.utterances, strict=True):
        assert (one.x_m, one.y_m) == pytest.approx((other.x_m, -other.y_m), abs=1e-6)
        assert (one.angle_deg or 0.0) == -(other.angle_deg or 0.0)
        assert one.pan == -other.pan


@hypothesis_settings(deadline=None, max_examples=10)
@given(ways(), manners())
def test_the_same_input_gives_the_same_list(
    way: tuple[list[tuple[float, float]], list[str]], settings: Settings
) -> None:
    graph, goal = chain(*way), f"p{len(way[0]) - 1}"
    assert rehearse(graph, "p0", goal, settings) == rehearse(graph, "p0", goal, settings)


# ------------------------------------------------------------------------------------------------- what is said
AROUND_THE_CORNER = chain([(0.0, 0.0), (14.0, 0.0), (14.0, 25.0)], ["none", "left"])


def test_turns_places_and_reassurances_come_where_they_should() -> None:
    done = rehearse(AROUND_THE_CORNER, "p0", "p2")
    assert done.length_m == pytest.approx(39.0, abs=0.2)
    places = {each.poi_id: each for each in of_kind(done, CueKind.POI_AHEAD)}
    assert set(places) == {"p1", "p2"}
    for poi_id, at_m in (("p1", 14.0), ("p2", 39.0)):
        assert places[poi_id].distance_m == pytest.approx(6.0, abs=1.0)
        assert at_m - places[poi_id].along_m == pytest.approx(places[poi_id].distance_m, abs=0.2)
    (ahead,) = of_kind(done, CueKind.TURN_AHEAD)
    turn = of_kind(done, CueKind.TURN)[0]
    assert "left" in ahead.text
    assert ahead.stamp_s + ahead.lasts_s <= turn.stamp_s
    assert turn.angle_deg == pytest.approx(90.0, abs=10.0)
    assert math.dist((turn.x_m, turn.y_m), (14.0, 0.0)) < 1.5
    reassured = [each.along_m for each in of_kind(done, CueKind.REASSURANCE)]
    assert len(reassured) == 3
    assert all(10.0 <= b - a <= 14.0 for a, b in zip([0.0, *reassured], reassured, strict=False))
    assert done.utterances[0].text == "To Room 2."


def test_caution_is_said_on_the_edge_once_on_the_side_as_it_is_walked() -> None:
    there, back = rehearse(AROUND_THE_CORNER, "p0", "p2"), rehearse(AROUND_THE_CORNER, "p2", "p0")
    (on_the_way,) = of_kind(there, CueKind.CAUTION_SIDE)
    (on_the_way_back,) = of_kind(back, CueKind.CAUTION_SIDE)
    assert (on_the_way.text, on_the_way_back.text) == ("Caution on the left.", "Caution on the right.")
    assert on_the_way.edge_id == on_the_way_back.edge_id == "e1"
    # Past the corner: before it, left would be another side.
    walks = [each.stamp_s for each in of_kind(there, CueKind.WALK)]
    assert on_the_way.stamp_s > walks[1]
    assert on_the_way.y_m < 2.0
    assert [
        each.text for each in of_kind(rehearse(AROUND_THE_CORNER, "p0", "p2", language="zh"), CueKind.CAUTION_SIDE)
    ] == ["注意左边。"]


@pytest.mark.parametrize(
    ("width_m", "is_said_so"), [(None, False), (0.75, True), (0.89, True), (0.95, False), (2.0, False)]
)
def test_a_narrow_passage_is_said_where_it_is_one(width_m: float | None, is_said_so: bool) -> None:
    graph = chain([(0.0, 0.0), (20.0, 0.0)], width_m=width_m)
    assert [each.text for each in of_kind(rehearse(graph, "p0", "p1"), CueKind.NARROW_PASSAGE)] == (
        ["Narrow passage."] if is_said_so else []
    )
    # Whoever is wider hears it earlier.
    wide = Settings().changed({"obstacle.person_width_m": 1.0})
    assert bool(of_kind(rehearse(graph, "p0", "p1", wide), CueKind.NARROW_PASSAGE)) == (
        width_m is not None and width_m < 1.2
    )


@pytest.mark.parametrize("before_m", [6.2, 6.8, 7.4, 8.0])
def test_caution_makes_no_announcement_of_a_place_late(before_m: float) -> None:
    """However far the next place is from where the edge begins, it is told 6 ± 1 m ahead, and caution on its edge."""
    graph = chain([(0.0, 0.0), (12.0, 0.0), (12.0 + before_m, 0.0), (40.0, 0.0)], ["none", "both", "none"])
    done = rehearse(graph, "p0", "p3")
    for each in of_kind(done, CueKind.POI_AHEAD):
        assert each.distance_m == pytest.approx(6.0, abs=1.0), each
    assert {each.poi_id for each in of_kind(done, CueKind.POI_AHEAD)} == {"p1", "p2", "p3"}
    (caution,) = of_kind(done, CueKind.CAUTION_SIDE)
    assert 12.0 < caution.along_m < 12.0 + before_m / 2.0


@pytest.mark.parametrize("edge_m", [1.0, 2.0, 3.0, 5.0, 8.0, 20.0])
@pytest.mark.parametrize("after_m", [2.0, 5.0, 6.5])
@pytest.mark.parametrize(("side", "width_m"), [("left", None), ("none", 0.8)])
def test_what_is_to_be_known_of_an_edge_is_said_in_its_first_half(
    edge_m: float, after_m: float, side: str, width_m: float | None
) -> None:
    """However short it is, and whatever else is due there: places behind it, a reassurance."""
    for before_m in (3.0, 12.0):
        xs_m = list(itertools.accumulate([0.0, before_m, edge_m, after_m]))
        graph = with_changes(chain([(x_m, 0.0) for x_m in xs_m], ["none", side, "none"]), "e1", width_m=width_m)
        done = rehearse(graph, "p0", "p3")
        kind = CueKind.NARROW_PASSAGE if width_m else CueKind.CAUTION_SIDE
        (said,) = of_kind(done, kind)
        assert said.edge_id == "e1"
        assert said.along_m - before_m <= edge_m / 2.0


@hypothesis_settings(deadline=None, max_examples=25)
@given(st.lists(st.tuples(st.floats(2.0, 9.0), st.sampled_from(["none", "left", "right"])), min_size=3, max_size=6))
def test_of_edges_one_behind_the_other_each_caution_is_said_in_its_first_half(edges: list[tuple[float, str]]) -> None:
    xs_m = list(itertools.accumulate([0.0, *(length_m for length_m, _ in edges)]))
    done = rehearse(chain([(x_m, 0.0) for x_m in xs_m], [side for _, side in edges]), "p0", f"p{len(edges)}")
    begins_m: dict[str | None, float] = {}
    for each in of_kind(done, CueKind.CAUTION_SIDE):
        begins_m[each.edge_id] = each.along_m
    for number, (length_m, side) in enumerate(edges):
        if side != "none":
            assert begins_m[f"e{number}"] - xs_m[number] <= length_m / 2.0


def test_stairs_of_which_nobody_could_be_told_after_a_caution_come_before_it() -> None:
    graph = chain([(0.0, 0.0), (3.5, 0.0), (20.0, 0.0)], ["left", "none"])
    stairs = msgspec.structs.replace(graph.pois["p1"], kind="stairs")
    said = of_kind(
        rehearse(PoiGraph(1, {**graph.pois, "p1": stairs}, graph.edges), "p0", "p2"),
        CueKind.HAZARD_AHEAD, CueKind.CAUTION_SIDE,
    )  # fmt: skip
    assert said[0].kind is CueKind.HAZARD_AHEAD


def test_the_checker_hears_where_there_is_no_time_for_a_caution() -> None:
    """Two things to know of an edge half as long as the first of them: an error, not a silence."""
    graph = with_changes(chain([(0.0, 0.0), (20.0, 0.0), (21.0, 0.0), (40.0, 0.0)], ["none", "left", "none"]), "e1",
                         width_m=0.8)  # fmt: skip
    legs = all_routes_announced(graph)
    evidence = MapEvidence(graph, RoadNetwork.from_roads([]), routes=legs.routes)
    found = [each for each in findings_of(evidence) if each.code == "caution_not_said"]
    assert [(each.severity, each.edge_ids) for each in found] == [("error", ("e1",))]
    assert "narrow" in found[0].text
    fine = with_changes(graph, "e1", width_m=None)
    legs = all_routes_announced(fine)
    evidence = MapEvidence(fine, RoadNetwork.from_roads([]), routes=legs.routes)
    assert "caution_not_said" not in {each.code for each in findings_of(evidence)}


def test_a_way_that_does_not_exist_is_refused_as_the_device_refuses_it() -> None:
    closed = with_changes(AROUND_THE_CORNER, "e1", closed=True)
    done = rehearse(closed, "p0", "p2")
    assert not done.arrived
    assert done.refusal == "Room 2 cannot be reached: the way between Room 1 and Room 2 is closed."
    assert [each.text for each in done.utterances] == ["To Room 2.", done.refusal]
    assert rehearse(closed, "p0", "nowhere").refusal.startswith("There is no place 'nowhere'")


def test_who_stands_at_the_destination_has_arrived() -> None:
    done = rehearse(AROUND_THE_CORNER, "p1", "p1")
    assert [each.kind for each in done.utterances] == [CueKind.ANSWER, CueKind.ARRIVED]


def test_what_cannot_be_rehearsed_is_refused_in_a_sentence() -> None:
    with pytest.raises(InputError, match="choose another start"):
        rehearse(AROUND_THE_CORNER, "gone", "p2")
    with pytest.raises(InputError, match="rehearse it in parts"):
        rehearse(AROUND_THE_CORNER, "p0", "p2", longest_m=30.0)
    with pytest.raises(InputError, match="walking speed"):
        rehearse(AROUND_THE_CORNER, "p0", "p2", speed_m_s=float("nan"))
    with pytest.raises(CancelledError):
        rehearse(AROUND_THE_CORNER, "p0", "p2", cancelled=lambda: True)


def test_the_device_itself_says_the_same_words_on_that_way() -> None:
    """The device's own loop leads a walker who does not err through the same map, with depth images and all."""
    wall = (box(-3.0, -3.0, 20.0, -2.8), box(-3.0, 2.8, 11.2, 3.0), box(16.8, -3.0, 17.0, 30.0))
    exact = WalkerParameters(
        turn_gain_sigma=0.0, tone_sigma_deg=0.0, veer_deg_per_sqrt_m=0.0, reaction_min_s=0.7, reaction_max_s=0.7
    )
    world = BoxWorld(wall, (), exact, Start(0.0, 0.0, 0.0), 1)
    state = DeviceState(Settings(), AROUND_THE_CORNER, "boxes", "boxes-map")
    _, cues = lead(world, state, NoisyTruth(world, 1), "p2", max_s=120.0)
    rehearsed = rehearse(AROUND_THE_CORNER, "p0", "p2")
    assert cues[-1].kind is CueKind.ARRIVED
    # Those whose words do not depend on where exactly a walker who sways has come to.
    exact_words = (CueKind.CAUTION_SIDE, CueKind.ARRIVED)
    assert [(cue.kind, cue.text) for cue in cues if cue.kind in exact_words] == [
        (each.kind, each.text) for each in of_kind(rehearsed, *exact_words)
    ]
    told = (*exact_words, CueKind.TURN_AHEAD, CueKind.POI_AHEAD, CueKind.REASSURANCE)
    assert {cue.kind for cue in cues if cue.kind in told} == {each.kind for each in of_kind(rehearsed, *told)}
    arrived_s = of_kind(rehearsed, CueKind.ARRIVED)[0].stamp_s
    assert cues[-1].stamp_s == pytest.approx(arrived_s, abs=5.0)


# -------------------------------------------------------------------------------------------- the office, and all
def test_every_way_of_the_office_floor_can_be_rehearsed(office_site: Path) -> None:
    graph = load_poi_graph(office_site)
    assert len(graph.pois) >= 2
    finder = WayFinder(graph)
    for start in graph.pois:
        for goal in graph.pois:
            done = rehearse(graph, start, goal, finder=finder)
            assert done.arrived, (start, goal, done.refusal)
            assert done.utterances[-1].kind is CueKind.ARRIVED


def test_all_legs_are_announced_and_those_left_out_are_named() -> None:
    graph = chain([(0.0, 0.0), (14.0, 0.0), (14.0, 25.0), (40.0, 25.0)], ["left", "left", "none"])
    found = all_routes_announced(graph)
    assert (found.left_out, found.refusals) == ((), ())
    assert len(found.routes) < 6, "fewer ways than legs"
    said = [each for route in found.routes for each in route.announced]
    places = [each for each in said if each.kind == "poi_ahead"]
    assert {each.poi_id for each in places} == set(graph.pois)
    for each in places:
        assert each.distance_m == pytest.approx(6.0, abs=1.0)
        poi = graph.pois[each.poi_id]
        assert math.dist((each.x_m, each.y_m), (poi.x_m, poi.y_m)) == pytest.approx(each.distance_m, abs=0.7)
    heard_at = [(each.x_m, each.y_m) for each in said if each.kind == "caution_side"]
    for at_m in ((0.0, 0.0), (14.0, 0.0), (14.0, 25.0)):
        assert any(math.dist(at_m, each) < 2.5 for each in heard_at), "on both edges, there and back"
    for route in found.routes:
        at_m = [each.at_m for each in route.announced]
        assert at_m == sorted(at_m)
        assert (route.announced[-1].kind, route.announced[-1].poi_id) == ("arrived", route.goal_id)
        assert route.length_m - at_m[-1] < 1.5
        assert (route.end_x_m, route.end_y_m) == (graph.pois[route.goal_id].x_m, graph.pois[route.goal_id].y_m)
    assert all_routes_announced(graph, longest_m=40.0).left_out == ("e0", "e1", "e2")


def test_legs_that_nobody_is_led_over_are_named() -> None:
    graph = chain([(0.0, 0.0), (10.0, 0.0), (20.0, 0.0)])
    detour = Edge("detour", "p0", "p1", ((0.0, 0.0), (5.0, 20.0), (10.0, 0.0)), 41.2)
    closed = with_changes(graph, "e1", closed=True)
    assert all_routes_announced(with_edge(graph, detour)).left_out == ("detour",)
    assert all_routes_announced(closed).left_out == ()
    assert all_routes_announced(PoiGraph()).routes == ()
    one_way = all_routes_announced(with_changes(graph, "e1", one_way=True))
    assert one_way.left_out == ()


def test_of_many_places_some_are_rehearsed_and_the_rest_is_named() -> None:
    graph = chain([(10.0 * i, 0.0) for i in range(6)])
    some = all_routes_announced(graph, max_places=3)
    assert some.left_out == ("e2", "e3", "e4")
    assert {each for route in some.routes for each in route.edge_ids} == {"e0", "e1"}


def test_rehearsing_every_leg_can_be_given_up_at_any_time() -> None:
    graph = chain([(10.0 * i, 0.0) for i in range(4)])

    def times_asked(until: float) -> int:
        asked = itertools.count(1)
        last = 0

        def cancelled() -> bool:
            nonlocal last
            last = next(asked)
            return last >= until

        with pytest.raises(CancelledError) if until < math.inf else contextlib.nullcontext():
            all_routes_announced(graph, cancelled=cancelled)
        return last

    times = times_asked(math.inf)
    for until in (1, 3, 5, times - 1):
        assert times_asked(until) == until


# ---------------------------------------------------------------------------------------------------- the command
def test_the_command_lists_prints_and_sounds_a_way(
    office_site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = tmp_path / "way.wav"
    way = ["rehearse", "--site", str(office_site), "--from", "Hall", "--to", "Wash room"]
    assert main([*way, "--json", "--wav", str(sound)]) == 0
    values = json.loads(capsys.readouterr().out)
    graph = load_poi_graph(office_site)
    ids = {poi.name: poi.id for poi in graph.pois.values()}
    done = rehearse(graph, ids["Hall"], ids["Wash room"])
    assert len(values["utterances"]) == len(done.utterances)
    assert values["utterances"][-1]["text"] == done.utterances[-1].text == "You have arrived: Wash room."
    with wave.open(str(sound)) as written:
        assert written.getnframes() / written.getframerate() >= done.utterances[-1].stamp_s
    assert main([*way, "--language", "zh"]) == 0
    assert "您已到达Wash room。" in capsys.readouterr().out
    assert main([*way, "--set", "cues.direction_style=clock"]) == 0


def test_the_command_refuses_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rehearse", "--site", str(tmp_path), "--from", "Hall", "--to", "Bar"]) == 2
    assert "There is no site at" in capsys.readouterr().err


def test_an_utterance_is_the_cue_that_is_played() -> None:
    for each in rehearse(AROUND_THE_CORNER, "p0", "p2").utterances:
        cue = each.cue
        assert (cue.kind, cue.text, cue.frequency_hz, cue.pan) == (each.kind, each.text, each.frequency_hz, each.pan)
        assert cue.is_tone == (not each.text)
        assert replace(each, text="", kind=CueKind.TICK).cue.is_tone
