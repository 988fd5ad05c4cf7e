"""What the console keeps of walkers is deleted after some days, for good.

Each store that keeps something of them offers ``delete_before(wall_s) -> int``, and raises UndeletedError for what it
could not delete: that is shown on the page Privacy, and tried again an hour later. The map, recordings of map walks
(which show a building, and who walked there to record it), and accounts are not deleted here.

A clock that leaps ahead deletes nothing by that: see :mod:`navcore.clock_trust`.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import msgspec
from sqlalchemy.exc import OperationalError

from console.errors import BadRequestError
from console.store import Store
from console.tables import KeptValueRow
from navcore.clock_trust import ClockTrust, looked_at
from navcore.errors import VbrError

DEFAULT_DAYS = 7
MIN_DAYS, MAX_DAYS = 1, 365
EVERY_S = 3600.0
_DAY_S = 86_400.0
_KEPT_AS, _CLOCK_KEPT_AS = "retention_days", "retention_clock"
_LEAPT = (
    "The clock of the console's machine shows {shown}, and by all that is known it is not later than {trusted} yet."
    " Until it has gone on evenly for a day, things are deleted by the earlier of the two. If the clock is right, an"
    " admin may choose Delete now."
)
_log = logging.getLogger(__name__)

DeleteBefore = Callable[[float], int]


class UndeletedError(VbrError):
    """Something that is too old could not be deleted; all the rest has been. ``deleted`` counts that."""

    def __init__(self, sentence: str, deleted: int) -> None:
        super().__init__(sentence)
        self.deleted = deleted


@dataclass(frozen=True, slots=True)
class RetentionRun:
    """What was deleted last, and what could not be."""

    at_s: float
    """Unix time."""
    before_s: float
    """Unix time: what is older goes."""
    deleted: Mapping[str, int]
    """How much of each kind."""
    problems: tuple[str, ...]
    """Each says what is still there, and what to do."""


class Retention:
    """Deletes what is too old. All methods may be called from any thread."""

    def __init__(
        self,
        store: Store,
        kinds: Mapping[str, DeleteBefore],
        steady_s: Callable[[], float] = lambda: time.clock_gettime(time.CLOCK_BOOTTIME),
        note: Callable[[str, str, str], None] | None = None,
    ) -> None:
        """``kinds`` tells how each kind of thing is deleted, by its name for people; what lies in files comes first.

        ``steady_s`` is a clock that nobody sets, and that goes on while the machine sleeps. ``note`` writes down who
        had things deleted; by default in the database, at once.
        """
        self._store, self._kinds, self._steady_s = store, kinds, steady_s
        self._note = note or store.audit
        self._clock: ClockTrust | None = None
        """As it was looked at last: it may be that it could not be written."""
        self._looked_s: float | None = None
        self._running = threading.Lock()
        self.last_run: RetentionRun | None = None
        """None before the first."""

    @property
    def days(self) -> int:
        """How long things are kept."""
        with self._store.reading() as session:
            row = session.get(KeptValueRow, _KEPT_AS)
        return DEFAULT_DAYS if row is None else min(MAX_DAYS, max(MIN_DAYS, int(json.loads(row.value_json))))

    def keep_for(self, days: int, by: str) -> None:
        """Keep things for so long from now on, and delete at once what is older. Raises BadRequestError."""
        if not MIN_DAYS <= days <= MAX_DAYS:
            raise BadRequestError(f"Things cannot be kept for {days} days: give {MIN_DAYS} to {MAX_DAYS}.")
        before = self.days

        def write() -> None:
            with self._store.writing() as session:
                session.merge(KeptValueRow(name=_KEPT_AS, value_json=json.dumps(days)))
                self._store.add_audit(session, by, "retention", f"{before} → {days} days")

        self._store.urgently(write)
        self.run()

    def delete_now(self, by: str) -> RetentionRun:
        """Delete what is too old by this machine's clock, because somebody asks for it."""
        now_s = self._store.wall_s()
        self._clock = ClockTrust(now_s, now_s)
        # Deleting comes first: it makes the room to write it down.
        run = self.run()
        self._note(by, "retention_run", f"older than {self.days} days")
        return run

    def run(self) -> RetentionRun:
        """Delete what is too old; what cannot be deleted is said, and hinders nothing else."""
        with self._running:
            clock = self._look_at_clock()
            now_s, before_s = clock.shown_s, clock.trusted_s - self.days * _DAY_S
            deleted, problems = dict[str, int](), _said_of(clock)
            for kind, delete_before in self._kinds.items():
                try:
                    deleted[kind] = self._store.urgently(partial(delete_before, before_s))
                except UndeletedError as error:
                    deleted[kind] = error.deleted
                    problems.append(f"{kind}: {error}")
                except Exception as error:
                    # Whatever is wrong with one kind, the others go.
                    _log.exception("%s could not be deleted", kind)
                    problems.append(f"{kind}: {error or type(error).__name__}")
            problems += self._wipe()
            self._store.see_to_room()
            for problem in problems:
                _log.warning("Not deleted: %s", problem)
            self.last_run = RetentionRun(now_s, before_s, deleted, tuple(problems))
            return self.last_run

    def _look_at_clock(self) -> ClockTrust:
        now_s, steady_s = self._store.wall_s(), self._steady_s()
        passed_s = None if self._looked_s is None else steady_s - self._looked_s
        self._looked_s = steady_s
        before = self._clock or _kept_clock(self._store)
        self._clock = ClockTrust(now_s, now_s) if before is None else looked_at(before, now_s, passed_s)
        try:
            _keep_clock(self._store, self._clock)
        except OperationalError as error:
            # Nothing is kept longer for that: what is deleted now makes room.
            _log.warning("How far the clock is trusted is not written down: %s", error.orig)
        return self._clock

    def _wipe(self) -> list[str]:
        """Wipe the traces of what was deleted, at each run: an earlier one may have been hindered, or cut off."""
        try:
            if self._store.forget_deleted():
                return []
        except Exception as error:
            _log.exception("the database's log could not be emptied")
            return [f"Traces of what was deleted are wiped at the next run: {error or type(error).__name__}."]
        return ["The database is being read: traces of what was deleted are wiped at the next run."]


def believe_clock(store: Store) -> None:
    """Take the time for what the machine's clock shows: somebody has looked at it, or a restore begins with it."""
    now_s = store.wall_s()
    _keep_clock(store, ClockTrust(now_s, now_s))


def _kept_clock(store: Store) -> ClockTrust | None:
    with store.reading() as session:
        row = session.get(KeptValueRow, _CLOCK_KEPT_AS)
    return None if row is None else msgspec.json.decode(row.value_json, type=ClockTrust)


def _keep_clock(store: Store, clock: ClockTrust) -> None:
    with store.writing() as session:
        session.merge(KeptValueRow(name=_CLOCK_KEPT_AS, value_json=msgspec.json.encode(clock).decode()))


def _said_of(clock: ClockTrust) -> list[str]:
    if clock.even_for_s is None:
        return []
    return [_LEAPT.format(shown=_date(clock.shown_s), trusted=_date(clock.trusted_s))]


def _date(unix_s: float) -> str:
    try:
        return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(unix_s))
    except (OverflowError, ValueError, OSError):
        return "no date that there is"
