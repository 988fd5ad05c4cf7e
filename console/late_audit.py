"""Orders to devices in the audit log: they go out at once, whatever the database does just then.

Whoever pauses a walker must wait neither for a disk that is full nor for somebody else who writes: what they did is
noted in memory, and written by a thread of its own. What cannot be written yet is told in the log, and tried again.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy.exc import SQLAlchemyError

from console.store import Store
from console.tables import AuditRow

MAX_WAITING_COUNT = 10_000
WRITE_EVERY_S = 1.0
"""How often what could not be written is tried again."""
_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Deed:
    at_s: float
    who: str
    action: str
    detail: str
    is_told: bool = False
    """The log of the console tells of it, once, where the database does not."""


class LateAudit:
    """Writes deeds down, late where it must be. All methods may be called from any thread."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._waiting: deque[_Deed] = deque(maxlen=MAX_WAITING_COUNT)
        self.on_noted: Callable[[], object] = lambda: None
        """Called when there is something to write: whoever calls :meth:`write` in a thread of its own."""

    def note(self, who: str, action: str, detail: str) -> None:
        """Take down who did what, to be written; never waits for the database."""
        with self._lock:
            self._waiting.append(_Deed(self._store.wall_s(), who, action, detail[:500]))
        self.on_noted()

    def write(self) -> None:
        """Write what waits, waiting for the database; what cannot be written waits on."""
        with self._writing:
            with self._lock:
                deeds = list(self._waiting)
                self._waiting.clear()
            if not deeds:
                return
            try:
                with self._store.writing() as session:
                    session.add_all(AuditRow(at_s=d.at_s, who=d.who, action=d.action, detail=d.detail) for d in deeds)
            except SQLAlchemyError as error:
                _tell(deeds, error)
                with self._lock:
                    self._waiting = deque([*deeds, *self._waiting], maxlen=MAX_WAITING_COUNT)


def _tell(deeds: list[_Deed], error: SQLAlchemyError) -> None:
    for deed in deeds:
        if not deed.is_told:
            _log.error(
                "In the audit log later, for it cannot be written (%s): %s %s %s",
                getattr(error, "orig", error), deed.who, deed.action, deed.detail,
            )  # fmt: skip
            deed.is_told = True
