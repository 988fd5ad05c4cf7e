"""A site: the map of one building floor as a folder, and as one package file.

::

    SITE/
      manifest.json     format, schema version, site id, name, and of every other map file its size and SHA-256
      camera.json       the camera that made the map
      map/*.npy         the SLAM map: key frames, landmarks, observations (see navcore.slam.slam_map)
      road/*.npy        the virtual blind road: one polyline (n, 3) for each recorded stretch, metres, floor at z = 0
      cloud/*.npy       the dense coloured cloud: points_m (n, 3) float32, colours_rgb (n, 3) uint8
      poi_graph.json    the PoI-graph as last published; it changes without the map, so it stands outside the manifest

The same map gives the same bytes. Nothing is ever unpickled. A site that is damaged or newer than this program is
refused with SiteError, and nothing is changed.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from navcore.errors import SiteError
from navcore.geometry import FloatArray
from navcore.planning.poi_graph import PoiGraph
from navcore.types import CameraIntrinsics

FORMAT = "vbr-site"
SCHEMA_VERSION = 1
MAX_PACKAGE_BYTES = 1 << 30
_FOLDERS = ("map", "road", "cloud")
_GRAPH_FILE = "poi_graph.json"


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


class _FileEntry(msgspec.Struct, forbid_unknown_fields=True):
    size: int
    sha256: str


class _Manifest(msgspec.Struct):
    format: str
    schema_version: int
    site_id: str
    name: str
    files: dict[str, _FileEntry]
    report: dict[str, Any] = {}


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
        is_foreign = folder.exists() and (
            not folder.is_dir() or (any(folder.iterdir()) and not (folder / "manifest.json").exists())
        )
        Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent)).rmdir()
    except OSError as error:
        raise SiteError(f"No site can be written to {folder} ({error.strerror}): name another folder.") from error
    if is_foreign:
        raise SiteError(f"{folder} holds other files: name an empty folder, or one that already holds a site.")


def _replace_site(site: Site, folder: Path) -> None:
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        _write_site(site, fresh)
        fresh.chmod(0o755)
        if folder.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{folder.name}-old-", dir=folder.parent))
            os.replace(folder, old)
            os.replace(fresh, folder)
            shutil.rmtree(old)
        else:
            os.replace(fresh, folder)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def load_site(folder: Path) -> Site:
    """Read and check a site. Raises SiteError with what is wrong and what to do."""
    manifest = _read_manifest(folder)
    contents = {name: _read_checked(folder, name, entry) for name, entry in manifest.files.items()}
    arrays = {name: _array(folder, name, data) for name, data in contents.items() if name.endswith(".npy")}
    by_folder: dict[str, dict[str, NDArray[Any]]] = {part: {} for part in _FOLDERS}
    for name, array in arrays.items():
        part, _, file = name.partition("/")
        by_folder.setdefault(part, {})[file.removesuffix(".npy")] = array
    try:
        intrinsics = msgspec.json.decode(contents["camera.json"], type=CameraIntrinsics)
        points, colours = by_folder["cloud"]["points_m"], by_folder["cloud"]["colours_rgb"]
    except (KeyError, msgspec.MsgspecError) as error:
        raise SiteError(f"The site {folder} is incomplete ({error}): build the map again.") from error
    roads = tuple(by_folder["road"][name] for name in sorted(by_folder["road"]))
    _check_shapes(folder, roads, points, colours)
    return Site(
        manifest.site_id, manifest.name, intrinsics, by_folder["map"], roads, points, colours,
        load_poi_graph(folder), manifest.report,
    )  # fmt: skip


def map_checksum(folder: Path) -> str:
    """Return the SHA-256 (hex) that names this map: two sites with the same one hold the same map."""
    manifest = _read_manifest(folder)
    digest = hashlib.sha256()
    for name in sorted(manifest.files):
        digest.update(f"{name}\n{manifest.files[name].sha256}\n".encode())
    return digest.hexdigest()


def load_poi_graph(folder: Path) -> PoiGraph:
    """Read the published PoI-graph; an empty one where none has been published. Raises SiteError."""
    path = folder / _GRAPH_FILE
    if not path.exists():
        return PoiGraph()
    try:
        graph = msgspec.json.decode(path.read_bytes(), type=PoiGraph)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise SiteError(f"{path} is damaged ({error}): publish the PoI-graph again from the console.") from error
    if (loose := graph.loose_edge()) is not None:
        raise SiteError(
            f"{path} is damaged (edge {loose.id} does not join two of its places): publish the PoI-graph again from the"
            " console."
        )
    return graph


def save_poi_graph(graph: PoiGraph, folder: Path) -> None:
    """Replace the published PoI-graph of a site in one step."""
    _write_whole(folder / _GRAPH_FILE, msgspec.json.format(msgspec.json.encode(graph), indent=1))


def pack_site(folder: Path) -> bytes:
    """Return the site as one package (zip); the same site gives the same bytes. Raises SiteError."""
    manifest = _read_manifest(folder)
    names = ["manifest.json", *sorted(manifest.files)]
    if (folder / _GRAPH_FILE).exists():
        names.append(_GRAPH_FILE)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as package:
        for name in names:
            # A fixed date, so that the bytes tell of the contents alone.
            package.writestr(
                zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), (folder / name).read_bytes(), zipfile.ZIP_DEFLATED
            )
    return out.getvalue()


def unpack_site(package_bytes: bytes, folder: Path) -> None:
    """Write a package to a folder that does not exist yet. Raises SiteError, leaving nothing, where it is unfit."""
    if folder.exists():
        raise SiteError(f"{folder} exists already: name a new folder.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        _extract(package_bytes, fresh)
        load_site(fresh)
        fresh.chmod(0o755)
        os.replace(fresh, folder)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _extract(package_bytes: bytes, folder: Path) -> None:
    try:
        with zipfile.ZipFile(io.BytesIO(package_bytes)) as package:
            entries = package.infolist()
            if sum(entry.file_size for entry in entries) > MAX_PACKAGE_BYTES:
                raise SiteError("The site package unpacks to more than 1 GiB: export it again with a smaller cloud.")
            for entry in entries:
                path = PurePosixPath(entry.filename)
                if path.is_absolute() or ".." in path.parts or len(path.parts) > 2:
                    raise SiteError(
                        f"The site package holds a file outside the site ({entry.filename}): export it again."
                    )
                target = folder / path
                target.parent.mkdir(exist_ok=True)
                target.write_bytes(package.read(entry))
    except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, RuntimeError) as error:
        raise SiteError(f"The site package is damaged ({error}): export it again.") from error


def _write_site(site: Site, folder: Path) -> None:
    files: dict[str, bytes] = {"camera.json": msgspec.json.encode(site.intrinsics)}
    for name, array in site.map_arrays.items():
        files[f"map/{name}.npy"] = _npy(array)
    for index, road in enumerate(site.roads_m):
        files[f"road/{index:03d}.npy"] = _npy(road)
    files["cloud/points_m.npy"] = _npy(site.cloud_points_m)
    files["cloud/colours_rgb.npy"] = _npy(site.cloud_colours_rgb)
    for part in _FOLDERS:
        (folder / part).mkdir()
    entries = {name: _FileEntry(len(data), hashlib.sha256(data).hexdigest()) for name, data in sorted(files.items())}
    for name, data in files.items():
        (folder / name).write_bytes(data)
    manifest = _Manifest(FORMAT, SCHEMA_VERSION, site.site_id, site.name, entries, dict(site.report))
    (folder / "manifest.json").write_bytes(msgspec.json.format(msgspec.json.encode(manifest), indent=1))
    save_poi_graph(site.poi_graph, folder)


def _read_manifest(folder: Path) -> _Manifest:
    path = folder / "manifest.json"
    if not path.exists():
        raise SiteError(f"There is no site at {folder}: build one with `vbr map build RECORDING --site {folder}`.")
    try:
        raw = json.loads(path.read_bytes())
        _refuse_newer(folder, raw)
        manifest = msgspec.convert(raw, _Manifest)
    except (OSError, ValueError, RecursionError) as error:
        raise SiteError(f"{path} is damaged ({error}): build the map again, or take it from a backup.") from error
    if manifest.format != FORMAT or manifest.schema_version < 1:
        raise SiteError(f"{folder} is not a site of this program: name a folder made by `vbr map build`.")
    return manifest


def _refuse_newer(folder: Path, raw: object) -> None:
    """A newer manifest may have another form: its version is looked at before anything else."""
    version = raw.get("schema_version") if isinstance(raw, dict) and raw.get("format") == FORMAT else None
    if isinstance(version, int) and version > SCHEMA_VERSION:
        raise SiteError(
            f"The site {folder} was written by a newer program (schema {version}, this one knows"
            f" {SCHEMA_VERSION}): update this program."
        )


def _read_checked(folder: Path, name: str, entry: _FileEntry) -> bytes:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        raise SiteError(f"The site {folder} names a file outside itself ({name}): build the map again.")
    try:
        data = (folder / path).read_bytes()
    except OSError as error:
        raise SiteError(f"The site {folder} lacks {name}: build the map again, or take it from a backup.") from error
    if len(data) != entry.size or hashlib.sha256(data).hexdigest() != entry.sha256:
        raise SiteError(f"{name} of the site {folder} is damaged: build the map again, or take it from a backup.")
    return data


def _array(folder: Path, name: str, data: bytes) -> NDArray[Any]:
    try:
        return np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise SiteError(f"{name} of the site {folder} is no array ({error}): build the map again.") from error


def _check_shapes(folder: Path, roads: tuple[NDArray[Any], ...], points: NDArray[Any], colours: NDArray[Any]) -> None:
    good_roads = all(road.ndim == 2 and road.shape[1] == 3 and road.dtype == np.float64 for road in roads)
    good_cloud = points.ndim == 2 and points.shape[1] == 3 and points.shape == colours.shape
    if not good_roads or not good_cloud or points.dtype != np.float32 or colours.dtype != np.uint8:
        raise SiteError(f"The site {folder} holds arrays of another form: build the map again.")


def _npy(array: NDArray[Any]) -> bytes:
    out = io.BytesIO()
    np.lib.format.write_array(out, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
    return out.getvalue()


def _write_whole(path: Path, data: bytes) -> None:
    """Replace a file in one step: a reader, or a crash, meets the old one or the new one."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    with os.fdopen(handle, "wb") as out:
        out.write(data)
        out.flush()
        os.fsync(out.fileno())
    os.chmod(name, 0o644)
    os.replace(name, path)
