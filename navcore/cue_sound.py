"""A cue as sound: its tone in its place between the ears, its words in the middle."""

from __future__ import annotations

import io
import wave

import numpy as np
from numpy.typing import NDArray

from navcore.cues.synthesis import tone_samples
from navcore.cues.table import Cue
from navcore.espeak import SAMPLE_RATE_HZ, Speech

StereoSamples = NDArray[np.float32]
"""(n, 2), left first, −1…1."""


def render_cue(cue: Cue, speech: Speech) -> StereoSamples:
    """Return the sound of a cue at SAMPLE_RATE_HZ: the tone, then the words; silence (0, 2) where it has neither."""
    tone = (tone_samples(cue, SAMPLE_RATE_HZ) / 32767.0).astype(np.float32)
    words = speech.samples(cue.text)
    return np.concatenate([tone, np.repeat(words[:, None], 2, axis=1)])


def wav_bytes(samples: StereoSamples) -> bytes:
    """Return samples at SAMPLE_RATE_HZ as a stereo WAV file of 16 bits."""
    content = io.BytesIO()
    with wave.open(content, "wb") as sound:
        sound.setnchannels(2)
        sound.setsampwidth(2)
        sound.setframerate(SAMPLE_RATE_HZ)
        sound.writeframes((np.clip(samples, -1.0, 1.0) * 32767.0).astype("<i2").tobytes())
    return content.getvalue()
