"""Can places be told apart by ear, and can their names be spoken at all?"""

from __future__ import annotations

import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterator

from navcore.map_check.evidence import MapEvidence, is_silent, said_of
from navcore.map_check.finding import Finding, Severity
from navcore.map_check.sounds import confusable_pairs, plain_form
from navcore.planning.poi_graph import Poi

MAX_DIGITS = 4
"""Longer numbers are read as thousands and millions by speech synthesizers."""
_SPOKEN_SIGNS = frozenset(" '’-.,&")
_MAX_ABBREVIATION, _MAX_SPELLED = 5, 3
"""Capitals longer than this are written so to be seen, and are read as a word: EXIT."""


def duplicate_names(evidence: MapEvidence) -> Iterator[Finding]:
    """Find places that are called the same, in writing or aloud."""
    pois = evidence.graph.pois
    by_name, by_speech = defaultdict(list), defaultdict(list)
    for key in sorted(pois):
        by_name[plain_form(pois[key].name)].append(key)
        if not is_silent(pois[key]):
            by_speech[plain_form(said_of(pois[key]))].append(key)
    for ids in by_speech.values():
        if len(ids) > 1:
            yield _same(evidence, tuple(ids), "warning", "are both called {name} aloud")
    spoken = {tuple(ids) for ids in by_speech.values()}
    for ids in by_name.values():
        if len(ids) > 1 and tuple(ids) not in spoken:
            yield _same(evidence, tuple(ids), "note", "have the same name, {name}, in writing")


def _same(evidence: MapEvidence, ids: tuple[str, ...], severity: Severity, what: str) -> Finding:
    first = evidence.graph.pois[ids[0]]
    name = f"“{said_of(first) if severity == 'warning' else first.name}”"
    text = f"{_counted(len(ids))} places {what.format(name=name)}."
    text = text.replace("both", "all") if len(ids) > 2 else text
    code = "duplicate_spoken_name" if severity == "warning" else "duplicate_name"
    return Finding(code, severity, text, "Give each a name of its own.", first.x_m, first.y_m, ids)


def _counted(count: int) -> str:
    return "Two" if count == 2 else str(count)


def confusable_names(evidence: MapEvidence) -> Iterator[Finding]:
    """Find pairs of places whose names may be taken for each other by somebody who hears them."""
    pois = evidence.graph.pois
    spoken = {key: said_of(poi) for key, poi in pois.items() if not is_silent(poi)}
    for (one, other), reason in confusable_pairs(spoken).items():
        text = f"“{spoken[one]}” and “{spoken[other]}” may be confused by ear: {reason}."
        action = "Give one of them a spoken name that is clearly different."
        yield Finding("confusable_names", "warning", text, action, pois[one].x_m, pois[one].y_m, (one, other))


def unspeakable_names(evidence: MapEvidence) -> Iterator[Finding]:
    """Find places that are announced by a name that cannot be spoken well, and have no spoken name or a bad one."""
    for poi in evidence.graph.pois.values():
        if is_silent(poi) or (reason := why_unspeakable(said_of(poi))) is None:
            continue
        text = f"{_called(poi)} cannot be spoken well: it {reason}."
        action = "Give the place a spoken name: whole words, as somebody would say them."
        yield Finding("missing_spoken_name", "warning", text, action, poi.x_m, poi.y_m, (poi.id,))


def _called(poi: Poi) -> str:
    return f"The spoken name “{poi.spoken_name}”" if poi.spoken_name.strip() else f"The name “{poi.name}”"


def why_unspeakable(name: str) -> str | None:
    """Return why a name is not spoken well, as the end of a sentence that begins with "it"; None where it is."""
    plain = unicodedata.normalize("NFKC", name)
    if not any(character.isalpha() for character in plain):
        return "holds no word"
    if odd := sorted({c for c in plain if not (c.isalnum() or unicodedata.combining(c) or c in _SPOKEN_SIGNS)}):
        return f"holds “{odd[0]}”, which is left out or spelled"
    words = re.split(r"[\s\-,&]+", plain)
    if code := next((word for word in words if re.search(r"\d", word) and re.search(r"[^\W\d_]", word)), None):
        return f"holds a code, “{code}”"
    if re.search(rf"\d{{{MAX_DIGITS + 1}}}", plain):
        return "holds a long number"
    if short := next((word for word in words if _is_abbreviation(word)), None):
        return f"holds an abbreviation, “{short}”"
    return None


def _is_abbreviation(word: str) -> bool:
    letters = word.rstrip(".")
    if not (1 < len(letters) <= _MAX_ABBREVIATION and letters.isascii() and letters.isalpha()):
        return False
    is_spelled = letters.isupper() and len(letters) <= _MAX_SPELLED
    return is_spelled or word.endswith(".") or not re.search(r"[aeiouy]", letters.casefold())
