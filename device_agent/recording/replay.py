"""The loop runs again on what it read then, and comes to the same guidance, bit for bit.

The agent is the device's own; what it reads comes from a file: time, camera, rangefinder, orders, what the watchdog
did. Without a map, poses and scans come from the file as well; with one (and a recording with pictures) they are
computed again, and compared with those of then. Run under other settings, or by another version of the program, a
replay shows what that would have changed, as far as a walker who went as they did then can show it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from device_agent.adapters.clocks import SteppedClock
from device_agent.adapters.fakes import FakeOutput, NoUplink
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.cycle import Cycle, walker_state
from device_agent.load_plan import LoadLevel
from device_agent.locating import Answer, Locator, Request
from device_agent.loop import Ports
from device_agent.orders import Order
from device_agent.ports import Clock, CueOutput, LocalizerPort
from device_agent.recording import exact
from device_agent.recording.notes import CycleNotes, MapTaken, OrderTaken, Raised
from device_agent.recording.reading import RecordedCycle, RecordedPart
from device_agent.recording.tap import Tap
from device_agent.state import DeviceState, PreparedMap
from navcore.cues.table import Cue
from navcore.errors import InputError, SensorError
from navcore.explain import explain
from navcore.geometry import Transform
from navcore.obstacle.levelling import Expected, Levelling
from navcore.obstacle.scan import with_directions
from navcore.settings import ObstacleSettings, Settings, SettingValue, not_replayed
from navcore.site import Site
from navcore.types import (
    CameraIntrinsics,
    DecisionTrace,
    DepthImage,
    Frame,
    Guidance,
    Localization,
    ObstacleScan,
    SonarReading,
)
from navcore.wire import ApplySettings, decode_from_console

T = TypeVar("T")
MakeLocalizer = Callable[[CameraIntrinsics, Settings], LocalizerPort]
_SHOWN_LENGTH, _SHOWN_BEFORE = 100, 40
"""Characters of a value that are shown, and how many of them before the first that differs."""
_NOT_NOTED = Raised("LookupError", "The recording does not tell.")
_NO_COLOUR, _NO_DEPTH = np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedCycle:
    """A cycle then, and now."""

    notes: CycleNotes
    """What was noted then."""
    cycle: Cycle
    cues: tuple[Cue, ...]
    """All that the loop says now, notices included."""
    differs_in: tuple[str, ...]
    """What is not the same to the last bit: "guidance", "cues", "localization", "scan"."""
    state: DeviceState
    """After the cycle, now."""
    settings_then: Settings
    """What ran then."""


def replay(
    parts: Iterable[RecordedPart],
    make_localizer: MakeLocalizer | None = None,
    changes: Mapping[str, SettingValue] | None = None,
) -> Iterator[ReplayedCycle]:
    """Run the loop again through the files of one walk, in order.

    Args:
        parts: the files. From pictures, they begin with the walk's first one and none is missing between them.
        make_localizer: computes the poses from pictures; None takes poses and scans from the recording.
        changes: settings that differ from those of then.

    Raises:
        InputError: where what is needed is not in the files; the text says what to do.
    """
    changes = changes or {}
    unseen = not_replayed(changes)
    if make_localizer is None and unseen:
        raise InputError(
            f"Poses, what stands in the way and the device's pace are in a recording as they were then, so"
            f" {', '.join(unseen)} cannot be judged by it: leave it out, or name --site, and a recording with pictures."
        )
    run: _Run | None = None
    for part in parts:
        if make_localizer is None or run is None:
            run = _Run(part, make_localizer, changes)
        elif part.opening.walk_id != run.walk_id or part.opening.next_number != run.next_number:
            raise InputError(f"{part.path} does not follow on what was replayed before: name every file of one walk.")
        for recorded in part.cycles():
            yield run.replayed(recorded)


def cue_line(cue: Cue) -> dict[str, object]:
    """Return a cue as a stored list of cues has it: to the millisecond and the tenth of a degree, so that another
    processor's last bit is no difference."""
    line: dict[str, object] = {"s": round(cue.stamp_s, 3), "kind": cue.kind.value}
    if cue.text:
        line["text"] = cue.text
    for name, value in (("angle_deg", cue.angle_deg), ("distance_m", cue.distance_m), ("hz", cue.frequency_hz)):
        if value is not None:
            line[name] = round(value, 1)
    return line


