"""Building the map of a recording in a process of its own, which gives way to everything else.

Device and console both do so; the command line of this program is what does it.
"""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable
from pathlib import Path

from navcore.command_process import CommandProcess
from navcore.errors import MappingError

_OUT_OF_MEMORY = ("MemoryError", "Cannot allocate memory", "failed to map segment")
"""How Python, the system and its loader say that there is no more."""


class MapBuilding:
    """Runs ``vbr map build``; :meth:`stop` ends it from another thread."""

    def __init__(self) -> None:
        self._process = CommandProcess()

    def build(
        self,
        walk: Path,
        site: Path,
        name: str,
        date: str,
        progress: Callable[[int], None],
        limit_s: float | None = None,
    ) -> bool:
        """Build the map of a recording into ``site``, replacing what lies there; False where it was stopped.

        ``name`` is the site's, ``date`` when it was recorded. ``progress`` is called with each percent. What is not
        built after ``limit_s`` is given up.

        Raises MappingError with what the build said where it failed, or that it took too long.
        """
        shutil.rmtree(site, ignore_errors=True)
        arguments = [
            "map", "build", str(walk), "--site", str(site), f"--name={name}", f"--date={date}", "--behind", "--json"
        ]  # fmt: skip
        ended = self._process.run(arguments, progress, limit_s)
        if ended.was_stopped:
            return False
        if ended.code != 0 and ended.was_late:
            raise MappingError(
                f"Building the map has taken more than {(limit_s or 0.0) / 3600:.3g} h and was given up:"
                " record less at a time, or run `vbr map build` on a faster machine."
            )
        if ended.code == -signal.SIGKILL or any(words in ended.complaint for words in _OUT_OF_MEMORY):
            # Nobody kills it so but the system, where memory runs out.
            raise MappingError(
                "Building the map needed more memory than there is, and was broken off: record less at a time, or run"
                " `vbr map build` on a machine with more."
            )
        if ended.code != 0:
            raise MappingError(ended.complaint or f"The building of the map ended with {ended.code}.")
        return True

    def stop(self) -> None:
        """End the build, and begin no other."""
        self._process.stop()
