"""Whole walks on the real parts: simulated sensors, SLAM, planning, obstacles, guidance, cues, and the live process."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import termios
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from device_console import TOKEN, Console
from device_room import map_room, record_room, small_room

from device_agent.cli import main
from device_agent.localization import make_localizer
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import cue_line, replay
from device_agent.recording.walk_files import parts_in
from device_agent.walk import run_walk
from navcore.cues.table import CueKind
from navcore.deviation import distance_to_polyline_m
from navcore.site import Site, load_site, save_site
from navcore.wire import Hello, RouteChanged, Say, SetDestination, SettingsRunning, WalkerState


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The room's recording and its site."""
    folder = tmp_path_factory.mktemp("room")
    frames, poses = record_room(folder / "recording")
    save_site(map_room(frames, poses), folder / "site")
    return folder / "recording", folder / "site"


@pytest.fixture(scope="module")
def site(room: tuple[Path, Path]) -> Site:
    return load_site(room[1])


def test_a_simulated_walker_is_led_to_the_far_end_by_what_the_device_sees(site: Site) -> None:
    result = run_walk(site, small_room(), "Start", "Far end", seed=3, max_s=40.0)
    assert result.arrived, result.outcome
    assert result.contacts == 0
    assert result.cues[-1].kind is CueKind.ARRIVED
    assert result.localized_fraction > 0.95
    assert result.localization_rmse_m < 0.1
    assert 0.0 < result.deviation_mean_m <= result.deviation_max_m < 0.6
    assert result.reasons.get("sensor_stale", 0) == 0
    assert result.path_m[-1, 0] - result.path_m[0, 0] > 2.0


def test_a_recorded_walk_is_guided_again_to_the_last_bit_from_its_poses_and_from_its_pictures(
    room: tuple[Path, Path], site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path, pictures=True, reserve_bytes=0))
    result = run_walk(site, small_room(), "Start", "Far end", seed=4, max_s=40.0, tap=recorder)
    recorder.close()
    (path,) = parts_in(tmp_path)
    for how in ([], ["--site", str(room[1])]):
        cues = tmp_path / "cues.jsonl"
        assert main(["walks", "replay", str(path), *how, "--cues", str(cues), "--json"]) == 0
        assert json.loads(capsys.readouterr().out) == {
            "cycles": result.cycles, "different": 0, "first": [], "damages": {}
        }  # fmt: skip
        heard = [json.loads(line) for line in cues.read_text(encoding="utf-8").splitlines()]
        assert heard == [cue_line(cue) for cue in result.cues]


def test_the_distance_from_a_route_is_the_one_to_its_nearest_piece() -> None:
    route = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
    for point, distance_m in (((1.0, 0.5), 0.5), ((3.0, 1.0), 1.0), ((-3.0, 4.0), 5.0), ((2.0, 0.0), 0.0)):
        assert distance_to_polyline_m(np.array(point), route) == pytest.approx(distance_m)
    assert distance_to_polyline_m(np.array([3.0, 4.0]), np.zeros((1, 2))) == 5.0


@pytest.fixture
def console() -> Iterator[Console]:
    console = Console()
    console.start()
    yield console
    console.close()


