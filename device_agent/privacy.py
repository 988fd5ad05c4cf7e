"""Who sees the walker, told to them; and what they allow. Pure: steps from one frozen state to the next.

Nothing here ever speaks over an instruction: its cues have the lowest priority, and wait for a gap between other words
that is long enough. A sentence that is cut off all the same is said again after a while, until it has been heard whole.
A question that nobody answers is refused; what was allowed ends by itself, with the link, and with the one who asked.
"""

from __future__ import annotations

from dataclasses import replace

from device_agent.sharing import ColourShown, Consent, LinkStands, Privacy, Question, Saying, shared_by_both
from device_agent.state import (
    DeviceState,
    Effect,
    Happened,
    Notice,
    Outdated,
    SoundSign,
    Step,
    StoreAccesses,
    StoreConsent,
)
from navcore.cues.privacy_words import accesses_text, watching_text
from navcore.cues.synthesis import colour_sign_cue
from navcore.cues.table import Cue, CueKind, is_said
from navcore.cues.texts import TEXTS, speech_duration_s
from navcore.modes import Mode
from navcore.types import Action
from navcore.wire import Accesses, AskColour, SharingRunning, Watchers

ANSWER_WITHIN_S = 30.0
COLOUR_FOR_S = 60.0
SIGN_EVERY_S = 5.0
SAID_AGAIN_AFTER_S = 10.0
"""So long after a sentence was cut off, or found no gap after all, it is tried again: half sentences only disturb."""
GAP_S = 1.0
"""Nothing is begun before it has been silent for so long: of words, and of tones that steer."""
_QUESTION_OVER = Outdated(frozenset({CueKind.CONSENT}))
PrivacyOrder = Watchers | AskColour | Accesses | LinkStands | Consent


def sharing_of(privacy: Privacy) -> SharingRunning:
    """Return what the console is told."""
    colour, consent = privacy.colour, privacy.consent
    return SharingRunning(
        consent.silhouettes, consent.walks, privacy.told, "" if colour is None else colour.who,
        None if colour is None else colour.until_s, privacy.answered_id, privacy.refusal,
        privacy.why_ended,
    )  # fmt: skip


def taken(state: DeviceState, order: PrivacyOrder, now_s: float) -> Step:
    """Return the state after something was heard of who watches, asks, or has looked; or the walker's own will."""
    privacy = state.privacy
    match order:
        case Watchers(names):
            return _with(state, replace(privacy, watchers=names)), ()
        case LinkStands(joined):
            return (state, ()) if joined else _link_lost(state)
        case Accesses():
            known = replace(privacy, accesses=order, wall_offset_s=order.now_s - now_s)
            return _with(state, known), (StoreAccesses(order),)
        case Consent():
            return _heard_of_consent(state, order)
        case AskColour():
            return _asked(state, order, now_s)


def consented(state: DeviceState, consent: Consent) -> Step:
    """The walker changes what they share; it is kept."""
    state = _with(state, replace(state.privacy, consent=replace(consent, version=state.privacy.consent.version + 1)))
    return state, (StoreConsent(state.privacy.consent), *_told_of_consent(state))


def answered(state: DeviceState, allowed: bool, now_s: float) -> Step:
    """The walker answers the open question, or ends what they have allowed; call it only where there is one."""
    question, language = state.privacy.question, state.settings.cues.language
    if question is None:
        return _ended(state, "The walker has ended it.")
    if not allowed:
        state, effects = _refused(state, "The walker does not want it.", says="")
        return state, (Notice(TEXTS[language]["colour_refused"], answers=True), *effects)
    colour = ColourShown(question.who, now_s + COLOUR_FOR_S, now_s + SIGN_EVERY_S)
    state = _with(
        state, replace(_without_question(state.privacy, question.request_id, ""), colour=colour, why_ended="")
    )
    return state, (
        # The answer cuts the question off, which then waits to be said again.
        Notice(TEXTS[language]["colour_allowed"].format(name=question.who), answers=True),
        _QUESTION_OVER,
        Happened("privacy", f"The walker lets {question.who} see pictures for {COLOUR_FOR_S:.0f} s."),
        sharing_of(state.privacy),
    )


