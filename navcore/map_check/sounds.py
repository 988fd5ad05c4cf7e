"""Which names sound or read so alike that somebody who hears them may take the one for the other.

By rules, for English: letters that sound the same, numbers such as thirteen and thirty, two digits swapped, one letter
more, less or another. Names in Chinese are compared by their characters alone.
"""

from __future__ import annotations

import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterator, Mapping
from itertools import combinations

MIN_WORD_LETTERS = 4
"""In shorter words one letter makes a difference that is heard, or is meant to: Bar and Car, Gate A and Gate B."""
_SOUNDS: tuple[tuple[str, str], ...] = (
    ("ph", "f"), ("ck", "k"), ("gh", "g"), ("kn", "n"), ("wr", "r"), ("wh", "w"), ("qu", "kw"), ("c(?=[eiy])", "s"),
    ("c", "k"), ("q", "k"), ("x", "ks"), ("z", "s"), ("y", "i"), ("v", "f"), ("dt?", "t"), ("b", "p"), ("ee|ea", "i"),
    ("oo|ou|ue", "u"), ("ai|ei|ay|ey", "e"), ("h", ""), (r"e\b", ""), (r"(.)\1+", r"\1"),
)  # fmt: skip
"""What sounds about the same in English, in the order in which it is replaced, before doubled letters become one."""
_LETTERS_ALIKE = ("bcdegptvz", "mn", "fsx", "ajk", "iy", "qu")
"""Names of letters that rhyme, and are mistaken for each other (the reason for the spelling alphabet of ICAO)."""
_LETTER_CLASS = {letter: letters for letters in _LETTERS_ALIKE for letter in letters}


def plain_form(name: str) -> str:
    """Return a name as its words and numbers in small letters: what stays when it is read aloud."""
    folded = unicodedata.normalize("NFKC", name).casefold()
    words = re.findall(r"[^\W\d_]+|\d+", folded)
    return " ".join(words) or folded.strip()


def confusable_pairs(names: Mapping[str, str]) -> dict[tuple[str, str], str]:
    """Return why two names of different form may be confused, by their keys, each pair in the keys' order.

    ``names`` are names by whatever key; of those of one form, the first key stands for all.
    """
    key_of_form: dict[str, str] = {}
    for key in sorted(names):
        key_of_form.setdefault(plain_form(names[key]), key)
    alike: dict[tuple[str, str], list[str]] = defaultdict(list)
    for form in sorted(key_of_form):
        for kind, trace in _traces(form):
            if form not in alike[kind, trace]:
                alike[kind, trace].append(form)
    pairs: dict[tuple[str, str], str] = {}
    for (kind, _), forms in alike.items():
        for a, b in combinations(forms, 2):
            one, other = sorted((key_of_form[a], key_of_form[b]))
            pairs.setdefault((one, other), kind)
    return pairs


def _traces(form: str) -> Iterator[tuple[str, str]]:
    """Return what a form has in common with all that it may be confused with: two forms that share one are alike."""
    yield "they sound alike", _sound(form)
    yield "the names of the letters sound alike", " ".join(_letter(word) for word in form.split())
    for swapped in _swaps(form):
        yield "two digits are swapped", swapped
    for number in _teens(form):
        yield "the numbers sound alike", number
    for blanked in _blanked(form):
        yield "a single letter makes the difference", blanked


def _sound(form: str) -> str:
    words = []
    for word in form.split():
        for pattern, sound in _SOUNDS if len(word) > 1 and word.isascii() and word.isalpha() else ():
            word = re.sub(pattern, sound, word)
        words.append(word)
    return " ".join(words)


def _letter(word: str) -> str:
    return _LETTER_CLASS.get(word, word)


def _swaps(form: str) -> Iterator[str]:
    for at in range(len(form) - 1):
        a, b = form[at], form[at + 1]
        if a.isdecimal() and b.isdecimal():
            yield f"{at}:{form[:at]}{min(a, b)}{max(a, b)}{form[at + 2 :]}"


def _teens(form: str) -> Iterator[str]:
    """Thirteen and thirty: the last two digits of numbers that are read in pairs."""
    for number in re.finditer(r"\b(\d\d)?(?:1([3-9])|([3-9])0)\b", form):
        digit = number[2] or number[3]
        yield f"{form[: number.start()]}{number[1] or ''}{digit}-teen{form[number.end() :]}"


def _blanked(form: str) -> Iterator[str]:
    """The form with a letter blanked out, and with a blank put in: who shares one differs by a letter at that place."""
    for word in re.finditer(rf"[^\W\d_]{{{MIN_WORD_LETTERS},}}", form):
        for at in range(word.start(), word.end()):
            yield f"{form[:at]}_{form[at + 1 :]}"
        for at in range(word.start(), word.end() + 1):
            yield f"{form[:at]}_{form[at:]}"
