"""The settings that devices were asked to run, in the database: who, when, from, to, why, and what the device said."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, cast

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from console.errors import NotFoundError
from console.store import Store
from console.tables import SettingsRevisionRow, SettingsTrialRow
from navcore.settings import SettingValue
from navcore.wire import ApplySettings, SettingsRunning

RevisionState = Literal["sent", "trying", "running", "refused", "reverted"]
_STARTED_ANEW = "The device went back to what was kept before: it started anew, or nobody kept these."


@dataclass(frozen=True, slots=True)
class SettingsRevision:
    """Settings that somebody asked a device to run."""

    revision: int
    device_id: str
    author: str
    at_s: float
    """Unix time."""
    why: str
    changes: Mapping[str, tuple[SettingValue, SettingValue]]
    """From and to."""
    values: Mapping[str, SettingValue]
    state: RevisionState
    """``trying``: they run until they are kept or time is up; ``reverted``: they were tried out and not kept."""
    refusal: str
    revert_after_s: float = 0.0
    """So long they were to be tried out; 0 where they were to be kept at once."""
    override_reason: str = ""
    """Why they were changed though somebody was being led."""


class SettingsStore:
    """Revisions of settings. All methods may be called from any thread."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(
        self,
        device_id: str,
        author: str,
        why: str,
        before: Mapping[str, SettingValue],
        after: Mapping[str, SettingValue],
        *,
        newer_than: int = 0,
        revert_after_s: float = 0.0,
        override_reason: str = "",
    ) -> SettingsRevision:
        """Store what a device is about to be asked to run; its number, above ``newer_than``, names it from now on."""
        changes = {key: (before.get(key, ""), value) for key, value in after.items() if before.get(key) != value}
        with self._store.writing() as session:
            last = session.scalar(select(func.max(SettingsRevisionRow.revision))) or 0
            row = SettingsRevisionRow(
                revision=max(last, newer_than) + 1,
                device_id=device_id,
                author=author,
                at_s=self._store.wall_s(),
                why=why,
                changes_json=json.dumps(changes),
                values_json=json.dumps(dict(after)),
                state="sent",
                refusal="",
            )
            session.add(row)
            session.flush()
            trial = None
            if revert_after_s > 0.0:
                trial = SettingsTrialRow(
                    revision=row.revision, revert_after_s=revert_after_s, override_reason=override_reason
                )
                session.add(trial)
            overridden = f" though somebody is led ({override_reason})" if override_reason else ""
            detail = f"{device_id} r{row.revision}{overridden}: {row.changes_json} {why}"
            self._store.add_audit(session, author, "settings", detail)
        return _as_revision(row, trial)

    def note_running(self, device_id: str, told: SettingsRunning) -> None:
        """Store what a device says of its revisions: which one runs, and what became of others."""
        with self._store.writing() as session:
            if told.refused_revision is not None:
                self._note_refused(session, device_id, told.refused_revision, told.refusal)
            running = self._mine(session, device_id, told.revision)
            if running is not None:
                running.state, running.refusal = "trying" if told.revert_at_s is not None else "running", ""
            trying = (SettingsRevisionRow.device_id == device_id, SettingsRevisionRow.state == "trying")
            for row in session.scalars(select(SettingsRevisionRow).where(*trying)):
                if row.revision != told.revision:
                    self._set_reverted(session, row, _STARTED_ANEW)

    def revisions(self, device_id: str, count: int) -> list[SettingsRevision]:
        """Return the last revisions of a device, newest first."""
        with self._store.reading() as session:
            rows = session.scalars(_of(device_id).limit(count)).all()
            return [_with_trial(session, row) for row in rows]

    def revision(self, device_id: str, number: int) -> SettingsRevision:
        """Return one revision of a device. Raises NotFoundError."""
        with self._store.reading() as session:
            row = self._mine(session, device_id, number)
            if row is None:
                raise NotFoundError(
                    f"This device has never been asked to run revision {number}: choose one from its list."
                )
            return _with_trial(session, row)

    def wanted_revision(self, device_id: str) -> SettingsRevision | None:
        """Return the newest revision that the device has run and kept; None where there is none.

        What it never acknowledged is not asked for again: nobody carries out later what was asked for then.
        """
        kept = _of(device_id).where(SettingsRevisionRow.state == "running")
        with self._store.reading() as session:
            row = session.scalar(kept.limit(1))
            return None if row is None else _with_trial(session, row)

    def order_at_joining(self, device_id: str, running_revision: int) -> ApplySettings | None:
        """Return what a device is asked that has lost what it had kept, and runs an older revision; None: nothing."""
        kept = self.wanted_revision(device_id)
        if kept is None or kept.revision <= running_revision:
            return None
        return ApplySettings(kept.revision, dict(kept.values), base_revision=running_revision, kept_before=True)

    def _note_refused(self, session: Session, device_id: str, revision: int, refusal: str) -> None:
        row = self._mine(session, device_id, revision)
        if row is None:
            return
        if row.state == "sent":
            row.state, row.refusal = "refused", refusal
        elif row.state == "trying":
            self._set_reverted(session, row, refusal)

    def _set_reverted(self, session: Session, row: SettingsRevisionRow, why: str) -> None:
        row.state, row.refusal = "reverted", why
        self._store.add_audit(session, "device", "settings_reverted", f"{row.device_id} r{row.revision}: {why}")

    def _mine(self, session: Session, device_id: str, revision: int) -> SettingsRevisionRow | None:
        row = session.get(SettingsRevisionRow, revision)
        return row if row is not None and row.device_id == device_id else None


def _of(device_id: str) -> Select[SettingsRevisionRow]:
    return (
        select(SettingsRevisionRow)
        .where(SettingsRevisionRow.device_id == device_id)
        .order_by(SettingsRevisionRow.revision.desc())
    )


def _with_trial(session: Session, row: SettingsRevisionRow) -> SettingsRevision:
    return _as_revision(row, session.get(SettingsTrialRow, row.revision))


def _as_revision(row: SettingsRevisionRow, trial: SettingsTrialRow | None) -> SettingsRevision:
    changes = {key: (before, after) for key, (before, after) in json.loads(row.changes_json).items()}
    return SettingsRevision(
        row.revision, row.device_id, row.author, row.at_s, row.why, changes, json.loads(row.values_json),
        cast(RevisionState, row.state), row.refusal,
        0.0 if trial is None else trial.revert_after_s, "" if trial is None else trial.override_reason,
    )  # fmt: skip