def decision_line(cycle: ReplayedCycle) -> dict[str, object]:
    """Return a cycle as a list of decisions has it: what was decided then, and what is now, and in what they differ."""
    then = _decision(cycle.notes.guidance, cycle.notes.cues)
    now = _decision(cycle.cycle.guidance, cycle.cues)
    differs_in = [name for name in then if then[name] != now[name]]
    then["sentence"], now["sentence"] = _sentences(cycle, alike=not differs_in)
    return {
        "cycle": cycle.notes.number, "stamp_s": round(cycle.notes.guidance.stamp_s, 4), "differs_in": differs_in,
        "then": then, "now": now,
    }  # fmt: skip


def _decision(guidance: Guidance, cues: tuple[Cue, ...]) -> dict[str, object]:
    direction, deviation_m = guidance.direction, guidance.trace.deviation_m
    return {
        "action": guidance.action.value,
        "reason": guidance.reason.value,
        "rule": guidance.trace.rule,
        "direction_deg": None if direction is None else round(math.degrees(direction), 1),
        "deviation_m": None if deviation_m is None else round(deviation_m, 3),
        "cues": [cue.text or cue.kind.value for cue in cues],
    }


def _sentences(cycle: ReplayedCycle, *, alike: bool) -> tuple[str, str]:
    """Return why the decision was what it was then, and is what it is now, as the console would tell it.

    What stood in the way is the same for both: a replay takes it from the recording. What an earlier version did not
    note of a decision is that of now, where both decide ``alike``.
    """
    now, guidance_then = cycle.cycle, cycle.notes.guidance
    if alike and guidance_then.trace.decided is None:
        guidance_then = now.guidance
    fault_then = now.fault if guidance_then.reason is now.guidance.reason else ""
    then = replace(now, guidance=guidance_then, fault=fault_then)
    state_then = replace(cycle.state, settings=cycle.settings_then)
    return _sentence(then, state_then), _sentence(now, cycle.state)


def _sentence(cycle: Cycle, state: DeviceState) -> str:
    return explain(walker_state(state, cycle, None, 0.0)).sentence


def difference(cycle: ReplayedCycle) -> dict[str, object]:
    """Return in words what a cycle came to then, and now."""
    then, now = cycle.notes.guidance, cycle.cycle.guidance
    return {
        "cycle": cycle.notes.number,
        "stamp_s": then.stamp_s,
        "in": list(cycle.differs_in),
        "then": _in_words(then, cycle.notes.cues),
        "now": _in_words(now, cycle.cues),
        "values": _values_that_differ(cycle),
    }


def _values_that_differ(cycle: ReplayedCycle) -> dict[str, tuple[str, str]]:
    """Return what is not the same, by its name, then and now: two decisions may come to the same words."""
    then, now = cycle.notes.guidance, cycle.cycle.guidance
    outer = [(f"guidance.{each.name}", then, now, each.name) for each in fields(Guidance) if each.name != "trace"]
    inner = [(f"trace.{each.name}", then.trace, now.trace, each.name) for each in fields(DecisionTrace)]
    values = [(name, getattr(old, field), getattr(new, field)) for name, old, new, field in outer + inner]
    if "cues" in cycle.differs_in:
        values.append(("cues", cycle.notes.cues, cycle.cues))
    return {name: _apart(old, new) for name, old, new in values if not exact.same(old, new)}


def _apart(then: object, now: object) -> tuple[str, str]:
    """Return two values in words that differ: of long ones, from shortly before the first place where they do."""
    old, new = repr(then), repr(now)
    first = next((at for at, (one, other) in enumerate(zip(old, new, strict=False)) if one != other), 0)
    begin = max(0, first - _SHOWN_BEFORE) if max(len(old), len(new)) > _SHOWN_LENGTH else 0
    return _cut(old, begin), _cut(new, begin)


def _cut(text: str, begin: int) -> str:
    end = begin + _SHOWN_LENGTH
    return f"{'…' if begin else ''}{text[begin:end]}{'…' if end < len(text) else ''}"


def _in_words(guidance: Guidance, cues: tuple[Cue, ...]) -> str:
    direction = "" if guidance.direction is None else f" {math.degrees(guidance.direction):+.1f}°"
    said = "".join(f" “{cue.text}”" if cue.text else f" [{cue.kind.value}]" for cue in cues)
    return f"{guidance.action.value}{direction} ({guidance.reason.value}){said}"


