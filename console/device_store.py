"""Devices in the database: their tokens and their events."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

from sqlalchemy import delete, func, not_, select, update
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session, aliased

from console.errors import BadRequestError, ConflictError, NotFoundError
from console.secrets_kept import hash_of_token, new_token
from console.store import Store
from console.tables import DeviceRow, DeviceTokenRow, EventRow, VoidTokenRow
from navcore.wire import Event

MAX_NAME_LENGTH = 60
MAX_DEVICES_OF_TOKEN_COUNT = 20
"""A device may be set up anew, under another id; who makes up ids without end is none."""
_NAME = re.compile(r"\w[\w .'()-]*")
EventKind = Literal[
    "cue", "arrived", "route_refused", "localization", "sensor", "link", "mode", "watchdog", "button", "privacy"
]
EVENT_KINDS: tuple[EventKind, ...] = get_args(EventKind)


@dataclass(frozen=True, slots=True)
class DeviceToken:
    """A token as admins see it."""

    name: str
    created_by: str
    created_at_s: float
    last_seen_at_s: float | None
    revoked: bool


def checked_name(name: str) -> str:
    """Return a device's name, with single spaces. Raises BadRequestError for one that people could not type or read."""
    shown = _spaced(name)
    if len(shown) > MAX_NAME_LENGTH or _NAME.fullmatch(shown) is None:
        raise BadRequestError(
            f"{name[:MAX_NAME_LENGTH]!r} is no name for a device: use 1 to {MAX_NAME_LENGTH} letters, digits, spaces"
            " and - _ . ' ( ), and begin with a letter or digit."
        )
    return shown


def _spaced(name: str) -> str:
    return " ".join(name.split())


