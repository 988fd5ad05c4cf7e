"""The checker at work on the draft: in a thread, with what it has measured kept for the next time.

A result is of one version of the draft. While the draft is another one, it is stale, and says so: nothing that has not
been checked counts as good.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import msgspec

from console.errors import ConflictError
from console.map_geometry.clearance import path_clearance, place_clearance
from console.map_geometry.survey import Survey
from console.model import SiteModel
from console.surveys import Surveys
from navcore.errors import VbrError
from navcore.map_check.checker import findings_of
from navcore.map_check.clearance import PathClearance, PlaceClearance
from navcore.map_check.evidence import MapEvidence, path_of
from navcore.map_check.finding import Finding
from navcore.map_check.weak_localization import weak_places
from navcore.planning.poi_graph import PoiGraph
from navcore.planning.road_edits import network_of
from navcore.planning.road_network import RoadNetwork
from navcore.rehearsal.every_leg import EveryLeg, all_routes_announced
from navcore.settings import Settings, SettingValue

Stage = Literal["none", "running", "done", "failed"]
Rehearse = Callable[[PoiGraph, Settings], EveryLeg]
_SURVEY_SHARE = 0.8
"""Of the whole, where the map has not been measured before."""
_WIDTH = "obstacle.person_width_m"
_END_S = 10.0
"""So long the end of the console waits for a check that is given up; a step of it takes less."""
_log = logging.getLogger(__name__)


class CheckState(msgspec.Struct, frozen=True):
    """How far the check has come, and what the last one has found."""

    stage: Stage
    draft_version: int
    """The version of the draft now."""
    percent: int = 0
    """While it runs."""
    version: int | None = None
    """The version that the findings are of; None where nothing has been checked yet."""
    is_stale: bool = False
    """Whether the draft has changed since."""
    findings: tuple[Finding, ...] = ()
    sentence: str = ""
    """What to know of it, for the person who looks."""


class MapChecks:
    """Checks the draft of the model. All methods may be called from any thread."""

    def __init__(
        self,
        model: SiteModel,
        surveys: Surveys,
        rehearse: Rehearse | None = None,
        settings: Settings | None = None,
        device_settings: Callable[[], Sequence[Mapping[str, SettingValue]]] = tuple,
    ) -> None:
        """``rehearse`` returns what is said on the ways of a graph; by default :func:`all_routes_announced`.

        ``device_settings`` returns what connected devices run: the widest person whom they lead must find room.
        """
        self._model, self._surveys, self._rehearse = model, surveys, rehearse or self._every_leg
        self._settings, self._device_settings = settings or Settings(), device_settings
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._percent = 0
        self._is_measuring = False
        self._reason = ""
        self._result: tuple[int, tuple[Finding, ...], Settings] | None = None
        self._closed = False
        # Kept from check to check: an edit changes the paths of few edges.
        self._paths: dict[tuple[tuple[float, float], ...], PathClearance] = {}
        self._places: dict[tuple[float, float], PlaceClearance] = {}
        self._network: tuple[object, RoadNetwork] | None = None

    def start(self) -> CheckState:
        """Begin to check the draft as it is now, unless a check runs; return how it stands."""
        with self._lock:
            if self._closed:
                raise ConflictError("The console is ending: check again when it is back.")
            if self._thread is None:
                self._percent, self._reason = 0, ""
                self._thread = threading.Thread(target=self._run, args=(self._model.graph,), name="check", daemon=True)
                self._thread.start()
        return self.state()

    def state(self) -> CheckState:
        """Return how the check stands."""
        with self._lock:
            draft_version = self._model.graph.version
            version, findings, settings = self._result or (None, (), self._settings)
            is_stale = version is not None and version != draft_version
            stage: Stage = "none" if version is None else "done"
            sentence, percent = _sentence(version, draft_version, findings, settings), 0
            if self._thread is not None:
                stage, sentence, percent = "running", "Checking …", self._overall_percent()
            elif self._reason:
                stage, sentence = "failed", self._reason
            return CheckState(stage, draft_version, percent, version, is_stale, findings, sentence)

    def wait(self, timeout_s: float) -> CheckState:
        """Wait until no check runs, at most so long; return how it stands then."""
        thread = self._thread
        if thread is not None:
            thread.join(timeout_s)
        return self.state()

    def unconfirmed_errors(self, version: int) -> tuple[Finding, ...]:
        """Return the errors that somebody who publishes this version must have confirmed.

        A version that has not been checked is an error of its own: what is unknown is never clear.
        """
        with self._lock:
            result = self._result
        if result is None or result[0] != version:
            text, action = f"Version {version} of the draft has not been checked.", "Check it before you publish it."
            return (Finding("not_checked", "error", text, action, 0.0, 0.0),)
        return tuple(finding for finding in result[1] if finding.severity == "error")

    def close(self) -> None:
        """Begin no other check, and give up the one that runs; surveys are to be closed before."""
        with self._lock:
            self._closed = True
            thread = self._thread
        if thread is not None:
            thread.join(_END_S)

    # ----------------------------------------------------------------------------------------------- the check
    def _run(self, graph: PoiGraph) -> None:
        reason, findings, settings = "", None, self._widest()
        try:
            findings = findings_of(self._evidence(graph, settings))
        except VbrError as error:
            reason = str(error)
        except Exception as error:
            _log.exception("the draft could not be checked")
            reason = f"The draft could not be checked ({type(error).__name__}: {error}): tell whoever looks after this."
        with self._lock:
            if findings is not None:
                self._result = graph.version, findings, settings
            self._reason, self._thread = reason, None

    def _widest(self) -> Settings:
        """Return the settings to check with: the console's, for the widest person whom a connected device leads."""
        ours_m = self._settings.obstacle.person_width_m
        widths_m = [float(values.get(_WIDTH, ours_m)) for values in self._device_settings()]
        return self._settings.changed({_WIDTH: max([ours_m, *widths_m])})

    def _evidence(self, graph: PoiGraph, settings: Settings) -> MapEvidence:
        self._is_measuring = True
        survey = self._surveys.survey()
        self._is_measuring = False
        network = self._network_of(graph)
        self._measure(graph, survey)
        site, legs = self._model.site, self._rehearse(graph, settings)
        return MapEvidence(
            graph,
            network,
            {edge.id: self._paths[edge.path_m] for edge in graph.edges.values() if edge.path_m},
            {poi.id: self._places[poi.x_m, poi.y_m] for poi in graph.pois.values()},
            weak_places(site.map_arrays, site.report, network.polylines(), settings),
            legs.routes,
            legs.left_out,
            legs.refusals,
            settings,
        )

    def _measure(self, graph: PoiGraph, survey: Survey) -> None:
        """Measure what is new in the graph, and forget what is no longer in it."""
        paths = {edge.path_m: edge for edge in graph.edges.values() if edge.path_m}
        self._paths = {path: room for path, room in self._paths.items() if path in paths}
        for done, (path, edge) in enumerate(paths.items()):
            if self._closed:
                raise ConflictError("The console is ending: check again when it is back.")
            self._percent = round(100 * done / len(paths))
            if path not in self._paths:
                self._paths[path] = path_clearance(survey.occupancy, path_of(edge))
        places = {(poi.x_m, poi.y_m) for poi in graph.pois.values()}
        self._places = {place: place_clearance(survey.occupancy, *place) for place in places}

    def _every_leg(self, graph: PoiGraph, settings: Settings) -> EveryLeg:
        return all_routes_announced(graph, settings, cancelled=lambda: self._closed)

    def _network_of(self, graph: PoiGraph) -> RoadNetwork:
        if self._network is None or self._network[0] != graph.roads:
            self._network = graph.roads, network_of(graph.roads)
        return self._network[1]

    def _overall_percent(self) -> int:
        if self._is_measuring:
            return round(_SURVEY_SHARE * self._surveys.percent)
        return round(100 * _SURVEY_SHARE + (1.0 - _SURVEY_SHARE) * self._percent)


def _sentence(version: int | None, draft_version: int, findings: Sequence[Finding], settings: Settings) -> str:
    if version is None:
        return "The draft has not been checked yet."
    if version != draft_version:
        return f"This is of version {version}; the draft is version {draft_version} now: check again."
    counts = [
        f"{count} {word if count == 1 else word + 's'}"
        for word in ("error", "warning", "note")
        if (count := sum(finding.severity == word for finding in findings))
    ]
    found = f"Found {', '.join(counts)}." if counts else "Nothing was found that is wrong."
    width_m = settings.obstacle.person_width_m
    return f"{found} Checked for a person {width_m:g} m wide, and otherwise with the settings that devices come with."
