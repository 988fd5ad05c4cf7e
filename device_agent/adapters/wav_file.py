"""The sound of a whole walk as a stereo WAV file."""

from __future__ import annotations

import contextlib
import logging
import threading
import wave
from pathlib import Path

import numpy as np

from device_agent.adapters.waiting_cues import WaitingCues
from navcore.cue_sound import StereoSamples, render_cue
from navcore.cues.table import Cue
from navcore.errors import InputError
from navcore.espeak import SAMPLE_RATE_HZ, Speech

_log = logging.getLogger(__name__)
_MOST_WAITING = 20_000
"""Cues of some hours: a walk in lock step is over long before its sound is written."""
_TAIL_S = 10.0
"""Longest that the last cue may sound."""


class WavFileOutput:
    """Writes what the walker hears, each cue at its own time; one that begins cuts off the one before, as in the ear.

    Rendering and writing happen in a thread of its own. The file is whole after :meth:`close`.
    """

    def __init__(self, path: Path, speech: Speech, begin_s: float | None = None) -> None:
        """``begin_s`` is the time at which the file begins; the first cue's where it is None. Raises InputError."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = path.open("wb")
        except OSError as error:
            raise InputError(
                f"{path} cannot be written ({error.strerror}): name another file for the sound."
            ) from error
        self._file = wave.open(self._stream, "wb")  # noqa: SIM115 - closed in the thread
        self._file.setnchannels(2)
        self._file.setsampwidth(2)
        self._file.setframerate(SAMPLE_RATE_HZ)
        self._speech = speech
        self._begin_s = begin_s
        self._written = 0
        self._failed = False
        self._sounding: StereoSamples = np.zeros((0, 2), np.float32)
        self._cues = WaitingCues(_MOST_WAITING)
        self._thread = threading.Thread(target=self._run, name="wav", daemon=True)
        self._thread.start()

    def play(self, cue: Cue) -> None:
        """Hand the cue over."""
        if not self._failed:
            self._cues.put(cue)

    def close(self) -> None:
        """Write the rest and finish the file."""
        if self._thread.is_alive():
            self._cues.close()
            self._thread.join()

    def _run(self) -> None:
        try:
            self._write_all()
        except OSError as error:
            self._failed = True
            _log.warning("the sound is no longer written (%s): free the disk", error)

    def _write_all(self) -> None:
        with self._stream, contextlib.closing(self._file):
            while (cue := self._cues.next()) is not None:
                self._begin_s = cue.stamp_s if self._begin_s is None else self._begin_s
                self._write_until(round((cue.stamp_s - self._begin_s) * SAMPLE_RATE_HZ))
                self._sounding = render_cue(cue, self._speech)
            self._write_until(self._written + min(len(self._sounding), round(_TAIL_S * SAMPLE_RATE_HZ)))

    def _write_until(self, sample: int) -> None:
        """Write what sounds, then silence, up to a sample of the file."""
        while self._written < sample:
            # Piece by piece, so that an hour of silence needs no memory.
            count = min(sample - self._written, SAMPLE_RATE_HZ)
            heard, self._sounding = self._sounding[:count], self._sounding[count:]
            levels = np.zeros((count, 2), np.float32)
            levels[: len(heard)] = np.clip(heard, -1.0, 1.0) * 32767.0
            self._file.writeframesraw(levels.astype("<i2").tobytes())
            self._written += count
