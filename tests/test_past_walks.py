"""Walks that devices have sent to the console: put together, read, measured; whole, damaged, and with parts missing."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from recorded_walk import STORED_WALK

from console.errors import NotFoundError
from console.past_walks import PastWalks
from console.recordings import Recordings
from navcore.recording_upload import RecordingOffer

CLOCK_S = 1_800_000_000.0


def take(recordings: Recordings, data: bytes, name: str = "walk-001", device: str = "Glasses") -> str:
    """Take a file in as if a device had sent it; return its checksum."""
    sha256 = hashlib.sha256(data).hexdigest()
    recordings.offer(RecordingOffer("walk", name, len(data), sha256), device)
    assert recordings.add(sha256, 0, data).complete
    return sha256


@pytest.fixture
def recordings(tmp_path: Path) -> Recordings:
    return Recordings(tmp_path / "recordings", lambda: CLOCK_S)


def test_a_walk_says_itself_where_it_was_walked_and_when(recordings: Recordings) -> None:
    take(recordings, STORED_WALK.read_bytes())
    (walk,) = PastWalks(recordings).all()
    assert (walk.walk_id, walk.device, walk.site_id) == ("20261129T114718Z-glasses", "Glasses", "boxes")
    assert walk.map_checksum == "boxes-map"
    assert walk.began_at_s == 1795952838.0, "2026-11-29 11:47:18 UTC"
    assert walk.length_s == pytest.approx(16.0)
    assert (walk.has_pictures, walk.troubles, len(walk.parts)) == (False, (), 1)
    assert PastWalks(recordings).named(walk.walk_id) == walk


def test_a_damaged_file_and_one_that_is_no_walk_are_told_and_stop_no_other(recordings: Recordings) -> None:
    whole = STORED_WALK.read_bytes()
    take(recordings, whole[: len(whole) // 2], device="Cut")
    take(recordings, b"this is no walk at all", device="Foreign")
    take(recordings, whole)
    walks = {walk.device: walk for walk in PastWalks(recordings).all()}
    assert walks["Glasses"].troubles == ()
    assert 1.0 < walks["Cut"].length_s < 15.0
    assert "ends in the middle" in walks["Cut"].troubles[0]
    assert "no MCAP file" in walks["Foreign"].troubles[0]
    assert walks["Foreign"].length_s == 0.0


def test_what_has_been_kept_for_long_enough_is_deleted_with_all_that_was_found_in_it(tmp_path: Path) -> None:
    clock_s = [CLOCK_S]
    recordings = Recordings(tmp_path / "recordings", lambda: clock_s[0])
    old = take(recordings, STORED_WALK.read_bytes(), device="Old")
    recordings.companion(old, "figures").write_text("{}")
    map_walk = RecordingOffer("recording", "map", 1, hashlib.sha256(b"x").hexdigest())
    recordings.offer(map_walk, "Old")
    recordings.offer(RecordingOffer("walk", "half", 9, "0" * 64), "Old")
    clock_s[0] += 100.0
    new = take(recordings, STORED_WALK.read_bytes()[:-40], device="New")
    assert recordings.delete_before(CLOCK_S + 50.0) == 2
    kept = {path.name.partition(".")[0].rpartition("-")[2] for path in recordings.folder.iterdir()}
    assert kept == {new, map_walk.sha256}
    (walk,) = (walks := PastWalks(recordings)).all()
    assert walk.device == "New"
    assert recordings.delete_before(CLOCK_S + 200.0) == 1
    with pytest.raises(NotFoundError, match="deleted"):
        walks.named(walk.walk_id)
