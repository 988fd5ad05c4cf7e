"""Changing the settings of a device: checked here first, numbered, written to the audit log, then sent.

What people's safety hangs on needs a confirmation, is tried out before it is kept, and is locked while somebody is led
unless somebody says why. The device enforces lock and trial itself; here people are told sooner.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from console.errors import BadRequestError, ConflictError
from console.hub import DeviceHub
from console.live import Command, LiveDevice
from console.settings_store import SettingsStore
from navcore.settings import Settings, SettingValue, safety_changes

TRIAL_S = 60.0
"""So long something that safety hangs on runs unless it is kept."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """What somebody said to a change."""

    why: str = ""
    confirmed: bool = False
    """They have confirmed a change of what people's safety hangs on."""
    override_reason: str = ""
    """Why that is changed though somebody is being led."""
    trial_s: float = TRIAL_S
    """How long what safety hangs on is tried out."""


@dataclass(frozen=True, slots=True)
class Draft:
    """What changes would do to the settings that a device runs."""

    before: Mapping[str, SettingValue]
    after: Mapping[str, SettingValue]
    safety: tuple[str, ...]
    """Settings among them that people's safety hangs on."""

    @property
    def changes(self) -> dict[str, tuple[SettingValue, SettingValue]]:
        """From and to, of what really changes."""
        return {key: (old, self.after[key]) for key, old in self.before.items() if old != self.after[key]}


class Tuning:
    """Sends changed settings to devices; pages and scene both go through it. May be used from any thread."""

    def __init__(self, settings: SettingsStore, hub: DeviceHub) -> None:
        self._settings = settings
        self._hub = hub

    def draft(self, device_id: str, changes: Mapping[str, SettingValue]) -> Draft:
        """Return what changes would do. Raises SettingError for what is out of range or order, NotFoundError."""
        before = Settings().changed(self.running_values(self._hub.device(device_id)))
        after = before.changed(changes)
        return Draft(before.values(), after.values(), safety_changes(before, after))

    def change(
        self, device_id: str, changes: Mapping[str, SettingValue], who: str, confirmation: Confirmation | None = None
    ) -> Command:
        """Have a device run its settings with these changes, all or none; the command's detail is the revision.

        Raises SettingError for what is out of range or order, BadRequestError where a change of what people's safety
        hangs on was not confirmed, NotFoundError or ConflictError where the device is unknown or away, tries something
        out, or leads somebody.
        """
        confirmation = confirmation or Confirmation()
        device, draft = self._hub.device(device_id), self.draft(device_id, changes)
        if draft.safety and not confirmation.confirmed:
            raise BadRequestError(f"People's safety hangs on {', '.join(draft.safety)}: confirm the change.")
        self._hub.require_connected(device_id)
        self._refuse_untimely(device, draft, confirmation)
        revert_after_s = confirmation.trial_s if draft.safety else 0.0
        override = confirmation.override_reason if draft.safety and device.leads_somebody else ""
        revision = self._settings.add(
            device_id, who, confirmation.why, draft.before, draft.after, newer_than=device.settings_revision,
            revert_after_s=revert_after_s, override_reason=override,
        )  # fmt: skip
        return self._hub.apply_settings(device_id, revision.revision, draft.after, who, revert_after_s, override)

    def back_to(self, device_id: str, revision: int, who: str, confirmation: Confirmation) -> Command:
        """Have a device run an earlier revision again, as a new one. Raises what :meth:`change` raises."""
        earlier = self._settings.revision(device_id, revision)
        known = Settings().values()
        wanted = {key: value for key, value in earlier.values.items() if key in known}
        if not self.draft(device_id, wanted).changes:
            raise BadRequestError(f"The device runs the values of revision {revision} already.")
        why = f"Back to revision {revision}. {confirmation.why}".strip()
        said = Confirmation(why, confirmation.confirmed, confirmation.override_reason, confirmation.trial_s)
        return self.change(device_id, wanted, who, said)

    def keep(self, device_id: str, revision: int, who: str, *, keep: bool) -> Command:
        """Have a device keep what it tries out, or give it up. Raises NotFoundError or ConflictError."""
        device = self._hub.device(device_id)
        if device.settings_revert_at_s is None or device.settings_revision != revision:
            raise ConflictError(f"{device.name} does not try out revision {revision} any more: apply it anew.")
        return self._hub.keep_settings(device_id, revision, who, keep=keep)

    def running_values(self, device: LiveDevice) -> dict[str, SettingValue]:
        """Return the settings that a device runs, as far as is known: told, else asked for last, else the defaults."""
        known: Mapping[str, SettingValue] = device.settings or {}
        if device.settings is None:
            wanted = self._settings.wanted_revision(device.device_id)
            known = wanted.values if wanted is not None else {}
        return {key: known.get(key, value) for key, value in Settings().values().items()}

    def _refuse_untimely(self, device: LiveDevice, draft: Draft, confirmation: Confirmation) -> None:
        if device.settings_revert_at_s is not None:
            raise ConflictError(
                f"{device.name} tries out revision {device.settings_revision}: keep it or give it up first."
            )
        if draft.safety and device.leads_somebody and not confirmation.override_reason:
            raise ConflictError(
                f"Somebody is being led, and people's safety hangs on {', '.join(draft.safety)}: wait until they stand"
                " at their destination, or say why it must be changed now."
            )
