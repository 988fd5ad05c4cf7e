"""The page of the docs on cues, made from the table, the texts and the directions."""

from __future__ import annotations

from navcore.cues.announcements import (
    BEGINS_M,
    BEGINS_SHARE,
    LEAST_SHARE,
    MOST_SHARE,
    NARROW_MARGIN_M,
    PLACE_TOLERANCE_M,
    USUAL_SPEED_M_S,
)
from navcore.cues.directions import CLOCK_DEG, DEGREES_STEP_DEG, SIZES_DEG, SMALLEST_TURN_DEG, hour
from navcore.cues.table import CUE_TABLE, VERBOSITIES, CueEntry, CueKind, CuePriority
from navcore.cues.texts import EXPLANATIONS, PLACE_KINDS, STOP_TEXTS, TEXTS
from navcore.settings import CueSettings
from navcore.types import Reason


def cues_markdown() -> str:
    """Return docs/cues.md."""
    lines = [
        "# Cues",
        "",
        "All that the walker hears and sees, made by `make docs` from `navcore/cues/`. Names like `announce_m`",
        "are [settings](settings.md) of the group `cues`.",
        "",
        "- One voice: a higher priority cuts a lower one off, at the same level the newest is kept, and an instruction",
        "  that was cut off is said again if it still holds; a message without the sentences that were heard.",
        "  `repeat last` says the last sentence again.",
        "- Silence is never *go*: while *walk* holds, something is heard at least every `tick_interval_s`, and whoever",
        "  hears nothing for 1.5 s stops. No guidance, or an old one, is the cue *stop*, to the ear and to the eye.",
        "- Speech is espeak-ng's where it is installed; elsewhere the words are text, and the tones are heard.",
        "",
        "## The table",
        "",
        "Highest priority first. *From* is the least `verbosity` at which it is said.",
        "",
        "| cue | priority | from | what it means | sound | on the overlay | again |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(_row(kind, CUE_TABLE[kind]) for kind in _by_priority()),
        "",
        *_verbosity(),
        *_directions(),
        *_distances(),
        *_overlay(),
        *_words(),
        *_reasons(),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _by_priority() -> list[CueKind]:
    return sorted(CUE_TABLE, key=lambda kind: -CUE_TABLE[kind].priority)


def _row(kind: CueKind, entry: CueEntry) -> str:
    priority = CuePriority(entry.priority).name.lower().replace("_", " ")
    return (
        f"| `{kind.value}` | {int(entry.priority)} {priority} | {entry.verbosity} | {entry.meaning} | {entry.sound} |"
        f" {entry.picture} | {entry.repeats} |"
    )


def _verbosity() -> list[str]:
    lines = ["## Verbosity", "", "| `verbosity` | adds |", "| --- | --- |"]
    for level in VERBOSITIES:
        kinds = ", ".join(f"`{kind.value}`" for kind in _by_priority() if CUE_TABLE[kind].verbosity == level)
        extra = "; the angle in `turn_ahead`" if level == "full" else ""
        lines.append(f"| {level} | {kinds}{extra} |")
    lines += ["", "What safety hangs on is said at every level, in the same words.", ""]
    return lines


def _directions() -> list[str]:
    texts = TEXTS["en"]
    sides = "; ".join(f"“{texts[f'turn_{size}_left']}” {degrees:g}°" for size, degrees in SIZES_DEG.items())
    hours = ", ".join(f"{hour(-degrees)} for {degrees:g}°" for degrees in CLOCK_DEG[1:])
    return [
        "## Directions",
        "",
        "An angle is told as the nearest one that the style has; what is left when the walker has turned by it is told",
        "again, as a smaller turn, so that no style is too coarse to arrive. While walking, the tone says the rest.",
        "",
        "| `direction_style` | example | angles |",
        "| --- | --- | --- |",
        f"| degrees | {texts['turn_left'].format(degrees=30)} | steps of {DEGREES_STEP_DEG:g}°, at least"
        f" {SMALLEST_TURN_DEG:g}° |",
        f"| clock | {texts['turn_clock'].format(hour=11)} | to the right {hours}; the same to the left;"
        f" below 22.5° “{texts['turn_slightly_left']}” {CLOCK_DEG[0]:g}° |",
        f"| sides | {texts['turn_half_left']} | {sides} |",
        "",
    ]


def _distances() -> list[str]:
    announce_m, lead_s = CueSettings().announce_m, CueSettings().turn_lead_s
    kinds = ", ".join(word for kind, word in PLACE_KINDS["en"].items() if kind != "stairs")
    return [
        "## Announcements at the right distance",
        "",
        f"- A place is announced `announce_m` ({announce_m:g} m) ahead at {USUAL_SPEED_M_S:g} m/s, and between"
        f" {LEAST_SHARE * announce_m:g} and {MOST_SHARE * announce_m:g} m at other",
        "  speeds: the faster the walker, the earlier. A long sentence begins earlier still: when it ends, the walker",
        "  has `follower.reaction_s` left before the place. One that could not is not begun.",
        f"- A turn is announced so that the sentence is over {lead_s:g} s (`turn_lead_s`) before the turn is due, and",
        "  not at all where it would not be over by then.",
        f"- The kind of a place is said where its name does not say it: {kinds}. Stairs are a warning: they are",
        "  announced at every verbosity, and late rather than not at all.",
        "- Of an edge of the PoI-graph its caution side, as it is walked, and that it is narrow (less than",
        f"  `obstacle.person_width_m` + {NARROW_MARGIN_M:g} m wide) are said once, at every verbosity, as soon as the"
        " walker has come onto it",
        "  and walks: before that, left and right would be those of another way.",
        "- These wait for the announcement of a place, of stairs or of a turn while they can still begin in the first"
        f" {BEGINS_SHARE:.0%} of",
        f"  the edge and its first {BEGINS_M:g} m; then they come first, and late rather than not at all. Only stairs"
        " of which",
        "  nobody could be told in time after them come before.",
        "- A reassurance does not cut off the announcement of a place or a turn, make a place be told later"
        f" than {announce_m - PLACE_TOLERANCE_M:g} m",
        "  before it, or a turn not at all, and does not begin right before an edge of which something is to be said.",
        "",
    ]


def _overlay() -> list[str]:
    return [
        "## The see-through overlay",
        "",
        "For the partially sighted, on the two displays of the glasses",
        "([navcore/cues/overlay.py](../navcore/cues/overlay.py)): black is transparent there, and light is added to",
        "what is seen through. Arrow, post and outlines lie in the world and have the disparity of their distance;",
        "signs and figures lie at the distance of the virtual image. Every sign has a shape of its own, and a contrast",
        "of at least 3:1, before black and before a mid-grey wall. `vbr demo --headless --overlay DIR` writes what the",
        "walker sees.",
        "",
        "![What the left and the right eye see at a corner](overlay.jpg)",
        "",
    ]


def _words() -> list[str]:
    lines = ["## Words", "", "| cue | English | 中文 |", "| --- | --- | --- |"]
    for kind in _by_priority():
        lines += [f"| `{kind.value}` | {TEXTS['en'][key]} | {TEXTS['zh'][key]} |" for key in CUE_TABLE[kind].words]
    return [*lines, ""]


def _reasons() -> list[str]:
    lines = [
        "## Stops and their reasons",
        "",
        "The second sentence follows the stop at the verbosity *full*.",
        "",
        "| reason | English | 中文 |",
        "| --- | --- | --- |",
    ]
    for reason in Reason:
        english, chinese = (f"{STOP_TEXTS[each][reason]} · {EXPLANATIONS[each][reason]}" for each in ("en", "zh"))
        lines.append(f"| `{reason.value}` | {english} | {chinese} |")
    return lines
