"""Events on disk until the console has confirmed them: nothing is lost by an outage, a crash or a restart.

One SQLite file, written through to the disk (``synchronous=FULL``) by a thread of its own, so that no caller ever waits
for a disk. Sequence numbers grow by one with each event, over restarts too.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import queue
import sqlite3
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from device_agent.ports import EventKind
from navcore.errors import InputError, WireError
from navcore.wire import Event
from navcore.wire_trace import MAX_STAMP_S

MAX_EVENTS_ON_DISK = 100_000
MAX_EVENTS_IN_MEMORY = 10_000
RETRY_EVERY_S = 5.0
"""So often it is tried again to store what the disk did not take."""
_MAX_TEXT = 500
_IN_MEMORY = ":memory:"
_BEYOND_THE_DISK = 1 << 32
"""By how much a journal in memory numbers beyond what the console has: more events than any journal on disk issues
while no console hears of them, so that the one on disk later finds its own numbers passed. The wire counts to 2^53."""
MAX_AGREED_SEQUENCE = 1 << 52
"""No console is believed to have events beyond this that were not issued here: what follows them must still be numbers
that the wire takes, or no console would ever hear of this device again."""
_log = logging.getLogger(__name__)
_SCHEMA = """
CREATE TABLE IF NOT EXISTS event (
    sequence INTEGER PRIMARY KEY, stamp_s REAL NOT NULL, kind TEXT NOT NULL, text TEXT NOT NULL
) STRICT;
CREATE TABLE IF NOT EXISTS issued (
    only INTEGER PRIMARY KEY CHECK (only = 1), sequence INTEGER NOT NULL
) STRICT;
INSERT OR IGNORE INTO issued VALUES (1, 0);
CREATE TABLE IF NOT EXISTS agreed (
    only INTEGER PRIMARY KEY CHECK (only = 1), once INTEGER NOT NULL
) STRICT;
INSERT OR IGNORE INTO agreed SELECT 1, sequence > 0 FROM issued;
CREATE TABLE IF NOT EXISTS gap (
    only INTEGER PRIMARY KEY CHECK (only = 1), sequence INTEGER NOT NULL, missing_count INTEGER NOT NULL
) STRICT;
INSERT OR IGNORE INTO gap VALUES (1, 0, 0);
"""
"""``agreed`` is whether a console has ever been met; journals from before it was kept are taken to have met one.

