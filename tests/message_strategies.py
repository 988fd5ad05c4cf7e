"""Any message of the wire, for properties: made from the messages' own types, so that no field is forgotten."""

from __future__ import annotations

from typing import Any

import msgspec
from hypothesis import strategies as st
from msgspec import inspect


def messages(kind: type[msgspec.Struct]) -> st.SearchStrategy[Any]:
    """Return a strategy for one kind of message: everything that its types allow, at moderate lengths."""
    return _struct(inspect.type_info(kind))  # type: ignore[arg-type]


def _struct(info: inspect.StructType) -> st.SearchStrategy[Any]:
    return st.builds(info.cls, **{field.name: _value(field.type) for field in info.fields})


def _value(info: inspect.Type) -> st.SearchStrategy[Any]:  # noqa: C901  # one line for each type there is
    match info:
        case inspect.StructType():
            return _struct(info)
        case inspect.IntType():
            low, high = info.ge, info.le
            return st.integers(-(1 << 63) if low is None else low, (1 << 63) - 1 if high is None else high)
        case inspect.FloatType():
            return st.floats(info.ge, info.le, allow_nan=False)
        case inspect.StrType():
            return _text(info)
        case inspect.BytesType():
            return st.binary(max_size=min(info.max_length or 50, 50))
        case inspect.BoolType():
            return st.booleans()
        case inspect.NoneType():
            return st.none()
        case inspect.LiteralType():
            return st.sampled_from(info.values)
        case inspect.EnumType():
            return st.sampled_from(info.cls)
        case inspect.UnionType():
            return st.one_of(*map(_value, info.types))
        case inspect.VarTupleType():
            return st.lists(_value(info.item_type), max_size=3).map(tuple)
        case inspect.TupleType():
            return st.tuples(*map(_value, info.item_types))
        case inspect.DictType():
            return st.dictionaries(_value(info.key_type), _value(info.value_type), max_size=3)
        case _:
            raise AssertionError(f"no strategy for {info}")


def _text(info: inspect.StrType) -> st.SearchStrategy[str]:
    longest = min(info.max_length or 80, 80)
    if info.pattern is not None:
        # "$" would let a line end follow.
        return st.from_regex(info.pattern.replace("$", r"\Z")).filter(lambda text: len(text) <= longest)
    return st.text(st.characters(exclude_categories=["Cs"]), min_size=info.min_length or 0, max_size=longest)
