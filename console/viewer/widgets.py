"""Widgets of viser, used so that callbacks run one after the other, and only for people."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import viser

Act = Callable[[Callable[[], object]], Awaitable[None]]
"""Does an action, and redraws after it."""
Event = Any
"""A ``viser.GuiEvent`` of any widget."""


def on_press(button: viser.GuiButtonHandle, action: Callable[[], object], act: Act) -> None:
    """Do an action when a button is pressed."""

    async def pressed(_: Event) -> None:
        await act(action)

    button.on_click(pressed)


def on_choice(group: viser.GuiButtonGroupHandle, actions: dict[str, Callable[[], object]], act: Act) -> None:
    """Do the action of the button that was pressed in a group; an unknown name does nothing."""

    async def pressed(event: Event) -> None:
        action = actions.get(event.target.value)
        if action is not None:
            await act(action)

    group.on_click(pressed)


def on_change(widget: Any, action: Callable[[], object], act: Act) -> None:
    """Do an action when a person changes a widget (not when the program does)."""

    async def changed(event: Event) -> None:
        if event.client_id is not None:
            await act(action)

    widget.on_update(changed)


def set_value(widget: Any, value: object) -> None:
    """Show a value in a widget; nothing is sent where it is there already."""
    widget.value = value


async def at_once(action: Callable[[], object]) -> None:
    """Do what takes no time, in the scene's loop; the next tick shows it."""
    action()
