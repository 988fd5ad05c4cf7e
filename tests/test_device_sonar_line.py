"""The rangefinder's lines: whatever arrives, nothing breaks, little is remembered, and a good line is read."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from device_agent.adapters.sonar_line import (
    MAX_LINE_BYTES,
    LineParser,
    SonarKind,
    SonarLine,
    checksum,
    decoded,
    encoded,
)

LINES = st.one_of(
    st.builds(SonarLine, st.integers(0, 2**32 - 1), st.just(SonarKind.ECHO), st.integers(1, 99_999)),
    st.builds(SonarLine, st.integers(0, 2**32 - 1), st.sampled_from([SonarKind.NO_ECHO, SonarKind.FAULT]), st.just(0)),
)
PIECES = st.lists(st.integers(1, 30), max_size=60)


def fed(parser: LineParser, data: bytes, pieces: list[int]) -> list[SonarLine]:
    """Feed bytes in pieces of any size, as a serial line does."""
    found: list[SonarLine] = []
    for size in pieces:
        found += parser.feed(data[:size])
        data = data[size:]
        assert parser.waiting_bytes <= MAX_LINE_BYTES
    return found + parser.feed(data)


def test_the_documented_lines_are_what_is_sent() -> None:
    assert checksum(b"123456789") == 0x29B1, "CRC-16/CCITT-FALSE, by its usual check value"
    assert encoded(SonarLine(120_450, SonarKind.ECHO, 1534)) == b"$U1,120450,E,1534*C4E9\n"
    assert encoded(SonarLine(120_500, SonarKind.NO_ECHO, 0)) == b"$U1,120500,N,0*99B7\n"
    assert encoded(SonarLine(120_550, SonarKind.FAULT, 0)) == b"$U1,120550,F,0*7317\n"


@given(LINES)
def test_what_is_sent_is_what_is_read(line: SonarLine) -> None:
    text = encoded(line)
    assert len(text) <= MAX_LINE_BYTES
    assert LineParser().feed(text) == [line]
    assert LineParser().feed(text.replace(b"\n", b"\r\n")) == [line]


@given(st.lists(LINES, max_size=8), PIECES)
def test_lines_come_out_in_order_however_they_are_cut(lines: list[SonarLine], pieces: list[int]) -> None:
    assert fed(LineParser(), b"".join(encoded(line) for line in lines), pieces) == lines


@given(st.binary(max_size=600), LINES, PIECES)
@example(b"$U1,5,E,100*", SonarLine(7, SonarKind.ECHO, 1), [])
@example(b"$" * 500, SonarLine(7, SonarKind.ECHO, 1), [])
def test_a_good_line_after_any_garbage_is_read(garbage: bytes, line: SonarLine, pieces: list[int]) -> None:
    parser = LineParser()
    fed(parser, garbage, pieces)
    assert parser.waiting_bytes <= MAX_LINE_BYTES
    assert parser.feed(encoded(line))[-1:] == [line]


@given(st.binary(max_size=2000), PIECES)
def test_garbage_is_no_line(garbage: bytes, pieces: list[int]) -> None:
    # A line by chance needs the right form and one checksum of 65536: the examples hold none.
    assert fed(LineParser(), garbage, pieces) == []


@given(LINES, st.data())
def test_a_line_with_one_wrong_byte_is_left_out(line: SonarLine, data: st.DataObject) -> None:
    text = bytearray(encoded(line)[:-1])
    place = data.draw(st.integers(0, len(text) - 1))
    text[place] ^= data.draw(st.integers(1, 255))
    assert decoded(bytes(text)) is None


@given(LINES, st.data())
def test_a_line_without_some_of_its_bytes_is_left_out(line: SonarLine, data: st.DataObject) -> None:
    text = encoded(line)[:-1]
    first = data.draw(st.integers(0, len(text) - 1))
    last = data.draw(st.integers(first + 1, len(text)))
    assert decoded(text[:first] + text[last:]) is None


@pytest.mark.parametrize("body", [b"U1,5,E,0", b"U1,5,N,10", b"U1,4294967296,N,0", b"U2,5,N,0", b"U1,-5,N,0"])
def test_a_line_that_contradicts_itself_is_left_out(body: bytes) -> None:
    assert decoded(b"$%b*%04X" % (body, checksum(body))) is None
