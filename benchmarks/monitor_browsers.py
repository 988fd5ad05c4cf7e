"""Browsers as far as the monitor's live stream goes: real WebSocket clients, which note what they would show."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket as sockets
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from urllib.parse import urlsplit

import msgspec
import numpy as np
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from benchmarks.monitor_devices import captured_s
from navcore.geometry import FloatArray

FRAMES_HZ = 60.0
"""How often a screen shows what is there by then."""


SAY_EVERY_S = 3.0


@dataclass(frozen=True, slots=True)
class Page:
    """What a browser has open."""

    path: str
    watching: tuple[str, ...] | None
    """Ids of the devices that it says it shows; None says nothing, and is sent everything."""


EVERYTHING = Page("/live", None)
"""No page of ours: a program, or one of an older version."""


def console_page(device_id: str) -> Page:
    """Return the page Console of a device."""
    return Page(f"/live?says=1&devices=one&device={device_id}", (device_id,))


def overview_page(device_ids: Sequence[str]) -> Page:
    """Return the page Overview."""
    return Page("/live/overview?says=1", tuple(device_ids))


class _State(msgspec.Struct):
    last_cue: str = ""


class _Device(msgspec.Struct):
    id: str
    freshness: str
    state: _State | None = None


class _Row(msgspec.Struct):
    captured_s: float | None = None


class _Told(msgspec.Struct):
    devices: list[_Device] = msgspec.field(default_factory=list)
    rows: dict[str, _Row] = msgspec.field(default_factory=dict)
    """Of the page Overview, and only where they changed."""


@dataclass
class Seen:
    """What one browser was sent."""

    messages_count: int = 0
    bytes_count: int = 0
    arrivals: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    """When something new of a device came, and when that was captured (monotonic clock, seconds)."""
    live_count: int = 0
    shown_count: int = 0

    def take(self, data: str | bytes, now_s: float) -> None:
        """Note what a message shows."""
        self.messages_count += 1
        self.bytes_count += len(data)
        told = msgspec.json.decode(data, type=_Told)
        for device in told.devices:
            at_s = captured_s(device.state.last_cue) if device.state is not None else None
            if at_s is not None:
                self.shown_count += 1
                self.live_count += device.freshness == "live"
            self._note(device.id, at_s, now_s)
        for device_id, row in told.rows.items():
            self._note(device_id, row.captured_s, now_s)

    def _note(self, device_id: str, at_s: float | None, now_s: float) -> None:
        known = self.arrivals.setdefault(device_id, []) if at_s is not None else []
        if at_s is not None and (not known or known[-1][1] != at_s):
            known.append((now_s, at_s))

    def delays_s(self, from_s: float, until_s: float) -> FloatArray:
        """From capture until a browser has it, of all that came in that time."""
        every = [come for known in self.arrivals.values() for come in known if from_s <= come[0] < until_s]
        return np.array([came_s - at_s for came_s, at_s in every])

    def ages_s(self, from_s: float, until_s: float) -> FloatArray:
        """The age of what is on the screen, at each frame that the screen draws in that time."""
        frames_s = np.arange(from_s, until_s, 1.0 / FRAMES_HZ)
        shown = [_ages_s(np.array(known), frames_s) for known in self.arrivals.values()]
        return np.concatenate(shown) if shown else np.zeros(0)


def _ages_s(arrivals_s: FloatArray, frames_s: FloatArray) -> FloatArray:
    newest = np.searchsorted(arrivals_s[:, 0], frames_s, side="right") - 1
    drawn = newest >= 0
    return frames_s[drawn] - arrivals_s[newest[drawn], 1]


async def look(
    url: str, cookie: str, page: Page, until_s: float, seen: Seen, *, reads_every_s: float | None = 0.0
) -> None:
    """Be a browser until a time, and note what is seen: read at once, only every so often, or (None) never.

    A slow one has the small buffers of a thin line, so that what it does not read is soon the console's to hold.
    """
    is_slow = reads_every_s != 0.0
    address = urlsplit(url)
    line = sockets.socket()
    if is_slow:
        line.setsockopt(sockets.SOL_SOCKET, sockets.SO_RCVBUF, 4096)
    line.connect((address.hostname, address.port))
    line.setblocking(False)
    with contextlib.suppress(TimeoutError, ConnectionClosed):
        async with (
            asyncio.timeout(until_s - time.monotonic()),
            connect(
                f"{url.replace('http', 'ws', 1)}{page.path}", sock=line, origin=url,  # type: ignore[arg-type]
                additional_headers={"Cookie": cookie}, compression=None, proxy=None, max_size=None,
                max_queue=1 if is_slow else 16, ping_interval=None, close_timeout=1.0,
            ) as socket,
            asyncio.TaskGroup() as tasks,
        ):  # fmt: skip
            if page.watching is not None:
                tasks.create_task(_say(socket, page.watching))
            while True:
                if reads_every_s is None:
                    await asyncio.sleep(3600.0)
                seen.take(await socket.recv(), time.monotonic())
                await asyncio.sleep(reads_every_s or 0.0)


async def _say(socket: ClientConnection, watching: Sequence[str]) -> None:
    while True:
        await socket.send(json.dumps({"type": "watching", "watching": watching}))
        await asyncio.sleep(SAY_EVERY_S)


async def look_all(url: str, cookie: str, pages: Sequence[Page], until_s: float) -> list[Seen]:
    """Be a browser of each of these pages, all at once."""
    every = [Seen() for _ in pages]
    await asyncio.gather(*(look(url, cookie, page, until_s, seen) for page, seen in zip(pages, every, strict=True)))
    return every
