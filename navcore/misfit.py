"""What does not have the form that is due, told in our own words: which field, and what is expected there.

Two libraries check what enters, msgspec and pydantic. Each tells what is wrong in its own phrases, which are written
for programmers; of those that are not known here, only the field is told.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

_NO_FORM = "does not have the form that is due"
_SHOWN_LENGTH = 60
_KINDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "null": "null",
    "array": "a list",
    "object": "an object",
    "bytes": "bytes",
}
_PARTS = {"str": "character", "bytes": "byte", "array": "entry", "object": "entry"}
_BOUNDS = {
    ">=": "must be {} or more",
    ">": "must be more than {}",
    "<=": "must be {} or less",
    "<": "must be less than {}",
}

_PATTERNS = {
    r"^[A-Za-z0-9_-]+$": "must have no characters but letters, digits, - and _",
    r"^[0-9a-f]{64}\Z": "must be a SHA-256 as 64 hexadecimal digits",
    r"^[0-9a-f]*$": "must have no characters but hexadecimal digits",
    r"^[0-9]{2}:[0-9]{2}:[0-9]{2}$": "must be a time of day such as 14:05:00",
}
"""What each pattern stands for that a text has to match somewhere."""


# ------------------------------------------------------------------------------------------------------- of msgspec
_WHERE = re.compile(r"(.*) - at (`(?:key` in `)?\$[^`]*`)", re.DOTALL)


def words_of(error: Exception) -> str:
    """Return what is wrong with data that could not be read, as a part of a sentence: "name must be text"."""
    if isinstance(error, UnicodeDecodeError):
        return "it is no text in UTF-8"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if not isinstance(error, msgspec.MsgspecError):
        return str(error)
    found = _WHERE.fullmatch(str(error))
    told, where = found.groups() if found else (str(error), "")
    if isinstance(error.__cause__, ValueError | TypeError):
        # Raised by a type of ours: it has its own words.
        return str(error.__cause__)
    if not isinstance(error, msgspec.ValidationError):
        return _damage(told)
    if found := re.fullmatch(r"Object (missing required|contains unknown) field `(.*)`", told, re.DOTALL):
        field = ".".join(part for part in (_path(where), _plain(found[2])) if part)
        return f"{field} is {'missing' if found[1].startswith('missing') else 'not known here'}"
    return f"{_field(where)} {_expected(told)}"


def _damage(told: str) -> str:
    """Return what is wrong with what cannot even be taken apart."""
    for sign, words in (
        ("truncated", "it is cut off"),
        ("JSON", "it is no JSON"),
        ("MessagePack", "it is no MessagePack"),
    ):
        if sign in told:
            return words
    return f"it {_NO_FORM}"


def _path(where: str) -> str:
    """Return the field of ``$.a[0].b`` in backquotes, as people write it; empty for the whole."""
    found = re.search(r"`\$\.?([^`]*)`", where)
    return _plain(found[1]) if found else ""


def _field(where: str) -> str:
    path = _path(where)
    if where.startswith("`key`"):
        return f"a name in {path or 'it'}"
    if path.endswith("[...]"):
        return f"an entry of {path.removesuffix('[...]') or 'it'}"
    return re.sub(r"^\[(\d+)\]", r"entry \1", path) or "it"


def _expected(told: str) -> str:
    for pattern, words in _MSGSPEC:
        if found := pattern.match(told):
            return words(found)
    return _NO_FORM


def _a_kind(found: re.Match[str]) -> str:
    return f"must be {_one_of([_KINDS.get(kind, 'something else') for kind in found[1].split(' | ')])}"


def _a_length(found: re.Match[str]) -> str:
    least = found[2] in (">=", "at least")
    return _length_words(int(found[3]), least=least, exact=found[2] == "", part=_PARTS.get(found[1], "entry"))


_MSGSPEC: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], str]], ...] = (
    (re.compile(r"Expected `(\w+)` of length (>=|<=) (\d+)$"), _a_length),
    (re.compile(r"Expected `(array)` of (at least|at most|) ?length (\d+)(?:, got \d+| got \d+)?$"), _a_length),
    (
        re.compile(r"Expected `array` of length (\d+) to (\d+)"),
        lambda found: f"must have {found[1]} to {found[2]} entries",
    ),
    (re.compile(r"Expected `\w+` (>=|>|<=|<) (\S+)$"), lambda found: _BOUNDS[found[1]].format(_number(found[2]))),
    (re.compile(r"Expected `str` matching regex (.*)$"), lambda found: _pattern_words(ast.literal_eval(found[1]))),
    (re.compile(r"Expected `\w+` that's a multiple of (\S+)$"), lambda found: f"must be a multiple of {found[1]}"),
    (re.compile(r"Expected `([^`]+)`(?:, got `\w+`)?$"), _a_kind),
    (re.compile(r"Invalid (?:enum )?value (.*)$", re.DOTALL), lambda found: f"cannot be {_plain(found[1])}"),
    (re.compile(r"(?:Integer value|Number) out of range"), lambda found: "is a number beyond all that are taken"),
)


# ------------------------------------------------------------------------------------------------------ of pydantic
def field_and_words(errors: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Return what pydantic finds wrong with a request: in which field (empty for the whole), and "it must be text"."""
    first = errors[0]
    # The first part says whether it is the body, the query, or the path; the last of several is which kind was tried.
    place, kinds = first["loc"][1:], [each["loc"][-1] for each in errors if each["loc"][:-1] == first["loc"][:-1]]
    if len(kinds) > 1 and set(kinds) <= _KINDS.keys():
        return _dotted(place[:-1]), f"it must be {_one_of([_KINDS[kind] for kind in kinds])}"
    if first["type"] == "json_invalid":
        # What is said to be the place is how far it was read.
        return "", "it is no JSON"
    if first["type"] == "value_error":
        # Of a check of ours: it has its own words.
        return _dotted(place), str(first["ctx"]["error"]).removesuffix(".")
    return _dotted(place), f"it {_due(str(first['type']), first.get('ctx', {}))}"


