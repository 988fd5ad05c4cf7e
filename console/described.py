"""What the HTTP API is: an OpenAPI document, made from the routes, the types that check their bodies, and the rules.

It is made where it is wanted (``app.openapi()``), and is not served: whoever may not call a route need not know of it.
"""

from __future__ import annotations

from typing import Any

import msgspec
from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from console.errors import NoRoomError
from console.rules import RULES, Rule

_REF = "#/components/schemas/{name}"
_REFUSAL_SCHEMA = {
    "title": "Refusal",
    "type": "object",
    "required": ["error"],
    "properties": {"error": {"type": "string", "minLength": 1, "description": "One sentence: what is wrong."}},
}
_OF_FASTAPI = ("HTTPValidationError", "ValidationError")
"""What the framework would answer; here it is a refusal as any other."""
FILE_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
"""A body that is a file, or a piece of one."""


def json_body(kind: Any) -> dict[str, Any]:
    """Return how a route that reads this msgspec type by itself is described."""
    (schema,), parts = msgspec.json.schema_components([kind], ref_template="{name}")
    content = {"application/json": {"schema": _inlined(schema, parts)}}
    return {"requestBody": {"required": True, "content": content}}


def _inlined(schema: Any, parts: dict[str, Any]) -> Any:
    """Return a schema with its parts in it; no type of a body holds itself."""
    if isinstance(schema, list):
        return [_inlined(each, parts) for each in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return _inlined(parts[schema["$ref"]], parts)
    # What the discriminator names is in the alternatives themselves.
    return {key: _inlined(value, parts) for key, value in schema.items() if key != "discriminator"}


def answers_with(media_type: str) -> dict[int | str, dict[str, Any]]:
    """Return how a route is described that answers with a file."""
    content = {media_type: {"schema": {"type": "string", "format": "binary"}}}
    return {200: {"description": "The file.", "content": content}}


def _refusal(description: str) -> dict[str, Any]:
    schema = {"$ref": _REF.format(name="Refusal")}
    return {"description": description, "content": {"application/json": {"schema": schema}}}


NO_ROOM: dict[int | str, dict[str, Any]] = {NoRoomError.status: _refusal(str(NoRoomError.__doc__))}
"""How a route is described that needs the disk."""


def describe(app: FastAPI) -> None:
    """Have ``app.openapi()`` return the document: all routes of the API, with their bodies, answers and refusals."""

    def document() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app)
        return app.openapi_schema

    app.openapi = document  # type: ignore[method-assign]


def _document(app: FastAPI) -> dict[str, Any]:
    made = get_openapi(title=app.title, version=app.version, routes=app.routes)
    schemas = made.setdefault("components", {}).setdefault("schemas", {})
    for name in _OF_FASTAPI:
        schemas.pop(name, None)
    schemas["Refusal"] = _REFUSAL_SCHEMA
    made["components"]["securitySchemes"] = {
        "session": {"type": "apiKey", "in": "cookie", "name": "vbr_session_PORT"},
        "device": {"type": "http", "scheme": "bearer"},
    }
    for path, operations in made["paths"].items():
        for method, operation in operations.items():
            _complete(operation, RULES[method.upper(), path])
    return made


def _complete(operation: dict[str, Any], rule: Rule) -> None:
    answers = operation["responses"]
    answers.pop("422", None)
    answers["4XX"] = _refusal("Refused, and nothing is changed.")
    for content in (answer.get("content", {}) for code, answer in answers.items() if code.startswith("2")):
        for media_type, each in content.items():
            if media_type == "application/json":
                each["schema"] = {"type": "object"}
    operation["security"] = {"anyone": [], "people": [{"session": []}], "devices": [{"device": []}]}[rule.who]
