"""Several named files in one run of bytes, so that whatever spoils bytes spoils folders and archives too.

::

    === calib.txt
    fx 60.0
    === rgb/1.jpg
    …
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

_HEAD = re.compile(rb"(?:^|\n)=== ([^\n]{0,200})\n")
_PLAIN_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*(/[A-Za-z0-9_][A-Za-z0-9_.-]*)?")


def bundled(files: Mapping[str, bytes]) -> bytes:
    """Return files as one run of bytes."""
    return bundled_list(list(files.items()))


def bundled_list(files: list[tuple[str, bytes]]) -> bytes:
    """Return files as one run of bytes; a name may stand several times."""
    return b"\n".join(b"=== " + os.fsencode(name.replace("\n", "")) + b"\n" + content for name, content in files)


def unbundled(data: bytes) -> list[tuple[str, bytes]]:
    """Return the files, in order; a name may stand several times, and be any text."""
    pieces = _HEAD.split(data)
    names = (name.decode("utf-8", "surrogateescape") for name in pieces[1::2])
    return list(zip(names, pieces[2::2], strict=True))


def write_bundle(data: bytes, folder: Path) -> None:
    """Write the files below a new folder; those whose names leave it, or are in each other's way, are left out."""
    folder.mkdir()
    for name, content in unbundled(data):
        path = folder / name
        if _PLAIN_NAME.fullmatch(name) is None or path.is_dir() or path.parent.is_file():
            continue
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
