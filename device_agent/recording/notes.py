"""What is noted of a cycle, so that the loop can run it again: the values, and the ports that note them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import msgspec

from device_agent.load_plan import LoadLevel
from device_agent.locating import Answer, Locator, Request
from device_agent.orders import Lead, Order
from device_agent.ports import ButtonPress, Clock, CueOutput, DepthCamera, Sonar
from device_agent.sharing import Consent, LinkStands
from device_agent.state import DeviceState, MapWalkTold, PreparedMap
from device_agent.voice import VoiceMemory
from navcore import wire
from navcore.cues.table import Cue
from navcore.errors import SensorError
from navcore.geometry import FloatArray, Transform
from navcore.obstacle.levelling import Expected, Levelling
from navcore.obstacle.mounting import FloorFinder
from navcore.obstacle.scan import Scanner
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import ObstacleSettings, Settings
from navcore.types import (
    CameraIntrinsics,
    DepthImage,
    FisheyeCamera,
    Frame,
    Guidance,
    Localization,
    ObstacleScan,
    SonarReading,
)


class Raised(msgspec.Struct, frozen=True):
    """An error that came instead of a value."""

    kind: str
    """Name of its type."""
    text: str

    @staticmethod
    def of(error: Exception) -> Raised:
        """Return what is noted of an error."""
        return Raised(type(error).__name__, str(error))

    def error(self) -> Exception:
        """Return an error that the loop takes for the same one."""
        if self.kind == SensorError.__name__:
            return SensorError(self.text)
        kind: type[Exception] = type(self.kind if self.kind.isidentifier() else "Exception", (Exception,), {})
        return kind(self.text)


class MapTaken(msgspec.Struct, frozen=True):
    """A map that was put in place of another, without its landmarks."""

    checksum: str
    site_id: str
    name: str
    graph: PoiGraph
    told: MapWalkTold | None = None

    @staticmethod
    def of(prepared: PreparedMap) -> MapTaken:
        """Return what is noted of a map."""
        site = prepared.site
        return MapTaken(prepared.checksum, site.site_id, site.name, site.poi_graph, prepared.told)


class OrderTaken(msgspec.Struct, frozen=True):
    """An order: a message as it came over the wire, or a map."""

    kind: str
    """Name of its type."""
    message: bytes | None = None
    map: MapTaken | None = None
    lead: Lead | None = None
    press: ButtonPress | None = None
    told: MapWalkTold | None = None
    link: LinkStands | None = None
    consent: Consent | None = None
    """None of them where an order of this kind cannot be noted: nothing after it can be replayed."""

    @staticmethod
    def of(order: Order) -> OrderTaken:
        """Return what is noted of an order."""
        kind = type(order).__name__
        if isinstance(order, PreparedMap):
            return OrderTaken(kind, map=MapTaken.of(order))
        if isinstance(order, Lead):
            return OrderTaken(kind, lead=order)
        if isinstance(order, ButtonPress):
            return OrderTaken(kind, press=order)
        if isinstance(order, MapWalkTold):
            return OrderTaken(kind, told=order)
        if isinstance(order, LinkStands):
            return OrderTaken(kind, link=order)
        if isinstance(order, Consent):
            return OrderTaken(kind, consent=order)
        return OrderTaken(kind, wire.encode(order) if isinstance(order, wire.ConsoleMessage) else None)


class FrameNotes(msgspec.Struct, frozen=True):
    """What a frame is besides its pictures."""

    stamp_s: float
    fisheye_stamp_s: float | None = None
    fisheye_camera: FisheyeCamera | None = None
    gravity: FloatArray | None = None

    @staticmethod
    def of(frame: Frame) -> FrameNotes:
        """Return what is noted of a frame."""
        wide = frame.fisheye
        if wide is None:
            return FrameNotes(frame.stamp_s, gravity=frame.gravity)
        return FrameNotes(frame.stamp_s, wide.stamp_s, wide.camera, frame.gravity)


class CycleNotes(msgspec.Struct, frozen=True):
    """All that the loop learned from outside in one cycle, and what it came to.

    A replay from pictures takes the frame from the picture channels; one without pictures goes on from
    ``localization`` and ``scan``.
    """

    number: int
    """Counts the cycles since recording began, from 1."""
    now_s: tuple[float, ...]
    """The clock, each time it was read."""
    stale_s: tuple[float, ...]
    """When the watchdog had last found guidance stale, each time it was asked."""
    stop_counts: tuple[int, ...]
    """How often the watchdog had spoken, each time it was asked."""
    orders: tuple[OrderTaken, ...]
    frame: FrameNotes | None
    camera_error: Raised | None
    localization: Localization | None
    """The pose of the frame; None where it was not there in time, or the frame was left out."""
    localization_error: Raised | None
    scan: ObstacleScan | None
    """The scan of the image alone, before what is remembered joins it."""
    scan_error: Raised | None
    sonar: SonarReading | None
    sonar_error: Raised | None
    play_errors: tuple[tuple[int, Raised], ...]
    """Which of the cycle's cues could not be played."""
    guidance: Guidance
    cues: tuple[Cue, ...]
    """All that the loop said, notices included; what the watchdog said is not the loop's."""
    pictures: bool = False
    """The frame's pictures are in the file, right before this."""
    load_level: LoadLevel = LoadLevel.FULL
    """What was left out because the device was too slow."""
    floor: Levelling | None = None
    """The floor that was seen; None where none was, or nobody looked."""
    floor_error: Raised | None = None
    late_localization: Localization | None = None
    """The pose of an earlier frame, which came only in this cycle."""


