"""A file of messages: what is written is read back, whoever was killed meanwhile, and damage is told."""

from __future__ import annotations

import contextlib
import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link_processes import Victim
from message_strategies import messages
from test_alerts_engine import Room

from console.alerts.incidents import Cause
from console.message_log import MAGIC, MessageLogError, MessageLogWriter, TimedMessage, WireRecord, read_messages
from navcore.errors import InputError, WireError
from navcore.wire import Event, WalkerState, encode

stamps = st.floats(-1e12, 1e12)
logged = st.lists(st.tuples(stamps, stamps, messages(Event) | messages(WalkerState)), max_size=8)


def written(path: Path, entries: list[tuple[float, float, Event | WalkerState]]) -> Path:
    path.unlink(missing_ok=True)
    with MessageLogWriter(path) as log:
        log.append(WireRecord(arrival_s, offset_s, encode(message)) for arrival_s, offset_s, message in entries)
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("log") / "messages.vbrlog"


@settings(max_examples=25, deadline=None)
@given(logged)
def test_what_is_written_is_read_back(log: Path, entries: list[tuple[float, float, Event | WalkerState]]) -> None:
    assert list(read_messages(written(log, entries))) == [TimedMessage(*entry) for entry in entries]


@settings(max_examples=40, deadline=None)
@given(logged, st.data())
def test_a_torn_end_costs_the_record_that_it_tears(
    log: Path, entries: list[tuple[float, float, Event | WalkerState]], data: st.DataObject
) -> None:
    whole = written(log, entries).read_bytes()
    length = data.draw(st.integers(0, len(whole)))
    tail = data.draw(st.sampled_from([b"", bytes(3), bytes(5000)]))
    log.write_bytes(whole[:length] + (tail if length >= len(MAGIC) and length == len(whole) else b""))
    found = list(read_messages(log))
    assert found == [TimedMessage(*entry) for entry in entries[: len(found)]]
    assert length < len(whole) or len(found) == len(entries)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(stamps, stamps, messages(Event)), min_size=3, max_size=5), st.data())
def test_a_byte_that_is_damaged_is_told_and_never_becomes_a_message(
    log: Path, entries: list[tuple[float, float, Event]], data: st.DataObject
) -> None:
    raw = bytearray(written(log, entries).read_bytes())  # type: ignore[arg-type]
    raw[data.draw(st.integers(0, len(raw) - 1))] ^= data.draw(st.integers(1, 255))
    log.write_bytes(raw)
    found = []
    with contextlib.suppress(InputError):
        found.extend(read_messages(log))
    assert found == [TimedMessage(*entry) for entry in entries[: len(found)]]
    assert len(found) < len(entries)


def test_what_is_no_log_of_ours_is_refused_with_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "x"
    with pytest.raises(MessageLogError, match="still there"):
        list(read_messages(path))
    path.write_bytes(b"PK\x03\x04 something else")
    with pytest.raises(MessageLogError, match="no log"):
        list(read_messages(path))
    payload = b"\xc1 no msgpack"
    path.write_bytes(MAGIC + struct.pack("<II", len(payload), zlib.crc32(payload)) + payload)
    with pytest.raises(MessageLogError, match="no message"):
        list(read_messages(path))
    path.unlink()
    with MessageLogWriter(path) as log:
        log.append([WireRecord(0.0, 0.0, b"\x81\xa4type\xa5other")])
    with pytest.raises(WireError, match="another version"):
        list(read_messages(path))


def test_a_log_is_bounded_and_says_so(tmp_path: Path) -> None:
    record = WireRecord(1.0, 0.0, encode(Event(1, 0.0, "cue", "x" * 400)))
    with MessageLogWriter(tmp_path / "log", max_bytes=5000) as log:
        log.append([record] * 50)
        assert log.is_full
        log.append([record])
        count = log.message_count
    assert (tmp_path / "log").stat().st_size <= 5000
    assert len(list(read_messages(tmp_path / "log"))) == count > 5


def test_an_incident_that_a_kill_left_begun_or_half_deleted_goes_at_the_next_start(tmp_path: Path) -> None:
    room = Room(tmp_path)
    for name in ("begun", "half-deleted", "kept"):
        room.call(name)
    begun, half, kept = (
        room.incidents.folder / room.incidents.keep(name, Cause(0.0, "asked", ""))
        for name in ("begun", "half-deleted", "kept")
    )
    room.incidents.close()
    (begun / "manifest.json").unlink()
    (half / "messages.vbrlog").unlink()
    of_somebody_else = room.incidents.folder / "lost+found"
    of_somebody_else.mkdir()
    room.restart()
    assert {path.name for path in room.incidents.folder.iterdir()} == {kept.name, of_somebody_else.name}
    assert [incident.incident_id for incident in room.incidents.all()] == [kept.name]


def test_who_is_killed_while_an_incident_is_kept_leaves_all_that_was_written(tmp_path: Path) -> None:
    victim = Victim("incident_victim.py", tmp_path)
    incident_id = victim.says()
    told = -1
    while told < 300:
        told = int(victim.says())
    victim.kill()
    told = max([told, *(int(line) for line in victim.all_said() if line)])
    room = Room(tmp_path)
    incident = room.incidents.named(incident_id)
    assert incident.state == "cut_off"
    states = [each.message for each in room.incidents.messages(incident_id)]
    numbers = [state.inlier_count for state in states if isinstance(state, WalkerState)]
    assert numbers[6:][: told + 1] == list(range(told + 1))
    assert incident.message_count == len(states)
    assert [alert.record.incident_id for alert in room.alerts.active()] == [incident_id]
