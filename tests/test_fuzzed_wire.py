"""What comes over the air or a wire, spoiled: by its form, and by whatever was found to do harm once."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fuzz.targets_wire import GRAPH, SEEDS, TARGETS, device_ordered, device_seen, framed, sonar_line
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from message_strategies import messages
from test_misfit import FOREIGN, UNSAID
from test_wire import DOWN, UP

from console.place_words import PlaceWords
from device_agent.adapters.sonar_line import LineParser, SonarKind, SonarLine, encoded
from navcore import wire
from navcore.errors import VbrError, WireError
from navcore.jpeg_size import jpeg_size_px, refuse_picture
from navcore.wire_row import Direction

CORPUS = Path(__file__).parent / "data" / "corpus"
HARSH: tuple[object, ...] = (
    float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e13, 5e-324, -1, 1 << 53, (1 << 53) + 1, 1 << 62,
    (1 << 64) - 1, -(1 << 63), True, None, "", "x" * 5000, "\x00\x1b[2J\u202e", b"\xff" * 300, [], [0] * 5000, {},
    {"": {}},
)  # fmt: skip
"""What may stand where something else is due."""
OTHERWISE = settings(deadline=None, suppress_health_check=list(HealthCheck))


def _cases() -> Iterator[tuple[str, bytes]]:
    for name, seeds in SEEDS.items():
        yield from ((name, seed) for seed in seeds)
    for folder in sorted(CORPUS.glob("*")):
        if folder.name in TARGETS:
            yield from ((folder.name, file.read_bytes()) for file in sorted(folder.iterdir()))


def test_what_is_valid_and_what_did_harm_once_is_read_or_refused() -> None:
    refusals = list[str]()
    for name, data in _cases():
        try:
            TARGETS[name](data)
        except VbrError as error:
            refusals.append(str(error))
        except Exception as error:
            raise AssertionError(f"{name} is harmed by {data!r}") from error
    assert [each for each in refusals if not each.endswith(".")] == [], "each is a sentence"


@given(st.lists(st.one_of(*map(messages, wire.DeviceMessage.__args__), messages(wire.WalkerState)), max_size=4))
@settings(OTHERWISE, max_examples=150)
def test_whatever_a_device_may_say_can_be_shown(said: list[wire.DeviceMessage]) -> None:
    device_seen(framed(*said))


@given(st.lists(st.one_of(*map(messages, wire.ConsoleMessage.__args__)), max_size=4))
@settings(OTHERWISE, max_examples=150)
def test_whatever_the_console_may_order_is_carried_out_or_refused(said: list[wire.ConsoleMessage]) -> None:
    device_ordered(framed(*said))


def _spoiled(value: Any, harsh: object, at: list[int]) -> Any:
    """Put something harsh in the place of the ``at``-th value."""
    at[0] -= 1
    if at[0] == -1:
        return harsh
    if isinstance(value, dict):
        return {key: _spoiled(each, harsh, at) for key, each in value.items()}
    return [_spoiled(each, harsh, at) for each in value] if isinstance(value, list) else value


@pytest.mark.parametrize("message", [*UP, *DOWN], ids=lambda message: type(message).__name__)
def test_a_message_with_something_harsh_in_any_place_is_a_message_or_a_wire_error(message: Any) -> None:
    row = wire.MESSAGES[type(message)]
    decode: Callable[[bytes], Any] = wire.decode_from_device
    if row.direction is Direction.DOWN:
        decode = wire.decode_from_console
    plain = msgspec.msgpack.decode(wire.encode(message))
    refusals = list[str]()
    for harsh in HARSH:
        for place in range(1, 200):
            at = [place]
            spoiled = _spoiled(plain, harsh, at)
            if at[0] >= 0:
                break
            data = msgspec.msgpack.encode(spoiled)
            try:
                taken = decode(data)
            except WireError as error:
                refusals.append(str(error))
            else:
                assert decode(wire.encode(taken)) == taken
                assert re.search(r"\b(nan|inf)\b", repr(taken)) is None
    assert refusals
    assert all(each.endswith(".") for each in refusals)
    assert [each for each in refusals if FOREIGN.search(each) or UNSAID in each] == [], "each in our own words"


@pytest.mark.parametrize(
    "data",
    [
        b"\x92" * 100_000,
        b"\x81\xa4type" * 50_000,
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\xdb\xff\xff\xff\xff",
        b"\x82\xa4type\xa3say\xa4text\xd9\x02\xed\xa0",
        b"\x83\xa4type\xa3say\xa4text\xa1a\xa4text\xa1b" + b"\x00" * 3,
        b"\x82\xa4type\xa3say\xa4text\xc7\x04\x05xxxx",
        wire.encode(wire.Pause()) * 2,
        wire.encode(wire.Pause())[:-1],
    ],
    ids=["deep lists", "deep maps", "huge list", "huge map", "huge bytes", "huge text", "surrogate", "text and more",
         "extension", "two in one", "cut short"],
)  # fmt: skip
def test_what_only_claims_to_be_a_message_is_refused_at_once(data: bytes) -> None:
    for decode in (wire.decode_from_device, wire.decode_from_console, wire.decode_hello, wire.decode_welcome):
        with pytest.raises(WireError):
            decode(data)


def test_a_walker_at_the_end_of_the_world_is_still_in_the_overview() -> None:
    """A pose that no tree of edges could be asked about once ended everybody's Overview."""
    seen = wire.WalkerState(1000.0, "localized", "walk", "ok", pose=(1e12, -1e12, 1e12, -1e12))
    device_seen(framed(seen))
    for beyond in (1e308, float("nan"), float("inf")):
        with pytest.raises(WireError):
            wire.decode_from_device(msgspec.msgpack.encode(msgspec.structs.replace(seen, pose=(beyond, 0.0, 1.6, 0.0))))
    assert PlaceWords(GRAPH).at(1e12, -1e12)


