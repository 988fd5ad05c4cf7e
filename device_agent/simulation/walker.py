"""A model of somebody who walks by what they hear, and by nothing else.

It is a model, and said to be one: its parameters have their sources beside them. It acts on :class:`Cue` alone; the
building enters only where the body touches it, and where somebody with low vision sees it two steps ahead. State in,
state out; whoever holds the state holds the time.

======================  ==============================================================================
what is heard           what the walker does after the reaction delay
======================  ==============================================================================
STOP, ARRIVED           brakes and stands
TURN                    stands, hears the sentence out, turns on the spot by the angle, and stays standing
WALK                    turns by the angle (if any) while beginning to walk, or going on
STEER                   adds the angle to the direction while walking; goes on after a silence
TICK                    goes on after a silence
OBSTACLE_BEEP, others   nothing; but it is a sound, and so no silence
(silence while walking) after ``silence_s`` without any sound: stands until TICK, STEER or WALK
======================  ==============================================================================
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import numpy as np

from device_agent.simulation.building import SolidArrays, checked_seed, push_from_solids
from navcore.angles import wrap_rad
from navcore.cues.table import Cue, CueKind


@dataclass(frozen=True, slots=True)
class WalkerParameters:
    """One person. :func:`drawn_walker` draws one from the ranges."""

    speed_mps: float = 0.85
    """Preferred speed. Blind pedestrians: 0.6–1.1 m/s, slower than sighted ones and depending on the aid
    (D. Clark-Carter, A. Heyes, C. Howarth, "The efficiency and walking speed of visually impaired people", Ergonomics
    29, 1986)."""
    acceleration_mps2: float = 0.6
    """Gait initiation: the usual speed is reached within two or three steps."""
    braking_mps2: float = 1.2
    """Stopping takes one or two steps (K. Hase, R. Stein, "Analysis of rapid stopping during human walking",
    J. Neurophysiology 80, 1998)."""
    reaction_min_s: float = 0.3
    reaction_max_s: float = 0.9
    """From the beginning of a sound to the beginning of the movement: simple reactions to sound take 0.15–0.3 s,
    choosing among instructions and waiting for the next footfall takes the rest."""
    turn_rate_deg_s: float = 60.0
    """Turning on the spot."""
    steer_rate_deg_s: float = 40.0
    """Turning while walking."""
    turn_gain: float = 1.0
    """This person's own gain of turning by an instructed angle."""
    turn_gain_sigma: float = 0.04
    """Error of each turn, relative. Turns without vision err by several degrees (J. Loomis et al., "Nonvisual
    navigation by blind and sighted: assessment of path integration ability", J. Exp. Psychology: General 122, 1993)."""
    tone_sigma_deg: float = 3.0
    """Error of hearing a tone's direction: a few degrees ahead of the listener (J. Blauert, "Spatial Hearing")."""
    veer_deg_per_sqrt_m: float = 1.3
    """Random walk of the heading, here about 1° a step (C. Kallie, P. Schrater, G. Legge, "Variability in stepping
    direction explains the veering behavior of blind walkers", J. Exp. Psychology: HPP 33, 2007: the variable error of
    single steps dominates)."""
    veer_bias_deg_per_m: float = 0.0
    """Constant bend to one side (same source: consistent biases in step direction)."""
    silence_s: float = 1.5
    """Silence is never "go": the walker is taught to stop after so long without a sound."""
    speech_chars_per_s: float = 15.0
    """Speed of the device's speech, in letters; while it talks, it is not silent."""
    body_radius_m: float = 0.25
    sight_range_m: float = 0.0
    """How far the walker sees what is in the way, and goes round it; 0 for somebody who is totally blind. Low vision
    leaves large, near things to be seen (K. Turano et al., "Mobility performance in glaucoma", Invest. Ophthalmol. Vis.
    Sci. 40, 1999)."""


