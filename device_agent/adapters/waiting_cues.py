"""Cues on their way to an output that may be slow, or hang: whoever speaks never waits, and nothing grows."""

from __future__ import annotations

import logging
import threading
from collections import deque

from device_agent.ports import CueOutput
from navcore.cues.table import Cue

MAX_WAITING_CUES = 64
"""Half a minute of them, at the least. Where more wait, the oldest goes: what holds now is the newest."""
CLOSED_WITHIN_S = 2.0
_log = logging.getLogger(__name__)


class WaitingCues:
    """Filled by any thread, emptied by one."""

    def __init__(self, most: int = MAX_WAITING_CUES) -> None:
        """``most`` is how many may wait."""
        self._waiting: deque[Cue] = deque(maxlen=most)
        self._changed = threading.Condition()
        self._closed = False
        self.dropped_count = 0
        """Cues that had to go before they were taken."""

    def put(self, cue: Cue) -> None:
        """Add a cue; after closing nothing is taken any more."""
        with self._changed:
            if self._closed:
                return
            self.dropped_count += len(self._waiting) == self._waiting.maxlen
            self._waiting.append(cue)
            self._changed.notify_all()

    def next(self) -> Cue | None:
        """Wait for the oldest cue and take it; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed)
            return self._waiting.popleft() if self._waiting else None

    def newest(self) -> Cue | None:
        """Wait for a cue and take the newest, leaving out all before it; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed)
            cue = self._waiting[-1] if self._waiting else None
            self._waiting.clear()
            return cue

    def close(self) -> None:
        """End: what waits can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class ThreadedOutput:
    """Plays cues on another output, in a thread of its own: a pipe that nobody reads holds up nobody else."""

    def __init__(self, output: CueOutput) -> None:
        self._output = output
        self.waiting = WaitingCues()
        """What has not been played yet."""
        self._thread = threading.Thread(target=self._run, name="output", daemon=True)
        self._thread.start()

    def play(self, cue: Cue) -> None:
        """Hand the cue over."""
        self.waiting.put(cue)

    def close(self) -> None:
        """Play what waits; an output that hangs is not waited for."""
        self.waiting.close()
        self._thread.join(CLOSED_WITHIN_S)

    def _run(self) -> None:
        while (cue := self.waiting.next()) is not None:
            try:
                self._output.play(cue)
            except Exception:
                _log.exception("a cue could not be played")
        self._output.close()
