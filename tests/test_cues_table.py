"""The table of cues is whole: every kind, every reason, both languages; and the page of the docs is made from it."""

from __future__ import annotations

import string
import subprocess
import sys
from pathlib import Path

import pytest

from navcore.cues.overlay_display import DisplayGeometry
from navcore.cues.overlay_shapes import Label, Sheet
from navcore.cues.overlay_signs import arrival_sign, stop_sign
from navcore.cues.table import ANNOUNCEMENTS, CUE_TABLE, VERBOSITIES, CueKind, is_said
from navcore.cues.texts import EXPLANATIONS, PLACE_KINDS, STOP_TEXTS, TEXTS, distance_text, place_text
from navcore.planning.poi_graph import POI_KINDS
from navcore.types import Reason

NEEDED_TO_BE_SAFE = {
    CueKind.STOP, CueKind.ARRIVED, CueKind.OBSTACLE_BEEP, CueKind.TURN, CueKind.WALK, CueKind.STEER, CueKind.TICK,
    CueKind.HAZARD_AHEAD, CueKind.CAUTION_SIDE, CueKind.NARROW_PASSAGE, CueKind.MESSAGE, CueKind.ANSWER,
    # Of a map walk; to the sighted, but whoever is led later walks by its map.
    CueKind.MAP_ADVICE, CueKind.MAP_NEWS,
    # Not of safety, but nobody is to be watched without knowing.
    CueKind.WATCHED, CueKind.CONSENT, CueKind.COLOUR_SIGN,
}  # fmt: skip


def fields(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


def test_every_kind_is_in_the_table_and_says_what_it_is() -> None:
    assert set(CUE_TABLE) == set(CueKind)
    for kind, entry in CUE_TABLE.items():
        for part in (entry.meaning, entry.sound, entry.picture, entry.repeats):
            assert part, kind


def test_all_words_are_some_cues_and_exist_in_every_language() -> None:
    said = [key for entry in CUE_TABLE.values() for key in entry.words]
    assert sorted(said) == sorted(TEXTS["en"])
    for language, texts in TEXTS.items():
        assert texts.keys() == TEXTS["en"].keys()
        for key, text in texts.items():
            assert text.strip(), (language, key)
            assert fields(text) == fields(TEXTS["en"][key]), (language, key)
    assert {kind for kind, entry in CUE_TABLE.items() if entry.by_reason} == {CueKind.STOP, CueKind.EXPLANATION}


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_has_its_words_and_its_picture(reason: Reason) -> None:
    for texts in (STOP_TEXTS, EXPLANATIONS):
        assert all(texts[language][reason] for language in ("en", "zh"))
    sheet = Sheet(DisplayGeometry())
    if reason is Reason.ARRIVED:
        assert arrival_sign(sheet)
        return
    shapes = stop_sign(sheet, reason)
    assert next(shape.text for shape in shapes if isinstance(shape, Label)) == "STOP"
    assert len(shapes) > 3, "a pictogram"


def test_chinese_is_chinese_and_english_is_not() -> None:
    for language, is_chinese in (("en", False), ("zh", True)):
        texts = [*TEXTS[language].values(), *STOP_TEXTS[language].values(), *EXPLANATIONS[language].values()]
        for text in texts:
            assert any("\u4e00" <= character <= "\u9fff" for character in text) is is_chinese, text


def test_no_explanation_of_a_stop_holds_an_instruction_to_move() -> None:
    for language, words in (("en", ("move", "walk", "go ahead", "forward.")), ("zh", ("走",))):
        for text in EXPLANATIONS[language].values():
            said = text.casefold().replace("do not step forward.", "")
            assert not any(word in said for word in words), text


def test_what_safety_hangs_on_is_said_at_every_verbosity() -> None:
    for kind in CueKind:
        levels = [is_said(kind, verbosity) for verbosity in VERBOSITIES]
        assert levels == sorted(levels), "each level says all that the ones before it say"
        assert levels[-1]
        assert levels[0] == (kind in NEEDED_TO_BE_SAFE), kind
    assert not is_said(CueKind.EXPLANATION, "normal")
    assert is_said(CueKind.TURN_AHEAD, "normal")
    assert {kind for kind in NEEDED_TO_BE_SAFE if kind in ANNOUNCEMENTS} == {
        CueKind.HAZARD_AHEAD, CueKind.CAUTION_SIDE, CueKind.NARROW_PASSAGE,
    }  # fmt: skip


def test_places_where_something_is_to_be_done_are_said_by_their_kind() -> None:
    assert set(PLACE_KINDS["en"]) == set(PLACE_KINDS["zh"]) <= set(POI_KINDS)
    assert place_text("North", "lift", 6.2, "en") == "Lift in 6 metres: North."
    assert place_text("North lift", "lift", 6.2, "en") == "North lift in 6 metres."
    assert place_text("Bar", "bar", 1.2, "en") == "Bar in 1 metre."
    assert place_text("North", "stairs", 4.0, "en") == "Caution, stairs in 4 metres: North."
    assert place_text("Main stairs", "stairs", 4.0, "en") == "Caution, Main stairs in 4 metres."
    assert place_text("北", "stairs", 4.0, "zh") == "注意,前方4米有楼梯:北。"
    assert place_text("北电梯", "lift", 4.0, "zh") == "前方4米,北电梯。"
    assert distance_text(0.62, "en", decimals=1) == "0.6 metres"


def test_the_page_of_the_docs_is_current_and_names_everything() -> None:
    page = subprocess.run(
        [sys.executable, "-m", "device_agent", "cues", "--markdown"], capture_output=True, text=True, check=True
    ).stdout
    assert page == (Path(__file__).parent.parent / "docs" / "cues.md").read_text(encoding="utf-8")
    for kind in CueKind:
        assert page.count(f"`{kind.value}`") >= 2, kind
    for reason in Reason:
        assert f"`{reason.value}`" in page
    for text in TEXTS["zh"].values():
        assert text in page
    for picture in ("overlay.jpg",):
        assert (Path(__file__).parent.parent / "docs" / picture).stat().st_size < 150_000
