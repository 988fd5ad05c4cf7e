"""Buttons: presses short and long, over a pipe as from /dev/input, and over a terminal."""

from __future__ import annotations

import os
import sys
import termios
from pathlib import Path

import pytest
from hardware_stand_ins import InputDevice, eventually, waiting_bytes
from hypothesis import given
from hypothesis import strategies as st

from device_agent.adapters.clocks import FakeClock, SteppedClock
from device_agent.adapters.evdev_buttons import (
    EV_SYN,
    INPUT_EVENT,
    KEY_BUTTONS,
    SYN_DROPPED,
    EvdevButtons,
    has_any_key,
)
from device_agent.adapters.keyboard_buttons import KEYS, KeyboardButtons, keys_in
from device_agent.adapters.presses import LONG_AFTER_S, PressTracker
from device_agent.adapters.reopening import LONGEST_BACKOFF_S
from device_agent.ports import Button, ButtonPress, PressKind
from navcore.errors import SensorError

ENTER, RIGHT, VOLUME_DOWN, SPACE = 28, 106, 114, 57
BUTTONS = st.sampled_from(list(Button))


# ------------------------------------------------------------------------------------------------ short or long
def test_a_button_let_go_at_once_is_short() -> None:
    tracker = PressTracker()
    tracker.down(1.0, Button.MAIN)
    assert tracker.due(1.2) == ()
    assert tracker.up(1.2, Button.MAIN) == (ButtonPress(1.2, Button.MAIN, PressKind.SHORT),)


def test_a_held_button_is_long_while_it_is_still_held_and_only_once() -> None:
    tracker = PressTracker()
    tracker.down(1.0, Button.NEXT)
    tracker.down(1.5, Button.NEXT)
    assert tracker.due(1.0 + LONG_AFTER_S) == (ButtonPress(1.0 + LONG_AFTER_S, Button.NEXT, PressKind.LONG),)
    assert tracker.due(9.0) == ()
    assert tracker.up(9.5, Button.NEXT) == ()


def test_buttons_that_are_gone_press_nothing() -> None:
    tracker = PressTracker()
    tracker.down(1.0, Button.MAIN)
    tracker.release_all()
    assert tracker.due(9.0) == ()
    assert tracker.up(9.0, Button.MAIN) == ()


@given(st.lists(st.tuples(st.floats(0.0, 2.0), BUTTONS, st.sampled_from(["down", "up", "look"])), max_size=60))
def test_every_press_has_a_button_that_went_down_and_is_told_once(steps: list[tuple[float, Button, str]]) -> None:
    tracker, now_s, downs, told = PressTracker(), 0.0, 0, 0
    held: set[Button] = set()
    for passed_s, button, what in steps:
        now_s += passed_s
        if what == "down":
            downs += button not in held
            held.add(button)
            tracker.down(now_s, button)
        elif what == "up":
            held.discard(button)
            told += len(tracker.up(now_s, button))
        else:
            told += len(tracker.due(now_s))
    told += len(tracker.due(now_s + 2 * LONG_AFTER_S))
    assert told == downs


# -------------------------------------------------------------------------------------------------- /dev/input
@pytest.fixture
def device(tmp_path: Path) -> InputDevice:
    return InputDevice(tmp_path)


def kinds(presses: tuple[ButtonPress, ...]) -> list[tuple[Button, PressKind]]:
    return [(press.button, press.kind) for press in presses]


def test_the_kernels_event_has_the_documented_size() -> None:
    assert INPUT_EVENT.size == 24


def test_keys_become_presses(device: InputDevice) -> None:
    clock = FakeClock(50.0)
    buttons = EvdevButtons(device.path, clock)
    device.key(1000.0, ENTER, 1)
    device.key(1000.0, 0, 0, EV_SYN)
    assert buttons.pressed() == ()
    clock.advance(0.3)
    device.key(1000.3, ENTER, 0)
    assert buttons.pressed() == (ButtonPress(pytest.approx(50.3), Button.MAIN, PressKind.SHORT),)
    device.key(1000.4, VOLUME_DOWN, 1)
    device.key(1000.5, VOLUME_DOWN, 2)
    buttons.pressed()
    clock.advance(LONG_AFTER_S + 0.2)
    assert kinds(buttons.pressed()) == [(Button.PREVIOUS, PressKind.LONG)]
    device.key(1003.0, VOLUME_DOWN, 0)
    device.key(1003.0, SPACE, 1)
    device.key(1003.1, SPACE, 0)
    assert buttons.pressed() == ()
    buttons.close()


def test_a_loop_that_looks_late_still_tells_short_from_long(device: InputDevice) -> None:
    clock = FakeClock(50.0)
    buttons = EvdevButtons(device.path, clock)
    device.key(1000.0, ENTER, 1)
    device.key(1000.2, ENTER, 0)
    device.key(1001.0, RIGHT, 1)
    device.key(1002.0, RIGHT, 0)
    clock.advance(10.0)
    presses = buttons.pressed()
    assert kinds(presses) == [(Button.MAIN, PressKind.SHORT), (Button.NEXT, PressKind.LONG)]
    assert all(press.stamp_s <= clock.now_s() for press in presses)


def test_events_that_come_in_pieces_are_put_together(device: InputDevice) -> None:
    buttons = EvdevButtons(device.path, FakeClock())
    down = INPUT_EVENT.pack(1000, 0, 1, ENTER, 1)
    up = INPUT_EVENT.pack(1000, 100_000, 1, ENTER, 0)
    told: list[tuple[Button, PressKind]] = []
    for byte in down + up:
        device.send(bytes([byte]))
        told += kinds(buttons.pressed())
    assert told == [(Button.MAIN, PressKind.SHORT)]