@pytest.fixture
def device(room: tuple[Path, Path], console: Console, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """``vbr device`` in a process of its own, with the recorded walk as its camera."""
    recording, site_folder = room
    (tmp_path / "token").write_text(TOKEN)
    process = subprocess.Popen(
        [
            sys.executable, "-m", "device_agent", "device", "--site", str(site_folder), "--recording", str(recording),
            "--console", f"ws://127.0.0.1:{console.port}", "--token-file", str(tmp_path / "token"),
            "--state", str(tmp_path / "state"), "--device-id", "test-glasses", "--set", "gate.clearance_m=1.5",
            "--wav", str(tmp_path / "heard.wav"), "--record", str(tmp_path / "walks"), "--record-pictures",
        ],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    yield process
    process.kill()
    process.communicate()


def test_the_process_streams_takes_orders_survives_the_console_and_ends_cleanly(
    device: subprocess.Popen[str], console: Console, room: tuple[Path, Path], tmp_path: Path
) -> None:
    site = room[1]
    console.wait_for(lambda: any(state.quality == "localized" for state in console.of_type(WalkerState)), 60.0)
    hello = console.of_type(Hello)[0]
    assert (hello.device_id, hello.site_id, hello.graph_version) == ("test-glasses", "room", 1)
    assert console.of_type(SettingsRunning)[0].values["gate.clearance_m"] == 1.5
    console.send(SetDestination("end"))
    console.wait_for(lambda: any(state.mode == "guiding" for state in console.of_type(WalkerState)))
    # The newest state may overtake it.
    console.wait_for(lambda: any(route.destination_id == "end" for route in console.of_type(RouteChanged)))

    console.kill()
    console.start()
    console.wait_for(lambda: len(console.of_type(Hello)) == 2, 40.0)
    console.send(SetDestination("attic"))
    console.wait_for(lambda: "Attic" in console.of_type(RouteChanged)[-1].refusal, 40.0)
    console.send(Say("Good-bye."))
    console.wait_for(lambda: any("Good-bye." in event.text for event in console.stored))

    device.send_signal(signal.SIGTERM)
    output, _ = device.communicate(timeout=20.0)
    assert device.returncode == 0, output
    assert "Traceback" not in output
    assert (tmp_path / "heard.wav").stat().st_size > 10_000

    parts = [RecordedPart(path) for path in parts_in(tmp_path / "walks")]
    cycles = list(replay(parts))
    # Threads, clocks, the link and the watchdog were real, and so is every bit of what came of them.
    assert [(each.notes.number, each.differs_in) for each in cycles if each.differs_in] == []
    # What the walker shares, and whether the link stands, are noted as well: what is told of watchers hangs on them.
    kinds = {order.kind for each in cycles for order in each.notes.orders}
    assert kinds == {"SetDestination", "Say", "Consent", "LinkStands"}
    if all(each.notes.pictures for each in cycles if each.notes.frame is not None):
        again = replay(parts, lambda camera, settings: make_localizer(load_site(site), camera, settings))
        assert [(each.notes.number, each.differs_in) for each in again if each.differs_in] == []


@pytest.fixture
def keyboard(room: tuple[Path, Path], tmp_path: Path) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """``vbr device`` in a terminal of its own, without any console: the terminal's other end, and the process."""
    recording, site_folder = room
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        [
            sys.executable, "-m", "device_agent", "device", "--site", str(site_folder), "--recording", str(recording),
            "--state", str(tmp_path / "state"), "--buttons", "keyboard",
        ],
        stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    yield ours, process
    process.kill()
    process.communicate()
    os.close(ours)
    os.close(theirs)


def test_the_walker_chooses_starts_and_stops_with_keys_alone(keyboard: tuple[int, subprocess.Popen[str]]) -> None:
    terminal, process = keyboard
    assert process.stdout is not None
    before = termios.tcgetattr(terminal)

    def hear(*words: str) -> str:
        for line in process.stdout:  # type: ignore[union-attr]
            if any(each in line for each in words):
                return line
        raise AssertionError(f"never said {words}")

    # However slowly this machine plays the recorded walk, and wherever in it the keys are pressed.
    hear("Ready.")
    os.write(terminal, b"\x1b[C")
    if "Far end" not in hear("1 of 2."):
        os.write(terminal, b"\x1b[C")
        assert "Far end" in hear("2 of 2.")
    # Asked for a second press, and anew where this machine is so slow that the question is an old one by then.
    os.write(terminal, b" ")
    while "To Far end." not in hear("Press again to set off.", "To Far end."):
        os.write(terminal, b" ")
    os.write(terminal, b"s")
    if "Off duty." not in hear("Stop. No destination.", "Off duty."):
        os.write(terminal, b"s")
        hear("Off duty.")
    os.write(terminal, b"w")
    hear("You are off duty. Press the main button to go on duty.")
    process.send_signal(signal.SIGTERM)
    assert process.wait(20.0) == 0
    assert termios.tcgetattr(terminal) == before, "the terminal is put back as it was"
