"""Sending one recording to the console's machine, from where it was after any interruption. See link.md."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from typing import TypeVar

import httpx
import msgspec

from device_agent.map_download import MapSource, http_origin
from navcore.errors import VbrError
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import OFFERS_PATH, PIECE_BYTES, RecordingHeld, RecordingOffer, piece_path

T = TypeVar("T")
_TIMEOUT = httpx.Timeout(10.0, read=300.0)
"""The last piece is answered when the console has read all of the recording again, for its checksum."""
_OFFER_REFUSED = frozenset({400, 404, 405, 413})
"""Answers to an offer that the next one would get as well."""
_PIECE_REFUSED = _OFFER_REFUSED - {404}
"""The same of a piece. A console that has lost what it knew of a recording takes it anew when it is offered anew."""
MAX_BEGINNINGS = 3
"""A recording that comes damaged so often is not begun again."""


class NoThreadError(VbrError):
    """The machine starts no thread just now that could read the disk; nothing is wrong with any recording."""


class InterruptedUploadError(VbrError):
    """The recording has not gone whole; what has gone is kept, and the next attempt goes on from there."""


async def send_recording(
    archive: RecordingArchive,
    offer: RecordingOffer,
    console: MapSource,
    until_quiet: Callable[[], Awaitable[None]],
    progress: Callable[[int, int], None] = lambda sent_bytes, size_bytes: None,
) -> None:
    """Send a recording; returns when the console has all of it.

    Args:
        archive: its bytes.
        offer: what it is; its checksum is that of ``archive``.
        console: where it goes.
        until_quiet: waited for before each piece: what is more urgent goes first.
        progress: told how many bytes are there, of how many.

    Raises InterruptedUploadError or NoThreadError where trying again goes on from there, else VbrError.
    """
    async with _client(console) as client:
        await until_quiet()
        held = await _asked(client.post(OFFERS_PATH, content=msgspec.json.encode(offer)), _OFFER_REFUSED)
        beginnings = 1
        while not held.complete:
            progress(held.next_byte, offer.size_bytes)
            await until_quiet()
            before = held.next_byte
            held = await _send_piece(client, archive, offer.sha256, before)
            if held.next_byte <= before:
                # A piece that was taken always advances: what has come so far was damaged, and is asked for anew.
                beginnings += 1
            if beginnings > MAX_BEGINNINGS:
                raise VbrError("The recording has come damaged again and again: see to the disks of both machines.")
        progress(offer.size_bytes, offer.size_bytes)


def _client(console: MapSource) -> AbstractAsyncContextManager[httpx.AsyncClient]:
    return httpx.AsyncClient(
        base_url=http_origin(console.console_url),
        headers={"Authorization": f"Bearer {console.token}"},
        timeout=_TIMEOUT,
        verify=console.tls or True,
        trust_env=False,
    )


async def _send_piece(client: httpx.AsyncClient, archive: RecordingArchive, sha256: str, offset: int) -> RecordingHeld:
    """Send a piece, and pause for as long as that has taken: half of a slow link is left to all else."""
    piece = await in_thread(lambda: archive.read(offset, PIECE_BYTES))
    return await unhurried(_asked(client.put(piece_path(sha256, offset), content=piece), _PIECE_REFUSED))


async def in_thread(work: Callable[[], T]) -> T:
    """Do what reads the disk beside the event loop. Raises NoThreadError, or what it raises."""
    try:
        begun = asyncio.get_running_loop().run_in_executor(None, work)
    except RuntimeError as error:
        raise NoThreadError(
            f"This device is short of memory, or has too many threads, to read recordings ({error}): they wait here,"
            " and are tried again."
        ) from error
    return await begun


async def unhurried(work: Awaitable[T]) -> T:
    """Do something, and pause for as long as it has taken."""
    began_s = time.monotonic()
    done = await work
    await asyncio.sleep(time.monotonic() - began_s)
    return done


async def _asked(request: Awaitable[httpx.Response], refused: frozenset[int]) -> RecordingHeld:
    try:
        response = await request
    except httpx.HTTPError as error:
        raise InterruptedUploadError(
            f"The recording has not gone whole yet ({error or type(error).__name__})."
        ) from error
    if response.status_code in refused:
        raise VbrError(f"The console does not take the recording: {_sentence(response)}")
    if response.status_code != 200:
        raise InterruptedUploadError(f"The recording has not gone whole yet: {_sentence(response)}")
    try:
        return msgspec.json.decode(response.content, type=RecordingHeld)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise VbrError("The console answers what cannot be read: use the same version on both sides.") from error


def _sentence(response: httpx.Response) -> str:
    try:
        return str(response.json()["error"])[:400]
    except (ValueError, KeyError, TypeError):
        return f"it answers {response.status_code}."
