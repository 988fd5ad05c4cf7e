"""Sliders for the settings of a device, made from the settings model.

A value is sent when it is let go; what people's safety hangs on only once that is confirmed, and it is tried out until
somebody keeps it, here or on the settings page. The panel says whether the change was sent, runs, or was refused, and
what the device really runs. What is locked while somebody is led is refused here: only the settings page asks why.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from console.errors import ConflictError, ForbiddenError
from console.hub import DeviceHub
from console.live import Command, LiveDevice
from console.roles import TUNING, SignedIn
from console.tuning import Confirmation, Tuning
from console.viewer.widgets import at_once, on_change, on_press, set_value
from console.viewer.wording import card
from navcore.errors import VbrError
from navcore.settings import SettingSpec, SettingValue, setting_specs

GROUPS = ("obstacle", "follower", "gate", "cues")
"""The groups that are worth a slider beside the scene; the settings page has them all."""
SETTLED_AFTER_S = 0.4
"""A slider that has not moved for so long has been let go."""
Tell = Callable[[str, str], None]
_SPECS = {spec.key: spec for spec in setting_specs()}


class TuningPanel:
    """Sliders of one client for one device at a time."""

    def __init__(
        self, client: viser.ClientHandle, hub: DeviceHub, tuning: Tuning, person: SignedIn, tell: Tell
    ) -> None:
        self._hub = hub
        self._tuning = tuning
        self._person = person
        self._tell = tell
        self._device: LiveDevice | None = None
        self._moved: dict[str, SettingValue] = {}
        self._moved_s = 0.0
        self._to_confirm: dict[str, SettingValue] = {}
        self._shown: tuple[str, int, int] | None = None
        self._widgets: dict[str, Any] = {}
        gui = client.gui
        self._words = gui.add_html(card("No device has told its settings yet."))
        self._add_confirmation(gui)
        self._add_trial(gui)
        for group in GROUPS:
            specs = [spec for spec in setting_specs() if spec.group == group]
            with gui.add_folder(specs[0].group_title, expand_by_default=False):
                for spec in specs:
                    self._add(gui, spec)

    def _add_confirmation(self, gui: viser.GuiApi) -> None:
        self._confirmation = gui.add_folder("People's safety hangs on this", visible=False)
        with self._confirmation:
            self._question = gui.add_html("")
            send = gui.add_button("Send it", icon=viser.Icon.CHECK, color="orange")
            back = gui.add_button("Take it back", color="gray")
        on_press(send, self._confirm, at_once)
        on_press(back, self._take_back, at_once)

    def _add_trial(self, gui: viser.GuiApi) -> None:
        self._trial = gui.add_folder("Being tried out", visible=False)
        with self._trial:
            self._left = gui.add_html("")
            keep = gui.add_button("Keep it", icon=viser.Icon.CHECK, color="green")
            back = gui.add_button("Go back now", color="gray")
        on_press(keep, lambda: self._end_trial(keep=True), at_once)
        on_press(back, lambda: self._end_trial(keep=False), at_once)

    def _add(self, gui: viser.GuiApi, spec: SettingSpec) -> None:
        widget = _widget(gui, spec)
        self._widgets[spec.key] = widget

        def move() -> None:
            self._moved[spec.key] = widget.value
            self._moved_s = self._hub.now_s()

        on_change(widget, move, at_once)

    # ----------------------------------------------------------------------------------------------- sending
    def tick(self, device: LiveDevice | None) -> None:
        """Send what was let go, and show what the device runs."""
        self._device = device
        if self._moved and self._hub.now_s() - self._moved_s >= SETTLED_AFTER_S:
            self._let_go()
        self._show()

    def _let_go(self) -> None:
        changes, self._moved = self._to_confirm | self._moved, {}
        if any(_SPECS[key].safety for key in changes):
            self._to_confirm = changes
            self._question.content = card("; ".join(_change_words(key, value) for key, value in changes.items()))
            self._confirmation.visible = True
        else:
            self._send(changes, confirmed=False)

    def _confirm(self) -> None:
        changes = self._to_confirm
        self._forget()
        self._send(changes, confirmed=True)

    def _take_back(self) -> None:
        self._forget()
        self._shown = None

    def _forget(self) -> None:
        self._to_confirm = {}
        self._confirmation.visible = False

    def _send(self, changes: dict[str, SettingValue], *, confirmed: bool) -> None:
        confirmation = Confirmation(confirmed=confirmed)
        self._do(lambda device: self._tuning.change(device.device_id, changes, self._person.user_name, confirmation))

    def _end_trial(self, *, keep: bool) -> None:
        self._do(
            lambda device: self._tuning.keep(
                device.device_id, device.settings_revision, self._person.user_name, keep=keep
            )
        )

    def _do(self, act: Callable[[LiveDevice], Command]) -> None:
        try:
            if self._person.role not in TUNING:
                raise ForbiddenError("Your role may not change settings: ask a technician.")
            if self._device is None:
                raise ConflictError("No device has connected yet: try again when one has.")
            act(self._device)
            self._device = self._hub.device(self._device.device_id)
        except VbrError as error:
            self._tell("Not sent", str(error))
            self._shown = None

    # ----------------------------------------------------------------------------------------------- showing
    def _show(self) -> None:
        device = self._device
        if device is None or device.settings is None:
            return
        left_s = device.trial_left_s(self._hub.now_s())
        self._trial.visible = left_s is not None
        if left_s is not None:
            self._left.content = card(
                f"Revision {device.settings_revision} runs for {left_s:.0f} s more, and then what ran before."
            )
        last = last_change(device)
        self._words.content = card(words(device, last))
        waiting = last is not None and last.state == "sent"
        seen = device.device_id, device.settings_revision, last.id if last is not None else 0
        # Sliders follow the device when it runs, or has refused, something new: never while somebody moves one.
        busy = self._moved or self._to_confirm or (waiting and self._shown is not None)
        if busy or seen == self._shown:
            return
        self._shown = seen
        for key, widget in self._widgets.items():
            if key in device.settings:
                set_value(widget, device.settings[key])


def _widget(gui: viser.GuiApi, spec: SettingSpec) -> Any:
    label = (spec.name.rsplit("_", 1)[0] if spec.unit else spec.name).replace("_", " ").capitalize()
    label = f"{label}, {spec.unit}" if spec.unit else label
    hint = f"{spec.meaning} ({spec.source}) {spec.range_text().capitalize()}."
    if spec.choices:
        return gui.add_dropdown(label, spec.choices, initial_value=str(spec.default), hint=hint)
    if spec.kind == "bool" or spec.low is None or spec.high is None:
        return gui.add_checkbox(label, bool(spec.default), hint=hint)
    number = int if spec.kind == "int" else float
    step = number(spec.step or (spec.high - spec.low) / 100)
    return gui.add_slider(label, number(spec.low), number(spec.high), step, number(spec.default), hint=hint)


def _change_words(key: str, value: SettingValue) -> str:
    spec = _SPECS[key]
    number = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{spec.group_title}: {spec.name.replace('_', ' ')} = {number}"


def last_change(device: LiveDevice) -> Command | None:
    """Return the latest change of settings that was asked for."""
    return next((c for c in reversed(device.commands) if c.kind == "apply_settings"), None)


def words(device: LiveDevice, last: Command | None) -> str:
    """Return what became of the latest change, in one sentence."""
    running = f"{device.name} runs revision {device.settings_revision}."
    if last is None or last.state == "running":
        return running
    if last.state == "sent":
        return f"Sent revision {last.detail}: waiting for {device.name}."
    if last.state == "refused":
        return f"Refused: {last.refusal} {running}"
    return f"Revision {last.detail} was not answered. {running}"
