"""The process: where it listens, what it refuses, and what a kill leaves behind."""

from __future__ import annotations

import json
import signal
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from console_room import Person, first_admin, serving

from console.config import ConsoleConfig
from console.device_store import DeviceStore
from console.opening import default_data_folder
from console.server import ConsoleServer, check_listening
from console.store import DATABASE_FILE, Store
from device_agent.cli import main
from navcore.errors import InputError, SiteError
from navcore.site import Site, save_site


@pytest.fixture
def site_folder(tmp_path: Path, small_site: Site) -> Path:
    save_site(small_site, tmp_path / "site")
    return tmp_path / "site"


class Said(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def vbr(capsys: pytest.CaptureFixture[str]) -> Callable[..., Said]:
    def run(*arguments: str | Path) -> Said:
        code = main(["console", *map(str, arguments)])
        return Said(code, *capsys.readouterr())

    return run


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "example.org", "::"])
def test_listening_beyond_this_machine_needs_tls_or_a_word(host: str) -> None:
    with pytest.raises(InputError, match="--insecure-listen"):
        check_listening(ConsoleConfig(Path("s"), Path("d"), host))
    check_listening(ConsoleConfig(Path("s"), Path("d"), host, insecure_listen=True))


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.8.8.8"])
def test_loopback_needs_nothing(host: str) -> None:
    check_listening(ConsoleConfig(Path("s"), Path("d"), host))


def test_half_of_tls_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="both files"):
        check_listening(ConsoleConfig(Path("s"), Path("d"), tls_certificate=tmp_path))
    with pytest.raises(InputError, match="no TLS file"):
        check_listening(ConsoleConfig(Path("s"), Path("d"), tls_certificate=tmp_path / "a", tls_key=tmp_path / "b"))


