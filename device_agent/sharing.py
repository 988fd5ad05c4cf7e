"""What the walker lets others see, who watches, and what of it they have been told: frozen values."""

from __future__ import annotations

import math
from dataclasses import dataclass

from navcore.cues.table import CueKind
from navcore.wire import Accesses


@dataclass(frozen=True, slots=True)
class Consent:
    """What may go to the console; the walker's to decide, and kept over a restart."""

    silhouettes: bool = True
    """Depth images: shapes, no colours of people or places."""
    walks: bool = False
    """Recordings of walks."""
    version: int = 1
    """Grows with each change, by ear or by ``vbr consent``: an older one never undoes a newer one. 0: nobody has said
    it."""


DEFAULT_CONSENT = Consent(version=0)
"""What is shared where the walker has said nothing."""
NOTHING_SHARED = Consent(silhouettes=False, walks=False, version=0)


def shared_by_both(one: Consent, other: Consent) -> Consent:
    """Return what two allow that were said without knowing of each other, newer than both."""
    return Consent(
        one.silhouettes and other.silhouettes, one.walks and other.walks, max(one.version, other.version) + 1
    )


@dataclass(frozen=True, slots=True)
class LinkStands:
    """Whether the device is joined to the console now."""

    joined: bool


@dataclass(frozen=True, slots=True)
class Question:
    """Somebody asks to see colour pictures, and the walker has not answered yet."""

    request_id: int
    who: str
    why: str
    until_s: float
    """No answer until then is *no*."""
    begun: bool = False
    """The walker has begun to hear it."""
    heard: bool = False
    """It has been said without being cut off."""


@dataclass(frozen=True, slots=True)
class ColourShown:
    """Somebody may see colour pictures."""

    who: str
    until_s: float
    sign_due_s: float
    """When the walker hears the next sign of it."""


@dataclass(frozen=True, slots=True)
class Saying:
    """A sentence on privacy that is to be heard whole: it is said again where other words cut it off."""

    kind: CueKind
    text: str
    offered_s: float
    names: tuple[str, ...] = ()
    """Of whom the walker will have heard that they watch."""
    until_s: float | None = None
    """When it will have been said; None while it waits."""


@dataclass(frozen=True, slots=True)
class Privacy:
    """Everything of this between two cycles."""

    consent: Consent = DEFAULT_CONSENT
    watchers: tuple[str, ...] | None = None
    """Who watches now; None while that is not known, for there is no link."""
    told: tuple[str, ...] = ()
    """Of whom the walker has heard that they watch, and not yet that they have gone."""
    question: Question | None = None
    colour: ColourShown | None = None
    saying: Saying | None = None
    ended: str = ""
    """Key of the text that is still to be heard of pictures that are not shown, or no longer."""
    answered_id: int = 0
    refusal: str = ""
    why_ended: str = ""
    """Why nobody sees pictures any more."""
    accesses: Accesses | None = None
    """Who has watched, and who has looked at what is kept."""
    wall_offset_s: float = 0.0
    """Unix time minus the device's clock, as it was told with them."""
    words_until_s: float = -math.inf
    """When the last words, or the last steering tone, that the walker has heard were over."""

    @property
    def at_rest(self) -> bool:
        """Nothing is to be said, waited for, or ended."""
        has_news = self.watchers is not None and set(self.watchers) != set(self.told)
        return not (has_news or self.question or self.colour or self.saying or self.ended)
