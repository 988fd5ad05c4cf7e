"""What one run of the device agent is told."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from device_agent.recording.options import RecordingOptions
from device_agent.sensor_names import SensorName
from navcore.settings import SettingValue


@dataclass(frozen=True, slots=True)
class DeviceOptions:
    """The command line of ``vbr device``, checked."""

    site: Path
    state: Path
    """Folder for what is kept over a restart: settings, and events until the console confirms them."""
    device_id: str = "glasses"
    console_url: str | None = None
    token: str = field(default="", repr=False)
    tls: ssl.SSLContext | None = None
    changes: Mapping[str, SettingValue] = field(default_factory=dict)
    """Settings that differ from those that are kept."""
    without_map: bool = False
    """Begin without a map, off duty, where there is none yet: to record the first one."""
    to: str | None = None
    """A place to lead to at once."""
    recording: Path | None = None
    """A recording to play as the camera."""
    camera: SensorName | None = None
    """A depth camera; where neither this nor a recording is named, the device walks in the simulated building."""
    fisheye: str | None = None
    """The fisheye camera: a device, or a video file."""
    fisheye_calibration: Path | None = None
    """Lens, picture size and mounting of the fisheye camera; None takes the stored calibration."""
    sonar: SensorName | None = None
    """The rangefinder; the simulated one in the simulated building."""
    buttons: SensorName | None = None
    screen: SensorName | None = None
    """The displays of the glasses."""
    seed: int = 1
    start: str = "Hall"
    """Where the simulated walker stands."""
    rate_hz: float = 10.0
    size_px: tuple[int, int] = (320, 240)
    wav: Path | None = None
    sound: bool = False
    print_cues: bool = True
    overlay: Path | None = None
    """Folder for the pictures of the see-through overlay."""
    record: RecordingOptions | None = None
    """What is recorded of the walk; nothing where it is None."""

    shares_walks: bool = False
    """Whether recordings of walks go to the console where the walker has not said whether they may."""

    @property
    def map_walks(self) -> Path:
        """Folder of the map walks."""
        return self.state / "map-walks"

    @property
    def simulated(self) -> bool:
        """Whether the device walks in the simulated building."""
        return self.recording is None and self.camera is None
