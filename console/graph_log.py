"""The log of edits: from it come undo, history, audit, and the graph itself after a restart."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import Annotated, Literal, Protocol

import msgspec

from console.edits import Edit
from console.errors import ConflictError
from console.graph_delta import GraphDelta
from navcore.planning.poi_graph import PoiGraph

EntryKind = Literal["seed", "edit", "import", "rollback", "undo", "redo"]
NAME_TAKEN = "Another version has this name already: choose another one."
OWN_KINDS: frozenset[EntryKind] = frozenset({"edit", "import", "rollback"})
"""What somebody did to the draft, and can take back."""


class LogEntry(msgspec.Struct, frozen=True):
    """One change of the draft."""

    version: int
    """Version of the graph that this entry made."""
    kind: EntryKind
    author: str
    at_s: float
    """Unix time."""
    delta: GraphDelta
    edit: Edit | None = None
    """What was asked for; None where it was no edit of one thing."""
    target_version: int | None = None
    """For undo and redo, the version that the edit in question had made; for a rollback, that which it went back to."""
    why: str = ""
    """For an import: what was imported."""
    request: str = ""
    """The key of the request that asked for it, by which the same request is known when it comes again."""


class Publication(msgspec.Struct, frozen=True):
    """A graph as it was published to the devices."""

    graph: PoiGraph
    author: str
    at_s: float


class VersionName(msgspec.Struct, frozen=True):
    """A version of the draft that somebody gave a name, to come back to."""

    version: int
    name: Annotated[str, msgspec.Meta(min_length=1, max_length=80)]
    author: str
    at_s: float


class PublishedVersion(msgspec.Struct, frozen=True):
    """That a version was published, when and by whom."""

    version: int
    author: str
    at_s: float


class GraphLog(Protocol):
    """Where edits are kept. What ``append`` and ``add_publication`` have returned from survives a crash."""

    def entries(self, up_to: int | None = None) -> Iterable[LogEntry]:
        """Every entry, or those up to a version, in the order of versions."""
        ...

    def newest(self, count: int) -> Iterable[LogEntry]:
        """The latest entries, newest first."""
        ...

    def published(self) -> Publication | None:
        """The latest publication."""
        ...

    def publications(self) -> Iterable[PublishedVersion]:
        """Every publication, in the order of versions."""
        ...

    def names(self) -> Iterable[VersionName]:
        """Every name that was given to a version, oldest first."""
        ...

    def append(self, entry: LogEntry) -> None:
        """Store an entry. Raises ConflictError where its version is stored already."""
        ...

    def add_publication(self, publication: Publication) -> None:
        """Store a publication."""
        ...

    def add_name(self, name: VersionName) -> None:
        """Store a name. Raises ConflictError where it is taken."""
        ...


class MemoryGraphLog:
    """A log that lasts as long as the process: for tests and for trying things out."""

    def __init__(self) -> None:
        self._entries: list[LogEntry] = []
        self._publications: list[Publication] = []
        self._names: list[VersionName] = []
        self._lock = threading.Lock()

    def entries(self, up_to: int | None = None) -> Iterable[LogEntry]:
        """Every entry, or those up to a version, in the order of versions."""
        with self._lock:
            return tuple(entry for entry in self._entries if up_to is None or entry.version <= up_to)

    def newest(self, count: int) -> Iterable[LogEntry]:
        """The latest entries, newest first."""
        with self._lock:
            return tuple(reversed(self._entries[-count:]))

    def published(self) -> Publication | None:
        """The latest publication."""
        with self._lock:
            return self._publications[-1] if self._publications else None

    def publications(self) -> Iterable[PublishedVersion]:
        """Every publication, in the order of versions."""
        with self._lock:
            return tuple(PublishedVersion(p.graph.version, p.author, p.at_s) for p in self._publications)

    def names(self) -> Iterable[VersionName]:
        """Every name that was given to a version, oldest first."""
        with self._lock:
            return tuple(self._names)

    def append(self, entry: LogEntry) -> None:
        """Store an entry."""
        with self._lock:
            self._entries.append(entry)

    def add_publication(self, publication: Publication) -> None:
        """Store a publication."""
        with self._lock:
            self._publications.append(publication)

    def add_name(self, name: VersionName) -> None:
        """Store a name."""
        with self._lock:
            if any(known.name == name.name for known in self._names):
                raise ConflictError(NAME_TAKEN)
            self._names.append(name)
