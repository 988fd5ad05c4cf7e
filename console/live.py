"""What is known of one device, as values: the latest of each message, its age, and what was asked of the device."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Literal

from navcore.settings import SettingValue
from navcore.wire import DepthImage, Event, Hello, MapWalkSeen, RouteChanged, SharingRunning, WalkerState

DELAYED_AFTER_S = 1.0
STALE_AFTER_S = 5.0
LOST_AFTER_S = 15.0
EVENTS_KEPT_COUNT = 200
COMMANDS_KEPT_COUNT = 30


CommandKind = Literal[
    "set_destination",
    "clear",
    "pause",
    "resume",
    "repeat",
    "say",
    "apply_settings",
    "keep_settings",
    "give_up_settings",
    "begin_map_walk",
    "end_map_walk",
    "ask_colour",
]


class Freshness(enum.Enum):
    """How far what is shown may be believed to be now."""

    LIVE = "live"
    DELAYED = "delayed"
    STALE = "stale"
    LOST = "lost"


def freshness(age_s: float | None, connected: bool) -> Freshness:
    """Return how fresh something of this age is; without a link, or without anything, it is LOST."""
    if age_s is None or not connected or age_s > LOST_AFTER_S:
        return Freshness.LOST
    if age_s > STALE_AFTER_S:
        return Freshness.STALE
    return Freshness.DELAYED if age_s > DELAYED_AFTER_S else Freshness.LIVE


@dataclass(frozen=True, slots=True)
class Command:
    """Something that was asked of a device, and what became of it."""

    id: int
    kind: CommandKind
    detail: str
    """PoI id, sentence, or revision, as a text."""
    who: str
    at_s: float
    """Unix time of asking."""
    state: Literal["sent", "running", "refused", "unanswered"] = "sent"
    """``unanswered``: the link broke, or a later command took its place, before the device answered."""
    refusal: str = ""
    asked_s: float = 0.0
    """Monotonic time of asking (console clock)."""
    took_s: float | None = None
    """How long it took until this was known of it; None while it is only sent."""


@dataclass(frozen=True, slots=True)
class LiveDevice:
    """A device as the console knows it now. Frozen: the hub makes a new one at each message."""

    device_id: str
    name: str
    """Name of the token that the device signed in with."""
    hello: Hello
    connected: bool
    connected_at_s: float
    """Monotonic time of the last connecting (console clock)."""
    clock_offset_s: float
    """Device clock minus the console's monotonic clock."""
    clock_uncertainty_s: float | None = None
    """The true offset is no farther than this from ``clock_offset_s``; None where it has not been measured yet."""
    round_trip_s: float | None = None
    state: WalkerState | None = None
    state_arrival_s: float | None = None
    """Monotonic time of arrival (console clock)."""
    route: RouteChanged | None = None
    depth_image: DepthImage | None = None
    depth_arrival_s: float | None = None
    """Monotonic time of arrival (console clock)."""
    events: tuple[Event, ...] = ()
    """The latest, oldest first."""
    settings: dict[str, SettingValue] | None = None
    """The settings that the device runs; None until it has told them."""
    settings_revision: int = 0
    settings_revert_at_s: float | None = None
    """When the settings before run again unless these are kept, on the device's clock; None where they have been."""
    graph_version: int = 0
    graph_refusal: str = ""
    map_checksum: str = ""
    map_refusal: str = ""
    map_waiting: str = ""
    """Checksum of a newer map that the device holds, and takes as soon as nobody is led; empty where none waits."""
    map_walk_running: bool = False
    map_walk_refusal: str = ""
    """Why the device does not do what was asked of its map walk last."""
    map_walk: MapWalkSeen | None = None
    """How well the building was seen last, in the map walk that runs or in the last one."""
    watchers: tuple[str, ...] = ()
    """Who watches now."""
    sharing: SharingRunning | None = None
    """What the walker shares, and of whom they have heard that they watch; None until the device has told it."""
    colour_stamp_s: float | None = None
    """When the colour picture was taken that may be seen now, on the device's clock; it is kept nowhere but there."""
    commands: tuple[Command, ...] = field(default=())
    """The latest, oldest first."""

    def age_s(self, now_s: float) -> float | None:
        """Seconds since the frame behind ``state`` was captured; ``now_s`` is the console's monotonic clock."""
        captured_s = self.captured_s
        return None if captured_s is None else max(0.0, now_s - captured_s)

    @property
    def captured_s(self) -> float | None:
        """When the frame behind ``state`` was captured, on the console's clock; None before the first state.

        Never later than it arrived: a stamp ahead (a clock that was set, or compared badly) would look live for as long
        as it is ahead.
        """
        return None if self.state is None else self._told_s(self.state.stamp_s, self.state_arrival_s)

    def has_told(self, now_s: float) -> bool:
        """Whether it has sent a state, or had the time to: who has connected just now is awaited, not lost."""
        return self.state is not None or not self.connected or now_s - self.connected_at_s > STALE_AFTER_S

    def depth_age_s(self, now_s: float) -> float | None:
        """Seconds since the depth picture was captured, and no less than since it arrived; None without one."""
        image = self.depth_image
        return None if image is None else max(0.0, now_s - self._told_s(image.stamp_s, self.depth_arrival_s))

    def _told_s(self, stamp_s: float, arrival_s: float | None) -> float:
        on_our_clock_s = stamp_s - self.clock_offset_s
        return on_our_clock_s if arrival_s is None else min(on_our_clock_s, arrival_s)

    def longest_age_s(self, now_s: float) -> float | None:
        """The most that :meth:`age_s` may be in truth, as well as the clocks have been compared."""
        age_s = self.age_s(now_s)
        return None if age_s is None else age_s + (self.clock_uncertainty_s or 0.0)

    def trial_left_s(self, now_s: float) -> float | None:
        """Seconds until the settings before run again unless these are kept; None where nothing is tried out."""
        revert_at_s = self.settings_revert_at_s
        return None if revert_at_s is None else max(0.0, revert_at_s - self.clock_offset_s - now_s)

    @property
    def leads_somebody(self) -> bool:
        """As far as the device has told, somebody is being led, though they may stand just now."""
        return self.state is not None and self.state.leads_somebody

    def age_of(self, stamp_s: float, now_s: float) -> float:
        """Seconds since a time on the device's clock; never negative."""
        return max(0.0, now_s - (stamp_s - self.clock_offset_s))

    def colour_left_s(self, now_s: float) -> float:
        """Seconds for which colour pictures may still be seen; 0 where nobody may see any."""
        sharing = self.sharing
        if not self.connected or sharing is None or sharing.colour_until_s is None or not sharing.colour_for:
            return 0.0
        return max(0.0, sharing.colour_until_s - self.clock_offset_s - now_s)

    def freshness(self, now_s: float) -> Freshness:
        """How fresh ``state`` is, at the oldest that it may be; never LIVE while the clocks have not been compared."""
        found = freshness(self.longest_age_s(now_s), self.connected)
        return Freshness.DELAYED if found is Freshness.LIVE and self.clock_uncertainty_s is None else found
