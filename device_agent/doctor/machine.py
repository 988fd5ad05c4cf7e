"""Checks of the machine: map, disk, clock, link, memory and processor."""

from __future__ import annotations

import contextlib
import os
import shutil
import ssl
import time
from collections.abc import Callable
from email.utils import parsedate_to_datetime
from pathlib import Path

from device_agent.adapters.linux_host import THERMAL, hottest_c
from device_agent.device_store import DeviceStore
from device_agent.doctor.findings import Finding, as_finding, failed, ok, warning
from device_agent.recording.options import RecordingOptions
from device_agent.recording.room import map_walks_that_may_go, walks_that_may_go
from device_agent.recording.walk_files import parts_in
from device_agent.state_health import damages, largest_folders, refuse_unwritable
from navcore.site import load_site

_GIB = 1 << 30
_LOW_BYTES, _FULL_BYTES = _GIB, 100 << 20
_LOW_MEMORY_BYTES, _NO_MEMORY_BYTES = 500 << 20, 150 << 20
_HOT_C, _TOO_HOT_C = 75.0, 90.0
_LEAP_S = 1.0
_OLDEST_S = 1_767_225_600.0
"""1 January 2026: a clock before it has never been set."""
_MAX_OFFSET_S = 5.0
_ANSWER_WITHIN_S = 5.0
_LISTS_MEMORY = "`ps -eo pmem,pid,comm --sort=-pmem | head` lists them"
_LISTS_LOAD = "`ps -eo pcpu,pid,comm --sort=-pcpu | head` lists them"


def check_map(site: Path | None) -> Finding:
    """Read the whole site, checksums included."""
    if site is None:
        return failed("no map is named", "add `--site DIR`: the site's folder, as for `vbr device`")
    loaded = load_site(site)
    places = [poi for poi in loaded.poi_graph.pois.values() if poi.kind != "junction"]
    found = f"{loaded.name}: {len(places)} places, version {loaded.poi_graph.version}, whole"
    if not places:
        return warning(found, "nobody can choose a destination: name places in the console, and publish")
    return ok(found)


def check_disk(folder: Path, free_bytes: Callable[[Path], int] = lambda path: shutil.disk_usage(path).free) -> Finding:
    """Write to the device's own folder, look how much room there is, and whether what is kept there can be read."""
    refuse_unwritable(folder)
    free = free_bytes(folder)
    found = f"{free / (1 << 30):.1f} GiB free at {folder}"
    if free < _LOW_BYTES:
        advice = f"move recordings elsewhere; {largest_folders(folder)}"
        return (failed if free < _FULL_BYTES else warning)(found, advice)
    # The site is no matter of what is kept in this folder.
    for damage in damages(DeviceStore(folder, Path())):
        return as_finding(warning, damage)
    return ok(found)


def check_recordings(
    options: RecordingOptions | None,
    free_bytes: Callable[[Path], int] = lambda path: shutil.disk_usage(path).free,
) -> Finding:
    """Look at the recordings that are kept, and at which of them go when the disk gets full."""
    if options is None:
        return ok("none are made: no `--record` is given")
    if not options.folder.is_dir():
        return ok(f"there are none in {options.folder} yet")
    walks = walks_that_may_go(options.folder, parts_in(options.folder))
    kept = [*walks, *map_walks_that_may_go(options.map_walks)]
    confirmed_bytes, other_bytes = (
        sum(each.size_bytes for each in kept if each.confirmed is wanted) for wanted in (True, False)
    )
    free = free_bytes(options.folder)
    found = (
        f"{(confirmed_bytes + other_bytes) / _GIB:.1f} GiB, of which the console has {confirmed_bytes / _GIB:.1f};"
        f" {free / _GIB:.1f} GiB free; what the console has goes below {options.keep_free_bytes / _GIB:.1f},"
        f" and the rest below {options.reserve_bytes / _GIB:.2f}"
    )
    if free + confirmed_bytes >= options.keep_free_bytes:
        return ok(found)
    advice = "share walks (`--share-walks`), or move them elsewhere: they go next, and the console does not have them"
    return warning(
        found,
        advice if other_bytes else f"free the disk: no recording is left to go; {largest_folders(options.folder)}",
    )


