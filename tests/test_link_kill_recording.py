"""Kill -9 while a recording is sent: it goes on where it was, comes whole, and comes once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from link_processes import ConsoleProcess, Victim, surroundings
from link_proxy import Network
from test_link_kill import device_on

from device_agent.map_walk.walk_folder import STATE_FILE, WalkState, new_walk, read_state, write_state
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import PIECE_BYTES

PICTURE_BYTES = 400_000
PICTURE_COUNT = 8
_OTHER_MESSAGES_BYTES = 40_000


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """A recording that waits to be sent; what its pictures show does not matter on the way."""
    walk = new_walk(tmp_path / "device" / "map-walks", "2026-11-29")
    (walk / "rgb").mkdir()
    rng = np.random.default_rng(5)
    for number in range(PICTURE_COUNT):
        (walk / "rgb" / f"{number}.png").write_bytes(rng.bytes(PICTURE_BYTES))
    write_state(walk, WalkState("handed_over", "2026-11-29"))
    return walk


def wait_to_hear(device: Victim, line: str) -> None:
    """Pass over what a device says of maps, for it runs another than the console's."""
    while device.says() != line:
        pass


def test_a_recording_comes_whole_and_hardly_a_piece_twice_though_both_ends_are_killed_on_the_way(
    console: ConsoleProcess, network: Network, walk: Path, tmp_path: Path
) -> None:
    archive = RecordingArchive(walk, {STATE_FILE})
    third = archive.size_bytes // 3
    network.loosen(up_limit_bytes=third)
    device = device_on(network, console, tmp_path)
    network.wait_for(lambda: network.up_bytes >= third)
    console.kill()
    console.start()
    network.loosen(up_limit_bytes=2 * third)
    network.wait_for(lambda: network.up_bytes >= 2 * third)
    device.kill()
    assert read_state(walk).stage == "handed_over"
    network.loosen()
    device = device_on(network, console, tmp_path)
    wait_to_hear(device, "told map_sent")
    device.kill()
    assert read_state(walk) == WalkState("sent", "2026-11-29")
    (kept,) = (tmp_path / "data" / "recordings").glob("*.tar")
    assert kept.read_bytes() == archive.read(0, archive.size_bytes)
    assert not list(kept.parent.glob("*.part"))
    again_bytes = network.up_bytes - archive.size_bytes
    assert again_bytes < 2 * PIECE_BYTES + _OTHER_MESSAGES_BYTES, "each death costs the piece that was on the way"
    # What has been sent is not sent again at the next start, and stays where it is.
    before_bytes = network.up_bytes
    device = device_on(network, console, tmp_path)
    device.tell("1")
    wait_to_hear(device, "1")
    device.kill()
    assert network.up_bytes - before_bytes < PIECE_BYTES
    assert (walk / "rgb" / "0.png").stat().st_size == PICTURE_BYTES


def test_a_recorded_walk_is_sent_by_hand_and_goes_on_where_it_was(
    console: ConsoleProcess, network: Network, tmp_path: Path
) -> None:
    file = tmp_path / "monday.mcap"
    file.write_bytes(np.random.default_rng(6).bytes(1_000_000))
    (tmp_path / "token").write_text(console.token)
    command = [
        sys.executable, "-m", "device_agent", "walks", "send", str(file), "--token-file", str(tmp_path / "token"),
        "--console", f"ws://127.0.0.1:{network.port}",
    ]  # fmt: skip
    network.loosen(up_limit_bytes=500_000)
    process = subprocess.Popen(command, env=surroundings(), stderr=subprocess.DEVNULL)
    network.wait_for(lambda: network.up_bytes >= 500_000)
    process.kill()
    process.wait()
    network.loosen()
    done = subprocess.run(command, env=surroundings(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "is on the console's machine" in done.stdout
    (kept,) = (tmp_path / "data" / "recordings").glob("monday-*.mcap")
    assert kept.read_bytes() == file.read_bytes()
    assert network.up_bytes < 1_000_000 + PIECE_BYTES + _OTHER_MESSAGES_BYTES
    (tmp_path / "token").write_text("a-token-that-is-void-here")
    refused = subprocess.run(command, env=surroundings(), capture_output=True, text=True, check=False)
    assert refused.returncode != 0
    assert "token is not valid" in refused.stderr
