"""Alerts in the database: each as it stands, and every step that led there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from types import MappingProxyType

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from console.alerts.lifecycle import Change
from console.alerts.rules import RULES, AlertKind, Priority
from console.alerts.watch import LedRecord
from console.store import Store
from console.tables import AlertRow, AlertStepRow, DeviceRow, DeviceTokenRow, HeardRow, LedRow


@dataclass(frozen=True, slots=True)
class AlertRecord:
    """What is kept of an alert. Times are Unix seconds."""

    alert_id: str
    device_id: str
    device_name: str
    kind: AlertKind
    priority: Priority
    sentence: str
    raised_at_s: float
    is_active: bool = True
    times: int = 1
    returned_at_s: float | None = None
    acknowledged_at_s: float | None = None
    acknowledged_by: str = ""
    note: str = ""
    shelved_until_s: float | None = None
    shelved_by: str = ""
    shelf_reason: str = ""
    incident_id: str = ""
    """The bundle of what was heard around it; empty where none is kept."""
    closed_at_s: float | None = None


@dataclass(frozen=True, slots=True)
class AlertStep:
    """Something that happened to an alert."""

    alert_id: str
    at_s: float
    what: Change
    who: str = ""
    detail: str = ""


class AlertStore:
    """What is kept of alerts. All methods may be called from any thread."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self.wall_s = store.wall_s

    def save(
        self,
        records: Iterable[AlertRecord],
        steps: Iterable[AlertStep],
        audit: tuple[str, ...] = (),
        led: Mapping[str, LedRecord | None] = MappingProxyType({}),
    ) -> None:
        """Keep alerts as they stand and what happened to them, at once.

        ``audit`` is who, action and detail; ``led`` tells of devices, by id, whether they lead somebody.
        """
        with self._store.writing() as session:
            for record in records:
                session.merge(AlertRow(**asdict(record)))
            session.add_all(AlertStepRow(**asdict(step) | {"what": step.what.value}) for step in steps)
            if audit:
                self._store.add_audit(session, *audit)
            for device_id, leads in led.items():
                _note_led(session, device_id, leads, self.wall_s())

    def open_records(self) -> list[AlertRecord]:
        """Return the alerts that are not done with, oldest first."""
        unfinished = select(AlertRow).where(AlertRow.closed_at_s.is_(None)).order_by(AlertRow.raised_at_s)
        with self._store.reading() as session:
            return [_record(row) for row in session.scalars(unfinished) if row.kind in RULES]

    def recent(self, device_id: str | None, count: int) -> list[AlertRecord]:
        """Return the last alerts, of a device or of all, newest first."""
        found = select(AlertRow).order_by(AlertRow.raised_at_s.desc()).limit(count)
        if device_id is not None:
            found = found.where(AlertRow.device_id == device_id)
        with self._store.reading() as session:
            return [_record(row) for row in session.scalars(found) if row.kind in RULES]

    def named(self, alert_ids: Iterable[str]) -> list[AlertRecord]:
        """Return the alerts of these ids that there are, oldest first."""
        mine = select(AlertRow).where(AlertRow.alert_id.in_(list(alert_ids))).order_by(AlertRow.raised_at_s)
        with self._store.reading() as session:
            return [_record(row) for row in session.scalars(mine) if row.kind in RULES]

    def steps(self, alert_ids: Iterable[str]) -> list[AlertStep]:
        """Return what happened to these alerts, in order."""
        mine = select(AlertStepRow).where(AlertStepRow.alert_id.in_(list(alert_ids))).order_by(AlertStepRow.id)
        with self._store.reading() as session:
            return [AlertStep(r.alert_id, r.at_s, Change(r.what), r.who, r.detail) for r in session.scalars(mine)]

    def delete_before(self, wall_s: float) -> int:
        """Delete the alerts that were done with before this Unix time; return how many."""
        old = select(AlertRow.alert_id).where(AlertRow.closed_at_s < wall_s)
        with self._store.writing() as session:
            session.execute(delete(AlertStepRow).where(AlertStepRow.alert_id.in_(old)))
            return _deleted(session, list(session.scalars(old)))

    # ------------------------------------------------------------------------------------------ who is being led
    def leading(self) -> list[LedRecord]:
        """Return the devices that were leading somebody when they were heard of last, and may still call."""
        revoked = select(DeviceRow.device_id).join(DeviceTokenRow, DeviceTokenRow.name == DeviceRow.token_name)
        revoked = revoked.where(DeviceTokenRow.revoked_at_s.is_not(None))
        leading = select(LedRow, HeardRow).outerjoin(HeardRow, HeardRow.device_id == LedRow.device_id)
        with self._store.reading() as session:
            rows = session.execute(leading.where(LedRow.device_id.not_in(revoked)))
            return [_led_record(led, heard, self.wall_s()) for led, heard in rows]


def _led_record(led: LedRow, heard: HeardRow | None, wall_s: float) -> LedRecord:
    if heard is None:
        return LedRecord(led.device_id, led.device_name, wall_s)
    return LedRecord(led.device_id, led.device_name, heard.heard_at_s, heard.event_sequence)


def _note_led(session: Session, device_id: str, record: LedRecord | None, wall_s: float) -> None:
    if record is None:
        for table in (LedRow, HeardRow):
            session.execute(delete(table).where(table.device_id == device_id))
        return
    if session.get(LedRow, device_id) is None:
        session.add(LedRow(device_id=device_id, device_name=record.name, since_s=wall_s))
    session.merge(
        HeardRow(device_id=device_id, heard_at_s=record.heard_at_s, event_sequence=record.event_sequence)
    )  # fmt: skip


def _deleted(session: Session, alert_ids: list[str]) -> int:
    session.execute(delete(AlertRow).where(AlertRow.alert_id.in_(alert_ids)))
    return len(alert_ids)


def _record(row: AlertRow) -> AlertRecord:
    values = {field.name: getattr(row, field.name) for field in fields(AlertRecord)}
    return AlertRecord(**values | {"priority": Priority(row.priority), "kind": RULES[row.kind].kind})  # type: ignore[index]
