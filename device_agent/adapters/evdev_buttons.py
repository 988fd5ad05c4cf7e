"""Buttons as Linux sees them: the key events of an input device (gpio-keys, a headset's remote, a keyboard).

``/dev/input/event*`` delivers the kernel's ``struct input_event``: two longs of time, then type, code and value
(``linux/input.h``; codes in ``linux/input-event-codes.h``). It is read as it is: the package evdev has no wheels. A
named pipe to which another program writes such events is taken as well.
"""

from __future__ import annotations

import contextlib
import fcntl
import math
import os
import select
import stat
import struct
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from device_agent.adapters.presses import PressTracker
from device_agent.adapters.reopening import backoff_s
from device_agent.ports import Button, ButtonPress, Clock
from navcore.errors import SensorError

INPUT_EVENT = struct.Struct("@llHHi")
"""Time in s and µs, type, code, value; 24 bytes on 64-bit machines."""
EVIOCSCLOCKID = 0x400445A0
"""Sets the clock of an input device (``linux/input.h``)."""
EVIOCGBIT_KEY_BYTES = 96
EVIOCGBIT_KEY = 0x80000000 | EVIOCGBIT_KEY_BYTES << 16 | 0x4521
"""Asks an input device which keys it has: a bit for each code up to KEY_MAX (``linux/input.h``)."""
EV_SYN, EV_KEY = 0, 1
SYN_DROPPED = 3
RELEASED, PRESSED = 0, 1
KEY_BUTTONS: Mapping[int, Button] = {
    28: Button.MAIN,  # KEY_ENTER
    164: Button.MAIN,  # KEY_PLAYPAUSE
    0x100: Button.MAIN,  # BTN_0
    106: Button.NEXT,  # KEY_RIGHT
    115: Button.NEXT,  # KEY_VOLUMEUP
    163: Button.NEXT,  # KEY_NEXTSONG
    0x101: Button.NEXT,  # BTN_1
    105: Button.PREVIOUS,  # KEY_LEFT
    114: Button.PREVIOUS,  # KEY_VOLUMEDOWN
    165: Button.PREVIOUS,  # KEY_PREVIOUSSONG
    0x102: Button.PREVIOUS,  # BTN_2
    439: Button.REPEAT,  # KEY_MEDIA_REPEAT
    0x103: Button.REPEAT,  # BTN_3
}
_MAX_READ_EVENTS = 64
_MAX_READS = 16
"""More than a thousand events between two looks are no fingers."""


@dataclass(frozen=True, slots=True)
class KeyEvent:
    """A key has gone down or up."""

    stamp_s: float
    """The kernel's own time, seconds; only differences mean something."""
    code: int
    value: int


