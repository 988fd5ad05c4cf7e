"""What is replaced is kept, or not replaced: no failure of the disk makes it disappear."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from test_console_backup import Place

from console.backup import back_up
from console.backup_archive import BackupError
from console.restore import restore
from device_agent.device_store import DeviceStore
from navcore.errors import InputError
from navcore.folder_swap import aside, swap_in
from navcore.site import Site, save_site


def made(folder: Path) -> Path:
    folder.mkdir()
    (folder / "name").write_text(folder.name)
    return folder


def test_a_folder_that_cannot_be_kept_is_not_replaced(tmp_path: Path) -> None:
    old, fresh, keep = made(tmp_path / "old"), made(tmp_path / "fresh"), tmp_path / "keep"
    keep.write_text("no folder")
    with pytest.raises(OSError, match="directory"):
        swap_in(fresh, old, keep)
    assert [(each / "name").read_text() for each in (old, fresh)] == ["old", "fresh"]
    keep.unlink()
    swap_in(fresh, old, keep)
    assert [(each / "name").read_text() for each in (old, keep)] == ["fresh", "old"]


def test_what_waits_aside_is_kept_before_anything_takes_its_place(tmp_path: Path) -> None:
    folder, fresh, keep = made(tmp_path / "folder"), made(tmp_path / "fresh"), tmp_path / "keep"
    os.replace(made(tmp_path / "old"), aside(folder))
    keep.write_text("no folder")
    with pytest.raises(OSError, match="directory"):
        swap_in(fresh, folder, keep)
    assert (aside(folder) / "name").read_text() == "old"
    assert (folder / "name").read_text() == "folder"


def test_the_console_before_a_restore_is_not_deleted_where_it_cannot_be_kept(
    tmp_path: Path, small_site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Place(tmp_path / "here")
    place.site.parent.mkdir()
    save_site(small_site, place.site)
    place.edit("Kiosk")
    file = back_up(place.site, place.data, tmp_path / "b.zip").file
    place.edit("Later")
    later, real = place.content(), os.replace

    def failing(source: Path, target: Path) -> None:
        if Path(target).name == "site.console.before-restore":
            raise OSError(5, "Input/output error")
        real(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(BackupError, match="Input/output error"):
        restore(file, place.site, place.data, replace=True)
    with pytest.raises(InputError, match="cannot be brought to its end"):
        place.content()
    monkeypatch.undo()
    # The next start, on a disk that works again, goes on; and what was there is whole.
    assert "Later" not in place.content()["draft"]
    kept = Place(tmp_path / "kept")
    kept.site.parent.mkdir()
    for name in ("site", "site.console"):
        os.replace(place.site.with_name(f"{name}.before-restore"), kept.site.with_name(name))
    assert kept.content() == later


def test_who_comes_while_a_backup_is_unpacked_is_not_replaced_unasked(tmp_path: Path, small_site: Site) -> None:
    place, other = Place(tmp_path / "here"), Place(tmp_path / "there")
    for each in (place, other):
        each.site.parent.mkdir()
        save_site(small_site, each.site)
    place.edit("Kiosk")
    file = back_up(place.site, place.data, tmp_path / "b.zip").file
    shutil.rmtree(other.site)

    def come(share: float) -> None:
        if not other.site.exists():
            save_site(small_site, other.site)

    with pytest.raises(BackupError, match="in use already"):
        restore(file, other.site, other.data, progress=come)
    assert sorted(path.name for path in other.site.parent.iterdir()) == ["site"]


def test_a_device_whose_map_before_cannot_be_kept_runs_the_new_one(tmp_path: Path, small_site: Site) -> None:
    store = DeviceStore(tmp_path / "state", tmp_path / "site")
    save_site(small_site, store.site_folder)
    made(tmp_path / "old")
    # Killed in the middle of a swap, on a disk that has another thing where the map before is kept.
    os.replace(tmp_path / "old", aside(store.site_folder))
    store.previous_map.write_text("no folder")
    assert store.load_map().name == small_site.name
