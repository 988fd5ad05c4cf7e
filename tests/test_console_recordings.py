"""Recordings that devices send to a console: taken in piece by piece, kept whole, and maps that are built of them."""

from __future__ import annotations

import hashlib
import json
import threading
from pathlib import Path
from typing import Any

import httpx
import pytest
from console_room import Person, invited
from map_walk_rig import walk_frames

from console.errors import ConflictError, NoRoomError
from console.map_builds import MapBuilds
from console.recordings import MAX_UNFINISHED_COUNT, RESERVE_BYTES, BuiltMap, Recordings
from console.server import ConsoleServer
from device_agent.simulation.sensors import head_camera
from navcore.live_recording import LiveRecording
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import MAX_RECORDING_BYTES, OFFERS_PATH, RecordingHeld, RecordingOffer, piece_path
from navcore.site import Site, load_site, map_checksum, save_site

DATA = bytes(range(256)) * 40
SHA256 = hashlib.sha256(DATA).hexdigest()
DEADLINE_S = 120.0


def offer_of(data: bytes = DATA, **changes: Any) -> RecordingOffer:
    values: dict[str, Any] = {
        "kind": "recording", "name": "walk-0001", "size_bytes": len(data), "sha256": hashlib.sha256(data).hexdigest(),
    }  # fmt: skip
    return RecordingOffer(**(values | changes))


class Sender:
    """A device that sends recordings by hand."""

    def __init__(self, server: ConsoleServer, admin: Person, name: str = "Glasses") -> None:
        token = admin.http.post("/api/tokens", json={"name": name}).raise_for_status().json()["token"]
        self.http = httpx.Client(
            base_url=server.ready.url, headers={"Authorization": f"Bearer {token}"}, trust_env=False, timeout=60.0
        )

    def offer(self, data: bytes = DATA, **changes: Any) -> httpx.Response:
        values = {
            "kind": "recording", "name": "walk-0001", "size_bytes": len(data),
            "sha256": hashlib.sha256(data).hexdigest(),
        }  # fmt: skip
        return self.http.post(OFFERS_PATH, json=values | changes)

    def put(self, offset: int, piece: bytes, sha256: str = SHA256) -> httpx.Response:
        return self.http.put(piece_path(sha256, offset), content=piece)


@pytest.fixture
def sender(server: ConsoleServer, admin: Person) -> Sender:
    return Sender(server, admin)


def listed(person: Person) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = person.http.get("/api/recordings").raise_for_status().json()["recordings"]
    return found


# ------------------------------------------------------------------------------------------------------- arriving
def test_a_recording_comes_piece_by_piece_and_gets_its_name_once_it_is_whole(
    sender: Sender, admin: Person, tmp_path: Path
) -> None:
    assert sender.offer(name="../../Walk of\tMonday").json() == {"next_byte": 0, "complete": False}
    assert sender.put(0, DATA[:4000]).json() == {"next_byte": 4000, "complete": False}
    (shown,) = listed(admin)
    assert (shown["complete"], shown["have_bytes"], shown["device"]) == (False, 4000, "Glasses")
    assert sender.put(4000, DATA[4000:]).json() == {"next_byte": len(DATA), "complete": True}
    (shown,) = listed(admin)
    assert shown["complete"]
    kept = tmp_path / "data" / "recordings" / f"walk-of-monday-{SHA256}.tar"
    assert Path(shown["file"]) == kept
    assert kept.read_bytes() == DATA
    assert not list(kept.parent.glob("*.part"))
    assert sender.offer().json() == {"next_byte": len(DATA), "complete": True}, "it is not asked for twice"
    assert sender.put(0, DATA[:10]).json()["complete"]
    assert kept.read_bytes() == DATA


