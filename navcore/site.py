"""A site: the map of one building floor as a folder, and as one package file.

::

    SITE/
      manifest.json     format, schema version, site id, name, and of every other map file its size and SHA-256
      camera.json       the camera that made the map
      sessions.json     the recordings that the site is made of, and which of them each road comes from
      map/*.npy         the SLAM map: key frames, landmarks, observations (see navcore.slam.slam_map)
      road/*.npy        the virtual blind road: one polyline (n, 3) for each recorded stretch, metres, floor at z = 0
      cloud/*.npy       the dense coloured cloud: points_m (n, 3) float32, colours_rgb (n, 3) uint8, and of each point
                        weights (n,) float32, view_counts (n,) uint16, sessions (n,) uint64: who saw it
      poi_graph.json    the PoI-graph as last published, with a checksum; it changes without the map, so it stands
                        outside the manifest

The same map gives the same bytes. Nothing is ever unpickled. A site that is damaged or newer than this program is
refused with SiteError, and nothing is changed. A crash while a site is replaced leaves the old one.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from navcore.errors import SiteError
from navcore.folder_swap import fresh_folder, recover, swap_in, sync_tree
from navcore.geometry import FloatArray
from navcore.misfit import words_of
from navcore.planning.poi_graph import PoiGraph
from navcore.site_files import (
    FILE_NAME,
    FORMAT,
    MANIFEST,
    MAX_SITE_BYTES,
    SCHEMA_VERSION,
    Manifest,
    array_of,
    entry_of,
    manifest_bytes,
    npy_bytes,
    read_checked,
    read_manifest,
    write_whole,
)
from navcore.site_sessions import Session, SessionTable
from navcore.types import CameraIntrinsics
from navcore.zip_reading import copied, opened_zip, told_of_damage

MAX_PACKAGE_BYTES = MAX_SITE_BYTES
MAX_COORDINATE_M = 100_000.0
_PACKAGE = "The site package"
_FOLDERS = ("map", "road", "cloud")
GRAPH_FILE = "poi_graph.json"
_CLOUD_FORMS: dict[str, tuple[type, int]] = {
    "points_m": (np.float32, 2),
    "colours_rgb": (np.uint8, 2),
    "weights": (np.float32, 1),
    "view_counts": (np.uint16, 1),
    "sessions": (np.uint64, 1),
}
"""Type and number of dimensions of the cloud's arrays; the last three came with the second schema."""


def _one_session() -> tuple[Session, ...]:
    return (Session("1", "First recording"),)


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """One floor of one building, as it was mapped."""

    site_id: str
    name: str
    intrinsics: CameraIntrinsics
    map_arrays: Mapping[str, NDArray[Any]]
    """The SLAM map, array by array; :mod:`navcore.slam.slam_map` reads it."""
    roads_m: tuple[FloatArray, ...]
    """The virtual blind road: polylines (n, 3)."""
    cloud_points_m: NDArray[np.float32]
    """Points (n, 3), float32."""
    cloud_colours_rgb: NDArray[np.uint8]
    """Colours (n, 3), uint8."""
    poi_graph: PoiGraph = field(default_factory=PoiGraph)
    report: Mapping[str, Any] = field(default_factory=dict)
    """Figures of the map building (key frames, landmarks, …), for people to read."""
    sessions: tuple[Session, ...] = field(default_factory=_one_session)
    """The recordings that it is made of."""
    road_sessions: tuple[int, ...] = ()
    """For each road the number of its session; all of the first where this is empty."""
    cloud_weights: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    """(n,): how well each point is known, 1/m²; 1 for all where this is empty."""
    cloud_view_counts: NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))
    """(n,): key frames that saw it; 1 where this is empty."""
    cloud_sessions: NDArray[np.uint64] = field(default_factory=lambda: np.zeros(0, np.uint64))
    """(n,): bit s is set where session s saw it; the first where this is empty."""

    def __post_init__(self) -> None:
        count = len(self.cloud_points_m)
        for name in ("cloud_weights", "cloud_view_counts", "cloud_sessions"):
            given: NDArray[Any] = getattr(self, name)
            if not len(given):
                object.__setattr__(self, name, np.ones(count, given.dtype))
            elif len(given) != count:
                raise SiteError(f"The cloud has {count} points, but {len(given)} {name}: give one for each point.")
        if not self.road_sessions:
            object.__setattr__(self, "road_sessions", (0,) * len(self.roads_m))


def save_site(site: Site, folder: Path) -> None:
    """Write the site to a folder, which is replaced as a whole only after everything has been written.

    Raises SiteError where the folder holds something that is no site, or cannot be written.
    """
    prepare_site_folder(folder)
    try:
        _replace_site(site, folder)
    except OSError as error:
        raise SiteError(
            f"The site {folder} cannot be written ({error.strerror}): see whether the disk has room, or name another"
            " folder."
        ) from error


