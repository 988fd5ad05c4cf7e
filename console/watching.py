"""Who watches which walker just now: each is told to the walker, and written down.

A page says, over its live stream, which devices it shows while somebody can see it. A stream that says nothing of it
(a program, an old page) gets everything, and counts as watching everything. Whoever has just gone is taken for watching
a little longer, so that a page that is loaded anew, or left for another one, says nothing to the walker. Whoever still
shows a walker whose link breaks watches on: the walker does not hear that nobody does when the link is back.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Protocol

from console.access import AccessLog
from navcore.wire import MAX_NAMES_COUNT

GRACE_S = 8.0
AWAY_S = 120.0
"""A device that has been gone for longer is not watched any more, whoever shows what it said last."""
SAYS_AT_LEAST_EVERY_S = 10.0
"""A window that has once said what it shows, and says it no more, shows nothing any longer: its page is hidden."""
NOTED_EVERY_S = 30.0
LOOK_EVERY_S = 0.5
_log = logging.getLogger(__name__)


class WatchedDevices(Protocol):
    """What is asked of the hub."""

    def connected_ids(self) -> tuple[str, ...]:
        """Return the devices that are connected now."""
        ...

    def set_watchers(self, device_id: str, names: tuple[str, ...]) -> None:
        """Show who watches a device, and tell it."""
        ...


@dataclass(frozen=True, slots=True)
class _Open:
    """A page, or another stream, of one person."""

    who: str
    shows: frozenset[str] | None
    """Ids of devices; None shows every one."""
    said_s: float
    """When it said so; what has never said anything shows all as long as it is open."""
    counts_alone: bool = False
    """It counts only where this person has no other window: the scene knows not whether it can be seen."""


@dataclass(frozen=True, slots=True)
class _Watch:
    """Somebody watches a device."""

    seen_s: float
    """When they last did, as far as it is known."""
    entry: int | None = None
    """Their entry in the log; None until it could be written."""


class Window:
    """The window of one page, while it is open."""

    def __init__(self, watching: Watching) -> None:
        self._watching = watching

    def shows(self, device_ids: frozenset[str]) -> bool:
        """It says which devices it shows now; return whether that is news."""
        return self._watching.shows(self, device_ids)

    def sees(self, device_id: str) -> bool:
        """Whether what a device tells of its walker is for this window."""
        return self._watching.sees(self, device_id)


class Watching:
    """All who watch. All methods may be called from any thread; ``now_s`` is a monotonic clock.

    Windows only say what they show; :meth:`look`, called twice a second beside them, tells and writes it down.
    """

    def __init__(self, now_s: Callable[[], float], access: AccessLog, devices: WatchedDevices) -> None:
        self._now_s, self._access, self._devices = now_s, access, devices
        self._lock = threading.Lock()
        self._looking = threading.Lock()
        self._windows: dict[object, _Open] = {}
        self._watches: dict[str, dict[str, _Watch]] = {}
        self._connected_s: dict[str, float] = {}
        """When a device was connected last."""
        self._counted: frozenset[tuple[str, str]] = frozenset()
        """Device and person of whom it has been told; nobody else is shown anything."""
        self._ended: list[tuple[int, str]] = []
        """Entries of the log whose end is still to be written, and their devices."""
        self._noted_s = now_s()
        self._is_failing = False

    @contextmanager
    def window(self, who: str, *, says: bool) -> Iterator[Window]:
        """Open a window of a page for as long as the block runs."""
        window = Window(self)
        self.opened(window, who, says=says)
        try:
            yield window
        finally:
            self.closed(window)

    def opened(self, window: object, who: str, *, says: bool, counts_alone: bool = False) -> None:
        """A window has been opened; one that never ``says`` what it shows, shows everything."""
        shows = frozenset[str]() if says else None
        with self._lock:
            self._windows[window] = _Open(who, shows, self._now_s(), counts_alone)

    def shows(self, window: object, device_ids: frozenset[str]) -> bool:
        """A window says which devices it shows now, none where nobody can see it; return whether that is news."""
        with self._lock:
            known = self._windows.get(window)
            if known is None:
                return False
            self._windows[window] = replace(known, shows=device_ids, said_s=self._now_s())
            return known.shows != device_ids

    def closed(self, window: object) -> None:
        """A window is gone."""
        with self._lock:
            self._windows.pop(window, None)

    def sees(self, window: object, device_id: str) -> bool:
        """Whether what a device tells of its walker is for this window: it watches, and is counted."""
        connected = self._devices.connected_ids()
        with self._lock:
            known = self._windows.get(window)
            is_shown = known is not None and _shows(known, device_id, self._now_s())
            return known is not None and is_shown and self._is_counted(known.who, device_id, connected)

    def scene_sees(self, window: object, device_id: str) -> bool:
        """The same for a scene: where its person has pages open, these must say that they show the device."""
        connected = self._devices.connected_ids()
        with self._lock:
            known, now_s = self._windows.get(window), self._now_s()
            if known is None or not self._is_counted(known.who, device_id, connected):
                return False
            pages = [each for each in self._windows.values() if each.who == known.who and not each.counts_alone]
            return not pages or any(_shows(page, device_id, now_s) for page in pages)

    def person_sees(self, who: str, device_id: str) -> bool:
        """Whether a page of this person says that it shows the device."""
        connected = self._devices.connected_ids()
        with self._lock:
            now_s = self._now_s()
            pages = [each for each in self._windows.values() if each.who == who and not each.counts_alone]
            return self._is_counted(who, device_id, connected) and any(_shows(page, device_id, now_s) for page in pages)

    def looked(self, who: str, device_id: str) -> None:
        """Somebody has asked for a picture of a walker: that is watching as well."""
        with self._lock:
            self._windows[who, device_id] = _Open(who, frozenset({device_id}), self._now_s())

    def look(self) -> None:
        """Bring up to date who watches and tell the devices; then write it down, which may have to wait."""
        with self._looking:
            now_s = self._now_s()
            for device_id, who in self._seen_now(now_s, self._lately_connected(now_s)):
                self._begin_or_go_on(who, device_id, now_s)
            for device_id, watches in self._watches.items():
                for who, watch in tuple(watches.items()):
                    if now_s - watch.seen_s > GRACE_S:
                        del watches[who]
                        if watch.entry is not None:
                            self._ended.append((watch.entry, device_id))
                self._devices.set_watchers(device_id, tuple(watches)[:MAX_NAMES_COUNT])
            self._watches = {device_id: watches for device_id, watches in self._watches.items() if watches}
            counted = frozenset((each, who) for each, watches in self._watches.items() for who in watches)
            with self._lock:
                self._counted = counted
            try:
                self._write_down(now_s)
                self._is_failing = False
            except Exception:
                # It is tried again at the next look, and said once; whoever is watched has been told.
                if not self._is_failing:
                    _log.exception("who watches cannot be written down for now")
                self._is_failing = True

    def _is_counted(self, who: str, device_id: str, connected: tuple[str, ...]) -> bool:
        """Whether the device has been told of somebody; one that is away tells nothing new, and cannot be told."""
        return device_id not in connected or (device_id, who) in self._counted

    def _write_down(self, now_s: float) -> None:
        for device_id, watches in self._watches.items():
            for who, watch in watches.items():
                if watch.entry is None:
                    watches[who] = replace(watch, entry=self._access.watch_begins(who, device_id))
        while self._ended:
            self._access.watch_ends(*self._ended[-1])
            self._ended.pop()
        self._note(now_s)

    def _lately_connected(self, now_s: float) -> tuple[str, ...]:
        self._connected_s |= dict.fromkeys(self._devices.connected_ids(), now_s)
        self._connected_s = {each: at_s for each, at_s in self._connected_s.items() if now_s - at_s <= AWAY_S}
        return tuple(self._connected_s)

    def _note(self, now_s: float) -> None:
        """Write down now and then who still watches, all at once: with many devices on a page these are many."""
        if now_s - self._noted_s < NOTED_EVERY_S:
            return
        entries = [
            watch.entry for watches in self._watches.values() for watch in watches.values() if watch.entry is not None
        ]
        if entries:
            self._access.watches_go_on(entries)
        self._noted_s = now_s

    def _seen_now(self, now_s: float, device_ids: tuple[str, ...]) -> list[tuple[str, str]]:
        """Return device and person of everything that is shown to somebody; forget pictures that were asked for."""
        with self._lock:
            over = [key for key, window in self._windows.items() if isinstance(key, tuple) and _is_over(window, now_s)]
            for key in over:
                del self._windows[key]
            windows = tuple(self._windows.values())
        with_pages = {window.who for window in windows if not window.counts_alone}
        counted = [window for window in windows if not (window.counts_alone and window.who in with_pages)]
        return [(each, window.who) for window in counted for each in device_ids if _shows(window, each, now_s)]

    def _begin_or_go_on(self, who: str, device_id: str, now_s: float) -> None:
        watches = self._watches.setdefault(device_id, {})
        watches[who] = replace(watches.get(who, _Watch(now_s)), seen_s=now_s)


def _is_over(window: _Open, now_s: float) -> bool:
    return now_s - window.said_s > SAYS_AT_LEAST_EVERY_S


def _shows(window: _Open, device_id: str, now_s: float) -> bool:
    if window.shows is None:
        return True
    return device_id in window.shows and not _is_over(window, now_s)
