"""The form of what a browser may send to the scene: viser's own types, which viser does not check.

A message of another form would end its window with a traceback in the log, some of them once for each message.
"""

from __future__ import annotations

import dataclasses
import sys
import types
import typing
from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
import viser._messages as viser_messages

from console.viewer.guard import EDITING, LOOKING

_Number = Annotated[float, msgspec.Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
"""Finite. Browsers do not tell whole numbers from others."""


def has_form(raw: bytes) -> bool:
    """Say whether a message that may be sent has the fields that viser gives it, each of its type."""
    try:
        form = _FORMS.get(_type_decoder.decode(raw).type)
        if form is not None:
            form.decode(raw)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return False
    return form is not None


class _Typed(msgspec.Struct):
    type: str


_type_decoder = msgspec.msgpack.Decoder(_Typed)


def _checked(hint: Any) -> Any:
    """Return the type to check a field by."""
    if hint in (int, float):
        return _Number
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple and parts[-1] is ...:
        # Viser reads the first of what may be many.
        return Annotated[tuple[_checked(parts[0]), ...], msgspec.Meta(min_length=1)]  # type: ignore[misc]
    if origin is tuple:
        return tuple[tuple(map(_checked, parts))]  # type: ignore[misc]
    if origin in (typing.Union, types.UnionType):
        return typing.Union[tuple(map(_checked, parts))]  # noqa: UP007  # made of parts
    return hint


def _form_of(name: str) -> msgspec.msgpack.Decoder[Any]:
    kind = getattr(viser_messages, name)
    hints = typing.get_type_hints(kind)
    fields: list[Any] = [("type", str)]
    for each in dataclasses.fields(kind):
        form = _checked(hints[each.name])
        fields.append((each.name, form) if each.default is dataclasses.MISSING else (each.name, form | None, None))
    return msgspec.msgpack.Decoder(msgspec.defstruct(name, fields, forbid_unknown_fields=True, kw_only=True))


_FORMS: Mapping[str, msgspec.msgpack.Decoder[Any]] = {name: _form_of(name) for name in LOOKING | EDITING}
