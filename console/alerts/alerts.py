"""The alerts of all devices: looked for by a timer, shown to the pages, kept in the database.

Everybody sees the same alerts: what one person acknowledges is acknowledged for all. What is shown never waits for the
disk; what cannot be written is written later. What a person does is written before it is answered.
"""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from console.alerts import lifecycle
from console.alerts.alert_store import AlertRecord, AlertStep, AlertStore
from console.alerts.incidents import Cause, Incidents
from console.alerts.lifecycle import Change, Life, Phase
from console.alerts.rules import RULES, AlertKind, Observation, Priority, Rule, judge, observe, sentence_of
from console.errors import ConflictError, ConsoleError, NotFoundError
from console.hub import DeviceHub
from console.live import LiveDevice

CHECK_EVERY_S = 0.25
SHELF_MINUTES = (5, 10, 15)
_log = logging.getLogger(__name__)
Listener = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Alert:
    """An alert that is not done with."""

    life: Life
    record: AlertRecord

    @property
    def phase(self) -> Phase:
        """How it stands."""
        return self.life.phase

    def urgency(self) -> tuple[bool, int, bool, float]:
        """Sort by this, and the worst comes first, however many there are: priority, then unseen, then the newest."""
        is_seen = self.phase is Phase.ACKNOWLEDGED
        return self.phase is Phase.SHELVED, -self.life.priority, is_seen, -self.record.raised_at_s


@dataclass(slots=True)
class _Watched:
    """What is remembered of a device between two looks."""

    name: str
    heard_s: float
    """When what it said last was true, on the console's steady clock."""
    was_led: bool = False