def can_answer(state: DeviceState, allowed: bool, now_s: float) -> bool:
    """Whether a press can be a *yes* (``allowed``) or a *no*: to a question, or to what is allowed already.

    *Yes* is said only by who has heard the whole question; *no* by who has begun to. Until then a press means what it
    always does: nobody allows, or refuses, what they do not know of.
    """
    question = state.privacy.question
    if question is None:
        # What is allowed already is not allowed again: *next* means what it always does.
        return state.privacy.colour is not None and not allowed
    return now_s <= question.until_s and (question.heard if allowed else question.begun)


def passed(state: DeviceState, now_s: float) -> Step:
    """Return the state as time has passed: what is over ends, and what is still to be heard is said."""
    privacy, effects = state.privacy, list[Effect]()
    if privacy.question is not None and now_s > privacy.question.until_s:
        state, more = _refused(state, "The walker has not answered.", says="colour_unanswered")
        effects += more
    if privacy.colour is not None and (over := _why_over(state, now_s)):
        state, more = _ended(state, over)
        effects += more
    state, more = _finish_saying(state, now_s)
    effects += more
    state, more = _say_next(state, now_s)
    effects += more
    colour = state.privacy.colour
    if colour is not None and now_s >= colour.sign_due_s:
        effects.append(SoundSign(colour_sign_cue(now_s)))
    return state, tuple(effects)


def heard(state: DeviceState, cues: tuple[Cue, ...]) -> DeviceState:
    """Note what the walker hears: a sentence on privacy begins, or other words cut it off; the sign has sounded."""
    privacy = state.privacy
    for cue in cues:
        saying, colour = privacy.saying, privacy.colour
        said_s = speech_duration_s(cue.text, state.settings.cues.language) if cue.text else 0.0
        if _cuts_off(cue):
            privacy = replace(privacy, words_until_s=cue.stamp_s + cue.duration_s + said_s)
        if cue.kind is CueKind.COLOUR_SIGN and colour is not None:
            privacy = replace(privacy, colour=replace(colour, sign_due_s=cue.stamp_s + SIGN_EVERY_S))
        elif saying is not None and (cue.kind, cue.text) == (saying.kind, saying.text):
            privacy = replace(privacy, saying=replace(saying, until_s=cue.stamp_s + said_s))
            if privacy.question is not None and saying.kind is CueKind.CONSENT:
                privacy = replace(privacy, question=replace(privacy.question, begun=True))
        elif saying is not None and saying.until_s is not None and cue.stamp_s < saying.until_s and _cuts_off(cue):
            privacy = replace(privacy, saying=replace(saying, until_s=None, offered_s=cue.stamp_s))
    return state if privacy is state.privacy else _with(state, privacy)


def watching_now(state: DeviceState) -> str:
    """Return in words who watches, where that is known."""
    language, watchers = state.settings.cues.language, state.privacy.watchers
    if watchers is None:
        return TEXTS[language]["privacy_unknown"]
    return watching_text("watch", watchers, language) if watchers else TEXTS[language]["privacy_nobody"]


def who_has_looked(state: DeviceState, now_s: float) -> str:
    """Return in words who has watched, and looked at what is kept."""
    language, told = state.settings.cues.language, state.privacy.accesses
    if told is None:
        return TEXTS[language]["access_none"]
    return accesses_text(told.entries, now_s + state.privacy.wall_offset_s, told.utc_offset_s, language)


# ------------------------------------------------------------------------------------------------------ internals
def _cuts_off(cue: Cue) -> bool:
    return bool(cue.text) or cue.kind is CueKind.STEER


