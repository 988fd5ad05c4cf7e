"""Progress bars on stderr, so that the answer on stdout stays clean."""

from __future__ import annotations

import json
import os
import select
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar while the body runs; it calls what it is given with the number done and the total."""
    with _bar() as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


@contextmanager
def stage_bar() -> Iterator[Callable[[float, str], None]]:
    """Show a bar while the body runs; it calls what it is given with the share done and what is being done."""
    with _bar() as progress:
        task = progress.add_task("Starting", total=1.0)
        yield lambda share, text: progress.update(task, completed=share, description=text)


@contextmanager
def stage_lines() -> Iterator[Callable[[float, str], None]]:
    """Print each new percent as a line of JSON on stdout while the body runs: for another program.

    Nobody reads them any more where that program has ended; printing them raises BrokenPipeError then, which ends this.
    """
    last = -1

    def progress(share: float, text: str) -> None:
        nonlocal last
        if (percent := int(100 * share)) > last:
            last = percent
            sys.stdout.write(json.dumps({"percent": percent, "stage": text}) + "\n")
            sys.stdout.flush()

    yield progress


def end_with_reader() -> None:
    """End this process as soon as the program that reads its stdout has ended, however long there is nothing to print.

    Whoever starts that program anew would find an hour's work of nobody in the way of its own.
    """
    poller = select.poll()
    try:
        poller.register(sys.stdout.fileno(), 0)
    except (OSError, ValueError):
        # It prints into memory: whoever reads that is this process itself.
        return

    def watch() -> None:
        if any(event & select.POLLERR for _, event in poller.poll()):
            os._exit(1)

    threading.Thread(target=watch, name="reader", daemon=True).start()


def _bar() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True))
