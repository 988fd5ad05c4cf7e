"""A restore over a console that is there: what it still knows of the one that the backup was taken of, and what not."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_console_backup import Place, names_of

from console.backup import back_up
from console.errors import SignInError
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


PASSWORDS = {each: f"the {each} password of Ada" for each in ("first", "second")}


def test_who_was_locked_out_since_the_backup_is_not_let_in_by_it(tmp_path: Path, small_site: Site) -> None:
    place, elsewhere = published_at(tmp_path / "here", small_site), published_at(tmp_path / "there", small_site)
    with place.opened() as services:
        accounts, devices = services.accounts, services.devices
        ada = accounts.use_link(accounts.new_admin_link_token("command line"), "Ada", PASSWORDS["first"])
        ben, _ = accounts.invite("Ben", "editor", "Ada")
        eve, link = accounts.invite("Eve", "admin", "Ada")
        accounts.use_link(link, "", PASSWORDS["first"])
        tokens = {name: devices.create_token(name, "Ada") for name in ("lost", "kept", "made anew")}
    file = back_up(place.site, place.data, tmp_path / "b.zip").file
    with place.opened() as services:
        accounts, devices = services.accounts, services.devices
        accounts.use_link(accounts.new_password_link(ada.id, "Ada"), "", PASSWORDS["second"])
        accounts.change(eve.id, "Ada", disabled=True)
        accounts.change(ben.id, "Ada", role="viewer")
        accounts.invite("Zoe", "admin", "Eve")
        devices.revoke_token("lost", "Ada")
        anew = devices.create_token("made anew", "Ada")
        devices.create_token("made since", "Eve")
    # Another console has an account and a token of the same number and name, which are nothing to these.
    with elsewhere.opened() as services:
        accounts = services.accounts
        accounts.use_link(accounts.new_admin_link_token("command line"), "Somebody else", PASSWORDS["second"])
        services.devices.create_token("lost", "Somebody else")
    for each in (place, elsewhere):
        done = restore(file, each.site, each.data, replace=True)
        assert done.are_rights_of_now == (each is place)
    with place.opened() as services:
        accounts, devices = services.accounts, services.devices
        assert [(user.name, user.role, user.disabled) for user in accounts.users()] == [
            ("Ada", "admin", False), ("Ben", "viewer", False), ("Eve", "admin", True),
        ]  # fmt: skip
        for name, password in (("Ada", "first"), ("Eve", "first")):
            with pytest.raises(SignInError):
                accounts.sign_in(name, PASSWORDS[password], "192.0.2.1")
        assert accounts.sign_in("Ada", PASSWORDS["second"], "192.0.2.1")
        assert {name: devices.name_of(token) for name, token in tokens.items()} == {
            "lost": None, "kept": "kept", "made anew": None,
        }  # fmt: skip
        assert devices.name_of(anew) == "made anew"
        assert len(devices.tokens()) == len(tokens)
    with elsewhere.opened() as services:
        assert services.accounts.sign_in("Ada", PASSWORDS["first"], "192.0.2.1")
        assert services.devices.name_of(tokens["lost"]) == "lost"
