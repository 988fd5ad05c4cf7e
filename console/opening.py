"""Opening what a console needs: the site, the database, the model over both."""

from __future__ import annotations

import os
from pathlib import Path

from console.audit_command import command_line
from console.config import ConsoleConfig
from console.device_store import DeviceStore
from console.folder_restore import finish_restore
from console.graph_store import StoredGraphLog, graph_key
from console.hub import DeviceHub
from console.model import SiteModel
from console.secrets_kept import new_token
from console.services import Services, build_services
from console.store import Store
from navcore.errors import InputError
from navcore.site import Site, load_site, map_checksum
from navcore.site_files import clear_half_written


def default_data_folder(site_folder: Path) -> Path:
    """Return where the database of a site lies unless somebody says otherwise: beside the site's folder."""
    resolved = site_folder.resolve()
    return resolved.parent / f"{resolved.name}.console"


def open_services(config: ConsoleConfig) -> Services:
    """Open site and database. Raises SiteError or InputError with what is wrong."""
    finish_restore(config.data_folder)
    site = load_site(config.site_folder)
    clear_half_written(config.site_folder)
    store = Store.open(config.data_folder)
    try:
        model = open_model(store, site, config.site_folder)
        return build_services(config, store, model, DeviceHub(wall_s=store.wall_s))
    except BaseException:
        store.close()
        raise


def open_model(store: Store, site: Site, site_folder: Path) -> SiteModel:
    """Return draft and published graph of a site. Raises InputError where the log of edits cannot be read."""
    key = graph_key(site.site_id, map_checksum(site_folder))
    return SiteModel(site, StoredGraphLog(store, key, site.name), site_folder, store.wall_s)


def _make_token_file(path: Path) -> None:
    """In one step: a file without its token would lock the device out, and no later start would mend it."""
    fresh = path.with_name(f".{path.name}.new")
    with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="ascii") as out:
        out.write(new_token() + "\n")
    os.replace(fresh, path)


def let_token_of_file_in(devices: DeviceStore, path: Path) -> str | None:
    """Let the device token in a file in; a file that does not exist yet is written with a new one.

    The device's name is the file's, without its ending. Returns what to tell people where the token is void, and stays
    it: None otherwise. Raises InputError where the file cannot be read or written.
    """
    try:
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            _make_token_file(path)
        token = path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"The device token file {path} cannot be used ({error}): name another one.") from error
    if len(token) < 20 or not token.isprintable() or " " in token:
        raise InputError(f"The device token file {path} holds no token: delete it, and a new one is made.")
    if devices.ensure_token(path.stem, token, command_line()):
        return None
    return (
        f"The device token in {path} was taken back, or replaced by a newer one: it lets no device in. To let this"
        f" device in again, delete the file and start again, which makes a new token; or write the one into it that"
        f" `vbr console token {path.stem}` prints, and give it to the device."
    )
