"""``vbr console backup`` and ``vbr console restore``."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from console.audit_command import command_line
from navcore.errors import InputError

if TYPE_CHECKING:
    from console.backup_archive import BackupManifest, Progress
    from console.restore import Restored

_STEP_PERCENT = 10
_RIGHTS_OF_NOW = (
    "Passwords, roles, locked accounts and device tokens are those of now; accounts and tokens made since the backup"
    " are gone."
)
_RIGHTS_OF_THEN = (
    "Accounts, passwords and device tokens are those of then: take back again what was taken back since (`vbr console"
    " token --list`)."
)


def add_backup_commands(
    below: argparse._SubParsersAction[argparse.ArgumentParser], add_places: Callable[[argparse.ArgumentParser], None]
) -> None:
    """Add both; ``add_places`` adds the options that name site and data."""
    backup = below.add_parser(
        "backup",
        help="write everything that a console keeps to one file, also while it runs",
        description="Write the site, the database, recordings, incidents and built maps to one new file."
        " The file holds what is recorded of walkers, and everybody's accounts: keep it as safe as the console.",
    )
    backup.add_argument("file", type=Path, metavar="FILE", help="the new file, as backup-2026-11-29.zip")
    add_places(backup)
    backup.set_defaults(run=run_backup)
    restore = below.add_parser(
        "restore",
        help="make a console again from such a file, or check one",
        description="Unpack a backup beside its place, check all of it, and only then put it in place.",
    )
    restore.add_argument("file", type=Path, metavar="FILE", help="a file that `vbr console backup` made")
    restore.add_argument("--verify", action="store_true", help="only check the file")
    restore.add_argument(
        "--replace", action="store_true", help="replace a site and data that are there; they are kept aside"
    )
    add_places(restore)
    restore.set_defaults(run=run_restore)


def run_backup(arguments: argparse.Namespace) -> None:
    """Make a backup."""
    from console.backup import back_up

    data_folder = data_folder_of(arguments)
    made = back_up(site_folder_of(arguments), data_folder, arguments.file, progress=_percent("Backup"))
    _write_down_backup(data_folder, arguments.file)
    for path in made.left_out:
        sys.stderr.write(f"Left out, for it is nothing of the console's, or a link: {path}\n")
    sys.stdout.write(
        f"{made.file}: {_of(made.manifest, made.manifest.graph_version)}, {made.size_bytes / 1e6:,.1f} MB.\n"
    )


def _write_down_backup(data_folder: Path, file: Path) -> None:
    """Write down who has taken a copy of everything; the copy is whole also where the disk has no room for that."""
    from sqlalchemy.exc import OperationalError

    from console.store import Store

    try:
        store = Store.open(data_folder)
        try:
            store.audit(command_line(), "backup", str(file))
        finally:
            store.close()
    except (InputError, OperationalError) as error:
        sys.stderr.write(f"The backup is made, but could not be written down in the audit log ({error}).\n")


def run_restore(arguments: argparse.Namespace) -> None:
    """Restore a backup, or check one."""
    from console.restore import restore, verify_backup

    if arguments.verify:
        manifest = verify_backup(arguments.file, _percent("Checked"))
        sys.stdout.write(f"{arguments.file} is whole: {_of(manifest, manifest.graph_version)}.\n")
        return
    site_folder, data_folder = site_folder_of(arguments), data_folder_of(arguments)
    done = restore(arguments.file, site_folder, data_folder, replace=arguments.replace, progress=_percent("Restored"))
    _tell_restored(done, site_folder, data_folder)


def _tell_restored(done: Restored, site_folder: Path, data_folder: Path) -> None:
    sys.stdout.write(f"{site_folder} and {data_folder} are {_of(done.manifest, done.graph_version)}.\n")
    rights = _RIGHTS_OF_NOW if done.are_rights_of_now else _RIGHTS_OF_THEN
    sys.stdout.write(
        f"Everybody signs in anew. {rights} What is older than may be kept is deleted at the next start.\n"
    )
    for path in done.kept:
        sys.stdout.write(f"What was there before is in {path}: delete it when nothing in it is needed any more.\n")


def site_folder_of(arguments: argparse.Namespace) -> Path:
    """Return the site's folder that the command line names. Raises InputError where it names none."""
    if arguments.site is None:
        raise InputError("Which site? Name its folder with --site DIR: it belongs to the console's backup.")
    return Path(arguments.site)


def data_folder_of(arguments: argparse.Namespace) -> Path:
    """Return the console's folder that the command line names. Raises InputError where it names none."""
    if arguments.data is not None:
        return Path(arguments.data)
    if arguments.site is None:
        raise InputError("Which console? Name the site's folder with --site DIR, or the database's with --data DIR.")
    from console.opening import default_data_folder

    return default_data_folder(arguments.site)


def _of(manifest: BackupManifest, draft_version: int) -> str:
    made = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(manifest.made_at_s))
    return f"{manifest.site_name} as of {made}, {len(manifest.files)} files, draft version {draft_version}"


def _percent(word: str) -> Progress:
    """Return what prints each tenth that is done, on stderr."""
    told = 0

    def progress(share: float) -> None:
        nonlocal told
        if (percent := int(100 * share)) >= told + _STEP_PERCENT:
            told = percent - percent % _STEP_PERCENT
            sys.stderr.write(f"{word}: {told} %\n")

    return progress
