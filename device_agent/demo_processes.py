"""The live demo: the console and the device as two processes, started and stopped together."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from device_agent.recording.options import RecordingOptions, recording_flags
from navcore.errors import VbrError
from navcore.site import load_poi_graph, map_checksum

READY_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 10.0
CONSOLE_MUST_LAST_S = 10.0
"""A console that ends sooner than this after its start would only end again."""
_POLL_S = 0.1


def run_live_demo(
    data: Path,
    site: Path,
    port: int,
    seed: int,
    start: str,
    size_px: tuple[int, int],
    rate_hz: float,
    record: RecordingOptions | None = None,
) -> int:
    """Run console and device until Ctrl-C, or until the device ends by itself. Returns the exit code.

    A console that ends is started again: the walker goes on meanwhile, and the device joins it again.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    ready_file, token_file = data / "ready.json", data / "glasses.token"
    ready_file.unlink(missing_ok=True)
    device_site = _device_copy(site, data / "device" / "site")

    def console_command(port: int) -> list[str]:
        return [
            "console", "--site", str(site), "--data", str(data / "console"), "--port", str(port),
            "--ready-file", str(ready_file), "--device-token-file", str(token_file),
        ]  # fmt: skip

    with ExitStack() as stack:
        console = stack.enter_context(_process(console_command(port), quiet=True))
        ready = _wait_ready(ready_file, console, stop)
        if ready is None:
            return console.wait(STOP_TIMEOUT_S) if console.poll() is not None else 0
        url = str(ready["url"])
        device_command = [
            "device", "--site", str(device_site), "--state", str(data / "device" / "state"),
            "--console", url.replace("http", "ws", 1), "--token-file", str(token_file),
            "--simulated", "--seed", str(seed), "--start", start,
            "--size", f"{size_px[0]}x{size_px[1]}", "--rate-hz", f"{rate_hz:g}",
            *recording_flags(record),
        ]  # fmt: skip
        device = stack.enter_context(_process(device_command))
        _greet(ready, site)
        again = console_command(urlsplit(url).port or port)
        return _watch(device, console, lambda: stack.enter_context(_process(again, quiet=True)), stop)


def _device_copy(site: Path, folder: Path) -> Path:
    """Give the device a site of its own, as real glasses have; it keeps what it has where that is the same map."""
    if (folder / "manifest.json").exists() and map_checksum(folder) == map_checksum(site):
        return folder
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(site, folder)
    return folder


@contextmanager
def _process(command: Sequence[str], quiet: bool = False) -> Iterator[subprocess.Popen[bytes]]:
    """Run ``vbr COMMAND`` in a process of its own, and end it with the block."""
    process = subprocess.Popen(
        [sys.executable, "-m", "device_agent", *command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL if quiet else None,
        # Ctrl-C reaches this process alone: it ends the others, in order.
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _wait_ready(
    path: Path, console: subprocess.Popen[bytes], stop: threading.Event
) -> dict[str, str | int | None] | None:
    deadline_s = time.monotonic() + READY_TIMEOUT_S
    while not path.exists():
        if console.poll() is not None or stop.is_set():
            return None
        if time.monotonic() > deadline_s:
            raise VbrError(f"The console was not ready after {READY_TIMEOUT_S:.0f} s: is this machine overloaded?")
        stop.wait(_POLL_S)
    ready: dict[str, str | int | None] = json.loads(path.read_text(encoding="utf-8"))
    return ready


def _greet(ready: dict[str, str | int | None], site: Path) -> None:
    pois = load_poi_graph(site).pois.values()
    places = ", ".join(sorted(poi.name for poi in pois if poi.kind != "junction"))
    link = ready.get("first_link")
    lines = [
        "",
        f"  The console is at  {ready['url']}",
        f"  First, choose name and password here (the link works once):\n  {link}"
        if link
        else "  Sign in with the account that you made.",
        "",
        f"  Then pick a destination ({places}) and watch the walker.",
        "  What the walker hears is printed below. Ctrl-C ends the demo.",
        "",
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.flush()


def _watch(
    device: subprocess.Popen[bytes],
    console: subprocess.Popen[bytes],
    start_console: Callable[[], subprocess.Popen[bytes]],
    stop: threading.Event,
) -> int:
    started_s = time.monotonic()
    while not stop.wait(_POLL_S):
        if (code := device.poll()) is not None:
            sys.stderr.write(f"vbr: The device has ended by itself (exit code {code}); the demo ends.\n")
            return code or 1
        if (code := console.poll()) is None:
            continue
        if time.monotonic() - started_s < CONSOLE_MUST_LAST_S:
            sys.stderr.write(f"vbr: The console does not stay up (exit code {code}); the demo ends.\n")
            return code or 1
        sys.stderr.write(f"vbr: The console has ended (exit code {code}) and is started again; the walker goes on.\n")
        console, started_s = start_console(), time.monotonic()
    return 0
