"""A device in lock step that is shown frames, with everything real behind its map walks; and walks to show it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from device_room import small_room

from device_agent.adapters.clocks import SteppedClock
from device_agent.adapters.fakes import FakeButtons, FakeCamera, FakeLocalizer, FakeOutput, FakeSonar, FakeUplink
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.device_store import DeviceStore
from device_agent.localization import make_localizer
from device_agent.map_walk.map_walks import DeviceMapWalks, WalkPlan
from device_agent.ports import Button, ButtonPress, PressKind
from device_agent.recording.tap import Tap
from device_agent.simulation.building import Building
from device_agent.simulation.sensors import head_camera
from device_agent.simulation.simulated_walk import shots, staged_walk
from device_agent.state import DeviceState
from device_agent.state_health import refuse_unwritable
from navcore.cues.table import Cue, CueKind
from navcore.geometry import Transform, rotation_from_rotvec
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.types import Frame, Localization, LocalizationQuality

RATE_HZ = 10.0
BUTTONS_TO_BEGIN = (
    (Button.MAIN, PressKind.LONG),  # off duty
    (Button.MAIN, PressKind.LONG),  # is a map walk wanted?
    (Button.NEXT, PressKind.SHORT),  # it is
)


def walk_frames(
    building: Building | None = None,
    waypoints_m: tuple[tuple[float, float], ...] | None = None,
    *,
    max_length_m: float,
    turned: Callable[[float], float] = lambda stamp_s: 0.0,
) -> list[Frame]:
    """Return the frames of a sighted person's walk; ``turned`` says how far (rad) they look further down, and when."""
    staged = staged_walk(building or small_room(), waypoints_m, 0, rate_hz=RATE_HZ, max_length_m=max_length_m)
    heads = tuple(
        head
        @ Transform.from_rotation_translation(rotation_from_rotvec(np.array([-turned(stamp_s), 0.0, 0.0])), np.zeros(3))
        for head, stamp_s in zip(staged.heads, staged.stamp_s.tolist(), strict=True)
    )
    return [shot.frame for shot in shots(replace(staged, heads=heads), 0)]


def paced(frames: Iterable[Frame], rate_hz: float = RATE_HZ, begin_s: float = 0.0) -> list[Frame]:
    """Return frames as if they had been taken at another rate."""
    return [replace(frame, stamp_s=begin_s + number / rate_hz) for number, frame in enumerate(frames)]


def covered(frame: Frame) -> Frame:
    return replace(frame, colour_rgb=np.zeros_like(frame.colour_rgb), depth_m=np.full_like(frame.depth_m, np.nan))


def darkened(frame: Frame) -> Frame:
    return replace(frame, colour_rgb=(frame.colour_rgb * 0.05).astype(np.uint8))


def _lost(frame: Frame) -> Localization:
    return Localization(frame.stamp_s, LocalizationQuality.LOST, None, None, 0)


@dataclass
class MapRig:
    """A device with a map walk; ``walk`` shows it frames."""

    folder: Path
    settings: Settings = field(default_factory=Settings)
    free_bytes: Callable[[Path], int] = lambda folder: 1 << 40
    owns_map: bool = True
    tap: Tap = field(default_factory=Tap)

    def __post_init__(self) -> None:
        self.clock = SteppedClock(100.0)
        self.output, self.uplink, self.buttons = FakeOutput(), FakeUplink(), FakeButtons()
        self.site = self.folder / "site"
        self.store = DeviceStore(self.folder / "state", self.site)
        refuse_unwritable(self.store.state_folder)
        plan = WalkPlan(self.folder / "state" / "map-walks", self.site, self.owns_map, beside=False)
        self.walks = DeviceMapWalks(
            plan, head_camera(320, 240), make_localizer, lambda order: self.agent.submit(order),
            today=lambda: "2026-11-29", free_bytes=self.free_bytes,
        )  # fmt: skip
        self._to_show: list[Frame | Exception] = []
        camera = FakeCamera(head_camera(320, 240), self.clock, self._shown())
        parts = DeviceParts(
            self.clock, camera, FakeSonar(self.clock), self.output, self.uplink, make_localizer, self.store,
            buttons=self.buttons, map_walks=self.walks, tap=self.tap,
        )  # fmt: skip
        self.agent = DeviceAgent(parts, DeviceState(self.settings, PoiGraph()), FakeLocalizer(_lost))

    def _shown(self) -> Iterator[Frame | Exception]:
        while True:
            yield self._to_show.pop(0)

    def show(self, frame: Frame | Exception) -> list[Cue]:
        """Run a cycle on a frame, a tenth of a second after the last one; return what is heard."""
        if isinstance(frame, Frame):
            frame = replace(frame, stamp_s=self.clock.now_s() + 1.0 / RATE_HZ)
        before = len(self.output.cues)
        self._to_show.append(frame)
        self.agent.run_cycle()
        self.agent.settle()
        self.agent.watchdog.check()
        return self.output.cues[before:]

    def press(self, button: Button, kind: PressKind, frame: Frame) -> list[str]:
        self.buttons.press(ButtonPress(self.clock.now_s(), button, kind))
        return [cue.text for cue in self.show(frame) if cue.text]

    def begin(self, frame: Frame) -> None:
        """Begin a map walk by the buttons alone."""
        for button, kind in BUTTONS_TO_BEGIN:
            self.press(button, kind, frame)
        assert self.agent.state.mode is Mode.MAPPING

    def end(self, frame: Frame) -> None:
        self.press(Button.MAIN, PressKind.LONG, frame)

    def walk(self, frames: Iterable[Frame]) -> None:
        for frame in frames:
            self.show(frame)

    def said(self, kind: CueKind) -> list[str]:
        return [cue.text for cue in self.output.cues if cue.kind is kind]

    @property
    def uplink_texts(self) -> list[str]:
        """What the console hears of the device's doings."""
        return [text for _, kind, text in self.uplink.events if kind == "mode"]

    @property
    def walk_folder(self) -> Path:
        """The newest walk's."""
        return max((self.folder / "state" / "map-walks").glob("walk-*"))