def _dotted(place: Sequence[object]) -> str:
    return _plain(".".join(map(str, place)))


def _due(kind: str, context: Mapping[str, Any]) -> str:
    if kind in _PLAIN_WORDS:
        return _PLAIN_WORDS[kind]
    if kind in _BOUND_OF:
        sign, name = _BOUND_OF[kind]
        return _BOUNDS[sign].format(_number(context[name]))
    if kind == "string_pattern_mismatch":
        return _pattern_words(context["pattern"])
    if kind in ("literal_error", "enum"):
        return f"must be {context['expected']}"
    for ending, name in (("too_short", "min_length"), ("too_long", "max_length")):
        if kind.endswith(ending):
            part = "character" if kind.startswith("string") else "entry"
            return _length_words(int(context[name]), least=name == "min_length", exact=False, part=part)
    return _NO_FORM


_WORDS_OF_KINDS = {
    "must be text": ("string_type", "string_sub_type", "string_unicode"),
    "must be a whole number": ("int_type", "int_parsing", "int_from_float"),
    "must be a number": ("float_type", "float_parsing", "finite_number"),
    "must be true or false": ("bool_type", "bool_parsing"),
    "must be a list": ("list_type", "tuple_type"),
    "must be an object": ("dict_type", "model_type", "model_attributes_type", "mapping_type"),
    "is missing": ("missing",),
    "is not known here": ("extra_forbidden",),
    "is a number beyond all that are taken": ("int_parsing_size",),
}
_PLAIN_WORDS = {kind: words for words, kinds in _WORDS_OF_KINDS.items() for kind in kinds}
_BOUND_OF = {
    "greater_than_equal": (">=", "ge"),
    "greater_than": (">", "gt"),
    "less_than_equal": ("<=", "le"),
    "less_than": ("<", "lt"),
}


# -------------------------------------------------------------------------------------------------------- of both
def _length_words(length: int, *, least: bool, exact: bool, part: str) -> str:
    if least and length == 1:
        return "must not be empty"
    parts = part if length == 1 else {"entry": "entries"}.get(part, f"{part}s")
    return f"must have {'' if exact else 'at least ' if least else 'at most '}{length} {parts}"


def _pattern_words(pattern: str) -> str:
    return _PATTERNS.get(pattern, _NO_FORM)


def _one_of(words: Sequence[str]) -> str:
    *others, last = dict.fromkeys(words)
    return f"{', '.join(others)} or {last}" if others else last


def _number(value: object) -> str:
    """Return a bound as people write it: 0, and not 0.0."""
    return str(value).removesuffix(".0")


def _plain(text: str) -> str:
    """Return what somebody sent as it may stand in a sentence."""
    plain = "".join(char if char.isprintable() else " " for char in text[: _SHOWN_LENGTH + 1])
    return plain if len(plain) <= _SHOWN_LENGTH else f"{plain[: _SHOWN_LENGTH - 1]}…"
