"""Words and small pieces of HTML for the panel. Everything that comes from outside is escaped here."""

from __future__ import annotations

import html
from collections.abc import Sequence

_CARD = "padding:0 0.75em 0.35em;font-size:0.86em;line-height:1.35;opacity:0.9"
_ROW = "display:flex;justify-content:space-between;gap:1em"
_BADGE = "display:inline-block;padding:0.05em 0.55em;border-radius:0.8em;font-weight:700;color:#111;background:{}"
BADGE_COLOURS = {"live": "#4ade80", "delayed": "#facc15", "stale": "#fb923c", "lost": "#9ca3af"}


def card(sentence: str) -> str:
    """A sentence as HTML."""
    return f'<div style="{_CARD}">{html.escape(sentence)}</div>'


def status_card(badge: str, heading: str, rows: Sequence[tuple[str, str]]) -> str:
    """A badge, a heading, and rows of name and value, as HTML."""
    colour = BADGE_COLOURS.get(badge, "#9ca3af")
    lines = "".join(
        f'<div style="{_ROW}"><span style="opacity:0.7">{html.escape(name)}</span>'
        f'<span style="text-align:right">{html.escape(value)}</span></div>'
        for name, value in rows
    )
    return (
        f'<div style="{_CARD}"><div style="margin-bottom:0.3em"><span style="{_BADGE.format(colour)}">'
        f"{html.escape(badge.upper())}</span> <b>{html.escape(heading)}</b></div>{lines}</div>"
    )
