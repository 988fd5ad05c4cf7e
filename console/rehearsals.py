"""Rehearsals for whoever edits the map, and the sound of what is heard in them; both bounded."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from console.errors import ConflictError, NotFoundError, TooManyError
from navcore.cue_sound import render_cue, wav_bytes
from navcore.cues.table import Cue
from navcore.cues.texts import Language
from navcore.espeak import SAMPLE_RATE_HZ, Speech
from navcore.planning.poi_graph import PoiGraph
from navcore.rehearsal.rehearsing import CancelledError, Rehearsal, rehearse
from navcore.settings import Settings

LONGEST_M = 1000.0
"""A longer way is rehearsed in parts."""
_LONGEST_S = 30.0
"""Longest that one rehearsal may take."""
_LONGEST_WAIT_S = 5.0
"""Longest that another waits for it: it holds a thread that other requests need."""
_MAX_WAITING = 2
"""So many wait; whoever comes then is told at once."""
_MAX_KNOWN = 5000
"""Sounds of so many different cues can be asked for; of older ones after the next rehearsal."""
_MAX_CACHED_BYTES = 16 << 20
_SPOKEN_COUNT = 8
"""Texts that the voice itself remembers: what was made of them is kept here."""
_LONGEST_SOUND_S = 30.0


class Rehearsals:
    """Rehearses one way at a time, so that the rest of the console goes on. Thread-safe."""

    def __init__(self, now_s: Callable[[], float], longest_s: float = _LONGEST_S) -> None:
        """``now_s`` is a steady clock."""
        self._now_s = now_s
        self._longest_s = longest_s
        self._turn = threading.Lock()
        self._present = threading.BoundedSemaphore(1 + _MAX_WAITING)

    def rehearse(self, graph: PoiGraph, start_id: str, destination_id: str, settings: Settings) -> Rehearsal:
        """Return what is heard on the way. Raises ConsoleError, or InputError where the way is too long."""
        for poi_id in (start_id, destination_id):
            if poi_id not in graph.pois:
                raise NotFoundError(f"There is no place {poi_id!r}: it may have been deleted meanwhile.")
        if not self._present.acquire(blocking=False):
            raise _too_many()
        try:
            return self._rehearse_in_turn(graph, start_id, destination_id, settings)
        finally:
            self._present.release()

    def _rehearse_in_turn(self, graph: PoiGraph, start_id: str, destination_id: str, settings: Settings) -> Rehearsal:
        if not self._turn.acquire(timeout=min(self._longest_s, _LONGEST_WAIT_S)):
            raise _too_many()
        try:
            until_s = self._now_s() + self._longest_s
            return rehearse(
                graph,
                start_id,
                destination_id,
                settings,
                longest_m=LONGEST_M,
                cancelled=lambda: self._now_s() > until_s,
            )
        except CancelledError as error:
            raise ConflictError("This rehearsal takes too long: rehearse the way in parts.") from error
        finally:
            self._turn.release()


def _too_many() -> TooManyError:
    return TooManyError("Other ways are being rehearsed: try again in a moment.", 5.0)


@dataclass(frozen=True, slots=True)
class _Sounding:
    """All that a sound depends on."""

    language: Language
    cue: Cue


class Sounds:
    """The sound of cues, by a key that is made of their content. Nothing else can be asked for. Thread-safe."""

    def __init__(self) -> None:
        self._voices: dict[Language, Speech] = {"en": Speech("en", _SPOKEN_COUNT), "zh": Speech("zh", _SPOKEN_COUNT)}
        self._lock = threading.Lock()
        self._known: OrderedDict[str, _Sounding] = OrderedDict()
        self._made: OrderedDict[str, bytes] = OrderedDict()
        self._made_bytes = 0

    @property
    def has_voice(self) -> bool:
        """Whether words can be spoken here; otherwise only tones can be heard."""
        return self._voices["en"].available

    def key_of(self, cue: Cue, language: Language) -> str | None:
        """Return the key under which a cue can be heard from now on; None where it has words and there is no voice."""
        if cue.text and not self.has_voice:
            return None
        heard = (language, cue.text, cue.frequency_hz, cue.duration_s, cue.pan)
        key = hashlib.sha256(msgspec.json.encode(heard)).hexdigest()[:32]
        with self._lock:
            self._known[key] = _Sounding(language, cue)
            self._known.move_to_end(key)
            while len(self._known) > _MAX_KNOWN:
                self._known.popitem(last=False)
        return key

    def wav(self, key: str) -> bytes:
        """Return the sound as a WAV file. Raises NotFoundError."""
        with self._lock:
            sounding, made = self._known.get(key), self._made.get(key)
        if sounding is None:
            raise NotFoundError("This sound is not known any more: rehearse the way again.")
        if made is None:
            made = self._rendered(sounding)
            self._keep(key, made)
        return made

    def _rendered(self, sounding: _Sounding) -> bytes:
        speech = self._voices[sounding.language]
        if sounding.cue.text and not len(speech.samples(sounding.cue.text)):
            raise NotFoundError("These words could not be spoken here: let the browser speak them.")
        samples = render_cue(sounding.cue, speech)
        return wav_bytes(samples[: round(_LONGEST_SOUND_S * SAMPLE_RATE_HZ)])

    def _keep(self, key: str, made: bytes) -> None:
        with self._lock:
            if key not in self._made:
                self._made[key] = made
                self._made_bytes += len(made)
            while self._made_bytes > _MAX_CACHED_BYTES:
                _, oldest = self._made.popitem(last=False)
                self._made_bytes -= len(oldest)
