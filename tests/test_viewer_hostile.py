"""A signed-in browser that sends the scene values of no form: its window goes on, others look on, the log is silent."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec
import pytest
import viser._messages as viser_messages
from test_viewer_mount import CAMERA, Console, console, received, send  # noqa: F401

from console.viewer.forms import has_form
from console.viewer.guard import EDITING, LOOKING

HARSH: tuple[Any, ...] = (
    float("nan"), float("inf"), -float("inf"), [], [0] * 3000, [float("nan")] * 3, [float("nan")] * 4, ["x", "y", "z"],
    {}, {"value": [[]]}, b"\xff", [[[0.0]]],
)  # fmt: skip
POINT, PLACE = [0.0, 1.0, 2.0], [0.5, 0.5]
USUAL: dict[str, dict[str, Any]] = {
    "ViewerCameraMessage": {name: value for name, value in CAMERA.items() if name != "type"},
    "GuiUpdateMessage": {"uuid": "x", "updates": {"value": 1.5}},
    "CommandTriggerMessage": {"uuid": "x"},
    "SceneNodeClickMessage": {
        "name": "/x", "instance_index": None, "ray_origin": POINT, "ray_direction": POINT, "screen_pos": PLACE,
        "modifier": None,
    },
    "ScenePointerMessage": {
        "event_type": "click", "ray_origin": POINT, "ray_direction": POINT, "screen_pos": [PLACE], "modifier": "shift",
    },
    "SceneNodeDragMessage": {
        "phase": "start", "name": "/x", "instance_index": 3, "start_position": POINT, "start_screen_pos": PLACE,
        "end_position": POINT, "end_screen_pos": PLACE, "button": "left", "modifier": None,
    },
}  # fmt: skip


def _harsh() -> list[dict[str, Any]]:
    """Return messages of every type that an editor may send, with something harsh in each field in turn."""
    made = list[dict[str, Any]]()
    for kind, usual in USUAL.items():
        made += [{"type": kind, **usual, name: harsh} for name in usual for harsh in HARSH]
        made += [{"type": kind}, {"type": kind, **usual, "more": 1}]
    # A widget's value is judged by its widget; which values are plain, the guard says.
    return [each for each in made if not isinstance(each.get("updates"), dict)]


def test_what_is_usual_has_its_form_and_nothing_harsh_has() -> None:
    assert set(USUAL) == LOOKING | EDITING
    for kind, usual in USUAL.items():
        fields = {each.name for each in dataclasses.fields(getattr(viser_messages, kind))}
        assert set(usual) <= fields
        assert has_form(msgspec.msgpack.encode({"type": kind, **usual})), kind
    assert [each for each in _harsh() if has_form(msgspec.msgpack.encode(each))] == []


def test_values_of_no_form_do_nothing_and_are_not_told_message_by_message(
    console: Console,  # noqa: F811
    caplog: pytest.LogCaptureFixture,
) -> None:
    with console.open("editor") as window, console.open("editor") as good:
        for message in _harsh():
            send(window, message)
        for each in (window, good):
            send(each, CAMERA)
            assert received(each, "GuiTabGroupMessage"), "it goes on"
    assert [record.getMessage() for record in caplog.records] == []
