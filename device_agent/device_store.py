"""What the device keeps over a restart: the settings that it runs, and the map and PoI-graph in its site folder."""

from __future__ import annotations

import json
import logging
import os
import shutil
from pathlib import Path

from navcore.errors import InputError, SettingError, SiteError
from navcore.folder_swap import recover, swap_in
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.site import save_poi_graph

_log = logging.getLogger(__name__)


def previous_site(site_folder: Path) -> Path:
    """Return where the site that ran before the present one is kept."""
    return site_folder.with_name(f".{site_folder.name}-previous")


def keep_previous(site_folder: Path) -> None:
    """Keep the present site, before another one takes its place. Raises OSError."""
    if not site_folder.is_dir():
        return
    fresh = site_folder.with_name(f".{site_folder.name}-kept")
    shutil.rmtree(fresh, ignore_errors=True)
    # Files of a site are replaced, never changed: both folders may share them.
    shutil.copytree(site_folder, fresh, copy_function=_link_or_copy)
    swap_in(fresh, previous_site(site_folder))


def _link_or_copy(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        # Not every disk knows links.
        shutil.copy2(source, target)


def restore_previous(site_folder: Path) -> None:
    """Let present and previous site change places. Raises InputError where there is none, and OSError."""
    previous = previous_site(site_folder)
    recover(previous)
    if not previous.is_dir():
        raise InputError(f"No earlier map of {site_folder} is kept: build it again from its recording.")
    staging = site_folder.with_name(f".{site_folder.name}-restored")
    shutil.rmtree(staging, ignore_errors=True)
    shutil.copytree(previous, staging, copy_function=_link_or_copy)
    keep_previous(site_folder)
    swap_in(staging, site_folder)


class DeviceStore:
    """The device's own folder, and its site folder."""

    def __init__(self, state_folder: Path, site_folder: Path) -> None:
        self.state_folder = state_folder
        self.site_folder = site_folder

    def prepare(self) -> None:
        """Make the device's own folder. Raises InputError where that cannot be."""
        try:
            self.state_folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"{self.state_folder}, where settings and events are kept, cannot be made ({error.strerror}): name"
                " another with --state."
            ) from error

    @property
    def journal_path(self) -> Path:
        """Where events wait for the console."""
        return self.state_folder / "events.sqlite"

    @property
    def _settings_path(self) -> Path:
        return self.state_folder / "settings.json"

    def load_settings(self) -> tuple[Settings, int]:
        """Return the settings that ran last, and their revision; the defaults where there are none that still fit."""
        try:
            stored = json.loads(self._settings_path.read_text(encoding="utf-8"))
            return Settings().changed(stored["values"]), int(stored["revision"])
        except FileNotFoundError:
            return Settings(), 0
        except (OSError, ValueError, KeyError, TypeError, AttributeError, SettingError) as error:
            _log.warning("the stored settings do not fit (%s): the defaults run", error)
            return Settings(), 0

    def save_settings(self, settings: Settings, revision: int) -> None:
        """Keep the settings. Raises OSError."""
        self.state_folder.mkdir(parents=True, exist_ok=True)
        fresh = self._settings_path.with_suffix(".new")
        with fresh.open("w", encoding="utf-8") as out:
            json.dump({"revision": revision, "values": settings.values()}, out, indent=1)
            out.flush()
            os.fsync(out.fileno())
        os.replace(fresh, self._settings_path)

    def save_graph(self, graph: PoiGraph) -> None:
        """Keep the PoI-graph in the site. Raises OSError."""
        save_poi_graph(graph, self.site_folder)

    def swap_map(self, staging: Path) -> None:
        """Move a staged site into place. Raises OSError or SiteError, and the old site stays then."""
        if not staging.is_dir():
            raise SiteError(f"The new map is no longer at {staging}: publish it again.")
        keep_previous(self.site_folder)
        swap_in(staging, self.site_folder)
