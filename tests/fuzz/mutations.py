"""How files are spoiled: by what their form says matters, with whatever source of chance is given.

A source is a :class:`random.Random`: hypothesis has one whose choices it can make smaller, ``.ci/fuzz`` a seeded one.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from fuzz.bundle import bundled_list, unbundled

Mutation = Callable[[bytes, Random], bytes]

DEEP_COUNT = 100_000
NUMBERS = (
    b"0", b"-1", b"1", b"2147483648", b"4294967295", b"9223372036854775807", b"9223372036854775808",
    b"-9223372036854775809", b"18446744073709551616", b"1e400", b"-1e308", b"1e308", b"1e-320", b"NaN", b"nan", b"inf",
    b"-Infinity", b"0.5", b"1_0", b"0x10", b"1e9", b"9" * 4301, b"\xd9\xa3", b"true", b"null", b"",
)  # fmt: skip
"""What stands in place of a number: limits of types, what is no number, digits of another script."""
TEXTS = (
    b"", b"../x", b"/etc/x", b"C:\\\\x", b"..", b".", b"a/b/c/d", b"\\u0000", b"\x00", b"\\ud800", b"\xff\xfe",
    b"\x1b[2J", b"\\u202e", b"x" * 5000, b"NaN", b"\\n", b"con", b"~", b"&amp;", b"&#0;", b"]]>",
)  # fmt: skip
"""What stands in place of a text: names that lead elsewhere, what is no character, what turns a terminal's head."""
WORDS = (
    *(struct.pack(form, value) for form in ("<I", ">I", "<Q", ">Q", "<d", "<f") for value in (1, 2**31, 2**32 - 1)),
    *(bytes(count) for count in (1, 2, 4, 8)), *(b"\xff" * count for count in (1, 2, 4, 8)), b"\x7f" + b"\xff" * 7,
    struct.pack("<d", float("nan")), struct.pack("<f", float("inf")),
)  # fmt: skip
"""What stands in place of some bytes: counts and lengths, in either order."""
_JSON_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 2**31, 2**63, 2**64, -(2**63) - 1, 10**400, 1e308, -1e308, 1e-320, float("nan"), float("inf"),
    "", "x", "../x", "\x00", "\ud800", "\x1b[2J", "x" * 5000, "2026", [], {}, [[]], [None] * 300, {"": {}}, {"a": 1},
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_QUOTED = re.compile(rb'"(?:[^"\\]|\\.)*"')
_WORD = re.compile(rb"[^\s,;=<>\"]+")


# --------------------------------------------------------------------------------------------------- by bytes
def _cut(data: bytes, random: Random) -> bytes:
    return data[: random.randint(0, len(data))]


def _flip(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(random.randint(1, 4)):
        if changed:
            changed[random.randrange(len(changed))] = random.randrange(256)
    return bytes(changed)


def _span(data: bytes, random: Random, longest: int = 64) -> tuple[int, int]:
    begin = random.randint(0, len(data))
    return begin, min(len(data), begin + random.randint(0, longest))


def _repeat(data: bytes, random: Random) -> bytes:
    begin, end = _span(data, random, 200)
    return data[:end] + data[begin:end] * random.choice((1, 2, 50)) + data[end:]


def _leave_out(data: bytes, random: Random) -> bytes:
    begin, end = _span(data, random, 200)
    return data[:begin] + data[end:]


def _move(data: bytes, random: Random) -> bytes:
    begin, end = _span(data, random)
    to = random.randint(0, len(data))
    return data[:to] + data[begin:end] + data[to:]


def _overwrite(data: bytes, random: Random) -> bytes:
    word = random.choice(WORDS)
    at = random.randint(0, max(0, len(data) - len(word)))
    return data[:at] + word + data[at + len(word) :]


def _turn_round(data: bytes, random: Random) -> bytes:
    """Swap the order of the bytes of a number: a machine of the other kind has written it."""
    size = random.choice((2, 4, 8))
    at = random.randint(0, max(0, len(data) - size))
    return data[:at] + data[at : at + size][::-1] + data[at + size :]


# ---------------------------------------------------------------------------------------------------- by text
def _replaced(data: bytes, random: Random, what: re.Pattern[bytes], by: Sequence[bytes], mark: bytes = b"") -> bytes:
    found = list(what.finditer(data))
    if not found:
        return _overwrite(data, random)
    place = random.choice(found)
    return data[: place.start()] + mark + random.choice(by) + mark + data[place.end() :]


def _number(data: bytes, random: Random) -> bytes:
    return _replaced(data, random, _NUMBER, NUMBERS)


def _text(data: bytes, random: Random) -> bytes:
    return _replaced(data, random, _QUOTED, TEXTS, b'"')


def _word(data: bytes, random: Random) -> bytes:
    return _replaced(data, random, _WORD, (*TEXTS, *NUMBERS))


def _lines(data: bytes, random: Random) -> bytes:
    lines = data.splitlines(keepends=True)
    if not lines:
        return b"\n"
    at = random.randrange(len(lines))
    match random.randrange(4):
        case 0:
            lines.insert(random.randint(0, len(lines)), lines[at])
        case 1:
            del lines[at]
        case 2:
            other = random.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        case _:
            lines[at] = lines[at].rstrip(b"\n") + b" " + random.choice(NUMBERS) + b"\n"
    return b"".join(lines)


def _encoding(data: bytes, random: Random) -> bytes:
    text = data.decode("utf-8", "replace")
    match random.randrange(5):
        case 0:
            return b"\xef\xbb\xbf" + data
        case 1:
            return data.replace(b"\n", b"\r\n")
        case 2:
            return text.encode(random.choice(("utf-16", "utf-32", "utf-16-be")))
        case 3:
            return text.encode("latin-1", "replace")
        case _:
            return data.replace(b"\n", random.choice((b"\r", b"\x0b", b"\x85", "\u2028".encode(), b"\x00")))


def _deep(data: bytes, random: Random) -> bytes:
    at = random.choice([place.start() for place in _WORD.finditer(data)] or [0])
    opening, closing = random.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"<a>", b"</a>"), (b"(", b")"), (b"\x91", b"")))
    count = random.choice((3, 200, 1200, DEEP_COUNT))
    return data[:at] + opening * count + (closing * count if random.randrange(2) else b"") + data[at:]