def prepare_site_folder(folder: Path) -> None:
    """See that a site can be written here, before hours of work go into it. Raises SiteError.

    Makes the folders above it; the folder itself is not touched.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        recover(folder)
        is_foreign = folder.exists() and (
            not folder.is_dir() or (any(folder.iterdir()) and not (folder / MANIFEST).exists())
        )
        with fresh_folder(folder):
            pass
    except OSError as error:
        raise SiteError(f"No site can be written to {folder} ({error.strerror}): name another folder.") from error
    if is_foreign:
        raise SiteError(f"{folder} holds other files: name an empty folder, or one that already holds a site.")


def _replace_site(site: Site, folder: Path) -> None:
    with fresh_folder(folder) as fresh:
        _write_site(site, fresh)
        fresh.chmod(0o755)
        sync_tree(fresh)
        swap_in(fresh, folder)


def load_site(folder: Path) -> Site:
    """Read and check a site. Raises SiteError with what is wrong and what to do."""
    recover(folder)
    manifest = read_manifest(folder)
    contents = {name: read_checked(folder, name, entry) for name, entry in manifest.files.items()}
    arrays = {name: array_of(folder, name, data) for name, data in contents.items() if name.endswith(".npy")}
    by_folder: dict[str, dict[str, NDArray[Any]]] = {part: {} for part in _FOLDERS}
    for name, array in arrays.items():
        part, _, file = name.partition("/")
        by_folder.setdefault(part, {})[file.removesuffix(".npy")] = array
    roads = tuple(by_folder["road"][name] for name in sorted(by_folder["road"]))
    try:
        intrinsics = msgspec.json.decode(contents["camera.json"], type=CameraIntrinsics)
        table = _session_table(manifest, contents.get("sessions.json"))
        cloud = _checked_cloud(folder, by_folder["cloud"], len(table.sessions))
    except (KeyError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise SiteError(f"The site {folder} is incomplete ({words_of(error)}): build the map again.") from error
    _check_roads(folder, roads, table)
    return Site(
        manifest.site_id, manifest.name, intrinsics, by_folder["map"], roads, cloud["points_m"], cloud["colours_rgb"],
        load_poi_graph(folder), manifest.report, table.sessions, table.road_sessions,
        *(cloud.get(name, np.zeros(0, dtype)) for name, (dtype, _) in list(_CLOUD_FORMS.items())[2:]),
    )  # fmt: skip


def _session_table(manifest: Manifest, data: bytearray | None) -> SessionTable:
    """A site of the first schema was made of one recording."""
    if data is not None:
        return msgspec.json.decode(data, type=SessionTable)
    if manifest.schema_version > 1:
        raise KeyError("sessions.json")
    frames = manifest.report.get("frames", 0)
    return SessionTable((Session("1", manifest.name, frame_count=frames if isinstance(frames, int) else 0),))


def map_checksum(folder: Path) -> str:
    """Return the SHA-256 (hex) that names this map: two sites with the same one hold the same map."""
    recover(folder)
    manifest = read_manifest(folder)
    digest = hashlib.sha256()
    for name in sorted(manifest.files):
        digest.update(f"{name}\n{manifest.files[name].sha256}\n".encode())
    return digest.hexdigest()


def load_poi_graph(folder: Path) -> PoiGraph:
    """Read the published PoI-graph; an empty one where none has been published. Raises SiteError."""
    path = folder / GRAPH_FILE
    if not path.exists():
        return PoiGraph()
    try:
        raw = json.loads(path.read_bytes())
        checksum = raw.pop("sha256", None)
        # Of what the file says, so that one written before a field was added is still whole.
        found = _graph_checksum(raw)
        graph = msgspec.convert(raw, PoiGraph)
    except (OSError, ValueError, OverflowError, RecursionError, AttributeError, TypeError) as error:
        raise SiteError(f"{path} is damaged ({error}): publish the PoI-graph again from the console.") from error
    if (loose := graph.loose_edge()) is not None:
        raise SiteError(
            f"{path} is damaged (edge {loose.id} does not join two of its places): publish the PoI-graph again from the"
            " console."
        )
    if checksum not in (None, found):
        raise SiteError(
            f"{path} is damaged (its checksum is another): publish the PoI-graph again from the console, or, if you"
            " changed it by hand, delete its sha256."
        )
    return graph


def _graph_checksum(raw: dict[str, Any]) -> str:
    return hashlib.sha256(msgspec.json.encode(raw)).hexdigest()


def save_poi_graph(graph: PoiGraph, folder: Path) -> None:
    """Replace the published PoI-graph of a site in one step."""
    raw = msgspec.to_builtins(graph)
    sealed = {"sha256": _graph_checksum(raw), **raw}
    write_whole(folder / GRAPH_FILE, msgspec.json.format(msgspec.json.encode(sealed), indent=1))


def pack_site(folder: Path) -> bytes:
    """Return the site as one package (zip); the same site gives the same bytes. Raises SiteError."""
    recover(folder)
    manifest = read_manifest(folder)
    names = [MANIFEST, *sorted(manifest.files)]
    if (folder / GRAPH_FILE).exists():
        names.append(GRAPH_FILE)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as package:
        for name in names:
            # A fixed date, so that the bytes tell of the contents alone.
            package.writestr(
                zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), (folder / name).read_bytes(), zipfile.ZIP_DEFLATED
            )
    return out.getvalue()


def unpack_site(package: bytes | Path, folder: Path) -> None:
    """Write a package, or a file that holds one, to a folder that does not exist yet.

    Raises SiteError, leaving nothing, where it is unfit.
    """
    if folder.exists():
        raise SiteError(f"{folder} exists already: name a new folder.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with fresh_folder(folder) as fresh:
        _extract(package, fresh)
        load_site(fresh)
        fresh.chmod(0o755)
        os.replace(fresh, folder)


def _extract(source: bytes | Path, folder: Path) -> None:
    try:
        with (
            io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as file,
            opened_zip(file, _PACKAGE, MAX_PACKAGE_BYTES) as package,
        ):
            entries = package.infolist()
            if sum(entry.file_size for entry in entries) > MAX_PACKAGE_BYTES:
                raise SiteError(f"{_PACKAGE} unpacks to more than 1 GiB: export it again with a smaller cloud.")
            for entry in entries:
                if FILE_NAME.fullmatch(entry.filename) is None:
                    raise SiteError(
                        f"{_PACKAGE} holds a file outside the site ({entry.filename[:100]!r}): export it again."
                    )
                told_of_damage(partial(_extract_entry, package, entry, folder / entry.filename), _PACKAGE)
    except OSError as error:
        raise SiteError(f"{_PACKAGE} is damaged ({error}): export it again.") from error


def _extract_entry(package: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path) -> None:
    target.parent.mkdir(exist_ok=True)
    with package.open(entry) as packed, target.open("xb") as out:
        copied(packed, out, entry.file_size)


def _write_site(site: Site, folder: Path) -> None:
    table = SessionTable(site.sessions, site.road_sessions)
    files: dict[str, bytes] = {
        "camera.json": msgspec.json.encode(site.intrinsics),
        "sessions.json": msgspec.json.format(msgspec.json.encode(table), indent=1),
    }
    for name, array in site.map_arrays.items():
        files[f"map/{name}.npy"] = npy_bytes(array)
    for index, road in enumerate(site.roads_m):
        files[f"road/{index:03d}.npy"] = npy_bytes(road)
    for name in _CLOUD_FORMS:
        files[f"cloud/{name}.npy"] = npy_bytes(getattr(site, f"cloud_{name}"))
    for part in _FOLDERS:
        (folder / part).mkdir()
    entries = {name: entry_of(data) for name, data in sorted(files.items())}
    for name, data in files.items():
        (folder / name).write_bytes(data)
    manifest = Manifest(FORMAT, SCHEMA_VERSION, site.site_id, site.name, entries, dict(site.report))
    (folder / MANIFEST).write_bytes(manifest_bytes(manifest))
    save_poi_graph(site.poi_graph, folder)


def _checked_cloud(folder: Path, cloud: dict[str, NDArray[Any]], sessions: int) -> dict[str, NDArray[Any]]:
    count = next(iter(cloud["points_m"].shape), 0)
    for name, array in cloud.items():
        form = _CLOUD_FORMS.get(name)
        shape = (count, 3)[: form[1]] if form else None
        if form is None or array.dtype != form[0] or array.shape != shape:
            raise _of_another_form(folder)
    colours, points = cloud["colours_rgb"], cloud["points_m"]
    if len(colours) != count or not (np.abs(points) <= MAX_COORDINATE_M).all():
        raise _of_another_form(folder)
    seen_by = cloud.get("sessions", np.ones(1, np.uint64))
    if len(seen_by) and (seen_by.min() == 0 or int(seen_by.max()) >> sessions):
        raise SiteError(f"The site {folder} holds points of the cloud that no session has seen: build the map again.")
    return cloud


def _check_roads(folder: Path, roads: tuple[NDArray[Any], ...], table: SessionTable) -> None:
    for road in roads:
        if road.ndim != 2 or road.shape[1] != 3 or road.dtype != np.float64:
            raise _of_another_form(folder)
        if not (np.abs(road) <= MAX_COORDINATE_M).all():
            raise SiteError(f"The site {folder} holds a road that is nowhere: build the map again.")
    numbers = table.road_sessions
    if numbers and (len(numbers) != len(roads) or not all(0 <= n < len(table.sessions) for n in numbers)):
        raise _of_another_form(folder)


def _of_another_form(folder: Path) -> SiteError:
    return SiteError(f"The site {folder} holds arrays of another form: build the map again.")
