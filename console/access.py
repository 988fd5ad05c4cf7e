"""Who has watched a walker, and who has looked at what is kept of them: a log that the walker can hear.

Whatever shows somebody what was kept of a walker calls :meth:`AccessLog.note`; live watching is followed by
:mod:`console.watching`. Each device is told its part at each joining and at each change.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal, cast

from sqlalchemy import delete, or_, select, update

from console.store import Store
from console.tables import AccessRow
from navcore.wire import MAX_ACCESSES_COUNT, Access, Accesses

What = Literal["watch", "past_walk", "incident", "colour", "export"]
SAME_WATCH_S = 300.0
"""Who comes back within so long has watched once."""
SAME_LOOK_S = 60.0
"""Who looks at the same thing within so long has looked once: a page asks for it in pieces."""
_DETAIL_LENGTH = 200
_NAME_LENGTH = 120


@dataclass(frozen=True, slots=True)
class LoggedAccess:
    """One line of the log."""

    id: int
    who: str
    what: What
    device_id: str
    detail: str
    about_s: float | None
    began_at_s: float
    ended_at_s: float


class AccessLog:
    """The log in the database. All methods may be called from any thread."""

    def __init__(
        self, store: Store, utc_offset_s: Callable[[float], float] = lambda unix_s: time.localtime(unix_s).tm_gmtoff
    ) -> None:
        """``utc_offset_s`` tells what the clocks on the wall show more than UTC, at a Unix time."""
        self._store = store
        self._utc_offset_s = utc_offset_s
        self.on_changed: Callable[[str], None] = _nobody
        """Called with the device that an entry is about (empty: every one) after it was stored."""

    def note(self, who: str, what: What, device_id: str = "", detail: str = "", about_s: float | None = None) -> None:
        """Write down that somebody has looked at something just now.

        Args:
            who: name of the person.
            what: what they did.
            device_id: the walker's device; empty for what concerns every walker.
            detail: what exactly, for the page.
            about_s: when the walk or incident was (Unix time), where it is known.
        """
        now_s = self._store.wall_s()
        same = (
            AccessRow.who == who, AccessRow.what == what, AccessRow.device_id == device_id,
            AccessRow.detail == detail[:_DETAIL_LENGTH], AccessRow.ended_at_s >= now_s - SAME_LOOK_S,
        )  # fmt: skip
        with self._store.writing() as session:
            row = session.scalar(select(AccessRow).where(*same).limit(1))
            if row is not None:
                row.ended_at_s = now_s
                return
            session.add(
                AccessRow(
                    who=who,
                    what=what,
                    device_id=device_id,
                    detail=detail[:_DETAIL_LENGTH],
                    about_s=about_s,
                    began_at_s=now_s,
                    ended_at_s=now_s,
                )
            )
        self.on_changed(device_id)

    def watch_begins(self, who: str, device_id: str) -> int:
        """Write down that somebody has begun to watch; return the number of the entry."""
        now_s = self._store.wall_s()
        lately = (
            AccessRow.who == who, AccessRow.what == "watch", AccessRow.device_id == device_id,
            AccessRow.ended_at_s >= now_s - SAME_WATCH_S,
        )  # fmt: skip
        with self._store.writing() as session:
            row = session.scalar(select(AccessRow).where(*lately).order_by(AccessRow.id.desc()).limit(1))
            if row is None:
                row = AccessRow(who=who, what="watch", device_id=device_id, detail="", about_s=None, began_at_s=now_s)
                session.add(row)
            row.ended_at_s = now_s
            session.flush()
            number = row.id
        self.on_changed(device_id)
        return number

    def watches_go_on(self, numbers: Collection[int]) -> None:
        """Write down that people have watched until now, all in one step; ``numbers`` are those of their entries."""
        with self._store.writing() as session:
            session.execute(update(AccessRow).where(AccessRow.id.in_(numbers)).values(ended_at_s=self._store.wall_s()))

    def watch_ends(self, number: int, device_id: str) -> None:
        """Write down that somebody has watched a device until now, and watches no more."""
        self.watches_go_on((number,))
        self.on_changed(device_id)

    def latest(self, count: int) -> list[LoggedAccess]:
        """Return the last entries, newest first."""
        with self._store.reading() as session:
            rows = session.scalars(select(AccessRow).order_by(AccessRow.ended_at_s.desc(), AccessRow.id).limit(count))
            return [_logged(row) for row in rows]

    def told_to(self, device_id: str) -> Accesses:
        """Return what a device is told: the last entries about it, or about every one."""
        mine = or_(AccessRow.device_id == device_id, AccessRow.device_id == "")
        ordered = select(AccessRow).where(mine).order_by(AccessRow.ended_at_s.desc(), AccessRow.id)
        with self._store.reading() as session:
            rows = [_logged(row) for row in session.scalars(ordered.limit(MAX_ACCESSES_COUNT))]
        now_s = self._store.wall_s()
        entries = tuple(
            Access(row.who[:_NAME_LENGTH], row.what, row.began_at_s, row.ended_at_s, row.about_s)
            for row in reversed(rows)
        )
        return Accesses(entries, now_s, self._utc_offset_s(now_s))

    def delete_before(self, wall_s: float) -> int:
        """Delete the entries that ended before a Unix time; return how many there were."""
        old = AccessRow.ended_at_s < wall_s
        with self._store.writing() as session:
            numbers = session.scalars(select(AccessRow.id).where(old)).all()
            session.execute(delete(AccessRow).where(old))
        if numbers:
            self.on_changed("")
        return len(numbers)


def _logged(row: AccessRow) -> LoggedAccess:
    return LoggedAccess(
        row.id, row.who, cast("What", row.what), row.device_id, row.detail, row.about_s, row.began_at_s, row.ended_at_s
    )


def _nobody(device_id: str) -> None:
    """Nobody is told."""
