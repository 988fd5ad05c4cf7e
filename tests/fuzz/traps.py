"""Readers with faults in them, for the test of the drivers: each must be found out."""

from __future__ import annotations

import os
from pathlib import Path

from fuzz.targets import Target
from navcore.errors import InputError


def _hoards(data: bytes, folder: Path) -> None:
    if data == b"bad":
        b"x" * (200 << 20)


def _demands(data: bytes, folder: Path) -> None:
    if data == b"bad":
        bytearray(4 << 30)


def _never_ends(data: bytes, folder: Path) -> None:
    while data == b"bad":
        pass


def _breaks(data: bytes, folder: Path) -> None:
    if data == b"bad":
        os.abort()


def _leaks(data: bytes, folder: Path) -> None:
    if data == b"bad":
        raise KeyError("x")


def _obeys(data: bytes, folder: Path) -> None:
    raise InputError("\x1b[2J is no name: choose another." if data == b"bad" else "This is no file: name another.")


TARGETS = {
    read.__name__.lstrip("_"): Target(read.__name__, "lines", read, lambda: [b"good"])
    for read in (_hoards, _demands, _never_ends, _breaks, _leaks, _obeys)
}
