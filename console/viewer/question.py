"""A question before something is done: a dialog of one window with two answers."""

from __future__ import annotations

from collections.abc import Callable

import viser

from console.viewer.widgets import at_once, on_press
from console.viewer.wording import card


class Question:
    """One dialog at a time: a new question takes the place of one that nobody has answered."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._close: Callable[[], None] | None = None

    def ask(self, title: str, sentence: str, *, yes: str, no: str, action: Callable[[], object]) -> None:
        """Do ``action`` once somebody presses ``yes``; nothing where they press ``no``, or close it."""
        self.close()
        modal = self._gui.add_modal(title)
        self._close = modal.close

        def accept() -> None:
            self.close()
            action()

        with modal:
            self._gui.add_html(card(sentence))
            on_press(self._gui.add_button(yes), accept, at_once)
            on_press(self._gui.add_button(no, color="gray"), self.close, at_once)

    def close(self) -> bool:
        """Take the question away; return whether there was one."""
        close, self._close = self._close, None
        if close is not None:
            close()
        return close is not None
