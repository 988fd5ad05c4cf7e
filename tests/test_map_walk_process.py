"""The live process: from a device without any map, by keys alone, to one that has its first map."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from device_room import record_room

from device_agent.cli import main
from navcore.site import load_site

DEADLINE_S = 120.0


class Device:
    """``vbr device`` with a terminal of its own."""

    def __init__(self, recording: Path, folder: Path) -> None:
        self._ours, self._theirs = os.openpty()
        self._process = subprocess.Popen(
            [
                sys.executable, "-m", "device_agent", "device", "--site", str(folder / "site"), "--without-map",
                "--recording", str(recording), "--state", str(folder / "state"), "--buttons", "keyboard",
            ],
            stdin=self._theirs, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        self.heard: list[str] = []
        # A device that never says what is waited for is ended, and then read to its end.
        self._deadline = threading.Timer(DEADLINE_S, self._process.kill)
        self._deadline.start()

    def press(self, key: str) -> None:
        os.write(self._ours, key.encode())

    def wait_for(self, text: str) -> None:
        """Read what is heard up to a sentence; a device that ends without it fails."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.heard.append(line.strip())
            if text in line:
                return
        raise AssertionError(f"{text!r} is not in {self.heard}")

    def end(self) -> None:
        self._deadline.cancel()
        self._process.terminate()
        self._process.communicate()
        os.close(self._ours)
        os.close(self._theirs)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("room") / "recording"
    record_room(folder)
    return folder


def test_a_device_without_a_map_records_its_first_one_and_knows_where_it_is_in_it(
    recording: Path, tmp_path: Path
) -> None:
    device = Device(recording, tmp_path)
    try:
        device.wait_for("There is no map yet.")
        device.press("s")
        device.wait_for("Does a sighted person want to record a map?")
        device.press("n")
        device.wait_for("The map walk begins.")
        device.press(" ")
        device.wait_for("Place 1 is marked.")
        # The recording that stands for the camera is at its end.
        device.wait_for("The camera gives no pictures.")
        device.press("s")
        device.wait_for("The map walk has ended.")
        device.wait_for("The new map is in use.")
    finally:
        device.end()
    again = Device(recording, tmp_path)
    try:
        again.wait_for("Ready.")
    finally:
        again.end()
    assert [poi.name for poi in load_site(tmp_path / "site").poi_graph.pois.values()] == ["Place 1"]


def test_a_site_that_is_not_there_is_refused_without_the_option(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["device", "--site", str(tmp_path / "none"), "--recording", str(recording), "--state", str(tmp_path / "s")]
    assert main(where) == 2
    assert "There is no site" in capsys.readouterr().err
    assert main([*where, "--without-map", "--to", "Bar"]) == 2
    assert "no map yet" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
