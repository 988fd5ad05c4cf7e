"""What the device keeps over a restart: the settings that it runs, and the map and PoI-graph in its site folder."""

from __future__ import annotations

import contextlib
import fcntl
import json
import logging
import os
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from device_agent.calibration_store import CalibrationStore
from device_agent.link_state import LinkState
from device_agent.private_folder import make_private
from device_agent.sharing import DEFAULT_CONSENT, NOTHING_SHARED, Consent, shared_by_both
from navcore.errors import InputError, SettingError, SiteError
from navcore.folder_swap import keep_aside, swap_in, sync_tree
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.site import Site, load_site, save_poi_graph
from navcore.site_files import clear_half_written, write_whole
from navcore.wire import Accesses, Count

_log = logging.getLogger(__name__)


def previous_site(site_folder: Path) -> Path:
    """Return where the site that ran before the present one is kept."""
    return site_folder.with_name(f".{site_folder.name}-previous")


def restore_previous(site_folder: Path) -> None:
    """Let present and previous map change places. Raises InputError where there is none, and OSError."""
    previous, moved = previous_site(site_folder), site_folder.with_name(f".{site_folder.name}-restored")
    if not moved.is_dir():
        if not previous.is_dir():
            raise InputError(f"No earlier map of {site_folder} is kept: build it again from its recording.")
        os.replace(previous, moved)
    # Where this was broken off before, it goes on from here.
    swap_in(moved, site_folder, keep=previous)


class _StoredSettings(msgspec.Struct, frozen=True):
    """What the file of settings holds."""

    revision: Count
    values: dict[str, float | int | bool | str]


