"""The keys of the scene: one table, which the shortcuts and the help are made from.

Plain arrows turn viser's camera; the scene's page gives them to the editor instead, and leaves Alt+arrows to the camera
(:mod:`console.viewer.page`). Viser knows no question mark: the page makes an H of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from viser._messages import HotkeyKey, KeyModifier

Action = Literal[
    "select", "tag", "connect", "draw", "propose", "publish", "accept", "escape", "take_back", "delete", "undo", "redo",
    "next_place", "previous_place", "next_connection", "previous_connection", "next_road", "previous_road", "pick",
    "up", "down", "left", "right", "far_up", "far_down", "far_left", "far_right", "overview", "above", "follow", "help",
]  # fmt: skip
ARROWS: dict[str, tuple[float, float, float]] = {
    f"{far}{name}": (right, ahead, step_m)
    for far, step_m in (("", 0.1), ("far_", 1.0))
    for name, right, ahead in (("up", 0.0, 1.0), ("down", 0.0, -1.0), ("left", -1.0, 0.0), ("right", 1.0, 0.0))
}
"""Actions of the arrows: to the right, ahead (as the camera looks), and how far in metres."""


@dataclass(frozen=True, slots=True)
class Shortcut:
    """A command of the scene, and its key."""

    action: Action
    words: str
    group: str
    key: HotkeyKey | None = None
    modifier: KeyModifier | None = None
    is_editing: bool = True
    """Whether it is for those who may edit."""
    together: str = ""
    """What the help says of this and the others that say the same; empty: the words."""

    @property
    def keys(self) -> str:
        """The keys in words, as ``Ctrl+Shift+Z``."""
        assert self.key is not None
        modifiers = [_MODIFIERS[part] for part in self.modifier.split("+")] if self.modifier else []
        return "+".join([*modifiers, _KEYS.get(self.key, self.key.capitalize())])


_MODIFIERS = {"cmd/ctrl": "Ctrl", "alt": "Alt", "shift": "Shift"}
_KEYS = {
    "escape": "Esc", "H": "? or H", **dict.fromkeys(("arrowup", "arrowdown", "arrowleft", "arrowright"), "Arrows"),
}  # fmt: skip
_MODES, _CHANGE, _KEYBOARD, _VIEW = "Modes", "Change", "Without the mouse", "View"

_ARROW_KEYS: tuple[tuple[Action, Action, str, HotkeyKey], ...] = (
    ("up", "far_up", "ahead", "arrowup"), ("down", "far_down", "back", "arrowdown"),
    ("left", "far_left", "to the left", "arrowleft"), ("right", "far_right", "to the right", "arrowright"),
)  # fmt: skip


def _steps(near: Action, far: Action) -> tuple[tuple[Action, str, KeyModifier | None], ...]:
    return (near, "0.1 m", None), (far, "1 m", "shift")


SHORTCUTS: tuple[Shortcut, ...] = (
    Shortcut("select", "Select and move", _MODES, "1"),
    Shortcut("tag", "Tag a place", _MODES, "2"),
    Shortcut("connect", "Connect two places", _MODES, "3"),
    Shortcut("draw", "Draw a road", _MODES, "4"),
    Shortcut("accept", "Accept what is shown", _CHANGE, "enter"),
    Shortcut("escape", "Let go of what was begun", _CHANGE, "escape", is_editing=False),
    Shortcut("take_back", "Take the last point back", _CHANGE, "backspace"),
    Shortcut("delete", "Delete what is selected", _CHANGE, "delete"),
    Shortcut("undo", "Undo", _CHANGE, "Z", "cmd/ctrl"),
    Shortcut("redo", "Redo", _CHANGE, "Z", "cmd/ctrl+shift"),
    Shortcut("propose", "Propose connections between neighbours", _CHANGE, "J"),
    Shortcut("publish", "Publish the map", _CHANGE),
    Shortcut("next_place", "Next place", _KEYBOARD, "N", is_editing=False, together="Next, previous place"),
    Shortcut(
        "previous_place", "Previous place", _KEYBOARD, "N", "shift", is_editing=False, together="Next, previous place"
    ),
    Shortcut(
        "next_connection", "Next connection", _KEYBOARD, "C", is_editing=False, together="Next, previous connection"
    ),
    Shortcut(
        "previous_connection",
        "Previous connection",
        _KEYBOARD,
        "C",
        "shift",
        is_editing=False,
        together="Next, previous connection",
    ),
    Shortcut("next_road", "Next road", _KEYBOARD, "R", is_editing=False, together="Next, previous road"),
    Shortcut(
        "previous_road", "Previous road", _KEYBOARD, "R", "shift", is_editing=False, together="Next, previous road"
    ),
    Shortcut("pick", "Click where the cross is", _KEYBOARD, "space"),
    *(
        Shortcut(
            action,
            f"Move {metres} {where}",
            _KEYBOARD,
            key,
            modifier,
            together=f"Move the selected place, or the cross, by {metres}",
        )
        for near, far, where, key in _ARROW_KEYS
        for action, metres, modifier in _steps(near, far)
    ),
    Shortcut("overview", "Overview", _VIEW, "O", is_editing=False),
    Shortcut("above", "From above", _VIEW, "P", is_editing=False),
    Shortcut("follow", "Follow the walker", _VIEW, "F", is_editing=False),
    Shortcut("help", "Show the keys", _VIEW, "H", is_editing=False),
)
_MOUSE: tuple[tuple[str, str], ...] = (
    ("Click", "Select; in a mode, what its hint says"),
    ("Shift+Click", "Put a new place off the road"),
    ("Drag a place", "Move it, its connections follow"),
    ("Drag the floor", "Turn the view; with the right button, shift it"),
    ("Alt+arrows, W A S D Q E", "Turn and move the camera"),
    ("Ctrl+K", "All commands, by name; also Publish"),
)


def help_groups(may_edit: bool) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return what the help lists: groups of keys and what they do."""
    groups: dict[str, dict[str, list[str]]] = {}
    for each in SHORTCUTS:
        if each.key is None or (each.is_editing and not may_edit):
            continue
        rows, words = groups.setdefault(each.group, {}), each.together or each.words
        if each.keys not in rows.setdefault(words, []):
            rows[words].append(each.keys)
    keyed = [(group, [(", ".join(keys), words) for words, keys in rows.items()]) for group, rows in groups.items()]
    return [*keyed, ("Mouse and camera", list(_MOUSE))]
