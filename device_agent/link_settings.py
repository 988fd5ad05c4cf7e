"""What the link is told at its start, and what it asks of the device."""

from __future__ import annotations

import math
import ssl
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from device_agent.sharing import LinkStands
from device_agent.state import MapWalkTold
from navcore.errors import VbrError
from navcore.wire import ConsoleMessage, Hello


class LinkRefusedError(VbrError):
    """The console does not take this device in."""


class LinkedDevice(Protocol):
    """What the link needs of the device. All methods may be called from any thread and return at once."""

    def hello(self) -> Hello:
        """Return who calls and what it runs."""
        ...

    def submit(self, order: ConsoleMessage | MapWalkTold | LinkStands, holds_s: float = math.inf) -> None:
        """Take an order; it is carried out between two frames, within ``holds_s`` or not at all."""
        ...

    def map_arrived(self, staging: Path, checksum: str) -> None:
        """Take a map that is unpacked and checked. The one method that may take its time. Raises VbrError."""
        ...


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """How to reach the console."""

    url: str
    """ws(s)://host:port; the path ``/device`` is added."""
    token: str = field(repr=False)
    staging: Path
    """Folder in which maps are fetched, and wait until nobody is being led."""
    tls: ssl.SSLContext | None = None
    first_pause_s: float = 0.5
    longest_pause_s: float = 30.0
    refused_pause_s: float = 60.0
    answer_timeout_s: float = 10.0
    """How long the console may take to welcome, and to answer a ping."""
    seed: int = 0
    """Of the jitter of the pauses: another one for each device, lest all come back in the same instant."""
    map_walks: Path | None = None
    """Folder of the map walks, whose recordings go to the console's machine; None where there are none."""
    walks: Path | None = None
    """Folder of the recorded walks; None where none are recorded."""