def _with(state: DeviceState, privacy: Privacy) -> DeviceState:
    return replace(state, privacy=privacy)


def _heard_of_consent(state: DeviceState, consent: Consent) -> Step:
    """Take up what was kept by others, where it is newer than what the walker said last, which may wait for the disk.

    What nobody has said (the file is gone, or cannot be read) never lets anything be shared that was not.
    """
    known, is_said = state.privacy.consent, consent.version > 0
    if not is_said:
        consent = shared_by_both(known, consent)
    elif consent.version <= known.version:
        return state, ()
    is_same = (consent.silhouettes, consent.walks) == (known.silhouettes, known.walks)
    if is_same and not is_said:
        return state, ()
    state = _with(state, replace(state.privacy, consent=consent))
    stored = () if is_said else (StoreConsent(consent),)
    return state, stored if is_same else (*stored, *_told_of_consent(state))


def _told_of_consent(state: DeviceState) -> tuple[Effect, ...]:
    consent = state.privacy.consent
    said = [f"depth pictures: {_yes(consent.silhouettes)}", f"recordings of walks: {_yes(consent.walks)}"]
    return Happened("privacy", f"The walker shares now: {', '.join(said)}."), sharing_of(state.privacy)


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _link_lost(state: DeviceState) -> Step:
    """Nobody can be asked who watches; a question, and what was allowed, end with the connection that they came by."""
    effects = list[Effect]()
    if state.privacy.question is not None:
        state, more = _refused(state, "The link has broken.", says="colour_unanswered")
        effects += more
    if state.privacy.colour is not None:
        state, more = _ended(state, "The link has broken.")
        effects += more
    return _with(state, replace(state.privacy, watchers=None)), tuple(effects)


def _asked(state: DeviceState, order: AskColour, now_s: float) -> Step:
    privacy, why_not = state.privacy, ""
    if privacy.question is not None or privacy.colour is not None:
        why_not = "Somebody has asked already: wait until that is over."
    elif state.purpose is Mode.OFF_DUTY:
        why_not = "The walker is off duty."
    happened = Happened("privacy", f"{order.who} asks to see pictures{f': {order.why}' if order.why else ''}.")
    if why_not:
        state = _with(state, replace(privacy, answered_id=order.request_id, refusal=why_not))
        return state, (happened, sharing_of(state.privacy))
    question = Question(order.request_id, order.who, order.why, now_s + ANSWER_WITHIN_S)
    return _with(state, replace(privacy, question=question, ended="")), (happened,)


def _without_question(privacy: Privacy, request_id: int, refusal: str) -> Privacy:
    saying = privacy.saying if privacy.saying is None or privacy.saying.kind is not CueKind.CONSENT else None
    return replace(privacy, question=None, saying=saying, answered_id=request_id, refusal=refusal)


def _refused(state: DeviceState, why: str, *, says: str) -> Step:
    question = state.privacy.question
    assert question is not None, "there is a question to refuse"
    state = _with(state, replace(_without_question(state.privacy, question.request_id, why), ended=says))
    happened = Happened("privacy", f"No pictures for {question.who}. {why}")
    return state, (_QUESTION_OVER, happened, sharing_of(state.privacy))


def _ended(state: DeviceState, why: str) -> Step:
    colour = state.privacy.colour
    assert colour is not None, "there is something to end"
    state = _with(state, replace(state.privacy, colour=None, ended="colour_ended", why_ended=why))
    return state, (Happened("privacy", f"{colour.who} sees no pictures any more. {why}"), sharing_of(state.privacy))


def _why_over(state: DeviceState, now_s: float) -> str:
    """Return why nobody may see colour pictures any longer; empty while they may."""
    colour, watchers = state.privacy.colour, state.privacy.watchers
    assert colour is not None
    if now_s >= colour.until_s:
        return "The time is over."
    if state.purpose is Mode.OFF_DUTY:
        return "The walker is off duty."
    return "They watch no more." if watchers is not None and colour.who not in watchers else ""