def test_a_taken_port_is_named(site_folder: Path, vbr: Callable[..., Said]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        answer = vbr("--site", site_folder, "--port", str(port))
    assert answer.code == 2
    assert answer.err == (
        f"vbr: Port {port} of 127.0.0.1 is taken: stop what uses it, or choose another with --port (0 takes any free"
        " one).\n"
    )


def test_a_missing_site_is_one_sentence(tmp_path: Path, vbr: Callable[..., Said]) -> None:
    with pytest.raises(SiteError, match="vbr map build"):
        ConsoleServer(ConsoleConfig(tmp_path / "none", tmp_path / "data", port=0), with_scene=False)
    assert not (tmp_path / "data").exists()
    assert vbr().err == "vbr: Which site? Name its folder with --site DIR; `vbr map build` makes one.\n"


def test_a_newer_or_damaged_database_is_refused_and_left_alone(site_folder: Path, tmp_path: Path) -> None:
    Store.open(tmp_path / "data").close()
    path = tmp_path / "data" / DATABASE_FILE
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE schema_info SET version = 99")
    connection.close()
    with pytest.raises(InputError, match="version 99"):
        Store.open(tmp_path / "data")
    path.write_bytes(b"not a database at all, though long enough to be looked at" * 30)
    before = path.read_bytes()
    with pytest.raises(InputError, match="backup"):
        Store.open(tmp_path / "data")
    assert path.read_bytes() == before


def test_edits_are_durable_by_configuration(tmp_path: Path) -> None:
    store = Store.open(tmp_path)
    with store.writing() as session:
        connection = session.connection()
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2
        assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar() == 1


def test_a_token_file_is_made_once_and_lets_the_device_in(site_folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "keys" / "walker-1.token"
    for _ in range(2):
        with serving(site_folder, tmp_path / "data", device_token_file=path) as server:
            assert server.services.devices.name_of(path.read_text().strip()) == "walker-1"
            assert path.stat().st_mode & 0o777 == 0o600
            assert len(server.services.devices.tokens()) == 1


def test_the_command_makes_and_revokes_tokens(site_folder: Path, vbr: Callable[..., Said]) -> None:
    token = vbr("token", "glasses", "--site", site_folder).out.strip()
    store = Store.open(default_data_folder(site_folder))
    assert DeviceStore(store).name_of(token) == "glasses"
    assert "void" in vbr("--site", site_folder, "token", "glasses", "--revoke").out
    assert DeviceStore(store).name_of(token) is None
    again = vbr("--site", site_folder, "token", "glasses", "--revoke")
    assert (again.code, "was revoked already on 20" in again.out) == (0, True)
    assert [row.action for row in store.latest_audit(9)].count("token_revoked") == 1
    assert "/first?token=" in vbr("admin-link", "--site", site_folder).out


def test_a_new_token_says_what_it_replaces_and_all_are_listed(site_folder: Path, vbr: Callable[..., Said]) -> None:
    command = ("token", "--site", site_folder)
    assert "No device has a token yet: make one with `vbr console token NAME`." in vbr(*command, "--list").out
    first = vbr(*command, "glasses")
    assert first.err == ""
    second = vbr(*command, "glasses")
    assert "takes the place of the token of glasses that was made on 20" in second.err
    assert "by command line, " in second.err
    assert "last signed in: never" in second.err
    devices = DeviceStore(Store.open(default_data_folder(site_folder)))
    assert (devices.name_of(first.out.strip()), devices.name_of(second.out.strip())) == (None, "glasses")
    vbr(*command, "spare pair")
    vbr(*command, " spare  pair ", "--revoke")
    listed = vbr(*command, "--list").out.splitlines()
    assert [line.partition(", made by")[0] for line in listed] == ["glasses: valid", "spare pair: revoked"]
    assert vbr(*command, "spare pair").err == "", "a token that was taken back is not replaced"
    assert "choose one of those that have (glasses, spare pair)" in vbr(*command, "glases", "--revoke").err


@pytest.mark.parametrize(
    "name", ["", " ", "../glasses", "-glasses", "a\nb\x00", "<b>", "x" * 61, "\u202eglasses", "💥"]
)
def test_a_name_that_nobody_could_type_or_read_gets_no_token(
    name: str, site_folder: Path, vbr: Callable[..., Said]
) -> None:
    assert "is no name for a device: use 1 to 60" in vbr("--site", site_folder, "token", "--", name).err
    assert DeviceStore(Store.open(default_data_folder(site_folder))).tokens() == []


def start(site_folder: Path, ready_file: Path) -> tuple[subprocess.Popen[str], dict[str, str]]:
    command = [sys.executable, "-m", "device_agent", "console", "--site", str(site_folder), "--port", "0"]
    process = subprocess.Popen([*command, "--ready-file", str(ready_file)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert any("Ctrl-C ends it." in line for line in process.stdout), "the console ended"
    return process, json.loads(ready_file.read_text())


def test_a_killed_console_keeps_what_it_has_answered_and_a_stopped_one_ends_cleanly(
    site_folder: Path, tmp_path: Path
) -> None:
    process, ready = start(site_folder, tmp_path / "ready.json")
    try:
        person = Person(ready["url"])
        person.open_link(ready["first_link"], "Ada").raise_for_status()
        answered = person.edit("update_poi", poi_id="a", name="Answered").raise_for_status().json()
    finally:
        process.kill()
        process.wait()
    (tmp_path / "ready.json").unlink()
    process, ready = start(site_folder, tmp_path / "ready.json")
    try:
        assert ready["first_link"] is None
        person = Person(ready["url"])
        person.sign_in("Ada").raise_for_status()
        assert person.graph()["version"] == answered["version"]
        assert person.graph()["pois"][0]["name"] == "Answered"
        with person.live() as live:
            live.recv(timeout=20)
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=60) == 0
    finally:
        process.kill()
        process.wait()


def test_unknown_addresses_and_unfit_bodies_get_a_sentence(site_folder: Path, tmp_path: Path) -> None:
    with serving(site_folder, tmp_path / "data") as server:
        admin = first_admin(server)
        assert admin.http.get("/api/nothing").json() == {"error": "There is nothing at this address."}
        opened = admin.http.get("/nothing", headers={"Accept": "text/html,*/*;q=0.8"})
        assert opened.status_code == 404
        assert "<h1>There is no such page</h1>" in opened.text
        assert admin.http.get("/nothing").json() == {"error": "There is nothing at this address."}
        assert admin.http.delete("/api/graph").status_code == 405
        for path, body in (("/api/sign-in", {"name": "x"}), ("/api/users", {"name": "x", "role": "king"})):
            answer = admin.http.post(path, json=body)
            assert answer.status_code == 400
            assert answer.json()["error"].endswith(".")
        assert admin.http.post("/api/users", content=b"\xff\xfe").status_code == 400
        assert admin.http.post("/api/users/9/link").status_code == 404
        large = admin.http.post("/api/users", content=b" " * 300_000)
        assert large.status_code == 413
        assert "too large" in large.json()["error"]
