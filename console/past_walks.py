"""The walks that devices have recorded and sent: their files, put together by what the files say of themselves."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from console.errors import NotFoundError
from console.recordings import Recordings, StoredRecording
from navcore.errors import InputError
from navcore.walk_file import NS_PER_S, WalkFile, WalkPart

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class PastWalk:
    """A walk as far as it has come here."""

    walk_id: str
    device: str
    """Name of the token of the device that sent it."""
    site_id: str
    map_checksum: str
    """Of the map that it was walked in."""
    began_at_s: float
    """Unix time."""
    length_s: float
    """Time that its files cover."""
    parts: tuple[Path, ...]
    """MCAP files in order."""
    has_pictures: bool
    sha256: str
    """Checksum of its first file: what is kept about the walk is kept, and deleted, beside that."""
    size_bytes: int
    troubles: tuple[str, ...] = ()
    """What of it is missing or damaged, in sentences."""


@dataclass(frozen=True, slots=True)
class _Head:
    """What a file says of itself, and how much time it covers."""

    says: WalkPart
    length_s: float
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class _Part:
    """A file that belongs to a walk."""

    stored: StoredRecording
    head: _Head

    @property
    def walk_id(self) -> str:
        """Names the walk; a file that does not say its own is a walk by itself."""
        return self.head.says.walk_id or self.stored.entry.offer.sha256[:16]


class PastWalks:
    """The walks among the recordings. May be used from any thread."""

    def __init__(self, recordings: Recordings) -> None:
        """Nothing is read before it is asked for; a file's head is read once."""
        self.recordings = recordings
        self._heads: dict[Path, _Head] = {}

    def all(self) -> tuple[PastWalk, ...]:
        """Return every walk of which a file is here whole, the newest first."""
        walks: defaultdict[tuple[str, str], list[_Part]] = defaultdict(list)
        here = [stored for stored in self.recordings.all() if stored.entry.offer.kind == "walk" and stored.complete]
        for stored in here:
            part = _Part(stored, self._head(stored))
            walks[stored.entry.device, part.walk_id].append(part)
        # Files that were deleted are forgotten.
        self._heads = {stored.file: head for stored in here if (head := self._heads.get(stored.file)) is not None}
        # A walk between two others, in which nobody was led, is sent by hand alone; it is no walk in the list.
        found = [_walk(parts) for parts in walks.values() if any(part.head.says.is_walk for part in parts)]
        return tuple(sorted(found, key=lambda walk: (-walk.began_at_s, walk.walk_id)))

    def named(self, walk_id: str) -> PastWalk:
        """Return a walk. Raises NotFoundError."""
        for walk in self.all():
            if walk.walk_id == walk_id:
                return walk
        raise NotFoundError("There is no such walk: it was deleted, or it has not come from the device yet.")

    def _head(self, stored: StoredRecording) -> _Head:
        head = self._heads.get(stored.file)
        if head is None:
            head = self._heads[stored.file] = _read_head(stored)
        return head


def _read_head(stored: StoredRecording) -> _Head:
    try:
        file = WalkFile(stored.file)
        length_s = file.length_s()
        if length_s is not None:
            return _Head(file.part, length_s)
        covered_s = _covered_s(file)
    except InputError as error:
        _log.warning("%s", error)
        # The path of a file on this machine is nothing to people at a browser.
        why = str(error).replace(str(stored.file), "A file of this walk")
        return _Head(WalkPart.of({}), 0.0, why)
    return _Head(file.part, covered_s, f"A file ends in the middle ({file.damage or 'it was not completed'}).")


def _covered_s(file: WalkFile) -> float:
    """Return the time between the first message and the last of a file without an index."""
    first_ns = last_ns = None
    for _, message in file.messages():
        first_ns = message.log_time if first_ns is None else min(first_ns, message.log_time)
        last_ns = message.log_time if last_ns is None else max(last_ns, message.log_time)
    return 0.0 if first_ns is None or last_ns is None else (last_ns - first_ns) / NS_PER_S


def _walk(parts: list[_Part]) -> PastWalk:
    parts = sorted(parts, key=lambda part: (part.head.says.part, part.stored.entry.offered_at_s))
    first = parts[0]
    says = first.head.says
    numbers = [part.head.says.part for part in parts]
    return PastWalk(
        walk_id=first.walk_id,
        device=first.stored.entry.device,
        site_id=says.site_id,
        map_checksum=says.map_checksum,
        began_at_s=says.began_at_s or first.stored.entry.offered_at_s,
        length_s=sum(part.head.length_s for part in parts),
        parts=tuple(part.stored.file for part in parts),
        has_pictures=any(part.head.says.has_pictures for part in parts),
        sha256=first.stored.entry.offer.sha256,
        size_bytes=sum(part.stored.entry.offer.size_bytes for part in parts),
        troubles=(*_missing(numbers), *(part.head.trouble for part in parts if part.head.trouble)),
    )


def _missing(numbers: Iterable[int]) -> tuple[str, ...]:
    """Return a sentence where files are missing between the first and the last that are here."""
    here = set(numbers)
    missing = [str(number) for number in range(1, max(here)) if number not in here]
    if not missing:
        return ()
    return (f"Missing: file {', '.join(missing)} of this walk has not come from the device.",)
