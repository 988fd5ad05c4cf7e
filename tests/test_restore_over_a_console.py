"""A restore over a console that is there: what it still knows of the one that the backup was taken of, and what not."""

from __future__ import annotations

from pathlib import Path

from test_console_backup import Place, names_of

from console.backup import back_up
from console.restore import restore
from navcore.site import Site, save_site


def published_at(folder: Path, site: Site) -> Place:
    """Return a console that has published once."""
    place = Place(folder)
    folder.mkdir()
    save_site(site, place.site)
    publish(place, "Kiosk")
    return place


def publish(place: Place, name: str) -> int:
    place.edit(name)
    with place.opened() as services:
        return services.model.publish("Ada").version


def test_over_a_console_that_was_just_installed_no_number_stands_for_two_graphs(
    tmp_path: Path, small_site: Site
) -> None:
    old = published_at(tmp_path / "old", small_site)
    file = back_up(old.site, old.data, tmp_path / "b.zip").file
    issued = {publish(old, name) for name in ("Later", "Later still", "Last")}
    # One that nobody has touched, one with edits of its own, and the one that the backup is of.
    installed, other = Place(tmp_path / "new"), published_at(tmp_path / "other", small_site)
    installed.site.parent.mkdir()
    save_site(small_site, installed.site)
    with installed.opened():
        pass
    for place in (installed, other, old):
        restore(file, place.site, place.data, replace=True)
        with place.opened() as services:
            restored = services.model.published
        assert names_of(restored) == {"Hall", "Bar", "Kiosk"}
        assert restored.version > max(issued)
    # That one has been asked: it has given no more than these.
    assert restored.version == max(issued) + 1
