"""The alerts of all devices: looked for by a timer, shown to the pages, kept in the database.

Everybody sees the same alerts: what one person acknowledges is acknowledged for all. What is shown never waits for the
disk: another thread writes it down, and what cannot be written is written later. What a person does is written before
it is answered.
"""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from console.alerts import lifecycle
from console.alerts.alert_store import AlertRecord, AlertStep, AlertStore
from console.alerts.incidents import BEFORE_S, Cause, Incidents
from console.alerts.lifecycle import Change, Life, Phase
from console.alerts.rules import RULES, AlertKind, Priority, Rule, judge, sentence_of
from console.alerts.watch import LedRecord, Watch
from console.errors import ConflictError, ConsoleError, NotFoundError
from console.hub import DeviceHub
from console.live import STALE_AFTER_S, LiveDevice
from navcore.repeating import Repeating

CHECK_EVERY_S = 0.25
HEARD_KEPT_EVERY_S = 5.0
"""So often it is written down when somebody who is being led was heard of last."""
KEEP_AGAIN_AFTER_S = 5.0
"""So long after an incident could not be kept it is tried again, while its alert lasts."""
SHELF_MINUTES = (5, 10, 15)
SAME_SHELF_S = 60.0
"""Who shelves an alert as they did within so long asks again, for they have not heard the answer."""
_log = logging.getLogger(__name__)
Listener = Callable[[], None]
Key = tuple[str, AlertKind]


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


@dataclass(frozen=True, slots=True)
class _DueIncident:
    """An incident that is to be kept."""

    cause: Cause
    since_s: float
    """When it became due, on the steady clock."""
    at_s: float
    """Not before this, on the steady clock."""


@dataclass(slots=True)
class _Unwritten:
    """What the database does not hold yet."""

    records: dict[str, AlertRecord] = field(default_factory=dict)
    steps: list[AlertStep] = field(default_factory=list)
    led: dict[str, LedRecord | None] = field(default_factory=dict)
    """Of devices, by id, whether they lead somebody."""

    def __bool__(self) -> bool:
        return bool(self.records or self.steps or self.led)

    def copy(self) -> _Unwritten:
        """Return what it holds now."""
        return _Unwritten(dict(self.records), list(self.steps), dict(self.led))

    def forget(self, written: _Unwritten) -> None:
        """Take out what has been written; what has changed since stays."""
        self.records = {key: each for key, each in self.records.items() if written.records.get(key) is not each}
        # Steps are only ever added, and two that are alike are two.
        done = {id(step) for step in written.steps}
        self.steps = [step for step in self.steps if id(step) not in done]
        self.led = {
            key: each for key, each in self.led.items() if key not in written.led or written.led[key] is not each
        }  # fmt: skip


