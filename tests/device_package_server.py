"""A server of one package, for tests of what the device fetches; it notes what is asked of it."""

from __future__ import annotations

import hashlib
import http.server
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from navcore.site import map_checksum, pack_site
from navcore.wire import MapAvailable

TOKEN = "a-token-of-this-test"
PATH = "/maps/new"


class PackageServer(http.server.ThreadingHTTPServer):
    """Serves ``package``; answers ranges unless it knows none."""

    def __init__(self, package: bytes) -> None:
        self.package = package
        self.knows_ranges = True
        self.status = 200
        self.cuts_after_bytes: int | None = None
        """Each answer breaks off there."""
        self.asked: list[str] = []
        """The range of each request; empty where all was asked for."""
        super().__init__(("127.0.0.1", 0), _Handler)

    @property
    def url(self) -> str:
        """The address as a device is told it."""
        return f"ws://127.0.0.1:{self.server_address[1]}"


class _Handler(http.server.BaseHTTPRequestHandler):
    server: PackageServer

    def do_GET(self) -> None:
        server, wanted = self.server, self.headers.get("Range", "")
        server.asked.append(wanted)
        if self.headers["Authorization"] != f"Bearer {TOKEN}" or self.path != PATH or server.status != 200:
            self.send_error(404 if server.status == 200 else server.status)
            return
        etag = f'"{hashlib.sha256(server.package).hexdigest()}"'
        first = int(wanted[6:-1]) if wanted and server.knows_ranges and self.headers.get("If-Range") == etag else 0
        self.send_response(206 if first else 200)
        self.send_header("Content-Length", str(len(server.package) - first))
        if first:
            self.send_header("Content-Range", f"bytes {first}-{len(server.package) - 1}/{len(server.package)}")
        self.end_headers()
        last = None if server.cuts_after_bytes is None else first + server.cuts_after_bytes
        self.wfile.write(server.package[first:last])

    def log_message(self, format: str, *args: object) -> None:
        """Be quiet."""


@contextmanager
def serving_package(package: bytes) -> Iterator[PackageServer]:
    """Serve it until the block ends."""
    with PackageServer(package) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def offer_of(site: Path) -> tuple[MapAvailable, bytes]:
    """Return the offer of a site, and its package."""
    package = pack_site(site)
    return MapAvailable(PATH, map_checksum(site), len(package), hashlib.sha256(package).hexdigest()), package