class ClockWatch:
    """Notes how the time of day and the steady clock go apart while the other checks run."""

    def __init__(self, wall_s: Callable[[], float] = time.time, steady_s: Callable[[], float] = time.monotonic) -> None:
        self._wall_s, self._steady_s = wall_s, steady_s
        self._offset_s = wall_s() - steady_s()

    def check(self, newest_s: float, is_synchronised: Callable[[], bool | None]) -> Finding:
        """Tell whether the time of day can be believed.

        Args:
            newest_s: the newest time that this device has ever noted, seconds since 1970; 0 where it has noted none.
            is_synchronised: asks the system; None where it does not say.
        """
        now_s = self._wall_s()
        leap_s = now_s - self._steady_s() - self._offset_s
        found = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now_s))
        if now_s < max(_OLDEST_S, newest_s - 60.0):
            return failed(
                f"{found} is earlier than what was noted before",
                "set the clock: connect to a network once, with `sudo timedatectl set-ntp true`",
            )
        if abs(leap_s) > _LEAP_S:
            return warning(f"{found}; it leapt by {leap_s:+.1f} s meanwhile", "wait until the clock is set")
        synchronised = is_synchronised()
        if synchronised is None:
            return warning(
                f"{found}; whether it is synchronised is not known",
                "let the program ask the kernel (adjtimex), or see `timedatectl`",
            )
        if not synchronised:
            return warning(
                f"{found}; it is not synchronised", "run `sudo timedatectl set-ntp true`, and connect to a network once"
            )
        return ok(f"{found}, synchronised")


def check_link(
    url: str | None, token: Callable[[], str], tls: Callable[[], ssl.SSLContext | None], new_token: str
) -> Finding:
    """Join the console's socket and leave before saying who calls: a device that is there already is not disturbed.

    ``new_token`` says how to come by another token.
    """
    if url is None:
        return ok("no console is named; the device leads without one")
    from websockets.exceptions import InvalidStatus, WebSocketException
    from websockets.sync.client import connect

    headers = {"Authorization": f"Bearer {token()}"}
    try:
        began_s = time.time()
        with connect(
            url.rstrip("/") + "/device", additional_headers=headers, ssl=tls(), open_timeout=_ANSWER_WITHIN_S,
            close_timeout=1.0, proxy=None,
        ) as socket:  # fmt: skip
            answered_s = time.time()
            date = "" if socket.response is None else socket.response.headers.get("Date", "")
    except InvalidStatus as error:
        if error.response.status_code in (401, 403):
            return failed("the console refuses the token", new_token)
        return failed(f"the console answers {error.response.status_code}", "see that the address is the console's")
    except (OSError, WebSocketException) as error:
        # Guidance never depends on the console.
        return warning(f"the console does not answer ({error})", "see that it runs, and that the network is there")
    return _reached(answered_s - began_s, _offset_s(date, answered_s))


def _reached(took_s: float, offset_s: float | None) -> Finding:
    found = f"reached in {1000.0 * took_s:.0f} ms, token accepted"
    if offset_s is None:
        return ok(f"{found}; the console does not tell its time")
    if abs(offset_s) > _MAX_OFFSET_S:
        return warning(
            f"{found}; its clock is {offset_s:+.0f} s off ours", "set both clocks: see the check of the clock"
        )
    return ok(f"{found}, clocks within {_MAX_OFFSET_S:g} s")


def _offset_s(date: str, now_s: float) -> float | None:
    """Return the console's clock minus ours, to a second: HTTP tells whole seconds (RFC 9110, 6.6.1)."""
    try:
        return parsedate_to_datetime(date).timestamp() + 0.5 - now_s
    except (TypeError, ValueError):
        return None


def check_system(meminfo: Path = Path("/proc/meminfo"), thermal: Path = THERMAL, load: float | None = None) -> Finding:
    """Look at free memory, load and temperature."""
    free, cores = _available_bytes(meminfo), os.cpu_count() or 1
    load = os.getloadavg()[0] if load is None else load
    hottest = hottest_c(thermal)
    heat = "" if hottest is None else f", {hottest:.0f} °C"
    memory = "memory unknown" if free is None else f"{free / (1 << 20):.0f} MiB free"
    found = f"{memory}, load {load:.1f} on {cores} cores{heat}"
    if free is not None and free < _NO_MEMORY_BYTES:
        return failed(found, f"end other programs before this one is ended for lack of memory; {_LISTS_MEMORY}")
    if hottest is not None and hottest > _TOO_HOT_C:
        return failed(found, "let it cool down: the processor is being slowed")
    advice = []
    if free is None:
        advice.append("see that /proc is mounted (`ls /proc/meminfo`)")
    elif free < _LOW_MEMORY_BYTES:
        advice.append(f"end programs that take memory; {_LISTS_MEMORY}")
    if load > 1.5 * cores:
        advice.append(f"end programs that take the processor; {_LISTS_LOAD}")
    if (hottest or 0.0) > _HOT_C:
        advice.append("let it cool down: take it out of the sun and out of its bag")
    return warning(found, "; ".join(advice)) if advice else ok(found)


def _available_bytes(meminfo: Path) -> int | None:
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in meminfo.read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    return None
