"""The pages, and the files that they are made of: HTML, CSS and ES modules as they lie in ``static/``."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from fastapi.responses import FileResponse, PlainTextResponse, Response
from fastapi.staticfiles import StaticFiles

from console.roles import Role
from console.rules import RULES

PAGES = {
    "/signin": "signin.html",
    "/first": "first.html",
    "/": "console.html",
    "/overview": "overview.html",
    "/pois": "pois.html",
    "/versions": "versions.html",
    "/checks": "checks.html",
    "/rehearse": "rehearse.html",
    "/exchange": "exchange.html",
    "/privacy": "privacy.html",
    "/settings": "settings.html",
    "/alerts": "alerts.html",
    "/walks": "walks.html",
    "/map-walks": "map-walks.html",
    "/admin": "admin.html",
}


def pages_for(role: Role) -> list[str]:
    """Return the paths of the pages that somebody of this role may open, besides those for who is not signed in."""
    return [path for path in PAGES if RULES["GET", path].who == "people" and RULES["GET", path].permits(role)]


def is_page(path: str) -> bool:
    """Say whether a path is that of a page."""
    return path in PAGES


def refused_page() -> Response:
    """Return the page that stands where one is that the visitor's role does not open."""
    return FileResponse(static_folder() / "refused.html", status_code=403, media_type="text/html; charset=utf-8")


def missing_page() -> Response:
    """Return the page that stands at an address where nothing is."""
    return FileResponse(static_folder() / "missing.html", status_code=404, media_type="text/html; charset=utf-8")


def static_folder() -> Path:
    """Return where the pages lie: in the checkout, or installed beside the packages."""
    return Path(__file__).resolve().parent.parent / "static"


def add_routes(app: FastAPI) -> None:
    """Add the pages and their files."""
    folder = static_folder()
    for path, file in PAGES.items():
        app.add_api_route(path, _page(folder / file), methods=["GET"], include_in_schema=False)
    app.mount("/static", _Files(directory=folder), name="static")

    @app.get("/favicon.ico", include_in_schema=False)
    async def favicon() -> Response:
        return FileResponse(folder / "icon.svg", media_type="image/svg+xml")

    @app.get("/healthz", include_in_schema=False)
    async def healthz() -> Response:
        return PlainTextResponse("ok")


def _page(path: Path) -> Callable[[], Awaitable[Response]]:
    async def page() -> Response:
        return FileResponse(path, media_type="text/html; charset=utf-8")

    return page


class _Files(StaticFiles):
    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        response = super().file_response(*args, **kwargs)
        # The browser asks each time whether a file has changed; the answer is mostly "no" (ETag).
        response.headers["Cache-Control"] = "no-cache"
        return response
