"""The editor's second pair of hands: every click that a mouse makes, made by keys.

Keys go from thing to thing, or move a cross on the floor; Space clicks there. Where a place is selected and no click is
waited for, the arrows move the place.
"""

from __future__ import annotations

from collections.abc import Callable

from console.edits import Thing, ThingKind
from console.viewer.begun import FloorPoint, Mode
from console.viewer.editor import Editor
from console.viewer.people_layer import place_of

CameraFloor = Callable[[], tuple[FloorPoint, FloorPoint]]
"""Returns the point of the floor that the camera looks at, and the unit direction on the floor in which it looks."""


class Keyboard:
    """Aims and clicks for one editor."""

    def __init__(self, editor: Editor, camera: CameraFloor, now_s: Callable[[], float]) -> None:
        self._editor = editor
        self._camera = camera
        self._now_s = now_s
        self.cursor_m: FloorPoint | None = None
        """The cross; None while the keys have not been used."""
        self._aimed: Thing | None = None

    @property
    def aimed(self) -> Thing | None:
        """What Space would click on; None where that is the floor."""
        return self._aimed

    def forget(self) -> None:
        """The mouse is used: the cross goes."""
        self.cursor_m = self._aimed = None

    def cycle(self, kind: ThingKind, step: int) -> None:
        """Go to the next, or the previous, thing of a kind: it is selected, or aimed at while a click is waited for."""
        graph, editor = self._editor.graph, self._editor
        if kind == "poi":
            keys = sorted(graph.pois, key=lambda key: (graph.pois[key].name.casefold(), key))
        else:
            keys = list(graph.edges if kind == "edge" else graph.roads)
        if not keys:
            return
        now = self._aimed if self._waits else editor.selected
        if now is not None and now[0] == kind and now[1] in keys:
            key = keys[(keys.index(now[1]) + step) % len(keys)]
        else:
            key = keys[0 if step > 0 else -1]
        thing = (kind, key)
        if self._waits:
            self._aimed, self.cursor_m = thing, place_of(thing, graph)
        else:
            editor.select(thing)

    def arrow(self, right: float, ahead: float, step_m: float) -> None:
        """An arrow was pressed: the selected place moves, or the cross does."""
        centre, (x, y) = self._camera()
        towards = (right * y + ahead * x, -right * x + ahead * y)
        if not self._waits and self._editor.poi is not None:
            self._editor.nudge(towards, step_m, self._now_s())
            return
        here = self.cursor_m or place_of(self._editor.selected, self._editor.graph) or centre
        self._aimed = None
        self.cursor_m = here[0] + step_m * towards[0], here[1] + step_m * towards[1]

    def click(self) -> None:
        """Space was pressed: click on what is aimed at, or where the cross is; where there is none yet, show it."""
        if self._aimed is not None and not self._editor.wants_floor:
            self._editor.pick(self._aimed)
        elif self.cursor_m is not None and self._waits:
            self._editor.pick_floor(self.cursor_m)
        elif self._waits:
            self.cursor_m = place_of(self._editor.selected, self._editor.graph) or self._camera()[0]

    @property
    def _waits(self) -> bool:
        """Whether the editor waits for a click."""
        return self._editor.mode is not Mode.SELECT or self._editor.begun is not None
