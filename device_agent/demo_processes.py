"""The live demo: the console and the device as two processes, started and stopped together."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO
from urllib.parse import urlsplit

from device_agent.adapters.keyboard_buttons import HELP
from navcore.errors import VbrError
from navcore.site import load_poi_graph, map_checksum

READY_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 10.0
CONSOLE_MUST_LAST_S = 10.0
"""A console that ends sooner than this after its start would only end again."""
_POLL_S = 0.1
_SHOWN_LINES = 20


def run_device_alone(data: Path, site: Path, simulation: Sequence[str]) -> int:
    """Run the device without a console until Ctrl-C, or until it ends by itself. Returns the exit code.

    ``simulation`` is what ``vbr device`` is told of the simulated building.
    """
    stop = _stopped_by_signals()
    with ExitStack() as stack:
        device = stack.enter_context(_device(_device_command(data, site, simulation)))
        sys.stdout.write("\n".join(["", *_how_to_steer(), "  Ctrl-C ends the demo.", ""]) + "\n")
        sys.stdout.flush()
        while not stop.wait(_POLL_S):
            if (code := device.poll()) is not None:
                return code
    return 0


def run_live_demo(data: Path, site: Path, port: int, simulation: Sequence[str]) -> int:
    """Run console and device until Ctrl-C, or until the device ends by itself. Returns the exit code.

    A console that ends is started again: the walker goes on meanwhile, and the device joins it again. ``simulation`` is
    what ``vbr device`` is told of the simulated building.
    """
    stop = _stopped_by_signals()
    ready_file, token_file = data / "ready.json", data / "glasses.token"
    ready_file.unlink(missing_ok=True)

    def console_command(port: int) -> list[str]:
        return [
            "console", "--site", str(site), "--data", str(data / "console"), "--port", str(port),
            "--ready-file", str(ready_file), "--device-token-file", str(token_file),
        ]  # fmt: skip

    with ExitStack() as stack:
        # Where keys are pressed in the terminal, what the console logs would stand in between.
        log = stack.enter_context((data / "console.log").open("wb")) if _has_keys() else None
        console = stack.enter_context(_process(console_command(port), quiet=True, log=log))
        ready = _wait_ready(ready_file, console, stop)
        if ready is None:
            _tell_log(log)
            return console.wait(STOP_TIMEOUT_S) if console.poll() is not None else 0
        url = str(ready["url"])
        link = ["--console", url.replace("http", "ws", 1), "--token-file", str(token_file)]
        device = stack.enter_context(_device(_device_command(data, site, [*simulation, *link])))
        _greet(ready, site)
        again = console_command(urlsplit(url).port or port)
        code = _watch(device, console, lambda: stack.enter_context(_process(again, quiet=True, log=log)), stop)
        if code:
            _tell_log(log)
        return code


def _stopped_by_signals() -> threading.Event:
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


def _device_command(data: Path, site: Path, options: Sequence[str]) -> list[str]:
    device_site = _device_copy(site, data / "device" / "site")
    return ["device", "--site", str(device_site), "--state", str(data / "device" / "state"), *options]


@contextmanager
def _device(command: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run the device; where this is a terminal, its keys are the walker's buttons, and it is put back afterwards."""
    if not _has_keys():
        with _process(command) as process:
            yield process
        return
    before = termios.tcgetattr(sys.stdin)
    try:
        with _process([*command, "--buttons", "keyboard"], stdin=None) as process:
            yield process
    finally:
        # A device that was killed could not do this.
        termios.tcsetattr(sys.stdin, termios.TCSANOW, before)


def _has_keys() -> bool:
    return sys.stdin is not None and sys.stdin.isatty()


def _how_to_steer() -> list[str]:
    if not _has_keys():
        return ["  No keys: standard input is no terminal."]
    return [HELP]


def _device_copy(site: Path, folder: Path) -> Path:
    """Give the device a site of its own, as real glasses have; it keeps what it has where that is the same map."""
    if (folder / "manifest.json").exists() and map_checksum(folder) == map_checksum(site):
        return folder
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(site, folder)
    return folder


@contextmanager
def _process(
    command: Sequence[str],
    quiet: bool = False,
    stdin: int | None = subprocess.DEVNULL,
    log: BinaryIO | None = None,
) -> Iterator[subprocess.Popen[bytes]]:
    """Run ``vbr COMMAND`` in a process of its own, and end it with the block; ``stdin`` None shares the terminal.

    ``log`` is a file that takes what it writes to stderr; None shares ours.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "device_agent", *command],
        stdin=stdin,
        stdout=subprocess.DEVNULL if quiet else None,
        stderr=log,
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


def _tell_log(log: BinaryIO | None) -> None:
    """Show the end of what a process that has failed had to say."""
    if log is None:
        return
    lines = Path(log.name).read_text(encoding="utf-8", errors="replace").splitlines()
    sys.stderr.write("".join(f"{line}\n" for line in lines[-_SHOWN_LINES:]))


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
        *([f"  {warning}"] if (warning := ready.get("warning")) else []),
        *_how_to_steer(),
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
