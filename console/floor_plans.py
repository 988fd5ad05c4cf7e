"""The floor plan of the draft: drawn once for each version and theme, one at a time, and never waited for.

A request that waits holds a thread that commands to devices need: whoever comes too early hears so, and asks again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TypeVar

from console.errors import ConflictError
from console.map_geometry.floor_plan import FloorPlan, floor_plan
from console.map_geometry.floor_plan_svg import floor_plan_svg
from console.map_geometry.occupancy import Occupancy
from console.map_geometry.plan_layout import PlanPlace, Theme
from console.model import SiteModel
from console.surveys import Surveys
from navcore.geometry import FloatArray
from navcore.map_check.evidence import is_silent
from navcore.planning.poi_graph import PoiGraph

_Plan = TypeVar("_Plan")
Shown = tuple[Occupancy, FloatArray, Sequence[FloatArray], Sequence[PlanPlace]]


class FloorPlans:
    """Draws the plans. All methods may be called from any thread.

    They raise ConflictError while the map is being measured or another plan is drawn, MappingError where the map cannot
    be measured.
    """

    def __init__(self, model: SiteModel, surveys: Surveys) -> None:
        """``surveys`` measures the map."""
        self._model, self._surveys = model, surveys
        self._drawing = threading.Lock()
        self._pictures: dict[Theme, tuple[int, FloorPlan]] = {}
        self._drawings: dict[Theme, tuple[int, str]] = {}

    def picture(self, theme: Theme) -> FloorPlan:
        """Return the plan of the draft as a picture."""
        return self._drawn(self._pictures, theme, floor_plan)

    def drawing(self, theme: Theme) -> str:
        """Return the plan of the draft as SVG."""
        return self._drawn(self._drawings, theme, floor_plan_svg)

    def _drawn(self, kept: dict[Theme, tuple[int, _Plan]], theme: Theme, draw: Callable[..., _Plan]) -> _Plan:
        graph = self._model.graph
        version, plan = kept.get(theme, (None, None))
        if plan is not None and version == graph.version:
            return plan
        shown = self._shown(graph)
        if not self._drawing.acquire(blocking=False):
            raise ConflictError("Another plan is being drawn: ask again in a moment.")
        try:
            plan = draw(*shown, theme)
        finally:
            self._drawing.release()
        kept[theme] = graph.version, plan
        return plan

    def _shown(self, graph: PoiGraph) -> Shown:
        """Return what the plan shows; places that are announced choose first where their names go."""
        survey = self._surveys.survey(0.0)
        pois = sorted(graph.pois.values(), key=lambda poi: (is_silent(poi), poi.id))
        places = [PlanPlace(poi.name, poi.x_m, poi.y_m) for poi in pois]
        return survey.occupancy, survey.walls_m, self._model.network.polylines(), places
