"""Cue outputs without a loudspeaker: text, and several outputs at once."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TextIO

from device_agent.plain_text import plain
from device_agent.ports import CueOutput
from navcore.cues.table import Cue, CueKind

_FIRST_LIVE_STAMP_S = 1e9
_TONES = (CueKind.STEER, CueKind.TICK, CueKind.OBSTACLE_BEEP, CueKind.COLOUR_SIGN)


def cue_line(cue: Cue) -> str:
    """Return a cue as a line of text: time, kind, what is spoken, and the figures behind a tone."""
    figures = [] if cue.angle_deg is None else [f"{cue.angle_deg:+.0f}°"]
    figures += [] if cue.distance_m is None else [f"{cue.distance_m:.1f} m"]
    return " ".join([f"{_time_text(cue.stamp_s)}  {cue.kind.value:13}", *filter(None, [plain(cue.text), *figures])])


def _time_text(stamp_s: float) -> str:
    """Time of day of a live stamp, seconds of a simulated one."""
    if stamp_s < _FIRST_LIVE_STAMP_S:
        return f"{stamp_s:8.2f}"
    return datetime.fromtimestamp(stamp_s, UTC).astimezone().strftime("%H:%M:%S")


class TextOutput:
    """Writes each cue as a line; heart-beats and tones only where ``tones`` asks for them."""

    def __init__(self, stream: TextIO | None = None, *, tones: bool = False) -> None:
        self._stream: TextIO | None = stream or sys.stdout
        self._tones = tones

    def play(self, cue: Cue) -> None:
        """Write the cue."""
        if self._stream is None or (cue.kind in _TONES and not self._tones):
            return
        try:
            self._stream.write(cue_line(cue) + "\n")
            self._stream.flush()
        except (OSError, ValueError):
            # Whoever read along has left; the walker hears the other outputs and walks on.
            self._stream = None

    def close(self) -> None:
        """Write nothing from now on; the stream stays open."""
        self._stream = None


class TeeOutput:
    """Plays every cue on several outputs, the first one first."""

    def __init__(self, outputs: Sequence[CueOutput]) -> None:
        self._outputs = tuple(outputs)

    def play(self, cue: Cue) -> None:
        """Hand the cue to each output; one that fails does not silence the others."""
        failures: list[Exception] = []
        for output in self._outputs:
            try:
                output.play(cue)
            except Exception as error:
                failures.append(error)
        if failures:
            raise failures[0]

    def close(self) -> None:
        """Close each output."""
        for output in self._outputs:
            output.close()
