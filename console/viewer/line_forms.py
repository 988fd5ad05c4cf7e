"""The forms of the selected connection and the selected road in the panel."""

from __future__ import annotations

import itertools
import math
from typing import TypeVar, get_args

import viser

from console.edits import SetEdge, SmoothRoad
from console.viewer import appearance as look
from console.viewer.begun import CutRoad, JoinedRoad, PlaceOnEdge, TrimmedRoad, name_of
from console.viewer.editor import Editor
from console.viewer.widgets import Act, on_change, on_choice, on_press, set_value
from console.viewer.wording import card
from navcore.planning.poi_graph import CAUTION_SIDES, CautionSide, Edge, Road

T = TypeVar("T")
_PLACE_ON_IT, _TURN = "Place on it", "Turn around"
_SIDES: dict[str, CautionSide] = {side: side for side in get_args(CautionSide)}
_ORIGINS = {"recorded": "recorded by a walk", "drawn": "drawn by hand: nobody has walked it yet"}


class ConnectionForm:
    """How the selected edge may be walked."""

    def __init__(self, gui: viser.GuiApi, editor: Editor, act: Act) -> None:
        self._editor = editor
        self._edge: Edge | None = None
        self._version = 0
        self._folder = gui.add_folder("Connection", visible=False)
        locked = not editor.may_edit
        with self._folder:
            self._words = gui.add_html("")
            self._one_way = gui.add_checkbox("One way", False, disabled=locked)
            self._closed = gui.add_checkbox("Closed", False, disabled=locked)
            self._cost = gui.add_number("Cost ×", 1.0, min=1.0, max=100.0, step=0.5, disabled=locked, hint=(
                "1 is the pure distance; a higher value is avoided where there is another way"
            ))  # fmt: skip
            self._width = gui.add_number(
                "Width m", 0.0, min=0.0, max=50.0, step=0.05, disabled=locked, hint="Free width; 0: not measured"
            )
            self._caution = gui.add_dropdown("Caution", CAUTION_SIDES, disabled=locked, hint=(
                "On which side, walking from the first place to the second, something asks for caution"
            ))  # fmt: skip
            if editor.may_edit:
                more = gui.add_button_group("Edge", (_PLACE_ON_IT, _TURN), hint=(
                    "A new place on this connection; or lead it the other way"
                ))  # fmt: skip
                on_choice(more, {_PLACE_ON_IT: self._place_on_it, _TURN: self._turn}, act)
                delete = gui.add_button("Delete connection", icon=viser.Icon.TRASH, color="red", hint="Delete")
                on_press(delete, editor.delete_selected, act)
        for widget in (self._one_way, self._closed, self._cost, self._width, self._caution):
            on_change(widget, self._apply, act)

    def _apply(self) -> None:
        edge = self._edge
        if edge is None:
            return
        wanted = SetEdge(
            edge.id,
            _other(self._one_way.value, edge.one_way),
            _other(self._closed.value, edge.closed),
            _other(float(self._cost.value), edge.cost_multiplier),
            _other(float(self._width.value), edge.width_m or 0.0),
            _other(_SIDES.get(self._caution.value, edge.caution_side), edge.caution_side),
        )
        self._editor.apply(wanted, self._version)
        self._edge = None

    def _turn(self) -> None:
        if self._edge is not None:
            self._editor.apply(SetEdge(self._edge.id, turned=True), self._version)

    def _place_on_it(self) -> None:
        if self._edge is not None:
            self._editor.begin(PlaceOnEdge(self._edge.id))

    def forget(self) -> None:
        """Fill in anew what is there now."""
        self._edge = None

    def show(self, edge: Edge | None) -> None:
        """Show an edge."""
        self._folder.visible = edge is not None
        if edge is None:
            self._edge = None
            return
        graph = self._editor.graph
        a, b = name_of(graph, edge.a), name_of(graph, edge.b)
        self._words.content = card(f"{a} {'→' if edge.one_way else '–'} {b}, {look.metres_text(edge.length_m)}")
        if edge == self._edge:
            return
        self._edge, self._version = edge, self._editor.version
        set_value(self._one_way, edge.one_way)
        set_value(self._closed, edge.closed)
        set_value(self._cost, edge.cost_multiplier)
        set_value(self._width, edge.width_m or 0.0)
        set_value(self._caution, edge.caution_side)


class RoadForm:
    """What the selected road is, and what can be done to it."""

    def __init__(self, gui: viser.GuiApi, editor: Editor, act: Act) -> None:
        self._editor = editor
        self._road: Road | None = None
        self._version = 0
        self._folder = gui.add_folder("Road", visible=False)
        with self._folder:
            self._words = gui.add_html("")
            if editor.may_edit:
                smooth, split, trim, join = "Smooth", "Split here", "Trim", "Join"
                lines = gui.add_button_group("Line", (smooth, trim), hint=(
                    "Smooth: take the sway out. Trim: keep what lies between two clicks."
                ))  # fmt: skip
                on_choice(lines, {smooth: self._smooth, trim: self._trim}, act)
                parts = gui.add_button_group("Parts", (split, join), hint=(
                    "Split here: click where it is cut in two. Join: click the other road."
                ))  # fmt: skip
                on_choice(parts, {split: self._split, join: self._join}, act)
                delete = gui.add_button("Delete road", icon=viser.Icon.TRASH, color="red", hint="Delete")
                on_press(delete, editor.delete_selected, act)

    def _smooth(self) -> None:
        if self._road is not None:
            self._editor.apply(SmoothRoad(self._road.id), self._version)

    def _trim(self) -> None:
        if self._road is not None:
            self._editor.begin(TrimmedRoad(self._road.id))

    def _split(self) -> None:
        if self._road is not None:
            self._editor.begin(CutRoad(self._road.id))

    def _join(self) -> None:
        if self._road is not None:
            self._editor.begin(JoinedRoad(self._road.id))

    def show(self, road: Road | None) -> None:
        """Show a road."""
        self._folder.visible = road is not None
        if road is not None and road is not self._road:
            self._version = self._editor.version
            self._words.content = card(f"{look.metres_text(length_of(road))}, {_ORIGINS[road.origin]}")
        self._road = road


def length_of(road: Road) -> float:
    """Return the length of a road in metres."""
    return sum(itertools.starmap(math.dist, itertools.pairwise(road.points_m)))


def _other(given: T, known: T) -> T | None:
    return given if given != known else None
