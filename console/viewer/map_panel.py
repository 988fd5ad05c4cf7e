"""The map editor's part of the panel: modes, undo, what is about to be added, a conflict, who else is here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import viser

from console.viewer.begun import Drawing, Mode, NewEdges, NewPlace
from console.viewer.conflict import Conflict
from console.viewer.editor import Editor
from console.viewer.line_forms import ConnectionForm, RoadForm
from console.viewer.place_forms import Guide, NewPlaceForm, PlaceForm
from console.viewer.widgets import Act, on_change, on_choice, on_press
from console.viewer.wording import card, conflict_card, people_card

_PROPOSE, _PUBLISH, _PUBLISHED = "Propose", "Publish", "Published"


class MapPanel:
    """Widgets for the editor of one client; ``act`` does each action and redraws scene and panel after it.

    ``guide`` is None for who may not lead the walker.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        editor: Editor,
        act: Act,
        publish: Callable[[], None],
        guide: Guide | None,
    ) -> None:
        self._gui = client.gui
        self._editor = editor
        self._act = act
        self._hint = self._gui.add_html("")
        self._people = self._gui.add_html("", visible=False)
        self._conflict = _ConflictForm(self._gui, editor, act) if editor.may_edit else None
        if editor.may_edit:
            self._add_tools(publish)
        self._new_place = NewPlaceForm(self._gui, editor, act) if editor.may_edit else None
        self._place = PlaceForm(self._gui, editor, act, guide)
        self._connection = ConnectionForm(self._gui, editor, act)
        self._road = RoadForm(self._gui, editor, act)

    def _add_tools(self, publish: Callable[[], None]) -> None:
        gui, editor = self._gui, self._editor
        self._modes = {
            mode: gui.add_button(word, icon=icon, hint=hint)
            for mode, word, icon, hint in (
                (Mode.SELECT, "Select (1)", viser.Icon.POINTER, "Select, drag, rename, delete"),
                (Mode.TAG, "Tag a place (2)", viser.Icon.MAP_PIN_PLUS, "Click on the road to tag a place"),
                (Mode.CONNECT, "Connect (3)", viser.Icon.ROUTE, "Click two places to connect them"),
                (Mode.DRAW, "Draw a road (4)", viser.Icon.LINE, "Click on the floor to draw a road"),
            )
        }
        for mode, button in self._modes.items():
            self._on_press(button, partial(editor.set_mode, mode))
        self._free = gui.add_checkbox(
            "Free position", False, visible=False, hint="New places stand where you click, off the road (Shift+click)"
        )
        on_change(self._free, self._set_free, self._act)
        self._accept = gui.add_button("Accept (Enter)", icon=viser.Icon.CHECK, color="green", visible=False)
        self._on_press(self._accept, self.accept)
        self._undo_redo = gui.add_button_group("Edits", ("Undo", "Redo"), hint="Ctrl+Z, Ctrl+Shift+Z")
        on_choice(self._undo_redo, {"Undo": editor.undo, "Redo": editor.redo}, self._act)
        self._more = gui.add_button_group("Map", (_PROPOSE, _PUBLISHED), hint=(
            "Propose: connections between all neighbours along the road. Publish: give this map to the devices."
        ))  # fmt: skip
        on_choice(self._more, {_PROPOSE: editor.propose, _PUBLISH: publish, _PUBLISHED: publish}, self._act)

    def _on_press(self, button: viser.GuiButtonHandle, action: Callable[[], object]) -> None:
        on_press(button, action, self._act)

    def _set_free(self) -> None:
        self._editor.is_free = self._free.value

    def accept(self) -> None:
        """Enter was pressed: take what is about to be added."""
        match self._editor.begun:
            case NewEdges():
                self._editor.accept_edges()
            case Drawing():
                self._editor.accept_drawing()
            case NewPlace() if self._new_place is not None:
                self._new_place.add()
            case _:
                self._editor.put_down()

    def show_working(self) -> None:
        """Say that what was asked for goes on; :meth:`show` ends that."""
        self._hint.content = card("Working…")

    def show(self, unpublished: bool) -> None:
        """Bring the widgets in line with the editor."""
        editor = self._editor
        self._hint.content = card(editor.hint)
        if editor.may_edit:
            for mode, button in self._modes.items():
                button.color = "blue" if mode is editor.mode else "gray"
            self._free.visible = editor.mode is Mode.TAG and editor.begun is None
            self._accept.visible = isinstance(editor.begun, NewEdges | Drawing)
            self._more.options = (_PROPOSE, _PUBLISH if unpublished else _PUBLISHED)
        if self._conflict is not None and self._conflict.show():
            # One of the two versions was chosen: the forms show what is there now.
            self._place.forget()
            self._connection.forget()
        if self._new_place is not None:
            self._new_place.show()
        # While two places are being connected, the form of one of them would only be in the way.
        is_quiet = editor.begun is None and editor.mode is not Mode.CONNECT
        self._place.show(editor.poi if is_quiet else None)
        self._connection.show(editor.edge if is_quiet else None)
        self._road.show(editor.road if is_quiet else None)

    def show_people(self, lines: Sequence[str]) -> None:
        """Name the others who are here, and what they do."""
        self._people.visible = bool(lines)
        self._people.content = people_card(lines)


class _ConflictForm:
    """Both versions of what two people have changed, and which of them stays."""

    def __init__(self, gui: viser.GuiApi, editor: Editor, act: Act) -> None:
        self._editor = editor
        self._shown: Conflict | None = None
        self._folder = gui.add_folder("Conflict", visible=False)
        with self._folder:
            self._words = gui.add_html("")
            self._mine = gui.add_button("Use mine", color="orange")
            self._theirs = gui.add_button("Keep theirs", color="gray")
        on_press(self._mine, editor.use_mine, act)
        on_press(self._theirs, editor.keep_theirs, act)

    def show(self) -> bool:
        """Show the editor's conflict; return whether one has just been settled."""
        before, self._shown = self._shown, self._editor.conflict
        self._folder.visible = self._shown is not None
        if self._shown is not None:
            self._words.content = conflict_card(self._shown.sentence, self._shown.by, self._shown.rows)
            self._mine.visible = self._shown.can_insist
        return before is not None and self._shown is None
