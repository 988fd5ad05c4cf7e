"""The walker's list of what concerns privacy: who watches, who has looked, and what is shared. Pure.

Each entry is said when it is come to; the main button does what the entry says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from device_agent.privacy import consented, watching_now, who_has_looked
from device_agent.sharing import Consent
from device_agent.state import DeviceState, Menu, Notice, Step
from navcore.cues.texts import TEXTS

Shared = Literal["silhouettes", "walks"]


@dataclass(frozen=True, slots=True)
class PrivacyEntry:
    """One entry of the list."""

    said: Callable[[DeviceState], str]
    chosen: Callable[[DeviceState, float], Step]


def _shared(what: Shared) -> PrivacyEntry:
    def said(state: DeviceState) -> str:
        is_shared: bool = getattr(state.privacy.consent, what)
        return TEXTS[state.settings.cues.language][f"privacy_{what}_{'on' if is_shared else 'off'}"]

    def turned(state: DeviceState, now_s: float) -> Step:
        consent: Consent = state.privacy.consent
        state, effects = consented(state, replace(consent, **{what: not getattr(consent, what)}))
        return state, (Notice(said(state), answers=True), *effects)

    return PrivacyEntry(said, turned)


def _says_watchers(state: DeviceState, now_s: float) -> Step:
    return state, (Notice(watching_now(state), answers=True),)


def _says_accesses(state: DeviceState, now_s: float) -> Step:
    return state, (Notice(who_has_looked(state, now_s), answers=True),)


ENTRIES: dict[str, PrivacyEntry] = {
    "watchers": PrivacyEntry(watching_now, _says_watchers),
    "accesses": PrivacyEntry(lambda state: TEXTS[state.settings.cues.language]["privacy_accesses"], _says_accesses),
    "silhouettes": _shared("silhouettes"),
    "walks": _shared("walks"),
}
"""The list, in order."""


def opened(state: DeviceState, until_s: float) -> Step:
    """Open the list at its first entry."""
    language = state.settings.cues.language
    first = next(iter(ENTRIES))
    between = "" if language == "zh" else " "
    text = TEXTS[language]["privacy_list"] + between + ENTRIES[first].said(state)
    return replace(state, menu=Menu(first, "privacy", until_s)), (Notice(text, answers=True),)


def moved(state: DeviceState, step: int, until_s: float) -> Step:
    """Go to another entry of the open list."""
    assert state.menu is not None
    keys = list(ENTRIES)
    key = keys[(keys.index(state.menu.entry_id) + step) % len(keys)]
    return replace(state, menu=Menu(key, "privacy", until_s)), (Notice(ENTRIES[key].said(state), answers=True),)


def chosen(state: DeviceState, now_s: float, until_s: float) -> Step:
    """Do what the entry says that was named last; the list stays open."""
    assert state.menu is not None
    entry = ENTRIES[state.menu.entry_id]
    return entry.chosen(replace(state, menu=replace(state.menu, until_s=until_s)), now_s)