class _Run:
    """An agent whose surroundings are a file."""

    def __init__(
        self, part: RecordedPart, make_localizer: MakeLocalizer | None, changes: Mapping[str, SettingValue]
    ) -> None:
        opening = part.opening
        self.walk_id, self.next_number = opening.walk_id, opening.next_number
        self._from_pictures = make_localizer is not None
        self._intrinsics = opening.intrinsics
        state = _changed(opening.state, changes)
        if opening.waiting_map is not None:
            state = replace(state, waiting_map=self._prepared(opening.waiting_map))
        localizer: LocalizerPort = _NoLocalizer()
        if make_localizer is not None:
            localizer = _rehearsed(part, make_localizer(opening.intrinsics, state.settings))
        self._changes = changes
        self._then = _SettingsThen(opening.state.settings, changes)
        self._tap = _ReplayTap(self._from_pictures, redirects=any(key.startswith("obstacle.") for key in changes))
        parts = DeviceParts(
            SteppedClock(), _ReplayedCamera(self._tap, opening.intrinsics), _ReplayedSonar(self._tap), FakeOutput(),
            NoUplink(), lambda *_: localizer, tap=self._tap,
        )  # fmt: skip
        self._agent = DeviceAgent(parts, state, localizer, opening.voice)

    def replayed(self, recorded: RecordedCycle) -> ReplayedCycle:
        """Run one cycle, and compare."""
        notes = recorded.notes
        if notes.number != self.next_number:
            raise InputError(
                f"Cycle {self.next_number} is missing from the recording: it was changed by something else."
            )
        self.next_number += 1
        if self._from_pictures and notes.frame is not None and recorded.frame is None:
            raise InputError(
                f"Cycle {notes.number} has no pictures: they were not recorded, or the disk was too slow for them."
                " Replay without --site, from poses and scans."
            )
        self._tap.load(recorded)
        for order in notes.orders:
            self._agent.submit(self._order(order))
        cycle = self._agent.run_cycle()
        cues = tuple(self._tap.cues)
        pairs = {
            "localization": (self._tap.located, (notes.late_localization, notes.localization)),
            "scan": (self._tap.seen, notes.scan),
            "guidance": (cycle.guidance, notes.guidance), "cues": (cues, notes.cues),
        }  # fmt: skip
        differs_in = tuple(name for name, (now, then) in pairs.items() if not exact.same(now, then))
        state = self._agent.state
        return ReplayedCycle(notes, cycle, cues, differs_in, state, self._then.after(state.settings))

    def _order(self, order: OrderTaken) -> Order:
        if order.message is not None:
            message = decode_from_console(order.message)
            if isinstance(message, ApplySettings):
                self._then.ask(message.values)
                # What was changed on the way back then does not undo what is looked at now.
                message = msgspec.structs.replace(message, values=message.values | dict(self._changes))
            return message
        if (local := order.lead or order.press or order.told or order.link or order.consent) is not None:
            return local
        if order.map is None:
            raise InputError(f"An order of the kind {order.kind} cannot be replayed: replay the walk up to there.")
        if self._from_pictures:
            raise InputError("The map was changed during this walk: replay it without --site, from poses and scans.")
        return self._prepared(order.map)

    def _prepared(self, taken: MapTaken) -> PreparedMap:
        empty = np.zeros((0, 3))
        site = Site(
            taken.site_id, taken.name, self._intrinsics, {}, (), empty.astype(np.float32), empty.astype(np.uint8),
            taken.graph,
        )  # fmt: skip
        return PreparedMap(Path(), taken.checksum, site, _NoLocalizer(), taken.told)


def _changed(state: DeviceState, changes: Mapping[str, SettingValue]) -> DeviceState:
    """Return a state under other settings: those that run again after a trial are changed too."""
    trial = state.trial
    if trial is not None:
        trial = replace(trial, before=trial.before.changed(changes))
    return replace(state, settings=state.settings.changed(changes), trial=trial)


def _rehearsed(part: RecordedPart, localizer: LocalizerPort) -> LocalizerPort:
    """Bring the localizer to where it was before the first cycle."""
    if part.description.get("pictures") != "yes":
        raise InputError(f"{part.path} has no pictures: replay it without --site, from poses and scans.")
    if part.opening.next_number != 1:
        raise InputError(
            f"{part.path} is not the first file of its walk, and what the localizer remembered is in no file: name the"
            " walk's files from 001 on, or replay without --site, from poses and scans."
        )
    frame = part.rehearsal()
    if frame is not None:
        localizer.locate(frame)
    return localizer


