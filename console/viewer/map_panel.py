"""The map editor's part of the panel: modes, undo, the place about to be added, and what is selected."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import viser

from console.edits import SetEdge, UpdatePoi
from console.viewer import appearance as look
from console.viewer.editor import Editor, Mode
from console.viewer.widgets import Refresh, on_change, on_choice, on_press, set_value
from console.viewer.wording import card
from navcore.planning.poi_graph import Edge, Poi

_MODE_WORDS = {Mode.SELECT: "Select (1)", Mode.TAG: "Tag a place (2)", Mode.CONNECT: "Connect (3)"}
_PROPOSE, _PUBLISH, _PUBLISHED = "Join all", "Publish", "Published"

Guide = Callable[[str], None]
"""Asks to lead the walker to a place."""


class MapPanel:
    """Widgets for the editor of one client; ``refresh`` redraws scene and panel after each action.

    ``guide`` is None for who may not lead the walker.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        editor: Editor,
        refresh: Refresh,
        publish: Callable[[], None],
        guide: Guide | None,
    ) -> None:
        self._gui = client.gui
        self._editor = editor
        self._refresh = refresh
        self._hint = self._gui.add_html("")
        if editor.may_edit:
            self._add_tools(publish)
        self._tag = _TagForm(self._gui, editor, refresh) if editor.may_edit else None
        self._place = _PlaceForm(self._gui, editor, refresh, guide)
        self._connection = _ConnectionForm(self._gui, editor, refresh)

    def _add_tools(self, publish: Callable[[], None]) -> None:
        gui, editor = self._gui, self._editor
        self._modes = {
            mode: gui.add_button(word, icon=icon, hint=hint)
            for mode, word, icon, hint in (
                (Mode.SELECT, _MODE_WORDS[Mode.SELECT], viser.Icon.POINTER, "Select, drag, rename, delete"),
                (Mode.TAG, _MODE_WORDS[Mode.TAG], viser.Icon.MAP_PIN_PLUS, "Click on the road to tag a place"),
                (Mode.CONNECT, _MODE_WORDS[Mode.CONNECT], viser.Icon.ROUTE, "Click two places to connect them"),
            )
        }
        for mode, button in self._modes.items():
            self._on_press(button, partial(editor.set_mode, mode))
        self._connect = gui.add_button("Connect (Enter)", icon=viser.Icon.CHECK, color="green", visible=False)
        self._on_press(self._connect, editor.accept_edge)
        self._undo_redo = gui.add_button_group("Edits", ("Undo", "Redo"), hint="Ctrl+Z, Ctrl+Shift+Z")
        on_choice(self._undo_redo, {"Undo": editor.undo, "Redo": editor.redo}, self._refresh)
        self._more = gui.add_button_group("Map", (_PROPOSE, _PUBLISHED), hint=(
            "Join all: connect all neighbours along the road. Publish: give this map to the devices."
        ))  # fmt: skip
        on_choice(self._more, {_PROPOSE: editor.propose_edges, _PUBLISH: publish, _PUBLISHED: publish}, self._refresh)

    def _on_press(self, button: viser.GuiButtonHandle, action: Callable[[], object]) -> None:
        on_press(button, action, self._refresh)

    def accept(self) -> None:
        """Enter was pressed: take what is about to be added."""
        if self._editor.pending_edge is not None:
            self._editor.accept_edge()
        elif self._tag is not None and self._editor.pending_tag is not None:
            self._tag.add()

    def show(self, unpublished: bool) -> None:
        """Bring the widgets in line with the editor."""
        editor = self._editor
        self._hint.content = card(editor.hint)
        if editor.may_edit:
            for mode, button in self._modes.items():
                button.color = "blue" if mode is editor.mode else "gray"
            self._connect.visible = editor.pending_edge is not None
            self._more.options = (_PROPOSE, _PUBLISH if unpublished else _PUBLISHED)
        if self._tag is not None:
            self._tag.show()
        # While two places are being connected, the form of one of them would only be in the way.
        self._place.show(editor.poi if editor.pending_tag is None and editor.mode is not Mode.CONNECT else None)
        self._connection.show(editor.edge)


class _TagForm:
    """Name and kind of the place about to be added."""

    def __init__(self, gui: viser.GuiApi, editor: Editor, refresh: Refresh) -> None:
        self._editor = editor
        self._shown = False
        self._folder = gui.add_folder("New place", visible=False)
        with self._folder:
            self._name = gui.add_text("Name", "")
            self._kind = gui.add_dropdown("Kind", tuple(look.KIND_OF_WORD), initial_value="Room")
            add = gui.add_button("Add place (Enter)", icon=viser.Icon.CHECK, color="green")
            cancel = gui.add_button("Cancel (Esc)", color="gray")
        on_press(add, self.add, refresh)
        on_press(cancel, editor.escape, refresh)

    def add(self) -> None:
        """Add the place; an empty name becomes the kind."""
        name = self._name.value.strip() or self._kind.value
        if self._editor.add_pending_tag(name, look.KIND_OF_WORD[self._kind.value]):
            set_value(self._name, "")

    def show(self) -> None:
        """Show the form while a place is about to be added."""
        self._folder.visible = self._editor.pending_tag is not None