def test_a_piece_that_does_not_follow_changes_nothing_and_is_answered_with_what_is_missing(sender: Sender) -> None:
    assert sender.put(0, DATA[:10]).status_code == 404, "nothing was offered"
    sender.offer()
    sender.put(0, DATA[:1000])
    for offset in (0, 999, 1001, 5000):
        assert sender.put(offset, DATA[offset : offset + 100]).json() == {"next_byte": 1000, "complete": False}
    assert sender.put(1000, DATA[1000:] + b"x").status_code == 400
    assert sender.put(1000, DATA[1000:]).json()["complete"]


def test_what_comes_damaged_is_asked_for_anew(sender: Sender, admin: Person) -> None:
    sender.offer()
    assert sender.put(0, bytes(len(DATA))).json() == {"next_byte": 0, "complete": False}
    assert listed(admin)[0]["have_bytes"] == 0
    assert sender.put(0, DATA).json()["complete"]


@pytest.mark.parametrize(
    ("changes", "status", "sentence"),
    [
        ({"size_bytes": MAX_RECORDING_BYTES + 1}, 413, "too large"),
        ({"size_bytes": 0}, 400, "empty"),
        ({"size_bytes": -1}, 400, "cannot be read"),
        ({"sha256": "../../etc"}, 400, "cannot be read"),
        ({"kind": "virus"}, 400, "cannot be read"),
        ({"more": 1}, 400, "cannot be read"),
        ({"name": "x" * 121}, 400, "cannot be read"),
    ],
)
def test_an_offer_that_cannot_be_taken_is_refused_with_a_sentence(
    sender: Sender, admin: Person, changes: dict[str, Any], status: int, sentence: str
) -> None:
    answer = sender.offer(**changes)
    assert answer.status_code == status
    assert sentence in answer.json()["error"]
    assert listed(admin) == []


def test_a_device_with_another_token_goes_on_with_what_it_has_begun(
    server: ConsoleServer, sender: Sender, admin: Person
) -> None:
    sender.offer()
    sender.put(0, DATA[:1000])
    again = Sender(server, admin, "New token")
    assert again.offer(name="walk-0001 again").json() == {"next_byte": 1000, "complete": False}
    (shown,) = listed(admin)
    assert (shown["device"], shown["name"]) == ("New token", "walk-0001 again"), "they are as the last offer says"
    assert sender.put(1000, DATA[1000:2000]).json()["next_byte"] == 2000, "two that have the same help each other"
    assert again.put(2000, DATA[2000:]).json()["complete"]
    assert sender.offer().json()["complete"], "once it is whole, it is the same recording whoever has it"
    assert listed(admin)[0]["device"] == "New token"


def test_an_offer_that_was_wrong_about_the_size_is_no_hindrance_to_the_next(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "r", lambda: 0.0)
    recordings.offer(offer_of(size_bytes=len(DATA) + 1000), "spoiled")
    recordings.add(SHA256, 0, DATA + bytes(100))
    assert recordings.offer(offer_of(), "glasses") == RecordingHeld(0, False), "more is here than there can be"
    assert recordings.add(SHA256, 0, DATA).complete


def test_nobody_sends_without_a_token_and_only_who_maps_sees_them(
    server: ConsoleServer, sender: Sender, admin: Person
) -> None:
    sender.offer()
    bare = httpx.Client(base_url=server.ready.url, trust_env=False)
    assert bare.post(OFFERS_PATH, content=b"{}").status_code == 401
    assert bare.put(piece_path(SHA256, 0), content=b"x").status_code == 401
    assert admin.http.put(piece_path(SHA256, 0), content=b"x").status_code == 401, "people are no devices"
    assert invited(admin, "Vera", "viewer").http.get("/api/recordings").status_code == 403
    for role in ("editor", "technician"):
        assert len(listed(invited(admin, role, role))) == 1


def test_a_recording_whose_checksum_begins_as_that_of_another_does_is_another(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "r", lambda: 0.0)
    store(recordings, DATA)
    alike = offer_of(sha256=SHA256[:8] + "0" * 56)
    assert recordings.offer(alike, "glasses") == RecordingHeld(0, False)