class _SettingsThen:
    """Knows what ran then, from what runs now and what of it is looked at under another value."""

    def __init__(self, settings: Settings, changes: Mapping[str, SettingValue]) -> None:
        self._values = {key: settings.value(key) for key in changes}
        self._asked: dict[str, SettingValue] = {}
        self._now = self._then = settings

    def ask(self, values: Mapping[str, SettingValue]) -> None:
        """Somebody asked for other values; whether they ran is seen after the cycle."""
        self._asked |= {key: value for key, value in values.items() if key in self._values}

    def after(self, now: Settings) -> Settings:
        """Return what ran then, where this runs now."""
        if now is not self._now:
            self._values |= self._asked
            self._now, self._then = now, now.changed(self._values)
        self._asked = {}
        return self._then


class _ReplayTap(Tap):
    """Gives the loop what was noted, each thing as often as it asked for it then."""

    def __init__(self, from_pictures: bool, *, redirects: bool = False) -> None:
        self.from_pictures = from_pictures
        self.redirects = redirects
        """The directions of a scan are found anew, for other settings than those of then."""
        self._now_s: Iterator[float] = iter(())
        self._stale_s: Iterator[float] = iter(())
        self._stop_counts: Iterator[int] = iter(())
        self._last_now_s, self._last_stale_s, self._last_stop_count = 0.0, -np.inf, 0
        self.recorded: RecordedCycle | None = None
        self.cues: list[Cue] = []
        self.located: tuple[Localization | None, Localization | None] = (None, None)
        """The pose of an earlier frame that came late, and that of this cycle's."""
        self.late: _Found | None = None
        """What the pictures show of a frame whose pose has not come yet."""
        self.seen: ObstacleScan | None = None
        """The scan of this cycle's image."""

    def load(self, recorded: RecordedCycle) -> None:
        """Make ready for a cycle."""
        notes = recorded.notes
        self.recorded, self.cues, self.located, self.seen = recorded, [], (None, None), None
        self._now_s, self._stale_s, self._stop_counts = iter(notes.now_s), iter(notes.stale_s), iter(notes.stop_counts)

    @property
    def notes(self) -> CycleNotes:
        """What was noted of the cycle that runs."""
        assert self.recorded is not None, "a cycle is loaded before it runs"
        return self.recorded.notes

    # Another version of the loop may ask more often than it did then: the last answer still holds.
    def now_s(self) -> float:
        """Return what the clock said."""
        self._last_now_s = next(self._now_s, self._last_now_s)
        return self._last_now_s

    def stale_s(self) -> float:
        """Return when the watchdog had last found guidance stale."""
        self._last_stale_s = next(self._stale_s, self._last_stale_s)
        return self._last_stale_s

    def stops(self) -> int:
        """Return how often the watchdog had spoken."""
        self._last_stop_count = next(self._stop_counts, self._last_stop_count)
        return self._last_stop_count

    def clock(self, clock: Clock) -> Clock:
        """Give the time of then."""
        return _ReplayedClock(self)

    def voice_output(self, output: CueOutput) -> CueOutput:
        """Keep what is said."""
        return _ReplayedOutput(self)

    def stop_count(self, count: Callable[[], int]) -> Callable[[], int]:
        """Give what the watchdog did then."""
        return self.stops

    def load_level(self, level: LoadLevel) -> LoadLevel:
        """Leave out what was left out then."""
        return self.notes.load_level

    def ports(self, ports: Ports) -> Ports:
        """Give what was read then."""
        scan, find_floor = ports.scan, ports.floor

        def floor(depth_m: DepthImage, intrinsics: CameraIntrinsics) -> Levelling | None:
            if self.from_pictures:
                return find_floor(depth_m, intrinsics)
            if self.notes.floor_error is not None:
                raise self.notes.floor_error.error()
            return self.notes.floor

        def seen(
            depth_m: DepthImage,
            intrinsics: CameraIntrinsics,
            world_from_camera: Transform | None,
            settings: ObstacleSettings,
            expected: Expected | None,
        ) -> ObstacleScan:
            if self.from_pictures:
                self.seen = scan(depth_m, intrinsics, world_from_camera, settings, expected)
            else:
                noted = _given(self.notes.scan, self.notes.scan_error)
                self.seen = with_directions(noted, settings) if self.redirects else noted
            return self.seen

        locator = _ReplayedLocator(self, ports.locator)
        return replace(ports, locator=locator, scan=seen, floor=floor, stale_s=self.stale_s)


