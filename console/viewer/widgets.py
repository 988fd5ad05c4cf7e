"""Widgets of viser, used so that callbacks run one after the other, in the scene's loop, and only for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

Refresh = Callable[[], None]
Event = Any
"""A ``viser.GuiEvent`` of any widget."""


def on_press(button: viser.GuiButtonHandle, action: Callable[[], object], refresh: Refresh) -> None:
    """Run an action when a button is pressed, then redraw."""

    async def pressed(_: Event) -> None:
        action()
        refresh()

    button.on_click(pressed)


def on_choice(group: viser.GuiButtonGroupHandle, actions: dict[str, Callable[[], object]], refresh: Refresh) -> None:
    """Run the action of the button that was pressed in a group, then redraw; an unknown name does nothing."""

    async def pressed(event: Event) -> None:
        action = actions.get(event.target.value)
        if action is not None:
            action()
        refresh()

    group.on_click(pressed)


def on_change(widget: Any, action: Callable[[], object], refresh: Refresh) -> None:
    """Run an action when a person changes a widget (not when the program does), then redraw."""

    async def changed(event: Event) -> None:
        if event.client_id is not None:
            action()
            refresh()

    widget.on_update(changed)


def set_value(widget: Any, value: object) -> None:
    """Show a value in a widget; nothing is sent where it is there already."""
    widget.value = value


def nothing() -> None:
    """Nothing to redraw: the next tick shows it."""
