"""Shipped fakes of every port, for tests and for trying things out without hardware."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from device_agent.ports import ButtonPress, Clock, EventKind, HostHealth, KeptMessage
from navcore.cues.overlay import Overlay
from navcore.cues.overlay_display import DisplayGeometry
from navcore.cues.table import Cue
from navcore.errors import SensorError
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, FisheyeImage, Frame, Localization, SonarReading, SonarState
from navcore.wire import WalkerState


class FakeCamera:
    """A camera that is fed: each entry is a frame, or the error that reading it raises.

    Frames are given no earlier than their stamp and no later than ``fresh_for_s`` after it.
    """

    def __init__(
        self, intrinsics: CameraIntrinsics, clock: Clock, feed: Iterable[Frame | Exception], fresh_for_s: float = 0.5
    ) -> None:
        self._intrinsics = intrinsics
        self._clock = clock
        self._feed = iter(feed)
        self._fresh_for_s = fresh_for_s
        self._closed = False

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera's geometry."""
        return self._intrinsics

    def read(self) -> Frame:
        """Return the next fresh frame of the feed. Raises SensorError, or the error that was fed."""
        while not self._closed:
            entry = next(self._feed, None)
            if entry is None:
                break
            if isinstance(entry, Exception):
                raise entry
            self._clock.sleep_until(entry.stamp_s)
            if self._clock.now_s() - entry.stamp_s <= self._fresh_for_s:
                return entry
        raise SensorError("The camera delivers no pictures: check its cable.")

    def close(self) -> None:
        """Deliver nothing from now on."""
        self._closed = True


