"""What one run of the device agent is told."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from device_agent.recording.options import RecordingOptions
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
    to: str | None = None
    """A place to lead to at once."""
    recording: Path | None = None
    """A recording to play as the camera; the simulated building where it is None."""
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
