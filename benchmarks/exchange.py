"""Export and import at full size: time, and memory beyond what the process had before, as JSON.

    python -m benchmarks.exchange [--points 5000000]

A site with a large cloud goes out as an archive and as clouds, and in again; a PoI-graph of 500 places and 800 edges
goes through both forms; foreign files are as large, or as bad, as is looked at. Each step is a process of its own.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from navcore import pcd_files, ply_files
from navcore.errors import InputError
from navcore.graph_import import GRAPH_FORMS, MAX_FOREIGN_LENGTH_M, imported, read_graph
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road
from navcore.site import Site, load_site, save_site
from navcore.site_archive import unpack_site_archive, write_site_archive
from navcore.types import CameraIntrinsics

POI_COUNT, EDGE_COUNT = 500, 800
_MIB = 1024.0


def main() -> int:
    """Run the benchmark; print its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--points", type=int, default=5_000_000)
    parser.add_argument("--step", nargs=2, metavar=("NAME", "FOLDER"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.step is not None:
        return _run(arguments.step[0], Path(arguments.step[1]))
    with tempfile.TemporaryDirectory() as scratch:
        _save_large_site(Path(scratch), arguments.points)
        for name in STEPS:
            command = [sys.executable, "-m", "benchmarks.exchange", "--step", name, scratch]
            sys.stdout.write(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            sys.stdout.flush()
    return 0


def _run(name: str, folder: Path) -> int:
    step = STEPS[name](folder)
    # The highest so far is forgotten first.
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before_kib, start_s = _highest_kib(), time.perf_counter()
    told = step()
    took_s, grown_kib = time.perf_counter() - start_s, _highest_kib() - before_kib
    figures = {"step": name, "time_s": round(took_s, 3), "memory_mib": round(grown_kib / _MIB, 1), "told": told}
    sys.stdout.write(json.dumps(figures) + "\n")
    return 0


def _highest_kib() -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))


def _save_large_site(folder: Path, point_count: int) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, 100.0, (point_count, 3)).astype(np.float32)
    colours = rng.integers(0, 256, (point_count, 3)).astype(np.uint8)
    camera = CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0)
    road = np.column_stack([np.linspace(0.0, 100.0, 1001), np.zeros(1001), np.zeros(1001)])
    save_site(Site("large", "Large site", camera, {}, (road,), points, colours), folder / "site")
    with (folder / "made.zip").open("wb") as out:
        write_site_archive(folder / "site", out)


# -------------------------------------------------------------------------------------------------------- steps
Step = Callable[[], str]


def _archive_out(folder: Path) -> Step:
    def step() -> str:
        with (folder / "out.zip").open("wb") as out:
            write_site_archive(folder / "site", out)
            return f"{out.tell() >> 20} MiB"

    return step


def _archive_in(folder: Path) -> Step:
    return lambda: unpack_site_archive(folder / "made.zip", folder / "copy", replace=True).name


def _site_opened(folder: Path) -> Step:
    """What anybody who opens the site takes: reading an archive ends with it."""
    return lambda: load_site(folder / "site").name


def _cloud_out(module: object, ending: str, folder: Path) -> Step:
    site = load_site(folder / "site")

    def step() -> str:
        with (folder / f"cloud.{ending}").open("wb") as out:
            out.writelines(module.encoded(site.cloud_points_m, site.cloud_colours_rgb))  # type: ignore[attr-defined]
            return f"{out.tell() >> 20} MiB"

    return step


def _graph() -> PoiGraph:
    """Places on a grid 10 m apart, joined by edges with a point every 0.1 m."""
    width = 25
    pois = {f"p{n}": Poi(f"p{n}", f"Place {n}", "room", n % width * 10.0, n // width * 10.0) for n in range(POI_COUNT)}
    pairs = [(n, n + 1) for n in range(POI_COUNT) if (n + 1) % width] + [
        (n, n + width) for n in range(POI_COUNT - width)
    ]
    edges: dict[str, Edge] = {}
    for number, (a, b) in enumerate(pairs[:EDGE_COUNT]):
        ends = [(poi.x_m, poi.y_m) for poi in (pois[f"p{a}"], pois[f"p{b}"])]
        path = tuple(map(tuple, np.linspace(*ends, 101).tolist()))
        length_m = sum(math.dist(p, q) for p, q in itertools.pairwise(path))
        edges[f"e{number}"] = Edge(f"e{number}", f"p{a}", f"p{b}", path, length_m)  # type: ignore[arg-type]
    return PoiGraph(1, pois, edges, {"r1": Road("r1", ((0.0, 0.0), (240.0, 0.0)))})


def _graph_through(form: str, folder: Path) -> Step:
    graph = _graph()

    def step() -> str:
        data = GRAPH_FORMS[form](graph, "large", "Large site")
        assert read_graph(data) == graph
        return f"{len(data) >> 10} KiB"

    return step


def _foreign(folder: Path) -> Step:
    """A floor of corridors and places that another program drew, as large as is taken."""
    features = [
        {"geometry": {"type": "LineString", "coordinates": [[0, y], [80, y]]}, "properties": {"name": f"Corridor {y}"}}
        for y in range(0, 2 * int(MAX_FOREIGN_LENGTH_M / 80), 2)
    ]
    features += [
        {"geometry": {"type": "Point", "coordinates": [n % 60, 2 * (n // 60)]}, "properties": {"name": f"Place {n}"}}
        for n in range(POI_COUNT)
    ]
    data = json.dumps({"type": "FeatureCollection", "features": features}).encode()
    draft = PoiGraph(0, {}, {}, {"r1": Road("r1", ((0.0, 0.0), (0.0, 248.0)))})
    return lambda: f"{len(imported(data, draft).graph.pois)} places"


def _refused(data: bytes, folder: Path) -> Step:
    def step() -> str:
        try:
            imported(data, PoiGraph())
        except InputError as error:
            return str(error)
        return "taken"

    return step


STEPS: dict[str, Callable[[Path], Step]] = {
    "archive out": _archive_out,
    "archive in": _archive_in,
    "the site opened": _site_opened,
    "cloud.ply out": lambda folder: _cloud_out(ply_files, "ply", folder),
    "cloud.pcd out": lambda folder: _cloud_out(pcd_files, "pcd", folder),
    "graph.geojson out and in": lambda folder: _graph_through("geojson", folder),
    "graph.graphml out and in": lambda folder: _graph_through("graphml", folder),
    "a drawn floor": _foreign,
    "a million features": lambda folder: _refused(
        b'{"type":"FeatureCollection","features":[' + b"{}," * 999_999 + b"{}]}", folder
    ),
    "features without end": lambda folder: _refused(
        b'{"type":"FeatureCollection","features":[' + b"1," * ((8 << 20) - 40) + b"1]}", folder
    ),
    "16 MiB of numbers": lambda folder: _refused(
        b'{"type":"FeatureCollection","features":[{"geometry":{"type":"LineString","coordinates":['
        + b"[0,0]," * 2_700_000 + b"[0,0]]}}]}", folder
    ),
    "16 MiB of tags": lambda folder: _refused(b"<graphml><graph>" + b"<node/>" * 2_300_000, folder),
}  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
