"""The log of edits: from it come undo, history, audit, and the graph itself after a restart."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import Literal, Protocol

import msgspec

from console.edits import Edit
from console.graph_delta import GraphDelta
from navcore.planning.poi_graph import PoiGraph


class LogEntry(msgspec.Struct, frozen=True):
    """One change of the draft."""

    version: int
    """Version of the graph that this entry made."""
    kind: Literal["seed", "edit", "undo", "redo"]
    author: str
    at_s: float
    """Unix time."""
    delta: GraphDelta
    edit: Edit | None = None
    """What was asked for; None for undo and redo."""
    target_version: int | None = None
    """For undo and redo: the version that the edit in question had made."""


class Publication(msgspec.Struct, frozen=True):
    """A graph as it was published to the devices."""

    graph: PoiGraph
    author: str
    at_s: float


class GraphLog(Protocol):
    """Where edits are kept. What ``append`` and ``add_publication`` have returned from survives a crash."""

    def entries(self) -> Iterable[LogEntry]:
        """Every entry, in the order of versions."""
        ...

    def published(self) -> Publication | None:
        """The latest publication."""
        ...

    def append(self, entry: LogEntry) -> None:
        """Store an entry. Raises ConflictError where its version is stored already."""
        ...

    def add_publication(self, publication: Publication) -> None:
        """Store a publication."""
        ...


class MemoryGraphLog:
    """A log that lasts as long as the process: for tests and for trying things out."""

    def __init__(self) -> None:
        self._entries: list[LogEntry] = []
        self._publications: list[Publication] = []
        self._lock = threading.Lock()

    def entries(self) -> Iterable[LogEntry]:
        """Every entry, in the order of versions."""
        with self._lock:
            return tuple(self._entries)

    def published(self) -> Publication | None:
        """The latest publication."""
        with self._lock:
            return self._publications[-1] if self._publications else None

    def append(self, entry: LogEntry) -> None:
        """Store an entry."""
        with self._lock:
            self._entries.append(entry)

    def add_publication(self, publication: Publication) -> None:
        """Store a publication."""
        with self._lock:
            self._publications.append(publication)
