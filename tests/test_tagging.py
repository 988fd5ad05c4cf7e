"""Named places become PoIs where the recording person stood."""

import numpy as np
import pytest

from navcore.planning.edits import validate
from navcore.planning.road_network import RoadNetwork
from navcore.recording import Mark
from navcore.tagging import graph_from_marks, lost_marks


def test_named_places_become_a_joined_graph() -> None:
    stamps = np.arange(0.0, 10.0, 0.1)
    positions = np.stack([stamps, np.zeros_like(stamps), np.full_like(stamps, 1.6)], axis=1)
    network = RoadNetwork.from_roads([positions])
    marks = [
        Mark(1.0, "hall", "Hall"),
        Mark(5.0, "bar", "Bar"),
        Mark(9.0, "room", "Room"),
        Mark(50.0, "exit", "Nowhere"),
    ]
    graph = graph_from_marks(marks, stamps, positions, network)
    validate(graph)
    assert [(poi.name, poi.kind) for poi in graph.pois.values()] == [("Hall", "hall"), ("Bar", "bar"), ("Room", "room")]
    assert [poi.x_m for poi in graph.pois.values()] == pytest.approx([1.0, 5.0, 9.0], abs=0.06)
    assert sorted(edge.length_m for edge in graph.edges.values()) == pytest.approx([4.0, 4.0], abs=0.1)
    assert graph.version == 1


def test_junctions_are_places_so_that_edges_do_not_lie_upon_each_other() -> None:
    """A T: the junction that was named half a metre aside is put where the roads meet."""
    along = np.stack([np.arange(0.0, 10.05, 0.1), np.zeros(101)], axis=1)
    side = np.stack([np.full(51, 5.0), np.arange(0.0, 5.05, 0.1)], axis=1)
    network = RoadNetwork.from_roads([along, side])
    stamps = np.arange(101.0)
    ends = [Mark(1.0, "hall", "West"), Mark(99.0, "bar", "East")]
    graph = graph_from_marks(ends, stamps, along, network)
    assert {poi.name for poi in graph.pois.values()} == {"West", "East", "Junction 1"}
    assert len(graph.edges) == 2
    named = graph_from_marks([*ends, Mark(56.0, "junction", "T")], stamps, along, network)
    assert {poi.name for poi in named.pois.values()} == {"West", "East", "T"}
    junction = next(poi for poi in named.pois.values() if poi.name == "T")
    assert junction.x_m == pytest.approx(5.0, abs=0.15)
    assert len(named.edges) == 2


def test_what_was_marked_off_the_road_or_while_the_place_was_lost_is_left_out_and_named() -> None:
    """The end of the walk is no road: it was too short, and lies apart."""
    stamps = np.arange(0.0, 10.0, 0.1)
    positions = np.stack([stamps, np.zeros_like(stamps)], axis=1)
    positions[90:, 1] = 5.0
    network = RoadNetwork.from_roads([positions[:90]])
    marks = [Mark(1.0, "other", "Place 1"), Mark(9.5, "other", "Place 2"), Mark(50.0, "other", "Place 3")]
    graph = graph_from_marks(marks, stamps, positions, network)
    assert [poi.name for poi in graph.pois.values()] == ["Place 1"]
    assert lost_marks(marks, stamps, positions, network) == ("Place 2", "Place 3")
    nothing = np.zeros(0), np.zeros((0, 2))
    assert lost_marks(marks[:1], *nothing, network) == ("Place 1",)
