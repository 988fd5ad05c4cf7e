"""Speech by espeak-ng, where it is installed; without it cues are text and tones."""

from __future__ import annotations

import io
import logging
import shutil
import subprocess
import threading
import wave
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

SAMPLE_RATE_HZ = 22_050
"""Rate of everything that the device sounds; espeak-ng's own."""
_VOICES = {"en": "en-us", "zh": "cmn"}
_WORDS_PER_MINUTE = {"en-us": 175, "cmn": 280}
"""At one rate for both, Chinese would be spoken at two and a half syllables a second: people speak four or five."""
_USUAL_WORDS_PER_MINUTE = 175
_MAX_CACHED = 200
_TIMEOUT_S = 2.0
"""A voice that hangs may not hold up the next Stop for longer."""
_log = logging.getLogger(__name__)

Samples = NDArray[np.float32]


class Speech:
    """Turns texts into sound, and remembers those that it has spoken: instructions come again and again."""

    def __init__(self, language: str = "en", most_cached: int = _MAX_CACHED) -> None:
        """``language`` is that of texts which do not show it by their script; so many texts are remembered."""
        self._most_cached = most_cached
        self._voice = _VOICES.get(language, language)
        self._program = shutil.which("espeak-ng")
        self._cache: OrderedDict[str, Samples] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def available(self) -> bool:
        """Whether there is a voice at all."""
        return self._program is not None

    def samples(self, text: str) -> Samples:
        """Return the spoken text as samples (n,) in −1…1; none where there is no voice, or it failed."""
        if not text or self._program is None:
            return np.zeros(0, np.float32)
        with self._lock:
            if text not in self._cache:
                self._cache[text] = self._spoken(self._program, text)
            self._cache.move_to_end(text)
            while len(self._cache) > self._most_cached:
                self._cache.popitem(last=False)
            return self._cache[text]

    def _voice_for(self, text: str) -> str:
        """The language may be changed while texts of both wait: Chinese shows by itself which voice it needs."""
        return _VOICES["zh"] if any("\u4e00" <= character <= "\u9fff" for character in text) else self._voice

    def _spoken(self, program: str, text: str) -> Samples:
        voice = self._voice_for(text)
        rate = _WORDS_PER_MINUTE.get(voice, _USUAL_WORDS_PER_MINUTE)
        command = [program, "-v", voice, "-s", str(rate), "--stdin", "--stdout"]
        try:
            done = subprocess.run(command, input=text.encode(), capture_output=True, timeout=_TIMEOUT_S, check=True)
            return _samples_of_wav(done.stdout)
        except (OSError, subprocess.SubprocessError, wave.Error, EOFError) as error:
            _log.warning("%r could not be spoken (%s)", text, error)
            return np.zeros(0, np.float32)


def _samples_of_wav(data: bytes) -> Samples:
    with wave.open(io.BytesIO(data)) as sound:
        rate_hz = sound.getframerate()
        # What is written to a pipe carries no true length: all that is there is read.
        raw = sound.readframes(len(data))
    samples = (np.frombuffer(raw[: len(raw) // 2 * 2], "<i2") / 32768.0).astype(np.float32)
    if rate_hz == SAMPLE_RATE_HZ:
        return samples
    positions = np.arange(0, len(samples), rate_hz / SAMPLE_RATE_HZ)
    return np.interp(positions, np.arange(len(samples)), samples).astype(np.float32)
