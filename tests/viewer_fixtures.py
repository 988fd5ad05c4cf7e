"""The parts of a console around the scene, real and small, for the tests of the scene."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from viewer_site import crossing_corridors

from console.config import ConsoleConfig
from console.edits import AddEdge, AddPoi
from console.opening import open_services
from console.services import Services
from console.viewer.scene import Scene
from navcore.site import save_site
from navcore.wire import ConsoleMessage, Hello


@contextmanager
def services_of_crossing(folder: Path, points_count: int = 4000) -> Iterator[Services]:
    """The services of a console over the crossing corridors, with four places and one edge (Hall – Junction)."""
    save_site(crossing_corridors(points_count), folder / "site")
    services = open_services(ConsoleConfig(folder / "site", folder / "data"))
    for name, kind, x_m, y_m in (
        ("Hall", "hall", 1.0, 0.0), ("Junction", "junction", 10.0, 0.0), ("Bar", "bar", 19.0, 0.0),
        ("Lift", "lift", 10.0, 7.0),
    ):  # fmt: skip
        services.model.apply(AddPoi(name, kind, x_m, y_m), "setup")  # type: ignore[arg-type]
    services.model.apply(AddEdge("hall", "junction"), "setup")
    services.model.publish("setup")
    try:
        yield services
    finally:
        services.store.close()


@contextmanager
def scene_over(services: Services) -> Iterator[Scene]:
    """A running scene that looks at model and hub when the test says so."""
    scene = Scene(services, tick_s=None)
    try:
        yield scene
    finally:
        scene.stop()


class RecordingOutlet:
    """The way to a device that is the test itself: keeps what it is sent."""

    def __init__(self) -> None:
        self.sent: list[ConsoleMessage] = []

    def send(self, message: ConsoleMessage) -> None:
        """Keep a message."""
        self.sent.append(message)

    def close(self, code: int, reason: str) -> None:
        """Nothing to close."""


def connect_device(services: Services, device_id: str = "glasses") -> RecordingOutlet:
    """Connect a device whose other end is the test."""
    outlet = RecordingOutlet()
    hello = Hello(1, device_id, "0.1", services.model.site.site_id, "x", 1, 0, services.hub.now_s())
    services.devices.ensure_token("Glasses", "a token of the test, long enough", "setup")
    services.devices.take_in(device_id, "Glasses")
    services.hub.connect(hello, "Glasses", outlet)
    # Who watches is told at each joining, and is no order.
    outlet.sent.clear()
    return outlet