def drawn_walker(seed: int) -> WalkerParameters:
    """Return a totally blind person drawn from the ranges of the literature."""
    rng = np.random.default_rng([checked_seed(seed), 6])
    return WalkerParameters(
        speed_mps=float(rng.uniform(0.6, 1.1)),
        turn_gain=float(np.clip(rng.normal(1.0, 0.04), 0.9, 1.1)),
        veer_bias_deg_per_m=float(np.clip(rng.normal(0.0, 0.5), -1.0, 1.0)),
    )


def drawn_partially_sighted_walker(seed: int) -> WalkerParameters:
    """Return the same person, but one who still sees what is large and near.

    Veering comes from walking without seeing (C. Kallie et al., 2007; J. Souman et al., "Walking straight into
    circles", Current Biology 19, 2009): whoever sees the edges of the floor at their feet corrects it all the time.
    """
    return replace(
        drawn_walker(seed), veer_deg_per_sqrt_m=0.4, veer_bias_deg_per_m=0.0, sight_range_m=SHORT_SIGHT_M
    )  # fmt: skip


SHORT_SIGHT_M = 1.5
"""Two steps ahead."""
_SEEN_MARGIN_M = 0.1
"""Whoever sees something keeps so far away from it."""
_SEEN_TURNS_RAD = tuple(math.radians(side * degrees) for degrees in (15.0, 30.0, 45.0, 60.0) for side in (1.0, -1.0))
_STOPS_BEFORE_M = 0.3


class Motion(enum.Enum):
    """What the feet do."""

    STANDING = "standing"
    TURNING = "turning"
    """On the spot."""
    WALKING = "walking"
    HUSHED = "hushed"
    """Standing because the device fell silent: a heart-beat is enough to go on."""


@dataclass(frozen=True, slots=True)
class Intention:
    """Something heard that will be acted on at ``act_at_s``."""

    act_at_s: float
    kind: CueKind
    goal_rad: float | None
    """Sum of intended turns at which it is fulfilled; None where the cue named no angle."""
    begins_turn: bool = False
    """The second part of TURN: the sentence has been heard out."""


