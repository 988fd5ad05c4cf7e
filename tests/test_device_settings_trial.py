"""What safety hangs on is tried out: the device itself goes back to what ran before, whatever the console does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from device_hall import Rig
from hypothesis import given
from hypothesis import strategies as st

from device_agent.device_store import DeviceStore
from device_agent.orders import carry_out
from device_agent.settings_trial import TRIAL_S, after_trial
from device_agent.state import DeviceState, Happened, Notice, RunSettings, StoreSettings
from navcore.cues.texts import TEXTS
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.wire import ApplySettings, KeepSettings, SettingsRunning

DELTA = "gate.clearance_m"
STANDING = DeviceState(Settings(), PoiGraph(), settings_revision=4, mode=Mode.READY)
LED = replace(STANDING, mode=Mode.GUIDING, destination_id="b")


def tried(state: DeviceState = STANDING, at_s: float = 100.0, **more: object) -> tuple[DeviceState, tuple[object, ...]]:
    order = ApplySettings(5, {DELTA: 1.5}, revert_after_s=60.0, **more)  # type: ignore[arg-type]
    return carry_out(state, order, at_s)


def answers(effects: tuple[object, ...]) -> SettingsRunning:
    (found,) = [effect for effect in effects if isinstance(effect, SettingsRunning)]
    return found


def test_what_is_tried_out_runs_at_once_and_is_not_on_the_disk() -> None:
    state, effects = tried()
    assert state.settings.gate.clearance_m == 1.5
    assert [type(effect) for effect in effects] == [RunSettings, SettingsRunning]
    told = answers(effects)
    assert (told.revision, told.revert_at_s, told.values[DELTA]) == (5, 160.0, 1.5)
    kept, effects = carry_out(state, KeepSettings(5), 159.0)
    assert kept.trial is None
    assert [type(effect) for effect in effects] == [StoreSettings, SettingsRunning]
    assert answers(effects).revert_at_s is None
    assert after_trial(kept, 1e6) == (kept, ())
    assert answers(carry_out(kept, KeepSettings(5), 170.0)[1]).refused_revision is None, "kept twice is kept"


def test_what_is_not_kept_in_time_gives_way_to_what_ran_before() -> None:
    state, _ = tried()
    assert after_trial(state, 159.9) == (state, ())
    back, effects = after_trial(state, 160.0)
    assert (back.settings, back.settings_revision, back.trial) == (STANDING.settings, 4, None)
    told = answers(effects)
    assert (told.revision, told.refused_revision, told.revert_at_s) == (4, 5, None)
    assert told.refusal == "Revision 5 of the settings was not kept in time: revision 4 runs again."
    assert Happened("mode", told.refusal) in effects
    assert not any(isinstance(effect, (StoreSettings, Notice)) for effect in effects)
    late = answers(carry_out(back, KeepSettings(5), 161.0)[1])
    assert (late.revision, late.refused_revision) == (4, 5)
    assert "apply it anew" in late.refusal
    at_once, effects = carry_out(state, KeepSettings(5, keep=False), 101.0)
    assert (at_once.settings, answers(effects).refusal) == (STANDING.settings, told.refusal.replace(
        "was not kept in time", "was given up"))  # fmt: skip


def test_while_something_is_tried_out_nothing_else_is_changed() -> None:
    state, _ = tried()
    same, effects = carry_out(state, ApplySettings(6, {"cues.announce_m": 8.0}), 110.0)
    assert same is state
    told = answers(effects)
    assert (told.revision, told.refused_revision, told.revert_at_s) == (5, 6, 160.0)
    assert "keep them or give them up first" in told.refusal


@pytest.mark.parametrize(
    ("mode", "beneath", "locked"),
    [
        (Mode.GUIDING, None, True), (Mode.LOST, None, True), (Mode.FAULT, Mode.GUIDING, True),
        (Mode.PAUSED, None, True), (Mode.FAULT, Mode.PAUSED, True),
        (Mode.READY, None, False), (Mode.FAULT, Mode.READY, False), (Mode.ARRIVED, None, False),
    ],
)  # fmt: skip
def test_what_safety_hangs_on_is_locked_while_somebody_is_led(mode: Mode, beneath: Mode | None, locked: bool) -> None:
    before = replace(LED, mode=mode, beneath=beneath)
    state, effects = tried(before)
    assert (state is before) == locked
    assert (answers(effects).refused_revision == 5) == locked
    if locked:
        assert f"hangs on {DELTA}: wait until" in answers(effects).refusal
    allowed, effects = carry_out(before, ApplySettings(6, {"cues.announce_m": 8.0}), 100.0)
    assert allowed.settings.cues.announce_m == 8.0, "nobody's safety hangs on it"
    assert not any(isinstance(effect, Notice) for effect in effects)


def test_the_device_itself_has_tried_out_what_safety_hangs_on_whoever_orders_it() -> None:
    state, effects = carry_out(STANDING, ApplySettings(5, {DELTA: 1.5}), 100.0)
    assert state.settings.gate.clearance_m == 1.5
    assert not any(isinstance(effect, StoreSettings) for effect in effects), "nobody has kept it"
    assert answers(effects).revert_at_s == 100.0 + TRIAL_S
    back, _ = after_trial(state, 100.0 + TRIAL_S)
    assert (back.settings, back.settings_revision) == (STANDING.settings, 4)
    lost = replace(STANDING, settings_revision=0)
    again, effects = carry_out(lost, ApplySettings(5, {DELTA: 1.5}, base_revision=0, kept_before=True), 100.0)
    assert (again.trial, again.settings.gate.clearance_m) == (None, 1.5)
    assert any(isinstance(effect, StoreSettings) for effect in effects)
    led = replace(LED, settings_revision=0)
    same, effects = carry_out(led, ApplySettings(5, {DELTA: 1.5}, base_revision=0, kept_before=True), 100.0)
    assert (same is led, answers(effects).refused_revision) == (True, 5), "locked, whoever kept it"
    blank, effects = carry_out(LED, ApplySettings(5, {DELTA: 1.5}, 60.0, "   "), 100.0)
    assert (blank is LED, answers(effects).refused_revision) == (True, 5), "blanks say nothing"


def test_a_change_of_what_does_not_run_any_more_is_refused_whole() -> None:
    state, _ = carry_out(STANDING, ApplySettings(5, {"cues.announce_m": 8.0}, base_revision=4), 100.0)
    assert state.settings_revision == 5
    same, effects = carry_out(state, ApplySettings(6, {"follower.policy": "paper"}, base_revision=4), 101.0)
    told = answers(effects)
    assert (same is state, told.revision, told.refused_revision) == (True, 5, 6)
    assert told.refusal.startswith("It changes revision 4, and revision 5 runs by now: look")


def test_an_override_is_told_to_whoever_walks_and_kept_with_its_reason() -> None:
    state, effects = tried(LED, override_reason="Rain on the glass doors.")
    assert state.settings.gate.clearance_m == 1.5
    assert Notice(TEXTS["en"]["settings_changing"]) in effects
    (happened,) = [effect for effect in effects if isinstance(effect, Happened)]
    assert happened.text.endswith("while somebody is led: Rain on the glass doors.")
    _, effects = after_trial(state, 160.0)
    assert Notice(TEXTS["en"]["settings_back"]) in effects


steps = st.one_of(
    st.builds(
        lambda value, s, why: ("apply", value, s, why),
        st.sampled_from([0.5, 1.5, 2.5, 99.0]), st.sampled_from([0.0, 10.0]), st.sampled_from(["", "Because."]),
    ),
    st.builds(lambda back, keep: ("keep", back, keep), st.integers(0, 3), st.booleans()),
    st.builds(lambda s: ("wait", s), st.sampled_from([1.0, 9.9, 10.0])),
    st.sampled_from([("walks",), ("stands",), ("restarts",)]),
)  # fmt: skip


@given(st.lists(steps, max_size=20))
def test_whatever_happens_the_device_runs_what_it_told_last_and_keeps_only_what_was_kept(
    happenings: list[tuple[object, ...]],
) -> None:
    """Any order of applying, keeping, waiting, walking and starting anew: no value runs that was not told, none is on
    the disk that was only tried out, and once time has passed what is on the disk runs."""
    state, now_s, revision = STANDING, 0.0, 4
    disk, told = (Settings(), 4), SettingsRunning(4, Settings().values())

    def do(step: tuple[DeviceState, tuple[object, ...]]) -> None:
        nonlocal state, disk, told
        state, effects = step
        for effect in effects:
            if isinstance(effect, StoreSettings):
                assert kind == "keep" or effect.settings == disk[0], "somebody has kept it"
                disk = effect.settings, effect.revision
            if isinstance(effect, SettingsRunning):
                told = effect

    kind = ""
    for kind, *details in happenings:
        if kind == "apply":
            value, revert_after_s, why = details
            revision += 1
            values = {DELTA: value}
            do(carry_out(state, ApplySettings(revision, values, revert_after_s, why), now_s))  # type: ignore[arg-type]
            assert told.revision == revision or told.refused_revision == revision, "every order is answered"
        elif kind == "keep":
            back, keep = details
            do(carry_out(state, KeepSettings(max(0, revision - int(back)), keep), now_s))  # type: ignore[call-overload, arg-type]
        elif kind == "wait":
            now_s += details[0]  # type: ignore[operator]
        elif kind == "restarts":
            state = DeviceState(disk[0], PoiGraph(), settings_revision=disk[1], mode=Mode.READY)
            told = SettingsRunning(disk[1], disk[0].values())
        else:
            state = replace(state, mode=Mode.GUIDING if kind == "walks" else Mode.READY)
        do(after_trial(state, now_s))
        assert (told.revision, told.values) == (state.settings_revision, state.settings.values())
        assert (told.revert_at_s is None) == (state.trial is None)
        if state.trial is None:
            assert (state.settings, state.settings_revision) == disk
        else:
            assert (state.trial.before, state.trial.before_revision) == disk
    do(after_trial(state, now_s + TRIAL_S))
    assert (state.settings, state.settings_revision) == disk
    assert told.values == disk[0].values()


def test_the_loop_goes_back_by_its_own_clock_and_what_is_outside_it_hears_of_that(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path / "state", tmp_path / "site")
    rig = Rig(store=store)
    rig.agent.submit(ApplySettings(7, {DELTA: 1.5}, revert_after_s=2.0))
    rig.cycles(1)
    assert rig.agent.state.settings.gate.clearance_m == 1.5
    rig.agent.settle()
    assert store.load_settings() == (Settings(), 0), "a device that starts anew runs what was kept"
    rig.cycles(25)
    assert rig.agent.state.settings == Settings()
    told = rig.messages(SettingsRunning)[-1]
    assert (told.revision, told.refused_revision) == (0, 7)
    rig.agent.submit(ApplySettings(8, {DELTA: 1.5}, revert_after_s=2.0))
    rig.cycles(1)
    rig.agent.submit(KeepSettings(8))
    rig.cycles(30)
    rig.agent.settle()
    assert store.load_settings() == (rig.agent.state.settings, 8)
    assert rig.agent.state.settings.gate.clearance_m == 1.5
