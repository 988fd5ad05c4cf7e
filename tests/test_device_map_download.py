"""Maps are fetched whole or not at all: over cuts, restarts, and whatever a server may send."""

from __future__ import annotations

import asyncio
import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from device_package_server import TOKEN, PackageServer, offer_of, serving_package
from test_device_link import Device

from device_agent.link_settings import LinkSettings
from device_agent.map_download import InterruptedFetchError, MapSource, fetch_map
from device_agent.map_intake import MapIntake
from navcore.errors import VbrError
from navcore.site import Site, map_checksum, save_site
from navcore.site_files import MANIFEST, SCHEMA_VERSION
from navcore.wire import MapAvailable, MapRunning


@pytest.fixture
def published(small_site: Site, tmp_path: Path) -> Path:
    save_site(small_site, tmp_path / "published")
    return tmp_path / "published"


@pytest.fixture
def offer(published: Path) -> MapAvailable:
    return offer_of(published)[0]


@pytest.fixture
def server(published: Path) -> Iterator[PackageServer]:
    with serving_package(offer_of(published)[1]) as server:
        yield server


def fetched(offer: MapAvailable, server: PackageServer, staging: Path) -> Path:
    return asyncio.run(fetch_map(offer, MapSource(server.url, TOKEN), staging))


def left_in(staging: Path) -> list[str]:
    return sorted(path.name for path in staging.iterdir()) if staging.exists() else []


def test_a_map_is_fetched_checked_and_unpacked(offer: MapAvailable, server: PackageServer, tmp_path: Path) -> None:
    folder = fetched(offer, server, tmp_path / "staging")
    assert map_checksum(folder) == offer.map_checksum
    assert left_in(tmp_path / "staging") == [offer.map_checksum]
    fetched(offer, server, tmp_path / "staging")
    assert server.asked == [""]


@pytest.mark.parametrize("knows_ranges", [True, False])
def test_a_download_goes_on_where_it_was_cut_off(
    offer: MapAvailable, server: PackageServer, tmp_path: Path, knows_ranges: bool
) -> None:
    server.cuts_after_bytes = 1000
    with pytest.raises(InterruptedFetchError, match="not come whole"):
        fetched(offer, server, tmp_path / "staging")
    assert left_in(tmp_path / "staging") == [f"{offer.package_sha256}.part"]
    server.cuts_after_bytes, server.knows_ranges = None, knows_ranges
    assert map_checksum(fetched(offer, server, tmp_path / "staging")) == offer.map_checksum
    assert server.asked == ["", "bytes=1000-"]


def test_another_package_begins_anew_and_the_old_piece_goes(
    offer: MapAvailable, server: PackageServer, small_site: Site, tmp_path: Path
) -> None:
    server.cuts_after_bytes = 1000
    with pytest.raises(InterruptedFetchError):
        fetched(offer, server, tmp_path / "staging")
    save_site(replace(small_site, name="Another"), tmp_path / "other")
    other, server.package = offer_of(tmp_path / "other")
    server.cuts_after_bytes = None
    assert map_checksum(fetched(other, server, tmp_path / "staging")) == other.map_checksum
    assert left_in(tmp_path / "staging") == [other.map_checksum]
    assert server.asked == ["", ""]


@pytest.mark.parametrize(
    ("changes", "status", "damaged", "sentence"),
    [
        ({"map_checksum": "another"}, 200, False, "not the one offered"),
        ({"size_bytes": 5}, 200, False, "bytes that were offered"),
        ({}, 200, True, "damaged"),
        ({}, 404, False, "could not be fetched"),
        ({"path": "//elsewhere/maps/new"}, 200, False, "no path of its own"),
        ({"map_checksum": "../outside"}, 200, False, "which is none"),
        ({"size_bytes": 1 << 40}, 200, False, "1 GiB"),
    ],
)
def test_a_map_that_is_not_what_was_offered_is_refused_and_leaves_nothing(
    offer: MapAvailable, server: PackageServer, tmp_path: Path,
    changes: dict[str, object], status: int, damaged: bool, sentence: str,
) -> None:  # fmt: skip
    server.status = status
    if damaged:
        server.package = bytes(len(server.package))
    with pytest.raises(VbrError, match=sentence) as refusal:
        fetched(msgspec.structs.replace(offer, **changes), server, tmp_path / "staging")
    assert not isinstance(refusal.value, InterruptedFetchError)
    assert left_in(tmp_path / "staging") == []


