"""A cue as sound: its tone in its place between the ears, its words in the middle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from device_agent.speech import SAMPLE_RATE_HZ, Speech
from navcore.cues.synthesis import tone_samples
from navcore.cues.table import Cue

StereoSamples = NDArray[np.float32]
"""(n, 2), left first, −1…1."""


def render_cue(cue: Cue, speech: Speech) -> StereoSamples:
    """Return the sound of a cue at SAMPLE_RATE_HZ: the tone, then the words; silence (0, 2) where it has neither."""
    tone = (tone_samples(cue, SAMPLE_RATE_HZ) / 32767.0).astype(np.float32)
    words = speech.samples(cue.text)
    return np.concatenate([tone, np.repeat(words[:, None], 2, axis=1)])