``gap`` is the event that stands for those that were too many, and how many they are.
"""

_Occurrence = tuple[float, EventKind, str]
_Work = _Occurrence | Callable[[], None] | None


class EventJournal:
    """Takes events from any thread; gives those that are not confirmed yet, in order."""

    def __init__(
        self, path: Path | None, on_stored: Callable[[], None] = lambda: None, max_count: int = MAX_EVENTS_ON_DISK
    ) -> None:
        """Open or make the journal; a damaged one is put aside, for nobody is to wait at home for a repair.

        Without a path, events are kept in memory alone: where there is no disk, the console still hears of them.

        Of more than ``max_count`` events the oldest give way to one that says how many are missing. Raises InputError
        where the file cannot be written.
        """
        self._max_count = max_count
        self._is_on_disk = path is not None
        self.on_stored = on_stored
        """Called, in the journal's thread, when new events are safe on disk."""
        self.damaged: Path | None
        """Where a damaged journal was put on opening; None where it was sound."""
        self._lock = threading.Lock()
        self._work: queue.Queue[_Work] = queue.Queue(MAX_EVENTS_IN_MEMORY)
        self._counting = threading.Lock()
        self._missed = 0
        self._unstored: list[_Occurrence] = []
        """What the disk did not take when it was its turn: tried again with what comes next, or after a while."""
        self._confirmed = 0
        """What the console has, also where the disk did not take that it may be forgotten."""
        try:
            self._base, self.damaged = _opened(path) if path is not None else (_connected(_IN_MEMORY), None)
        except (OSError, sqlite3.Error) as error:
            raise InputError(
                f"The event journal {path} cannot be used ({error}): free the disk, or move the file away."
            ) from error
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()

    def append(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Hand over an event; returns at once. Where the disk is very far behind, it is counted as missed."""
        try:
            self._work.put_nowait((_storable_stamp_s(stamp_s), kind, _storable(text)))
        except queue.Full:
            self._count_missed(1)

    def flush(self) -> None:
        """Return when everything that was handed over before is on disk."""
        done = threading.Event()
        self._work.put(done.set)
        done.wait()

    def pending(self, after: int, limit: int = 64) -> list[Event]:
        """Return stored events with a sequence number greater than ``after`` that are not confirmed, in order."""
        after = max(after, self._confirmed)
        with self._lock:
            rows = self._base.execute(
                "SELECT sequence, stamp_s, kind, text FROM event WHERE sequence > ? ORDER BY sequence LIMIT ?",
                (after, limit),
            ).fetchall()
        return [Event(*row) for row in rows]

    def confirm(self, sequence: int) -> None:
        """Forget events up to this one: the console has stored them.

        A disk that takes nothing forgets them later; told again after a restart, the console knows their numbers.
        """
        with self._lock:
            self._confirmed = max(self._confirmed, sequence)
            with contextlib.suppress(sqlite3.OperationalError):
                self._base.execute("DELETE FROM event WHERE sequence <= ?", (self._confirmed,))

    def agree(self, last_stored: int) -> None:
        """Come to terms with a console that has this device's events up to ``last_stored``.

        What the console knows is of an earlier journal of this device where this one meets it for the first time, or
        never issued so many numbers (a disk was replaced, a damaged journal put aside, or events waited in memory
        meanwhile). What waits here is numbered after those then, so that nothing is taken for known.

        A journal on disk that is passed over for one start, with events in it that the console has stored and not yet
        confirmed, tells these twice: nothing here says that they arrived.

        Raises WireError where the console claims to have more events than any device tells.
        """
        with self._lock:
            if last_stored > max(self._issued(), MAX_AGREED_SEQUENCE):
                raise WireError("The console claims to have events that no device can have told: use another console.")
            (has_agreed,) = self._base.execute("SELECT once FROM agreed").fetchone()
            is_known = has_agreed and last_stored <= self._issued()
        if is_known:
            # This needs no room on the disk: a device whose disk is full is watched over all the same.
            self.confirm(last_stored)
            return
        with self._lock:
            with self._transaction():
                self._base.execute("DELETE FROM event WHERE sequence <= ?", (self._confirmed,))
                self._number_after(last_stored if has_agreed or self._is_on_disk else last_stored + _BEYOND_THE_DISK)
                self._base.execute("UPDATE agreed SET once = 1")
            self._confirmed = 0

    def close(self) -> None:
        """Write what was handed over, and close the file."""
        if self._thread.is_alive():
            self._work.put(None)
            self._thread.join()
            with self._lock:
                self._base.close()

    def _run(self) -> None:
        while True:
            batch: list[_Work] = []
            with contextlib.suppress(queue.Empty):
                batch.append(self._work.get(timeout=RETRY_EVERY_S if self._unstored else None))
            with contextlib.suppress(queue.Empty):
                while len(batch) < 256:
                    batch.append(self._work.get_nowait())
            self._store([work for work in batch if isinstance(work, tuple)])
            for work in batch:
                if callable(work):
                    work()
            if None in batch:
                return

    def _store(self, events: list[_Occurrence]) -> None:
        events = [*self._unstored, *events]
        if not events:
            return
        missed = self._missed
        text = f"{missed} events were too many for the disk and are missing."
        told: list[_Occurrence] = [(events[-1][0], "link", text)] if missed else []
        try:
            with self._lock, self._transaction():
                self._insert([*events, *told])
        except Exception as error:
            # A disk that is full, or fails, may not end the thread: guidance goes on, and there may be room again.
            if not self._unstored:
                _log.error("events wait in memory, for they could not be stored (%s): free the disk", error)
            self._count_missed(max(0, len(events) - MAX_EVENTS_IN_MEMORY))
            self._unstored = events[:MAX_EVENTS_IN_MEMORY]
            return
        self._count_missed(-missed)
        self._unstored = []
        self.on_stored()

    def _count_missed(self, count: int) -> None:
        with self._counting:
            self._missed += count

    def _insert(self, events: list[_Occurrence]) -> None:
        first = self._issued() + 1
        rows = [(first + index, *event) for index, event in enumerate(events)]
        self._base.executemany("INSERT INTO event VALUES (?, ?, ?, ?)", rows)
        self._base.execute("UPDATE issued SET sequence = ?", (rows[-1][0],))
        self._make_room(rows[-1][0] - self._max_count)

    def _make_room(self, last_going: int) -> None:
        """Let one event stand for all up to this number."""
        (count, stamp_s) = self._base.execute(
            "SELECT COUNT(*), MAX(stamp_s) FROM event WHERE sequence <= ?", (last_going,)
        ).fetchone()
        if not count:
            return
        # An earlier gap that is still untold goes up in this one; one that was told counts no more.
        (earlier, itself) = self._base.execute(
            "SELECT COALESCE(SUM(missing_count), 0), COUNT(*) FROM gap JOIN event USING (sequence)"
        ).fetchone()
        missing_count = count + earlier - itself
        text = f"{missing_count} events waited too long for the console and are missing here."
        self._base.execute("DELETE FROM event WHERE sequence <= ?", (last_going,))
        self._base.execute("INSERT INTO event VALUES (?, ?, 'link', ?)", (last_going, stamp_s, text))
        self._base.execute("UPDATE gap SET sequence = ?, missing_count = ?", (last_going, missing_count))

    def _number_after(self, last: int) -> None:
        """Number what waits from ``last`` + 1 on, where it is not beyond that already, and what comes next after it."""
        (first,) = self._base.execute("SELECT COALESCE(MIN(sequence), ?) FROM event", (self._issued() + 1,)).fetchone()
        shift = max(0, last + 1 - first)
        # By way of negative numbers, so that no two rows share one on the way.
        self._base.execute("UPDATE event SET sequence = -(sequence + ?)", (shift,))
        self._base.execute("UPDATE event SET sequence = -sequence")
        self._base.execute("UPDATE issued SET sequence = sequence + ?", (shift,))
        self._base.execute("UPDATE gap SET sequence = sequence + ?", (shift,))

    def _issued(self) -> int:
        return int(self._base.execute("SELECT sequence FROM issued").fetchone()[0])

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._base.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._base.execute("COMMIT")
        except BaseException:
            # A full disk may have ended the transaction already; one that stayed open would block all later ones.
            if self._base.in_transaction:
                self._base.execute("ROLLBACK")
            raise


def _opened(path: Path) -> tuple[sqlite3.Connection, Path | None]:
    """Return the journal's file, and where a damaged one was put. Raises OSError, sqlite3.Error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        return _connected(path), None
    except sqlite3.OperationalError:
        # Locked, or a disk that is full or cannot be written: nothing is wrong with the file.
        raise
    except sqlite3.DatabaseError:
        aside = next(free for count in itertools.count(1) if not (free := _damaged(path, count)).exists())
        for part in ("", "-wal", "-shm"):
            with contextlib.suppress(FileNotFoundError):
                path.with_name(path.name + part).replace(aside.with_name(aside.name + part))
        return _connected(path), aside


def _damaged(path: Path, count: int) -> Path:
    return path.with_name(f"{path.name}.damaged-{count}")


def refuse_damaged(path: Path) -> None:
    """Look whether a journal is whole, and change nothing. Raises InputError where it is not."""
    # Path.is_file raises where the folder may not be read, or the disk fails; nothing is known against the file then.
    if not os.path.isfile(path):
        return
    try:
        with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as base:
            (verdict,) = base.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.OperationalError:
        # Locked, or a disk that cannot be written: nothing is known against the file.
        return
    except sqlite3.DatabaseError as error:
        verdict = str(error)
    if verdict != "ok":
        why = " ".join(verdict.split())
        raise InputError(
            f"The event journal {path} is damaged ({why}), and events that the console has not had may be lost: run"
            " `vbr device` with --console, which puts it aside, and replace the disk if this comes again."
        )


def _connected(path: Path | str) -> sqlite3.Connection:
    base = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
    try:
        base.execute("PRAGMA journal_mode=WAL")
        base.execute("PRAGMA synchronous=FULL")
        (verdict,) = base.execute("PRAGMA quick_check(1)").fetchone()
        if verdict != "ok":
            raise sqlite3.DatabaseError(verdict)
        base.executescript(_SCHEMA)
    except sqlite3.Error:
        base.close()
        raise
    return base


def _storable_stamp_s(stamp_s: float) -> float:
    """Return a time that the wire takes: one event that no console can read would hold up all that follow."""
    return stamp_s if abs(stamp_s) <= MAX_STAMP_S else 0.0


def _storable(text: str) -> str:
    """Return the text as SQLite takes it: names of broken files may hold what is no character."""
    return text[:_MAX_TEXT].encode("utf-8", "replace").decode("utf-8")
