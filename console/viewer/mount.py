"""The scene's page and its WebSocket inside the console's application, on the application's own origin.

======================  =====================================================================================
``GET /viewer/scene/``  the page (viser's client with a strict Content-Security-Policy); needs a session
``/viewer/scene``       its WebSocket: session cookie → person, Origin == Host, before it is accepted
======================  =====================================================================================

The client makes the WebSocket's address from its page's address without the last slash, hence the two paths.
"""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import urlencode

from fastapi import FastAPI, Request, Response, WebSocket
from fastapi.responses import RedirectResponse
from starlette.requests import HTTPConnection

from console.errors import TooManyError
from console.origin import is_same_origin
from console.roles import SignedIn
from console.sockets import TOO_MANY_CODE, SessionSockets
from console.viewer.embedded import SUBPROTOCOL, EmbeddedViser, client_html
from console.viewer.page import THEME_COOKIE, ScenePage, scene_page

PAGE_PATH = "/viewer/scene/"
SOCKET_PATH = "/viewer/scene"
_QUERY = frozenset({"fixedDpr"})
"""A coarser picture, for a computer that draws slowly."""
Authenticate = Callable[[HTTPConnection], SignedIn | None]
"""Returns who sent a request, from its session cookie; None for nobody."""


def mount(
    app: FastAPI,
    embedded: EmbeddedViser,
    authenticate: Authenticate,
    sockets: SessionSockets,
    *,
    session_url: str,
    sign_in_url: str,
) -> None:
    """Add the page and the WebSocket of the scene to the application."""
    page = scene_page(client_html(), "Virtual blind road", session_url, sign_in_url)

    @app.get(PAGE_PATH, include_in_schema=False)
    async def viewer_page(request: Request) -> Response:
        if authenticate(request) is None:
            return RedirectResponse(sign_in_url, status_code=303)
        query = plain_query(request)
        if query != request.url.query:
            return RedirectResponse(f"{PAGE_PATH}?{query}" if query else PAGE_PATH, status_code=303)
        return _page_response(page, request)

    @app.websocket(SOCKET_PATH)
    async def viewer_socket(socket: WebSocket) -> None:
        visitor = authenticate(socket)
        if visitor is None or not is_same_origin(socket) or SUBPROTOCOL not in socket.scope["subprotocols"]:
            # Before accept(): the browser gets a plain 403, and viser never hears of it.
            await socket.close(1008)
            return
        try:
            forget = sockets.add(visitor.session_id, lambda: embedded.close_session(visitor.session_id))
        except TooManyError as error:
            await socket.close(TOO_MANY_CODE, str(error))
            return
        try:
            await socket.accept(subprotocol=SUBPROTOCOL)
            await embedded.serve(socket, visitor, prefers_light=socket.cookies.get(THEME_COOKIE) == "light")
        finally:
            forget()


def plain_query(request: Request) -> str:
    """Return what of a query viser's client may read.

    It would show, in the place of our building, any scene that its query leads to, one that is within the query as
    well (``?playbackPath=data:…``): somebody who followed a link would see a walker who is not there.
    """
    return urlencode([(name, value) for name, value in request.query_params.multi_items() if name in _QUERY])


def _page_response(page: ScenePage, request: Request) -> Response:
    headers = {
        "Content-Security-Policy": page.content_security_policy,
        "Cache-Control": "private, no-cache",
        "ETag": page.etag,
        "Vary": "Accept-Encoding, Cookie",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
    }
    if request.headers.get("if-none-match") == page.etag:
        return Response(status_code=304, headers=headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(page.body_gzip, headers=headers | {"Content-Encoding": "gzip"}, media_type="text/html")
    return Response(page.body, headers=headers, media_type="text/html")
