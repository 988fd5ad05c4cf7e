"""Backup and restore of a console: at one instant, whole or not at all, and nothing that was taken back comes back."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import resource
import shutil
import signal
import sqlite3
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from console_room import Person, first_admin, serving
from link_processes import ConsoleProcess

from console.backup import KEPT_FOLDERS, MADE_ANEW, back_up
from console.backup_archive import BackupError
from console.config import ConsoleConfig
from console.data_lock import BusyDataError
from console.edits import AddPoi
from console.opening import open_services
from console.restore import restore, verify_backup
from console.services import Services
from console.store import DATABASE_FILE
from device_agent.cli import main
from navcore.errors import InputError
from navcore.recording_upload import RecordingOffer
from navcore.site import Site, load_poi_graph, save_site

DAY_S = 86_400.0


class Place:
    """A console's two folders."""

    def __init__(self, folder: Path) -> None:
        self.site, self.data = folder / "site", folder / "site.console"

    @contextlib.contextmanager
    def opened(self) -> Iterator[Services]:
        services = open_services(ConsoleConfig(self.site, self.data))
        try:
            yield services
        finally:
            services.surveys.close()
            services.store.close()

    def edit(self, name: str) -> None:
        with self.opened() as services:
            services.model.apply(AddPoi(name, "room", 3.0, 0.0), "Ada")

    def content(self) -> dict[str, Any]:
        """Return all that somebody could miss: graphs by content, recordings, whether the database is sound."""
        with self.opened() as services:
            model = services.model
            assert load_poi_graph(self.site).version == model.published.version
            found = {
                "draft": names_of(model.graph), "published": names_of(model.published),
                "walks": [each.entry.offer.name for each in services.recordings.all() if each.complete],
            }  # fmt: skip
        with contextlib.closing(sqlite3.connect(self.data / DATABASE_FILE)) as base:
            assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        return found


def names_of(graph: Any) -> set[str]:
    return {poi.name for poi in graph.pois.values()}


@pytest.fixture
def place(tmp_path: Path, small_site: Site) -> Place:
    """A console that has been used: an edit, one more that is only a draft, and a walk."""
    found = Place(tmp_path / "here")
    found.site.parent.mkdir()
    save_site(small_site, found.site)
    found.edit("Kiosk")
    with found.opened() as services:
        services.model.publish("Ada")
    found.edit("Stairs")
    keep_walk(found, "old walk", 1000.0)
    return found


def keep_walk(place: Place, name: str, at_s: float, data: bytes = b"a walk") -> None:
    sha256 = hashlib.sha256(data).hexdigest()
    with place.opened() as services:
        services.recordings._wall_s = lambda: at_s
        services.recordings.offer(RecordingOffer("walk", name, len(data), sha256, "2026-01-01"), "glasses")
        assert services.recordings.add(sha256, 0, data).complete


def test_what_is_restored_on_another_machine_is_what_was_backed_up(tmp_path: Path, place: Place) -> None:
    before = place.content()
    (place.data / "incidents" / "0123456789abcdef").mkdir(parents=True)
    (place.data / "incidents" / "0123456789abcdef" / "messages.vbrlog").write_bytes(b"VBRLOG1\n")
    made = back_up(place.site, place.data, tmp_path / "backup.zip")
    assert made.left_out == ()
    assert made.file.stat().st_mode & 0o777 == 0o600
    assert verify_backup(made.file) == made.manifest
    other = Place(tmp_path / "there")
    assert restore(made.file, other.site, other.data).kept == ()
    assert (other.data / "incidents" / "0123456789abcdef" / "messages.vbrlog").read_bytes() == b"VBRLOG1\n"
    assert other.content() == before
    assert other.data.stat().st_mode & 0o777 == 0o700
    assert (other.data / DATABASE_FILE).stat().st_mode & 0o777 == 0o600
    assert sorted(path.name for path in other.site.parent.iterdir()) == ["site", "site.console"]


