"""The one model behind the pages and the scene: the site, its road, and the draft of its PoI-graph.

Whoever edits (a form, a drag in the scene, a shortcut) goes through :meth:`SiteModel.apply`, and whoever shows
something reads :attr:`SiteModel.graph` and subscribes. An edit that was answered is in the log on disk.

A request may carry a key: asked again with the same one, because nobody heard the answer, it is not done twice. The key
is stored with the change, so this holds over a console that was killed between the two.

Undo is per author: it takes back one's own latest edit, and refuses (ConflictError) where somebody else has changed
the same thing since, so that nothing of theirs is lost silently.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from console.edit_conflict import EditConflictError
from console.edits import Edit, Thing, evaluate, touched
from console.errors import ConflictError, NotFoundError
from console.graph_delta import GraphDelta, apply_delta, changed_by, difference
from console.graph_log import OWN_KINDS, EntryKind, GraphLog, LogEntry, Publication, PublishedVersion, VersionName
from navcore.errors import VbrError
from navcore.planning.edits import validate
from navcore.planning.poi_graph import PoiGraph, Road
from navcore.planning.road_edits import network_of, newly_without_road, recorded_roads
from navcore.planning.road_network import RoadNetwork
from navcore.site import Site, save_poi_graph

_log = logging.getLogger(__name__)
_TRIES = 3
"""An edit that others overtake so often is worked out while they wait."""
_NETWORKS_KEPT_COUNT = 3
"""Those of the draft, of a preview, and of what an undo would make."""
UNDO_STEPS_COUNT = 500
SYSTEM = "system"
"""Author of what no person did."""


def _push(stacks: dict[str, list[LogEntry]], who: str, entry: LogEntry) -> None:
    stack = stacks.setdefault(who, [])
    stack.append(entry)
    del stack[:-UNDO_STEPS_COUNT]


@dataclass(frozen=True, slots=True)
class ModelChange:
    """What a listener is told."""

    kind: EntryKind | Literal["publish"]
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
        self._recorded = recorded_roads(site.roads_m)
        self._networks: list[tuple[dict[str, Road], RoadNetwork]] = [(self._recorded, network_of(self._recorded))]
        self._changed: dict[Thing, dict[str, LogEntry]] = {}
        self._requests: set[tuple[str, str]] = set()
        """Author and key of each request that made a change."""
        self._log = log
        self._folder = folder
        self._now_s = now_s
        self._lock = threading.RLock()
        self._listeners: list[Listener] = []
        self._undo: dict[str, list[LogEntry]] = {}
        self._redo: dict[str, list[LogEntry]] = {}
        self._graph = PoiGraph(roads=self._recorded)
        self._published = self._graph
        self._restore()

    # ------------------------------------------------------------------------------------------------ reading
    @property
    def graph(self) -> PoiGraph:
        """The draft, as it is now; immutable."""
        return self._graph

    @property
    def network(self) -> RoadNetwork:
        """The network that the draft's roads make."""
        return self._network_of(self._graph)

    @property
    def published(self) -> PoiGraph:
        """The graph that was published last."""
        return self._published

    @property
    def for_devices(self) -> PoiGraph:
        """What devices get of the published graph: they walk along edges, and need no roads."""
        return msgspec.structs.replace(self._published, roads={})

    def can_undo(self, who: str) -> bool:
        """Whether ``who`` has an edit to take back."""
        return bool(self._undo.get(who))

    def can_redo(self, who: str) -> bool:
        """Whether ``who`` has an edit to make again."""
        return bool(self._redo.get(who))

    def history(self, count: int) -> tuple[LogEntry, ...]:
        """The latest changes of the draft, newest first."""
        return tuple(self._log.newest(count))

    def last_change(self, thing: Thing) -> LogEntry | None:
        """Return the entry that changed a thing last; None where none has since the draft began."""
        entries = self._changed.get(thing, {}).values()
        return max(entries, key=lambda entry: entry.version, default=None)

    def graph_at(self, version: int) -> PoiGraph:
        """Return the draft as it was in an earlier version. Raises NotFoundError where there was none."""
        graph = PoiGraph(roads=self._recorded)
        for entry in self._log.entries(version):
            graph = apply_delta(graph, entry.delta, entry.version)
        if graph.version != version:
            raise NotFoundError(f"There is no version {version} of this map: look at the history for those that are.")
        return graph

    def named_versions(self) -> tuple[VersionName, ...]:
        """Every version that somebody gave a name, oldest name first."""
        return tuple(self._log.names())

    def publications(self) -> tuple[PublishedVersion, ...]:
        """Every version that was published, oldest first."""
        return tuple(self._log.publications())

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

    def apply(self, edit: Edit, who: str, base_version: int | None = None, request: str = "") -> PoiGraph:
        """Make an edit and return the new draft; stored before this returns.

        ``request`` is the key of the request: what it made already is not made again. ``base_version`` is the version
        that ``who`` saw when they decided on it; None is the one that is there now.
        An edit that changes nothing makes no version. Raises InputError, PlanningError, or, where somebody else has
        changed the same thing since, EditConflictError with both; then nothing is changed.
        """
        for _ in range(_TRIES):
            # An edit of a long road takes seconds, in which nobody else should have to wait.
            before = self._graph
            if self.was_made(who, request):
                return before
            after = self._evaluated(edit, who, base_version, before)
            # Whoever looks at the draft next finds its network made.
            self._network_of(after)
            with self._lock:
                if self._graph is before:
                    self._refuse_conflict(edit, who, base_version, before)
                    return self._make("edit", who, difference(before, after), edit=edit, request=request)
        with self._lock:
            if self.was_made(who, request):
                return self._graph
            after = self._evaluated(edit, who, base_version, self._graph)
            return self._make("edit", who, difference(self._graph, after), edit=edit, request=request)

    def was_made(self, who: str, request: str) -> bool:
        """Whether the change that a request with a key asks for was made before."""
        return request != "" and (who, request) in self._requests

    def _evaluated(self, edit: Edit, who: str, base_version: int | None, graph: PoiGraph) -> PoiGraph:
        self._refuse_conflict(edit, who, base_version, graph)
        return evaluate(edit, graph, self._network_of(graph))

    def replace(
        self, graph: PoiGraph, who: str, why: str = "", base_version: int | None = None, request: str = ""
    ) -> PoiGraph:
        """Put another graph in the draft's place, as one change that one undo takes back; return the new draft.

        A graph without roads lies on those that are there. Raises InputError where the graph breaks a law, and
        ConflictError where the draft is not the version ``base_version`` any more: that change would be lost.
        """
        with self._lock:
            if self.was_made(who, request):
                return self._graph
            if base_version not in (None, self._graph.version):
                raise ConflictError("The draft was changed meanwhile: look again at what would change.")
            whole = graph if graph.roads else msgspec.structs.replace(graph, roads=self._graph.roads)
            validate(whole)
            return self._make("import", who, difference(self._graph, whole), why=why, request=request)

    def roll_back(self, version: int, who: str, base_version: int | None = None, request: str = "") -> PoiGraph:
        """Make the draft what it was in an earlier version, as one change that one undo takes back; return it.

        Raises NotFoundError where there is no such version, and ConflictError where the draft is no longer of the
        ``base_version`` that was looked at: what others have done since would be gone with it, unseen.
        """
        then = self.graph_at(version)
        self._network_of(then)
        with self._lock:
            if self.was_made(who, request):
                return self._graph
            self._refuse_other_draft(base_version)
            delta = difference(self._graph, then)
            return self._make("rollback", who, delta, target_version=version, request=request)

    def name_version(self, name: str, who: str) -> VersionName:
        """Give the draft, as it is now, a name to come back to. Raises ConflictError where it is taken."""
        with self._lock:
            named = VersionName(self._graph.version, name, who, self._now_s())
            self._log.add_name(named)
            return named

    def undo(self, who: str, request: str = "") -> PoiGraph:
        """Take back the latest edit of ``who``. Raises ConflictError where there is none, or others built on it."""
        return self._step("undo", who, self._undo, self._redo, "There is nothing to undo.", request)

    def redo(self, who: str, request: str = "") -> PoiGraph:
        """Make again what ``who`` took back last. Raises ConflictError where it cannot be done."""
        return self._step("redo", who, self._redo, self._undo, "There is nothing to redo.", request)

    def _step(
        self,
        kind: Literal["undo", "redo"],
        who: str,
        source: dict[str, list[LogEntry]],
        sink: dict[str, list[LogEntry]],
        nothing: str,
        request: str,
    ) -> PoiGraph:
        self._prepare_network(kind, source.get(who))
        with self._lock:
            if self.was_made(who, request):
                return self._graph
            if not source.get(who):
                raise ConflictError(nothing)
            entry = source[who][-1]
            delta = entry.delta.inverse() if kind == "undo" else entry.delta
            try:
                self._advance(kind, who, delta, target_version=entry.version, request=request)
            except ConflictError:
                # It stays off the stack: the next call reaches what lies below it.
                source[who].pop()
                raise
            _push(sink, who, source[who].pop())
            self._tell(kind, who)
            return self._graph

    def _prepare_network(self, kind: Literal["undo", "redo"], stack: list[LogEntry] | None) -> None:
        """Work out what the roads will be before anybody has to wait for it."""
        if not stack or not stack[-1].delta.roads:
            return
        delta = stack[-1].delta.inverse() if kind == "undo" else stack[-1].delta
        with contextlib.suppress(ConflictError):
            self._network_of(apply_delta(self._graph, delta, 0))

    def publish(self, who: str, version: int | None = None) -> PoiGraph:
        """Make the draft the graph that devices are given; return it.

        Raises ConflictError where the draft is no longer of the ``version`` that was looked at.
        """
        with self._lock:
            self._refuse_other_draft(version)
            if self._published.version != self._graph.version:
                self._publish_as(who)
                self._tell("publish", who)
            return self._published

    def number_beyond(self, version: int) -> None:
        """Give the published graph, and the draft, numbers above this one: those up to it may stand for other graphs.

        So it is after a restore. A device that runs one of these is offered what is published here, and nobody's page
        takes an old draft for this one.
        """
        with self._lock:
            draft, published = self._graph, self._published
            beyond = max(version, draft.version) + 1
            self._advance(
                "rollback", SYSTEM, difference(draft, published), target_version=published.version, version=beyond
            )
            self._publish_as(SYSTEM)
            back = difference(published, draft)
            if not back.is_empty:
                self._advance("rollback", SYSTEM, back, target_version=draft.version)

    # ----------------------------------------------------------------------------------------------- internals
    def _make(
        self,
        kind: EntryKind,
        who: str,
        delta: GraphDelta,
        *,
        edit: Edit | None = None,
        target_version: int | None = None,
        why: str = "",
        request: str = "",
    ) -> PoiGraph:
        """Make a change that its author can take back."""
        if delta.is_empty:
            return self._graph
        entry = self._advance(
            kind, who, delta, edit=edit, target_version=target_version, why=why, request=request
        )  # fmt: skip
        _push(self._undo, who, entry)
        self._redo.pop(who, None)
        self._tell(kind, who)
        return self._graph

    def _advance(
        self,
        kind: EntryKind,
        who: str,
        delta: GraphDelta,
        *,
        edit: Edit | None = None,
        target_version: int | None = None,
        version: int | None = None,
        why: str = "",
        request: str = "",
    ) -> LogEntry:
        version = self._graph.version + 1 if version is None else version
        changed = apply_delta(self._graph, delta, version)
        if kind in ("undo", "redo"):
            self._refuse_off_road(changed, delta)
        entry = LogEntry(version, kind, who, self._now_s(), delta, edit, target_version, why, request)
        self._log.append(entry)
        self._take(entry, changed)
        return entry

    def _take(self, entry: LogEntry, changed: PoiGraph) -> None:
        self._graph = changed
        if entry.request:
            self._requests.add((entry.author, entry.request))
        for thing in changed_by(entry.delta):
            self._changed.setdefault(thing, {})[entry.author] = entry

    def _refuse_conflict(self, edit: Edit, who: str, base_version: int | None, graph: PoiGraph) -> None:
        if base_version is None:
            return
        for thing in touched(edit, graph):
            others = [entry for author, entry in self._changed.get(thing, {}).items() if author not in (who, SYSTEM)]
            newest = max(others, key=lambda entry: entry.version, default=None)
            if newest is None or newest.version <= base_version:
                continue
            try:
                yours: PoiGraph | None = evaluate(edit, graph, self._network_of(graph))
            except VbrError:
                yours = None
            raise EditConflictError(thing, newest, graph, yours)

    def _refuse_other_draft(self, version: int | None) -> None:
        if version is not None and version != self._graph.version:
            raise ConflictError("The draft has been changed meanwhile: look at it again first.")

    def _refuse_off_road(self, changed: PoiGraph, delta: GraphDelta) -> None:
        """What comes back, or stands where a road goes, must have its road."""
        before, after = self._network_of(self._graph), self._network_of(changed)
        pois, edges = (changed.pois, changed.edges) if delta.roads else (delta.pois, delta.edges)
        if (name := newly_without_road(self._graph, changed, before, after, pois, edges)) is not None:
            raise ConflictError(f"{name} would be left without a road, which was changed meanwhile: change it by hand.")

    def _network_of(self, graph: PoiGraph) -> RoadNetwork:
        for roads, network in self._networks:
            if roads is graph.roads or roads == graph.roads:
                return network
        network = network_of(graph.roads)
        self._networks = [(graph.roads, network), *self._networks[: _NETWORKS_KEPT_COUNT - 1]]
        return network

    def _publish_as(self, who: str) -> None:
        self._log.add_publication(Publication(self._without_recorded(self._graph), who, self._now_s()))
        self._published = self._graph
        self._write_published()

    def _write_published(self) -> None:
        if self._folder is None:
            return
        try:
            save_poi_graph(self._without_recorded(self._published), self._folder)
        except OSError as error:
            # The log holds it, and devices are given the log's: the file is a copy for other programs.
            _log.warning("The published PoI-graph could not be written to %s: %s", self._folder, error)

    def _with_recorded(self, graph: PoiGraph) -> PoiGraph:
        """A graph whose roads nobody has edited is stored without them: they are the site's."""
        return graph if graph.roads else msgspec.structs.replace(graph, roads=self._recorded)

    def _without_recorded(self, graph: PoiGraph) -> PoiGraph:
        return msgspec.structs.replace(graph, roads={}) if graph.roads == self._recorded else graph

    def _tell(self, kind: EntryKind | Literal["publish"], who: str) -> None:
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
            self._take(entry, apply_delta(self._graph, entry.delta, entry.version))
            by_version[entry.version] = entry
            self._replay_stacks(entry, by_version)
        publication = self._log.published()
        if publication is None:
            self._publish_as(SYSTEM)
        else:
            self._published = self._with_recorded(publication.graph)
        if self._without_recorded(self._published) != self.site.poi_graph:
            self._write_published()

    def _seed(self) -> None:
        version = max(1, self.site.poi_graph.version)
        seed = self._with_recorded(self.site.poi_graph)
        self._advance("seed", SYSTEM, difference(self._graph, seed), version=version)
        self._publish_as(SYSTEM)

    def _replay_stacks(self, entry: LogEntry, by_version: dict[int, LogEntry]) -> None:
        undo, redo = self._undo.setdefault(entry.author, []), self._redo.setdefault(entry.author, [])
        if entry.kind in OWN_KINDS:
            undo.append(entry)
            redo.clear()
        elif entry.target_version is not None:
            source, sink = (undo, redo) if entry.kind == "undo" else (redo, undo)
            target = by_version[entry.target_version]
            while source and source.pop() != target:
                pass
            sink.append(target)