def test_a_full_disk_is_told_and_nothing_that_has_come_is_lost(tmp_path: Path) -> None:
    free_bytes = RESERVE_BYTES + len(DATA)
    recordings = Recordings(tmp_path / "r", lambda: 0.0, lambda folder: free_bytes)
    recordings.offer(offer_of(), "glasses")
    recordings.add(SHA256, 0, DATA[:1000])
    free_bytes -= 1001
    with pytest.raises(NoRoomError, match="free its disk"):
        recordings.offer(offer_of(), "glasses")
    free_bytes += 1
    assert recordings.offer(offer_of(), "glasses").next_byte == 1000
    # What others write meanwhile is not known at the offer: each piece looks again.
    free_bytes = RESERVE_BYTES + 99
    with pytest.raises(NoRoomError, match="free its disk"):
        recordings.add(SHA256, 1000, DATA[1000:1100])
    free_bytes += 1
    assert recordings.add(SHA256, 1000, DATA[1000:1100]).next_byte == 1100


def test_no_device_begins_more_recordings_than_a_few(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "r", lambda: 0.0)
    for number in range(MAX_UNFINISHED_COUNT):
        recordings.offer(offer_of(f"{number}".encode()), "glasses")
    with pytest.raises(ConflictError, match="send those first"):
        recordings.offer(offer_of(), "glasses")
    recordings.offer(offer_of(), "other glasses")


def test_a_description_that_is_damaged_hides_no_other(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "r", lambda: 0.0)
    recordings.offer(offer_of(), "glasses")
    (tmp_path / "r" / f"{'0' * 64}.json").write_bytes(b"\xff{")
    assert [each.entry.offer.sha256 for each in recordings.all()] == [SHA256]


# ------------------------------------------------------------------------------------------------------- building
@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A short map walk, as it is sent."""
    folder = tmp_path_factory.mktemp("walk") / "walk-0001"
    recording = LiveRecording(folder, head_camera(320, 240))
    for frame in walk_frames(max_length_m=2.5):
        recording.add(frame)
    recording.close()
    archive = RecordingArchive(folder)
    return archive.read(0, archive.size_bytes)


def store(recordings: Recordings, data: bytes, **changes: Any) -> str:
    offer = offer_of(data, **changes)
    recordings.offer(offer, "glasses")
    assert recordings.add(offer.sha256, 0, data).complete
    return offer.sha256


class Watched(Recordings):
    """Says when a map is done."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, lambda: 0.0)
        self.done = threading.Event()

    def note_map(self, sha256: str, built: BuiltMap) -> None:
        super().note_map(sha256, built)
        if built.stage in ("built", "failed"):
            self.done.set()


def test_a_map_is_built_of_a_recording_as_a_new_site_each_time(recorded: bytes, tmp_path: Path) -> None:
    recordings = Watched(tmp_path / "recordings")
    builds = MapBuilds(recordings, tmp_path / "maps")
    sha256 = store(recordings, recorded)
    folders = []
    for _ in range(2):
        recordings.done.clear()
        builds.start(sha256, "Ada")
        with pytest.raises(ConflictError, match="Another map is being built"):
            builds.start(sha256, "Ada")
        assert recordings.done.wait(DEADLINE_S)
        built = recordings.named(sha256).entry.map
        assert built.stage == "built", built.reason
        assert built.report["road_m"] > 1.5
        folders.append(built.folder)
        builds.close()
        builds = MapBuilds(recordings, tmp_path / "maps")
    assert folders == [f"walk-0001-{sha256[:8]}-1", f"walk-0001-{sha256[:8]}-2"]
    first, second = (load_site(tmp_path / "maps" / name) for name in folders)
    assert first.name == second.name == "walk-0001"
    assert sorted(path.name for path in (tmp_path / "maps").iterdir()) == folders, "nothing else is left"


