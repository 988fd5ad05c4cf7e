"""Kill -9 of the console at moments that a seed chooses, while seven clients work with it (benchmarks/kills).

Here are few of these kills; ``python -m benchmarks.kills --kills 1000`` does as many as wanted.
"""

from __future__ import annotations

import random
import shutil
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from console_room import Person, first_admin
from link_processes import quick_folder, surroundings

from benchmarks.kills.console import KilledConsole
from benchmarks.kills.nursery import ROOT, WAIT_S, BrokenPromiseError, Nursery
from benchmarks.kills.sites import MAP_WALK_NAME
from console.alerts.alert_store import AlertRecord
from console.alerts.rules import Priority
from console.edits import AddPoi
from console.opening import let_token_of_file_in
from console.server import ConsoleServer
from navcore.folder_swap import fresh_folder
from navcore.site_files import clear_half_written, write_whole

pytestmark = pytest.mark.slow
KILLS = 10
"""More, with other seeds: benchmarks/kills."""


@pytest.fixture(scope="module")
def nursery(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nursery]:
    nursery = Nursery("benchmarks.kills.console", tmp_path_factory.mktemp("nursery") / "log")
    yield nursery
    nursery.close()


def test_what_was_acknowledged_outlives_every_kill_and_nothing_is_half_there(nursery: Nursery, tmp_path: Path) -> None:
    with quick_folder(tmp_path) as folder:
        console = KilledConsole(folder, 1, nursery)
        try:
            for _ in range(KILLS):
                console.kill_once()
        finally:
            console.close()
        assert console.request_count > KILLS


@pytest.mark.parametrize(
    ("spoil", "found"),
    [
        ("DELETE FROM device_events WHERE sequence = 1", "events"),
        ("DELETE FROM graph_entries", "ended by itself"),
        ("UPDATE graph_entries SET entry_json = replace(entry_json, 'Bar', 'Other')", "draft"),
        ("a half-written file", "half-written"), ("a map of nobody", "nobody tells of"),
        ("half an incident", "half incidents"),
    ],
)  # fmt: skip
def test_what_was_lost_is_found(spoil: str, found: str, nursery: Nursery, tmp_path: Path) -> None:
    with quick_folder(tmp_path) as folder:
        console = KilledConsole(folder, 3, nursery)
        try:
            console.close()
            _spoil(console, spoil)
            with pytest.raises(BrokenPromiseError, match=found):
                console.start_and_check()
        finally:
            console.close()


def _spoil(console: KilledConsole, how: str) -> None:
    match how:
        case "a half-written file":
            (console.site / ".graph.json-abcdefgh.half~").touch()
        case "a map of nobody":
            shutil.copytree(console.site, console.data / "maps" / f"{MAP_WALK_NAME}-1")
        case "half an incident":
            (console.data / "incidents" / "begun").mkdir(parents=True)
        case _:
            with closing(sqlite3.connect(console.data / "console.sqlite3")) as base, base:
                base.execute(how)


def test_who_works_for_a_program_that_was_killed_ends_with_it_though_it_says_nothing() -> None:
    script = "from device_agent.progress import end_with_reader; end_with_reader(); print('!', flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, env=surroundings()
    ) as worker:
        assert worker.stdout is not None
        assert worker.stdout.readline() == b"!\n"
        assert worker.poll() is None
        worker.stdout.close()
        assert worker.wait(WAIT_S) == 1