class EvdevButtons:
    """The :class:`device_agent.ports.Buttons` of an input device; unplugged and plugged in again, it goes on."""

    def __init__(self, path: str, clock: Clock, key_buttons: Mapping[int, Button] = KEY_BUTTONS) -> None:
        """Raises SensorError where there is no such device, it has none of these keys, or it may not be read."""
        self._path = path
        self._clock = clock
        self._key_buttons = key_buttons
        self._tracker = PressTracker()
        self._rest = b""
        self._behind_s = math.inf
        """How far the kernel's times are behind the device's clock: the least that was ever seen."""
        self._failure_count = 0
        self._retry_s = clock.now_s()
        self._closed = False
        self._file: int | None = self._opened()

    def pressed(self) -> tuple[ButtonPress, ...]:
        """Return what was pressed since the last call. Raises SensorError while the device is gone."""
        if self._closed:
            raise SensorError("The buttons are closed: start the device again.")
        file = self._reopened() if self._file is None else self._file
        try:
            events = list(self._events(file))
        except OSError as error:
            raise self._lost() from error
        # How long a button was held is told by the kernel's times alone: the loop may look late.
        now_s = self._clock.now_s()
        self._behind_s = min([self._behind_s, *(now_s - event.stamp_s for event in events)])
        presses = [press for event in events for press in self._taken(event)]
        presses += self._tracker.due(now_s - self._behind_s)
        return tuple(replace(press, stamp_s=min(press.stamp_s + self._behind_s, now_s)) for press in presses)

    def close(self) -> None:
        """Let go of the device; closing twice is harmless."""
        self._closed = True
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _events(self, file: int) -> Iterator[KeyEvent]:
        for _ in range(_MAX_READS):
            if not select.select([file], [], [], 0.0)[0]:
                return
            data = os.read(file, _MAX_READ_EVENTS * INPUT_EVENT.size)
            if not data:
                raise OSError("the device has ended")
            self._rest += data
            whole = len(self._rest) // INPUT_EVENT.size * INPUT_EVENT.size
            data, self._rest = self._rest[:whole], self._rest[whole:]
            for seconds, microseconds, kind, code, value in INPUT_EVENT.iter_unpack(data):
                if kind == EV_SYN and code == SYN_DROPPED:
                    # The kernel has lost events, perhaps that a button was let go: better no press than a false one.
                    self._tracker.release_all()
                elif kind == EV_KEY:
                    yield KeyEvent(seconds + 1e-6 * microseconds, code, value)

    def _taken(self, event: KeyEvent) -> tuple[ButtonPress, ...]:
        button = self._key_buttons.get(event.code)
        if button is None or event.value not in (PRESSED, RELEASED):
            return ()
        if event.value == RELEASED:
            return self._tracker.up(event.stamp_s, button)
        self._tracker.down(event.stamp_s, button)
        return ()

    def _opened(self) -> int:
        try:
            file = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except FileNotFoundError as error:
            raise SensorError(f"There are no buttons at {self._path}: plug them in, or name another device.") from error
        except OSError as error:
            raise SensorError(
                f"The buttons at {self._path} cannot be read ({error.strerror}): add the user to the group 'input'."
            ) from error
        try:
            self._refuse_without_buttons(file)
        except SensorError:
            os.close(file)
            raise
        with contextlib.suppress(OSError):
            # Events are stamped with the time of day otherwise, which leaps when somebody sets it.
            fcntl.ioctl(file, EVIOCSCLOCKID, struct.pack("@i", time.CLOCK_MONOTONIC))
        return file

    def _refuse_without_buttons(self, file: int) -> None:
        """Raise SensorError for what will never tell of a press: the walker would press in vain."""
        if stat.S_ISFIFO(os.fstat(file).st_mode):
            return
        keys = bytearray(EVIOCGBIT_KEY_BYTES)
        try:
            fcntl.ioctl(file, EVIOCGBIT_KEY, keys)
        except OSError as error:
            raise SensorError(
                f"{self._path} is no input device: name one of /dev/input/event*, as `cat /proc/bus/input/devices`"
                " lists them."
            ) from error
        if not has_any_key(keys, self._key_buttons):
            raise SensorError(
                f"{self._path} has no key that could be a button: name another one of /dev/input/event*"
                " (docs/hardware.md)."
            )

    def _reopened(self) -> int:
        if self._clock.now_s() < self._retry_s:
            raise SensorError(f"The buttons at {self._path} are gone: plug them in again.")
        try:
            self._file = self._opened()
        except SensorError:
            self._failed()
            raise
        self._failure_count = 0
        return self._file

    def _lost(self) -> SensorError:
        if self._file is not None:
            os.close(self._file)
        self._file, self._rest, self._behind_s = None, b"", math.inf
        self._tracker.release_all()
        self._failed()
        return SensorError(f"The buttons at {self._path} are gone: plug them in again.")

    def _failed(self) -> None:
        self._failure_count += 1
        self._retry_s = self._clock.now_s() + backoff_s(self._failure_count)


def has_any_key(bits: bytes | bytearray, codes: Iterable[int]) -> bool:
    """Return whether a device whose keys are these bits (bit 0 of byte 0 is code 0) has a key of one of the codes."""
    return any(code // 8 < len(bits) and bits[code // 8] >> code % 8 & 1 for code in codes)
