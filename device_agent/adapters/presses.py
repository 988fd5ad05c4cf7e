"""From keys that go down and up to presses, short or long. Pure: times are handed in."""

from __future__ import annotations

from dataclasses import dataclass

from device_agent.ports import Button, ButtonPress, PressKind

LONG_AFTER_S = 0.7
"""Who holds a button for so long means a long press; a short one rarely takes half of it."""


@dataclass(frozen=True, slots=True)
class _Held:
    since_s: float
    told: bool = False
    """The long press has been told already, while the button was held."""


class PressTracker:
    """Remembers which buttons are held."""

    def __init__(self) -> None:
        self._held: dict[Button, _Held] = {}

    def down(self, stamp_s: float, button: Button) -> None:
        """A button goes down; one that is held already (the keyboard repeats itself) stays as it is."""
        self._held.setdefault(button, _Held(stamp_s))

    def up(self, stamp_s: float, button: Button) -> tuple[ButtonPress, ...]:
        """A button is let go: return what is still to be told of it. One that was not held tells nothing."""
        held = self._held.pop(button, None)
        if held is None or held.told:
            return ()
        kind = PressKind.LONG if stamp_s - held.since_s >= LONG_AFTER_S else PressKind.SHORT
        return (ButtonPress(stamp_s, button, kind),)

    def due(self, now_s: float) -> tuple[ButtonPress, ...]:
        """Return the long presses that have become so by now, each once."""
        due = [button for button, held in self._held.items() if not held.told and now_s - held.since_s >= LONG_AFTER_S]
        for button in due:
            self._held[button] = _Held(self._held[button].since_s, told=True)
        return tuple(ButtonPress(now_s, button, PressKind.LONG) for button in due)

    def release_all(self) -> None:
        """The buttons are gone: nothing is held any more, and nothing comes of what was."""
        self._held.clear()