def test_the_same_request_again_is_done_once(server: ConsoleServer) -> None:
    admin = first_admin(server)
    lift = {"edit": "add_poi", "name": "Lift", "kind": "lift", "x_m": 3.0, "y_m": 0.0}

    def asked_twice(path: str, key: str, body: object = None) -> list[dict[str, object]]:
        answers = [admin.http.post(path, json=body, headers={"Idempotency-Key": key}) for _ in range(2)]
        return [answer.raise_for_status().json() for answer in answers]

    before = admin.graph()["version"]
    once, again = asked_twice(f"/api/edits?base_version={before}", "a", lift)
    assert once == again
    assert once["version"] == before + 1
    assert [each["version"] for each in asked_twice("/api/undo", "b")] == [before + 2] * 2
    assert [each["version"] for each in asked_twice("/api/redo", "c")] == [before + 3] * 2
    back = asked_twice(f"/api/versions/{before}/roll-back", "d", {"base_version": before + 3})
    assert [each["version"] for each in back] == [before + 4] * 2
    # Without a key, and with another one, it is another request.
    admin.edit(**lift).raise_for_status()
    admin.http.post("/api/edits", json=lift | {"name": "Lift 2"}, headers={"Idempotency-Key": "e"}).raise_for_status()
    assert admin.graph()["version"] == before + 6
    archive = admin.http.get("/api/export/site.zip").raise_for_status().content
    sites = [
        admin.http.post("/api/import/site", content=archive, headers={"Idempotency-Key": key}).raise_for_status()
        for key in ("f", "f", "g")
    ]
    assert len({answer.json()["site"] for answer in sites}) == 2
    too_long = admin.http.post("/api/undo", headers={"Idempotency-Key": "x" * 65})
    assert too_long.status_code == 400


def test_a_key_is_the_one_persons_who_sent_it(server: ConsoleServer) -> None:
    model = server.services.model
    before = model.graph.version
    lift = AddPoi("Lift", "lift", 3.0, 0.0)
    for who in ("Ada", "Bob"):
        model.apply(lift, who, request="a")
    assert model.graph.version == before + 2


def test_an_alert_is_shelved_once_though_it_is_asked_twice(server: ConsoleServer) -> None:
    services = server.services
    record = AlertRecord("1" * 16, "away", "Away", "too_hot", Priority.LOW, "Hot.", services.store.wall_s())
    services.alert_store.save([record], [])
    services.alerts._take_up(record, services.hub.now_s())
    for _ in range(2):
        services.alerts.shelve(record.alert_id, 5, "Ada", "We know.")
    services.alerts.shelve(record.alert_id, 10, "Ada", "We know.")
    steps = [step.detail for step in services.alert_store.steps([record.alert_id])]
    assert steps == ["5 min: We know.", "10 min: We know."]


def test_what_is_half_written_goes_and_what_is_being_written_stays(tmp_path: Path) -> None:
    (tmp_path / ".walk.json-abcdefgh.half").write_bytes(b"{")
    (tmp_path / ".site-previous").mkdir()
    (tmp_path / ".kept-previous").write_bytes(b"of somebody else")
    dice, stopped, failures = random.Random(1), threading.Event(), list[BaseException]()

    def write() -> None:
        try:
            while not stopped.is_set():
                write_whole(tmp_path / "walk.json", dice.randbytes(100))
        except BaseException as error:
            failures.append(error)

    writer = threading.Thread(target=write)
    writer.start()
    for _ in range(300):
        clear_half_written(tmp_path)
    stopped.set()
    writer.join()
    assert failures == []
    assert sorted(path.name for path in tmp_path.iterdir()) == [".kept-previous", ".site-previous", "walk.json"]


def test_a_folder_that_a_crash_left_half_filled_goes_and_one_that_is_being_filled_stays(tmp_path: Path) -> None:
    (tmp_path / ".site-fresh-abcdefgh").mkdir()
    (tmp_path / ".site-previous").mkdir()
    with fresh_folder(tmp_path / "site") as first, fresh_folder(tmp_path / "site") as second:
        left = {path.name for path in tmp_path.iterdir()}
        assert left == {".site-previous", first.name, second.name}
    assert [path.name for path in tmp_path.iterdir()] == [".site-previous"]


def test_a_token_file_that_was_begun_is_made_anew(server: ConsoleServer, admin: Person, tmp_path: Path) -> None:
    (tmp_path / ".glasses.token.new").write_text("half")
    path = tmp_path / "glasses.token"
    assert let_token_of_file_in(server.services.devices, path) is None
    assert server.services.devices.name_of(path.read_text().strip()) == "glasses"
    assert not (tmp_path / ".glasses.token.new").exists()