class _PlaceForm:
    """Name, spoken name and kind of the selected place."""

    def __init__(self, gui: viser.GuiApi, editor: Editor, refresh: Refresh, guide: Guide | None) -> None:
        self._editor = editor
        self._poi: Poi | None = None
        self._folder = gui.add_folder("Place", visible=False)
        locked = not editor.may_edit
        with self._folder:
            self._name = gui.add_text("Name", "", disabled=locked)
            self._kind = gui.add_dropdown("Kind", tuple(look.KIND_OF_WORD), disabled=locked)
            self._spoken = gui.add_text("Spoken", "", disabled=locked, hint="What the walker hears; empty: the name")
            if editor.may_edit:
                self._rename = gui.add_button("Apply", icon=viser.Icon.CHECK)
                on_press(self._rename, self._apply, refresh)
                delete = gui.add_button("Delete place", icon=viser.Icon.TRASH, color="red", hint="Delete")
                on_press(delete, editor.delete_selected, refresh)
            if guide is not None:
                button = gui.add_button("Guide the walker here", icon=viser.Icon.NAVIGATION, color="teal")
                on_press(button, lambda: guide(self._poi.id) if self._poi is not None else None, refresh)
        on_change(self._kind, self._apply, refresh)

    def _apply(self) -> None:
        if self._poi is None:
            return
        name, spoken = self._name.value.strip(), self._spoken.value.strip()
        kind = look.KIND_OF_WORD.get(self._kind.value)
        self._editor.update_poi(UpdatePoi(self._poi.id, name=name, kind=kind, spoken_name=spoken))
        self._poi = None

    def show(self, poi: Poi | None) -> None:
        """Show a place; what is being typed stays until another place, or another version of it, is shown."""
        self._folder.visible = poi is not None
        if poi is None:
            self._poi = None
            return
        before, self._poi = self._poi, poi
        if before is None or _naming(before) != _naming(poi):
            set_value(self._name, poi.name)
            set_value(self._kind, look.KINDS[poi.kind].word)
            set_value(self._spoken, poi.spoken_name)


def _naming(poi: Poi) -> tuple[str, ...]:
    return poi.id, poi.name, poi.kind, poi.spoken_name


class _ConnectionForm:
    """One-way, closed and cost of the selected edge."""

    def __init__(self, gui: viser.GuiApi, editor: Editor, refresh: Refresh) -> None:
        self._editor = editor
        self._edge: Edge | None = None
        self._folder = gui.add_folder("Connection", visible=False)
        locked = not editor.may_edit
        with self._folder:
            self._words = gui.add_html("")
            self._one_way = gui.add_checkbox("One way", False, disabled=locked)
            self._closed = gui.add_checkbox("Closed", False, disabled=locked)
            self._cost = gui.add_number("Cost ×", 1.0, min=1.0, max=100.0, step=0.5, disabled=locked, hint=(
                "1 is the pure distance; a higher value is avoided where there is another way"
            ))  # fmt: skip
            if editor.may_edit:
                delete = gui.add_button("Delete connection", icon=viser.Icon.TRASH, color="red", hint="Delete")
                on_press(delete, editor.delete_selected, refresh)
        for widget in (self._one_way, self._closed, self._cost):
            on_change(widget, self._apply, refresh)

    def _apply(self) -> None:
        if self._edge is None:
            return
        self._editor.set_edge(
            SetEdge(
                self._edge.id, one_way=self._one_way.value, closed=self._closed.value,
                cost_multiplier=float(self._cost.value),
            )
        )  # fmt: skip
        self._edge = None

    def show(self, edge: Edge | None) -> None:
        """Show an edge."""
        self._folder.visible = edge is not None
        if edge is None or edge == self._edge:
            self._edge = edge
            return
        self._edge = edge
        pois = self._editor.graph.pois
        a, b = pois[edge.a].name, pois[edge.b].name
        self._words.content = card(f"{a} {'→' if edge.one_way else '–'} {b}, {look.metres_text(edge.length_m)}")
        set_value(self._one_way, edge.one_way)
        set_value(self._closed, edge.closed)
        set_value(self._cost, edge.cost_multiplier)
