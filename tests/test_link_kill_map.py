"""Kill -9 while a map is fetched or swapped in: what was fetched is not fetched again, and there is always a map."""

from __future__ import annotations

import hashlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from link_processes import HERE, ConsoleProcess, surroundings
from link_proxy import Network
from test_link_kill import device_on, until

from device_agent.device_store import DeviceStore
from navcore.site import Site, map_checksum, pack_site, save_site

pytestmark = pytest.mark.slow
POINTS_COUNT = 200_000
_OTHER_MESSAGES_BYTES = 20_000


@pytest.fixture
def large_site(small_site: Site, tmp_path: Path) -> Path:
    """A site of some megabytes that cannot be compressed."""
    rng = np.random.default_rng(5)
    points_m = rng.normal(size=(POINTS_COUNT, 3)).astype(np.float32)
    colours = rng.integers(0, 256, (POINTS_COUNT, 3)).astype(np.uint8)
    ones = [np.ones(POINTS_COUNT, kind) for kind in (np.float32, np.uint16, np.uint64)]
    cloud = dict(zip(("cloud_weights", "cloud_view_counts", "cloud_sessions"), ones, strict=True))
    large = replace(small_site, cloud_points_m=points_m, cloud_colours_rgb=colours, **cloud)
    save_site(large, tmp_path / "site")
    return tmp_path / "site"


@pytest.fixture
def console(large_site: Path, tmp_path: Path) -> Iterator[ConsoleProcess]:
    console = ConsoleProcess(large_site, tmp_path)
    yield console
    console.kill()


def test_a_map_comes_whole_and_hardly_a_piece_twice_though_both_ends_are_killed_on_the_way(
    console: ConsoleProcess, network: Network, large_site: Path, tmp_path: Path
) -> None:
    package = pack_site(large_site)
    part = tmp_path / "device" / "incoming" / f"{hashlib.sha256(package).hexdigest()}.part"
    third = len(package) // 3
    network.loosen(third)
    device = device_on(network, console, tmp_path)
    network.wait_for(lambda: network.down_bytes >= third)
    console.kill()
    console.start()
    network.loosen(2 * third)
    until(lambda: part.stat().st_size > third)
    device.kill()
    missing_bytes, before_bytes = len(package) - part.stat().st_size, network.down_bytes
    assert missing_bytes > third // 2
    network.loosen(None)
    device = device_on(network, console, tmp_path)
    checksum = map_checksum(large_site)
    assert device.says() == f"map {checksum}"
    device.kill()
    assert map_checksum(tmp_path / "device" / "incoming" / checksum) == checksum
    assert not part.exists()
    assert network.down_bytes - before_bytes < missing_bytes + _OTHER_MESSAGES_BYTES


def test_whoever_is_killed_while_a_map_is_swapped_in_finds_a_whole_one(small_site: Site, tmp_path: Path) -> None:
    killed = 0
    names = []
    for fatal in range(20):
        folder = tmp_path / str(fatal)
        site, staging = folder / "site", folder / ".site-incoming" / "new"
        save_site(small_site, site)
        save_site(replace(small_site, name="Newer"), folder / "newer")
        DeviceStore(folder / "state", site).swap_map(folder / "newer")
        save_site(replace(small_site, name="Newest"), staging)
        code = subprocess.run(
            [sys.executable, str(HERE / "map_swap_victim.py"), site, staging, str(fatal)],
            env=surroundings(), check=False,
        ).returncode  # fmt: skip
        store = DeviceStore(folder / "state", site)
        names.append(store.load_map().name)
        assert store.went_back == ""
        assert DeviceStore(folder / "state", store.previous_map).load_map().name in ("Small site", "Newer")
        if code == 0:
            break
        assert code == -signal.SIGKILL
        killed += 1
    assert killed >= 4
    assert names == sorted(names)
    assert (names[0], names[-1]) == ("Newer", "Newest")


def test_a_map_that_is_damaged_on_the_disk_gives_way_to_the_one_before(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    save_site(replace(small_site, name="Newer"), tmp_path / "newer")
    store = DeviceStore(tmp_path / "state", tmp_path / "site")
    store.swap_map(tmp_path / "newer")
    damaged = tmp_path / "site" / "map" / "descriptors.npy"
    damaged.write_bytes(damaged.read_bytes()[:-1] + b"x")
    assert store.load_map().name == "Small site"
    assert "the one before it runs until a new one has come" in store.went_back
    assert DeviceStore(tmp_path / "state", tmp_path / "site").load_map().name == "Small site"


def test_a_failure_of_the_swap_keeps_the_old_map(small_site: Site, tmp_path: Path) -> None:
    save_site(small_site, tmp_path / "site")
    store = DeviceStore(tmp_path / "state", tmp_path / "site")
    with pytest.raises(Exception, match="publish it again"):
        store.swap_map(tmp_path / "gone")
    assert store.load_map().name == "Small site"
