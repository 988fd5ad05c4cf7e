"""Text from elsewhere as it may stand on a terminal: whoever reads it is not told by it what their screen is to do."""

from __future__ import annotations


def plain(text: str) -> str:
    """Return a text on one line, with a space for each character that is not printed (control, direction)."""
    return "".join(each if each.isprintable() else " " for each in text)
