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


def conflict_card(sentence: str, by: str, rows: Sequence[tuple[str, str, str]]) -> str:
    """A sentence, and of each field the version of somebody else and one's own, as HTML."""
    head = "".join(f'<th style="text-align:left">{html.escape(word)}</th>' for word in ("", by, "You"))
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return (
        f'<div style="{_CARD}"><div role="alert">{html.escape(sentence)}</div>'
        f'<table style="width:100%;margin-top:0.3em"><tr>{head}</tr>{body}</table></div>'
    )


def people_card(lines: Sequence[str]) -> str:
    """Who else is here, as HTML."""
    return f'<div style="{_CARD}">' + "".join(f"<div>● {html.escape(line)}</div>" for line in lines) + "</div>"


def keys_table(groups: Sequence[tuple[str, Sequence[tuple[str, str]]]]) -> str:
    """Shortcuts by group, each as keys and what they do, as HTML."""
    parts = []
    for heading, rows in groups:
        lines = "".join(
            f'<tr><td style="white-space:nowrap;padding-right:1.2em"><kbd>{html.escape(keys)}</kbd></td>'
            f"<td>{html.escape(words)}</td></tr>"
            for keys, words in rows
        )
        parts.append(f'<h4 style="margin:0.7em 0 0.2em">{html.escape(heading)}</h4><table>{lines}</table>')
    return f'<div style="padding:0 0.75em 0.5em;font-size:0.9em;line-height:1.5">{"".join(parts)}</div>'


def legend_card(heading: str, rows: Sequence[tuple[tuple[int, int, int], str]]) -> str:
    """Colours and what they mean, as HTML."""
    lines = "".join(
        f'<div><span style="display:inline-block;width:0.9em;height:0.9em;margin-right:0.5em;border-radius:0.2em;'
        f'background:rgb({red},{green},{blue})"></span>{html.escape(words)}</div>'
        for (red, green, blue), words in rows
    )
    return f'<div style="{_CARD}"><b>{html.escape(heading)}</b>{lines}</div>'
