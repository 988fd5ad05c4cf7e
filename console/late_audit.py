"""Orders to devices in the audit log: they go out at once, also where the disk takes nothing just then.

Whoever pauses a walker must not wait for a disk that is full. What could not be written is kept in memory and written
as soon as it can be; a console that ends before that has told its log.
"""

from __future__ import annotations

import logging
import threading
from collections import deque

from sqlalchemy.exc import OperationalError

from console.store import Store
from console.tables import AuditRow

MAX_WAITING_COUNT = 10_000
_log = logging.getLogger(__name__)


class LateAudit:
    """Writes deeds down, late where it must be. All methods may be called from any thread."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._waiting: deque[AuditRow] = deque(maxlen=MAX_WAITING_COUNT)

    def note(self, who: str, action: str, detail: str) -> None:
        """Write down who did what; never raises because of the disk."""
        at_s = self._store.wall_s()
        try:
            self._store.audit(who, action, detail)
        except OperationalError as error:
            with self._lock:
                self._waiting.append(AuditRow(at_s=at_s, who=who, action=action, detail=detail[:500]))
            _log.error(
                "In the audit log later, for it cannot be written (%s): %s %s %s", error.orig, who, action, detail
            )

    def write(self) -> None:
        """Write what waits; what cannot be written waits on."""
        with self._lock:
            rows = list(self._waiting)
            if not rows:
                return
            try:
                with self._store.writing() as session:
                    session.add_all(
                        AuditRow(at_s=row.at_s, who=row.who, action=row.action, detail=row.detail) for row in rows
                    )
            except OperationalError:
                return
            self._waiting.clear()