def test_every_folder_that_a_console_keeps_is_either_backed_up_or_made_anew() -> None:
    sources = (Path(__file__).parent.parent / "console").rglob("*.py")
    used = {name for path in sources for name in re.findall(r'data_folder / "([\w-]+)"', path.read_text("utf-8"))}
    assert used == {*KEPT_FOLDERS, *MADE_ANEW}


def test_a_backup_while_people_edit_is_what_they_had_done_at_one_instant(tmp_path: Path, small_site: Site) -> None:
    site = tmp_path / "site"
    save_site(small_site, site)
    console = ConsoleProcess(site, tmp_path)
    try:
        person = Person(f"http://127.0.0.1:{console.port}")
        person.open_link(console.first_link, "Ada").raise_for_status()
        acknowledged: list[str] = []
        enough, stopped = threading.Semaphore(0), threading.Event()

        def edit() -> None:
            while not stopped.is_set():
                name = f"Room {len(acknowledged)}"
                person.edit("add_poi", name=name, kind="room", x_m=3.0, y_m=0.0).raise_for_status()
                acknowledged.append(name)
                if len(acknowledged) % 3 == 0:
                    version = person.graph()["version"]
                    publish = {"version": version, "confirmed": True}
                    person.http.post("/api/publish", json=publish).raise_for_status()
                enough.release()

        editing = threading.Thread(target=edit)
        editing.start()
        seen: list[tuple[int, int, Path]] = []
        for number in range(3):
            for _ in range(4):
                assert enough.acquire(timeout=60.0)
            before = len(acknowledged)
            file = back_up(site, tmp_path / "data", tmp_path / f"{number}.zip").file
            seen.append((before, len(acknowledged) + 1, file))
        stopped.set()
        editing.join()
    finally:
        console.kill()
    for before, after, file in seen:
        assert_graph_is_the_published_one(file, tmp_path / f"{file.stem}.sqlite3")
        other = Place(tmp_path / file.stem)
        restore(file, other.site, other.data)
        content = other.content()
        rooms = content["draft"] - {"Hall", "Bar"}
        assert before <= len(rooms) <= after
        assert rooms == {f"Room {number}" for number in range(len(rooms))}
        published = content["published"] - {"Hall", "Bar"}
        assert published == {f"Room {number}" for number in range(len(published))}
        assert len(rooms) - 3 <= len(published)


def assert_graph_is_the_published_one(backup: Path, copy: Path) -> None:
    """Also for whoever takes the site out of the archive by hand."""
    with zipfile.ZipFile(backup) as archive:
        graph = msgspec.json.decode(archive.read("site/poi_graph.json"))
        copy.write_bytes(archive.read(f"data/{DATABASE_FILE}"))
    with contextlib.closing(sqlite3.connect(copy)) as base:
        (text,) = base.execute("SELECT graph_json FROM publications ORDER BY version DESC LIMIT 1").fetchone()
    published = msgspec.json.decode(text)
    assert (graph["version"], graph["pois"]) == (published["version"], published["pois"])