class Opening(msgspec.Struct, frozen=True):
    """What a file begins with: everything that the loop remembers, so that a replay can begin here."""

    format_version: int
    walk_id: str
    part: int
    next_number: int
    """Number of the first cycle in this file."""
    intrinsics: CameraIntrinsics
    state: DeviceState
    voice: VoiceMemory
    waiting_map: MapTaken | None = None
    rehearsal: FrameNotes | None = None
    """The localizer has seen a frame before the first cycle; its pictures are in the file, before the first cycle."""


@dataclass(slots=True)
class Notepad:
    """Collects the notes of the cycle that runs; only the loop's thread writes here."""

    now_s: list[float] = field(default_factory=list)
    stale_s: list[float] = field(default_factory=list)
    stop_counts: list[int] = field(default_factory=list)
    orders: list[Order] = field(default_factory=list)
    frame_notes: FrameNotes | None = None
    frame: Frame | None = None
    """Its pictures, where they are to be kept."""
    camera_error: Raised | None = None
    localization: Localization | None = None
    late_localization: Localization | None = None
    localization_error: Raised | None = None
    scan: ObstacleScan | None = None
    scan_error: Raised | None = None
    floor: Levelling | None = None
    floor_error: Raised | None = None
    sonar: SonarReading | None = None
    sonar_error: Raised | None = None
    play_errors: list[tuple[int, Raised]] = field(default_factory=list)
    cues: list[Cue] = field(default_factory=list)
    load_level: LoadLevel = LoadLevel.FULL

    def notes(self, number: int, guidance: Guidance, *, pictures: bool) -> CycleNotes:
        """Return what was collected; ``pictures`` tells whether those of the frame are kept as well."""
        return CycleNotes(
            number, tuple(self.now_s), tuple(self.stale_s), tuple(self.stop_counts),
            tuple(map(OrderTaken.of, self.orders)), self.frame_notes, self.camera_error, self.localization,
            self.localization_error, self.scan, self.scan_error, self.sonar, self.sonar_error,
            tuple(self.play_errors), guidance, tuple(self.cues), pictures,
            self.load_level,
            self.floor, self.floor_error,
            self.late_localization,
        )  # fmt: skip


