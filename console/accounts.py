"""People: accounts, sign-in sessions, and the one-time links that let somebody choose a password.

There is no default password. The first start makes a link that lets whoever opens it become the first admin; later an
admin invites others by such links, and nobody but the person ever knows the password.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from sqlalchemy import delete, func, select, update
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from console.errors import BadRequestError, ConflictError, NotFoundError, SignInError, TooManyError
from console.roles import ROLES, Role, SignedIn
from console.secrets_kept import hash_of_password, hash_of_token, new_token, password_matches
from console.sign_in_limit import Attempt, SignInLimit, network_of
from console.store import Store
from console.tables import AuditRow, OneTimeLinkRow, SessionRow, UserRow

_log = logging.getLogger(__name__)
SESSION_IDLE_S = 24 * 3600.0
SESSION_LONGEST_S = 14 * 24 * 3600.0
LINK_VALID_S = 48 * 3600.0
SEEN_STEP_S = 60.0
MAX_NAME_LENGTH = 60
FAILURES_OF_ADDRESS_COUNT = 20
FAILURES_OF_ACCOUNT_COUNT = 100
"""So many from anywhere, then an account waits as well. Neither this nor the limit of an address is for who has signed
in from there before."""
ACCOUNT_WAITS_S = 30.0
MAX_HASHING_COUNT = 4
"""Passwords are hashed so many at a time: each takes memory and a core, on purpose."""
_BAD_LINK = "This link has been used, has expired, or is not complete: ask for a new one."


@dataclass(frozen=True, slots=True)
class User:
    """An account, as admins see it."""

    id: int
    name: str
    role: Role
    has_password: bool
    disabled: bool
    created_at_s: float


class Accounts:
    """Accounts and sessions in the store. All methods may be called from any thread.

    ``on_session_end`` is called with the id of every session that ends before its time.
    """

    def __init__(
        self, store: Store, steady_s: Callable[[], float], on_session_end: Callable[[str], None] = lambda _: None
    ) -> None:
        self._store = store
        self._by_name = SignInLimit(steady_s)
        self._by_address = SignInLimit(steady_s, FAILURES_OF_ADDRESS_COUNT)
        self._by_account = SignInLimit(steady_s, FAILURES_OF_ACCOUNT_COUNT, ACCOUNT_WAITS_S)
        self._hashing = threading.BoundedSemaphore(MAX_HASHING_COUNT)
        self._on_session_end = on_session_end
        self._seen_s: dict[str, float] = {}
        """When sessions were used, as far as it is not written yet: an order must not wait for the database."""

    # -------------------------------------------------------------------------------------------------- links
    def first_admin_link_token(self) -> str | None:
        """Make the token of a link for the first admin, and void earlier ones; None where an admin exists already."""
        with self._store.writing() as session:
            if _active_admin_count(session):
                return None
            session.execute(delete(OneTimeLinkRow).where(OneTimeLinkRow.user_id.is_(None)))
            return self._add_link(session, None)

    def new_admin_link_token(self, by: str) -> str:
        """Make the token of a link for one more admin: for whoever has the machine, and no way in."""
        with self._store.writing() as session:
            self._store.add_audit(session, by, "admin_link")
            return self._add_link(session, None)

    def link_name(self, token: str) -> str | None:
        """Return whose link it is; None where it makes a new admin. Raises NotFoundError for a spent link."""
        with self._store.reading() as session:
            link = self._open_link(session, token)
            user = session.get(UserRow, link.user_id) if link.user_id is not None else None
            return user.name if user else None

    def use_link(self, token: str, name: str, password: str) -> User:
        """Spend a link: the person of that name has this password now, and no other link. Raises NotFoundError,
        BadRequestError or TooManyError.
        """
        self.link_name(token)  # Hashing takes long on purpose: not for somebody without a link.
        with self._hashing_in_turn():
            password_hash = hash_of_password(password)
        # Urgent, as signing in is: somebody may have no other way in, and only who has a link comes so far.
        result, ended = self._store.urgently(partial(self._spend_link, token, name, password_hash))
        self._tell_ended(ended)
        return result

    def _spend_link(self, token: str, name: str, password_hash: str) -> tuple[User, list[str]]:
        with self._store.writing() as session:
            link = self._open_link(session, token)
            link.used_at_s = self._store.wall_s()
            user_id = link.user_id
            user = self._add_user(session, name, "admin") if user_id is None else _user(session, user_id)
            user.password_hash = password_hash
            session.flush()
            _void_links(session, user.id)
            ended = _end_sessions(session, user.id)
            self._store.add_audit(session, user.name, "password_chosen")
            return _as_user(user), ended

    # ----------------------------------------------------------------------------------------------- sessions
    def sign_in(self, name: str, password: str, address: str) -> str:
        """Return the token of a new session. Raises SignInError or TooManyError; the same for unknown names."""
        name_key = _name_key(name)
        with self._store.reading() as session:
            user = session.scalar(select(UserRow).where(UserRow.name_key == name_key))
        usable = user is not None and user.disabled_at_s is None
        with self._hashing_in_turn():
            attempts = self._attempts(name_key, user, address)
            matches = password_matches(password, user.password_hash if user is not None and usable else None)
        if user is None or not matches:
            # A name that nobody has may be a password that was typed into the wrong field.
            self._audit_failure(user.name if user else "unknown name", address)
            raise SignInError("Name and password do not match.")
        _take_back(attempts)
        self._by_name.forget(attempts[0][1].key)
        return self._store.urgently(partial(self._start_checked, user, address))

    def start_session(self, user_id: int) -> str:
        """Return the token of a new session of this person."""
        return self._store.urgently(partial(self._start_session, user_id))

    def _start_session(self, user_id: int) -> str:
        with self._store.writing() as session:
            return self._add_session(session, user_id)

    def _start_checked(self, seen: UserRow, address: str) -> str:
        """Start the session of whoever gave the right password, unless it has been changed while it was judged."""
        with self._store.writing() as session:
            user = _user(session, seen.id)
            if user.password_hash != seen.password_hash or user.disabled_at_s is not None:
                raise SignInError("Name and password do not match.")
            self._store.add_audit(session, user.name, "sign_in", address)
            return self._add_session(session, user.id)

    def _add_session(self, session: Session, user_id: int) -> str:
        token, now_s = new_token(), self._store.wall_s()
        session.execute(delete(SessionRow).where(SessionRow.created_at_s < now_s - SESSION_LONGEST_S))
        session.add(
            SessionRow(token_hash=hash_of_token(token), user_id=user_id, created_at_s=now_s, last_seen_at_s=now_s)
        )
        return token

    def signed_in(self, token: str) -> SignedIn | None:
        """Return who holds this session token; None where the session is over."""
        with self._store.reading() as session:
            row = session.get(SessionRow, hash_of_token(token))
            user = session.get(UserRow, row.user_id) if row else None
        now_s = self._store.wall_s()
        if row is None or user is None or not self._goes_on(row, user, now_s):
            return None
        if abs(now_s - row.last_seen_at_s) > SEEN_STEP_S:
            self._seen_s[row.token_hash] = now_s
        return SignedIn(row.token_hash, user.id, user.name, _role(user.role))

    def over(self, session_ids: Collection[str]) -> set[str]:
        """Return those of these sessions that are over."""
        chosen = select(SessionRow, UserRow).join(UserRow, UserRow.id == SessionRow.user_id)
        with self._store.reading() as session:
            rows = session.execute(chosen.where(SessionRow.token_hash.in_(session_ids))).all()
        now_s = self._store.wall_s()
        return set(session_ids) - {row.token_hash for row, user in rows if self._goes_on(row, user, now_s)}

    def note_used(self, session_ids: Collection[str]) -> None:
        """Write down that sessions are used: a page that is open uses its own, though it may ask for nothing."""
        self._write_seen()
        now_s = self._store.wall_s()
        stale = SessionRow.token_hash.in_(session_ids), SessionRow.last_seen_at_s < now_s - SEEN_STEP_S
        with self._store.reading() as session:
            found = session.scalars(select(SessionRow.token_hash).where(*stale)).all()
        if found:
            with self._store.writing() as session:
                session.execute(update(SessionRow).where(SessionRow.token_hash.in_(found)).values(last_seen_at_s=now_s))

    def sign_out(self, person: SignedIn) -> None:
        """End one session."""
        self._store.urgently(partial(self._end_session, person))
        self._tell_ended([person.session_id])

    def _end_session(self, person: SignedIn) -> None:
        with self._store.writing() as session:
            session.execute(delete(SessionRow).where(SessionRow.token_hash == person.session_id))
            self._store.add_audit(session, person.user_name, "sign_out")

    def _audit_failure(self, name: str, address: str) -> None:
        try:
            self._store.audit(name, "sign_in_failed", address)
        except OperationalError as error:
            # Whoever guesses is refused all the same, and must not use up the room that others sign in by.
            _log.warning("A failed sign-in from %s could not be written down (%s).", address, error.orig)

    # ------------------------------------------------------------------------------------------------- people
    def users(self) -> list[User]:
        """Return all accounts by name."""
        with self._store.reading() as session:
            return [_as_user(row) for row in session.scalars(select(UserRow).order_by(UserRow.name_key))]

    def invite(self, name: str, role: Role, by: str) -> tuple[User, str]:
        """Add a person; return the account and the token of the link to choose a password with."""
        with self._store.writing() as session:
            user = self._add_user(session, name, role)
            session.flush()
            self._store.add_audit(session, by, "user_invited", f"{user.name} as {role}")
            return _as_user(user), self._add_link(session, user.id)

    def new_password_link(self, user_id: int, by: str) -> str:
        """Return the token of a link with which a person chooses a new password; the old one holds until then.

        Earlier links are void.
        """
        return self._store.urgently(partial(self._new_password_link, user_id, by))

    def _new_password_link(self, user_id: int, by: str) -> str:
        with self._store.writing() as session:
            user = _user(session, user_id)
            _void_links(session, user_id)
            self._store.add_audit(session, by, "password_link", user.name)
            return self._add_link(session, user.id)

    def change(self, user_id: int, by: str, role: Role | None = None, disabled: bool | None = None) -> User:
        """Give a person another role, or lock the account; their sessions end, and the links of who is locked out.

        Refuses to take the last admin away.
        """
        result, ended = self._store.urgently(partial(self._change, user_id, by, role, disabled))
        self._tell_ended(ended)
        return result

    def _change(self, user_id: int, by: str, role: Role | None, disabled: bool | None) -> tuple[User, list[str]]:
        with self._store.writing() as session:
            user = _user(session, user_id)
            if role is not None:
                user.role = role
            if disabled is not None:
                user.disabled_at_s = self._store.wall_s() if disabled else None
            session.flush()
            if disabled:
                _void_links(session, user_id)
            if not _active_admin_count(session):
                raise ConflictError("This is the last admin: make somebody else an admin first.")
            ended = _end_sessions(session, user_id)
            self._store.add_audit(session, by, "user_changed", f"{user.name}: role {user.role}, disabled {disabled}")
            return _as_user(user), ended

    # ---------------------------------------------------------------------------------------------- internals
    @contextmanager
    def _hashing_in_turn(self) -> Iterator[None]:
        """Refuse, rather than let wait, where many are being judged: who waits holds a thread that all need."""
        if not self._hashing.acquire(blocking=False):
            raise TooManyError("Others are signing in just now: try again in a moment.", 1.0)
        try:
            yield
        finally:
            self._hashing.release()

    def _attempts(self, name_key: str, user: UserRow | None, address: str) -> list[tuple[SignInLimit, Attempt]]:
        """Count an attempt with every limit, that of the name at its address first; where one refuses it, with none."""
        network = network_of(address)
        attempts = _counted([(self._by_name, f"{name_key}\n{network}")])
        try:
            return attempts + _counted([(self._by_address, network), (self._by_account, name_key)])
        except TooManyError:
            if user is not None and self._came_from(user.name, network):
                # Nobody locks a person out from where they come: neither neighbours, nor many addresses together.
                return attempts
            _take_back(attempts)
            raise

    def _came_from(self, user_name: str, network: str) -> bool:
        signed_in = AuditRow.who == user_name, AuditRow.action == "sign_in"
        with self._store.reading() as session:
            addresses = session.scalars(select(AuditRow.detail).where(*signed_in).distinct()).all()
        return network in map(network_of, addresses)

    def _add_link(self, session: Session, user_id: int | None) -> str:
        token, now_s = new_token(), self._store.wall_s()
        session.add(
            OneTimeLinkRow(
                token_hash=hash_of_token(token), user_id=user_id, created_at_s=now_s, expires_at_s=now_s + LINK_VALID_S
            )
        )
        return token

    def _open_link(self, session: Session, token: str) -> OneTimeLinkRow:
        link = session.get(OneTimeLinkRow, hash_of_token(token))
        if link is None or link.used_at_s is not None:
            raise NotFoundError(_BAD_LINK)
        now_s = self._store.wall_s()
        # Nor does one hold that was made while the clock was far ahead.
        if now_s > link.expires_at_s or now_s < link.created_at_s - LINK_VALID_S:
            raise NotFoundError(_BAD_LINK)
        return link

    def _add_user(self, session: Session, name: str, role: Role) -> UserRow:
        shown = " ".join(name.split())
        if not shown or len(shown) > MAX_NAME_LENGTH or not shown.isprintable():
            raise BadRequestError(f"This name cannot be used: give 1 to {MAX_NAME_LENGTH} printable characters.")
        if session.scalar(select(UserRow.id).where(UserRow.name_key == _name_key(name))) is not None:
            raise ConflictError(f"There is an account {shown!r} already: choose another name.")
        user = UserRow(
            name=shown, name_key=_name_key(name), password_hash="", role=role, created_at_s=self._store.wall_s()
        )
        session.add(user)
        return user

    def _goes_on(self, row: SessionRow, user: UserRow, now_s: float) -> bool:
        return _goes_on(row, user, self._seen_s.get(row.token_hash, row.last_seen_at_s), now_s)

    def _write_seen(self) -> None:
        seen_s = dict(self._seen_s)
        if not seen_s:
            return
        with self._store.writing() as session:
            for session_id, at_s in seen_s.items():
                mine = SessionRow.token_hash == session_id
                session.execute(update(SessionRow).where(mine).values(last_seen_at_s=at_s))
        for session_id, at_s in seen_s.items():
            if self._seen_s.get(session_id) == at_s:
                del self._seen_s[session_id]

    def _tell_ended(self, session_ids: list[str]) -> None:
        for session_id in session_ids:
            self._on_session_end(session_id)


def _name_key(name: str) -> str:
    return " ".join(name.split()).casefold()


def _user(session: Session, user_id: int) -> UserRow:
    user = session.get(UserRow, user_id)
    if user is None:
        raise NotFoundError("There is no such account.")
    return user


def _role(text: str) -> Role:
    return next(role for role in ROLES if role == text)


def _as_user(row: UserRow) -> User:
    disabled = row.disabled_at_s is not None
    return User(row.id, row.name, _role(row.role), bool(row.password_hash), disabled, row.created_at_s)


def _active_admin_count(session: Session) -> int:
    able = (UserRow.role == "admin", UserRow.disabled_at_s.is_(None), UserRow.password_hash != "")
    return session.scalar(select(func.count()).select_from(UserRow).where(*able)) or 0


def _counted(limits: list[tuple[SignInLimit, str]]) -> list[tuple[SignInLimit, Attempt]]:
    counted: list[tuple[SignInLimit, Attempt]] = []
    try:
        for limit, key in limits:
            counted.append((limit, limit.attempt(key)))
    except TooManyError:
        _take_back(counted)
        raise
    return counted


def _take_back(attempts: list[tuple[SignInLimit, Attempt]]) -> None:
    for limit, attempt in attempts:
        limit.succeeded(attempt)


def _goes_on(row: SessionRow, user: UserRow, seen_s: float, now_s: float) -> bool:
    """Whether a session is neither too old, nor too long unused, nor of somebody who is locked out."""
    # Either way: a session that was begun while the clock was years ahead is not to last for years.
    is_young = abs(now_s - row.created_at_s) <= SESSION_LONGEST_S
    is_used = abs(now_s - seen_s) <= SESSION_IDLE_S
    return is_young and is_used and user.disabled_at_s is None


def _void_links(session: Session, user_id: int) -> None:
    unused = OneTimeLinkRow.user_id == user_id, OneTimeLinkRow.used_at_s.is_(None)
    session.execute(delete(OneTimeLinkRow).where(*unused))


def _end_sessions(session: Session, user_id: int) -> list[str]:
    ended = list(session.scalars(select(SessionRow.token_hash).where(SessionRow.user_id == user_id)))
    session.execute(delete(SessionRow).where(SessionRow.user_id == user_id))
    return ended
