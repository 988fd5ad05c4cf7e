"""Whether a request says that it comes from a page of this very console."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.requests import HTTPConnection

_SECURE_SCHEMES = ("https", "wss")


def is_secure(connection: HTTPConnection) -> bool:
    """Whether a request came by TLS: to this process, or to the proxy in front that says so."""
    return connection.scope.get("scheme", "http") in _SECURE_SCHEMES


def is_same_origin(connection: HTTPConnection) -> bool:
    """Whether a request comes from a page of this very host; one without an Origin, or with half of one, does not.

    Over TLS the page must have come by TLS as well: what is sent in the clear can be changed on the way.
    """
    origin, host = connection.headers.get("origin", ""), connection.headers.get("host", "")
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    schemes = ("https",) if is_secure(connection) else ("http", "https")
    return bool(host) and parts.scheme in schemes and parts.netloc.lower() == host.lower()
