"""Readers with faults in them, for the test of the drivers: each must be found out."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

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


def _mumbles(data: bytes, folder: Path) -> None:
    raise InputError("no" if data == b"bad" else "This is no file: name another.")


TARGETS = {
    read.__name__.lstrip("_"): SimpleNamespace(read=read, seeds=[b"good"])
    for read in (_hoards, _demands, _never_ends, _breaks, _leaks, _mumbles)
}
"""Like those of :mod:`fuzz.targets`, without all that they import."""
