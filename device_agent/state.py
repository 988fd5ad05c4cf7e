"""What the device knows between two frames: one frozen value; every step of the loop returns a new one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from device_agent.load_plan import LoadLevel
from device_agent.ports import EventKind, KeptMessage, LocalizerPort
from device_agent.sharing import Consent, Privacy
from navcore.calibration import Calibration
from navcore.cues.table import Cue, CueKind
from navcore.cues.texts import TEXTS, Language
from navcore.modes import LED, ON_THE_WAY, Mode
from navcore.obstacle.approach import RecentScans
from navcore.obstacle.facing import FacingWatch
from navcore.obstacle.memory import ObstacleMemory
from navcore.obstacle.mounting import MountingWatch
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.way_finding import Blockage, WayFinder
from navcore.settings import Settings
from navcore.site import Site
from navcore.types import Guidance, Localization, Pose2D, Route
from navcore.wire import Accesses

TrailPoint = tuple[float, float, float]
"""Stamp (s), x and y (m) of the walker."""


@dataclass(frozen=True, slots=True)
class Phrase:
    """A text of :data:`navcore.cues.texts.TEXTS`, and what is put into it."""

    key: str
    values: dict[str, int | str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class MapWalkTold:
    """What a map walk, or the building of its map, has to say: put into words in the language that is spoken then."""

    kind: CueKind
    phrases: tuple[Phrase, ...]
    failed: bool = False
    """Recording has ended by itself."""

    def text(self, language: Language) -> str:
        """Return it in words."""
        between = "" if language == "zh" else " "
        return between.join(TEXTS[language][each.key].format(**each.values) for each in self.phrases)


@dataclass(frozen=True, slots=True, eq=False)
class PreparedMap:
    """A new map that is loaded and ready, but not swapped in yet."""

    staging: Path
    checksum: str
    site: Site
    localizer: LocalizerPort
    told: MapWalkTold | None = None
    """What is said once it is in use."""


@dataclass(frozen=True, slots=True)
class Menu:
    """Where the walker is in a list: of places, or of what concerns privacy."""

    entry_id: str
    """What was named last: a PoI, the entry that leads to privacy, or one of :mod:`device_agent.privacy_menu`."""
    by: Literal["distance", "name", "privacy"]
    until_s: float
    """Nobody remembers an open menu for ever: it closes by itself."""
    listed: tuple[str, ...] = ()
    """The entries, in the order in which they stood when the list was opened: whoever walks on finds them there."""
    set_off_until_s: float = -math.inf
    """Until then the main button sets off to the place that was named last: it has been chosen once already."""


@dataclass(frozen=True, slots=True)
class BlockedPlace:
    """A place of the road at which something stood in the way."""

    since_s: float
    place: Blockage
    until_rest: bool = False
    """It was closed by a person: it is not forgotten before the next graph is taken."""


@dataclass(frozen=True, slots=True)
class StepBack:
    """The walker was sent back a little, to look from there at what no image showed any more."""

    since_s: float
    x_m: float
    y_m: float
    """Where they stood."""
    route_version: int
    """Of the way back."""
    place: Blockage | None = None
    """On the road, just before them; None where it is unknown."""


@dataclass(frozen=True, slots=True)
class Overridden:
    """What the walker was on their way to before somebody at the console chose another place."""

    poi_id: str
    by: str
    """Who had chosen it; empty: the walker."""
    was_paused: bool
    until_s: float
    """Until when one press brings it back."""


@dataclass(frozen=True, slots=True)
class SettingsTrial:
    """Settings are tried out: those before run again unless these are kept. On the disk are those before."""

    before: Settings
    before_revision: int
    until_s: float
    """When the settings before run again."""


@dataclass(frozen=True, slots=True, eq=False)
class DeviceState:
    """Everything that the loop remembers. The states and what leads from one to another: :mod:`device_agent.states`."""

    settings: Settings
    graph: PoiGraph
    site_id: str = ""
    map_checksum: str = ""
    settings_revision: int = 0
    trial: SettingsTrial | None = None
    """What runs again unless the settings are kept; None where they have been."""
    mode: Mode = Mode.LOCALIZING
    beneath: Mode | None = None
    """The state that a fault leads back to; None where there is no fault."""
    promised_ready: bool = False
    """The walker waits to hear *Ready*."""
    menu: Menu | None = None
    """The places that the walker browses with the buttons."""
    destination_id: str | None = None
    wanted_id: str | None = None
    """A destination that is to be planned as soon as the pose is known."""
    aim_by: str = ""
    """Who at the console chose where the walker is led; empty: nobody there, the walker did."""
    overridden: Overridden | None = None
    """What the walker can still bring back; None where nobody has changed it."""
    route: Route | None = None
    route_version: int = 0
    located: Localization | None = None
    """Where the last frame was taken; None without one, and off duty."""
    fixes: tuple[Localization, ...] = ()
    """The last two poses that the localizer has found, oldest first: by them a pose that is not there is carried on."""
    load_level: LoadLevel = LoadLevel.FULL
    """What is left out because the device is too slow."""
    eye: tuple[float, float] | None = None
    """When the pose was certain last, and how high the camera was above the floor then, metres."""
    sure: tuple[float, Pose2D] | None = None
    """When and where the position was last known for sure."""
    guidance: Guidance | None = None
    """The previous guidance: the only memory of route following."""
    calibration: Calibration = field(default_factory=Calibration)
    """What has been measured of these glasses."""
    mounting: MountingWatch = field(default_factory=MountingWatch)
    """Whether the camera is still where it was calibrated."""
    facing: FacingWatch = field(default_factory=FacingWatch)
    """Whether the camera looks where the walker walks."""
    obstacles: ObstacleMemory = field(default_factory=ObstacleMemory)
    """What was in the way a moment ago and may be out of the image now."""
    heard: ObstacleMemory = field(default_factory=ObstacleMemory)
    """What the rangefinder alone has heard."""
    recent_scans: RecentScans = ()
    """What was seen in the last moments, to tell what comes from what stands."""
    off_route_since_s: float | None = None
    blocked: tuple[BlockedPlace, ...] = ()
    """Places where something stood in the way, newest last."""
    is_hidden_ahead: bool = False
    """What is nearest ahead is remembered only: no image shows whether it is still there."""
    step_back: StepBack | None = None
    """The last time that the walker was sent back to look again, on this way or an earlier one."""
    told_blocked_s: float | None = None
    """When the walker was told that the way is blocked and that there is no other; None once they walk again."""
    way_finder: WayFinder | None = None
    """Made for the graph when it is first planned in; another graph needs another one."""
    map_offered_until_s: float = -math.inf
    """Until when a press of *next* begins a map walk."""
    mark_count: int = 0
    """Places that were marked in this map walk, or in the last one."""
    blind: bool = False
    """The camera gave nothing in the last cycle."""
    deaf: bool = False
    """The rangefinder had failed in the last cycle."""
    failed_s: float = -math.inf
    """When guidance last failed: no picture, too late a decision, something raised."""
    trail: tuple[TrailPoint, ...] = ()
    """Where the walker was during the last second or so."""
    waiting_graph: PoiGraph | None = None
    """A published PoI-graph that is taken at the next stop."""
    waiting_map: PreparedMap | None = None
    """A map that is swapped in at the next stop."""
    privacy: Privacy = field(default_factory=Privacy)
    """Who sees the walker, and what they allow."""

    @property
    def purpose(self) -> Mode:
        """What the device is there for: its state, or in a fault the state beneath it."""
        return self.beneath or self.mode

    @property
    def has_map(self) -> bool:
        """There is a map to look for a position in."""
        return bool(self.map_checksum)

    @property
    def leading(self) -> bool:
        """Somebody is being led, even if they stand just now."""
        return self.purpose in LED

    @property
    def aim_id(self) -> str | None:
        """Where somebody is being led, or will be as soon as there is a way; None where nobody is."""
        return (self.wanted_id or self.destination_id) if self.leading else None

    @property
    def uses_its_map(self) -> bool:
        """Map and PoI-graph must stay as they are: somebody is being led by them, or a map is being recorded."""
        return self.leading or self.purpose is Mode.MAPPING

    @property
    def on_the_way(self) -> bool:
        """Somebody is being led, and not paused."""
        return self.purpose in ON_THE_WAY

    def place_ahead(self, ahead_m: float) -> Blockage | None:
        """Return the place of the road so far ahead on the walker's route, or the route's end; None if unknown."""
        if self.route is None or self.guidance is None or self.guidance.route_version != self.route_version:
            return None
        index = self.guidance.trace.closest_index
        on_edge = None if index is None else self.route.on_edge(float(self.route.arc_length_m[index]) + ahead_m)
        return None if on_edge is None else Blockage(*on_edge)

    def place_name(self, poi_id: str | None) -> str:
        """Return what a PoI is called."""
        poi = self.graph.pois.get(poi_id or "")
        return (poi.spoken_name or poi.name) if poi else str(poi_id)


@dataclass(frozen=True, slots=True)
class Notice:
    """A sentence that the walker shall hear."""

    text: str
    answers: bool = False
    """It answers a button, or tells of an order: not said again where an instruction cuts it off."""
    kind: CueKind | None = None
    """What kind of cue it is, where it is neither an answer nor a message."""


@dataclass(frozen=True, slots=True)
class MarkPlace:
    """A place is to be noted in the map walk, where the last frame was taken."""

    name: str


@dataclass(frozen=True, slots=True)
class SayAgain:
    """The last sentence is to be said again."""

    otherwise: str
    """What is said where there is none, or it is no longer true."""


@dataclass(frozen=True, slots=True)
class Outdated:
    """What was said in cues of these kinds is no longer true: it is neither said late nor said again."""

    kinds: frozenset[CueKind]


@dataclass(frozen=True, slots=True)
class Happened:
    """Something for the record, which reaches the console for certain."""

    kind: EventKind
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class StoreGraph:
    """The PoI-graph that runs from now on is to be kept on disk."""

    graph: PoiGraph


@dataclass(frozen=True, slots=True, eq=False)
class RunSettings:
    """Other settings run from now on; what is outside the loop hears of them."""

    settings: Settings


@dataclass(frozen=True, slots=True, eq=False)
class StoreSettings:
    """The settings that run are to be kept on disk."""

    settings: Settings
    revision: int


@dataclass(frozen=True, slots=True, eq=False)
class SwapMap:
    """The prepared map is to be moved into place."""

    prepared: PreparedMap


@dataclass(frozen=True, slots=True)
class StoreConsent:
    """What the walker shares is to be kept on disk."""

    consent: Consent


@dataclass(frozen=True, slots=True, eq=False)
class StoreAccesses:
    """Who has watched, and looked at what is kept, is to be kept on disk."""

    accesses: Accesses


@dataclass(frozen=True, slots=True)
class SoundSign:
    """A tone that is none of guidance is to be heard, where no words are heard just now."""

    tone: Cue


Effect = (
    KeptMessage | Notice | SayAgain | Outdated | MarkPlace | Happened | StoreGraph | RunSettings | StoreSettings
    | StoreConsent | StoreAccesses | SoundSign | SwapMap
)  # fmt: skip
"""What a step asks the agent to do in the world."""
Step = tuple[DeviceState, tuple[Effect, ...]]
