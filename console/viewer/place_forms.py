"""The forms of places in the panel: the one about to be added, and the selected one."""

from __future__ import annotations

from collections.abc import Callable

import viser

from console.edits import AddPoi, UpdatePoi
from console.viewer import appearance as look
from console.viewer.begun import MergePlace, NewPlace
from console.viewer.editor import Editor
from console.viewer.widgets import Act, on_change, on_press, set_value
from navcore.planning.poi_graph import Poi

Guide = Callable[[str], None]
"""Asks to lead the walker to a place."""
_SPOKEN_HINT = "What the walker hears; empty: the name"


class NewPlaceForm:
    """Name, kind, spoken name and notes of the place about to be added."""

    def __init__(self, gui: viser.GuiApi, editor: Editor, act: Act) -> None:
        self._editor = editor
        self._folder = gui.add_folder("New place", visible=False)
        with self._folder:
            self._name = gui.add_text("Name", "")
            self._kind = gui.add_dropdown("Kind", tuple(look.KIND_OF_WORD), initial_value="Room")
            self._spoken = gui.add_text("Spoken", "", hint=_SPOKEN_HINT)
            self._notes = gui.add_text("Notes", "", multiline=True)
            add = gui.add_button("Add place (Enter)", icon=viser.Icon.CHECK, color="green")
            cancel = gui.add_button("Cancel (Esc)", color="gray")
        on_press(add, self.add, act)
        on_press(cancel, editor.escape, act)

    def add(self) -> None:
        """Add the place; an empty name becomes the kind."""
        begun = self._editor.begun
        if not isinstance(begun, NewPlace):
            return
        name = self._name.value.strip() or self._kind.value
        kind = look.KIND_OF_WORD.get(self._kind.value, "room")
        extra = ("", "") if begun.edge_id is not None else (self._spoken.value.strip(), self._notes.value.strip())
        if self._editor.add_place(AddPoi(name, kind, *begun.place_m, spoken_name=extra[0], notes=extra[1])):
            for widget in (self._name, self._spoken, self._notes):
                set_value(widget, "")

    def show(self) -> None:
        """Show the form while a place is about to be added; on a connection it gets its name and kind alone."""
        begun = self._editor.begun
        self._folder.visible = isinstance(begun, NewPlace)
        self._spoken.visible = self._notes.visible = isinstance(begun, NewPlace) and begun.edge_id is None


class PlaceForm:
    """The selected place. What is being typed stays, and is held against the version that it was typed over."""

    def __init__(self, gui: viser.GuiApi, editor: Editor, act: Act, guide: Guide | None) -> None:
        self._editor = editor
        self._poi: Poi | None = None
        """The place as it was filled in."""
        self._version = 0
        self._folder = gui.add_folder("Place", visible=False)
        locked = not editor.may_edit
        with self._folder:
            self._name = gui.add_text("Name", "", disabled=locked)
            self._kind = gui.add_dropdown("Kind", tuple(look.KIND_OF_WORD), disabled=locked)
            self._spoken = gui.add_text("Spoken", "", disabled=locked, hint=_SPOKEN_HINT)
            self._notes = gui.add_text("Notes", "", disabled=locked, multiline=True)
            self._free = gui.add_checkbox(
                "Off the road", False, disabled=locked, hint="Stands free where it is, and is no destination"
            )
            if editor.may_edit:
                on_press(gui.add_button("Apply", icon=viser.Icon.CHECK), self._apply, act)
                merge = gui.add_button("Merge into…", icon=viser.Icon.ARROW_MERGE, color="gray")
                on_press(merge, self._merge, act)
                delete = gui.add_button("Delete place", icon=viser.Icon.TRASH, color="red", hint="Delete")
                on_press(delete, editor.delete_selected, act)
            if guide is not None:
                button = gui.add_button("Guide the walker here", icon=viser.Icon.NAVIGATION, color="teal")
                on_press(button, lambda: guide(self._poi.id) if self._poi is not None else None, act)
        on_change(self._kind, self._apply, act)
        on_change(self._free, lambda: editor.set_on_road(not self._free.value), act)

    def _apply(self) -> None:
        poi = self._poi
        if poi is None:
            return
        name, kind, spoken, notes = self._typed()
        edit = UpdatePoi(
            poi.id, _changed(name, poi.name), look.KIND_OF_WORD.get(_changed(kind, look.KINDS[poi.kind].word) or ""),
            _changed(spoken, poi.spoken_name), _changed(notes, poi.notes),
        )  # fmt: skip
        # What was refused stays as it was typed, to be corrected.
        if self._editor.apply(edit, self._version):
            self._poi = None

    def _merge(self) -> None:
        if self._poi is not None:
            self._editor.begin(MergePlace(self._poi.id))

    def forget(self) -> None:
        """Fill in anew what is there now, whatever has been typed."""
        self._poi = None

    def show(self, poi: Poi | None) -> None:
        """Show a place; another version of it is filled in only where nothing is being typed."""
        self._folder.visible = poi is not None
        before = self._poi
        if poi is None:
            self._poi = None
            return
        if before is not None and before.id == poi.id and self._typed() != _filled(before):
            return
        self._poi, self._version = poi, self._editor.version
        for widget, value in zip((self._name, self._kind, self._spoken, self._notes), _filled(poi), strict=True):
            set_value(widget, value)
        set_value(self._free, not poi.on_road)

    def _typed(self) -> tuple[str, str, str, str]:
        return self._name.value.strip(), self._kind.value, self._spoken.value.strip(), self._notes.value.strip()


def _filled(poi: Poi) -> tuple[str, str, str, str]:
    return poi.name.strip(), look.KINDS[poi.kind].word, poi.spoken_name.strip(), poi.notes.strip()


def _changed(typed: str, filled: str) -> str | None:
    return typed if typed != filled.strip() else None
