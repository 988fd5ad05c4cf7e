"""The device token in a file: what was taken back stays so, and people are told what to do."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from console_room import serving

from console.device_store import DeviceStore
from console.opening import default_data_folder
from console.store import Store
from device_agent.cli import main
from navcore.site import Site, save_site


@pytest.fixture
def site_folder(tmp_path: Path, small_site: Site) -> Path:
    save_site(small_site, tmp_path / "site")
    return tmp_path / "site"


def revoke(devices: DeviceStore) -> None:
    devices.revoke_token("glasses", "Ada")


def replace(devices: DeviceStore) -> None:
    devices.create_token("glasses", "Ada")


def revoke_and_replace(devices: DeviceStore) -> None:
    revoke(devices)
    replace(devices)


@pytest.mark.parametrize("deed", [revoke, replace, revoke_and_replace])
def test_a_token_that_was_taken_back_or_replaced_stays_void_whatever_the_file_says(
    deed: Callable[[DeviceStore], None], site_folder: Path, tmp_path: Path
) -> None:
    path, data = tmp_path / "glasses.token", tmp_path / "data"
    with serving(site_folder, data, device_token_file=path) as server:
        deed(server.services.devices)
        before = server.services.devices.tokens()
        assert server.ready.warning is None
    token = path.read_text().strip()
    for _ in range(2):
        with serving(site_folder, data, device_token_file=path) as server:
            assert server.services.devices.name_of(token) is None
            assert server.services.devices.tokens() == before
            assert server.ready.warning is not None
            assert "vbr console token glasses" in server.ready.warning
    path.unlink()
    with serving(site_folder, data, device_token_file=path) as server:
        assert server.ready.warning is None
        assert server.services.devices.name_of(path.read_text().strip()) == "glasses"
        assert server.services.devices.name_of(token) is None


def test_a_token_under_another_file_s_name_is_the_device_s_own(site_folder: Path, tmp_path: Path) -> None:
    path, other = tmp_path / "glasses.token", tmp_path / "renamed.token"
    with serving(site_folder, tmp_path / "data", device_token_file=path):
        pass
    path.rename(other)
    with serving(site_folder, tmp_path / "data", device_token_file=other) as server:
        assert server.services.devices.name_of(other.read_text().strip()) == "glasses"
        revoke(server.services.devices)
    with serving(site_folder, tmp_path / "data", device_token_file=other) as server:
        assert server.services.devices.name_of(other.read_text().strip()) is None


def test_the_terminal_says_that_the_token_is_void_and_the_console_serves(site_folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "glasses.token"
    with serving(site_folder, default_data_folder(site_folder), device_token_file=path):
        pass
    assert main(["console", "token", "glasses", "--revoke", "--site", str(site_folder)]) == 0
    command = ["console", "--site", str(site_folder), "--port", "0", "--device-token-file", str(path)]
    with subprocess.Popen(
        [sys.executable, "-m", "device_agent", *command], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as console:
        assert console.stderr is not None
        said = next(line for line in console.stderr if "token" in line)
        console.terminate()
        assert console.wait(30) == 0
    assert "was taken back" in said
    assert "delete the file and start again" in said
    store = Store.open(default_data_folder(site_folder))
    assert DeviceStore(store).name_of(path.read_text().strip()) is None
    store.close()
