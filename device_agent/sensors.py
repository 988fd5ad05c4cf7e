"""The sensors and outputs that one run of the device is told to use."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from device_agent.adapters.fakes import FakeHost, NoButtons, NoSonar
from device_agent.adapters.linux_host import LinuxHost
from device_agent.adapters.newest_frame import NewestFrameCamera
from device_agent.adapters.outputs import TeeOutput, TextOutput
from device_agent.adapters.recorded import RecordedCamera
from device_agent.adapters.reopened_camera import CameraSource, ReopenedCamera
from device_agent.adapters.reopening import Reopening
from device_agent.adapters.waiting_cues import ThreadedOutput
from device_agent.calibration_store import CalibrationStore
from device_agent.device_options import DeviceOptions
from device_agent.ports import Buttons, Clock, CueOutput, DepthCamera, DisplayOutput, HostMonitor, Sonar
from device_agent.sensor_names import SensorName
from device_agent.simulation.pace import PacedCamera, PacedClock
from navcore.errors import InputError
from navcore.espeak import Speech
from navcore.fisheye_recording import read_fisheye_camera
from navcore.recording import open_recording
from navcore.settings import Settings
from navcore.types import FisheyeCamera, FisheyeImage


@dataclass(frozen=True, slots=True, eq=False)
class Hardware:
    """What the agent senses with, and speaks through."""

    camera: DepthCamera
    sonar: Sonar
    output: CueOutput
    display: DisplayOutput | None = None
    buttons: Buttons = field(default_factory=NoButtons)
    newest: NewestFrameCamera | None = None
    """The part of the camera that waits for frames, where there is one."""
    host: HostMonitor = field(default_factory=FakeHost)
    """Battery and temperature; of simulated glasses nothing is known."""

    def apply(self, settings: Settings) -> None:
        """Run other settings from now on."""
        if self.newest is not None:
            self.newest.timeout_s = settings.watchdog.camera_timeout_s


def open_hardware(options: DeviceOptions, settings: Settings, clock: Clock, stack: ExitStack) -> Hardware:
    """Open sensors and outputs; ``stack`` closes them. Raises VbrError where one cannot be opened."""
    output = TeeOutput(_outputs(options))
    stack.callback(output.close)
    display = open_display(options)
    if display is not None:
        stack.callback(display.close)
    buttons = open_buttons(options, clock)
    stack.callback(buttons.close)
    if isinstance(clock, PacedClock):
        # The simulation waits for the loop, so that there is no newer frame than the one that it gives.
        paced, sonar, ear = simulated_hardware(options, clock)
        for each in (ear, sonar, paced):
            stack.callback(each.close)
        return Hardware(paced, sonar, TeeOutput([ear, output]), display, buttons)
    sonar = open_sonar(options, clock)
    stack.callback(sonar.close)
    newest = open_depth_camera(options, settings, clock)
    stack.callback(newest.close)
    camera = _with_fisheye(options, newest, clock)
    stack.callback(camera.close)
    host = LinuxHost()
    stack.callback(host.close)
    return Hardware(camera, sonar, output, display, buttons, newest, host)


def open_depth_camera(options: DeviceOptions, settings: Settings, clock: Clock) -> NewestFrameCamera:
    """Open the depth camera, or the recording in its place. Raises VbrError."""
    timeout_s = settings.watchdog.camera_timeout_s
    if options.camera is None:
        assert options.recording is not None
        return NewestFrameCamera(RecordedCamera(open_recording(options.recording), clock), clock, timeout_s)
    name = options.camera
    real = ReopenedCamera(lambda: open_camera(name, clock), clock)
    return NewestFrameCamera(real, clock, timeout_s, real.abandon)


def open_camera(name: SensorName, clock: Clock) -> CameraSource:
    """Open a depth camera by its name. Raises SensorError, MissingPackageError."""
    if name.kind == "oak":
        from device_agent.adapters.oak import OakSource

        return OakSource(clock, name.where)
    from device_agent.adapters.realsense import RealSenseSource

    if name.where is not None and Path(name.where).suffix in (".db3", ".bag"):
        return RealSenseSource(clock, recording=Path(name.where))
    return RealSenseSource(clock, name.where)


def _with_fisheye(options: DeviceOptions, camera: DepthCamera, clock: Clock) -> DepthCamera:
    if options.fisheye is None:
        return camera
    from device_agent.adapters.paired_camera import PairedCamera

    wide = open_fisheye(options.fisheye, options, clock)
    return PairedCamera(camera, wide, clock, wide.abandon)


def open_fisheye(path: str, options: DeviceOptions, clock: Clock) -> Reopening[FisheyeImage]:
    """Open the fisheye camera with its calibration. Raises VbrError."""
    from device_agent.adapters.uvc import open_uvc_camera

    return open_uvc_camera(path, _fisheye_camera(options), clock)


def _fisheye_camera(options: DeviceOptions) -> FisheyeCamera:
    if options.fisheye_calibration is not None:
        return read_fisheye_camera(options.fisheye_calibration)
    # In the place of a damaged one; told at the start (device_process.py).
    stored, _ = CalibrationStore(options.state).load_or_kept()
    camera = None if stored is None or stored.calibration.fisheye is None else stored.calibration.fisheye.camera
    if camera is None:
        raise InputError(
            "The fisheye camera has no calibration with a mounting: name --fisheye-calibration FILE, or run"
            " `vbr calibrate fisheye` with --mounting FILE."
        )
    return camera


def open_sonar(options: DeviceOptions, clock: Clock) -> Sonar:
    """Open the rangefinder; one that says it is absent where none is named. Raises VbrError."""
    if options.sonar is None or options.sonar.where is None:
        return NoSonar(clock)
    from device_agent.adapters.serial_sonar import SerialSonar

    return SerialSonar(options.sonar.where, clock)


def open_buttons(options: DeviceOptions, clock: Clock) -> Buttons:
    """Open the buttons; those that nobody can press where none are named. Raises VbrError."""
    if options.buttons is None:
        return NoButtons()
    if options.buttons.where is None:
        from device_agent.adapters.keyboard_buttons import KeyboardButtons

        return KeyboardButtons(clock)
    from device_agent.adapters.evdev_buttons import EvdevButtons

    return EvdevButtons(options.buttons.where, clock)


def open_display(options: DeviceOptions) -> DisplayOutput | None:
    """Open the display; None where none is named. Raises VbrError."""
    if options.screen is not None and options.overlay is not None:
        raise InputError("The overlay is shown in one place: name --display or --overlay, not both.")
    if options.screen is not None and options.screen.where is not None:
        from device_agent.adapters.framebuffer import FramebufferDisplay

        return FramebufferDisplay(Path(options.screen.where))
    if options.overlay is None:
        return None
    from device_agent.adapters.displays import PngDisplay

    return PngDisplay(options.overlay)


def simulated_hardware(options: DeviceOptions, clock: PacedClock) -> tuple[DepthCamera, Sonar, CueOutput]:
    """Return camera, rangefinder and ears of a walker who stands in the simulated building. Raises InputError."""
    from device_agent.simulation.adapters import SimulatedCamera, SimulatedEar, SimulatedSonar
    from device_agent.simulation.office_floor import office_floor
    from device_agent.simulation.walker import drawn_walker
    from device_agent.simulation.world import SimulatedWorld, start_at

    building = office_floor()
    start = start_at(building, options.start)
    world = SimulatedWorld(
        building, drawn_walker(options.seed), start, options.seed, size_px=options.size_px, start_s=clock.now_s()
    )
    # The first picture takes seconds, for its kernels are loaded: not while the watchdog looks on.
    world.capture()
    camera = PacedCamera(SimulatedCamera(world, clock, options.rate_hz), clock)
    return camera, SimulatedSonar(world, clock), SimulatedEar(world, clock)


def _outputs(options: DeviceOptions) -> list[CueOutput]:
    outputs: list[CueOutput] = []
    if options.print_cues:
        outputs.append(ThreadedOutput(TextOutput()))
    speech = Speech()
    if options.wav is not None:
        from device_agent.adapters.wav_file import WavFileOutput

        outputs.append(WavFileOutput(options.wav, speech))
    if options.sound:
        from device_agent.adapters.sound_device import SoundDeviceOutput

        outputs.append(SoundDeviceOutput(speech))
    return outputs
