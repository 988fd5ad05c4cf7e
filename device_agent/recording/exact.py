"""Values as bytes and back, to the last bit: frozen dataclasses, message structs, arrays, and numbers of every kind.

msgpack by the types of the values, so that a field that a later version adds gets its default, and one that it no
longer has is passed over. Arrays keep their type, their shape and their order in memory, for the last bit of a matrix
product can hang on the order. Nothing is unpickled, and no array is made that its bytes do not fill.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import cache
from typing import Any, TypeVar, cast, get_origin

import msgspec
import numpy as np

from navcore.errors import InputError, SettingError
from navcore.settings import Settings

T = TypeVar("T")
_ARRAY_KINDS = "fiub"
"""Floating-point and whole numbers, and truth values: no objects, no text."""


_UNREADABLE = (
    msgspec.MsgspecError, SettingError, ValueError, TypeError, KeyError, OverflowError, SyntaxError, RecursionError,
)  # fmt: skip
"""SyntaxError and OverflowError are NumPy's, for types and shapes that are none."""


def encode(value: object) -> bytes:
    """Return the value as msgpack. Raises TypeError for what is no plain value."""
    return _encoder.encode(value)


def decode(data: bytes, kind: type[T]) -> T:
    """Return the value of a type from what :func:`encode` made of it. Raises InputError."""
    try:
        return cast(T, _decoder(cast(Hashable, kind)).decode(data))
    except _UNREADABLE as error:
        raise InputError(
            f"A value of the recording cannot be read ({error}): use the version of the program that recorded it."
        ) from error


def same(one: object, other: object) -> bool:
    """Return whether two values are the same to the last bit; NaN is the same as NaN."""
    return encode(one) == encode(other)


@cache
def _decoder(kind: Hashable) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(kind, dec_hook=_from_plain)


def _to_plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        order = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
        return value.dtype.str, order, value.shape, value.tobytes(order)  # type: ignore[arg-type]  # "C" or "F"
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Settings):
        return value.values()
    raise TypeError(f"a {type(value).__name__} is no plain value")


def _from_plain(kind: type[Any], plain: Any) -> object:
    if kind is Settings:
        if not isinstance(plain, dict):
            raise TypeError("settings are given by name")
        return Settings().changed(plain)
    if (get_origin(kind) or kind) is not np.ndarray:
        raise TypeError(f"{kind} cannot be read from a recording")
    dtype_name, order, shape, data = plain
    dtype = np.dtype(dtype_name)
    if dtype.kind not in _ARRAY_KINDS or order not in ("C", "F"):
        raise ValueError("an array of an unknown kind")
    # A copy, for what is read from bytes cannot be written to, and some of the loop's arrays are.
    return np.frombuffer(data, dtype).reshape(shape, order=order).copy(order=order)


_encoder = msgspec.msgpack.Encoder(enc_hook=_to_plain)
