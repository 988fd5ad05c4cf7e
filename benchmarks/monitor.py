"""What the monitor can carry: how old what browsers show is, a hundred devices, an hour, a browser that does not read.

    python -m benchmarks.monitor [--only age chromium fleet restart memory slow] [--seconds 20] [--browsers 5]
        [--devices 100] [--never-say]

The console is a process of its own (``vbr console``), devices and browsers are real WebSocket clients on loopback: the
devices in a second process, the browsers in this one. Ages are of the capture, by the one monotonic clock of the
machine: *delay* from capture until a browser has it, *age* of what is on the screen at each frame that it draws.
``chromium`` is one real page among the browsers: there the age is the page's own, once a state is drawn.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks.console_process import RunningConsole, console_process
from benchmarks.monitor_browsers import EVERYTHING, Page, Seen, console_page, look, look_all, overview_page
from benchmarks.monitor_chromium import look_with_chromium
from benchmarks.monitor_devices import Told, burst_all, walk_all
from navcore.geometry import FloatArray

BEGIN_S = 3.0
"""Until all have joined, and the clocks have been compared."""
CHROMIUM_BEGIN_S = 30.0
"""Until its page and its scene are there."""
HOUR_STEPS_COUNT = 12
TARGET_AGE_P95_S = 0.25


def main() -> None:
    """Run it."""
    parts = {"age": age, "chromium": chromium, "fleet": fleet, "restart": restart, "memory": memory, "slow": slow}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=parts, default=list(parts))
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--browsers", type=int, default=5)
    parser.add_argument("--devices", type=int, default=100)
    parser.add_argument("--minutes", type=float, default=60.0, help="of a walk, for the memory")
    parser.add_argument("--no-scene", action="store_true", help="Chromium draws the page Console without its 3D scene")
    parser.add_argument("--never-say", action="store_true", help="browsers that ask for everything of all devices")
    parser.add_argument("--profile", type=Path, help="file for pstats: where the time of the console's loop goes")
    arguments = parser.parse_args()
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as devices:
        # Its imports are no part of what is measured.
        devices.submit(time.monotonic).result()
        for name in arguments.only:
            with tempfile.TemporaryDirectory() as folder:
                print(f"== {name}", flush=True)
                parts[name](arguments, Path(folder), devices)


# -------------------------------------------------------------------------------------------------------- measures
def age(arguments: argparse.Namespace, folder: Path, devices: ProcessPoolExecutor) -> None:
    """One device that decides at 20 Hz, seen by several browsers."""
    with console_process(folder, 1, arguments.profile) as console:
        pages = [_page(arguments)] * arguments.browsers
        told, seen, cpu_share = _walked(console, devices, arguments.seconds, 20.0, pages)
        _print_ages(f"1 device at 20 Hz, {len(pages)} browsers", seen, arguments.seconds, TARGET_AGE_P95_S)
        _print_events(console, told)
        print(f"console: {100 * cpu_share:.0f} % of a core, {console.rss_mb():.0f} MB")


def chromium(arguments: argparse.Namespace, folder: Path, devices: ProcessPoolExecutor) -> None:
    """The same, and one of the browsers is a real one."""
    with console_process(folder, 1, arguments.profile) as console:
        whole_s = CHROMIUM_BEGIN_S + arguments.seconds
        from_s, until_s = time.monotonic() + CHROMIUM_BEGIN_S, time.monotonic() + whole_s
        walking = devices.submit(walk_all, console.socket_url, list(console.tokens), whole_s + 1.0, 20.0)
        pages = [_page(arguments)] * (arguments.browsers - 1)

        async def all_look() -> tuple[list[Seen], FloatArray]:
            return await asyncio.gather(
                look_all(console.url, console.cookie, pages, until_s),
                look_with_chromium(
                    console.url, console.cookie, "glasses-0", from_s, until_s, with_scene=not arguments.no_scene
                ),
            )

        seen, drawn_s = asyncio.run(all_look())
        _print_ages(
            f"1 device at 20 Hz, {len(pages)} browsers beside Chromium", seen, arguments.seconds, None, CHROMIUM_BEGIN_S
        )
        print(
            f"  Chromium: capture to screen {_spread(drawn_s)}; {len(drawn_s) / arguments.seconds:.1f} states a second"
        )
        _print_events(console, [*walking.result()])


def fleet(arguments: argparse.Namespace, folder: Path, devices: ProcessPoolExecutor) -> None:
    """Many devices at 10 Hz, seen by the page Overview, and one of them by the page Console."""
    with console_process(folder, arguments.devices, arguments.profile) as console:
        names = [f"glasses-{number}" for number in range(arguments.devices)]
        pages = [EVERYTHING] if arguments.never_say else [overview_page(names), console_page(names[0])]
        told, seen, cpu_share = _walked(console, devices, arguments.seconds, 10.0, pages)
        for page, each in zip(pages, seen, strict=True):
            _print_ages(f"{arguments.devices} devices at 10 Hz, {page.path}", [each], arguments.seconds, None)
        _print_events(console, told)
        print(f"console: {100 * cpu_share:.0f} % of a core, {console.rss_mb():.0f} MB")


def restart(arguments: argparse.Namespace, folder: Path, devices: ProcessPoolExecutor) -> None:
    """Many devices at 10 Hz, and in the middle the console is killed and started again."""
    with console_process(folder, arguments.devices) as console:
        seconds = BEGIN_S + arguments.seconds
        walking = devices.submit(walk_all, console.socket_url, list(console.tokens), seconds, 10.0)
        time.sleep(seconds / 2)
        console.kill_and_start_again()
        _print_events(console, walking.result())


def memory(arguments: argparse.Namespace, folder: Path, devices: ProcessPoolExecutor) -> None:
    """An hour of a walk as fast as it is taken in: in bursts, each over a link of its own, and a browser looks on."""
    with console_process(folder, 1, arguments.profile) as console:
        held_mb, began_s, told = [console.rss_mb()], time.monotonic(), Told("glasses-0")

        async def watched(told: Told) -> None:
            browser = asyncio.create_task(look(console.url, console.cookie, _page(arguments), began_s + 3600.0, Seen()))
            loop = asyncio.get_running_loop()
            for _ in range(HOUR_STEPS_COUNT):
                minutes = arguments.minutes / HOUR_STEPS_COUNT
                told = await loop.run_in_executor(
                    devices, burst_all, console.socket_url, console.tokens[0], minutes, told
                )
                assert told.confirmed_sequence == told.events_count
                held_mb.append(console.rss_mb())
            browser.cancel()
            await asyncio.gather(browser, return_exceptions=True)

        asyncio.run(watched(told))
        took_s, step = time.monotonic() - began_s, arguments.minutes / HOUR_STEPS_COUNT
        print(f"{arguments.minutes:g} minutes of a walk in {took_s:.0f} s; MB before, and every {step:g} minutes:")
        print("  " + " ".join(f"{mb:.0f}" for mb in held_mb))
        print(f"from the second step to the last: {held_mb[-1] - held_mb[2]:+.1f} MB")


def slow(arguments: argparse.Namespace, folder: Path, devices: ProcessPoolExecutor) -> None:
    """The same browsers without and with two that hardly read, or never."""
    with console_process(folder, 1, arguments.profile) as console:
        pages = [_page(arguments)] * (arguments.browsers - 1)
        _, alone, _ = _walked(console, devices, arguments.seconds, 20.0, pages)
        _print_ages("all browsers read", alone, arguments.seconds, None)
        before_mb = console.rss_mb()
        _, beside, _ = _walked(console, devices, arguments.seconds, 20.0, pages, slow_reads_every_s=(1.0, None))
        _print_ages("beside one that reads once a second, and one that never does", beside, arguments.seconds, None)
        print(f"console: {console.rss_mb() - before_mb:+.1f} MB meanwhile")


# ---------------------------------------------------------------------------------------------------------- walking
def _walked(
    console: RunningConsole,
    devices: ProcessPoolExecutor,
    seconds: float,
    rate_hz: float,
    pages: Sequence[Page],
    slow_reads_every_s: Sequence[float | None] = (),
) -> tuple[list[Told], list[Seen], float]:
    """Let the devices walk, and browsers look on; return both, and the share of a core that the console took."""
    walking = devices.submit(walk_all, console.socket_url, list(console.tokens), BEGIN_S + seconds, rate_hz)
    until_s, cpu_s = time.monotonic() + BEGIN_S + seconds, console.cpu_s()

    async def all_look() -> list[Seen]:
        aside = [
            asyncio.create_task(look(console.url, console.cookie, pages[0], until_s, Seen(), reads_every_s=every_s))
            for every_s in slow_reads_every_s
        ]
        seen = await look_all(console.url, console.cookie, pages, until_s)
        await asyncio.gather(*aside)
        return seen

    seen = asyncio.run(all_look())
    cpu_share = (console.cpu_s() - cpu_s) / (BEGIN_S + seconds)
    return walking.result(), seen, cpu_share


def _page(arguments: argparse.Namespace) -> Page:
    return EVERYTHING if arguments.never_say else console_page("glasses-0")


def _print_ages(
    what: str, seen: Sequence[Seen], seconds: float, target_s: float | None, begin_s: float = BEGIN_S
) -> None:
    until_s = max(come[-1][0] for each in seen for come in each.arrivals.values())
    from_s = until_s - seconds
    ages_s = np.concatenate([each.ages_s(from_s, until_s) for each in seen])
    print(f"{what}: delay {_spread(np.concatenate([each.delays_s(from_s, until_s) for each in seen]))}")
    verdict = ""
    if target_s is not None:
        verdict = f"; wanted: p95 up to {1e3 * target_s:.0f} ms"
    print(f"  age on the screen {_spread(ages_s)}{verdict}")
    messages_hz = sum(each.messages_count for each in seen) / len(seen) / (begin_s + seconds)
    kbytes = sum(each.bytes_count for each in seen) / max(1, sum(each.messages_count for each in seen)) / 1e3
    shown_count = sum(each.shown_count for each in seen)
    live = f"; shown as live: {100 * sum(each.live_count for each in seen) / shown_count:.1f} %" if shown_count else ""
    print(f"  each browser: {messages_hz:.1f} messages a second of {kbytes:.1f} kB{live}")


def _spread(values_s: FloatArray) -> str:
    p50, p95, most = 1e3 * np.percentile(values_s, (50, 95, 100))
    return f"p50 {p50:.0f} ms, p95 {p95:.0f} ms, at most {most:.0f} ms"


def _print_events(console: RunningConsole, told: Sequence[Told]) -> None:
    lost, out_of_order = 0, 0
    for each in told:
        stored = console.stored_sequences(each.device_id)
        lost += len(set(range(1, each.events_count + 1)) - set(stored))
        out_of_order += stored != sorted(set(stored))
    sent, confirmed = sum(each.events_count for each in told), sum(each.confirmed_sequence for each in told)
    slowest_s = max(each.slowest_confirmation_s for each in told)
    print(
        f"  events: {sent} sent, {confirmed} confirmed, {lost} not in the database, {out_of_order} devices with events"
        f" twice or out of order; the slowest confirmation took {1e3 * slowest_s:.0f} ms"
    )
    breaks = [each for each in told if each.links_count != 1]
    why = f" ({breaks[0].last_break})" if breaks else ""
    print(f"  states: {sum(each.states_count for each in told)}; links that broke: {len(breaks)}{why}")


if __name__ == "__main__":
    main()
