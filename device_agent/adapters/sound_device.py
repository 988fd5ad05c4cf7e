"""The machine's loudspeaker or earphone, through the optional package sounddevice (extra ``audio``)."""

from __future__ import annotations

import contextlib
import importlib
import logging
import threading
from typing import Any

from device_agent.adapters.waiting_cues import WaitingCues
from navcore.cue_sound import render_cue
from navcore.cues.table import Cue
from navcore.errors import MissingPackageError, SensorError
from navcore.espeak import SAMPLE_RATE_HZ, Speech

_log = logging.getLogger(__name__)
_LAST_CUE_S = 10.0


class SoundDeviceOutput:
    """Plays cues; the newest cuts off the one that sounds. Rendering happens in a thread of its own."""

    def __init__(self, speech: Speech) -> None:
        """Raises MissingPackageError without the package, SensorError without a sound device."""
        try:
            self._sounddevice: Any = importlib.import_module("sounddevice")
            self._sounddevice.check_output_settings(channels=2, samplerate=SAMPLE_RATE_HZ)
        except ModuleNotFoundError as error:
            raise MissingPackageError(
                "Sound needs the package 'sounddevice': run `pip install 'virtual-blind-road[audio]'`."
            ) from error
        except OSError as error:
            raise SensorError(
                f"The system's PortAudio cannot be loaded ({error}): run `apt-get install libportaudio2`, or use --wav."
            ) from error
        except Exception as error:
            # The package raises errors of its own.
            raise SensorError(f"There is no sound device to play on ({error}): plug one in, or use --wav.") from error
        self._speech = speech
        self._cues = WaitingCues()
        self._thread = threading.Thread(target=self._run, name="sound", daemon=True)
        self._thread.start()

    def play(self, cue: Cue) -> None:
        """Hand the cue over."""
        self._cues.put(cue)

    def close(self) -> None:
        """Fall silent once the last cue has been heard out; an output that hangs is not waited for."""
        if self._thread.is_alive():
            self._cues.close()
            self._thread.join(_LAST_CUE_S)

    def _run(self) -> None:
        # What would be cut off at once is not rendered first.
        while (cue := self._cues.newest()) is not None:
            try:
                self._sounddevice.play(render_cue(cue, self._speech), SAMPLE_RATE_HZ)
            except Exception:
                # An unplugged earphone must not end the thread: the next cue may find it plugged in again.
                _log.exception("a cue could not be played")
        with contextlib.suppress(Exception):
            self._sounddevice.wait()
