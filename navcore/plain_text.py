"""Text that people give: what nobody can see in it turns sentences round, breaks lines, and is not spoken."""

from __future__ import annotations

import unicodedata

from navcore.errors import InputError

JOINERS = "\u200c\u200d"
"""Persian, Hindi and other scripts are not written rightly without these two."""
_BREAKS = "\n\r\t"
_HIDDEN_CATEGORIES = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Control and format characters (those that turn the direction of writing among them), halves, and separators."""


def refuse_hidden(what: str, text: str, *, may_break: bool = False) -> None:
    """Raise InputError, naming what it is and the character, where a text holds one that nobody can see.

    ``may_break`` lets lines end and columns stand in it.
    """
    allowed = JOINERS + _BREAKS if may_break else JOINERS
    for each in text:
        if unicodedata.category(each) in _HIDDEN_CATEGORIES and each not in allowed:
            raise InputError(f"{what} holds a character that nobody can see (U+{ord(each):04X}): type it without that.")


def is_blank(text: str) -> bool:
    """Whether there is nothing to see in a text."""
    return not text.strip().strip(JOINERS).strip()
