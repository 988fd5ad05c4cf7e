"""What viser's client, one built page, was made of: as the lock file that viser's wheel carries beside it names it.

The page holds no list of its own. The lock file names more than is in it (what builds the page as well), never less.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from locked import LockError

CARRIER = "viser"
_LOCK = "client/package-lock.json"
_FOLDER = "node_modules/"


@dataclass(frozen=True, order=True)
class ClientPackage:
    """A package of npm."""

    name: str
    version: str
    licence: str
    """In its own words, empty where it has none."""
    sha512: str
    """Of its file, in hexadecimal digits."""


def client_packages(lock: Path | None = None) -> list[ClientPackage]:
    """Return what the client was made of, by name; what is only for its developers or one system's tools is left out.

    Raises LockError where the lock file is gone or says something else than it used to.
    """
    path = lock or Path(str(metadata.distribution(CARRIER).locate_file(f"{CARRIER}/{_LOCK}")))
    try:
        named = json.loads(path.read_text(encoding="utf-8"))["packages"]
        used = {place: each for place, each in named.items() if place and not (each.get("dev") or each.get("optional"))}
        return sorted({_package(place, each) for place, each in used.items()})
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LockError(f"What {CARRIER}'s client is made of cannot be read in {path}: {error!r}.") from error


def _package(place: str, entry: dict[str, str]) -> ClientPackage:
    algorithm, _, digest = entry["integrity"].partition("-")
    if algorithm != "sha512":
        raise ValueError(f"{place} has no SHA-512")
    name = place.rpartition(_FOLDER)[2]
    return ClientPackage(name, entry["version"], entry.get("license", ""), base64.b64decode(digest).hex())
