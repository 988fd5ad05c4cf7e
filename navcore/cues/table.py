"""Everything that the walker can hear and see, in one place: the kinds, the table of what each is, and the cue value.

The page ``docs/cues.md`` is made from :data:`CUE_TABLE` (``vbr cues --markdown``).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Literal

from navcore.modes import Mode

Verbosity = Literal["brief", "normal", "full"]
"""How much is said; each level says all that the ones before it say."""
VERBOSITIES: tuple[Verbosity, ...] = ("brief", "normal", "full")


class CuePriority(enum.IntEnum):
    """A higher cue cuts a lower one off; at the same level the newest is kept."""

    PRIVACY = 0
    POI = 1
    REASSURANCE = 2
    OFF_ROAD = 3
    TURN = 4
    OBSTACLE = 5
    STOP = 6


class CueKind(enum.Enum):
    """What a cue tells the walker to do, or tells them of."""

    STOP = "stop"
    """Stand still. ``reason`` in the text."""
    WALK = "walk"
    """Begin to move, or go on, in ``angle_deg``."""
    TURN = "turn"
    """Turn on the spot by ``angle_deg``, without a step."""
    STEER = "steer"
    """A tone, placed where to walk, while walking: ``angle_deg``."""
    TICK = "tick"
    """The heart-beat of guidance while walking straight: as long as it is heard, "walk" holds; silence is *stop*."""
    OBSTACLE_BEEP = "obstacle_beep"
    """Quickens and rises as an obstacle nears: ``distance_m``."""
    ARRIVED = "arrived"
    HAZARD_AHEAD = "hazard_ahead"
    """Stairs on the way, known from the map: ``distance_m``."""
    CAUTION_SIDE = "caution_side"
    """Something beside the way asks for caution, known from the map."""
    NARROW_PASSAGE = "narrow_passage"
    """The way is hardly wider than a person, known from the map."""
    TURN_AHEAD = "turn_ahead"
    """A corner of the way: ``distance_m``. Nothing is to be done yet, so that it carries no angle."""
    POI_AHEAD = "poi_ahead"
    REASSURANCE = "reassurance"
    DEVIATION = "deviation"
    """Where the road is, as seen by somebody who walks beside it: ``distance_m``."""
    EXPLANATION = "explanation"
    """Why the walker was stopped, in a full sentence, after the stop itself."""
    MESSAGE = "message"
    """A sentence from a person at the console, or a notice of the device (a sensor failed, a map was taken)."""
    ANSWER = "answer"
    """What the walker hears for pressing a button, or of an order from the console."""
    MAP_ADVICE = "map_advice"
    """What the sighted person who records a map shall do differently, or that recording has ended."""
    MAP_NEWS = "map_news"
    """How the recording, or the building, of a map goes on."""
    WATCHED = "watched"
    """Who has begun to watch."""
    UNWATCHED = "unwatched"
    """Who watches no more."""
    CONSENT = "consent"
    """Somebody asks to see pictures, or sees them no more."""
    COLOUR_SIGN = "colour_sign"
    """Somebody sees colour pictures: a tone, as long as it lasts."""


@dataclass(frozen=True, slots=True)
class CueEntry:
    """One line of the table."""

    priority: CuePriority
    meaning: str
    """What the walker is to do, or learns."""
    sound: str
    picture: str
    """What the see-through overlay shows meanwhile."""
    repeats: str
    """When it comes again while it holds."""
    words: tuple[str, ...] = ()
    """Keys of :data:`navcore.cues.texts.TEXTS` that it may say."""
    by_reason: Literal["", "stop", "explanation"] = ""
    """Whether it has a sentence for each reason: ``STOP_TEXTS`` or ``EXPLANATIONS``."""
    verbosity: Verbosity = "brief"
    """The least verbosity at which it is said. Whatever safety hangs on is ``brief``: it is said at every level."""


NO_WAY = (
    "unknown", "aside", "unjoined", "lost", "no_ways", "far", "blocked", "closed_between", "closed", "one_way", "apart",
)  # fmt: skip
"""Why there is no way, as :class:`navcore.errors.PlanningError` tells it."""
_SIDES = ("left", "right")
_SPOKEN = "speech, in the middle"

_ANSWERS = (
    *(f"mode_{mode.value}" for mode in Mode), "mode_no_map",
    "on_duty", "off_duty", "map_offered", "map_begun", "map_begun_console", "map_place",
    "map_marked", "map_ended", "map_ended_console",
    "destination", "destination_console", "the_console", "way_look_again",
    *(f"refused_{why}" for why in (
        "off_duty", "on_duty", "no_map", "mapping", "no_map_walk", "not_led", "led", "paused", "not_paused",
    )),
    "menu_by_distance", "menu_by_name", "menu_place", "menu_place_here", "menu_entry", "menu_set_off", "menu_privacy",
    "menu_closed",
    "menu_empty",
    "where_here", "where_near", "where_goal", "where_next", "where_unknown", "where_last", "where_no_place",
    "colour_allowed", "colour_refused", "privacy_list", "privacy_nobody", "privacy_unknown", "privacy_accesses",
    *(f"privacy_{what}_{state}" for what in ("silhouettes", "walks") for state in ("on", "off")),
    "access_none", "access_since", "access_watch", "access_watch_times", "access_past_walk", "access_past_walk_of",
    "access_incident", "access_incident_of", "access_colour", "access_export", "access_export_of",
    "access_past_walk_many", "access_incident_many", "access_export_many", "access_more", "access_when",
    "day_today", "day_yesterday",
    "at_ahead", "at_behind", "at_clock", *(f"at_{size}_{side}" for size in ("degrees", "half", "full", "sharp")
                                           for side in _SIDES),
)  # fmt: skip
"""What the device says of its state (``docs/states.md``), of places, and of where the walker is."""

CUE_TABLE: dict[CueKind, CueEntry] = {
    CueKind.STOP: CueEntry(
        CuePriority.STOP, "Stand still, and why.", "330 Hz for 0.2 s, then speech",
        "octagon with STOP, and the pictogram of the reason", "every 3 × `turn_repeat_s`, while somebody is led",
        by_reason="stop",
    ),
    CueKind.ARRIVED: CueEntry(
        CuePriority.STOP, "Stand still: this is the destination.", _SPOKEN, "ring with a tick mark", "no",
        ("arrived", "arrived_here", "arrived_unsure", "arrived_here_unsure"),
    ),
    CueKind.OBSTACLE_BEEP: CueEntry(
        CuePriority.OBSTACLE, "Something stands ahead, the nearer the quicker and higher.",
        "600 Hz (far) to 1200 Hz (touching), 0.06 s",
        "outline of what is near: thicker and brighter the nearer, hatched inside the stop distance;"
        " a drop is a toothed line",
        "every 1.0 s (far) to 0.1 s (touching)",
    ),
    CueKind.TURN: CueEntry(
        CuePriority.TURN, "Stand, and turn on the spot by the angle. The turn ends with the next instruction.",
        _SPOKEN, "dial with an arc from straight ahead to the new direction, and the angle as it is spoken",
        "when the walker stands still in a wrong direction, or the direction has become another one",
        (*(f"turn_{side}" for side in _SIDES), "turn_clock",
         *(f"turn_{size}_{side}" for size in ("slightly", "half", "full", "sharp", "round") for side in _SIDES)),
    ),
    CueKind.WALK: CueEntry(
        CuePriority.TURN, "Begin to move, or go on, in the direction.", _SPOKEN,
        "arrow on the floor, bent towards the direction", "after every stop and turn",
        ("move_straight", *(f"move_{side}" for side in _SIDES), "move_clock",
         *(f"move_{size}_{side}" for size in ("slightly", "half", "full", "sharp", "round") for side in _SIDES)),
    ),
    CueKind.STEER: CueEntry(
        CuePriority.TURN, "Go on, and bear towards the tone.",
        "660 to 880 Hz, 0.15 s; place and pitch by the angle", "the arrow on the floor bends",
        "every `steer_interval_s`",
    ),
    CueKind.TICK: CueEntry(
        CuePriority.REASSURANCE, "Go straight on. Silence is *stop*.", "440 Hz for 0.05 s, in the middle",
        "the arrow on the floor is straight", "every `tick_interval_s`",
    ),
    CueKind.HAZARD_AHEAD: CueEntry(
        CuePriority.OFF_ROAD, "Stairs on the way: walk with care.", _SPOKEN, "no other",
        "no", ("hazard_ahead", "hazard_ahead_named"),
    ),
    CueKind.CAUTION_SIDE: CueEntry(
        CuePriority.OFF_ROAD, "From here on, keep away from this side of the way: an open stairwell, doors.", _SPOKEN,
        "no other", "no", tuple(f"caution_{side}" for side in (*_SIDES, "both")),
    ),
    CueKind.NARROW_PASSAGE: CueEntry(
        CuePriority.OFF_ROAD, "From here on the way is hardly wider than a person: walk with care.", _SPOKEN,
        "no other", "no", ("narrow_passage",),
    ),
    CueKind.MESSAGE: CueEntry(
        CuePriority.OFF_ROAD,
        "A person at the console speaks, or the device tells what has changed.", _SPOKEN,
        "triangle with a mark while off the road (!) or unsure of the position (?)",
        "off the road: every 10 s; position uncertain: every 20 s",
        ("off_road", "sonar_lost", "sonar_back", "pose_uncertain", "way_closed", "way_blocked", "way_blocked_wait",
         "way_anew", *(f"no_way_{why}" for why in NO_WAY), "camera_moved", "camera_agrees", "look_ahead",
         "looks_left", "looks_right", "looks_ahead", "storage_trouble",
         "battery_low", "battery_empty", "device_hot",
         "settings_changing", "settings_back", "destination_instead"),
    ),
    CueKind.MAP_ADVICE: CueEntry(
        CuePriority.OBSTACLE, "For the sighted person who records a map: what to do differently. Never for the walker.",
        _SPOKEN, "no other", "every `map_walk.repeat_s` while it lasts",
        ("map_walk_covered", "map_walk_dark", "map_walk_lost", "map_walk_slow_down", "map_walk_look_ahead",
         "map_walk_weak", "map_no_picture", "map_disk_full", "map_disk_slow", "map_not_recorded", "map_no_feedback",
         "map_place_unsure"),
    ),
    CueKind.ANSWER: CueEntry(
        CuePriority.OFF_ROAD, "The device answers a button, or tells what was ordered.", _SPOKEN, "no other",
        "no; not said again where an instruction has cut it off", _ANSWERS,
    ),
    CueKind.MAP_NEWS: CueEntry(
        CuePriority.REASSURANCE, "How the recording or the building of a map goes on; not said while somebody is led.",
        _SPOKEN, "no other", "no",
        ("map_none", "map_picture", "map_walk_found", "map_walk_loop", "map_recorded", "map_handed_over",
         "map_sent", "map_not_sent", "map_building", "map_not_built", "map_too_short",
         "map_unfinished", "map_built", "map_places_lost", "map_built_good", "map_built_weak"),
    ),
    CueKind.TURN_AHEAD: CueEntry(
        CuePriority.REASSURANCE, "The way bends so far ahead. Nothing is to be done yet.", _SPOKEN,
        "bent arrow with the distance", "no", (*(f"turn_ahead_{side}" for side in _SIDES), "turn_ahead_exact"),
        verbosity="normal",
    ),
    CueKind.REASSURANCE: CueEntry(
        CuePriority.REASSURANCE, "All is well, and so far it is to the destination.", _SPOKEN,
        "target with the distance left", "every `reassurance_m` walked", ("reassurance",), verbosity="normal",
    ),
    CueKind.POI_AHEAD: CueEntry(
        CuePriority.POI, "A place on the way.", _SPOKEN, "no other", "no", ("poi_ahead", "poi_ahead_kind"),
        verbosity="normal",
    ),
    CueKind.DEVIATION: CueEntry(
        CuePriority.POI, "The walker is beside the middle of the road, though not off it.", _SPOKEN,
        "post on the floor at the sub-goal, with its distance", "every 10 s",
        tuple(f"deviation_{side}" for side in _SIDES), verbosity="full",
    ),
    CueKind.WATCHED: CueEntry(
        CuePriority.PRIVACY, "Somebody has begun to watch at the console.", _SPOKEN, "no other",
        "in a gap, and after 10 s again where it was cut off",
        ("watch_one", "watch_many", "watch_also_one", "watch_also_many", "names_and", "names_others"),
    ),
    CueKind.UNWATCHED: CueEntry(
        CuePriority.PRIVACY, "Somebody watches no more.", _SPOKEN, "no other",
        "in a gap, and after 10 s again where it was cut off", ("watch_left_one", "watch_left_many", "watch_nobody"),
        verbosity="normal",
    ),
    CueKind.CONSENT: CueEntry(
        CuePriority.PRIVACY,
        "Somebody at the console asks to see colour pictures, or sees them no more. No answer in 30 s is *no*.",
        _SPOKEN, "no other", "in a gap, and after 10 s again where it was cut off",
        ("colour_asked", "colour_asked_why", "colour_unanswered", "colour_ended"),
    ),
    CueKind.COLOUR_SIGN: CueEntry(
        CuePriority.PRIVACY, "Somebody at the console sees colour pictures just now.",
        "1500 Hz for 0.1 s, in the middle", "no other", "every 5 s while it lasts",
    ),
    CueKind.EXPLANATION: CueEntry(
        CuePriority.POI, "Why the walker was stopped, after the stop itself.", _SPOKEN,
        "that of the stop", "no", by_reason="explanation", verbosity="full",
    ),
}  # fmt: skip
"""What each kind of cue is."""

PRIORITY: dict[CueKind, CuePriority] = {kind: entry.priority for kind, entry in CUE_TABLE.items()}
"""The priority of each kind of cue."""

ANNOUNCEMENTS = frozenset(
    {
        CueKind.HAZARD_AHEAD, CueKind.CAUTION_SIDE, CueKind.NARROW_PASSAGE, CueKind.TURN_AHEAD, CueKind.REASSURANCE,
        CueKind.POI_AHEAD, CueKind.DEVIATION, CueKind.EXPLANATION,
    }
)  # fmt: skip
"""Sentences that begin at their time or not at all: said later, the distance in them would be wrong."""

OF_PRIVACY = frozenset({CueKind.WATCHED, CueKind.UNWATCHED, CueKind.CONSENT})
"""Sentences that never wait for the end of others: whoever has them said waits for a gap, and tries again."""
ASIDES = frozenset({CueKind.WATCHED, CueKind.UNWATCHED})
"""What is told beside guidance: it takes nobody's place as the last sentence, neither to repeat nor to be shown."""


def is_said(kind: CueKind, verbosity: Verbosity) -> bool:
    """Return whether cues of a kind are said at a verbosity."""
    return VERBOSITIES.index(CUE_TABLE[kind].verbosity) <= VERBOSITIES.index(verbosity)


@dataclass(frozen=True, slots=True)
class Cue:
    """One thing to be heard now. Speech where there is a text; a tone where there is a frequency; both where both."""

    stamp_s: float
    kind: CueKind
    priority: CuePriority
    text: str = ""
    """What is spoken, in the walker's language; empty for a tone."""
    angle_deg: float | None = None
    """Direction in degrees relative to the heading, left positive, as the text says it or the tone's place tells."""
    distance_m: float | None = None
    frequency_hz: float | None = None
    """Pitch of the tone; None for pure speech."""
    duration_s: float = 0.0
    """Length of the tone."""
    repeats: CueKind | None = None
    """Kind of the cue whose words a message says again; they are said only while that would still be true."""
    pan: float = 0.0
    """Place of the tone between the ears: −1 left, +1 right."""

    @property
    def is_tone(self) -> bool:
        """Whether this is a short sound without words."""
        return not self.text