def test_who_signed_out_or_used_a_link_is_not_let_in_by_a_restore(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    other = Place(tmp_path / "there")
    with serving(tmp_path / "site", tmp_path / "data") as server:
        person = first_admin(server)
        link = person.http.post("/api/users", json={"name": "Ben", "role": "viewer"}).json()["link"]
        restore(back_up(tmp_path / "site", tmp_path / "data", tmp_path / "b.zip").file, other.site, other.data)
        assert person.http.get("/api/graph").status_code == 200
    with serving(other.site, other.data) as server:
        again = Person(server.ready.url)
        again.http.cookies = person.http.cookies
        assert again.http.get("/api/graph").status_code == 401
        assert again.open_link(link, "Ben").status_code == 404
        assert again.sign_in("Ada").status_code == 200


def test_a_console_that_runs_is_not_restored_over_and_none_starts_meanwhile(tmp_path: Path, place: Place) -> None:
    file = back_up(place.site, place.data, tmp_path / "b.zip").file
    with place.opened(), pytest.raises(BusyDataError, match="stop the console"):
        restore(file, place.site, place.data, replace=True)
    started: list[str] = []

    def start(share: float) -> None:
        if not started:
            with pytest.raises(BusyDataError) as error, place.opened():
                pass
            started.append(str(error.value))

    restore(file, place.site, place.data, replace=True, progress=start)
    assert len(started) == 1


def test_what_is_there_is_replaced_only_on_demand_and_kept_aside(tmp_path: Path, place: Place) -> None:
    file, before = back_up(place.site, place.data, tmp_path / "b.zip").file, place.content()
    place.edit("Later")
    later = place.content()
    with pytest.raises(BackupError, match="--replace"):
        restore(file, place.site, place.data)
    assert place.content() == later
    kept = restore(file, place.site, place.data, replace=True).kept
    assert place.content() == before
    with pytest.raises(BackupError, match="earlier restore"):
        restore(file, place.site, place.data, replace=True)
    back = Place(tmp_path / "back")
    back.site.parent.mkdir()
    for old, new in zip(kept, (back.site, back.data), strict=True):
        old.rename(new)
    assert back.content() == later
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "letter.txt").write_text("Dear Ada")
    with pytest.raises(BackupError, match="other files"):
        restore(file, place.site, tmp_path / "foreign", replace=True)
    with pytest.raises(BackupError, match="in one another"):
        restore(file, tmp_path / "both", tmp_path / "both" / "data")
    assert (tmp_path / "foreign" / "letter.txt").read_text() == "Dear Ada"


def test_a_device_with_a_graph_of_after_the_backup_is_offered_the_restored_one(tmp_path: Path, place: Place) -> None:
    file = back_up(place.site, place.data, tmp_path / "b.zip").file
    issued = set[int]()
    for name in ("Later", "Later still"):
        place.edit(name)
        with place.opened() as services:
            issued.add(services.model.publish("Ada").version)
    elsewhere = Place(tmp_path / "there")
    restore(file, elsewhere.site, elsewhere.data)
    restore(file, place.site, place.data, replace=True)
    for each in (place, elsewhere):
        with each.opened() as services:
            assert services.model.published.version > max(issued)
            assert services.model.graph.version > services.model.published.version
            assert names_of(services.model.graph_at(services.model.published.version)) == {"Hall", "Bar", "Kiosk"}
            assert names_of(services.model.graph) == {"Hall", "Bar", "Kiosk", "Stairs"}


def test_what_was_too_old_when_it_was_restored_is_deleted_at_the_next_start(tmp_path: Path, place: Place) -> None:
    now_s = 1000.0 + 30 * DAY_S
    keep_walk(place, "young walk", now_s - DAY_S, b"another")
    other = Place(tmp_path / "there")
    file = back_up(place.site, place.data, tmp_path / "b.zip", wall_s=lambda: 2000.0).file
    restore(file, other.site, other.data, wall_s=lambda: now_s)
    assert set(other.content()["walks"]) == {"old walk", "young walk"}
    with other.opened() as services:
        services.store.wall_s = lambda: now_s + 60.0
        run = services.retention.run()
    assert run.problems == ()
    assert other.content()["walks"] == ["young walk"]


# ----------------------------------------------------------------------------------------------------------- damage
def altered(source: Path, target: Path, alter: Callable[[dict[str, bytes], dict[str, Any]], None], **info: Any) -> Path:
    """Write a backup anew, after something was done to its files and to its list."""
    with zipfile.ZipFile(source) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    listed = msgspec.json.decode(files.pop("backup.json"))
    alter(files, listed)
    with zipfile.ZipFile(target, "w", info.get("kind", zipfile.ZIP_STORED)) as archive:
        for name, data in {**files, "backup.json": msgspec.json.encode(listed)}.items():
            archive.writestr(name, data)
    return target


