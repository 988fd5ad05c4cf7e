"""The walker whom guidance reckons with: does what is heard, after the usual reaction time, and errs in nothing. Pure.

Words begin and end what they do; while they walk they keep to the direction of guidance, as if each tone told it
exactly and at once, so that they walk along the planned way. Real people do not: :mod:`device_agent.simulation.walker`
is a model of these. State in, state out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from navcore.angles import wrap_rad
from navcore.cues.table import Cue, CueKind
from navcore.cues.texts import Language, speech_duration_s
from navcore.follower.road_centred import BRAKING_M_S2

_ACCELERATION_M_S2 = 0.6
"""The usual speed is reached within two or three steps."""
_ON_THE_SPOT_RAD_S, _WHILE_WALKING_RAD_S = math.radians(60.0), math.radians(40.0)
_STANDS_M_S = 0.1
"""Nobody turns on the spot while still braking."""
_STOPPING = frozenset({CueKind.STOP, CueKind.ARRIVED})
_INSTRUCTIONS = frozenset({*_STOPPING, CueKind.TURN, CueKind.WALK})


@dataclass(frozen=True, slots=True)
class Intention:
    """What will be done at a time, because of what was heard."""

    act_at_s: float
    walks: bool
    """Whether to walk from then on."""
    heading_rad: float | None = None
    """World direction to turn to; None where none was named."""


@dataclass(frozen=True, slots=True)
class IdealWalker:
    """Metres, radians, seconds."""

    x_m: float
    y_m: float
    heading_rad: float
    usual_speed_m_s: float
    reaction_s: float
    time_s: float = 0.0
    speed_m_s: float = 0.0
    walks: bool = False
    goal_rad: float | None = None
    """World direction in which the present turn ends."""
    intentions: tuple[Intention, ...] = ()

    def led(self, direction_rad: float | None) -> IdealWalker:
        """Return the walker who, where they walk, turns to a direction, relative to the heading, left positive."""
        if direction_rad is None or not self.walks:
            return self
        return replace(self, goal_rad=self.heading_rad + direction_rad)

    def hear(self, cue: Cue, language: Language) -> IdealWalker:
        """Return the walker who begins to hear a cue now."""
        goal_rad = None if cue.angle_deg is None else self.heading_rad + math.radians(cue.angle_deg)
        react_s = self.time_s + self.reaction_s
        if cue.kind not in _INSTRUCTIONS:
            return self
        # A newer instruction takes the place of what was to be done.
        if cue.kind is not CueKind.TURN:
            walks = cue.kind is CueKind.WALK
            return replace(self, intentions=(Intention(react_s, walks, goal_rad if walks else None),))
        heard_s = max(react_s, self.time_s + speech_duration_s(cue.text, language))
        return replace(self, intentions=(Intention(react_s, False), Intention(heard_s, False, goal_rad)))

    def after(self, dt_s: float) -> IdealWalker:
        """Return the walker a moment later (``dt_s`` up to about 0.05 s)."""
        walker = replace(self, time_s=self.time_s + dt_s)._acting()
        may_turn = walker.walks or walker.speed_m_s < _STANDS_M_S
        left_rad = 0.0 if walker.goal_rad is None else wrap_rad(walker.goal_rad - walker.heading_rad)
        most_rad = dt_s * (_WHILE_WALKING_RAD_S if walker.walks else _ON_THE_SPOT_RAD_S) if may_turn else 0.0
        heading_rad = wrap_rad(walker.heading_rad + min(most_rad, max(-most_rad, left_rad)))
        wanted_m_s = self.usual_speed_m_s if walker.walks else 0.0
        gain_m_s = min(_ACCELERATION_M_S2 * dt_s, max(-BRAKING_M_S2 * dt_s, wanted_m_s - self.speed_m_s))
        step_m = (self.speed_m_s + gain_m_s / 2.0) * dt_s
        return replace(
            walker,
            x_m=self.x_m + step_m * math.cos(heading_rad),
            y_m=self.y_m + step_m * math.sin(heading_rad),
            heading_rad=heading_rad,
            speed_m_s=self.speed_m_s + gain_m_s,
        )

    def _acting(self) -> IdealWalker:
        walker = self
        while walker.intentions and walker.intentions[0].act_at_s <= walker.time_s:
            due = walker.intentions[0]
            walker = replace(
                walker,
                walks=due.walks,
                goal_rad=due.heading_rad,
                intentions=walker.intentions[1:],
            )
        return walker
