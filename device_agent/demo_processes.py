"""The live demo: the console and the device as two processes, started and stopped together."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from navcore.errors import VbrError
from navcore.site import load_poi_graph, map_checksum

READY_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 10.0
_POLL_S = 0.1


def run_live_demo(
    data: Path, site: Path, port: int, seed: int, start: str, size_px: tuple[int, int], rate_hz: float
) -> int:
    """Run console and device until Ctrl-C, or until one of them ends by itself. Returns the exit code."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    ready_file, token_file = data / "ready.json", data / "glasses.token"
    ready_file.unlink(missing_ok=True)
    device_site = _device_copy(site, data / "device" / "site")
    console_command = [
        "console", "--site", str(site), "--data", str(data / "console"), "--port", str(port),
        "--ready-file", str(ready_file), "--device-token-file", str(token_file),
    ]  # fmt: skip
    with _process(console_command, quiet=True) as console:
        ready = _wait_ready(ready_file, console, stop)
        if ready is None:
            return console.wait(STOP_TIMEOUT_S) if console.poll() is not None else 0
        device_command = [
            "device", "--site", str(device_site), "--state", str(data / "device" / "state"),
            "--console", str(ready["url"]).replace("http", "ws", 1), "--token-file", str(token_file),
            "--simulated", "--seed", str(seed), "--start", start,
            "--size", f"{size_px[0]}x{size_px[1]}", "--rate-hz", f"{rate_hz:g}",
        ]  # fmt: skip
        with _process(device_command) as device:
            _greet(ready, site)
            return _watch({"console": console, "device": device}, stop)


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


def _watch(processes: dict[str, subprocess.Popen[bytes]], stop: threading.Event) -> int:
    while not stop.wait(_POLL_S):
        for name, process in processes.items():
            code = process.poll()
            if code is not None:
                sys.stderr.write(f"vbr: The {name} has ended by itself (exit code {code}); the demo ends.\n")
                return code or 1
    return 0