def test_a_map_that_takes_too_long_is_given_up_and_keeps_no_other_waiting(recorded: bytes, tmp_path: Path) -> None:
    recordings = Watched(tmp_path / "recordings")
    builds = MapBuilds(recordings, tmp_path / "maps", max_build_s=0.01)
    sha256 = store(recordings, recorded)
    for _ in range(2):
        recordings.done.clear()
        builds.start(sha256, "Ada")
        assert recordings.done.wait(DEADLINE_S)
        built = recordings.named(sha256).entry.map
        assert (built.stage, built.by) == ("failed", "Ada")
        assert "was given up" in built.reason
        assert builds._thread is not None
        builds._thread.join(DEADLINE_S)
        assert list((tmp_path / "maps").iterdir()) == []
    builds.close()


def test_what_is_no_recording_of_a_map_walk_leaves_a_sentence_and_no_map(tmp_path: Path) -> None:
    recordings = Watched(tmp_path / "recordings")
    builds = MapBuilds(recordings, tmp_path / "maps")
    sha256 = store(recordings, DATA)
    builds.start(sha256, "Ada")
    assert recordings.done.wait(DEADLINE_S)
    built = recordings.named(sha256).entry.map
    assert (built.stage, built.by) == ("failed", "Ada")
    assert "cannot be unpacked" in built.reason
    assert list((tmp_path / "maps").iterdir()) == []
    walk = store(recordings, b"a walk", kind="walk", name="Monday")
    with pytest.raises(Exception, match="a map is built of a map walk"):
        builds.start(walk, "Ada")
    builds.close()


def test_what_was_being_built_when_the_console_was_killed_is_cleared_away_and_can_be_built_again(
    tmp_path: Path,
) -> None:
    recordings = Recordings(tmp_path / "recordings", lambda: 0.0)
    sha256 = store(recordings, DATA)
    recordings.note_map(sha256, BuiltMap("building", "Ada"))
    (tmp_path / "maps" / ".building-x" / "recording").mkdir(parents=True)
    builds = MapBuilds(recordings, tmp_path / "maps")
    built = recordings.named(sha256).entry.map
    assert (built.stage, built.by) == ("failed", "Ada")
    assert "build it again" in built.reason
    assert list((tmp_path / "maps").iterdir()) == []
    builds.close()


def test_a_map_that_had_come_to_its_place_when_the_console_was_killed_is_told_of(
    tmp_path: Path, small_site: Site
) -> None:
    recordings = Recordings(tmp_path / "recordings", lambda: 0.0)
    sha256 = store(recordings, DATA)
    for folder, stage in (("walk-0001-1", "built"), ("walk-0001-2", "failed")):
        if stage == "built":
            save_site(small_site, tmp_path / "maps" / folder)
        recordings.note_map(sha256, BuiltMap("building", "Ada", folder))
        MapBuilds(recordings, tmp_path / "maps").close()
        built = recordings.named(sha256).entry.map
        assert (built.stage, built.by) == (stage, "Ada")
        assert (built.folder, built.report) == ((folder, small_site.report) if stage == "built" else ("", {}))


def test_a_caregiver_has_a_map_built_by_the_page(
    server: ConsoleServer, sender: Sender, admin: Person, recorded: bytes, tmp_path: Path
) -> None:
    before = map_checksum(tmp_path / "site")
    sha256 = hashlib.sha256(recorded).hexdigest()
    sender.offer(recorded)
    for offset in range(0, len(recorded), 200_000):
        sender.put(offset, recorded[offset : offset + 200_000], sha256).raise_for_status()
    caregiver = invited(admin, "Eda", "editor")
    answer = caregiver.http.post(f"/api/recordings/{sha256}/map")
    assert answer.status_code == 202
    assert answer.json()["map"]["stage"] == "building"
    thread = server.services.builds._thread
    assert thread is not None
    thread.join(DEADLINE_S)
    (shown,) = listed(caregiver)
    assert shown["map"]["stage"] == "built", shown["map"]
    assert load_site(Path(shown["map"]["site"])).report == shown["map"]["report"]
    assert map_checksum(tmp_path / "site") == before, "the site in use is left alone"
    log = json.dumps(admin.http.get("/api/audit").json())
    assert "build_map" in log
