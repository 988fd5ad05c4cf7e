"""The console's database: SQLite in WAL mode by default, through SQLAlchemy, so that a URL may name PostgreSQL instead.

What :meth:`Store.writing` has committed survives a crash and a power cut (``synchronous=FULL``). What is deleted is
overwritten (``secure_delete``), and gone from the write-ahead log after :meth:`Store.forget_deleted`.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from sqlalchemy import Connection, Engine, create_engine, event, insert, inspect, select, update
from sqlalchemy.exc import DatabaseError, OperationalError
from sqlalchemy.orm import Session

from console.data_lock import DataLock
from console.disk_reserve import is_short_of_room, put_back, put_by, release
from console.storage_trouble import is_for_want_of_room
from console.tables import SCHEMA_VERSION, AuditRow, Base, SchemaRow
from navcore.errors import InputError

DATABASE_FILE = "console.sqlite3"
_log = logging.getLogger(__name__)
_Done = TypeVar("_Done")
_WRITES = "vbr_writes"
_LOCK_WAIT_MS = 10_000
"""So long whoever reads or writes waits for another process."""
_EMPTYING_WAIT_MS = 100
_UNOPENED = (
    "The database {where} cannot be opened ({why}): see whether its folder is writable and the disk has room, or name"
    " another folder with --data."
)


class Store:
    """An open database. All methods may be called from any thread.

    ``wall_s`` is the clock of every date that is stored.
    """

    def __init__(
        self,
        engine: Engine,
        where: str,
        wall_s: Callable[[], float] = time.time,
        lock: DataLock | None = None,
        folder: Path | None = None,
    ) -> None:
        """``lock`` is held as long as the database is open; in ``folder`` room is put by for when the disk is full."""
        self.wall_s, self._lock, self._folder = wall_s, lock, folder
        self._is_short_of_room = False
        self._engine = engine
        self._writing_engine = engine.execution_options(**{_WRITES: True})
        self._write_lock = threading.RLock()
        _prepare_schema(self._writing_engine, where)

    @staticmethod
    def open(folder: Path, wall_s: Callable[[], float] = time.time) -> Store:
        """Open, or make, the database in a folder. Raises InputError where it is damaged, newer, or not writable."""
        path = folder / DATABASE_FILE
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise InputError(f"The folder {folder} cannot be made ({error}): name another with --data.") from error
        try:
            lock = DataLock(folder)
        except OSError as error:
            raise InputError(_UNOPENED.format(where=path, why=error)) from error
        try:
            return _opened(folder, wall_s, lock)
        except BaseException:
            lock.close()
            raise

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Open a session that only reads."""
        with Session(self._engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """Open a session that is committed at the end of the block, durably; an exception undoes it."""
        with self._write_lock, Session(self._writing_engine, expire_on_commit=False) as session, session.begin():
            yield session

    def urgently(self, deed: Callable[[], _Done]) -> _Done:
        """Do what must be done though the disk is full, in the room that was put by: who is locked out, is.

        ``deed`` writes all of its own in one block of :meth:`writing`, for it is done again where there was no room.
        """
        try:
            return deed()
        except OperationalError as error:
            if self._folder is None or not is_for_want_of_room(error):
                raise
            # So that nobody else takes the room meanwhile.
            with self._write_lock:
                released_bytes = release(self._folder)
                try:
                    return deed()
                finally:
                    put_back(self._folder, released_bytes)

    @property
    def is_short_of_room(self) -> bool:
        """Whether the disk was full, or as good as full, when :meth:`see_to_room` looked last."""
        return self._is_short_of_room

    def see_to_room(self) -> None:
        """Put by what was used as soon as there is room again; tell the log when the disk is as good as full."""
        if self._folder is None:
            return
        with self._write_lock:
            put_by(self._folder)
        was_short = self._is_short_of_room
        self._is_short_of_room = is_short_of_room(self._folder, was_short=was_short)
        if self._is_short_of_room and not was_short:
            _log.error("The disk of %s is as good as full: free it now. Nothing more can be stored soon.", self._folder)

    def audit(self, who: str, action: str, detail: str = "") -> None:
        """Write down who did what."""
        with self.writing() as session:
            self.add_audit(session, who, action, detail)

    def add_audit(self, session: Session, who: str, action: str, detail: str = "") -> None:
        """Write down who did what, in the same transaction as the deed."""
        session.add(AuditRow(at_s=self.wall_s(), who=who, action=action, detail=detail[:500]))

    def redact_audit_before(self, wall_s: float) -> int:
        """Keep of orders to devices before a Unix time only who gave which to which device; return how many."""
        old = (
            AuditRow.at_s < wall_s,
            AuditRow.action.startswith("device_", autoescape=True),
            AuditRow.detail.contains(" "),
        )
        with self.writing() as session:
            rows = session.scalars(select(AuditRow).where(*old)).all()
            for row in rows:
                row.detail = row.detail.split(" ")[0]
        return len(rows)

    def latest_audit(
        self, count: int, *, before_id: int | None = None, who: str = "", action: str = ""
    ) -> list[AuditRow]:
        """Return the last deeds, newest first: before one, of whoever's name and of what kind holds this text."""
        wanted = select(AuditRow).order_by(AuditRow.id.desc()).limit(count)
        if before_id is not None:
            wanted = wanted.where(AuditRow.id < before_id)
        if who:
            wanted = wanted.where(AuditRow.who.icontains(who, autoescape=True))
        if action:
            wanted = wanted.where(AuditRow.action.icontains("_".join(action.split()), autoescape=True))
        with self.reading() as session:
            return list(session.scalars(wanted))

    def forget_deleted(self) -> bool:
        """Empty the write-ahead log, which may still hold what was deleted; return False where a reader hinders it."""
        if self._engine.dialect.name != "sqlite":
            return True
        with self._write_lock, self._engine.connect() as connection:
            # Not within a transaction, which the log could not be emptied in.
            cursor = connection.connection.cursor()
            # Everybody who writes waits meanwhile: a reader that hinders it is waited for only briefly.
            cursor.execute(f"PRAGMA busy_timeout = {_EMPTYING_WAIT_MS}")
            try:
                answer = cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
            finally:
                cursor.execute(f"PRAGMA busy_timeout = {_LOCK_WAIT_MS}")
                cursor.close()
        return answer is not None and answer[0] == 0

    def close(self) -> None:
        """Close the database."""
        self._engine.dispose()
        if self._lock is not None:
            self._lock.close()


def _opened(folder: Path, wall_s: Callable[[], float], lock: DataLock) -> Store:
    """Open the database; on a full disk by the room that was put by for it."""
    path = folder / DATABASE_FILE

    def opened() -> Store:
        return Store(_sqlite_engine(f"sqlite:///{path}"), str(path), wall_s, lock, folder)

    try:
        store = opened()
    except InputError as error:
        if not (isinstance(error.__cause__, OperationalError) and release(folder)):
            raise
        _log.error("%s What was put by for this is used up: free the disk now.", error)
        return opened()
    put_by(folder)
    return store


def _sqlite_engine(url: str) -> Engine:
    engine = create_engine(url, connect_args={"check_same_thread": False, "timeout": _LOCK_WAIT_MS / 1000.0})

    @event.listens_for(engine, "connect")
    def configure(connection: Any, record: object) -> None:
        # The driver's own guesses about transactions are switched off: BEGIN is ours, below.
        connection.isolation_level = None
        for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "secure_delete=ON"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # A writer takes its lock at the start: upgrading later fails where another process has written meanwhile.
        immediate = connection.get_execution_options().get(_WRITES, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if immediate else "BEGIN")

    return engine


def _prepare_schema(engine: Engine, where: str) -> None:
    try:
        with engine.begin() as connection:
            if not inspect(connection).get_table_names():
                Base.metadata.create_all(connection)
                connection.execute(insert(SchemaRow).values(version=SCHEMA_VERSION))
                return
            version = connection.scalar(select(SchemaRow.version))
            if version is not None and version < SCHEMA_VERSION:
                # So far each version only added tables.
                Base.metadata.create_all(connection)
                connection.execute(update(SchemaRow).values(version=SCHEMA_VERSION))
                version = SCHEMA_VERSION
    except OperationalError as error:
        raise InputError(_UNOPENED.format(where=where, why=error.orig)) from error
    except DatabaseError as error:
        raise InputError(
            f"The database {where} is damaged ({error.orig}): restore it from a backup, or name another folder with"
            " --data."
        ) from error
    if version is None or version != SCHEMA_VERSION:
        raise InputError(
            f"The database {where} is of version {version}, and this program knows version {SCHEMA_VERSION}: update the"
            " program, or name another folder with --data."
        )
