"""The demo's map: the simulated sighted person's walk, recorded and mapped once, then kept."""

from __future__ import annotations

import json
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from device_agent.progress import progress_bar, stage_bar
from navcore.errors import InputError, SiteError
from navcore.recording import open_recording
from navcore.settings import Settings
from navcore.site import Site, load_site, save_site
from navcore.slam.map_arrays import descriptor_kind

MAP_VERSION = 1
"""Counts up when the building, the recording or the mapping changes so that a kept map no longer fits."""
RECORDING_SEED = 0
SITE_NAME = "Office floor"


def prepare_demo_site(data: Path, size_px: tuple[int, int], rate_hz: float, *, fresh: bool = False) -> Path:
    """Return the demo's site folder; record and map the building first where that has not been done yet.

    The picture size and the frame rate are those of the walker's camera, for the map and for the walk alike.
    """
    site, note = data / "site", data / "demo.json"
    wanted = {
        "map_version": MAP_VERSION,
        "features": descriptor_kind().tobytes().hex(),
        "size_px": list(size_px),
        "rate_hz": rate_hz,
    }
    if not fresh and _kept(note) == wanted and _is_whole(site):
        return site
    _make_folder(data)
    _say("First start: the simulated building is walked through and mapped once, which takes some minutes.")
    recording = data / "recording"
    shutil.rmtree(recording, ignore_errors=True)
    _record(recording, size_px, rate_hz)
    built = _mapped(recording)
    # Only now: whoever stops this earlier keeps the map that they had.
    note.unlink(missing_ok=True)
    save_site(built, site)
    shutil.rmtree(recording)
    note.write_text(json.dumps(wanted), encoding="utf-8")
    return site


def _make_folder(data: Path) -> None:
    try:
        data.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder {data} cannot be made ({error.strerror}): name another with --data.") from error


def _record(folder: Path, size_px: tuple[int, int], rate_hz: float) -> None:
    from device_agent.simulation.walk_recording import record_walk

    with progress_bar("Walking through the building") as report:
        record_walk(folder, RECORDING_SEED, size_px, rate_hz, report)


def _mapped(recording: Path) -> Site:
    from device_agent.single_core import use_one_core
    from navcore.site_building import build_site

    use_one_core()
    settings = Settings().localization
    with ThreadPoolExecutor(1) as executor, stage_bar() as progress:
        built, _ = build_site(open_recording(recording), SITE_NAME, settings, progress, executor=executor)
    return built


def _kept(note: Path) -> object:
    try:
        return json.loads(note.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _is_whole(site: Path) -> bool:
    try:
        load_site(site)
    except SiteError as error:
        _say(f"{error} It is made again now.")
        return False
    return True


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
