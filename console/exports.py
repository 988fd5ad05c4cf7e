"""Files to download: the site, its PoI-graph, cloud and road, each made on the disk first and sent from there.

So what cannot be made is an error before anything is sent, the length is known, and memory stays small. The file has
no name: nothing is left behind, whoever ends in the middle.
"""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO, cast

from console.errors import ConflictError, NoRoomError, NotFoundError
from console.model import SiteModel
from console.recordings import RESERVE_BYTES, plain_name
from navcore import pcd_files, ply_files
from navcore.graph_import import GRAPH_FORMS
from navcore.recording import trajectory_lines
from navcore.road_trajectory import COMMENT, road_poses
from navcore.site_archive import write_site_archive
from navcore.site_files import read_manifest

MAX_MAKING_COUNT = 2
"""More files are not made at a time."""
_PIECE_BYTES = 256 << 10
_POINT_BYTES = 16


@dataclass(frozen=True, slots=True)
class ExportedFile:
    """A file that was made: open, and gone when it is closed."""

    name: str
    """Letters, digits, hyphens, dots: safe in any header and on any disk."""
    media_type: str
    file: BinaryIO
    size_bytes: int

    def pieces(self) -> Iterator[bytes]:
        """Read it once, and close it."""
        with self.file:
            while piece := self.file.read(_PIECE_BYTES):
                yield piece


@dataclass(frozen=True, slots=True)
class _Form:
    stem: str
    media_type: str
    write: Callable[[BinaryIO], object]
    version: int
    at_most_bytes: int = 0


class Exports:
    """Makes the files. All methods may be called from any thread."""

    def __init__(
        self,
        model: SiteModel,
        site_folder: Path,
        work_folder: Path,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        """``work_folder`` is on the disk where files are made; ``free_bytes`` tells the room there."""
        self._model, self._site_folder, self._work_folder = model, site_folder, work_folder
        self._free_bytes = free_bytes
        self._making = threading.BoundedSemaphore(MAX_MAKING_COUNT)

    def make(self, what: str, *, published: bool = False) -> ExportedFile:
        """Make ``site.zip``, ``graph.geojson``, ``graph.graphml``, ``cloud.ply``, ``cloud.pcd`` or ``road.tum``.

        Graph and road are the draft's, or the published one's; the archive has the published graph, as devices get it.
        Raises NotFoundError, SiteError, ConflictError while others are being made, NoRoomError.
        """
        form = self._forms(published).get(what)
        if form is None:
            raise NotFoundError(f"There is no such file: choose one of {', '.join(self._forms(False))}.")
        if self._free_bytes(self._work_folder) < form.at_most_bytes + RESERVE_BYTES:
            raise NoRoomError("There is no room to make this file on the console's machine: free its disk.")
        if not self._making.acquire(blocking=False):
            raise ConflictError("Other files are being made: try again in a moment.")
        try:
            return self._made(form, what.rpartition(".")[2])
        except OSError as error:
            raise NoRoomError(
                f"The file cannot be made on the console's machine ({error.strerror}): free its disk."
            ) from error
        finally:
            self._making.release()

    def _made(self, form: _Form, ending: str) -> ExportedFile:
        file = cast("BinaryIO", tempfile.TemporaryFile(dir=self._work_folder))  # noqa: SIM115  # closed when it is sent
        try:
            form.write(file)
            size_bytes = file.tell()
            file.seek(0)
        except BaseException:
            file.close()
            raise
        name = f"{plain_name(self._model.site.name, 'site')}-{form.stem}-v{form.version}.{ending}"
        return ExportedFile(name, form.media_type, file, size_bytes)

    def _forms(self, published: bool) -> Mapping[str, _Form]:
        site = self._model.site
        graph = self._model.published if published else self._model.graph
        roads_m = [road.points_m for road in graph.roads.values()]
        cloud = site.cloud_points_m, site.cloud_colours_rgb
        cloud_bytes = len(site.cloud_points_m) * _POINT_BYTES
        version, published_version = graph.version, self._model.published.version

        def write_graph(ending: str, out: BinaryIO) -> None:
            out.write(GRAPH_FORMS[ending](graph, site.site_id, site.name))

        def write_road(out: BinaryIO) -> None:
            out.writelines(line.encode() for line in trajectory_lines(road_poses(roads_m), COMMENT))

        return {
            "site.zip": _Form(
                "site", "application/zip", partial(write_site_archive, self._site_folder), published_version,
                sum(entry.size for entry in read_manifest(self._site_folder).files.values()),
            ),
            "graph.geojson": _Form("graph", "application/geo+json", partial(write_graph, "geojson"), version),
            "graph.graphml": _Form("graph", "application/xml", partial(write_graph, "graphml"), version),
            "cloud.ply": _Form(
                "cloud", "application/octet-stream", lambda out: out.writelines(ply_files.encoded(*cloud)),
                published_version, cloud_bytes,
            ),
            "cloud.pcd": _Form(
                "cloud", "application/octet-stream", lambda out: out.writelines(pcd_files.encoded(*cloud)),
                published_version, cloud_bytes,
            ),
            "road.tum": _Form("road", "text/plain; charset=utf-8", write_road, version),
        }  # fmt: skip
