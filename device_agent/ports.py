"""Where the outside world meets the loop: one small Protocol for each kind of hardware.

Adapters live in ``device_agent.adapters`` (hardware, recordings, fakes) and ``device_agent.simulation``. An adapter
gives something fresh or raises SensorError; it never gives what is old as if it were new.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Literal, Protocol

from navcore.cues.overlay import Overlay
from navcore.cues.overlay_display import DisplayGeometry
from navcore.cues.table import Cue
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, FisheyeImage, Frame, Localization, SonarReading
from navcore.wire import (
    GraphRunning,
    MapRunning,
    MapWalkRunning,
    RouteChanged,
    SettingsRunning,
    SharingRunning,
    WalkerState,
)

KeptMessage = RouteChanged | SettingsRunning | GraphRunning | MapRunning | MapWalkRunning | SharingRunning
"""What tells the console which of its orders runs, and what the walker shares."""
EventKind = Literal[
    "cue", "arrived", "route_refused", "localization", "sensor", "link", "mode", "watchdog", "button", "privacy"
]


class Clock(Protocol):
    """Time, injected, so that a walk can run faster than real time and a test can stand still."""

    def now_s(self) -> float:
        """Seconds on a steady scale; the scale that all stamps of this device use."""
        ...

    def sleep_until(self, stamp_s: float) -> None:
        """Return when ``now_s()`` has reached ``stamp_s``."""
        ...


class DepthCamera(Protocol):
    """A camera that gives colour with registered depth."""

    @property
    def intrinsics(self) -> CameraIntrinsics: ...

    def read(self) -> Frame:
        """Wait for the next capture and return it. Raises SensorError when none comes, or it is not fresh."""
        ...

    def close(self) -> None: ...


class WideCamera(Protocol):
    """The second, fisheye camera."""

    def read(self) -> FisheyeImage:
        """Wait for the next picture and return it. Raises SensorError when none comes, or it is not fresh."""
        ...

    def close(self) -> None: ...


class Sonar(Protocol):
    """An ultrasonic rangefinder that looks where the camera looks."""

    def read(self) -> SonarReading:
        """Return the latest reading without waiting; its state says STALE or ABSENT where there is none.

        Raises SensorError, with a sentence for people, where the rangefinder has failed.
        """
        ...

    def close(self) -> None: ...


class CueOutput(Protocol):
    """Whatever lets the walker hear (or see) a cue."""

    def play(self, cue: Cue) -> None:
        """Begin the cue now; one that is playing is cut off. Never blocks longer than handing it over takes."""
        ...

    def close(self) -> None: ...


class DisplayOutput(Protocol):
    """The two see-through displays of the glasses."""

    @property
    def geometry(self) -> DisplayGeometry: ...

    def show(self, overlay: Overlay) -> None:
        """Show the pictures now, instead of those before. Never blocks longer than handing them over takes."""
        ...

    def close(self) -> None: ...


class Button(enum.Enum):
    """The buttons on the glasses; what they mean is decided in :mod:`device_agent.menu`."""

    MAIN = "main"
    NEXT = "next"
    PREVIOUS = "previous"
    REPEAT = "repeat"


class PressKind(enum.Enum):
    """How a button was pressed."""

    SHORT = "short"
    """Let go again at once; told when it is let go."""
    LONG = "long"
    """Held; told while it is still held, so that the walker knows when to let go."""


@dataclass(frozen=True, slots=True)
class ButtonPress:
    """Somebody has pressed a button."""

    stamp_s: float
    """When it was known what kind of press it is, seconds on the device's clock."""
    button: Button
    kind: PressKind


class Buttons(Protocol):
    """The buttons that the walker can feel."""

    def pressed(self) -> tuple[ButtonPress, ...]:
        """Return what was pressed since the last call, in order, each once, without waiting.

        Raises SensorError where the buttons are gone; they come back by themselves.
        """
        ...

    def close(self) -> None: ...


class MapWalks(Protocol):
    """Records map walks, advises on the way, and has maps built. No method waits for the disk or for computing.

    What is to be said, and finished maps, come to the agent as orders.
    """

    def begin(self, settings: Settings) -> None:
        """Begin to record a walk."""
        ...

    def take(self, frame: Frame) -> None:
        """Record a frame of the walk; it is written within a second."""
        ...

    def mark(self, name: str) -> None:
        """Note that a place was named where the last frame was taken."""
        ...

    def end(self) -> None:
        """End the walk: complete its recording, and have its map built or handed over."""
        ...

    def close(self) -> None: ...


class LocalizerPort(Protocol):
    """Finds the camera in the pre-built map (navcore.slam.localizer, or a fake)."""

    def locate(self, frame: Frame) -> Localization:
        """Return the pose of one frame; frames come in order of their stamps."""
        ...

    def use_features(self, fraction: float) -> None:
        """Look for this share (0, 1] of a frame's features from the next one on, where the device is too slow."""
        ...

    def apply(self, settings: Settings) -> None:
        """Run other settings from the next frame on."""
        ...


@dataclass(frozen=True, slots=True)
class HostHealth:
    """How the machine in the glasses, or in the pocket, is doing; None for what it does not tell."""

    battery_percent: float | None = None
    is_charging: bool | None = None
    """Whether the battery is being charged, or full on the charger."""
    temperature_c: float | None = None
    """Of the hottest part that is measured."""


class HostMonitor(Protocol):
    """Battery and temperature. Looking at them may take long, so it is done beside the loop."""

    def read(self) -> HostHealth:
        """Return what was found last, without waiting; what could not be read is None."""
        ...

    def close(self) -> None: ...


class Uplink(Protocol):
    """Where the loop leaves what the console shall know. No method waits for the network, or for the disk."""

    def state(self, state: WalkerState) -> None:
        """Offer the newest state; it replaces one that is not sent yet."""
        ...

    def depth_image(self, frame: Frame) -> None:
        """Offer the newest depth image; the first thing to be dropped. It goes only while the walker shares it."""
        ...

    def colour_image(self, frame: Frame) -> None:
        """Offer the newest colour picture. It goes only while the walker lets somebody see it."""
        ...

    def message(self, message: KeptMessage) -> None:
        """Hand over a message that is kept until it is sent."""
        ...

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Hand over something that must not be lost: kept until the console confirms it."""
        ...
