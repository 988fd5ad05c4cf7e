"""The site as one package for devices to fetch."""

from __future__ import annotations

import threading
from pathlib import Path

from console.errors import NotFoundError
from navcore.site import map_checksum, pack_site


class MapPackage:
    """Packs the site when it is first asked for, and keeps the bytes: what was offered is what is fetched."""

    def __init__(self, site_folder: Path) -> None:
        self._site_folder = site_folder
        self.checksum = map_checksum(site_folder)
        self._lock = threading.Lock()
        self._bytes: bytes | None = None

    @property
    def path(self) -> str:
        """Where a device fetches it."""
        return f"/api/device/map/{self.checksum}"

    def content(self) -> bytes:
        """Return the package. Raises SiteError where the site cannot be read."""
        with self._lock:
            if self._bytes is None:
                self._bytes = pack_site(self._site_folder)
            return self._bytes

    def named(self, checksum: str) -> bytes:
        """Return the package of this checksum. Raises NotFoundError for another."""
        if checksum != self.checksum:
            raise NotFoundError("This map is not offered any more: connect again to hear of the current one.")
        return self.content()
