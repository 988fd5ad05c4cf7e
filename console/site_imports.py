"""Sites that come in as an archive: each becomes a new folder beside the maps that are built here, never over another.

::

    FOLDER/
      NAME-ID-1/        an imported site;  NAME-ID-2: the same archive, imported again
      .importing-…/     the one that is coming in; cleared away where the console ended meanwhile
"""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from console.errors import ConflictError, NoRoomError
from console.map_builds import free_place
from console.recordings import RESERVE_BYTES, plain_name
from navcore.folder_swap import sync_path
from navcore.site_archive import ArchiveManifest, unpack_site_archive
from navcore.site_files import write_whole

_PREFIX = ".importing-"
_REQUEST_FILE = ".request"


class SiteImports:
    """Takes archives in, one at a time. All methods may be called from any thread."""

    def __init__(
        self, folder: Path, free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free
    ) -> None:
        """``folder`` is made when it is needed; ``free_bytes`` tells the room on its disk."""
        self.folder, self._free_bytes = folder, free_bytes
        self._busy = threading.Lock()
        for work in folder.glob(f"{_PREFIX}*"):
            shutil.rmtree(work, ignore_errors=True)

    @contextmanager
    def receiving(self, size_bytes: int) -> Iterator[Path]:
        """Give a file to write an archive of about this size to; it is gone afterwards, whatever has become of it.

        Raises ConflictError while another comes in, NoRoomError.
        """
        if not self._busy.acquire(blocking=False):
            raise ConflictError("Another site is being imported: try again when it is done.")
        try:
            work = self._work_folder(size_bytes)
            try:
                yield work / "archive.zip"
            finally:
                shutil.rmtree(work, ignore_errors=True)
        except OSError as error:
            raise NoRoomError(
                f"The site cannot be kept on the console's machine ({error.strerror}): free its disk."
            ) from error
        finally:
            self._busy.release()

    def keep(self, archive: Path, request: str = "") -> tuple[Path, ArchiveManifest]:
        """Make a received archive into a site; return where it is. Raises SiteError; nothing is kept then.

        ``request`` is the key of the request: the site that it has made already is not made again.
        """
        site = archive.with_name("site")
        manifest = unpack_site_archive(archive, site)
        if request:
            for known in self.folder.glob(f"*/{_REQUEST_FILE}"):
                if known.read_text(encoding="utf-8") == request:
                    return known.parent.resolve(), manifest
            # Within the site, so that both come to their place in one step.
            write_whole(site / _REQUEST_FILE, request.encode())
        name = f"{plain_name(manifest.name, 'site')}-{manifest.id[:8]}"
        target = free_place(self.folder, name)
        os.rename(site, target)
        sync_path(self.folder)
        return target.resolve(), manifest

    def _work_folder(self, size_bytes: int) -> Path:
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if self._free_bytes(self.folder) < size_bytes + RESERVE_BYTES:
            raise NoRoomError(
                f"There is no room for this site on the console's machine ({size_bytes >> 20} MiB, and"
                f" {RESERVE_BYTES >> 20} MiB that stay free): free its disk."
            )
        return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=self.folder))