class Alerts:
    """The alerts. All methods may be called from any thread; :meth:`check` is called by a timer once it is started."""

    def __init__(
        self, hub: DeviceHub, store: AlertStore, incidents: Incidents, rules: Mapping[AlertKind, Rule] = RULES
    ) -> None:
        """Take up the alerts that were not done with when the console ended."""
        self._hub, self._store, self._incidents, self.rules = hub, store, incidents, rules
        self._lock = threading.RLock()
        """Of what is known; nobody waits for the disk while they hold it."""
        self._writing = threading.RLock()
        """Held by whoever writes to the database, so that an alert's steps are written in order; taken first."""
        self._lives: dict[Key, Life] = {}
        self._records: dict[Key, AlertRecord] = {}
        self._unwritten = _Unwritten()
        self._is_failing = False
        self._due_incidents: dict[Key, _DueIncident] = {}
        self._listeners: list[Listener] = []
        self._shown: tuple[Alert, ...] = ()
        self._timers = (
            Repeating("alerts", CHECK_EVERY_S, self.check),
            Repeating("alerts-writing", CHECK_EVERY_S, self.write),
            Repeating("incidents", CHECK_EVERY_S, incidents.write),
        )
        self._began_s = hub.now_s()
        wall_s = store.wall_s()
        self._kept_led: dict[str, LedRecord | None] = {each.device_id: each for each in store.leading()}
        self._watches = {
            key: Watch.resumed(each, self._began_s, wall_s) for key, each in self._kept_led.items() if each
        }
        for record in store.open_records():
            self._take_up(record, self._began_s)
        self._show()

    # --------------------------------------------------------------------------------------------------- reading
    def active(self, device_id: str | None = None) -> tuple[Alert, ...]:
        """Return the alerts that are not done with, of a device or of all, the most urgent first; never waits."""
        return tuple(each for each in self._shown if device_id is None or each.record.device_id == device_id)

    def views(self, device_id: str | None = None) -> list[dict[str, Any]]:
        """Return them as plain data for JSON."""
        now_s, wall_s = self._hub.now_s(), self._store.wall_s()
        return [_view(each, self.rules[each.record.kind], now_s, wall_s) for each in self.active(device_id)]

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

        def seen(record: AlertRecord) -> AlertRecord:
            return replace(record, acknowledged_at_s=self._store.wall_s(), acknowledged_by=who, note=note)

        def refuse(record: AlertRecord) -> ConflictError:
            return ConflictError(f"{record.acknowledged_by} has acknowledged this alert already.")

        self._do(alert_id, lifecycle.acknowledge, seen, refuse, who, note)

    def shelve(self, alert_id: str, minutes: int, who: str, reason: str) -> None:
        """Keep an alert silent for some minutes; what the same person has just asked for is not done twice.

        Raises NotFoundError, or ConflictError for other times.
        """
        if minutes not in SHELF_MINUTES:
            raise ConflictError("An alert is shelved for 5, 10 or 15 minutes: choose one of these.")
        if self._is_on_this_shelf(alert_id, minutes, who, reason):
            return
        until_s, until_wall_s = (now_s + 60.0 * minutes for now_s in (self._hub.now_s(), self._store.wall_s()))

        def shelved(record: AlertRecord) -> AlertRecord:
            return replace(record, shelved_until_s=until_wall_s, shelved_by=who, shelf_reason=reason)

        detail = f"{minutes} min: {reason}"
        self._do(alert_id, lambda life: lifecycle.shelve(life, until_s), shelved, _not_open, who, detail)

    def _is_on_this_shelf(self, alert_id: str, minutes: int, who: str, reason: str) -> bool:
        with self._lock:
            _, record = self._open(alert_id)
        if record.shelved_until_s is None or (record.shelved_by, record.shelf_reason) != (who, reason):
            return False
        return 0.0 <= self._store.wall_s() - (record.shelved_until_s - 60.0 * minutes) < SAME_SHELF_S

    def unshelve(self, alert_id: str, who: str) -> None:
        """Let a shelved alert be heard again. Raises NotFoundError, or ConflictError where it is on no shelf."""

        def refuse(record: AlertRecord) -> ConflictError:
            return ConflictError("This alert is not shelved: its time may be up already.")

        now_s = self._hub.now_s()
        self._do(alert_id, lambda life: lifecycle.unshelve(life, now_s), lambda record: record, refuse, who, "")

    def end_watch(self, device_id: str, who: str, why: str) -> None:
        """Miss a device no more that led somebody and is not heard of, until it connects anew.

        Raises NotFoundError, or ConflictError where it is heard of: then guidance is to be ended.
        """
        with self._writing:
            with self._lock:
                watch = self._watches.get(device_id)
                if watch is None or not watch.was_led:
                    raise NotFoundError("Nobody is known to be led by this device: there is nothing to be missed.")
                device = self._device(device_id)
                if device is not None and device.connected:
                    raise ConflictError(f"{watch.name} is connected: end guidance instead.")
            self._store.save([], [], (who, "watch_ended", f"{watch.name} {why}"), {device_id: None})
            self._off_watch(device_id, watch)

    def forget(self, device_id: str) -> None:
        """Miss a device no more, for it may not call any more (its token is void)."""
        with self._lock:
            watch = self._watches.get(device_id)
            if watch is not None:
                self._off_watch(device_id, watch)

    def concerned_ids(self) -> frozenset[str]:
        """Return the devices of which there are alerts that are not done with, or that are missed."""
        with self._lock:
            missed = {key for key, watch in self._watches.items() if watch.was_led or watch.broke_off}
            return frozenset(missed | {key[0] for key, life in self._lives.items() if life.is_open})

    def forget_device(self, device_id: str) -> None:
        """Keep nothing any more of a device that the hub has forgotten."""
        with self._lock:
            self._watches.pop(device_id, None)
            self._kept_led.pop(device_id, None)
            for kind in self.rules:
                self._lives.pop((device_id, kind), None)
                self._records.pop((device_id, kind), None)

    # ------------------------------------------------------------------------------------------------ the timers
    def start(self) -> None:
        """Look for alerts from now on, and write them down, in threads of their own."""
        for timer in self._timers:
            timer.start()

    def close(self) -> None:
        """Stop looking, and write what is still to be written."""
        for timer in self._timers:
            timer.close()
        self.write()
        self._incidents.close()

    def check(self) -> None:
        """Look at all devices now; waits for no disk."""
        with self._lock:
            now_s = self._hub.now_s()
            devices = {device.device_id: device for device in self._hub.devices()}
            for device_id in (*devices, *(each for each in self._watches if each not in devices)):
                self._look_at(device_id, devices.get(device_id), now_s)
            self._show()

    def write(self) -> None:
        """Keep the incidents that are due, and write what is not written yet; what fails is tried again later."""
        self._keep_incidents()
        with self._writing:
            with self._lock:
                unwritten = self._unwritten.copy()
            if not unwritten:
                return
            try:
                self._store.save(unwritten.records.values(), unwritten.steps, led=unwritten.led)
            except SQLAlchemyError as error:
                if not self._is_failing:
                    _log.error("Alerts cannot be written down for now; they are shown all the same: %s", error)
                self._is_failing = True
                return
            self._is_failing = False
            with self._lock:
                self._unwritten.forget(unwritten)

    # ------------------------------------------------------------------------------------------------- internals
    def _look_at(self, device_id: str, device: LiveDevice | None, now_s: float) -> None:
        is_heard_of = device is not None and device.state is not None
        if not is_heard_of and now_s < self._began_s + STALE_AFTER_S:
            # A console that has just begun gives the devices time to call.
            return
        watch = self._watches.get(device_id)
        if watch is None:
            watch = self._watches[device_id] = Watch(device.name if device else device_id, now_s)
        seen = watch.look(device, now_s)
        self._note_led(device_id, watch, now_s)
        for kind, rule in self.rules.items():
            key = device_id, kind
            life = self._lives.get(key, Life())
            finding = judge(rule, seen, life.is_holding)
            after, changes = lifecycle.step(life, rule, finding.verdict, now_s)
            if after is not life:
                self._lives[key] = after
            if changes:
                self._note(key, changes, watch.name, sentence_of(rule, finding, seen, watch.name))

    def _note_led(self, device_id: str, watch: Watch, now_s: float) -> None:
        record = watch.record(device_id, self._store.wall_s() - now_s)
        before = self._kept_led.get(device_id)
        if record is not None and before is not None and record.heard_at_s - before.heard_at_s < HEARD_KEPT_EVERY_S:
            return
        if record is None and before is None:
            return
        self._kept_led[device_id] = self._unwritten.led[device_id] = record

    def _note(self, key: Key, changes: tuple[Change, ...], name: str, sentence: str) -> None:
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
        if record.priority is Priority.HIGH and {Change.RAISED, Change.AGAIN, Change.ESCALATED} & set(changes):
            cause = Cause(wall_s, record.kind, record.sentence, record.alert_id)
            now_s = self._hub.now_s()
            self._due_incidents[key] = _DueIncident(cause, now_s, now_s)
        self._put(key, record, [AlertStep(record.alert_id, wall_s, change, "", "") for change in changes])

    def _keep_incidents(self) -> None:
        with self._lock:
            now_s = self._hub.now_s()
            due = [(key, each) for key, each in self._due_incidents.items() if each.at_s <= now_s]
        for key, each in due:
            try:
                incident_id = self._incidents.keep(key[0], each.cause)
            except ConsoleError as error:
                self._keep_later(key, each, error)
            else:
                self._has_incident(key, each, incident_id)

    def _keep_later(self, key: Key, due: _DueIncident, error: ConsoleError) -> None:
        with self._lock:
            passed_s = self._hub.now_s() - due.since_s
            if passed_s < KEEP_AGAIN_AFTER_S:
                _log.error("No incident is kept of %s for now: %s", self._records[key].device_name, error)
            if self._due_incidents.get(key) is not due:
                return
            if self._lives[key].is_active or passed_s < BEFORE_S:
                self._due_incidents[key] = replace(due, at_s=self._hub.now_s() + KEEP_AGAIN_AFTER_S)
            else:
                del self._due_incidents[key]

    def _has_incident(self, key: Key, due: _DueIncident, incident_id: str) -> None:
        with self._lock:
            if self._due_incidents.get(key) is due:
                del self._due_incidents[key]
            record = self._records[key]
            if record.alert_id == due.cause.alert_id:
                self._put(key, replace(record, incident_id=incident_id), [])
                self._show()

    def _do(
        self,
        alert_id: str,
        act: Callable[[Life], lifecycle.Step],
        update: Callable[[AlertRecord], AlertRecord],
        refuse: Callable[[AlertRecord], ConsoleError],
        who: str,
        detail: str,
    ) -> None:
        """Do to an alert what somebody wants: written first, then shown."""
        with self._writing:
            with self._lock:
                key, before = self._open(alert_id)
                life, changes = act(self._lives[key])
                if not changes:
                    raise refuse(before)
                wall_s = self._store.wall_s()
                record = _updated(update(before), life, changes, wall_s)
                steps = [
                    AlertStep(alert_id, wall_s, each, who, detail if each is changes[0] else "") for each in changes
                ]  # fmt: skip
                earlier = [step for step in self._unwritten.steps if step.alert_id == alert_id]
            audit = who, f"alert_{changes[0].value}", f"{record.device_name}: {record.kind} {detail}"
            self._store.save([record], [*earlier, *steps], audit)
            with self._lock:
                self._unwritten.forget(_Unwritten({alert_id: before}, earlier))
                if self._records[key].alert_id == alert_id:
                    self._take_over(key, before, record, act, update, changes)

    def _take_over(
        self,
        key: Key,
        before: AlertRecord,
        written: AlertRecord,
        act: Callable[[Life], lifecycle.Step],
        update: Callable[[AlertRecord], AlertRecord],
        known: tuple[Change, ...],
    ) -> None:
        """Do what was written to the alert as it is by now: the device may have gone on meanwhile."""
        now = self._records[key]
        self._lives[key], changes = act(self._lives[key])
        if now is before:
            self._records[key] = written
        else:
            wall_s = self._store.wall_s()
            more = [AlertStep(now.alert_id, wall_s, each) for each in changes if each not in known]
            self._put(key, _updated(update(now), self._lives[key], changes, wall_s), more)
        if key[1] == "broke_off" and self._lives[key].is_acknowledged:
            self._watches[key[0]].broke_off = False
        self._show()

    def _device(self, device_id: str) -> LiveDevice | None:
        return next((each for each in self._hub.devices() if each.device_id == device_id), None)

    def _off_watch(self, device_id: str, watch: Watch) -> None:
        with self._lock:
            watch.end(self._hub.now_s())
            self._note_led(device_id, watch, self._hub.now_s())

    def _put(self, key: Key, record: AlertRecord, steps: list[AlertStep]) -> None:
        self._records[key] = record
        self._unwritten.records[record.alert_id] = record
        self._unwritten.steps += steps

    def _open(self, alert_id: str) -> tuple[Key, AlertRecord]:
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
        watch = self._watches.setdefault(record.device_id, Watch(record.device_name, now_s))
        watch.broke_off = watch.broke_off or (
            record.kind == "broke_off" and record.is_active and record.acknowledged_at_s is None
        )


def _not_open(record: AlertRecord) -> ConsoleError:
    return NotFoundError("There is no such alert any more: it has been dealt with.")


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


def _view(alert: Alert, rule: Rule, now_s: float, wall_s: float) -> dict[str, Any]:
    record, shelved_until_s = alert.record, alert.life.shelved_until_s
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
        "shelf_left_s": None if shelved_until_s is None else max(0.0, shelved_until_s - now_s),
        "shelved_by": record.shelved_by,
        "shelf_reason": record.shelf_reason,
        "incident_id": record.incident_id,
    }
