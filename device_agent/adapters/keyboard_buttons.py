"""Buttons for the demo: keys of the terminal. A terminal tells no release, so a long press is the capital letter."""

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

HELP = "Buttons: m (or Enter), n, p are main, next, previous; M, N, P hold them."
KEYS: Mapping[str, tuple[Button, PressKind]] = {
    "m": (Button.MAIN, PressKind.SHORT),
    "\n": (Button.MAIN, PressKind.SHORT),
    "\r": (Button.MAIN, PressKind.SHORT),
    "M": (Button.MAIN, PressKind.LONG),
    "n": (Button.NEXT, PressKind.SHORT),
    "N": (Button.NEXT, PressKind.LONG),
    "p": (Button.PREVIOUS, PressKind.SHORT),
    "P": (Button.PREVIOUS, PressKind.LONG),
}
_MAX_READ_BYTES = 64


class KeyboardButtons:
    """The :class:`device_agent.ports.Buttons` of a terminal; it is put back as it was by :meth:`close`."""

    def __init__(self, clock: Clock, file: int | None = None) -> None:
        """Take keys as they are pressed, without Enter; Ctrl-C still interrupts. ``file`` is a terminal, or a pipe.

        Raises SensorError where there is no standard input.
        """
        self._clock = clock
        try:
            self._file = sys.stdin.fileno() if file is None else file
        except (AttributeError, OSError, ValueError) as error:
            raise SensorError("There is no keyboard to read: start the device in a terminal.") from error
        self._before = termios.tcgetattr(self._file) if os.isatty(self._file) else None
        if self._before is not None:
            tty.setcbreak(self._file, termios.TCSANOW)
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
        known = [KEYS[key] for key in data.decode("ascii", "ignore") if key in KEYS]
        now_s = self._clock.now_s()
        return tuple(ButtonPress(now_s, button, kind) for button, kind in known)

    def close(self) -> None:
        """Put the terminal back; closing twice is harmless."""
        if not self._closed and self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._file, termios.TCSANOW, self._before)
        self._closed = True
