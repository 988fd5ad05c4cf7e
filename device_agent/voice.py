"""The device's one voice: guidance and notices become cues, in turn, on one output."""

from __future__ import annotations

from dataclasses import replace

from device_agent.ports import CueOutput
from device_agent.state import DeviceState
from navcore.cues.bus import CueBus
from navcore.cues.speech import CueMemory, cues_for, repeat_last, say
from navcore.cues.table import Cue
from navcore.settings import Settings
from navcore.types import Guidance


class Voice:
    """Remembers what has been said, and plays what is to be said now."""

    def __init__(self, output: CueOutput) -> None:
        self._output = output
        self._memory = CueMemory()
        self.last_spoken: Cue | None = None
        """The last cue with words."""

    def tell(self, state: DeviceState, guidance: Guidance, now_s: float) -> tuple[Cue, ...]:
        """Play what guidance has to be heard now, and return it."""
        cues, self._memory = cues_for(guidance, self._memory, state.route, state.settings, now_s)
        return self._played(cues)

    def say(self, text: str, settings: Settings, now_s: float) -> tuple[Cue, ...]:
        """Speak a message as soon as nothing more important is heard; return what is played now."""
        cues, self._memory = say(text, self._memory, settings, now_s)
        return self._played(cues)

    def repeat(self, settings: Settings, now_s: float) -> tuple[Cue, ...]:
        """Say the last sentence again."""
        cues, self._memory = repeat_last(self._memory, settings, now_s)
        return self._played(cues)

    def forget(self) -> None:
        """The watchdog has spoken in between: whatever holds is to be said anew."""
        bus = CueBus(repeatable=self._memory.bus.repeatable)
        self._memory = replace(self._memory, bus=bus, told_action=None, told_reason=None)

    def _played(self, cues: tuple[Cue, ...]) -> tuple[Cue, ...]:
        for cue in cues:
            self._output.play(cue)
            if cue.text:
                self.last_spoken = cue
        return cues
