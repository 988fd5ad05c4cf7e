"""The sensors and outputs that one run of the device is told to use."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field

from device_agent.adapters.fakes import NoButtons, NoSonar
from device_agent.adapters.newest_frame import NewestFrameCamera
from device_agent.adapters.outputs import TeeOutput, TextOutput
from device_agent.adapters.recorded import RecordedCamera
from device_agent.device_options import DeviceOptions
from device_agent.ports import Buttons, Clock, CueOutput, DepthCamera, DisplayOutput, Sonar
from device_agent.simulation.pace import PacedCamera, PacedClock
from device_agent.speech import Speech
from navcore.recording import open_recording
from navcore.settings import Settings


@dataclass(frozen=True, slots=True, eq=False)
class Hardware:
    """What the agent senses with, and speaks through."""

    camera: DepthCamera
    sonar: Sonar
    output: CueOutput
    display: DisplayOutput | None = None
    buttons: Buttons = field(default_factory=NoButtons)

    def apply(self, settings: Settings) -> None:
        """Run other settings from now on."""
        if isinstance(self.camera, NewestFrameCamera):
            self.camera.timeout_s = settings.watchdog.camera_timeout_s


def open_hardware(options: DeviceOptions, settings: Settings, clock: Clock, stack: ExitStack) -> Hardware:
    """Open sensors and outputs; ``stack`` closes them. Raises VbrError where one cannot be opened."""
    outputs = _outputs(options)
    if isinstance(clock, PacedClock):
        # The simulation waits for the loop, so that there is no newer frame than the one that it gives.
        camera, sonar, ear = _simulated(options, clock)
        outputs.insert(0, ear)
    else:
        assert options.recording is not None
        raw = RecordedCamera(open_recording(options.recording), clock)
        camera, sonar = NewestFrameCamera(raw, clock, settings.watchdog.camera_timeout_s), NoSonar(clock)
    output = TeeOutput(outputs)
    for each in (output, sonar, camera):
        stack.callback(each.close)
    display = _display(options)
    if display is not None:
        stack.callback(display.close)
    buttons = _buttons(options, clock)
    stack.callback(buttons.close)
    return Hardware(camera, sonar, output, display, buttons)


def _buttons(options: DeviceOptions, clock: Clock) -> Buttons:
    if options.buttons is None:
        return NoButtons()
    from device_agent.adapters.keyboard_buttons import KeyboardButtons

    return KeyboardButtons(clock)


def _display(options: DeviceOptions) -> DisplayOutput | None:
    if options.overlay is None:
        return None
    from device_agent.adapters.displays import PngDisplay

    return PngDisplay(options.overlay)


def _simulated(options: DeviceOptions, clock: PacedClock) -> tuple[DepthCamera, Sonar, CueOutput]:
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
        outputs.append(TextOutput())
    speech = Speech()
    if options.wav is not None:
        from device_agent.adapters.wav_file import WavFileOutput

        outputs.append(WavFileOutput(options.wav, speech))
    if options.sound:
        from device_agent.adapters.sound_device import SoundDeviceOutput

        outputs.append(SoundDeviceOutput(speech))
    return outputs
