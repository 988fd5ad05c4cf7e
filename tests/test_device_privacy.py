"""Who watches is told to the walker and never over an instruction; pictures go only where, and while, they allow it."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_hall import Rig, pose_at

from device_agent.cli import main
from device_agent.consent_watch import ConsentWatch
from device_agent.device_options import DeviceOptions
from device_agent.device_process import _kept
from device_agent.device_store import DeviceStore
from device_agent.outbox import Outbox
from device_agent.ports import Button, PressKind
from device_agent.privacy import ANSWER_WITHIN_S, COLOUR_FOR_S, SIGN_EVERY_S
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import replay
from device_agent.recording.walk_files import parts_in
from device_agent.sharing import NOTHING_SHARED, Consent, LinkStands
from navcore.cues.privacy_words import accesses_text, names_text
from navcore.cues.table import CueKind, CuePriority
from navcore.modes import Mode
from navcore.silhouette import COLOUR_LONGEST_PX, colour_jpeg
from navcore.types import Frame
from navcore.wire import (
    MESSAGES,
    Access,
    Accesses,
    ApplySettings,
    AskColour,
    ColourImage,
    DepthImage,
    Say,
    SharingRunning,
    Watchers,
    encode,
)

LONG = PressKind.LONG
OF_PRIVACY = {CueKind.WATCHED, CueKind.UNWATCHED, CueKind.CONSENT}


def said(rig: Rig) -> list[str]:
    """Return what was said on privacy; the same words again, where others had cut them off, are said once."""
    found = [cue.text for cue in rig.output.cues if cue.kind in OF_PRIVACY]
    return [text for number, text in enumerate(found) if number == 0 or found[number - 1] != text]


def pass_s(rig: Rig, seconds: float) -> None:
    rig.cycles(round(seconds / rig.frame_s))


def open_privacy(rig: Rig) -> str:
    """Go to the entry after the last place, and open it; return what is said then."""
    for _ in range(len(rig.agent.state.graph.pois) + 1):
        if rig.press(Button.NEXT)[0] == "Privacy. Press the main button to open it.":
            return rig.press(Button.MAIN)[0]
    raise AssertionError("privacy is not among the places")


def told(rig: Rig) -> tuple[str, ...]:
    return rig.messages(SharingRunning)[-1].told


def watched_by(rig: Rig, *names: str) -> None:
    rig.agent.submit(Watchers(names))
    pass_s(rig, 6.0)


# --------------------------------------------------------------------------------------------------------- watchers
def test_the_walker_hears_who_comes_and_who_goes_and_the_console_that_they_have_heard() -> None:
    rig = Rig()
    watched_by(rig)
    assert said(rig) == [], "nobody has come, and nobody has gone"
    watched_by(rig, "Anna")
    assert told(rig) == ("Anna",)
    watched_by(rig, "Anna", "Ben")
    watched_by(rig, "Ben")
    assert told(rig) == ("Ben",)
    watched_by(rig)
    assert said(rig) == [
        "Anna is watching.", "Ben is watching too.", "Anna is no longer watching.", "Nobody is watching any more.",
    ]  # fmt: skip
    assert told(rig) == ()


def test_who_watches_is_neither_said_again_by_repeat_nor_shown_as_what_was_heard_last() -> None:
    rig = Rig()
    rig.agent.submit(Say("Lunch is ready."))
    pass_s(rig, 3.0)
    watched_by(rig, "Anna")
    assert said(rig) == ["Anna is watching."]
    assert rig.uplink.states[-1].last_cue == "Lunch is ready."
    assert rig.press(Button.REPEAT) == ["Lunch is ready."]


def test_the_console_is_told_only_once_the_words_have_been_spoken() -> None:
    rig = Rig()
    rig.cycles(3)
    rig.agent.submit(Watchers(("Anna",)))
    rig.cycles(2)
    assert said(rig) == ["Anna is watching."], "it is being said"
    assert not rig.messages(SharingRunning)
    pass_s(rig, 3.0)
    assert told(rig) == ("Anna",)


def test_who_has_gone_before_it_was_said_is_not_said_to_watch() -> None:
    rig = Rig()
    rig.lead_to()
    rig.agent.submit(Watchers(("Anna",)))
    rig.cycles(1)
    rig.agent.submit(Watchers(()))
    pass_s(rig, 30.0)
    heard = said(rig)
    assert heard in ([], ["Anna is watching.", "Nobody is watching any more."])


def test_nothing_on_privacy_cuts_off_an_instruction_and_it_is_heard_all_the_same() -> None:
    rig = Rig()
    rig.agent.submit(Watchers(("Anna",)))
    rig.agent.submit(AskColour(7, "Anna", "which door is it"))
    rig.lead_to()
    pass_s(rig, ANSWER_WITHIN_S - 5.0)
    until_s = -np.inf
    for cue in rig.output.cues:
        if cue.kind in OF_PRIVACY:
            assert cue.priority is CuePriority.PRIVACY
            assert cue.stamp_s >= until_s, "other words are being said"
        elif cue.text:
            until_s = cue.stamp_s + 0.3
    assert {
        "Anna is watching.",
        "Anna asks to see pictures: which door is it. Hold next to allow it for one minute,"
        " or previous to refuse. Silence is no.",
    } == (set(said(rig)))


def test_who_watches_is_said_in_a_gap_and_not_begun_again_and_again_between_instructions() -> None:
    rig = Rig()
    rig.lead_to()
    rig.agent.submit(Watchers(("Anna",)))
    for number in range(200):
        # Whoever sways is steered all the time.
        rig.pose = pose_at(1.0 + 0.05 * number, 0.0, np.radians(14.0 if number // 6 % 2 else -14.0))
        rig.cycles(1)
    begun_s = [cue.stamp_s for cue in rig.output.cues if cue.kind is CueKind.WATCHED]
    assert len(begun_s) <= 2
    assert all(later - earlier >= 10.0 for earlier, later in itertools.pairwise(begun_s))
    for begin_s in begun_s:
        before_s = [cue.stamp_s for cue in rig.output.cues if cue.kind is CueKind.STEER and cue.stamp_s < begin_s]
        assert not before_s or begin_s - before_s[-1] >= 1.0
    rig.pose = pose_at(11.0)
    pass_s(rig, 15.0)
    assert told(rig) == ("Anna",), "it is heard as soon as there is a gap"


def test_brief_walkers_hear_who_comes_and_not_who_goes() -> None:
    rig = Rig()
    rig.agent.submit(ApplySettings(1, {"cues.verbosity": "brief"}))
    watched_by(rig, "Anna")
    watched_by(rig)
    watched_by(rig, "Ben")
    assert said(rig) == ["Anna is watching.", "Ben is watching."]
    assert told(rig) == ("Ben",)


def test_without_a_link_it_is_not_known_who_watches_and_the_same_people_afterwards_are_no_news() -> None:
    rig = Rig()
    watched_by(rig, "Anna")
    rig.agent.submit(LinkStands(False))
    pass_s(rig, 5.0)
    assert said(rig) == ["Anna is watching."], "nobody knows that she has gone"
    assert open_privacy(rig) == "Privacy. There is no link to the console. It is not known who watches."
    rig.agent.submit(LinkStands(True))
    watched_by(rig, "Anna")
    assert said(rig) == ["Anna is watching."]


@pytest.mark.parametrize(
    ("names", "words"),
    [(("Anna",), "Anna"), (("Anna", "Ben"), "Anna and Ben"), (("Anna", "Ben", "Cem"), "Anna, Ben and Cem"),
     (("Anna", "Ben", "Cem", "Dee"), "Anna, Ben and 2 others")],
)  # fmt: skip
def test_several_people_are_named_as_people_name_them(names: tuple[str, ...], words: str) -> None:
    assert names_text(names, "en") == words


# ----------------------------------------------------------------------------------------------------------- colour
def asked(why: str = "") -> Rig:
    """Somebody asks, and the walker has heard it."""
    rig = Rig()
    rig.lead_to()
    watched_by(rig, "Anna")
    rig.agent.submit(AskColour(7, "Anna", why))
    pass_s(rig, 12.0)
    assert said(rig)[-1].startswith("Anna asks to see pictures")
    assert not rig.uplink.colour_images
    return rig


def test_allowed_pictures_go_for_a_minute_with_a_sign_that_is_heard_and_end_with_words() -> None:
    rig = asked()
    allowed = rig.press(Button.NEXT, LONG)
    assert "Anna sees pictures for one minute. Hold previous to end it." in allowed
    asked_count = len(said(rig))
    answer = rig.messages(SharingRunning)[-1]
    assert (answer.answered_id, answer.refusal, answer.colour_for) == (7, "", "Anna")
    pass_s(rig, COLOUR_FOR_S - 1.0)
    assert len(rig.uplink.colour_images) > 100
    assert len(said(rig)) == asked_count
    signs_s = [cue.stamp_s for cue in rig.output.cues if cue.kind is CueKind.COLOUR_SIGN]
    assert len(signs_s) >= 0.5 * COLOUR_FOR_S / SIGN_EVERY_S
    assert max(np.diff(signs_s)) < 3.0 * SIGN_EVERY_S
    pass_s(rig, 2.0)
    count = len(rig.uplink.colour_images)
    pass_s(rig, 5.0)
    assert len(rig.uplink.colour_images) == count, "the minute is over"
    assert said(rig)[-1] == "Pictures are no longer shown."
    assert rig.messages(SharingRunning)[-1].colour_for == ""
    assert [text for text in rig.events("privacy") if "Anna" in text][-1] == (
        "Anna sees no pictures any more. The time is over."
    )


def test_no_answer_is_no_and_a_refusal_says_so_at_once() -> None:
    rig = asked()
    pass_s(rig, ANSWER_WITHIN_S)
    assert rig.messages(SharingRunning)[-1].refusal == "The walker has not answered."
    assert said(rig)[-1] == "No pictures are shown."
    rig.agent.submit(AskColour(8, "Anna"))
    rig.cycles(2)
    assert "No pictures." in rig.press(Button.PREVIOUS, LONG)
    pass_s(rig, 5.0)
    assert (rig.messages(SharingRunning)[-1].answered_id, rig.uplink.colour_images) == (8, [])


@pytest.mark.parametrize("how", ["button", "gone", "link", "off duty"])
def test_what_was_allowed_ends_at_once_by_button_with_who_asked_with_the_link_and_off_duty(how: str) -> None:
    rig = Rig()
    watched_by(rig, "Anna", "Ben")
    rig.agent.submit(AskColour(7, "Anna"))
    pass_s(rig, 12.0)
    heard = len(rig.output.cues)
    rig.press(Button.NEXT, LONG)
    rig.cycles(40)
    assert CueKind.CONSENT not in rig.heard[heard:], "what is answered is not asked again"
    assert rig.uplink.colour_images
    if how == "button":
        rig.press(Button.PREVIOUS, LONG)
    elif how == "off duty":
        rig.press(Button.MAIN, LONG)
        assert rig.agent.state.mode is Mode.OFF_DUTY
    else:
        rig.agent.submit(Watchers(("Ben",)) if how == "gone" else LinkStands(False))
        rig.cycles(1)
    count = len(rig.uplink.colour_images)
    assert rig.messages(SharingRunning)[-1].colour_for == ""
    pass_s(rig, 5.0)
    assert len(rig.uplink.colour_images) == count
    assert "Pictures are no longer shown." in said(rig)


def test_while_somebody_asks_the_other_buttons_mean_what_they_always_do() -> None:
    rig = asked()
    rig.press(Button.MAIN)
    assert rig.agent.state.mode is Mode.PAUSED
    assert rig.agent.state.privacy.question is not None, "the question is still open"


def test_nobody_allows_what_they_have_not_heard_to_the_end_nor_refuses_what_they_do_not_know_of() -> None:
    rig = Rig()
    watched_by(rig, "Anna")
    rig.agent.submit(AskColour(7, "Anna", "which door is it"))
    assert not any("No pictures" in words for words in rig.press(Button.PREVIOUS, LONG))
    assert rig.agent.state.privacy.question is not None, "it was asked, and is not heard yet"
    pass_s(rig, 1.0)
    rig.press(Button.NEXT, LONG)
    pass_s(rig, 1.0)
    assert rig.agent.state.privacy.colour is None, "the question has not been heard to its end"
    pass_s(rig, 20.0)
    rig.press(Button.NEXT, LONG)
    assert rig.agent.state.privacy.colour is not None


def test_a_second_question_is_refused_while_the_first_is_open() -> None:
    rig = asked()
    rig.agent.submit(AskColour(8, "Ben"))
    rig.cycles(1)
    answer = rig.messages(SharingRunning)[-1]
    assert (answer.answered_id, answer.refusal) == (8, "Somebody has asked already: wait until that is over.")


# ------------------------------------------------------------------------------------------------------- what leaves
def frame() -> Frame:
    return Frame(1.0, np.full((480, 640, 3), 90, np.uint8), np.ones((4, 5), np.float32))


def test_no_picture_leaves_that_is_not_shared_whoever_offers_it() -> None:
    outbox = Outbox()

    def goes(kind: type[DepthImage] | type[ColourImage]) -> bool:
        outbox.offer_frame(kind, frame())
        return outbox.next_frame(kind, 1e6 * len(goes_at)) is not None

    goes_at = [0]
    for sharing, expected in (
        (None, (False, False)),
        (SharingRunning(True, False), (True, False)),
        (SharingRunning(False, False, colour_for="Anna"), (False, True)),
        (SharingRunning(False, True), (False, False)),
    ):
        if sharing is not None:
            outbox.keep(sharing)
        goes_at.append(0)
        assert (goes(DepthImage), goes(ColourImage)) == expected, sharing


def test_what_waits_to_be_sent_goes_no_more_once_it_is_not_shared() -> None:
    outbox = Outbox()
    outbox.keep(SharingRunning(True, False, colour_for="Anna"))
    for kind in (DepthImage, ColourImage):
        outbox.offer_frame(kind, frame())
    outbox.keep(SharingRunning(False, False))
    assert outbox.next_frame(DepthImage, 1e6) is None
    assert outbox.next_frame(ColourImage, 1e6) is None
    assert outbox.wait_s(1e6) is None


def test_a_colour_picture_is_small_and_comes_at_most_once_a_second() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (720, 1280, 3), dtype=np.uint8)
    assert len(encode(ColourImage(1.0, colour_jpeg(noise)))) < 100_000
    assert COLOUR_LONGEST_PX <= 320
    row = MESSAGES[ColourImage]
    assert row.rate_hz == 1.0
    assert row.priority == max(each.priority for each in MESSAGES.values())


# ---------------------------------------------------------------------------------------------------------- consent
def test_what_is_shared_is_changed_by_ear_and_kept_over_a_restart(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path, tmp_path / "site")
    rig = Rig(store=store)
    rig.agent.submit(Watchers(()))
    assert open_privacy(rig) == "Privacy. Nobody is watching."
    rig.press(Button.NEXT)
    (shared,) = rig.press(Button.NEXT)
    assert shared == "The console gets depth pictures. Press the main button to stop that."
    assert rig.press(Button.MAIN) == ["The console gets no depth pictures. Press the main button to allow them."]
    assert not rig.messages(SharingRunning)[-1].silhouettes
    rig.agent.settle()
    assert store.load_consent() == Consent(silhouettes=False, walks=False)


def test_consent_said_on_the_command_line_is_heeded_by_the_running_device(tmp_path: Path) -> None:
    store, heard = DeviceStore(tmp_path, tmp_path / "site"), list[Consent]()
    there = threading.Event()
    watch = ConsentWatch(
        store, Consent(), lambda consent: (heard.append(consent), there.set())[0], store.consent_stamp()
    )
    watch.start()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "device_agent", "consent", "--state", str(tmp_path), "--silhouettes", "no"],
            capture_output=True, text=True, check=True, env=os.environ | {"PYTHONPATH": str(Path.cwd())}, timeout=120,
        )  # fmt: skip
        assert there.wait(20.0)
    finally:
        watch.stop()
    assert heard == [Consent(silhouettes=False, walks=False)]
    assert "Depth pictures to the console:      no" in done.stdout


def test_consent_that_cannot_be_read_shares_nothing(tmp_path: Path) -> None:
    store, heard = DeviceStore(tmp_path, tmp_path / "site"), list[Consent]()
    watch = ConsentWatch(store, Consent(), heard.append, store.consent_stamp())
    (tmp_path / "consent.json").write_bytes(b"{broken")
    watch.look()
    assert heard == [NOTHING_SHARED]
    rig = Rig(store=store)
    rig.agent.submit(NOTHING_SHARED)
    rig.cycles(1)
    assert not rig.messages(SharingRunning)[-1].silhouettes
    rig.agent.settle()
    assert not store.load_consent().silhouettes, "it is kept so that it can be read again"


def test_what_the_walker_says_by_ear_is_not_undone_by_what_was_kept_before_it(tmp_path: Path) -> None:
    """The walker switches pictures on and off again; what is read of the disk is still what they said first."""
    store = DeviceStore(tmp_path, tmp_path / "site")
    rig, read = Rig(store=store), list[Consent]()
    store.save_consent(Consent(silhouettes=False, version=1))
    rig.agent.submit(store.load_consent())
    watch = ConsentWatch(store, Consent(), read.append, store.consent_stamp())
    store.save_consent(Consent(silhouettes=True, version=2))
    watch.look()
    rig.agent.submit(read[0])
    rig.cycles(1)
    assert rig.messages(SharingRunning)[-1].silhouettes
    open_privacy(rig)
    rig.press(Button.NEXT)
    rig.press(Button.NEXT)
    rig.press(Button.MAIN)
    rig.agent.submit(read[0])
    rig.cycles(1)
    assert not rig.messages(SharingRunning)[-1].silhouettes
    rig.agent.settle()
    assert store.load_consent() == Consent(silhouettes=False, version=3)


def test_where_two_say_something_at_once_what_both_allow_is_shared(tmp_path: Path) -> None:
    store, read = DeviceStore(tmp_path, tmp_path / "site"), list[Consent]()
    store.save_consent(Consent(silhouettes=True, walks=True, version=4))
    watch = ConsentWatch(store, Consent(), read.append, store.consent_stamp())
    store.change_consent(lambda kept: replace(kept, silhouettes=False, version=kept.version + 1))
    store.save_consent(Consent(silhouettes=True, walks=False, version=5))  # from the walker's own list
    watch.look()
    assert read == [Consent(silhouettes=False, walks=False, version=6)]
    (tmp_path / "consent.json").unlink()
    watch.look()
    store.save_consent(Consent(silhouettes=True, walks=True))  # by a program that knows nothing of what was there
    watch.look()
    rig = Rig()
    for consent in read:
        rig.agent.submit(consent)
    rig.cycles(1)
    assert not (told := rig.messages(SharingRunning)[-1]).silhouettes
    assert not told.walks, "a file that was lost can only share less"


def test_what_is_said_while_the_device_starts_is_not_overlooked(tmp_path: Path) -> None:
    store, read = DeviceStore(tmp_path, tmp_path / "site"), list[Consent]()
    options = DeviceOptions(tmp_path / "site", tmp_path, shares_walks=True)
    kept = _kept(options, store)
    assert kept.consent.walks
    store.change_consent(lambda now: replace(now, walks=False, version=now.version + 1))
    ConsentWatch(store, Consent(), read.append, kept.consent_stamp).look()
    assert [consent.walks for consent in read] == [False]


def test_a_device_that_shares_walks_from_its_start_says_so_and_only_as_long_as_it_is_started_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = DeviceStore(tmp_path, tmp_path / "site")
    options = DeviceOptions(tmp_path / "site", tmp_path, shares_walks=True)

    def printed(*said: str) -> str:
        assert main(["consent", "--state", str(tmp_path), *said]) == 0
        return capsys.readouterr().out

    _kept(options, store)
    assert "Recordings of walks to the console: yes" in printed()
    assert not _kept(replace(options, shares_walks=False), store).consent.walks
    assert "Recordings of walks to the console: no" in printed()
    printed("--walks", "no")
    assert not _kept(options, store).consent.walks, "the walker's own word holds"


# ----------------------------------------------------------------------------------------------------- who has looked
NOON_S = 1_764_417_600.0  # Saturday, 29 November 2025, 12:00 UTC
DAY_S = 86_400.0
LOG = (
    Access("Ben", "past_walk", NOON_S - DAY_S, NOON_S - DAY_S, NOON_S - 5 * DAY_S),
    Access("Anna", "watch", NOON_S - DAY_S, NOON_S - DAY_S + 60.0),
    Access("Anna", "watch", NOON_S - 3600.0, NOON_S - 3000.0),
)


def test_who_has_looked_is_read_to_the_walker_also_without_a_link_and_after_a_restart(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path, tmp_path / "site")
    before = Rig(store=store)
    before.agent.submit(Accesses(LOG, NOON_S, 3600.0))
    before.cycles(1)
    before.agent.settle()

    again = Rig(store=store)
    kept = store.load_accesses(NOON_S + 60.0)
    assert kept is not None
    again.agent.submit(kept)
    open_privacy(again)
    again.press(Button.NEXT)
    assert again.press(Button.MAIN) == [
        "Since yesterday: Ben looked at the walk of Monday. Anna watched 2 times, the last time today at 12:10."
    ]


def test_the_log_is_read_in_chinese_bounded_and_says_when_it_is_empty() -> None:
    assert accesses_text((), NOON_S, 0.0, "en") == "Nobody has watched, or looked at what is kept."
    assert (
        accesses_text(LOG, NOON_S, 3600.0, "zh")
        == "自昨天以来:Ben看过星期一的行走。Anna观看过2次,最后一次在今天的12:10。"
    )
    walks = [Access("Ada", "past_walk", NOON_S, NOON_S, NOON_S - number * DAY_S) for number in (1, 2, 3)]
    words = accesses_text([*walks, Access("Ben", "export", NOON_S, NOON_S, NOON_S - DAY_S)], NOON_S, 0.0, "en")
    assert words == (
        "Since today: Ada looked at 3 walks, the last time today at 12:00. Ben downloaded the incident of yesterday."
    )
    many = [Access(f"P{number}", "colour", NOON_S + number, NOON_S + number) for number in range(9)]
    words = accesses_text(many, NOON_S + 100.0, 0.0, "en")
    assert words.endswith("And 3 more.")
    assert "P8" in words
    assert "P2" not in words


# ------------------------------------------------------------------------------------------------------------ replay
def test_a_walk_on_which_somebody_watches_and_asks_is_replayed_to_the_same_words(tmp_path: Path) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path))
    rig = Rig(tap=recorder)
    orders = (
        LinkStands(True), Watchers(("Anna",)), Accesses(LOG, NOON_S, 3600.0), Consent(walks=True),
        AskColour(7, "Anna", "which door"), LinkStands(False),
    )  # fmt: skip
    for order in orders:
        rig.agent.submit(order)
        rig.cycles(25)
        recorder.check()
        if isinstance(order, AskColour):
            rig.cycles(60)
            rig.press(Button.NEXT, LONG)
            rig.cycles(60)
            open_privacy(rig)
            recorder.check()
    recorder.close()
    assert CueKind.COLOUR_SIGN in rig.heard
    (path,) = parts_in(tmp_path)
    cycles = list(replay([RecordedPart(path)]))
    assert len(cycles) > 200
    assert [each.differs_in for each in cycles if each.differs_in] == []
