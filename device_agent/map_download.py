"""Fetching a map from the console into a staging folder, where it waits until nobody is being led."""

from __future__ import annotations

import asyncio
import shutil
import ssl
from pathlib import Path
from urllib.parse import urlsplit

import httpx

from navcore.errors import InputError, SiteError, VbrError
from navcore.site import MAX_PACKAGE_BYTES, map_checksum, unpack_site
from navcore.wire import MapAvailable

_TIMEOUT = httpx.Timeout(10.0, read=30.0)


def http_origin(console_url: str) -> str:
    """Return ``http(s)://host:port`` of a console named by its WebSocket address."""
    parts = urlsplit(console_url)
    return f"{'https' if parts.scheme == 'wss' else 'http'}://{parts.netloc}"


def staging_folder(site_folder: Path) -> Path:
    """Return where a new map of this site waits: beside it, so that it can be moved into place in one step."""
    return site_folder.parent / f".{site_folder.name}-incoming"


async def fetch_map(
    offer: MapAvailable, console_url: str, token: str, staging: Path, tls: ssl.SSLContext | None = None
) -> None:
    """Download, check and unpack a map into ``staging``, replacing what lies there.

    Raises VbrError where it cannot be had or is not what was offered; nothing is left behind then.
    """
    package = await _download(offer, console_url, token, tls)
    await asyncio.to_thread(_unpack_checked, package, staging, offer.map_checksum)


async def _download(offer: MapAvailable, console_url: str, token: str, tls: ssl.SSLContext | None) -> bytes:
    if not offer.path.startswith("/") or offer.path.startswith("//"):
        raise InputError(f"The console offers a map at {offer.path!r}, which is no path of its own: publish it again.")
    if not 0 < offer.size_bytes <= MAX_PACKAGE_BYTES:
        raise InputError(f"The console offers a map of {offer.size_bytes} bytes: 1 GiB is the most that is taken.")
    try:
        async with (
            httpx.AsyncClient(timeout=_TIMEOUT, verify=tls or True, trust_env=False) as client,
            client.stream(
                "GET", http_origin(console_url) + offer.path, headers={"Authorization": f"Bearer {token}"}
            ) as response,
        ):
            response.raise_for_status()
            return await _received(response, offer.size_bytes)
    except httpx.HTTPError as error:
        raise VbrError(f"The map could not be fetched ({error}): publish it again.") from error


async def _received(response: httpx.Response, size_bytes: int) -> bytes:
    package = bytearray()
    async for chunk in response.aiter_bytes():
        package += chunk
        if len(package) > size_bytes:
            break
    if len(package) != size_bytes:
        raise VbrError(f"The map is not of the {size_bytes} bytes that were offered: publish it again.")
    return bytes(package)


def _unpack_checked(package: bytes, staging: Path, checksum: str) -> None:
    shutil.rmtree(staging, ignore_errors=True)
    unpack_site(package, staging)
    found = map_checksum(staging)
    if found != checksum:
        shutil.rmtree(staging, ignore_errors=True)
        raise SiteError(f"The map that came ({found[:12]}…) is not the one offered ({checksum[:12]}…): publish again.")
