"""The rangefinder's lines: whatever arrives, nothing breaks, little is remembered, and a good line is read."""

from __future__ import annotations

import itertools
import shutil
import subprocess
from pathlib import Path

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


# ------------------------------------------------------------------------------------ the sketch in the documents
BOARD = r"""
#include <cstdint>
#include <cstdio>
static const int HIGH = 1, LOW = 0, OUTPUT = 1, INPUT = 0;
static unsigned long now_us = 3000000, rises_us = 0, falls_us = 0, rises_after_us = 0, high_for_us = 0;
unsigned long micros() { return now_us; }
unsigned long millis() { return (now_us += 100) / 1000; }
void delayMicroseconds(unsigned long us) { now_us += us; }
void pinMode(int, int) {}
void digitalWrite(int, int level) {
  if (level == LOW) { rises_us = now_us + rises_after_us; falls_us = rises_us + high_for_us; }
}
int digitalRead(int) { now_us += 4; return now_us >= rises_us && now_us < falls_us ? HIGH : LOW; }
struct { void begin(long) {} void print(const char *text) { fputs(text, stdout); } } Serial;
"""
SCENES = r"""
int main() {
  const unsigned long rises[] = {450, 450, 450, 9000000, 450}, high[] = {8746, 38000, 40, 10, 9000000};
  setup();
  for (int scene = 0; scene < 5; scene++) { rises_after_us = rises[scene]; high_for_us = high[scene]; loop(); }
}
"""


def test_the_sketch_in_the_documents_says_what_the_device_reads(tmp_path: Path) -> None:
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        pytest.skip("there is no C++ compiler to compile the sketch with")
    page = (Path(__file__).parent.parent / "docs" / "hardware.md").read_text(encoding="utf-8")
    sketch = page.split("```cpp\n")[1].split("```")[0]
    (tmp_path / "sketch.cpp").write_text(BOARD + sketch + SCENES)
    subprocess.run([compiler, "-Wall", "-Werror", "-o", tmp_path / "sketch", tmp_path / "sketch.cpp"], check=True)
    said = subprocess.run([tmp_path / "sketch"], check=True, capture_output=True, timeout=60).stdout
    lines = LineParser().feed(said)
    assert [line.kind.value for line in lines] == ["E", "N", "E", "F", "F"]
    assert lines[0].distance_mm == pytest.approx(1500, abs=3)
    assert lines[2].distance_mm < 20
    assert all(b"$" + text in said for text in (b"U1,3000,E,",))
    pings_ms = [line.sensor_ms for line in lines]
    assert all(50 <= later - earlier <= 52 for earlier, later in itertools.pairwise(pings_ms))


def test_the_documents_show_real_lines() -> None:
    page = (Path(__file__).parent.parent / "docs" / "hardware.md").read_bytes()
    shown = [line for line in page.splitlines() if line.startswith(b"$U1,") and b"<" not in line]
    assert len(shown) == 3
    assert all(decoded(line) is not None for line in shown)