def _finish_saying(state: DeviceState, now_s: float) -> Step:
    """What has been said whole has been heard."""
    privacy, saying = state.privacy, state.privacy.saying
    if saying is None or saying.until_s is None or now_s < saying.until_s:
        return state, ()
    if saying.kind is CueKind.CONSENT:
        question = privacy.question
        asked = question if question is None else replace(question, heard=True)
        return _with(state, replace(privacy, saying=None, question=asked, ended="")), ()
    return _told(_with(state, replace(privacy, saying=None)), saying.names)


def _told(state: DeviceState, names: tuple[str, ...]) -> Step:
    state = _with(state, replace(state.privacy, told=names))
    whom = ", ".join(names) or "nobody"
    return state, (Happened("privacy", f"The walker knows who watches: {whom}."), sharing_of(state.privacy))


def _say_next(state: DeviceState, now_s: float) -> Step:
    saying = state.privacy.saying
    if saying is not None and saying.until_s is not None:
        return state, ()
    wanted, effects = _wanted(state, now_s), list[Effect]()
    if saying is not None and (wanted is None or wanted.text != saying.text):
        # It has not been heard, and is no longer true.
        effects.append(Outdated(frozenset({saying.kind})))
        state, saying = _with(state, replace(state.privacy, saying=None)), None
    if wanted is None or (saying is not None and now_s - saying.offered_s < SAID_AGAIN_AFTER_S):
        return state, tuple(effects)
    if not is_said(wanted.kind, state.settings.cues.verbosity):
        state, told = _told(state, wanted.names)
        return state, (*effects, *told)
    if not _is_gap(state, wanted.text, now_s):
        return state, tuple(effects)
    return _with(state, replace(state.privacy, saying=wanted)), (*effects, Notice(wanted.text, kind=wanted.kind))


def _is_gap(state: DeviceState, text: str, now_s: float) -> bool:
    """Whether it is silent, and no turn is due before the sentence has been heard."""
    if now_s - state.privacy.words_until_s < GAP_S:
        return False
    guidance = state.guidance
    if guidance is None or not state.on_the_way:
        return True
    if guidance.action is Action.TURN:
        return False
    corner = guidance.trace.corner
    if corner is None or guidance.action is Action.STOP:
        return True
    heard_m = guidance.trace.speed_m_s * (speech_duration_s(text, state.settings.cues.language) + GAP_S)
    return corner.distance_m - corner.turn_m > heard_m


def _wanted(state: DeviceState, now_s: float) -> Saying | None:
    """Return the sentence that the walker is to hear next; None where there is none."""
    privacy, language = state.privacy, state.settings.cues.language
    texts, question = TEXTS[language], privacy.question
    if question is not None and not question.heard:
        key = "colour_asked_why" if question.why else "colour_asked"
        return Saying(CueKind.CONSENT, texts[key].format(name=question.who, why=question.why), now_s)
    if question is None and privacy.ended:
        return Saying(CueKind.CONSENT, texts[privacy.ended], now_s)
    return None if privacy.watchers is None else _news_of_watchers(state, privacy.watchers, now_s)


def _news_of_watchers(state: DeviceState, watchers: tuple[str, ...], now_s: float) -> Saying | None:
    language, told = state.settings.cues.language, state.privacy.told
    stay = tuple(name for name in told if name in watchers)
    gone = tuple(name for name in told if name not in watchers)
    if come := tuple(name for name in watchers if name not in told):
        text = watching_text("watch_also" if stay else "watch", come, language)
        # Those who have gone meanwhile are told of afterwards, unless they are back by then.
        return Saying(CueKind.WATCHED, text, now_s, (*told, *come))
    if not gone:
        return None
    text = watching_text("watch_left", gone, language) if stay else TEXTS[language]["watch_nobody"]
    return Saying(CueKind.UNWATCHED, text, now_s, stay)
