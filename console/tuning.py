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
from navcore.wire import ApplySettings

TRIAL_S = 60.0
"""So long something that safety hangs on runs unless it is kept."""
MAX_BELIEVED_REVISION = 1 << 40
"""No console counts so far. The numbers are counted for all devices together, and what one device claims to run must
not use up those that the wire has for the others."""


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
        """Return what changes would do. Raises SettingError for what is out of range or order, NotFoundError.

        Raises ConflictError where the device has not told what it runs: what is not known is not changed.
        """
        return _draft(self._hub.device(device_id), changes)

    def change(
        self,
        device_id: str,
        changes: Mapping[str, SettingValue],
        who: str,
        confirmation: Confirmation | None = None,
        seen_revision: int | None = None,
    ) -> Command:
        """Have a device run its settings with these changes, all or none; the command's detail is the revision.

        ``seen_revision`` is what ran when somebody decided on them; None: they decided on whatever runs now. Raises
        SettingError for what is out of range or order, BadRequestError where a change of what people's safety hangs on
        was not confirmed, NotFoundError or ConflictError where the device is unknown or away, has not told what it
        runs, runs something else by now, tries something out, or leads somebody.
        """
        confirmation = confirmation or Confirmation()
        device = self._hub.device(device_id)
        if seen_revision not in (None, device.settings_revision):
            raise ConflictError(
                f"{device.name} runs revision {device.settings_revision} by now: look at what was changed, and apply it"
                " anew."
            )
        draft = _draft(device, changes)
        if draft.safety and not confirmation.confirmed:
            raise BadRequestError(f"People's safety hangs on {', '.join(draft.safety)}: confirm the change.")
        self._hub.require_connected(device_id)
        self._refuse_untimely(device, draft, confirmation)
        revert_after_s = confirmation.trial_s if draft.safety else 0.0
        override = confirmation.override_reason if draft.safety and device.leads_somebody else ""
        revision = self._settings.add(
            device_id, who, confirmation.why, draft.before, draft.after, newer_than=_believed(device.settings_revision),
            revert_after_s=revert_after_s, override_reason=override,
        )  # fmt: skip
        # What is not changed is not sent: whoever changed it in the meantime is not undone.
        order = ApplySettings(
            revision.revision, {key: after for key, (_, after) in draft.changes.items()}, revert_after_s, override,
            base_revision=device.settings_revision,
        )  # fmt: skip
        return self._hub.apply_settings(device_id, order, who)

    def back_to(
        self, device_id: str, revision: int, who: str, confirmation: Confirmation, seen_revision: int | None = None
    ) -> Command:
        """Have a device run an earlier revision again, as a new one. Raises what :meth:`change` raises."""
        earlier = self._settings.revision(device_id, revision)
        known = Settings().values()
        wanted = {key: value for key, value in earlier.values.items() if key in known}
        if not self.draft(device_id, wanted).changes:
            raise BadRequestError(f"The device runs the values of revision {revision} already.")
        why = f"Back to revision {revision}. {confirmation.why}".strip()
        said = Confirmation(why, confirmation.confirmed, confirmation.override_reason, confirmation.trial_s)
        return self.change(device_id, wanted, who, said, seen_revision)

    def keep(self, device_id: str, revision: int, who: str, *, keep: bool) -> Command:
        """Have a device keep what it tries out, or give it up. Raises NotFoundError or ConflictError."""
        device = self._hub.device(device_id)
        if device.settings_revert_at_s is None or device.settings_revision != revision:
            raise ConflictError(f"{device.name} does not try out revision {revision} any more: apply it anew.")
        return self._hub.keep_settings(device_id, revision, who, keep=keep)

    def running_values(self, device: LiveDevice) -> dict[str, SettingValue]:
        """Return the settings that a device runs, as far as is known: told, else kept last, else the defaults.

        For people to look at: only what the device has told is changed.
        """
        known: Mapping[str, SettingValue] = device.settings or {}
        if device.settings is None:
            wanted = self._settings.wanted_revision(device.device_id)
            known = wanted.values if wanted is not None else {}
        return _completed(known)

    def told_values(self, device_id: str) -> dict[str, SettingValue]:
        """Return the settings that a device has told. Raises NotFoundError, or ConflictError where it has not."""
        return _told(self._hub.device(device_id))

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


def _believed(revision: int) -> int:
    return revision if revision <= MAX_BELIEVED_REVISION else 0


def _draft(device: LiveDevice, changes: Mapping[str, SettingValue]) -> Draft:
    before = Settings().changed(_told(device))
    after = before.changed(changes)
    return Draft(before.values(), after.values(), safety_changes(before, after))


def _told(device: LiveDevice) -> dict[str, SettingValue]:
    if device.settings is None:
        raise ConflictError(f"{device.name} has not told yet what it runs: wait until it is connected, then try again.")
    return _completed(device.settings)


def _completed(known: Mapping[str, SettingValue]) -> dict[str, SettingValue]:
    """A device of another version may not have all settings, or more."""
    return {key: known.get(key, value) for key, value in Settings().values().items()}
