"""An agent in lock step on fakes: an empty hall with a road from the hall's door to a bar, for tests."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from device_agent.adapters.clocks import SteppedClock
from device_agent.adapters.fakes import FakeButtons, FakeCamera, FakeLocalizer, FakeOutput, FakeSonar, FakeUplink
from device_agent.adapters.outputs import TeeOutput
from device_agent.agent import DeviceAgent, DeviceParts
from device_agent.cycle import Cycle
from device_agent.device_store import DeviceStore
from device_agent.locating import DirectLocator, InLine
from device_agent.ports import Button, ButtonPress, CueOutput, LocalizerPort, PressKind, Uplink
from device_agent.recording.tap import Tap
from device_agent.state import DeviceState
from navcore.calibration import Calibration
from navcore.cues.table import CueKind
from navcore.geometry import Transform, world_from_camera_at
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.settings import Settings
from navcore.types import CameraIntrinsics, Frame, Localization, LocalizationQuality
from navcore.wire import SetDestination

INTRINSICS = CameraIntrinsics(160, 120, 116.0, 116.0, 79.5, 59.5)
EYE_HEIGHT_M = 1.6
WALL_X_M = 30.0
GRAPH = PoiGraph(
    3,
    {
        "hall": Poi("hall", "Hall", "hall", 0.0, 0.0),
        "bar": Poi("bar", "Bar", "bar", 20.0, 0.0),
        "attic": Poi("attic", "Attic", "room", 0.0, 50.0),
    },
    {"road": Edge("road", "hall", "bar", ((0.0, 0.0), (20.0, 0.0)), 20.0)},
)


def pose_at(x_m: float, y_m: float = 0.0, heading_rad: float = 0.0) -> Transform:
    return world_from_camera_at((x_m, y_m, EYE_HEIGHT_M), heading_rad, np.radians(15.0))


def empty_hall(world_from_camera: Transform) -> np.ndarray:
    """Return the depth image (h, w) of a floor and one far wall."""
    u, v = np.meshgrid(np.arange(INTRINSICS.width_px), np.arange(INTRINSICS.height_px))
    rays = np.stack(
        [(u - INTRINSICS.cx_px) / INTRINSICS.fx_px, (v - INTRINSICS.cy_px) / INTRINSICS.fy_px, np.ones(u.shape)],
        axis=-1,
    )
    directions = rays @ world_from_camera.rotation.T
    x, _, z = world_from_camera.translation
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(directions[..., 2] < 0, -z / directions[..., 2], np.inf)
        wall = np.where(directions[..., 0] > 0, (WALL_X_M - x) / directions[..., 0], np.inf)
    depth = np.minimum(floor, wall).astype(np.float32)
    depth[depth > 12.0] = np.nan
    return depth


@dataclass
class Rig:
    """An agent on fakes; ``place`` moves the walker, ``feed`` replaces what the camera gives next."""

    store: DeviceStore | None = None
    clock: SteppedClock = field(default_factory=lambda: SteppedClock(100.0))
    pose: Transform | None = field(default_factory=lambda: pose_at(0.5))
    spoil: Callable[[Frame], Frame | Exception] = lambda frame: frame
    locate_error: Exception | None = None
    quality: LocalizationQuality = LocalizationQuality.LOCALIZED
    believed: Transform | None = None
    """Where the localizer has the walker, if not where they are."""
    tap: Tap = field(default_factory=Tap)
    timer_s: Callable[[], float] = time.perf_counter
    plans_load: bool = False
    locating: Callable[[LocalizerPort], DirectLocator] = InLine
    frame_s: float = 0.1
    link: Uplink | None = None
    """Where events go instead of to the fake."""
    first_output: CueOutput | None = None
    """Speaks before the fake does."""
    calibration: Calibration = field(default_factory=Calibration)

    def __post_init__(self) -> None:
        self.output, self.uplink, self.buttons = FakeOutput(), FakeUplink(), FakeButtons()
        self.sonar = FakeSonar(self.clock)
        self.localizer = FakeLocalizer(lambda frame: self.locate(frame))
        output = self.output if self.first_output is None else TeeOutput([self.first_output, self.output])
        parts = DeviceParts(
            self.clock, FakeCamera(INTRINSICS, self.clock, self._frames()), self.sonar, output,
            self.link or self.uplink,
            lambda site, intrinsics, settings: FakeLocalizer(self.locate), self.store, buttons=self.buttons,
            timer_s=self.timer_s, plans_load=self.plans_load, tap=self.tap,
            locating=self.locating,
        )  # fmt: skip
        state = DeviceState(Settings(), GRAPH, "hall-site", "old-map", calibration=self.calibration)
        self.agent = DeviceAgent(parts, state, self.localizer)

    def _frames(self) -> Iterator[Frame | Exception]:
        while True:
            shown = self.pose or pose_at(0.0)
            colour = np.zeros((INTRINSICS.height_px, INTRINSICS.width_px, 3), np.uint8)
            yield self.spoil(Frame(self.clock.now_s() + self.frame_s, colour, empty_hall(shown)))

    def locate(self, frame: Frame) -> Localization:
        if self.locate_error is not None:
            raise self.locate_error
        quality = self.quality if self.pose is not None else LocalizationQuality.LOST
        pose = self.believed or self.pose
        return Localization(frame.stamp_s, quality, pose, None if pose is None else np.eye(6) * 1e-4, 200)

    def cycles(self, count: int) -> list[Cycle]:
        done = []
        for _ in range(count):
            self.sonar.echo(None)
            done.append(self.agent.run_cycle())
            self.agent.watchdog.check()
        return done

    def lead_to(self, poi_id: str = "bar") -> Cycle:
        self.agent.submit(SetDestination(poi_id))
        return self.cycles(6)[-1]

    def press(self, button: Button, kind: PressKind = PressKind.SHORT) -> list[str]:
        """Press a button; return what is said within the next cycle."""
        self.buttons.press(ButtonPress(self.clock.now_s(), button, kind))
        before = len(self.output.cues)
        self.cycles(1)
        return [cue.text for cue in self.output.cues[before:] if cue.text]

    @property
    def heard(self) -> list[CueKind]:
        return [cue.kind for cue in self.output.cues]

    def messages(self, kind: type) -> list:  # type: ignore[type-arg]
        return [message for message in self.uplink.messages if isinstance(message, kind)]

    def events(self, kind: str) -> list[str]:
        return [text for _, each, text in self.uplink.events if each == kind]
