"""Events that were shown before they could be stored: a device sends them again, and nobody is to see them twice."""

from __future__ import annotations

from navcore.wire import Event

REMEMBERED_COUNT = 4096
"""Of each device; what is older may be shown twice, where the disk takes nothing for so long."""


class ShownEvents:
    """What was shown of each device, over all its links. For one thread."""

    def __init__(self) -> None:
        self._shown: dict[str, dict[int, None]] = {}

    def is_new(self, device_id: str, event: Event) -> bool:
        """Return whether this very event has not been shown yet, and take it as shown now.

        By all that it says: a device whose journal is lost gives the numbers anew that were not stored.
        """
        shown, key = self._shown.setdefault(device_id, {}), hash(event)
        if key in shown:
            return False
        shown[key] = None
        if len(shown) > REMEMBERED_COUNT:
            del shown[next(iter(shown))]
        return True

    def forget(self, device_id: str) -> None:
        """Remember nothing of a device any more."""
        self._shown.pop(device_id, None)
