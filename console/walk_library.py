"""Past walks, read: timelines of those that are looked at, and what is kept of every walk for lists, tables and maps.

A walk is read once for what is kept of it, by a thread that works while there is something to read, one walk after the
other; the result lies beside the walk's first file. Timelines are kept in memory, a few of them.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict, deque

import msgspec

from console.errors import ConsoleError, NotFoundError
from console.past_walks import PastWalk, PastWalks
from console.walk_figures import FOUND_VERSION, WalkFound, found_in
from console.walk_reading import read_walk
from console.walk_timeline import WalkTimeline
from navcore.errors import VbrError

TIMELINES_KEPT_COUNT = 3
"""Of an hour each: about 60 MB in all."""
KEPT_AS = "figures"
_log = logging.getLogger(__name__)


class WalkLibrary:
    """Reads walks and remembers what it has read. May be used from any thread."""

    def __init__(self, walks: PastWalks) -> None:
        """Nothing is read before it is asked for."""
        self.walks = walks
        self._timelines: OrderedDict[PastWalk, WalkTimeline] = OrderedDict()
        self._reading = threading.Lock()
        """One walk is read at a time, whoever asks: the live stream needs the processor as well."""
        self._changed = threading.Condition()
        self._waiting: deque[PastWalk] = deque()
        self._working = False
        self._found: dict[PastWalk, WalkFound | str] = {}
        """What is kept of a walk, or why it cannot be read."""

    def timeline(self, walk: PastWalk) -> WalkTimeline:
        """Return a walk's timeline; reads its files where it is not known. Raises NotFoundError."""
        with self._reading:
            known = self._timelines.pop(walk, None)
            timeline = self._timelines[walk] = known or read_walk(walk)
            while len(self._timelines) > TIMELINES_KEPT_COUNT:
                self._timelines.popitem(last=False)
            return timeline

    def found(self, walk: PastWalk) -> WalkFound | None:
        """Return what is kept of a walk; None where it is still being read, or cannot be (:meth:`trouble`)."""
        with self._changed:
            known = self._found.get(walk)
            if known is None and (kept := self._kept(walk)) is not None:
                known = self._found[walk] = kept
            if known is None and walk not in self._waiting:
                self._waiting.append(walk)
                self._begin_work()
            return known if isinstance(known, WalkFound) else None

    def trouble(self, walk: PastWalk) -> str:
        """Return why a walk cannot be read; empty where it can, or where that is not known yet."""
        known = self._found.get(walk)
        return known if isinstance(known, str) else ""

    def wait(self, timeout_s: float) -> bool:
        """Wait until nothing is being read; return whether that is so."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._working, timeout_s)

    def forget_deleted(self, walks: tuple[PastWalk, ...]) -> None:
        """Forget everything about walks that are not among these."""
        here = set(walks)
        with self._changed:
            self._found = {walk: found for walk, found in self._found.items() if walk in here}
        with self._reading:
            for walk in [walk for walk in self._timelines if walk not in here]:
                del self._timelines[walk]

    # ------------------------------------------------------------------------------------------------- beside
    def _begin_work(self) -> None:
        if not self._working:
            self._working = True
            threading.Thread(target=self._work, name="walk-reading", daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._changed:
                if not self._waiting:
                    self._working = False
                    self._changed.notify_all()
                    return
                walk = self._waiting[0]
            found = self._read(walk)
            with self._changed:
                if all(part.exists() for part in walk.parts):
                    # One that was deleted meanwhile has been forgotten already.
                    self._found[walk] = found
                self._waiting.popleft()

    def _read(self, walk: PastWalk) -> WalkFound | str:
        """Return what is kept of a walk, and keep it; or why it cannot be read."""
        try:
            with self._reading:
                # It is not put among those that are looked at: there they would push each other out.
                timeline = self._timelines.get(walk) or read_walk(walk)
            found = found_in(timeline)
        except ConsoleError as error:
            return str(error)
        except Exception:
            _log.exception("the walk %s could not be read", walk.walk_id)
            return "This walk could not be read: the console's log says why."
        try:
            self.walks.recordings.keep_beside(walk.sha256, KEPT_AS, msgspec.json.encode(found))
        except VbrError as error:
            # It is found anew at the next start.
            _log.warning("what was found in %s is not kept: %s", walk.walk_id, error)
        return found

    def _kept(self, walk: PastWalk) -> WalkFound | None:
        try:
            data = self.walks.recordings.companion(walk.sha256, KEPT_AS).read_bytes()
            found = msgspec.json.decode(data, type=WalkFound)
        except (OSError, ValueError, RecursionError, msgspec.MsgspecError):
            # There is none yet, or it is of another version: the walk is read.
            return None
        is_this = found.version == FOUND_VERSION and found.parts == tuple(path.name for path in walk.parts)
        return found if is_this else None


def walks_named(library: WalkLibrary, walk_ids: list[str]) -> list[PastWalk]:
    """Return walks by their ids. Raises NotFoundError at the first that is not there."""
    here = {walk.walk_id: walk for walk in library.walks.all()}
    for walk_id in walk_ids:
        if walk_id not in here:
            raise NotFoundError("There is no such walk: it was deleted, or it has not come from the device yet.")
    return [here[walk_id] for walk_id in walk_ids]
