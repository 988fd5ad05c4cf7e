"""Ages on the console: whatever a device's clock says, nothing looks newer than the moment at which it arrived."""

from __future__ import annotations

import pytest

from console.hub import DeviceHub
from console.live import Freshness
from console.live_panel import device_view
from console.overview import overview_row
from console.place_words import PlaceWords
from console.viewer.live_view import LiveView
from navcore.planning.poi_graph import PoiGraph
from navcore.wire import PROTOCOL_VERSION, ConsoleMessage, DepthImage, Hello, Pong, WalkerState


class NoOutlet:
    """A link that nobody listens at."""

    def send(self, message: ConsoleMessage) -> None:
        """Drop it."""

    def close(self, code: int, reason: str) -> None:
        """Nothing to end."""


@pytest.mark.parametrize("ahead_s", [0.0, 3.0, 3600.0])
def test_a_stamp_ahead_of_the_clock_never_looks_live_for_longer_than_since_it_came(
    ahead_s: float, caplog: pytest.LogCaptureFixture
) -> None:
    clock_s = [100.0]
    hub = DeviceHub(now_s=lambda: clock_s[0])
    hub.connect(Hello(PROTOCOL_VERSION, "glasses", "0", "s", "m", 1, 0, 100.0), "Glasses", NoOutlet())
    hub.receive("glasses", Pong(100.0, 100.0, 100.0))
    for _ in range(2):
        hub.receive("glasses", WalkerState(100.0 + ahead_s, "localized", "walk", "ok"))
    hub.receive("glasses", DepthImage(100.0 + ahead_s, b"jpeg"))
    device = hub.device("glasses")
    for waited_s, expected in ((0.5, "LIVE"), (2.0, "DELAYED"), (10.0, "STALE"), (600.0, "LOST")):
        clock_s[0] = 100.0 + waited_s
        assert device.freshness(clock_s[0]) is Freshness[expected]
        view = device_view(device, clock_s[0])
        assert (view["age_s"], view["depth_age_s"]) == (waited_s, waited_s)
        row = overview_row(device, PoiGraph(), PlaceWords(PoiGraph()))
        assert clock_s[0] - float(row["captured_s"]) == waited_s
        assert LiveView(device, clock_s[0]).is_silhouette_believed == (waited_s <= 5.0)
    warned = [record for record in caplog.records if "ahead of its clock" in record.getMessage()]
    assert len(warned) == (1 if ahead_s else 0), "said once, and only where it is so"
