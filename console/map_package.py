"""The site as one package for devices to fetch: a file that is named by its contents."""

from __future__ import annotations

import hashlib
import os
import threading
from dataclasses import dataclass
from pathlib import Path

from console.errors import NotFoundError
from navcore.errors import SiteError
from navcore.site import map_checksum, pack_site


@dataclass(frozen=True, slots=True)
class PackedMap:
    """A package as it is offered."""

    file: Path
    sha256: str
    """Of the file; also the name under which it is fetched."""
    size_bytes: int

    @property
    def path(self) -> str:
        """Where a device fetches it."""
        return f"/api/device/map/{self.sha256}"


class MapPackage:
    """Packs the site when it is first asked for, and keeps the file: what was offered is what is fetched.

    The same site and places give the same bytes, so a download that was cut off goes on over restarts of the console.
    """

    def __init__(self, site_folder: Path, package_folder: Path) -> None:
        """``package_folder`` is made when it is needed, and holds nothing else."""
        self._site_folder = site_folder
        self._package_folder = package_folder
        self.checksum = map_checksum(site_folder)
        """Of the map that this console serves."""
        self._lock = threading.Lock()
        self._packed: PackedMap | None = None

    def packed(self) -> PackedMap:
        """Return the package. Raises SiteError where there is none to offer."""
        with self._lock:
            if self._packed is None:
                self._packed = self._pack()
            return self._packed

    def named(self, sha256: str) -> PackedMap:
        """Return the package of these contents. Raises NotFoundError for another."""
        packed = self.packed()
        if sha256 != packed.sha256:
            raise NotFoundError("This map is not offered any more: connect again to hear of the current one.")
        return packed

    def _pack(self) -> PackedMap:
        data = pack_site(self._site_folder)
        if map_checksum(self._site_folder) != self.checksum:
            raise SiteError("The site's map was changed since the console started: start the console again.")
        sha256 = hashlib.sha256(data).hexdigest()
        file = self._package_folder / f"{sha256}.zip"
        try:
            self._package_folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            _write_instead_of_others(file, data)
        except OSError as error:
            raise SiteError(
                f"The map cannot be packed into {file.parent} ({error.strerror}): free the disk."
            ) from error
        return PackedMap(file, sha256, len(data))


def _write_instead_of_others(file: Path, data: bytes) -> None:
    for old in file.parent.iterdir():
        old.unlink()
    fresh = file.with_suffix(".new")
    fresh.write_bytes(data)
    os.replace(fresh, file)
