"""Changing settings on the device: what safety hangs on is tried out first, and runs on only where somebody keeps it.

The timer is the device's own: where the console is gone, or the browser, the settings before run again by themselves.
What is tried out is never on the disk, so a device that starts anew runs what was kept. Pure.
"""

from __future__ import annotations

from dataclasses import replace

from device_agent.state import (
    DeviceState,
    Effect,
    Happened,
    Notice,
    RunSettings,
    SettingsTrial,
    Step,
    StoreSettings,
)
from navcore.cues.texts import TEXTS
from navcore.errors import SettingError
from navcore.settings import safety_changes
from navcore.wire import ApplySettings, KeepSettings, SettingsRunning

TRIAL_S = 60.0
"""So long the device tries out what safety hangs on where an order does not say for how long."""
_TRIED_OUT = "Other settings are being tried out: keep them or give them up first."
_CHANGED_MEANWHILE = (
    "It changes revision {base}, and revision {running} runs by now: look at what runs, and apply it anew."
)
_LOCKED = (
    "Somebody is being led, and people's safety hangs on {keys}: wait until they stand at their destination, or say why"
    " it must be changed now."
)


def apply_settings(state: DeviceState, order: ApplySettings, now_s: float) -> Step:
    """Return the state with other settings, all of them or none.

    For a while only where the order says so, or where safety hangs on one of them: whoever orders, the device has that
    tried out, unless it ran and was kept before.
    """
    if state.trial is not None:
        return state, (_refused(state, order.revision, _TRIED_OUT),)
    if order.base_revision not in (None, state.settings_revision):
        why = _CHANGED_MEANWHILE.format(base=order.base_revision, running=state.settings_revision)
        return state, (_refused(state, order.revision, why),)
    try:
        settings = state.settings.changed(order.values)
    except SettingError as error:
        return state, (_refused(state, order.revision, str(error)),)
    critical = safety_changes(state.settings, settings)
    if critical and state.leading and not order.override_reason.strip():
        return state, (_refused(state, order.revision, _LOCKED.format(keys=", ".join(critical))),)
    told = _told_under_way(state, order) if critical else ()
    trial_s = order.revert_after_s or (TRIAL_S if critical and not order.kept_before else 0.0)
    before = SettingsTrial(state.settings, state.settings_revision, now_s + trial_s)
    state = replace(state, settings=settings, settings_revision=order.revision)
    if trial_s > 0.0:
        state = replace(state, trial=before)
        return state, (*told, RunSettings(settings), running(state))
    return state, (*told, RunSettings(settings), StoreSettings(settings, order.revision), running(state))


def keep_settings(state: DeviceState, order: KeepSettings) -> Step:
    """Return the state with the settings that are tried out kept, or given up; others are not touched."""
    if state.settings_revision != order.revision:
        return state, (_refused(state, order.revision, "It does not run any more, and cannot be kept: apply it anew."),)
    if state.trial is None:
        return state, (running(state),)
    if not order.keep:
        return _given_up(state, state.trial, "was given up")
    state = replace(state, trial=None)
    return state, (StoreSettings(state.settings, state.settings_revision), running(state))


def after_trial(state: DeviceState, now_s: float) -> Step:
    """Return the state with the settings from before, once those that are tried out have not been kept in time."""
    if state.trial is None or now_s < state.trial.until_s:
        return state, ()
    return _given_up(state, state.trial, "was not kept in time")


def running(state: DeviceState) -> SettingsRunning:
    """Return what the console is told of the settings that run."""
    revert_at_s = None if state.trial is None else state.trial.until_s
    return SettingsRunning(state.settings_revision, state.settings.values(), revert_at_s=revert_at_s)


def _refused(state: DeviceState, revision: int, why: str) -> SettingsRunning:
    revert_at_s = None if state.trial is None else state.trial.until_s
    return SettingsRunning(state.settings_revision, state.settings.values(), revision, why[:500], revert_at_s)


def _given_up(state: DeviceState, trial: SettingsTrial, why: str) -> Step:
    revision = state.settings_revision
    text = f"Revision {revision} of the settings {why}: revision {trial.before_revision} runs again."
    state = replace(state, settings=trial.before, settings_revision=trial.before_revision, trial=None)
    said: tuple[Effect, ...] = ()
    if state.leading:
        said = (Notice(TEXTS[state.settings.cues.language]["settings_back"]),)
    return state, (*said, RunSettings(state.settings), Happened("mode", text), _refused(state, revision, text))


def _told_under_way(state: DeviceState, order: ApplySettings) -> tuple[Effect, ...]:
    """Whoever is led hears that something about their safety changes, and that it was meant."""
    if not state.leading:
        return ()
    text = f"Revision {order.revision} of the settings while somebody is led: {order.override_reason}"
    return Notice(TEXTS[state.settings.cues.language]["settings_changing"]), Happened("mode", text[:500])
