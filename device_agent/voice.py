"""The device's one voice: guidance and notices become cues, in turn, on one output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from device_agent.ports import CueOutput
from device_agent.state import DeviceState, Notice
from device_agent.states import may_be_told
from navcore.cues.bus import CueBus
from navcore.cues.memory import AT_REST, CueMemory
from navcore.cues.speech import cues_for, forget, repeat_last, say, sound
from navcore.cues.table import ASIDES, Cue, CueKind
from navcore.modes import Mode
from navcore.settings import Settings
from navcore.types import Action, DecisionTrace, Guidance, Reason, SonarState


@dataclass(frozen=True, slots=True)
class VoiceMemory:
    """Everything that the voice remembers."""

    cues: CueMemory
    stops_heard: int
    """How often the watchdog had spoken when the voice last asked."""
    last_spoken: Cue | None = None


class Voice:
    """Remembers what has been said, and plays what is to be said now."""

    def __init__(self, output: CueOutput, watchdog_stops: Callable[[], int]) -> None:
        """``watchdog_stops`` counts how often the watchdog has spoken on the same output."""
        self._output = output
        self._watchdog_stops = watchdog_stops
        self._stops_heard = watchdog_stops()
        self._memory = AT_REST
        self.last_spoken: Cue | None = None
        """The last cue with words, but for what is told beside guidance."""

    @property
    def memory(self) -> VoiceMemory:
        """What has been said so far."""
        return VoiceMemory(self._memory, self._stops_heard, self.last_spoken)

    def go_on_from(self, memory: VoiceMemory) -> None:
        """Take it that this is what has been said so far."""
        self._memory, self._stops_heard, self.last_spoken = memory.cues, memory.stops_heard, memory.last_spoken

    def tell(self, state: DeviceState, guidance: Guidance, now_s: float) -> tuple[Cue, ...]:
        """Play what guidance has to be heard now, and return it."""
        if self._watchdog_stops() != self._stops_heard:
            self._stops_heard = self._watchdog_stops()
            if state.on_the_way:
                self._overruled(now_s)
        if not state.leading:
            guidance = self._resting(state, guidance)
        cues, self._memory = cues_for(guidance, self._memory, state.route, state.settings, now_s)
        return self._played(cues, now_s)

    def say(self, notice: Notice, settings: Settings, now_s: float) -> tuple[Cue, ...]:
        """Speak a sentence as soon as nothing more important is heard; return what is played now."""
        kind = notice.kind or (CueKind.ANSWER if notice.answers else CueKind.MESSAGE)
        cues, self._memory = say(notice.text, self._memory, settings, now_s, kind)
        return self._played(cues, now_s)

    def sound(self, tone: Cue, settings: Settings, now_s: float) -> tuple[Cue, ...]:
        """Play a tone that is none of guidance, unless words are heard just now; return what is played."""
        cues, self._memory = sound(tone, self._memory, settings, now_s)
        return self._played(cues, now_s)

    def repeat(self, state: DeviceState, otherwise: str, now_s: float) -> tuple[Cue, ...]:
        """Say the last sentence again, or ``otherwise`` where it is no longer true; return what is played now."""
        guidance = state.guidance
        if guidance is None or not may_be_told(state.mode, guidance.action):
            # Guidance is of the last frame; whoever has paused since is not told once more to walk.
            guidance = Guidance(now_s, Action.STOP, None, Reason.PAUSED, DecisionTrace())
        cues, self._memory = repeat_last(guidance, self._memory, state.settings, now_s, otherwise)
        return self._played(cues, now_s)

    def forget(self, kinds: frozenset[CueKind]) -> None:
        """Neither say late nor say again what was said in cues of these kinds: it is no longer true."""
        self._memory = forget(kinds, self._memory)

    def _overruled(self, now_s: float) -> None:
        """The watchdog has said *Stop* in between: whatever else holds is to be said anew."""
        self._memory = replace(
            self._memory, bus=CueBus(), told_action=Action.STOP, told_reason=Reason.SENSOR_STALE, told_s=now_s
        )

    def _resting(self, state: DeviceState, guidance: Guidance) -> Guidance:
        """Whoever is not led hears that once, and nothing of the sensors' troubles afterwards."""
        sonar_state = SonarState.ABSENT if self._memory.sonar_lost else SonarState.OK
        trace = replace(guidance.trace, sonar_state=sonar_state, uncertain_since_s=None)
        reason = Reason.ARRIVED if state.purpose is Mode.ARRIVED else Reason.NO_ROUTE
        return replace(guidance, action=Action.STOP, direction=None, reason=reason, trace=trace)

    def _played(self, cues: tuple[Cue, ...], now_s: float) -> tuple[Cue, ...]:
        # One that waited, or is said again, keeps the stamp of its origin; outputs need the time at which it is heard.
        heard = tuple(replace(cue, stamp_s=now_s) for cue in cues)
        for cue in heard:
            try:
                self._output.play(cue)
            except Exception:
                # What could not be played was not heard: it is told anew as soon as it can be.
                self._memory = replace(self._memory, told_action=None, bus=CueBus())
                raise
            if cue.text and cue.kind not in ASIDES:
                self.last_spoken = cue
        return heard
