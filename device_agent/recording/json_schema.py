"""JSON schemas of our values, in the few words that every viewer understands.

Foxglove reads references and alternatives; Lichtblick reads objects with properties, strings, numbers, truth values,
and lists of these, and shows nothing at all of a channel that has anything else in its schema. So references are
resolved; a value that may be absent has the schema of the value (null stands for "not known"); an enumeration is its
words; and what cannot be said in these words (a list of lists) is left out of the schema, though not of the messages.
"""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]
_SIMPLE = ("string", "number", "integer", "boolean")
_TOLD = ("description", "minimum", "maximum", "enum")
"""What is kept of the rest: people read it."""


def plain_schema(schema: Schema) -> Schema:
    """Return a schema as viewers understand it. Raises ValueError for one that is no object's."""
    plain = _plain(schema, schema.get("$defs", {}))
    if plain is None or plain["type"] != "object":
        raise ValueError("only objects are messages")
    return plain


def _plain(schema: Schema, definitions: dict[str, Schema]) -> Schema | None:
    """Return the schema in plain words; None where they do not suffice."""
    if "$ref" in schema:
        return _plain(definitions[str(schema["$ref"]).rpartition("/")[2]], definitions)
    if "anyOf" in schema:
        return _only({**schema, "anyOf": [each for each in schema["anyOf"] if each.get("type") != "null"]}, definitions)
    told = {key: schema[key] for key in _TOLD if key in schema}
    kind = schema.get("type") or _kind_of(schema.get("enum", []))
    if kind == "object":
        return {"type": "object", **told, "properties": _properties(schema.get("properties", {}), definitions)}
    if kind == "array":
        items = _items(schema, definitions)
        return None if items is None else {"type": "array", **told, "items": items}
    return {"type": kind, **told} if kind in _SIMPLE else None


def _only(schema: Schema, definitions: dict[str, Schema]) -> Schema | None:
    alternatives = schema["anyOf"]
    return _plain(alternatives[0], definitions) if len(alternatives) == 1 else None


def _properties(properties: dict[str, Schema], definitions: dict[str, Schema]) -> dict[str, Schema]:
    plain = {name: _plain(each, definitions) for name, each in properties.items()}
    return {name: each for name, each in plain.items() if each is not None}


def _items(schema: Schema, definitions: dict[str, Schema]) -> Schema | None:
    """Return the schema of a list's members, where they all have the same, and are no lists themselves."""
    members = schema.get("prefixItems") or [schema.get("items") or {}]
    plain = [_plain(each, definitions) for each in members]
    first = plain[0]
    return first if first is not None and first["type"] != "array" and all(each == first for each in plain) else None


def _kind_of(words: list[object]) -> str:
    if words and all(isinstance(word, str) for word in words):
        return "string"
    return "integer" if words and all(isinstance(word, int) for word in words) else ""