# ---------------------------------------------------------------------------------------------------- by JSON
def _json(data: bytes, random: Random) -> bytes:
    """Change one value of a JSON text (or of one of its lines), whatever it is."""
    lines = data.split(b"\n") if data.count(b"\n{") else [data]
    at = random.randrange(len(lines))
    try:
        value = json.loads(lines[at])
        lines[at] = json.dumps(_changed(value, random)).encode("utf-8", "surrogatepass")
    except (ValueError, RecursionError):
        return _number(data, random)
    return b"\n".join(lines)


def _changed(value: Any, random: Random) -> Any:
    if not value or not isinstance(value, (dict, list)) or not random.randrange(8):
        return random.choice(_JSON_VALUES)
    keys: Any = list(value) if isinstance(value, dict) else range(len(value))
    key = random.choice(keys)
    copy = value.copy()
    match random.randrange(10):
        case 0:
            del copy[key]
        case 1 if isinstance(copy, dict):
            copy[random.choice(("", "x", "../x", "\x00", "\ud800", key + " "))] = copy.pop(key)
        case 1:
            copy.insert(key, copy[key])
        case 2:
            copy[key] = copy[random.choice(keys)]
        case _:
            copy[key] = _changed(copy[key], random)
    return copy


# -------------------------------------------------------------------------------------------------- by bundles
_NAMES = (
    "../x",
    "/etc/x",
    "a/b/c",
    "x\x00y",
    "C:\\x",
    "",
    ".",
    "..",
    "x" * 300,
    "a\udcffb",
    "camera.json/x",
    "MAP/x",
)


def _bundle(data: bytes, random: Random) -> bytes:
    files = unbundled(data)
    if not files:
        return _flip(data, random)
    at = random.randrange(len(files))
    name, content = files[at]
    match random.randrange(10):
        case 0:
            del files[at]
        case 1:
            files[at] = random.choice((*_NAMES, random.choice(files)[0])), content
        case 2:
            files.append((name, random.choice(files)[1]))
        case 3:
            files[at] = name, random.choice(files)[1]
        case _:
            how = random.choice(_FORMS[_form_of(content)])
            files[at] = name, how(content, random)
    return bundled_list(files)


def _form_of(content: bytes) -> str:
    if content.startswith((b"{", b"[")):
        return "json"
    return "lines" if content.isascii() and content.count(b"\x00") == 0 else "binary"


_BYTES: tuple[Mutation, ...] = (_cut, _flip, _repeat, _leave_out, _move, _overwrite, _turn_round)
_FORMS: dict[str, tuple[Mutation, ...]] = {
    "binary": (*_BYTES, _overwrite, _turn_round, _number, _word),
    "lines": (_cut, _flip, _leave_out, _number, _number, _word, _word, _lines, _lines, _encoding, _deep, _json),
    "json": (_cut, _flip, _json, _json, _json, _json, _number, _text, _encoding, _deep, _repeat),
    "xml": (_cut, _flip, _number, _text, _word, _lines, _lines, _encoding, _deep, _repeat, _move),
    "bundle": (_bundle, _bundle, _bundle, _bundle, _bundle, _flip, _cut),
}


def spoiled(data: bytes, form: str, random: Random) -> bytes:
    """Return a file of a form with one to three faults in it."""
    for _ in range(random.choice((1, 1, 2, 3))):
        data = random.choice(_FORMS[form])(data, random)
    return data
