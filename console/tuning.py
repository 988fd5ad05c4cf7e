"""Changing the settings of a device: checked here first, numbered, written to the audit log, then sent."""

from __future__ import annotations

from collections.abc import Mapping

from console.device_store import DeviceStore
from console.errors import BadRequestError
from console.hub import DeviceHub
from console.live import Command, LiveDevice
from navcore.settings import Settings, SettingValue, setting_specs


class Tuning:
    """Sends changed settings to devices; pages and scene both go through it. May be used from any thread."""

    def __init__(self, devices: DeviceStore, hub: DeviceHub) -> None:
        self._devices = devices
        self._hub = hub

    def change(
        self,
        device_id: str,
        changes: Mapping[str, SettingValue],
        who: str,
        why: str = "",
        *,
        confirmed: bool = False,
    ) -> Command:
        """Have a device run its settings with these changes, all or none; the command's detail is the revision.

        Raises SettingError for what is out of range, BadRequestError where a change of what people's safety hangs on
        was not confirmed, NotFoundError or ConflictError where the device is unknown or away.
        """
        device = self._hub.device(device_id)
        before = self.running_values(device)
        after = Settings().changed(before).changed(changes).values()
        risky = [spec.key for spec in setting_specs() if spec.safety and before[spec.key] != after[spec.key]]
        if risky and not confirmed:
            raise BadRequestError(f"People's safety hangs on {', '.join(risky)}: confirm the change.")
        self._hub.require_connected(device_id)
        revision = self._devices.add_revision(device_id, who, why, before, after, device.settings_revision)
        return self._hub.apply_settings(device_id, revision.revision, after, who)

    def running_values(self, device: LiveDevice) -> dict[str, SettingValue]:
        """Return the settings that a device runs, as far as is known: told, else asked for last, else the defaults."""
        known: Mapping[str, SettingValue] = device.settings or {}
        if device.settings is None:
            wanted = self._devices.wanted_revision(device.device_id)
            known = wanted.values if wanted is not None else {}
        return {key: known.get(key, value) for key, value in Settings().values().items()}