class NoMapWalks:
    """Records nothing: in a replay, what was said of a map walk comes from the recording."""

    def begin(self, settings: Settings) -> None:
        """Do nothing."""

    def take(self, frame: Frame) -> None:
        """Do nothing."""

    def mark(self, name: str) -> None:
        """Do nothing."""

    def end(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


class FakeWideCamera:
    """A fisheye camera that is fed: each entry is a picture, or the error that reading it raises."""

    def __init__(self, clock: Clock, feed: Iterable[FisheyeImage | Exception]) -> None:
        self._clock = clock
        self._feed = iter(feed)
        self._closed = False

    def read(self) -> FisheyeImage:
        """Return the next picture of the feed at its time. Raises SensorError, or the error that was fed."""
        entry = None if self._closed else next(self._feed, None)
        if entry is None:
            raise SensorError("The fisheye camera delivers no pictures: check its cable.")
        if isinstance(entry, Exception):
            raise entry
        self._clock.sleep_until(entry.stamp_s)
        return entry

    def close(self) -> None:
        """Deliver nothing from now on."""
        self._closed = True


class FakeSonar:
    """A rangefinder that says what it was last told, until that is too old."""

    def __init__(self, clock: Clock, distance_m: float | None = None, stale_after_s: float = 0.25) -> None:
        self._clock = clock
        self._stale_after_s = stale_after_s
        self._closed = False
        self.echo(distance_m)

    def echo(self, distance_m: float | None) -> None:
        """Hear an echo now; None is "nothing within range"."""
        state = SonarState.NO_ECHO if distance_m is None else SonarState.OK
        self._reading = SonarReading(self._clock.now_s(), state, distance_m)

    def read(self) -> SonarReading:
        """Return the last echo, STALE when it is old, ABSENT after closing."""
        now_s = self._clock.now_s()
        if self._closed:
            return SonarReading(now_s, SonarState.ABSENT)
        if now_s - self._reading.stamp_s > self._stale_after_s:
            return SonarReading(self._reading.stamp_s, SonarState.STALE)
        return self._reading

    def close(self) -> None:
        """Be absent from now on."""
        self._closed = True


class NoSonar:
    """There is no rangefinder."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def read(self) -> SonarReading:
        """Say so."""
        return SonarReading(self._clock.now_s(), SonarState.ABSENT)

    def close(self) -> None:
        """Nothing to close."""


class FakeOutput:
    """Keeps every cue, and calls back as each is played."""

    def __init__(self, on_play: Callable[[Cue], None] | None = None) -> None:
        self.cues: list[Cue] = []
        self._on_play = on_play
        self._closed = False

    def play(self, cue: Cue) -> None:
        """Keep the cue; after closing nothing is heard any more."""
        if self._closed:
            return
        self.cues.append(cue)
        if self._on_play is not None:
            self._on_play(cue)

    def close(self) -> None:
        """Be silent from now on."""
        self._closed = True


class FakeDisplay:
    """Keeps every pair of pictures, and calls back as each is shown."""

    def __init__(self, on_show: Callable[[Overlay], None] | None = None) -> None:
        self.overlays: list[Overlay] = []
        self._on_show = on_show
        self._closed = False

    @property
    def geometry(self) -> DisplayGeometry:
        """Displays of the usual size."""
        return DisplayGeometry()

    def show(self, overlay: Overlay) -> None:
        """Keep the pictures; after closing nothing is seen any more."""
        if self._closed:
            return
        self.overlays.append(overlay)
        if self._on_show is not None:
            self._on_show(overlay)

    def close(self) -> None:
        """Be dark from now on."""
        self._closed = True


class FakeButtons:
    """Buttons that a program presses."""

    def __init__(self) -> None:
        self._waiting: list[ButtonPress] = []
        self._closed = False

    def press(self, press: ButtonPress) -> None:
        """Press a button; it is told at the next look."""
        self._waiting.append(press)

    def pressed(self) -> tuple[ButtonPress, ...]:
        """Return what was pressed since the last call. Raises SensorError after closing."""
        if self._closed:
            raise SensorError("The buttons are closed: start the device again.")
        waiting, self._waiting = tuple(self._waiting), []
        return waiting

    def close(self) -> None:
        """Tell nothing from now on."""
        self._closed = True


class NoButtons:
    """There are no buttons."""

    def pressed(self) -> tuple[ButtonPress, ...]:
        """Nobody can press anything."""
        return ()

    def close(self) -> None:
        """Nothing to close."""


class FakeLocalizer:
    """Says of every frame what a function says of it."""

    def __init__(self, locate: Callable[[Frame], Localization]) -> None:
        self._locate = locate
        self.feature_fraction = 1.0
        """What was last asked for."""

    def locate(self, frame: Frame) -> Localization:
        """Return (or raise) what the function does."""
        return self._locate(frame)

    def use_features(self, fraction: float) -> None:
        """Keep it."""
        self.feature_fraction = fraction

    def apply(self, settings: Settings) -> None:
        """There is nothing to set."""


class FakeHost:
    """A machine that is as it is told to be; without anything told, one that measures nothing."""

    def __init__(self, health: HostHealth | None = None) -> None:
        self.health = health or HostHealth()

    def read(self) -> HostHealth:
        """Return what was told."""
        return self.health

    def close(self) -> None:
        """There is nothing to close."""


class FakeUplink:
    """Keeps everything that was handed over."""

    def __init__(self) -> None:
        self.states: list[WalkerState] = []
        self.depth_images: list[Frame] = []
        self.colour_images: list[Frame] = []
        self.messages: list[KeptMessage] = []
        self.events: list[tuple[float, EventKind, str]] = []

    def state(self, state: WalkerState) -> None:
        """Keep it."""
        self.states.append(state)

    def depth_image(self, frame: Frame) -> None:
        """Keep it."""
        self.depth_images.append(frame)

    def colour_image(self, frame: Frame) -> None:
        """Keep it."""
        self.colour_images.append(frame)

    def message(self, message: KeptMessage) -> None:
        """Keep it."""
        self.messages.append(message)

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Keep it."""
        self.events.append((stamp_s, kind, text))


class NoUplink:
    """There is no console: nothing is kept."""

    def state(self, state: WalkerState) -> None:
        """Drop it."""

    def depth_image(self, frame: Frame) -> None:
        """Drop it."""

    def colour_image(self, frame: Frame) -> None:
        """Drop it."""

    def message(self, message: KeptMessage) -> None:
        """Drop it."""

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Drop it."""
