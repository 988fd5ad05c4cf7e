"""A backup that root makes of another account's folders holds nothing that a link of that account's leads to."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from test_console_backup import Place, keep_walk

from console.backup import back_up
from console.backup_archive import BackupError
from console.disk_reserve import put_by
from console.folder_restore import finish_restore
from console.plain_files import LinkedError, open_below
from console.restore import restore
from console.store import DATABASE_FILE
from navcore.errors import InputError
from navcore.folder_swap import recover
from navcore.site import GRAPH_FILE, Site, save_site
from navcore.site_files import MANIFEST, read_manifest

NOBODY = 65_534
SECRET = b"of root alone"


@pytest.fixture
def place(tmp_path: Path, small_site: Site) -> Place:
    """A console that has a walk."""
    found = Place(tmp_path / "here")
    found.site.parent.mkdir()
    save_site(small_site, found.site)
    keep_walk(found, "walk", 1000.0)
    return found


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """A folder with a file that the account that owns the console's folders cannot read."""
    folder = tmp_path / "secret"
    folder.mkdir(mode=0o700)
    (folder / "key").write_bytes(SECRET)
    return folder


def moved_behind_a_link(path: Path) -> None:
    """Put what is there elsewhere, and a link to it in its place."""
    path.rename(path.with_name(f"{path.name}.elsewhere"))
    path.symlink_to(path.with_name(f"{path.name}.elsewhere"))


def names_in(file: Path) -> list[str]:
    with zipfile.ZipFile(file) as archive:
        assert all(SECRET not in archive.read(name) for name in archive.namelist())
        return archive.namelist()


@pytest.mark.parametrize(
    "name", ["recordings", "incidents", "maps", DATABASE_FILE, MANIFEST, GRAPH_FILE, "a site file"]
)
def test_a_link_in_the_place_of_a_folder_or_of_a_file_that_is_always_there_is_refused(
    tmp_path: Path, place: Place, secret: Path, name: str
) -> None:
    if name in ("incidents", "maps"):
        path = place.data / name
        path.symlink_to(secret)
    else:
        name = min(read_manifest(place.site).files) if name == "a site file" else name
        path = (place.data if (place.data / name).exists() else place.site) / name
        if not path.exists():
            path.write_bytes(b"")
        moved_behind_a_link(path)
    with pytest.raises(LinkedError, match=f"{path} is a link"):
        back_up(place.site, place.data, tmp_path / "b.zip")
    assert not (tmp_path / "b.zip").exists()


def test_links_further_down_are_left_out_and_named(tmp_path: Path, place: Place, secret: Path) -> None:
    to_file, to_folder = place.data / "recordings" / "a.mcap", place.data / "recordings" / "more"
    to_file.symlink_to(secret / "key")
    to_folder.symlink_to(secret)
    made = back_up(place.site, place.data, tmp_path / "b.zip")
    assert set(made.left_out) == {to_file, to_folder}
    assert any(name.startswith("data/recordings/") for name in names_in(made.file))


def test_a_link_that_is_put_there_while_the_backup_is_made_is_not_followed(
    tmp_path: Path, place: Place, secret: Path
) -> None:
    """All files have been listed by then, and the folder is another one."""
    (secret / "a.mcap").write_bytes(SECRET)
    (place.data / "recordings" / "a.mcap").write_bytes(b"mine.........")

    def swap(share: float) -> None:
        if not (place.data / "recordings").is_symlink():
            (place.data / "recordings").rename(place.data / "theirs")
            (place.data / "recordings").symlink_to(secret)

    with pytest.raises(LinkedError, match="is not followed"):
        back_up(place.site, place.data, tmp_path / "b.zip", progress=swap)
    assert not (tmp_path / "b.zip").exists()


def to_a_pipe(path: Path, secret: Path) -> None:
    os.mkfifo(path)


def to_a_file(path: Path, secret: Path) -> None:
    path.symlink_to(secret / "key")


@pytest.mark.parametrize("plant", [to_a_pipe, to_a_file])
def test_only_a_file_itself_is_opened(tmp_path: Path, secret: Path, plant: Callable[[Path, Path], None]) -> None:
    (tmp_path / "data" / "below").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "data")
    (tmp_path / "data" / "below" / "own").write_bytes(b"own")
    plant(tmp_path / "data" / "below" / "planted", secret)
    # The folder itself may be a link: whoever calls has named it.
    with open_below(tmp_path / "link", "below/own") as file:
        assert file.read() == b"own"
    with pytest.raises(LinkedError, match="below/planted is a link"):
        open_below(tmp_path / "data", "below/planted")
    with pytest.raises(FileNotFoundError):
        open_below(tmp_path / "data", "below/nothing")


def test_a_restore_reads_no_database_behind_a_link(tmp_path: Path, place: Place) -> None:
    file = back_up(place.site, place.data, tmp_path / "b.zip").file
    moved_behind_a_link(place.data / DATABASE_FILE)
    before = sorted(path.name for path in place.site.parent.iterdir())
    with pytest.raises(LinkedError, match="is a link"):
        restore(file, place.site, place.data, replace=True)
    assert sorted(path.name for path in place.site.parent.iterdir()) == before


def test_a_restore_writes_no_note_and_unpacks_nothing_behind_a_link(tmp_path: Path, place: Place, secret: Path) -> None:
    file = back_up(place.site, place.data, tmp_path / "b.zip").file
    for name, target in ((".site.console-restore.json.new", secret / "key"), (".site.console-restoring", secret)):
        planted = place.data.with_name(name)
        planted.symlink_to(target)
        with pytest.raises(BackupError, match="cannot be unpacked"):
            restore(file, place.site, place.data, replace=True)
        planted.unlink()
        recover(place.site)
        assert (secret / "key").read_bytes() == SECRET
        assert [path.name for path in secret.iterdir()] == ["key"]
    place.content()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can leave a note in another user's name")
def test_root_moves_no_folder_by_the_note_of_another_user(tmp_path: Path, place: Place, secret: Path) -> None:
    note = place.data.with_name(f".{place.data.name}-restore.json")
    taken = tmp_path / "taken"
    note.write_text(f'{{"swaps": [{{"fresh": "{secret}", "folder": "{taken}", "keep": null}}]}}')
    os.chown(note, NOBODY, NOBODY)
    with pytest.raises(InputError, match="as that user"):
        finish_restore(place.data)
    assert (secret / "key").exists()
    os.chown(note, 0, 0)
    finish_restore(place.data)
    assert (taken / "key").exists(), "by a note of one's own they move"


@pytest.mark.parametrize("plant", [to_a_file, lambda path, secret: path.hardlink_to(secret / "key"), to_a_pipe])
def test_room_is_put_by_in_no_other_file(tmp_path: Path, secret: Path, plant: Callable[[Path, Path], None]) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    plant(folder / "reserve", secret)
    put_by(folder)
    assert (secret / "key").read_bytes() == SECRET
    (folder / "reserve").unlink()
    put_by(folder)
    assert (folder / "reserve").stat().st_size > 0
