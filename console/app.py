"""The console as an ASGI application: pages, API, the stream to the pages, and the link to the devices.

What is added to it later (the 3D scene) stands behind the same guard, and needs a line in :mod:`console.rules`.
"""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from sqlalchemy.exc import OperationalError
from starlette.exceptions import HTTPException

from console import (
    alerts_socket,
    api_accounts,
    api_alerts,
    api_checks,
    api_devices,
    api_exchange,
    api_graph,
    api_past_view,
    api_privacy,
    api_recordings,
    api_rehearsal,
    api_road,
    api_settings,
    api_versions,
    api_walks,
    api_what_if,
    device_link,
    live_socket,
    overview_socket,
    pages,
)
from console.described import describe
from console.errors import BadRequestError, ConsoleError, NotFoundError
from console.security import Guard, error_response
from console.services import Services
from console.storage_trouble import refusal_of
from navcore.errors import VbrError
from navcore.misfit import field_and_words, words_of

_log = logging.getLogger(__name__)
_ROUTES = (
    alerts_socket,
    api_accounts,
    api_alerts,
    api_checks,
    api_devices,
    api_exchange,
    api_graph,
    api_past_view,
    api_privacy,
    api_recordings,
    api_rehearsal,
    api_road,
    api_settings,
    api_versions,
    api_walks,
    api_what_if,
    device_link,
    live_socket,
    overview_socket,
)


def app_of(services: Services) -> FastAPI:
    """Return the application over parts that are put together already; ``app.state.services`` holds them."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        yield
        services.sockets.close_all()

    app = FastAPI(
        title="Virtual blind road: console",
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        lifespan=lifespan,
    )
    app.state.services = services
    app.add_middleware(Guard, services=services)
    app.add_exception_handler(VbrError, _refused)
    app.add_exception_handler(OperationalError, _failed)
    app.add_exception_handler(OSError, _failed)
    app.add_exception_handler(RequestValidationError, _unfit)
    app.add_exception_handler(HTTPException, _http_error)
    for module in _ROUTES:
        module.add_routes(app, services)
    pages.add_routes(app)
    describe(app)
    return app


async def _refused(request: Request, error: Exception) -> Response:
    return error_response(error if isinstance(error, ConsoleError) else BadRequestError(str(error)))


async def _failed(request: Request, error: Exception) -> Response:
    """The disk or the database takes nothing just now."""
    refusal = refusal_of(error)
    if refusal is None:
        raise error
    _log.error("%s %s is refused (%s)", request.method, request.url.path, error)
    return error_response(refusal)


async def _unfit(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    field, why = field_and_words(error.errors())
    return error_response(BadRequestError(f"{field or 'The request'} cannot be used: {why}."))


def _is_opened_in_browser(request: Request) -> bool:
    """Whether somebody has opened an address, and it is no script of a page, or another program, that asks."""
    wants_page = request.method == "GET" and "text/html" in request.headers.get("accept", "")
    return wants_page and not request.url.path.startswith("/api/")


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if isinstance(error.__cause__, ConsoleError):
        # Whatever is raised while a body comes, the framework calls it a body that cannot be read.
        return error_response(error.__cause__)
    if isinstance(error.__cause__, UnicodeDecodeError | RecursionError):
        return error_response(BadRequestError(f"The request cannot be used: {words_of(error.__cause__)}."))
    if error.status_code == 404:
        if _is_opened_in_browser(request):
            return pages.missing_page()
        return error_response(NotFoundError("There is nothing at this address."))
    if error.status_code == 405:
        sentence = f"This address cannot be asked by {request.method}: the page knows how."
        return JSONResponse({"error": sentence}, 405, headers=error.headers)
    return JSONResponse({"error": f"{error.detail}."}, error.status_code, headers=error.headers)