def _declared(width_px: int, height_px: int) -> bytes:
    frame = b"\xff\xc0\x00\x11\x08" + height_px.to_bytes(2, "big") + width_px.to_bytes(2, "big") + b"\x03" + bytes(9)
    return b"\xff\xd8\xff\xe0\x00\x04ab\xff\xff" + frame + b"\xff\xd9"


def test_a_picture_is_judged_by_what_it_declares_before_there_is_room_for_it() -> None:
    refuse_picture(SEEDS["jpeg_header"][0])
    assert jpeg_size_px(SEEDS["jpeg_header"][0]) == (160, 120)
    assert jpeg_size_px(_declared(640, 480)) == (640, 480)
    refuse_picture(_declared(640, 480))
    bombs = [_declared(60_000, 60_000), _declared(65_535, 17), _declared(0, 0), _declared(640, 0)]
    others = [b"\x89PNG\r\n\x1a\n" + bytes(200), b"GIF89a", b"\xff\xd8", b"\xff\xd8\xff\xc4\x00\x00" * 3, b""]
    for data in (*bombs, *others):
        with pytest.raises(WireError):
            refuse_picture(data)


# --------------------------------------------------------------------------------------------------- the serial line
LINES = st.builds(SonarLine, st.integers(0, 2**32 - 1), st.just(SonarKind.ECHO), st.integers(1, 99_999))


@given(st.lists(LINES, min_size=2, max_size=6), st.data())
@settings(max_examples=200)
def test_of_a_stream_that_lost_bytes_and_gained_noise_only_what_was_sent_is_read(
    lines: list[SonarLine], data: st.DataObject
) -> None:
    stream = b"".join(encoded(line) for line in lines)
    for _ in range(data.draw(st.integers(1, 4))):
        first = data.draw(st.integers(0, len(stream)))
        last = data.draw(st.integers(first, min(len(stream), first + 60)))
        stream = stream[:first] + data.draw(st.binary(max_size=20)) + stream[last:]
    parser, read = LineParser(), list[SonarLine]()
    while stream:
        size = data.draw(st.integers(1, 64))
        read += parser.feed(stream[:size])
        stream = stream[size:]
    assert [line for line in read if line not in lines] == []
    assert parser.feed(b"\n" + encoded(lines[0]))[-1:] == [lines[0]], "it finds its way back within a line"


@given(st.binary(max_size=300))
def test_any_bytes_on_the_serial_line_give_what_was_sent_or_nothing(data: bytes) -> None:
    sonar_line(data)
