"""Who did what: all of it can be read, in words, on the page and on the command line."""

from __future__ import annotations

import getpass
import json
from pathlib import Path

import pytest
from console_room import first_admin, serving

from console.api_accounts import AUDIT_SHOWN_COUNT
from console.edits import AddPoi, MovePoi
from device_agent.cli import main
from navcore.site import Site, save_site


@pytest.fixture
def site_folder(tmp_path: Path, small_site: Site) -> Path:
    save_site(small_site, tmp_path / "site")
    return tmp_path / "site"


def test_nothing_that_was_written_down_is_out_of_reach(site_folder: Path, tmp_path: Path) -> None:
    with serving(site_folder, tmp_path / "data") as server:
        admin, store = first_admin(server), server.services.store
        with store.writing() as session:
            for number in range(2 * AUDIT_SHOWN_COUNT + 5):
                store.add_audit(session, "Bea_", "sign_in_failed" if number % 100 == 0 else "sign_in", str(number))
        seen, query = [], {"who": "bea_"}
        while True:
            answer = admin.http.get("/api/audit", params=query).raise_for_status().json()
            seen += [int(line["detail"]) for line in answer["audit"]]
            if not answer["has_older"]:
                break
            query["before"] = answer["audit"][-1]["id"]
        assert seen == list(reversed(range(2 * AUDIT_SHOWN_COUNT + 5)))
        failed = admin.http.get("/api/audit", params={"who": "BEA", "action": "sign in failed"}).json()
        assert [line["detail"] for line in failed["audit"]] == ["400", "300", "200", "100", "0"]
        assert admin.http.get("/api/audit", params={"who": "%"}).json() == {"audit": [], "has_older": False}


def test_edits_stand_there_in_words(site_folder: Path, tmp_path: Path) -> None:
    with serving(site_folder, tmp_path / "data") as server:
        admin, model = first_admin(server), server.services.model
        model.apply(AddPoi("Lift", "lift", 2.0, 0.0), "Bea")
        lift = next(poi for poi in model.graph.pois.values() if poi.name == "Lift")
        model.apply(MovePoi(lift.id, 2.5, 0.0), "Bea")
        model.undo("Bea")
        told = [line["detail"] for line in admin.http.get("/api/audit", params={"who": "Bea"}).json()["audit"]]
    assert [each.partition(" (version")[0] for each in told[1:]] == ["Moved Lift", "Tagged Lift"]
    assert told[0].startswith("Took back version")
    assert "{" not in "".join(told)


def test_the_command_line_says_what_it_did_and_who_it_was(
    site_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = ["--site", str(site_folder)]
    token_file = tmp_path / "other.token"
    with serving(site_folder, tmp_path / "site.console", device_token_file=token_file) as server:
        server.services.store.audit("Mal\u202elory", "sign_in_failed", "10.0.0.1\x1b[2J")
        assert main(["console", "token", "glasses", *site]) == 0
    assert main(["console", "backup", str(tmp_path / "copy.zip"), *site]) == 0
    capsys.readouterr()
    assert main(["console", "audit", "--json", *site]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    me = f"command line, {getpass.getuser()}"
    assert [(row["who"], row["action"]) for row in rows[:2]] == [(me, "backup"), (me, "token_created")]
    assert [row["who"] for row in rows if row["action"] == "token_created"] == [me, me], "that of the file too"
    assert [row["id"] for row in rows] == sorted((row["id"] for row in rows), reverse=True)
    assert main(["console", "audit", "--who", "lory", "--action", "failed", *site]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.endswith("Mal lory: sign in failed  10.0.0.1 [2J")
    assert main(["console", "restore", str(tmp_path / "copy.zip"), "--replace", *site]) == 0
    capsys.readouterr()
    assert main(["console", "audit", "--json", "--action", "restored", *site]) == 0
    assert [json.loads(each)["who"] for each in capsys.readouterr().out.splitlines()] == [me]
