"""Buttons for the demo: keys of the terminal. A terminal tells no release, so a long press has a key of its own."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Mapping

from device_agent.ports import Button, ButtonPress, Clock, PressKind
from navcore.errors import SensorError

KEYS: Mapping[str, tuple[Button, PressKind]] = {
    " ": (Button.MAIN, PressKind.SHORT),
    "m": (Button.MAIN, PressKind.SHORT),
    "\n": (Button.MAIN, PressKind.SHORT),
    "\r": (Button.MAIN, PressKind.SHORT),
    "s": (Button.MAIN, PressKind.LONG),
    "M": (Button.MAIN, PressKind.LONG),
    "\x1b[C": (Button.NEXT, PressKind.SHORT),
    "\x1b[B": (Button.NEXT, PressKind.SHORT),
    "n": (Button.NEXT, PressKind.SHORT),
    "o": (Button.NEXT, PressKind.LONG),
    "N": (Button.NEXT, PressKind.LONG),
    "\x1b[D": (Button.PREVIOUS, PressKind.SHORT),
    "\x1b[A": (Button.PREVIOUS, PressKind.SHORT),
    "p": (Button.PREVIOUS, PressKind.SHORT),
    "P": (Button.PREVIOUS, PressKind.LONG),
    "r": (Button.REPEAT, PressKind.SHORT),
    "w": (Button.REPEAT, PressKind.LONG),
    "R": (Button.REPEAT, PressKind.LONG),
}
"""What the terminal sends for a key, and what it means."""
KEY_NAMES = (
    ("space, Enter, m", "main: choose a place, and again: set off; pause, go on"),
    ("s, M", "main, held: stop; off duty"),
    ("→, ↓, n", "next place"),
    ("←, ↑, p", "previous place"),
    ("o, N", "next, held: places by name or by distance"),
    ("r", "repeat: the last sentence again"),
    ("w, R, P", "repeat (or previous), held: where am I"),
)
"""The keys as people read them."""
HELP = "\n".join(["  Keys (click into this window first):", *(f"    {keys:16} {what}" for keys, what in KEY_NAMES)])
_MAX_READ_BYTES = 64
_LONGEST_KEY = 3


class KeyboardButtons:
    """The :class:`device_agent.ports.Buttons` of a terminal; it is put back as it was by :meth:`close`."""

    def __init__(self, clock: Clock, file: int | None = None) -> None:
        """Take keys as they are pressed, without Enter; Ctrl-C still interrupts. ``file`` is a terminal, or a pipe.

        Raises SensorError where none is given and standard input is no terminal: nobody could press anything there.
        """
        self._clock = clock
        self._file = _terminal() if file is None else file
        self._before = termios.tcgetattr(self._file) if os.isatty(self._file) else None
        if self._before is not None:
            tty.setcbreak(self._file, termios.TCSANOW)
        self._rest = ""
        self._closed = False

    def pressed(self) -> tuple[ButtonPress, ...]:
        """Return what was pressed since the last call. Raises SensorError where the terminal has gone."""
        if self._closed:
            raise SensorError("The keyboard is closed: start the device again.")
        try:
            waiting = bool(select.select([self._file], [], [], 0.0)[0])
            data = os.read(self._file, _MAX_READ_BYTES) if waiting else b""
        except (OSError, ValueError) as error:
            raise SensorError("The keyboard has gone: start the device in a terminal again.") from error
        if waiting and not data:
            raise SensorError("The keyboard has gone: start the device in a terminal again.")
        known, self._rest = keys_in(self._rest + data.decode("ascii", "ignore"))
        now_s = self._clock.now_s()
        return tuple(ButtonPress(now_s, button, kind) for button, kind in known)

    def close(self) -> None:
        """Put the terminal back; closing twice is harmless."""
        if not self._closed and self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._file, termios.TCSANOW, self._before)
        self._closed = True


def _terminal() -> int:
    with contextlib.suppress(AttributeError, OSError, ValueError):
        if os.isatty(file := sys.stdin.fileno()):
            return file
    raise SensorError(
        "There is no keyboard to read, for standard input is no terminal: start the device in a terminal, or name"
        " --buttons evdev:/dev/input/event3."
    )


def keys_in(text: str) -> tuple[list[tuple[Button, PressKind]], str]:
    """Return the keys in what a terminal has sent, and the beginning of one that is not whole yet.

    An arrow is three characters. Whatever is no key of ours is left out.
    """
    found: list[tuple[Button, PressKind]] = []
    while text:
        if len(text) < _LONGEST_KEY and "\x1b[".startswith(text):
            return found, text
        key = text[:_LONGEST_KEY] if text.startswith("\x1b[") else text[0]
        if key in KEYS:
            found.append(KEYS[key])
        text = text[len(key) :]
    return found, ""