class NotingClock:
    """A clock of which each reading is noted."""

    def __init__(self, clock: Clock, pad: Callable[[], Notepad]) -> None:
        self._clock, self._pad = clock, pad

    def now_s(self) -> float:
        """Seconds."""
        now_s = self._clock.now_s()
        self._pad().now_s.append(now_s)
        return now_s

    def sleep_until(self, stamp_s: float) -> None:
        """Wait."""
        self._clock.sleep_until(stamp_s)


class NotingCamera:
    """A camera whose frames, or failures, are noted."""

    def __init__(self, camera: DepthCamera, pad: Callable[[], Notepad]) -> None:
        self._camera, self._pad = camera, pad

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """The camera's geometry."""
        return self._camera.intrinsics

    def read(self) -> Frame:
        """Return the next capture. Raises what the camera raises."""
        try:
            frame = self._camera.read()
        except Exception as error:
            self._pad().camera_error = Raised.of(error)
            raise
        pad = self._pad()
        pad.frame, pad.frame_notes = frame, FrameNotes.of(frame)
        return frame

    def close(self) -> None:
        """Close the camera."""
        self._camera.close()


class NotingLocator:
    """A locator of which each pose is noted in the cycle in which it came."""

    def __init__(self, locator: Locator, pad: Callable[[], Notepad]) -> None:
        self._locator, self._pad = locator, pad

    def locate(self, request: Request) -> Answer:
        """Return what there is; what is asked for follows from the level, which is noted."""
        try:
            answer = self._locator.locate(request)
        except Exception as error:
            self._pad().localization_error = Raised.of(error)
            raise
        self._pad().localization, self._pad().late_localization = answer.own, answer.late
        return answer

    def apply(self, settings: Settings) -> None:
        """Run other settings from the next frame on."""
        self._locator.apply(settings)

    def close(self) -> None:
        """Nothing is asked any more."""
        self._locator.close()


class NotingSonar:
    """A rangefinder of which each reading is noted, as it gave it."""

    def __init__(self, sonar: Sonar, pad: Callable[[], Notepad]) -> None:
        self._sonar, self._pad = sonar, pad

    def read(self) -> SonarReading:
        """Return the latest reading."""
        try:
            reading = self._sonar.read()
        except Exception as error:
            self._pad().sonar_error = Raised.of(error)
            raise
        self._pad().sonar = reading
        return reading

    def close(self) -> None:
        """Close the rangefinder."""
        self._sonar.close()


class NotingOutput:
    """An output of which each cue is noted, and whether it could be played."""

    def __init__(self, output: CueOutput, pad: Callable[[], Notepad]) -> None:
        self._output, self._pad = output, pad

    def play(self, cue: Cue) -> None:
        """Begin the cue now."""
        pad = self._pad()
        pad.cues.append(cue)
        try:
            self._output.play(cue)
        except Exception as error:
            pad.play_errors.append((len(pad.cues) - 1, Raised.of(error)))
            raise

    def close(self) -> None:
        """Close the output."""
        self._output.close()


def noting_scanner(scanner: Scanner, pad: Callable[[], Notepad]) -> Scanner:
    """Return a scanner of which each scan is noted."""

    def scan(
        depth_m: DepthImage,
        intrinsics: CameraIntrinsics,
        world_from_camera: Transform | None,
        settings: ObstacleSettings,
        expected: Expected | None,
    ) -> ObstacleScan:
        try:
            seen = scanner(depth_m, intrinsics, world_from_camera, settings, expected)
        except Exception as error:
            pad().scan_error = Raised.of(error)
            raise
        pad().scan = seen
        return seen

    return scan


def noting_floor_finder(finder: FloorFinder, pad: Callable[[], Notepad]) -> FloorFinder:
    """Return a floor finder whose results, or failures, are noted."""

    def find(depth_m: DepthImage, intrinsics: CameraIntrinsics) -> Levelling | None:
        try:
            seen = finder(depth_m, intrinsics)
        except Exception as error:
            pad().floor_error = Raised.of(error)
            raise
        pad().floor = seen
        return seen

    return find
