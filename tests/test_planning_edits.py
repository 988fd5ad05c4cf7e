"""Whatever the sequence of edits, the PoI-graph stays valid; what is refused changes nothing."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from navcore.errors import InputError
from navcore.planning import edits
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_network import RoadNetwork

CORRIDOR = np.column_stack([np.linspace(0, 20, 201), np.zeros(201)])
BRANCH = np.column_stack([np.full(81, 8.0), np.linspace(0, 8, 81)])
FAR = np.column_stack([np.linspace(0, 5, 51), np.full(51, 20.0)])
NETWORK = RoadNetwork.from_roads([CORRIDOR, BRANCH, FAR])


def graph_with(*places: tuple[str, float, float]) -> PoiGraph:
    graph = PoiGraph()
    for name, x_m, y_m in places:
        graph = edits.add_poi(graph, NETWORK, name=name, kind="other", x_m=x_m, y_m=y_m)
    return graph


class AnyEdits(RuleBasedStateMachine):
    """Random edits, good and bad."""

    def __init__(self) -> None:
        super().__init__()
        self.graph = PoiGraph()

    def attempt(self, edit) -> None:
        before = msgspec.json.encode(self.graph)
        try:
            after = edit(self.graph)
        except InputError:
            assert msgspec.json.encode(self.graph) == before
        else:
            assert after.version == self.graph.version + 1
            assert msgspec.json.encode(self.graph) == before, "a graph is never changed"
            self.graph = after

    def pick(self, data: st.DataObject, things: dict) -> str:
        return data.draw(st.sampled_from([*things, "nothing"]))

    @rule(name=st.sampled_from(["Hall", "Bar", "厕所", " ", "x" * 90]), x=st.floats(-3, 23), y=st.floats(-3, 22),
          on_road=st.booleans())  # fmt: skip
    def add_poi(self, name: str, x: float, y: float, on_road: bool) -> None:
        self.attempt(lambda g: edits.add_poi(g, NETWORK, name=name, kind="bar", x_m=x, y_m=y, on_road=on_road))

    @rule(data=st.data(), x=st.floats(-3, 23), y=st.floats(-3, 22), on_road=st.booleans())
    def move_poi(self, data: st.DataObject, x: float, y: float, on_road: bool) -> None:
        poi_id = self.pick(data, self.graph.pois)
        self.attempt(lambda g: edits.move_poi(g, NETWORK, poi_id, x, y, on_road))

    @rule(data=st.data(), name=st.sampled_from(["Lounge", ""]))
    def rename(self, data: st.DataObject, name: str) -> None:
        poi_id = self.pick(data, self.graph.pois)
        self.attempt(lambda g: edits.rename_poi(g, poi_id, name))

    @rule(data=st.data())
    def delete_poi(self, data: st.DataObject) -> None:
        poi_id = self.pick(data, self.graph.pois)
        self.attempt(lambda g: edits.delete_poi(g, poi_id))

    @rule(data=st.data())
    def add_edge(self, data: st.DataObject) -> None:
        a, b = self.pick(data, self.graph.pois), self.pick(data, self.graph.pois)
        self.attempt(lambda g: edits.add_edge(g, NETWORK, a, b))

    @rule(data=st.data(), one_way=st.booleans(), closed=st.booleans(), cost=st.sampled_from([0.5, 1.0, 3.0, None]))
    def set_edge(self, data: st.DataObject, one_way: bool, closed: bool, cost: float | None) -> None:
        edge_id = self.pick(data, self.graph.edges)
        self.attempt(lambda g: edits.set_edge(g, edge_id, one_way=one_way, closed=closed, cost_multiplier=cost))

    @rule(data=st.data())
    def delete_edge(self, data: st.DataObject) -> None:
        edge_id = self.pick(data, self.graph.edges)
        self.attempt(lambda g: edits.delete_edge(g, edge_id))

    @rule()
    def propose_edges(self) -> None:
        self.attempt(lambda g: edits.propose_edges(g, NETWORK))

    @invariant()
    def is_valid(self) -> None:
        edits.validate(self.graph)
        assert msgspec.json.decode(msgspec.json.encode(self.graph), type=PoiGraph) == self.graph


AnyEdits.TestCase.settings = settings(max_examples=25, stateful_step_count=25, deadline=None)
test_any_sequence_of_edits_keeps_the_graph_valid = AnyEdits.TestCase


def test_a_moved_poi_slides_along_the_road_and_takes_its_edges_along():
    graph = edits.propose_edges(graph_with(("A", 2, 0), ("B", 8, 6), ("C", 18, 0)), NETWORK)
    moved = edits.move_poi(graph, NETWORK, "a", 4.0, 1.0)
    assert moved.pois["a"].x_m == pytest.approx(4.0, abs=0.05)
    assert abs(moved.pois["a"].y_m) < 0.05
    lengths = {frozenset((e.a, e.b)): e.length_m for e in moved.edges.values()}
    assert lengths[frozenset(("a", "b"))] == pytest.approx(10.0, abs=0.3)
    assert lengths[frozenset(("a", "c"))] == pytest.approx(14.0, abs=0.3)


RING = RoadNetwork.from_roads([np.array([[0, 0], [20, 0], [20, 6], [0, 6], [0, 0]], dtype=float)])
IN_ITS_CORRIDOR = (0.7, "left", True)
IN_ANOTHER = (None, "none", True)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("to_m", "settings_then"),
    [
        ((12.0, 0.0), IN_ITS_CORRIDOR),  # nearer
        ((19.0, 0.0), IN_ITS_CORRIDOR),  # farther
        ((20.0, 3.0), IN_ITS_CORRIDOR),  # round the corner
        ((8.3, 0.0), IN_ITS_CORRIDOR),  # close to the other place
        ((10.0, 6.0), IN_ANOTHER),  # the other way round
        ((0.0, 1.0), IN_ANOTHER),  # past the other place
    ],
)
def test_a_moved_poi_takes_width_and_caution_along_only_in_their_corridor(to_m, settings_then, turned: bool) -> None:
    graph = PoiGraph()
    for name, x_m in (("A", 8.0), ("B", 18.0)):
        graph = edits.add_poi(graph, RING, name=name, kind="room", x_m=x_m, y_m=0.0)
    graph = edits.add_edge(graph, RING, *(("b", "a") if turned else ("a", "b")))
    graph = edits.set_edge(graph, "e1", width_m=0.7, caution_side="left", closed=True)
    edge = edits.move_poi(graph, RING, "b", *to_m).edges["e1"]
    assert (edge.width_m, edge.caution_side, edge.closed) == settings_then


def test_a_merged_poi_takes_width_and_caution_along_only_in_their_corridor() -> None:
    graph = PoiGraph()
    for name, x_m, y_m in (("A", 8, 0), ("B", 18, 0), ("B again", 17, 0), ("D", 4, 6)):
        graph = edits.add_poi(graph, RING, name=name, kind="room", x_m=x_m, y_m=y_m)
    graph = edits.set_edge(edits.add_edge(graph, RING, "b", "a"), "e1", width_m=0.7, caution_side="left")
    for other, width_m in (("b-again", 0.7), ("d", None)):
        assert edits.merge_pois(graph, RING, other, "b").edges["e1"].width_m == width_m


def test_proposed_edges_join_neighbours_only():
    graph = edits.propose_edges(
        graph_with(("A", 2, 0), ("J", 8, 0), ("B", 8, 6), ("C", 18, 0), ("Far", 2, 20)), NETWORK
    )
    pairs = {frozenset((e.a, e.b)) for e in graph.edges.values()}
    assert pairs == {frozenset(("a", "j")), frozenset(("j", "b")), frozenset(("j", "c"))}
    with pytest.raises(InputError, match="joined already"):
        edits.propose_edges(graph, NETWORK)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda g: edits.add_poi(g, NETWORK, name="Z", kind="bar", x_m=3, y_m=5), "from the road"),
        (lambda g: edits.add_poi(g, NETWORK, name="Z", kind="bar", x_m=3, y_m=0, poi_id="a"), "already"),
        (lambda g: edits.add_poi(g, NETWORK, name="Z", kind="cave", x_m=3, y_m=0), "kind of place"),
        (lambda g: edits.add_edge(g, NETWORK, "a", "a"), "different places"),
        (lambda g: edits.add_edge(g, NETWORK, "a", "nobody"), "no place"),
        (lambda g: edits.add_edge(g, NETWORK, "a", "far"), "No road leads"),
        (lambda g: edits.add_edge(edits.add_edge(g, NETWORK, "a", "c"), NETWORK, "c", "a"), "joined already"),
        (lambda g: edits.delete_edge(g, "e9"), "no edge"),
    ],
)
def test_what_is_refused_says_why(edit, words: str):
    graph = graph_with(("A", 2, 0), ("C", 18, 0), ("Far", 2, 20))
    with pytest.raises(InputError, match=words):
        edit(graph)


def test_validate_finds_what_an_import_may_bring():
    graph = edits.propose_edges(graph_with(("A", 2, 0), ("C", 18, 0)), NETWORK)
    edge = graph.edges["e1"]
    for broken in (
        msgspec.structs.replace(edge, length_m=3.0),
        msgspec.structs.replace(edge, b="nobody"),
        msgspec.structs.replace(edge, path_m=edge.path_m[:1]),
        msgspec.structs.replace(edge, id="other"),
    ):
        with pytest.raises(InputError):
            edits.validate(msgspec.structs.replace(graph, edges={"e1": broken}))