@dataclass(frozen=True, slots=True)
class WalkerBody:
    """State of the walker. Metres, radians, seconds."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float = 0.0
    yaw_rate_rad_s: float = 0.0
    motion: Motion = Motion.STANDING
    intended_rad: float = 0.0
    """Sum of all turns made on purpose. Veering goes unnoticed, so it is not in it."""
    goal_rad: float | None = None
    """Value of ``intended_rad`` at which the present turn ends."""
    heard_until_s: float = -math.inf
    """End of the last sound."""
    intentions: tuple[Intention, ...] = ()
    contacts: int = 0
    """Episodes of touching something."""
    is_touching: bool = False


_RESUMING = (CueKind.TICK, CueKind.STEER, CueKind.WALK)
_STOPPING = (CueKind.STOP, CueKind.ARRIVED)
_LETTERS_OF_A_SYLLABLE = 3.5
_RELEASE_M = 0.05
"""A contact ends when the body is this far from what it touched: sliding along a wall is one episode."""


def hear(body: WalkerBody, cue: Cue, walker: WalkerParameters, rng: np.random.Generator) -> WalkerBody:
    """Return the walker who has begun to hear a cue now."""
    now_s = body.time_s
    spoken_s = _letters(cue.text) / walker.speech_chars_per_s
    heard_until_s = max(body.heard_until_s, now_s + max(cue.duration_s, spoken_s))
    delay_s = float(rng.uniform(walker.reaction_min_s, walker.reaction_max_s))
    gain_error, tone_error = (float(value) for value in rng.standard_normal(2))
    body = replace(body, heard_until_s=heard_until_s)
    if cue.kind not in (*_RESUMING, *_STOPPING, CueKind.TURN):
        return body
    goal_rad = None
    if cue.angle_deg is not None:
        angle_deg = cue.angle_deg * walker.turn_gain * (1.0 + walker.turn_gain_sigma * gain_error)
        if cue.frequency_hz is not None and not cue.text:
            angle_deg += walker.tone_sigma_deg * tone_error
        goal_rad = body.intended_rad + math.radians(angle_deg)
    # Nobody acts on an older instruction after a newer one.
    latest_s = max([now_s + delay_s, *(intention.act_at_s for intention in body.intentions)])
    heard = [Intention(latest_s, cue.kind, goal_rad)]
    if cue.kind is CueKind.TURN:
        heard.append(Intention(max(latest_s, now_s + spoken_s), cue.kind, goal_rad, begins_turn=True))
    if cue.kind in _STOPPING:
        # "Stop" does not wait for its turn, and forgets what else was to be done. Who is about to stand anyhow is not
        # kept from it by hearing so again.
        stands = [each.act_at_s for each in body.intentions if each.kind in (*_STOPPING, CueKind.TURN)]
        return replace(body, intentions=(Intention(min([now_s + delay_s, *stands]), cue.kind, None),))
    return replace(body, intentions=(*body.intentions, *heard))


def _letters(text: str) -> float:
    """Return the length of a text in letters of the Latin script; one of the Chinese script is a syllable."""
    return sum(_LETTERS_OF_A_SYLLABLE if "\u4e00" <= character <= "\u9fff" else 1.0 for character in text)


def step(
    body: WalkerBody,
    walker: WalkerParameters,
    solids: SolidArrays,
    moving: SolidArrays,
    dt_s: float,
    rng: np.random.Generator,
) -> WalkerBody:
    """Return the walker a moment later (``dt_s`` up to about 0.05 s)."""
    body = replace(body, time_s=body.time_s + dt_s)
    body = _fall_silent(_act(body), walker)
    body = _turned(body, walker, dt_s, rng)
    seen_turn_rad, is_free = _seen(body, walker, (solids, moving))
    most_rad = math.radians(walker.steer_rate_deg_s) * dt_s
    aside_rad = min(most_rad, max(-most_rad, seen_turn_rad))
    body = replace(body, heading_rad=wrap_rad(body.heading_rad + aside_rad))
    body = _moved(body, walker, dt_s, is_free=is_free)
    return _touched(body, walker, solids, moving)


def _act(body: WalkerBody) -> WalkerBody:
    """Carry out the intentions whose time has come."""
    due = [intention for intention in body.intentions if intention.act_at_s <= body.time_s]
    for intention in due:
        body = _carried_out(body, intention)
    return replace(body, intentions=body.intentions[len(due) :]) if due else body


def _carried_out(body: WalkerBody, intention: Intention) -> WalkerBody:
    kind, goal_rad = intention.kind, intention.goal_rad
    if kind in _STOPPING:
        return replace(body, motion=Motion.STANDING, goal_rad=None)
    if kind is CueKind.TURN:
        if intention.begins_turn:
            return replace(body, motion=Motion.TURNING, goal_rad=goal_rad)
        return replace(body, motion=Motion.STANDING, goal_rad=None)
    if kind is CueKind.WALK:
        return replace(body, motion=Motion.WALKING, goal_rad=goal_rad)
    resumed = replace(body, motion=Motion.WALKING) if body.motion is Motion.HUSHED else body
    if kind is CueKind.STEER and resumed.motion is Motion.WALKING:
        return replace(resumed, goal_rad=goal_rad)
    return resumed


def _fall_silent(body: WalkerBody, walker: WalkerParameters) -> WalkerBody:
    if body.motion is Motion.WALKING and body.time_s - body.heard_until_s > walker.silence_s:
        return replace(body, motion=Motion.HUSHED, goal_rad=None)
    return body


def _turned(body: WalkerBody, walker: WalkerParameters, dt_s: float, rng: np.random.Generator) -> WalkerBody:
    """Turn on purpose, and veer."""
    rate_deg_s = walker.turn_rate_deg_s if body.motion is Motion.TURNING else walker.steer_rate_deg_s
    wanted_rad = 0.0 if body.goal_rad is None else body.goal_rad - body.intended_rad
    most_rad = math.radians(rate_deg_s) * dt_s
    # Nobody turns on the spot while still braking.
    may_turn = body.motion is Motion.WALKING or (body.motion is Motion.TURNING and body.speed_mps < 0.1)
    turn_rad = min(most_rad, max(-most_rad, wanted_rad)) if may_turn else 0.0
    is_done = body.goal_rad is None or (may_turn and abs(wanted_rad) <= most_rad)
    step_m = body.speed_mps * dt_s
    noise = float(rng.standard_normal())
    veer_rad = math.radians(
        walker.veer_deg_per_sqrt_m * math.sqrt(step_m) * noise + walker.veer_bias_deg_per_m * step_m
    )
    ended = body.motion is Motion.TURNING and is_done
    return replace(
        body,
        heading_rad=wrap_rad(body.heading_rad + turn_rad + veer_rad),
        yaw_rate_rad_s=(turn_rad + veer_rad) / dt_s,
        intended_rad=body.intended_rad + turn_rad,
        goal_rad=None if is_done else body.goal_rad,
        motion=Motion.STANDING if ended else body.motion,
    )


def _seen(body: WalkerBody, walker: WalkerParameters, groups: tuple[SolidArrays, ...]) -> tuple[float, bool]:
    """Return by how much somebody who sees turns aside for what they see, rad, and whether a step is free at all."""
    if walker.sight_range_m <= 0.0 or body.motion is not Motion.WALKING:
        return 0.0, True
    free_m = _seen_free_m(body, walker, groups, 0.0)
    if free_m >= walker.sight_range_m:
        return 0.0, True
    best = max(_SEEN_TURNS_RAD, key=lambda turn: (round(_seen_free_m(body, walker, groups, turn), 1), -abs(turn)))
    gains = _seen_free_m(body, walker, groups, best) > free_m
    return (best if gains else 0.0), free_m > _STOPS_BEFORE_M


def _seen_free_m(body: WalkerBody, walker: WalkerParameters, groups: tuple[SolidArrays, ...], turn_rad: float) -> float:
    """Return how far the body could go straight on in a direction without coming near anything, up to its sight."""
    c, s = math.cos(body.heading_rad + turn_rad), math.sin(body.heading_rad + turn_rad)
    needed_m = walker.body_radius_m + _SEEN_MARGIN_M
    for ahead_m in np.arange(0.3, walker.sight_range_m + 1e-9, 0.3):
        x_m, y_m = body.x_m + ahead_m * c, body.y_m + ahead_m * s
        if any(push_from_solids(group, x_m, y_m)[0] < needed_m for group in groups):
            return float(ahead_m) - 0.3
    return walker.sight_range_m


def _moved(body: WalkerBody, walker: WalkerParameters, dt_s: float, *, is_free: bool) -> WalkerBody:
    target_mps = walker.speed_mps if body.motion is Motion.WALKING and is_free else 0.0
    change = target_mps - body.speed_mps
    change = min(walker.acceleration_mps2 * dt_s, max(-walker.braking_mps2 * dt_s, change))
    speed_mps = body.speed_mps + change
    step_m = 0.5 * (body.speed_mps + speed_mps) * dt_s
    return replace(
        body,
        x_m=body.x_m + step_m * math.cos(body.heading_rad),
        y_m=body.y_m + step_m * math.sin(body.heading_rad),
        speed_mps=speed_mps,
    )


def _touched(body: WalkerBody, walker: WalkerParameters, solids: SolidArrays, moving: SolidArrays) -> WalkerBody:
    """Keep the body out of solids: it slides along what it touches, and each episode of touching counts once."""
    x_m, y_m, nearest_m = body.x_m, body.y_m, math.inf
    for _ in range(3):
        closest_m = math.inf
        for group in (solids, moving):
            distance_m, away = push_from_solids(group, x_m, y_m)
            closest_m = min(closest_m, distance_m)
            if distance_m < walker.body_radius_m:
                x_m += float(away[0]) * (walker.body_radius_m - distance_m)
                y_m += float(away[1]) * (walker.body_radius_m - distance_m)
        nearest_m = min(nearest_m, closest_m)
        if closest_m >= walker.body_radius_m:
            break
    touches = nearest_m < walker.body_radius_m - 1e-6
    return replace(
        body,
        x_m=x_m,
        y_m=y_m,
        contacts=body.contacts + int(touches and not body.is_touching),
        is_touching=touches or (body.is_touching and nearest_m < walker.body_radius_m + _RELEASE_M),
    )