def test_a_button_whose_release_was_lost_is_not_held_for_ever(device: InputDevice) -> None:
    clock = FakeClock()
    buttons = EvdevButtons(device.path, clock)
    device.key(1000.0, ENTER, 1)
    device.key(1000.1, SYN_DROPPED, 0, EV_SYN)
    clock.advance(5.0)
    assert buttons.pressed() == ()


@given(st.binary(max_size=24 * 20))
def test_any_bytes_do_no_harm(data: bytes) -> None:
    ours, theirs = os.pipe()
    try:
        buttons = EvdevButtons(f"/proc/self/fd/{ours}", FakeClock())
        os.write(theirs, data)
        for press in buttons.pressed():
            assert press.button in Button
        buttons.close()
    finally:
        os.close(ours)
        os.close(theirs)


def test_unplugged_buttons_are_an_error_and_come_back(device: InputDevice) -> None:
    clock = FakeClock(50.0)
    buttons = EvdevButtons(device.path, clock)
    device.key(1000.0, ENTER, 1)
    buttons.pressed()
    device.unplug()
    for _ in range(2):
        with pytest.raises(SensorError, match="gone: plug them in again"):
            buttons.pressed()
    clock.advance(LONGEST_BACKOFF_S)
    with pytest.raises(SensorError, match="no buttons at"):
        buttons.pressed()
    device.plug()
    clock.advance(LONGEST_BACKOFF_S)
    assert buttons.pressed() == (), "what was held when they went has come to nothing"
    device.key(5.0, RIGHT, 1)
    device.key(5.1, RIGHT, 0)
    assert kinds(buttons.pressed()) == [(Button.NEXT, PressKind.SHORT)]
    buttons.close()


def test_buttons_that_are_not_there_are_told_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(SensorError, match=r"no buttons at .*event9: plug them in"):
        EvdevButtons(str(tmp_path / "event9"), FakeClock())


@pytest.mark.parametrize("what", ["/dev/null", "a file", "a folder", "a terminal"])
def test_what_will_never_tell_of_a_press_is_refused(what: str, tmp_path: Path) -> None:
    (tmp_path / "a file").write_bytes(b"no events")
    (tmp_path / "a folder").mkdir()
    ours, theirs = os.openpty()
    path = {"/dev/null": what, "a terminal": os.ttyname(theirs)}.get(what, str(tmp_path / what))
    with pytest.raises(SensorError, match="is no input device: name one of /dev/input/event"):
        EvdevButtons(path, FakeClock())
    os.close(ours)
    os.close(theirs)


def test_a_device_is_one_of_buttons_where_it_has_one_of_their_keys() -> None:
    def bits(*codes: int) -> bytes:
        having = bytearray(96)
        for code in codes:
            having[code // 8] |= 1 << code % 8
        return bytes(having)

    for code in KEY_BUTTONS:
        assert has_any_key(bits(code), KEY_BUTTONS)
    assert not has_any_key(bits(116, 0x110, 0x118), KEY_BUTTONS), "a power button, a mouse"
    assert not has_any_key(b"", KEY_BUTTONS)


# ---------------------------------------------------------------------------------------------------- terminal
def test_keys_without_a_terminal_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = os.pipe()
    with os.fdopen(ours) as piped:
        for nothing in (piped, None):
            monkeypatch.setattr(sys, "stdin", nothing)
            with pytest.raises(SensorError, match=r"no terminal: start the device in a terminal, or name --buttons"):
                KeyboardButtons(SteppedClock())
    os.close(theirs)


def test_a_terminal_gives_its_keys_at_once_and_is_put_back() -> None:
    ours, theirs = os.openpty()
    before = termios.tcgetattr(theirs)
    buttons = KeyboardButtons(SteppedClock(7.0), theirs)
    sent = os.write(ours, b"x\x1b[Anm\nP\xff")
    eventually(lambda: waiting_bytes(theirs) == sent)
    assert kinds(buttons.pressed()) == [
        (Button.PREVIOUS, PressKind.SHORT),
        (Button.NEXT, PressKind.SHORT),
        (Button.MAIN, PressKind.SHORT),
        (Button.MAIN, PressKind.SHORT),
        (Button.PREVIOUS, PressKind.LONG),
    ]
    buttons.close()
    assert termios.tcgetattr(theirs) == before
    os.close(ours)
    os.close(theirs)


def test_a_terminal_that_is_closed_is_an_error() -> None:
    ours, theirs = os.pipe()
    buttons = KeyboardButtons(SteppedClock(), ours)
    os.write(theirs, b"m")
    assert kinds(buttons.pressed()) == [(Button.MAIN, PressKind.SHORT)]
    os.close(theirs)
    with pytest.raises(SensorError, match="keyboard has gone"):
        buttons.pressed()
    buttons.close()
    os.close(ours)


def test_an_arrow_that_comes_in_pieces_is_one_key_and_other_keys_are_none() -> None:
    assert keys_in("\x1b[") == ([], "\x1b[")
    assert keys_in("\x1b[C") == ([(Button.NEXT, PressKind.SHORT)], "")
    assert keys_in("\x1b") == ([], "\x1b"), "the escape key, or the beginning of an arrow"
    assert keys_in("\x1br") == ([(Button.REPEAT, PressKind.SHORT)], "")
    assert keys_in("\x1b[3~w") == ([(Button.REPEAT, PressKind.LONG)], "")


def test_every_button_has_a_short_and_a_long_press_on_keyboard_and_input_device() -> None:
    assert set(KEYS.values()) == {(button, kind) for button in Button for kind in PressKind}
    assert set(KEY_BUTTONS.values()) == set(Button)