class DeviceStore:
    """What is kept of devices. All methods may be called from any thread."""

    def __init__(self, store: Store) -> None:
        self._store = store

    # ------------------------------------------------------------------------------------------------- tokens
    def create_token(self, name: str, by: str) -> str:
        """Return a new token for the device of this name; an earlier one of the name is void from now on."""
        shown = checked_name(name)
        token = new_token()
        with self._store.writing() as session:
            self._set_token(session, shown, token, by)
        return token

    def valid_token(self, name: str) -> DeviceToken | None:
        """Return what is known of the token of this name, where a device can sign in with it; else None."""
        shown = _spaced(name)
        return next((token for token in self.tokens() if token.name == shown and not token.revoked), None)

    def ensure_token(self, name: str, token: str, by: str) -> bool:
        """Let a token that was made elsewhere in, for the device of this name; one that is known keeps its own.

        Returns False for one that was taken back, or that a newer one has replaced: it stays void.
        """
        token_hash = hash_of_token(token)
        with self._store.writing() as session:
            if session.get(VoidTokenRow, token_hash) is not None:
                return False
            known = session.scalar(select(DeviceTokenRow).where(DeviceTokenRow.token_hash == token_hash))
            if known is not None:
                return known.revoked_at_s is None
            self._set_token(session, name, token, by)
        return True

    def revoke_token(self, name: str, by: str) -> float | None:
        """Lock a device out; return when that was done before (Unix time), if it was.

        Raises NotFoundError with the names there are.
        """
        return self._store.urgently(partial(self._revoke, _spaced(name), by))

    def _revoke(self, name: str, by: str) -> float | None:
        with self._store.writing() as session:
            row = session.get(DeviceTokenRow, name)
            if row is None:
                names = ", ".join(session.scalars(select(DeviceTokenRow.name).order_by(DeviceTokenRow.name)))
                raise NotFoundError(
                    f"No device {name!r} has a token: choose one of those that have ({names or 'none'})."
                )
            if row.revoked_at_s is not None:
                # When it was done stays what it was; to do it twice is no fault.
                return row.revoked_at_s
            row.revoked_at_s = self._store.wall_s()
            self._store.add_audit(session, by, "token_revoked", name)
        return None

    def tokens(self) -> list[DeviceToken]:
        """Return all tokens by name."""
        with self._store.reading() as session:
            rows = session.scalars(select(DeviceTokenRow).order_by(DeviceTokenRow.name))
            return [
                DeviceToken(r.name, r.created_by, r.created_at_s, r.last_seen_at_s, r.revoked_at_s is not None)
                for r in rows
            ]

    def name_of(self, token: str) -> str | None:
        """Return the name that a valid token stands for; None for any other."""
        with self._store.reading() as session:
            row = session.scalar(select(DeviceTokenRow).where(DeviceTokenRow.token_hash == hash_of_token(token)))
        return row.name if row is not None and row.revoked_at_s is None else None

    def void(self, token_ids: Collection[str]) -> set[str]:
        """Return those of these tokens, by their hashes, that let no device in any more."""
        valid = DeviceTokenRow.token_hash.in_(token_ids), DeviceTokenRow.revoked_at_s.is_(None)
        with self._store.reading() as session:
            return set(token_ids) - set(session.scalars(select(DeviceTokenRow.token_hash).where(*valid)))

    def take_in(self, device_id: str, token_name: str) -> None:
        """Note that a device has called. Raises ConflictError where it belongs to another token, or has too many.

        One that is known is taken in also where the disk takes nothing just now.
        """
        try:
            self._note_called(device_id, token_name)
        except OperationalError:
            with self._store.reading() as session:
                row = session.get(DeviceRow, device_id)
            if row is None or row.token_name != token_name:
                raise

    def _note_called(self, device_id: str, token_name: str) -> None:
        with self._store.writing() as session:
            row = session.get(DeviceRow, device_id)
            if row is None:
                mine = select(func.count()).where(DeviceRow.token_name == token_name)
                if (session.scalar(mine) or 0) >= MAX_DEVICES_OF_TOKEN_COUNT:
                    raise ConflictError(
                        f"{MAX_DEVICES_OF_TOKEN_COUNT} devices have called with the token of {token_name!r}: make"
                        " one for each with `vbr console token NAME`."
                    )
                session.add(DeviceRow(device_id=device_id, token_name=token_name))
            elif row.token_name != token_name:
                raise ConflictError(
                    f"The device {device_id!r} belongs to the token of {row.token_name!r}: use that one."
                )
            token = session.get(DeviceTokenRow, token_name)
            if token is not None:
                token.last_seen_at_s = self._store.wall_s()

    # ------------------------------------------------------------------------------------------------- events
    def add_event(self, device_id: str, event: Event) -> bool:
        """Store an event durably; return whether it is new."""
        same = (EventRow.device_id == device_id, EventRow.sequence == event.sequence)
        with self._store.writing() as session:
            if session.scalar(select(EventRow.id).where(*same)) is not None:
                return False
            session.add(
                EventRow(
                    device_id=device_id,
                    sequence=event.sequence,
                    stamp_s=event.stamp_s,
                    arrived_at_s=self._store.wall_s(),
                    kind=event.kind,
                    text=event.text,
                )
            )
        return True

    def last_sequence(self, device_id: str) -> int:
        """Return the sequence of the last stored event of a device; 0 where there is none."""
        ordered = select(EventRow.sequence).where(EventRow.device_id == device_id).order_by(EventRow.sequence.desc())
        with self._store.reading() as session:
            return session.scalar(ordered.limit(1)) or 0

    def latest_events(self, device_id: str, count: int) -> tuple[Event, ...]:
        """Return the last events of a device, oldest first."""
        mine = EventRow.device_id == device_id, EventRow.text != ""
        ordered = select(EventRow).where(*mine).order_by(EventRow.sequence.desc())
        with self._store.reading() as session:
            rows = list(session.scalars(ordered.limit(count)))
        return tuple(Event(row.sequence, row.stamp_s, _kind(row.kind), row.text) for row in reversed(rows))

    def ids_of(self, token_name: str) -> tuple[str, ...]:
        """Return the devices that speak with the token of this name."""
        with self._store.reading() as session:
            mine = select(DeviceRow.device_id).where(DeviceRow.token_name == token_name)
            return tuple(session.scalars(mine.order_by(DeviceRow.device_id)))

    def delete_before(self, wall_s: float) -> int:
        """Delete the events that arrived before a Unix time; return how many there were.

        The last one of each device stays, without its words: by its number the device knows which the console has.
        """
        same_device = aliased(EventRow)
        last = select(func.max(same_device.sequence)).where(same_device.device_id == EventRow.device_id)
        is_last, old = EventRow.sequence == last.scalar_subquery(), EventRow.arrived_at_s < wall_s
        with self._store.writing() as session:
            count = session.scalar(select(func.count()).where(old, EventRow.text != "")) or 0
            session.execute(update(EventRow).where(old, is_last).values(text=""))
            session.execute(delete(EventRow).where(old, not_(is_last)))
        return count

    # ---------------------------------------------------------------------------------------------- internals
    def _set_token(self, session: Session, name: str, token: str, by: str) -> None:
        row = session.get(DeviceTokenRow, name) or DeviceTokenRow(name=name)
        if row.token_hash is not None:
            session.add(VoidTokenRow(token_hash=row.token_hash))
        row.token_hash = hash_of_token(token)
        row.created_by, row.created_at_s, row.revoked_at_s = by, self._store.wall_s(), None
        session.add(row)
        self._store.add_audit(session, by, "token_created", name)


def _kind(text: str) -> EventKind:
    return next(kind for kind in EVENT_KINDS if kind == text)