def escape(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    files["data/../../evil"] = b""
    listed["files"]["data/../../evil"] = {"size": 0, "sha256": ""}


def flip(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    name = next(name for name in files if name.startswith("data/recordings") and name.endswith(".mcap"))
    files[name] = bytes(files[name][:-1]) + b"?"


def lose(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    del files[f"data/{DATABASE_FILE}"]


def lose_both(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    lose(files, listed)
    del listed["files"][f"data/{DATABASE_FILE}"]


def add(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    files["data/recordings/more.mcap"] = b"more"


def both(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    for name in ("data/recordings/a", "data/recordings/a/b"):
        files[name] = b""
        listed["files"][name] = {
            "size": 0,
            "sha256": "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
        }


def newer(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    listed["schema_version"] = 99


def other_map(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    listed["map_sha256"] = "0" * 64


def negative(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    listed["files"][f"data/{DATABASE_FILE}"]["size"] = -1


def same(files: dict[str, bytes], listed: dict[str, Any]) -> None:
    """Nothing is done to it."""


DAMAGE: dict[str, tuple[Callable[..., None], dict[str, Any], str]] = {
    "a path that leads out": (escape, {}, "no file of a backup"),
    "another byte": (flip, {}, "checksum is another"),
    "a file is gone": (lose, {}, "lacks"),
    "file and entry are gone": (lose_both, {}, "lacks the database"),
    "a file too many": (add, {}, "does not name"),
    "a file that is a folder": (both, {}, "a file and a folder"),
    "of a newer program": (newer, {}, "update this program"),
    "another map": (other_map, {}, "another map"),
    "a size below nothing": (negative, {}, "not as large"),
    "packed": (same, {"kind": zipfile.ZIP_DEFLATED}, "not stored as backups are"),
}


def test_a_backup_that_is_damaged_is_refused_and_changes_nothing(tmp_path: Path, place: Place) -> None:
    whole = back_up(place.site, place.data, tmp_path / "whole.zip").file
    bad: list[tuple[Path, str]] = [
        (altered(whole, tmp_path / f"{number}.zip", alter, **info), words)
        for number, (alter, info, words) in enumerate(DAMAGE.values())
    ]
    data = whole.read_bytes()
    for name, contents in {
        "cut": data[:-100], "empty": b"", "half": data[: len(data) // 2], "text": b"Dear Ada",
        "long list": data[:-10] + b"\xff" * 4 + data[-6:],
    }.items():  # fmt: skip
        (tmp_path / name).write_bytes(contents)
        bad.append((tmp_path / name, "no backup"))
    bad.append((tmp_path / "missing", "cannot be read"))
    before, names = place.content(), sorted(path.name for path in place.site.parent.iterdir())
    for file, words in bad:
        with pytest.raises(BackupError, match=words):
            verify_backup(file)
        with pytest.raises(BackupError, match=words):
            restore(file, place.site, place.data, replace=True)
        with pytest.raises(BackupError, match=words):
            restore(file, tmp_path / "there" / "site", tmp_path / "there" / "data")
        assert sorted(path.name for path in place.site.parent.iterdir()) == names
    assert place.content() == before
    assert not (tmp_path / "there" / "data").exists()
    assert not (tmp_path / "evil").exists()


def test_a_damaged_database_is_not_backed_up(tmp_path: Path, place: Place) -> None:
    database = place.data / DATABASE_FILE
    data = bytearray(database.read_bytes())
    # Every page but the first holds something else.
    data[4096:] = bytes(len(data) - 4096)
    database.write_bytes(data)
    with pytest.raises(InputError, match=r"damaged|cannot be read"):
        back_up(place.site, place.data, tmp_path / "b.zip")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["here"]


# ------------------------------------------------------------------------------------------------------------ kills
def killed_at(step: int, work: Callable[[], object]) -> bool:
    """Do something in a process that is killed as ``kill -9`` does before its given change of the disk.

    Returns False where it has come to its end before.
    """
    child = os.fork()
    if child == 0:
        done = 0

        def watch(event: str, arguments: tuple[Any, ...]) -> None:
            nonlocal done
            is_write = event == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)
            if is_write or event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "shutil.rmtree"):
                if done == step:
                    os.kill(os.getpid(), signal.SIGKILL)
                done += 1

        sys.addaudithook(watch)
        try:
            work()
        finally:
            os._exit(0)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


def test_killed_at_any_moment_of_a_restore_the_console_is_the_old_one_or_the_new_one(
    tmp_path: Path, place: Place
) -> None:
    file, new = back_up(place.site, place.data, tmp_path / "b.zip").file, place.content()
    place.edit("Later")
    old, saw = place.content(), list[str]()
    saved = {path: read_tree(path) for path in (place.site, place.data)}
    step = 0
    while killed_at(step, lambda: restore(file, place.site, place.data, replace=True)):
        found = place.content()
        assert found in (old, new)
        saw.append("old" if found == old else "new")
        if found == new:
            assert read_tree(place.site.with_name("site.before-restore")) == saved[place.site]
            kept = Place(tmp_path / f"kept {step}")
            kept.site.parent.mkdir()
            for name in ("site", "site.console"):
                place.site.with_name(f"{name}.before-restore").rename(kept.site.with_name(name))
            assert kept.content() == old
            write_tree(place, saved)
        # In the part before the swap all steps are alike: some of them will do.
        step += 7 if len(saw) < 12 and step < 60 else 1
    assert saw == sorted(saw, reverse=True)
    assert {"old", "new"} == set(saw)


def read_tree(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def write_tree(place: Place, saved: dict[Path, dict[str, bytes]]) -> None:
    for folder, files in saved.items():
        shutil.rmtree(folder)
        for name, data in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)


def test_killed_at_any_moment_of_a_backup_there_is_none_or_a_whole_one(tmp_path: Path, place: Place) -> None:
    file, step = tmp_path / "b.zip", 0
    while killed_at(step, lambda: back_up(place.site, place.data, file)):
        if file.exists():
            verify_backup(file)
            file.unlink()
        step += 2
    assert step > 10
    verify_backup(file)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.zip", "here"]


def test_a_disk_that_is_full_is_told_and_nothing_is_left_behind(tmp_path: Path, place: Place) -> None:
    file = back_up(place.site, place.data, tmp_path / "whole.zip").file
    before, said = place.content(), tmp_path / "said"
    works = (
        lambda: back_up(place.site, place.data, tmp_path / "b.zip"),
        lambda: restore(file, place.site, place.data, replace=True),
    )
    for work in works:
        child = os.fork()
        if child == 0:
            # No file may grow beyond this: as if there were no more room.
            resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))
            # Python ignores its signal; the SDK of a camera, where a test has loaded one, ends by it.
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            try:
                work()
            except BackupError as error:
                said.write_text(str(error), encoding="utf-8")
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        assert "free the disk" in said.read_text(encoding="utf-8") or "cannot be read" in said.read_text("utf-8")
        said.unlink()
        assert place.content() == before
        assert sorted(path.name for path in tmp_path.iterdir()) == ["here", "whole.zip"]
        assert sorted(path.name for path in place.site.parent.iterdir()) == ["site", "site.console"]


def test_the_commands_say_what_they_did_and_what_to_do(
    tmp_path: Path, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*arguments: object) -> str:
        assert main(["console", *map(str, arguments)]) == 0
        return capsys.readouterr().out

    file = tmp_path / "b.zip"
    assert "Small site as of" in run("backup", file, "--site", place.site)
    assert "is whole" in run("restore", file, "--verify")
    restored = run("restore", file, "--site", tmp_path / "there" / "site")
    assert "signs in anew" in restored
    assert Place(tmp_path / "there").content() == place.content()
    with Place(tmp_path / "there").opened() as services, place.opened() as before:
        assert services.model.graph.version != before.model.graph.version
        assert f"draft version {services.model.graph.version}." in restored
    assert "before-restore: delete it" in run("restore", file, "--site", place.site, "--replace")
    assert main(["console", "backup", str(file), "--site", str(place.site)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert main(["console", "backup", str(tmp_path / "nowhere" / "b.zip"), "--site", str(place.site)]) == 2
    assert f"There is no folder {tmp_path / 'nowhere'} for the backup: make it" in capsys.readouterr().err
    assert main(["console", "restore", str(file)]) == 2
    assert "Which site?" in capsys.readouterr().err
