"""Fetching a map from the console: to the disk, on from where it was after any interruption, checked before it is used.

::

    STAGING/
      SHA256.part       the package as far as it has come; named after what it will be, so that it can go on later
      CHECKSUM/         a site that is unpacked, checked, and waits until nobody is being led

What the disk must hold is bounded: one package, and two such sites at most (one waits, a newer one comes).
"""

from __future__ import annotations

import asyncio
import hashlib
import re
import shutil
import ssl
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import httpx

from navcore.errors import InputError, SiteError, VbrError
from navcore.folder_swap import sync_tree
from navcore.site import MAX_PACKAGE_BYTES, map_checksum, unpack_site
from navcore.wire import MapAvailable
from navcore.zip_reading import opened_zip

_TIMEOUT = httpx.Timeout(10.0, read=30.0)
RESERVE_BYTES = 64 << 20
"""So much of the disk stays free for events and recordings."""


class InterruptedFetchError(VbrError):
    """The map has not come whole; what has come is kept, and the next attempt goes on from there."""


@dataclass(frozen=True, slots=True)
class MapSource:
    """Where maps come from."""

    console_url: str
    """ws(s)://host:port."""
    token: str
    tls: ssl.SSLContext | None = None


def http_origin(console_url: str) -> str:
    """Return ``http(s)://host:port`` of a console named by its WebSocket address."""
    parts = urlsplit(console_url)
    return f"{'https' if parts.scheme == 'wss' else 'http'}://{parts.netloc}"


def staging_folder(site_folder: Path) -> Path:
    """Return where new maps of this site wait: beside it, so that one can be moved into place in one step."""
    return site_folder.parent / f".{site_folder.name}-incoming"


async def fetch_map(offer: MapAvailable, source: MapSource, staging: Path, keep: Collection[str] = ()) -> Path:
    """Return the folder of the offered map, fetched, unpacked and checked.

    What lies in ``staging`` besides this map and those of the checksums in ``keep`` is removed. Raises
    InterruptedFetchError where trying again goes on from here, SiteError where what was offered is no map for this
    device, however often it is fetched, else VbrError; nothing of it is left behind then.
    """
    _refuse_unfit(offer)
    folder = staging / offer.map_checksum
    part = staging / f"{offer.package_sha256}.part"
    await asyncio.to_thread(_tidy, staging, {part.name, folder.name, *keep})
    if folder.is_dir():
        # It was complete before it got this name.
        return folder
    await _download(offer, source, part)
    try:
        await asyncio.to_thread(_unpack_checked, part, folder, offer)
    finally:
        part.unlink(missing_ok=True)
    return folder


def _refuse_unfit(offer: MapAvailable) -> None:
    if not offer.path.startswith("/") or offer.path.startswith("//"):
        raise InputError(f"The console offers a map at {offer.path!r}, which is no path of its own: publish it again.")
    if re.fullmatch(r"[0-9a-z]{1,64}", offer.map_checksum) is None:
        raise InputError(f"The console offers a map of the checksum {offer.map_checksum!r}, which is none.")
    if not 0 < offer.size_bytes <= MAX_PACKAGE_BYTES:
        raise InputError(f"The console offers a map of {offer.size_bytes} bytes: 1 GiB is the most that is taken.")


def _tidy(staging: Path, keep: Collection[str]) -> None:
    staging.mkdir(parents=True, exist_ok=True)
    for path in staging.iterdir():
        if path.name in keep:
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


async def _download(offer: MapAvailable, source: MapSource, part: Path) -> None:
    """Bring the file to its full size, from where it is."""
    have_bytes = part.stat().st_size if part.exists() else 0
    if have_bytes >= offer.size_bytes:
        return
    _refuse_without_room(part.parent, offer.size_bytes - have_bytes)
    headers = {"Authorization": f"Bearer {source.token}", "Accept-Encoding": "identity"}
    if have_bytes:
        headers |= {"Range": f"bytes={have_bytes}-", "If-Range": f'"{offer.package_sha256}"'}
    try:
        async with (
            httpx.AsyncClient(timeout=_TIMEOUT, verify=source.tls or True, trust_env=False) as client,
            client.stream("GET", http_origin(source.console_url) + offer.path, headers=headers) as response,
        ):
            _refuse_answer(response, part)
            await _receive(response, part, offer.size_bytes, have_bytes)
    except httpx.HTTPError as error:
        raise InterruptedFetchError(f"The map has not come whole yet ({error or type(error).__name__}).") from error
    except OSError as error:
        part.unlink(missing_ok=True)
        raise VbrError(f"The map could not be written ({error.strerror}): free the disk.") from error


def _refuse_answer(response: httpx.Response, part: Path) -> None:
    status = response.status_code
    if status in (200, 206):
        return
    if status == 416 or status >= 500:
        if status == 416:
            # What is here is no beginning of what is there.
            part.unlink(missing_ok=True)
        raise InterruptedFetchError(f"The map has not come whole yet (the console answers {status}).")
    raise VbrError(f"The map could not be fetched (the console answers {status}): publish it again.")


async def _receive(response: httpx.Response, part: Path, size_bytes: int, have_bytes: int) -> None:
    goes_on = response.status_code == 206 and response.headers.get("Content-Range", "").startswith(
        f"bytes {have_bytes}-"
    )
    if response.status_code == 206 and not goes_on:
        part.unlink(missing_ok=True)
        raise InterruptedFetchError("The console sent another piece of the map than was asked for.")
    # A server that knows no ranges sends all of it, from the beginning.
    have_bytes = have_bytes if goes_on else 0
    with part.open("ab" if goes_on else "wb") as out:
        async for chunk in response.aiter_raw():
            have_bytes += len(chunk)
            if have_bytes > size_bytes:
                break
            out.write(chunk)
    if have_bytes != size_bytes:
        part.unlink(missing_ok=True)
        raise VbrError(f"The map is not of the {size_bytes} bytes that were offered: publish it again.")


def _unpack_checked(part: Path, folder: Path, offer: MapAvailable) -> None:
    with part.open("rb") as package:
        found_sha256 = hashlib.file_digest(package, "sha256").hexdigest()
    if found_sha256 != offer.package_sha256:
        raise VbrError("The map that came is damaged (its checksum is another): it is fetched anew at the next offer.")
    _refuse_without_room(part.parent, _unpacked_bytes(part))
    unpack_site(part, folder)
    found = map_checksum(folder)
    if found != offer.map_checksum:
        shutil.rmtree(folder, ignore_errors=True)
        raise SiteError(
            f"The map that came ({found[:12]}…) is not the one offered ({offer.map_checksum[:12]}…): publish again."
        )
    sync_tree(folder)


def _unpacked_bytes(part: Path) -> int:
    try:
        with part.open("rb") as file, opened_zip(file, "The site package", MAX_PACKAGE_BYTES) as package:
            return sum(entry.file_size for entry in package.infolist())
    except (OSError, SiteError) as error:
        raise SiteError(f"The map that came is no package ({error}): publish it again.") from error


def _refuse_without_room(folder: Path, needed_bytes: int) -> None:
    free_bytes = shutil.disk_usage(folder).free
    if free_bytes < needed_bytes + RESERVE_BYTES:
        raise VbrError(
            f"There is no room for the new map ({needed_bytes >> 20} MiB more, and {RESERVE_BYTES >> 20} MiB that stay"
            f" free; there are {free_bytes >> 20} MiB): free the disk."
        )
