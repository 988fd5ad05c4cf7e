"""Files that are damaged, cut short or foreign: a sentence that says what to do, and never a wrong replay."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer
from recorded_walk import STORED_WALK

from device_agent.cli import main
from device_agent.recording.part_writer import OPENING_CRC, checksum
from device_agent.recording.reading import RecordedPart
from device_agent.recording.replay import replay
from navcore.errors import InputError

WALK = STORED_WALK.read_bytes()
WHOLE = [each.notes.number for each in RecordedPart(STORED_WALK).cycles()]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where damaged files are put, one after the other."""
    return tmp_path_factory.mktemp("damage") / "walk.mcap"


def read_as_far_as_possible(path: Path, data: bytes) -> list[int]:
    """Replay what can be read; whatever is replayed is as it was."""
    path.write_bytes(data)
    try:
        part = RecordedPart(path)
        cycles = list(replay([part]))
    except InputError:
        return []
    assert all(not each.differs_in for each in cycles)
    return [each.notes.number for each in cycles]


@given(st.integers(0, len(WALK) - 1))
@settings(deadline=None, max_examples=40)
def test_a_file_cut_short_is_read_up_to_there(path: Path, length: int) -> None:
    kept = read_as_far_as_possible(path, WALK[:length])
    assert kept == WHOLE[: len(kept)]


def test_the_longer_a_file_the_more_is_read(path: Path) -> None:
    counts = [len(read_as_far_as_possible(path, WALK[: round(share * len(WALK))])) for share in np.linspace(0, 1, 9)]
    assert counts == sorted(counts)
    assert counts[-1] == len(WHOLE)


@given(st.one_of(st.integers(0, len(WALK) - 1), st.integers(0, 8000)), st.integers(1, 255))
@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.too_slow])
def test_a_byte_gone_wrong_never_makes_a_wrong_replay(path: Path, where: int, change: int) -> None:
    data = bytearray(WALK)
    data[where] ^= change
    kept = read_as_far_as_possible(path, bytes(data))
    assert kept == WHOLE[: len(kept)]


@given(st.integers(0, 40_000), st.binary(min_size=1, max_size=60))
@settings(deadline=None, max_examples=40)
def test_bytes_put_in_near_the_beginning_do_no_harm(path: Path, where: int, extra: bytes) -> None:
    kept = read_as_far_as_possible(path, WALK[:where] + extra + WALK[where:])
    assert kept == WHOLE[: len(kept)]


@given(st.binary(max_size=200))
@settings(deadline=None, max_examples=40)
def test_foreign_bytes_are_no_walk(path: Path, data: bytes) -> None:
    assert read_as_far_as_possible(path, data) == []
    assert read_as_far_as_possible(path, WALK[:8] + data) == []


def mcap_with(fill: Callable[[Writer], None]) -> bytes:
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.NONE)
    writer.start()
    fill(writer)
    writer.finish()
    return out.getvalue()


def foreign(writer: Writer) -> None:
    schema = writer.register_schema("x", "jsonschema", b"{}")
    writer.add_message(writer.register_channel("/x", "json", schema), 1, b"{}", 1)


def newer(writer: Writer) -> None:
    writer.add_metadata("walk", {"format_version": "2"})


def nothing_to_begin_with(writer: Writer) -> None:
    data = b"\x93\x01\x02\x03"
    writer.add_metadata("walk", {"format_version": "1", OPENING_CRC: checksum(data)})
    writer.add_attachment(0, 0, "opening", "application/msgpack", data)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"hello", "no MCAP file"),
        (b"", "damaged where it begins"),
        (WALK[:300], "damaged where it begins"),
        (mcap_with(foreign), "no walk that was recorded here"),
        (mcap_with(newer), "use the version of the program"),
        (mcap_with(nothing_to_begin_with), "use the version of the program"),
    ],
)
def test_what_is_no_walk_is_refused_in_words(path: Path, data: bytes, words: str) -> None:
    path.write_bytes(data)
    with pytest.raises(InputError, match=words):
        RecordedPart(path)
    for command in ("show", "replay"):
        assert main(["walks", command, str(path)]) == 2


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    for command in (["show"], ["replay"], ["list"]):
        assert main(["walks", *command, str(tmp_path / "none.mcap")]) == 2


def test_a_chunk_that_claims_to_be_huge_is_not_unpacked(path: Path) -> None:
    """Some bytes that would become gigabytes: read up to there, in no memory to speak of."""
    bomb = zstandard.ZstdCompressor().compress(bytes(200 << 20))
    for claimed in (1000, 200 << 20, 1 << 60):
        chunk = Chunk("zstd", bomb, 2, 1, 0, claimed)
        path.write_bytes(_with_chunk(chunk))
        part = RecordedPart(path)
        assert list(part.cycles()) == []
        assert part.damage


def _with_chunk(chunk: Chunk) -> bytes:
    """Put a chunk in place of all that the stored walk has behind its opening."""
    from mcap.data_stream import RecordBuilder
    from mcap.records import Attachment, Header, Metadata
    from mcap.stream_reader import StreamReader

    builder = RecordBuilder()
    for record in StreamReader(io.BytesIO(WALK)).records:
        if isinstance(record, Header | Metadata | Attachment):
            record.write(builder)
            if isinstance(record, Attachment):
                break
    chunk.write(builder)
    return WALK[:8] + builder.end()


def test_a_damaged_file_is_repaired_up_to_the_damage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken, target = tmp_path / "20261129T000000Z-glasses-001.mcap", tmp_path / "whole.mcap"
    broken.write_bytes(WALK[: len(WALK) // 2])
    assert main(["walks", "list", str(tmp_path)]) == 0
    assert "not completed" in capsys.readouterr().out
    assert main(["walks", "repair", str(broken), str(target)]) == 0
    assert "damaged" in capsys.readouterr().out
    kept = [each.notes.number for each in RecordedPart(broken).cycles()]
    assert 0 < len(kept) < len(WHOLE)
    repaired = RecordedPart(target)
    assert [each.notes.number for each in repaired.cycles()] == kept
    assert repaired.damage == ""
    assert repaired.length_s() is not None
    assert main(["walks", "replay", str(target)]) == 0
    assert main(["walks", "repair", str(broken), str(target)]) == 2
    assert main(["walks", "replay", str(broken)]) == 0
    assert "read up to where it is damaged" in capsys.readouterr().out
