"""The one model behind the pages and the scene: the site, its road, and the draft of its PoI-graph.

Whoever edits (a form, a drag in the scene, a shortcut) goes through :meth:`SiteModel.apply`, and whoever shows
something reads :attr:`SiteModel.graph` and subscribes. An edit that was answered is in the log on disk.

Undo is per author: it takes back one's own latest edit, and refuses (ConflictError) where somebody else has changed
the same thing since, so that nothing of theirs is lost silently.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from console.edits import Edit, evaluate
from console.errors import ConflictError
from console.graph_delta import GraphDelta, apply_delta, difference
from console.graph_log import GraphLog, LogEntry, Publication
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_network import RoadNetwork
from navcore.site import Site, save_poi_graph

_log = logging.getLogger(__name__)
SYSTEM = "system"
"""Author of what no person did."""


@dataclass(frozen=True, slots=True)
class ModelChange:
    """What a listener is told."""

    kind: Literal["edit", "undo", "redo", "publish"]
    author: str
    graph: PoiGraph
    """The draft after the change."""
    published_version: int


Listener = Callable[[ModelChange], None]


class SiteModel:
    """Site, road network, draft, undo stacks. All methods may be called from any thread.

    ``folder`` is the site's folder, where the published graph is written to; None keeps it in the log alone.
    """

    def __init__(
        self, site: Site, log: GraphLog, folder: Path | None = None, now_s: Callable[[], float] = time.time
    ) -> None:
        self.site = site
        self.network = RoadNetwork.from_roads(site.roads_m)
        self._log = log
        self._folder = folder
        self._now_s = now_s
        self._lock = threading.RLock()
        self._listeners: list[Listener] = []
        self._undo: dict[str, list[LogEntry]] = {}
        self._redo: dict[str, list[LogEntry]] = {}
        self._graph = PoiGraph()
        self._published = PoiGraph()
        self._restore()

    # ------------------------------------------------------------------------------------------------ reading
    @property
    def graph(self) -> PoiGraph:
        """The draft, as it is now; immutable."""
        return self._graph

    @property
    def published(self) -> PoiGraph:
        """The graph that devices are given."""
        return self._published

    def can_undo(self, who: str) -> bool:
        """Whether ``who`` has an edit to take back."""
        return bool(self._undo.get(who))

    def can_redo(self, who: str) -> bool:
        """Whether ``who`` has an edit to make again."""
        return bool(self._redo.get(who))

    def history(self) -> tuple[LogEntry, ...]:
        """Every change of the draft since it began, oldest first."""
        return tuple(self._log.entries())

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Call ``listener`` after each change, in order, from whichever thread made it; return what ends that.

        The model is locked meanwhile: post the change to a queue or a loop, and return.
        """
        with self._lock:
            self._listeners.append(listener)

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return unsubscribe

    # ------------------------------------------------------------------------------------------------ editing
    def preview(self, edit: Edit) -> PoiGraph:
        """Return the graph that the edit would make, and change nothing. Raises InputError or PlanningError."""
        return evaluate(edit, self._graph, self.network)

    def apply(self, edit: Edit, who: str) -> PoiGraph:
        """Make an edit and return the new draft; stored before this returns.

        An edit that changes nothing makes no version. Raises InputError or PlanningError, and changes nothing.
        """
        with self._lock:
            delta = difference(self._graph, evaluate(edit, self._graph, self.network))
            if delta.is_empty:
                return self._graph
            entry = self._advance("edit", who, delta, edit=edit)
            self._undo.setdefault(who, []).append(entry)
            self._redo.pop(who, None)
            self._tell("edit", who)
            return self._graph

    def undo(self, who: str) -> PoiGraph:
        """Take back the latest edit of ``who``. Raises ConflictError where there is none, or others built on it."""
        with self._lock:
            entry = self._pop(self._undo, who, "There is nothing to undo.")
            self._advance("undo", who, entry.delta.inverse(), target=entry)
            self._redo.setdefault(who, []).append(entry)
            self._tell("undo", who)
            return self._graph

    def redo(self, who: str) -> PoiGraph:
        """Make again what ``who`` took back last. Raises ConflictError where it cannot be done."""
        with self._lock:
            entry = self._pop(self._redo, who, "There is nothing to redo.")
            self._advance("redo", who, entry.delta, target=entry)
            self._undo.setdefault(who, []).append(entry)
            self._tell("redo", who)
            return self._graph

    def publish(self, who: str) -> PoiGraph:
        """Make the draft the graph that devices are given; return it."""
        with self._lock:
            if self._published.version != self._graph.version:
                self._publish_as(who)
                self._tell("publish", who)
            return self._published

    # ----------------------------------------------------------------------------------------------- internals
    def _advance(
        self,
        kind: Literal["seed", "edit", "undo", "redo"],
        who: str,
        delta: GraphDelta,
        *,
        edit: Edit | None = None,
        target: LogEntry | None = None,
        version: int | None = None,
    ) -> LogEntry:
        version = self._graph.version + 1 if version is None else version
        changed = apply_delta(self._graph, delta, version)
        entry = LogEntry(version, kind, who, self._now_s(), delta, edit, target.version if target else None)
        self._log.append(entry)
        self._graph = changed
        return entry

    @staticmethod
    def _pop(stacks: dict[str, list[LogEntry]], who: str, nothing: str) -> LogEntry:
        # An entry that turns out to conflict stays off the stack: the next call reaches what lies below it.
        stack = stacks.get(who)
        if not stack:
            raise ConflictError(nothing)
        return stack.pop()

    def _publish_as(self, who: str) -> None:
        self._log.add_publication(Publication(self._graph, who, self._now_s()))
        self._published = self._graph
        self._write_published()

    def _write_published(self) -> None:
        if self._folder is None:
            return
        try:
            save_poi_graph(self._published, self._folder)
        except OSError as error:
            # The log holds it, and devices are given the log's: the file is a copy for other programs.
            _log.warning("The published PoI-graph could not be written to %s: %s", self._folder, error)

    def _tell(self, kind: Literal["edit", "undo", "redo", "publish"], who: str) -> None:
        change = ModelChange(kind, who, self._graph, self._published.version)
        for listener in tuple(self._listeners):
            try:
                listener(change)
            except Exception:
                _log.exception("A listener of the model failed; the change itself is stored.")

    # ------------------------------------------------------------------------------------------------- restart
    def _restore(self) -> None:
        entries = tuple(self._log.entries())
        if not entries:
            self._seed()
            return
        by_version: dict[int, LogEntry] = {}
        for entry in entries:
            self._graph = apply_delta(self._graph, entry.delta, entry.version)
            by_version[entry.version] = entry
            self._replay_stacks(entry, by_version)
        publication = self._log.published()
        if publication is None:
            self._publish_as(SYSTEM)
        else:
            self._published = publication.graph
        if self._published != self.site.poi_graph:
            self._write_published()

    def _seed(self) -> None:
        version = max(1, self.site.poi_graph.version)
        self._advance("seed", SYSTEM, difference(PoiGraph(), self.site.poi_graph), version=version)
        self._publish_as(SYSTEM)

    def _replay_stacks(self, entry: LogEntry, by_version: dict[int, LogEntry]) -> None:
        undo, redo = self._undo.setdefault(entry.author, []), self._redo.setdefault(entry.author, [])
        if entry.kind == "edit":
            undo.append(entry)
            redo.clear()
        elif entry.target_version is not None:
            source, sink = (undo, redo) if entry.kind == "undo" else (redo, undo)
            target = by_version[entry.target_version]
            while source and source.pop() != target:
                pass
            sink.append(target)
