"""What the kernel knows of its clocks: how long the machine has been up, and whether the network told it the time."""

from __future__ import annotations

import ctypes
import time

_UNSYNCHRONISED_US = 16_000_000
"""The largest error that the kernel tells of (NTP_PHASE_LIMIT): nobody keeps the clock."""
_ERROR = -1


class _Timex(ctypes.Structure):
    """The beginning of ``struct timex``, with room for the rest; adjtimex(2)."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("rest", ctypes.c_char * 256),
    )


def since_boot_s() -> float:
    """Return the seconds since the machine began, its sleep among them: a clock that nobody sets."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def clock_is_synchronised() -> bool | None:
    """Tell whether the network, or a receiver, keeps the clock; None where the kernel does not say.

    As ``timedatectl`` has it (NTPSynchronized). Whoever sets the clock by hand ends that.
    """
    asked = _Timex()
    try:
        state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(asked))
    except (OSError, AttributeError):
        return None
    return None if state == _ERROR else asked.maxerror < _UNSYNCHRONISED_US