def _given(value: T | None, error: Raised | None) -> T:
    if value is None:
        raise (error or _NOT_NOTED).error()
    return value


class _ReplayedClock:
    def __init__(self, tap: _ReplayTap) -> None:
        self._tap = tap

    def now_s(self) -> float:
        """Seconds."""
        return self._tap.now_s()

    def sleep_until(self, stamp_s: float) -> None:
        """Nobody waits in a replay."""


class _ReplayedCamera:
    def __init__(self, tap: _ReplayTap, intrinsics: CameraIntrinsics) -> None:
        self._tap, self._intrinsics = tap, intrinsics

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera of then."""
        return self._intrinsics

    def read(self) -> Frame:
        """Return the frame, with its pictures where they are there; raise what was raised."""
        notes = self._tap.notes
        given = _given(notes.frame, notes.camera_error)
        assert self._tap.recorded is not None
        return self._tap.recorded.frame or Frame(given.stamp_s, _NO_COLOUR, _NO_DEPTH, None, given.gravity)

    def close(self) -> None:
        """Nothing is open."""


class _ReplayedSonar:
    def __init__(self, tap: _ReplayTap) -> None:
        self._tap = tap

    def read(self) -> SonarReading:
        """Return the reading; raise what was raised."""
        return _given(self._tap.notes.sonar, self._tap.notes.sonar_error)

    def close(self) -> None:
        """Nothing is open."""


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What the pictures of one frame show."""

    pose: Localization | None = None
    error: Exception | None = None

    def taken(self) -> Localization | None:
        """Return the pose; raise what was raised."""
        if self.error is not None:
            raise self.error
        return self.pose


class _ReplayedLocator:
    """Gives each pose in the cycle in which it came then."""

    def __init__(self, tap: _ReplayTap, locator: Locator) -> None:
        self._tap, self._locator = tap, locator

    def locate(self, request: Request) -> Answer:
        """Return the poses of then, or those that the pictures show; raise what was raised."""
        answer = self._from_pictures(request) if self._tap.from_pictures else self._as_noted()
        self._tap.located = answer.late, answer.own
        return answer

    def _as_noted(self) -> Answer:
        notes = self._tap.notes
        if notes.localization_error is not None:
            raise notes.localization_error.error()
        return Answer(notes.localization, notes.late_localization)

    def _from_pictures(self, request: Request) -> Answer:
        """Locate the frames that were located then: one is worked on at a time, until its pose has come."""
        notes, late = self._tap.notes, None
        if (waiting := self._tap.late) is not None:
            if notes.late_localization is None and notes.localization_error is None:
                return Answer()
            self._tap.late = None
            late = waiting.taken()
            if request.rests:
                return Answer(late=late)
        if request.feature_fraction is None:
            return Answer(late=late)
        found = self._found(request)
        if notes.localization is None and notes.localization_error is None:
            self._tap.late = found
            return Answer(late=late)
        return Answer(found.taken(), late)

    def _found(self, request: Request) -> _Found:
        try:
            return _Found(self._locator.locate(request).own)
        except Exception as error:
            return _Found(error=error)

    def apply(self, settings: Settings) -> None:
        """Run other settings from the next frame on."""
        self._locator.apply(settings)

    def close(self) -> None:
        """Nothing is asked any more."""
        self._locator.close()


class _ReplayedOutput:
    def __init__(self, tap: _ReplayTap) -> None:
        self._tap = tap

    def play(self, cue: Cue) -> None:
        """Keep the cue; raise what was raised."""
        self._tap.cues.append(cue)
        failed = dict(self._tap.notes.play_errors).get(len(self._tap.cues) - 1)
        if failed is not None:
            raise failed.error()

    def close(self) -> None:
        """Nothing is open."""


class _NoLocalizer:
    def locate(self, frame: Frame) -> Localization:
        """Nothing is located where poses come from the recording."""
        raise SensorError("There is no map in a replay without pictures.")

    def use_features(self, fraction: float) -> None:
        """Nothing is looked for."""

    def apply(self, settings: Settings) -> None:
        """There is nothing to set."""
