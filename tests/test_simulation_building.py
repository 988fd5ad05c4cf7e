"""The simulated office floor: its ways, its places, and what stands in them."""

from __future__ import annotations

import itertools
import math

import networkx as nx
import numpy as np
import pytest

from device_agent.simulation.building import Building, push_from_solids, touchable
from device_agent.simulation.obstacles import carton, hanging_box, low_box, walking_person
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.picture import floor_plan, plan_view
from device_agent.simulation.shapes import Solid
from device_agent.simulation.walk import plan_walk
from navcore.errors import InputError
from navcore.planning.poi_graph import POI_KINDS


def road_graph(building: Building) -> nx.DiGraph:
    graph = nx.DiGraph()
    for a, b in itertools.pairwise(building.road_waypoints):
        graph.add_edge(a, b, weight=math.dist(a, b))
    return graph


def shortest(building: Building, begin: str, end: str) -> list[tuple[float, float]]:
    a, b = building.place(begin), building.place(end)
    return nx.shortest_path(road_graph(building), (a.x_m, a.y_m), (b.x_m, b.y_m), weight="weight")


def test_every_place_is_on_the_road_and_of_a_known_kind(office: Building) -> None:
    assert set(office.places) >= {"Hall", "Wash room", "Bar", "Lounge", "Room 3308", "Room 3311", "H", "I", "J", "K"}
    for place in office.places.values():
        assert place.kind in POI_KINDS
        assert (place.x_m, place.y_m) in office.road_waypoints


def test_the_walk_covers_every_piece_of_road_in_both_directions(office: Building) -> None:
    walked = set(itertools.pairwise(office.road_waypoints))
    assert walked == {(b, a) for a, b in walked}
    assert office.road_waypoints[0] == office.road_waypoints[-1]


def test_the_papers_example_route_is_the_shortest(office: Building) -> None:
    corners = {(place.x_m, place.y_m): name for name, place in office.places.items()}
    passed = [corners[point] for point in shortest(office, "Bar", "Room 3311") if point in corners]
    assert passed == ["Bar", "J", "I", "K", "H", "Room 3311"]


@pytest.mark.parametrize(("begin", "end"), [("Hall", "Wash room"), ("Lounge", "Bar"), ("Room 3308", "Wash room")])
def test_the_experiments_paths_are_of_useful_length_and_turn(office: Building, begin: str, end: str) -> None:
    points = np.array(shortest(office, begin, end))
    steps = np.diff(points, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert 12.0 <= np.hypot(*steps.T).sum() <= 25.0
    assert np.count_nonzero(np.abs(np.diff(headings)) > math.pi / 6) >= 2


def test_nothing_stands_in_the_way(office: Building) -> None:
    solids = touchable(office.solids)
    for x_m, y_m in plan_walk(office.road_waypoints, seed=1).position_m[::20]:
        assert push_from_solids(solids, x_m, y_m)[0] > 0.5


def test_every_surface_is_flat(office: Building) -> None:
    for surface in office.surfaces:
        corners = np.array(surface.corners)
        assert np.abs((corners - corners[0]) @ np.array(surface.normal)).max() < 1e-6, surface


def test_no_two_posters_are_the_same(office: Building) -> None:
    """The same name on two walls would be the same picture: places could be taken for one another."""
    walls = [
        s.texture for s in office.surfaces if s.texture.startswith(("poster/", "notice/")) and abs(s.normal[2]) < 0.5
    ]
    assert len(walls) > 40
    assert len(set(walls)) == len(walls)


def test_obstacles_are_seen_and_touched_at_their_heights(office: Building) -> None:
    building = office_floor([carton(9.0, 6.0), low_box(10.0, 6.0), hanging_box(11.0, 6.0, low_m=1.4)])
    before, after = touchable(office.solids), touchable(building.solids)
    assert len(after.centre_m) == len(before.centre_m) + 3
    assert len(building.surfaces) > len(office.surfaces)
    overhead = touchable((Solid("lintel", 0.0, 0.0, 1.0, 1.0, 0.0, 2.1, 2.7), Solid("mat", 0, 0, 1, 1, 0.0, 0.0, 0.01)))
    assert len(overhead.centre_m) == 0


def test_push_points_out_of_a_turned_box() -> None:
    solids = touchable((Solid("box", 1.0, 2.0, 0.5, 0.2, math.radians(30)),))
    for angle in np.linspace(0, math.tau, 24, endpoint=False):
        for reach in (0.05, 0.6, 1.5):
            x_m, y_m = 1.0 + reach * math.cos(angle), 2.0 + reach * math.sin(angle)
            distance, away = push_from_solids(solids, x_m, y_m)
            moved, _ = push_from_solids(solids, *(np.array([x_m, y_m]) + (0.3 - distance) * away))
            assert moved == pytest.approx(0.3, abs=0.13 if distance < 0 else 1e-9)


def test_a_person_walks_there_and_back() -> None:
    mover = walking_person(((0.0, 0.0), (4.0, 0.0), (4.0, 2.0)), speed_mps=1.0, start_s=1.0)
    placements = [mover.placement_at(t) for t in (0.0, 3.0, 6.0, 8.0, 13.0)]
    assert np.allclose([(p.x_m, p.y_m) for p in placements], [(0, 0), (2, 0), (4, 1), (4, 1), (0, 0)])
    assert placements[1].yaw_rad == pytest.approx(0.0)
    assert abs(placements[3].yaw_rad) == pytest.approx(math.pi / 2)


def test_an_unknown_place_is_named(office: Building) -> None:
    with pytest.raises(InputError, match="Swimming pool"):
        office.place("Swimming pool")


def test_floor_plan_shows_trajectories(office: Building) -> None:
    line = np.array([[7.0, 6.0], [15.0, 6.0]])
    plain, drawn = floor_plan(office), floor_plan(office, {"blind": [line]})
    column, row = plan_view(office).pixels(np.array([[11.0, 6.0]]))[0]
    assert plain.shape == drawn.shape
    assert not np.array_equal(plain[round(row), round(column)], drawn[round(row), round(column)])