class DeviceStore:
    """The device's own folder, and its site folder."""

    def __init__(self, state_folder: Path, site_folder: Path) -> None:
        self.state_folder = state_folder
        self.site_folder = site_folder
        self.went_back = ""
        """Why the map before the last one runs, as a sentence; empty while the last one does."""

    def clear_up(self, others: Iterable[Path] = ()) -> None:
        """Delete what was half-written in the device's folders, and in ``others``, when it was killed."""
        for folder in (
            self.state_folder,
            CalibrationStore(self.state_folder).history_folder,
            self.site_folder,
            *others,
        ):
            with contextlib.suppress(OSError):
                clear_half_written(folder)

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
            return self.stored_settings()
        except InputError:
            # Told at the start, and by the doctor (state_health.py).
            return Settings(), 0

    def stored_settings(self) -> tuple[Settings, int]:
        """Return the settings that ran last, and their revision; the defaults where nothing was ever stored.

        Raises InputError where what is stored is damaged, or fits this version no longer.
        """
        try:
            stored = msgspec.json.decode(self._settings_path.read_bytes(), type=_StoredSettings)
            return Settings().changed(stored.values), stored.revision
        except (FileNotFoundError, NotADirectoryError):
            return Settings(), 0
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError, SettingError) as error:
            raise InputError(
                f"The settings in {self._settings_path} cannot be used ({error}), and the defaults run: set them anew"
                f" in the console, or run `rm {shlex.quote(str(self._settings_path))}` to keep the defaults."
            ) from error

    def save_settings(self, settings: Settings, revision: int) -> None:
        """Keep the settings. Raises OSError."""
        make_private(self.state_folder)
        kept = {"revision": revision, "values": settings.values()}
        write_whole(self._settings_path, json.dumps(kept, indent=1).encode())

    @property
    def _consent_path(self) -> Path:
        return self.state_folder / "consent.json"

    @property
    def _accesses_path(self) -> Path:
        return self.state_folder / "accesses.json"

    def consent_stamp(self) -> tuple[int, int] | None:
        """Return what tells one version of the file of consent from another; None where there is none."""
        try:
            found = self._consent_path.stat()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns

    def load_consent(self, default: Consent = DEFAULT_CONSENT) -> Consent:
        """Return what the walker shares; ``default`` where nothing was ever stored.

        Raises InputError where what is stored cannot be read: nothing is shared then, until the walker says so.
        """
        try:
            return msgspec.json.decode(self._consent_path.read_bytes(), type=Consent)
        except (FileNotFoundError, NotADirectoryError):
            return default
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise InputError(
                f"What is shared, in {self._consent_path}, cannot be read ({error}), and nothing is shared: say it anew"
                " with `vbr consent`."
            ) from error

    def save_consent(self, consent: Consent) -> None:
        """Keep what the walker shares. Raises OSError.

        Where another process has said something else meanwhile, neither undoes the other: what both allow is kept.
        """

        def merged(kept: Consent) -> Consent:
            return consent if kept.version < consent.version or kept == consent else shared_by_both(kept, consent)

        self.change_consent(merged)

    def change_consent(self, changed: Callable[[Consent], Consent], default: Consent = DEFAULT_CONSENT) -> Consent:
        """Keep what ``changed`` makes of what is shared, with nobody writing between, and return it. Raises OSError.

        What cannot be read shares nothing; ``default`` holds where nothing was ever stored, and is then kept as well.
        """
        make_private(self.state_folder)
        with (self.state_folder / "consent.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            try:
                kept = self.load_consent(default)
            except InputError:
                kept = NOTHING_SHARED
            consent = changed(kept)
            write_whole(self._consent_path, msgspec.json.encode(consent))
        return consent

    def load_accesses(self, now_s: float) -> Accesses | None:
        """Return who has watched, and looked at what is kept, as it was told last, at ``now_s`` (Unix time); or None.

        Raises InputError where it cannot be read; the console tells it anew at the next joining.
        """
        try:
            told = msgspec.json.decode(self._accesses_path.read_bytes(), type=Accesses)
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise InputError(
                f"Who has watched, in {self._accesses_path}, cannot be read ({error}): the console tells it anew."
            ) from error
        return msgspec.structs.replace(told, now_s=now_s)

    def save_accesses(self, accesses: Accesses) -> None:
        """Keep who has watched, and looked at what is kept. Raises OSError."""
        write_whole(self._accesses_path, msgspec.json.encode(accesses))

    def save_graph(self, graph: PoiGraph) -> None:
        """Keep the PoI-graph in the site. Raises OSError."""
        save_poi_graph(graph, self.site_folder)

    def save_link_state(self, state: LinkState) -> None:
        """Leave how the link stands for whoever looks after the device. Raises OSError."""
        fresh = self.link_state_path.with_suffix(".new")
        fresh.write_bytes(msgspec.json.format(msgspec.json.encode(state), indent=1))
        os.replace(fresh, self.link_state_path)

    @property
    def link_state_path(self) -> Path:
        """How the link stands (:class:`~device_agent.link_state.LinkState`), as JSON."""
        return self.state_folder / "link.json"

    @property
    def previous_map(self) -> Path:
        """Where the map before the present one is kept."""
        return previous_site(self.site_folder)

    def swap_map(self, staging: Path) -> None:
        """Move a staged site into place, and keep the one before. Raises OSError or SiteError; the old one stays then.

        Whoever is killed in between finds the old one or the new one, whole, at the next start.
        """
        if not staging.is_dir():
            raise SiteError(f"The new map is no longer at {staging}: publish it again.")
        sync_tree(staging)
        swap_in(staging, self.site_folder, keep=self.previous_map)

    def load_map(self) -> Site:
        """Read the map; the one before where it is damaged. Raises SiteError where neither can be read."""
        with contextlib.suppress(OSError):
            # Where the map before cannot be kept, this one runs all the same.
            keep_aside(self.site_folder, self.previous_map)
        try:
            return load_site(self.site_folder)
        except SiteError as error:
            with contextlib.suppress(SiteError, OSError):
                return self._gone_back(error)
            raise

    def _gone_back(self, error: SiteError) -> Site:
        site = load_site(self.previous_map)
        swap_in(self.previous_map, self.site_folder, keep=self.site_folder.with_name(f".{self.site_folder.name}-bad"))
        self.went_back = f"The map could not be read ({error}): the one before it runs until a new one has come."[:500]
        _log.warning("%s", self.went_back)
        return site
