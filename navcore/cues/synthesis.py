"""The sound of the tones: placed between the ears where to walk, higher and quicker where something nears."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navcore.cues.table import PRIORITY, Cue, CueKind
from navcore.cues.texts import Language, stop_text
from navcore.types import Reason

SAMPLE_RATE_HZ = 16_000
TICK_HZ, TICK_S = 440.0, 0.05
STOP_HZ, STOP_S = 330.0, 0.2
STEER_S = 0.15
BEEP_S = 0.06
COLOUR_SIGN_HZ, COLOUR_SIGN_S = 1500.0, 0.1
_STEER_HZ, _STEER_SPAN_HZ = 660.0, 220.0
_FULL_PAN_DEG = 45.0
_BEEP_LOW_HZ, _BEEP_HIGH_HZ = 600.0, 1200.0
_BEEP_SHORTEST_S, _BEEP_LONGEST_S = 0.1, 1.0
_FADE_S = 0.008
_LOUDNESS = 0.5


def stop_cue(stamp_s: float, reason: Reason, language: Language = "en") -> Cue:
    """Return the cue *Stop* with its reason; the watchdog's, too. Its tone is heard even where there is no voice."""
    return Cue(
        stamp_s, CueKind.STOP, PRIORITY[CueKind.STOP], stop_text(reason, language),
        frequency_hz=STOP_HZ, duration_s=STOP_S,
    )  # fmt: skip


def tick_cue(stamp_s: float) -> Cue:
    """Return the heart-beat of guidance: straight on, all well."""
    return Cue(stamp_s, CueKind.TICK, PRIORITY[CueKind.TICK], angle_deg=0.0, frequency_hz=TICK_HZ, duration_s=TICK_S)


def colour_sign_cue(stamp_s: float) -> Cue:
    """Return the sign that somebody sees colour pictures: higher than every tone of guidance."""
    kind = CueKind.COLOUR_SIGN
    return Cue(stamp_s, kind, PRIORITY[kind], frequency_hz=COLOUR_SIGN_HZ, duration_s=COLOUR_SIGN_S)


def steer_cue(stamp_s: float, angle_deg: float) -> Cue:
    """Return the tone that says where to walk: panned to the side, the higher the farther to the side."""
    aside = min(1.0, abs(angle_deg) / _FULL_PAN_DEG)
    pan = -math.copysign(math.sin(aside * math.pi / 2), angle_deg)
    return Cue(
        stamp_s, CueKind.STEER, PRIORITY[CueKind.STEER], angle_deg=angle_deg,
        frequency_hz=_STEER_HZ + _STEER_SPAN_HZ * aside, duration_s=STEER_S, pan=pan,
    )  # fmt: skip


def beep_cue(stamp_s: float, distance_m: float, range_m: float) -> Cue:
    """Return the beep of an obstacle: 600–1200 Hz, higher the nearer it is."""
    near = 1.0 - min(1.0, max(0.0, distance_m / range_m))
    return Cue(
        stamp_s, CueKind.OBSTACLE_BEEP, PRIORITY[CueKind.OBSTACLE_BEEP], distance_m=distance_m,
        frequency_hz=_BEEP_LOW_HZ + (_BEEP_HIGH_HZ - _BEEP_LOW_HZ) * near, duration_s=BEEP_S,
    )  # fmt: skip


def beep_interval_s(distance_m: float, range_m: float) -> float:
    """Return the time between two beeps: 0.1 s when touching, 1.0 s at the end of the range."""
    far = min(1.0, max(0.0, distance_m / range_m))
    return _BEEP_SHORTEST_S + (_BEEP_LONGEST_S - _BEEP_SHORTEST_S) * far


def tone_samples(cue: Cue, sample_rate_hz: int = SAMPLE_RATE_HZ) -> NDArray[np.int16]:
    """Return the tone of a cue as stereo samples (n, 2), int16, left first; none (0, 2) where it has no tone.

    The power of both ears together does not depend on the place; the ends fade, so that nothing clicks.
    """
    if cue.frequency_hz is None or cue.duration_s <= 0.0:
        return np.zeros((0, 2), dtype=np.int16)
    count = round(cue.duration_s * sample_rate_hz)
    time_s = np.arange(count) / sample_rate_hz
    fade_s = min(_FADE_S, cue.duration_s / 2)
    envelope = np.clip(np.minimum(time_s, cue.duration_s - time_s) / fade_s, 0.0, 1.0)
    wave = _LOUDNESS * envelope * np.sin(math.tau * cue.frequency_hz * time_s)
    angle = (min(1.0, max(-1.0, cue.pan)) + 1.0) * math.pi / 4
    stereo = wave[:, None] * np.array([math.cos(angle), math.sin(angle)])
    samples: NDArray[np.int16] = np.round(stereo * 32767.0).astype(np.int16)
    return samples
