"""A past walk in the scene of one window, in place of the live one: for as long as its page says so, and no longer."""

from __future__ import annotations

import viser

from console.view_requests import ShowPast
from console.viewer.live_view import LiveView, PastMark

SILENCE_S = 10.0
"""Whoever says nothing for so long looks at the past no more: the live walker is back."""
_BANNER = "Nothing of this walker is happening now. The walker of now is back when the page Walks ends this, or closes."


class PastPlayback:
    """What of the past one window shows, with a banner that stays as long."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._shown: ShowPast | None = None
        self._heard_at_s = 0.0
        self._banner: viser.NotificationHandle | None = None

    def take(self, request: ShowPast, now_s: float) -> None:
        """Show this instant from now on; ``now_s`` is the console's monotonic clock."""
        self._shown, self._heard_at_s = request, now_s
        if self._banner is None:
            self._banner = self._client.add_notification(
                request.words, _BANNER, with_close_button=False, auto_close_seconds=None, color="gray"
            )
        elif self._banner.title != request.words:
            self._banner.title = request.words

    def end(self) -> None:
        """Show the live walker again."""
        self._shown = None
        if self._banner is not None:
            self._banner.remove()
            self._banner = None

    def view(self, live: LiveView) -> LiveView:
        """Return what is shown: the past while its page goes on, else what is live. Nothing live is drawn beside it."""
        if self._shown is not None and live.now_s - self._heard_at_s > SILENCE_S:
            self.end()
        shown = self._shown
        if shown is None:
            return live
        return LiveView(shown.device, shown.at_s, trail_m=shown.trail_m, past=PastMark(shown.words, live.now_s))
