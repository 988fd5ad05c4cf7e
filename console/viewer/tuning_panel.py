"""Sliders for the settings of a device, made from the settings model.

A value is sent when it is let go, as a whole and validated here first; the panel says whether it was sent, runs, or
was refused, and what the device really runs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from console.errors import ConflictError
from console.hub import DeviceHub
from console.live import Command, LiveDevice
from console.roles import TUNING, SignedIn
from console.viewer.widgets import nothing, on_change, set_value
from console.viewer.wording import card
from navcore.errors import VbrError
from navcore.settings import Settings, SettingSpec, SettingValue, setting_specs

GROUPS = ("obstacle", "follower", "gate", "cues")
"""The groups that are worth a slider beside the scene; the settings page has them all."""
SETTLED_AFTER_S = 0.4
"""A slider that has not moved for so long has been let go."""
Tell = Callable[[str, str], None]


class TuningPanel:
    """Sliders of one client for one device at a time."""

    def __init__(self, client: viser.ClientHandle, hub: DeviceHub, person: SignedIn, tell: Tell) -> None:
        self._hub = hub
        self._person = person
        self._tell = tell
        self._device: LiveDevice | None = None
        self._pending: dict[str, SettingValue] = {}
        self._touched_s = 0.0
        self._shown_revision: tuple[str, int, int] | None = None
        self._widgets: dict[str, Any] = {}
        gui = client.gui
        self._words = gui.add_html(card("No device has told its settings yet."))
        for group in GROUPS:
            specs = [spec for spec in setting_specs() if spec.group == group]
            with gui.add_folder(specs[0].group_title, expand_by_default=False):
                for spec in specs:
                    self._add(gui, spec)

    def _add(self, gui: viser.GuiApi, spec: SettingSpec) -> None:
        widget = _widget(gui, spec)
        self._widgets[spec.key] = widget
        on_change(widget, lambda: self._touch(spec.key, widget.value), nothing)

    def _touch(self, key: str, value: SettingValue) -> None:
        self._pending[key] = value
        self._touched_s = self._hub.now_s()

    def tick(self, device: LiveDevice | None) -> None:
        """Send what was let go, and show what the device runs."""
        if self._pending and self._hub.now_s() - self._touched_s >= SETTLED_AFTER_S:
            self._send(dict(self._pending))
            self._pending.clear()
        self._show(device)

    def _send(self, changes: dict[str, SettingValue]) -> None:
        try:
            if self._person.role not in TUNING:
                raise ConflictError("Your role may not change settings: ask a technician.")
            device = self._device
            if device is None or device.settings is None:
                raise ConflictError("No device has told its settings yet: wait until one is connected.")
            values = Settings().changed(device.settings).changed(changes).values()
            self._hub.apply_settings(device.device_id, next_revision(device), values, self._person.user_name)
        except VbrError as error:
            self._tell("Not sent", str(error))
            self._shown_revision = None

    def _show(self, device: LiveDevice | None) -> None:
        self._device = device
        if device is None or device.settings is None:
            return
        last = last_apply(device)
        self._words.content = card(words(device, last))
        # Sliders follow the device when it runs, or has refused, something new: never while somebody moves one.
        seen = device.device_id, device.settings_revision, last.id if last is not None and last.state != "sent" else 0
        if self._pending or seen == self._shown_revision:
            return
        self._shown_revision = seen
        for key, widget in self._widgets.items():
            if key in device.settings and (last is None or last.state != "sent"):
                set_value(widget, device.settings[key])


def _widget(gui: viser.GuiApi, spec: SettingSpec) -> Any:
    label = spec.name.rsplit("_", 1)[0].replace("_", " ") if spec.unit else spec.name.replace("_", " ")
    label = f"{label} ({spec.unit})" if spec.unit else label
    hint = f"{spec.meaning} {spec.source}. {spec.range_text().capitalize()}."
    if spec.choices:
        return gui.add_dropdown(label, spec.choices, initial_value=str(spec.default), hint=hint)
    if spec.kind == "bool" or spec.low is None or spec.high is None:
        return gui.add_checkbox(label, bool(spec.default), hint=hint)
    number = int if spec.kind == "int" else float
    low, high, step = number(spec.low), number(spec.high), number(spec.step or (spec.high - spec.low) / 100)
    return gui.add_slider(label, low, high, step, number(spec.default), hint=hint)


def next_revision(device: LiveDevice) -> int:
    """Return a revision number that this device has not seen yet."""
    asked = [int(c.detail) for c in device.commands if c.kind == "apply_settings" and c.detail.isdigit()]
    return max([device.settings_revision, *asked]) + 1


def last_apply(device: LiveDevice) -> Command | None:
    """Return the latest change of settings that was asked for."""
    return next((c for c in reversed(device.commands) if c.kind == "apply_settings"), None)


def words(device: LiveDevice, last: Command | None) -> str:
    """Return what became of the latest change, in one sentence."""
    if last is None or last.state == "running":
        return f"{device.name} runs revision {device.settings_revision}."
    if last.state == "sent":
        return f"Sent revision {last.detail}: waiting for {device.name}."
    if last.state == "refused":
        return f"Refused: {last.refusal} {device.name} runs revision {device.settings_revision}."
    return f"Revision {last.detail} was not answered; {device.name} runs revision {device.settings_revision}."
