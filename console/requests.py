"""What the routes take from a request besides its body."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from fastapi import Depends, Header, Response
from starlette.requests import HTTPConnection

from console.errors import SignInError
from console.origin import is_secure
from console.roles import SignedIn
from console.security import visitor_of


def signed_in(connection: HTTPConnection) -> SignedIn:
    """Return who asks. Raises SignInError where the rules let nobody in who is not signed in, and yet nobody is."""
    visitor = visitor_of(connection)
    if visitor is None:
        raise SignInError("Sign in first.")
    return visitor


Visitor = Annotated[SignedIn, Depends(signed_in)]
RequestKey = Annotated[str, Header(alias="Idempotency-Key", max_length=64)]
"""Names a request that is asked again where its answer did not come, so that it is not done twice; empty for none."""


def json_response(value: Any, status_code: int = 200) -> Response:
    """Return values (frozen dataclasses, messages, plain data) as JSON."""
    return Response(msgspec.json.encode(value), status_code, media_type="application/json")


def link_to(connection: HTTPConnection, token: str) -> str:
    """Return the address of a one-time link, on the host by which this console was reached."""
    scheme = "https" if is_secure(connection) else "http"
    return f"{scheme}://{connection.headers.get('host', '')}/first?token={token}"