class Alerts:
    """The alerts. All methods may be called from any thread; :meth:`check` is called by a timer once it is started."""

    def __init__(
        self, hub: DeviceHub, store: AlertStore, incidents: Incidents, rules: Mapping[AlertKind, Rule] = RULES
    ) -> None:
        """Take up the alerts that were not done with when the console ended."""
        self._hub, self._store, self._incidents, self.rules = hub, store, incidents, rules
        self._lock = threading.RLock()
        self._lives: dict[tuple[str, AlertKind], Life] = {}
        self._records: dict[tuple[str, AlertKind], AlertRecord] = {}
        self._unsaved: dict[str, AlertRecord] = {}
        self._unsaved_steps: list[AlertStep] = []
        self._listeners: list[Listener] = []
        self._shown: tuple[Alert, ...] = ()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        now_s = hub.now_s()
        self._watched = {device_id: _Watched(name, now_s, True) for device_id, name in store.leading().items()}
        for record in store.open_records():
            self._take_up(record, now_s)
        self._show()

    # --------------------------------------------------------------------------------------------------- reading
    def active(self, device_id: str | None = None) -> tuple[Alert, ...]:
        """Return the alerts that are not done with, of a device or of all, the most urgent first; never waits."""
        return tuple(each for each in self._shown if device_id is None or each.record.device_id == device_id)

    def views(self, device_id: str | None = None) -> list[dict[str, Any]]:
        """Return them as plain data for JSON."""
        wall_s = self._store.wall_s()
        return [_view(each, self.rules[each.record.kind], wall_s) for each in self.active(device_id)]

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Call ``listener`` whenever alerts change, from whichever thread; return what ends that."""
        with self._lock:
            self._listeners.append(listener)

        def unsubscribe() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return unsubscribe

    # ------------------------------------------------------------------------------------------- what people do
    def acknowledge(self, alert_id: str, who: str, note: str = "") -> None:
        """Note that somebody has seen an alert. Raises NotFoundError, or ConflictError where somebody was quicker."""
        with self._lock:
            key, record = self._open(alert_id)
            life, changes = lifecycle.acknowledge(self._lives[key])
            if not changes:
                raise ConflictError(f"{record.acknowledged_by} has acknowledged this alert already.")
            seen = replace(record, acknowledged_at_s=self._store.wall_s(), acknowledged_by=who, note=note)
            self._done(key, life, seen, changes, who, note)

    def shelve(self, alert_id: str, minutes: int, who: str, reason: str) -> None:
        """Keep an alert silent for some minutes. Raises NotFoundError, or ConflictError for other times."""
        if minutes not in SHELF_MINUTES:
            raise ConflictError("An alert is shelved for 5, 10 or 15 minutes: choose one of these.")
        with self._lock:
            key, record = self._open(alert_id)
            life, changes = lifecycle.shelve(self._lives[key], self._hub.now_s() + 60.0 * minutes)
            until_s = self._store.wall_s() + 60.0 * minutes
            shelved = replace(record, shelved_until_s=until_s, shelved_by=who, shelf_reason=reason)
            self._done(key, life, shelved, changes, who, f"{minutes} min: {reason}")

    def unshelve(self, alert_id: str, who: str) -> None:
        """Let a shelved alert be heard again. Raises NotFoundError, or ConflictError where it is on no shelf."""
        with self._lock:
            key, record = self._open(alert_id)
            life, changes = lifecycle.unshelve(self._lives[key], self._hub.now_s())
            if not changes:
                raise ConflictError("This alert is not shelved: its time may be up already.")
            self._done(key, life, record, changes, who, "")

    # ------------------------------------------------------------------------------------------------ the timer
    def start(self) -> None:
        """Look for alerts from now on, in a thread of its own."""
        self._thread = threading.Thread(target=self._run, name="alerts", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop looking, and write what is still to be written."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join()
        with self._lock:
            self._save()
        self._incidents.close()

    def check(self) -> None:
        """Look at all devices now."""
        with self._lock:
            now_s = self._hub.now_s()
            devices = {device.device_id: device for device in self._hub.devices()}
            for device_id in (*devices, *(each for each in self._watched if each not in devices)):
                self._look_at(device_id, devices.get(device_id), now_s)
            self._save()
            self._show()

    def _run(self) -> None:
        while not self._stopped.wait(CHECK_EVERY_S):
            for work in (self.check, self._incidents.write):
                try:
                    work()
                except Exception:
                    # Whatever is wrong with one look, the next one must take place.
                    _log.exception("Looking for alerts failed.")

    # ------------------------------------------------------------------------------------------------- internals
    def _look_at(self, device_id: str, device: LiveDevice | None, now_s: float) -> None:
        watched = self._watched.get(device_id)
        if watched is None:
            watched = self._watched[device_id] = _Watched(device.name if device else device_id, now_s)
        age_s = device.longest_age_s(now_s) if device is not None else None
        if age_s is not None:
            watched.heard_s = now_s - age_s
        seen = observe(device, now_s, watched.heard_s, watched.was_led)
        self._note_led(device_id, watched, seen)
        for kind, rule in self.rules.items():
            key = device_id, kind
            life = self._lives.get(key, Life())
            finding = judge(rule, seen, life.is_holding)
            after, changes = lifecycle.step(life, rule, finding.verdict, now_s)
            if after is not life:
                self._lives[key] = after
            if changes:
                self._note(key, changes, watched.name, sentence_of(rule, finding, seen, watched.name))

    def _note_led(self, device_id: str, watched: _Watched, seen: Observation) -> None:
        if seen.was_led == watched.was_led:
            return
        watched.was_led = seen.was_led
        try:
            self._store.note_leading(device_id, watched.name, seen.was_led)
        except SQLAlchemyError as error:
            _log.error("That %s leads somebody, or does no more, cannot be written down: %s", watched.name, error)

    def _note(self, key: tuple[str, AlertKind], changes: tuple[Change, ...], name: str, sentence: str) -> None:
        """Keep what has happened by itself."""
        wall_s = self._store.wall_s()
        before = self._records.get(key)
        if Change.RAISED in changes or before is None:
            before = AlertRecord(
                secrets.token_hex(8), key[0], name, key[1], self._lives[key].priority, sentence, wall_s
            )  # fmt: skip
        elif Change.AGAIN in changes:
            before = replace(before, times=before.times + 1, sentence=sentence, returned_at_s=None)
        record = _updated(before, self._lives[key], changes, wall_s)
        is_urgent = Change.RAISED in changes or Change.ESCALATED in changes
        if is_urgent and record.priority is Priority.HIGH and not record.incident_id:
            record = replace(record, incident_id=self._keep_incident(record))
        self._put(key, record, [AlertStep(record.alert_id, wall_s, change, "", "") for change in changes])

    def _keep_incident(self, record: AlertRecord) -> str:
        cause = Cause(record.raised_at_s, record.kind, record.sentence, record.alert_id)
        try:
            return self._incidents.keep(record.device_id, cause)
        except ConsoleError as error:
            _log.error("No incident is kept of %s: %s", record.device_name, error)
            return ""

    def _done(
        self,
        key: tuple[str, AlertKind],
        life: Life,
        record: AlertRecord,
        changes: tuple[Change, ...],
        who: str,
        detail: str,
    ) -> None:
        """Keep what somebody did: written first, then shown."""
        wall_s = self._store.wall_s()
        record = _updated(record, life, changes, wall_s)
        steps = [
            AlertStep(record.alert_id, wall_s, each, who, detail if each is changes[0] else "") for each in changes
        ]
        audit = who, f"alert_{changes[0].value}", f"{record.device_name}: {record.kind} {detail}"
        self._store.save([record], [*self._steps_of(record.alert_id), *steps], audit)
        self._unsaved.pop(record.alert_id, None)
        self._unsaved_steps = [step for step in self._unsaved_steps if step.alert_id != record.alert_id]
        self._lives[key] = life
        self._records[key] = record
        self._show()

    def _steps_of(self, alert_id: str) -> list[AlertStep]:
        return [step for step in self._unsaved_steps if step.alert_id == alert_id]

    def _put(self, key: tuple[str, AlertKind], record: AlertRecord, steps: list[AlertStep]) -> None:
        self._records[key] = record
        self._unsaved[record.alert_id] = record
        self._unsaved_steps += steps

    def _save(self) -> None:
        if not self._unsaved:
            return
        try:
            self._store.save(self._unsaved.values(), self._unsaved_steps)
        except SQLAlchemyError as error:
            _log.error("Alerts cannot be written down for now; they are shown all the same: %s", error)
            return
        self._unsaved, self._unsaved_steps = {}, []

    def _open(self, alert_id: str) -> tuple[tuple[str, AlertKind], AlertRecord]:
        for key, record in self._records.items():
            if record.alert_id == alert_id and self._lives[key].is_open:
                return key, record
        raise NotFoundError("There is no such alert any more: it has been dealt with.")

    def _show(self) -> None:
        found = [Alert(self._lives[key], record) for key, record in self._records.items() if self._lives[key].is_open]
        shown = tuple(sorted(found, key=Alert.urgency))
        if [(each.phase, each.record) for each in shown] == [(each.phase, each.record) for each in self._shown]:
            return
        self._shown = shown
        for listener in tuple(self._listeners):
            try:
                listener()
            except Exception:
                _log.exception("A listener of the alerts failed.")

    def _take_up(self, record: AlertRecord, now_s: float) -> None:
        """Go on with an alert of before the restart; how long it is shelved is bounded, whatever the clocks did."""
        shelved_s = None if record.shelved_until_s is None else record.shelved_until_s - self._store.wall_s()
        key = record.device_id, record.kind
        self._records[key] = record
        self._lives[key] = Life(
            is_open=True,
            is_active=record.is_active,
            is_acknowledged=record.acknowledged_at_s is not None,
            priority=record.priority,
            shelved_until_s=None if shelved_s is None else now_s + min(shelved_s, 60.0 * max(SHELF_MINUTES)),
            unacknowledged_since_s=now_s,
            is_holding=record.is_active,
        )
        self._watched.setdefault(record.device_id, _Watched(record.device_name, now_s))


def _updated(record: AlertRecord, life: Life, changes: tuple[Change, ...], wall_s: float) -> AlertRecord:
    """Return a record as its alert stands now."""
    shelved = record if life.shelved_until_s is not None else replace(record, shelved_until_s=None)
    if life.is_open and not life.is_acknowledged:
        shelved = replace(shelved, acknowledged_at_s=None)
    return replace(
        shelved,
        priority=life.priority,
        is_active=life.is_active,
        returned_at_s=wall_s if Change.RETURNED in changes else shelved.returned_at_s,
        closed_at_s=None if life.is_open else wall_s,
    )


def _view(alert: Alert, rule: Rule, wall_s: float) -> dict[str, Any]:
    record = alert.record
    return {
        "id": record.alert_id,
        "device_id": record.device_id,
        "device": record.device_name,
        "kind": record.kind,
        "title": rule.title,
        "priority": record.priority.word,
        "escalated": record.priority > rule.priority,
        "phase": alert.phase.value,
        "active": record.is_active,
        "sentence": record.sentence,
        "advice": rule.advice,
        "raised_at_s": record.raised_at_s,
        "age_s": max(0.0, wall_s - record.raised_at_s),
        "times": record.times,
        "acknowledged_by": record.acknowledged_by if record.acknowledged_at_s is not None else "",
        "note": record.note,
        "shelf_left_s": None if record.shelved_until_s is None else max(0.0, record.shelved_until_s - wall_s),
        "shelved_by": record.shelved_by,
        "shelf_reason": record.shelf_reason,
        "incident_id": record.incident_id,
    }