def test_a_disk_without_room_is_said_before_anything_is_fetched(
    offer: MapAvailable, server: PackageServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("device_agent.map_download.RESERVE_BYTES", 1 << 60)
    with pytest.raises(VbrError, match="no room for the new map"):
        fetched(offer, server, tmp_path / "staging")
    assert server.asked == []


def of_a_newer_program(package: bytes) -> bytes:
    """Return a package whose manifest says that a newer program has written it."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(package)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == MANIFEST:
                data = json.dumps({**json.loads(data), "schema_version": SCHEMA_VERSION + 1}).encode()
            new.writestr(name, data)
    return out.getvalue()


def intake_of(server: PackageServer, device: Device, told: asyncio.Queue[MapRunning], staging: Path) -> MapIntake:
    async def wait(pause_s: float) -> None:
        server.cuts_after_bytes = None

    settings = LinkSettings(server.url, TOKEN, staging)
    return MapIntake(settings, device, told.put_nowait, lambda failures: 0.0, wait)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [(of_a_newer_program, "newer program"), (lambda package: b"no zip" + package[6:-30], "no package")],
)
def test_a_package_that_is_unfit_is_refused_with_a_sentence_and_not_fetched_again(
    offer: MapAvailable, server: PackageServer, tmp_path: Path, spoil: Callable[[bytes], bytes], sentence: str
) -> None:
    server.package = spoil(server.package)
    sha256 = hashlib.sha256(server.package).hexdigest()
    unfit = msgspec.structs.replace(offer, size_bytes=len(server.package), package_sha256=sha256)
    device = Device()

    async def offered_twice() -> tuple[MapRunning, MapRunning | None]:
        told: asyncio.Queue[MapRunning] = asyncio.Queue()
        intake = intake_of(server, device, told, tmp_path / "staging")
        assert intake.take(unfit) is None
        first = await asyncio.wait_for(told.get(), 20.0)
        return first, intake.take(unfit)

    first, second = asyncio.run(offered_twice())
    assert sentence in first.refusal
    assert first == second == MapRunning("c0ffee", first.refusal)
    assert (server.asked, device.maps, left_in(tmp_path / "staging")) == ([""], [], [])


def test_what_was_cut_off_is_tried_again_until_it_is_here_and_handed_over_once(
    offer: MapAvailable, server: PackageServer, tmp_path: Path
) -> None:
    server.cuts_after_bytes = 1000
    device = Device()

    async def offered_thrice() -> None:
        intake = intake_of(server, device, asyncio.Queue(), tmp_path / "staging")
        for _ in range(2):
            assert intake.take(offer) is None
        await asyncio.to_thread(device.wait_for, lambda: bool(device.maps))
        assert intake.take(offer) is None

    asyncio.run(offered_thrice())
    assert device.maps == [(tmp_path / "staging" / offer.map_checksum, offer.map_checksum)]
    assert server.asked == ["", "bytes=1000-"]


def test_what_the_device_runs_already_is_not_fetched(
    offer: MapAvailable, server: PackageServer, tmp_path: Path
) -> None:
    async def offered() -> MapRunning | None:
        intake = intake_of(server, Device(), asyncio.Queue(), tmp_path / "staging")
        return intake.take(msgspec.structs.replace(offer, map_checksum="c0ffee"))

    assert asyncio.run(offered()) == MapRunning("c0ffee")
    assert server.asked == []
