"""The roads of the draft in the scene of one client: a band for each, and the line that places lie on.

What somebody walked is a whole band, what somebody drew is a dashed one. A band is picked like a place.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
import viser

from console.viewer import meshes
from console.viewer.appearance import DARK, Rgb, Theme
from navcore.planning.poi_graph import Road
from navcore.planning.road_network import RoadNetwork

# Above the points of the floor, below the connections.
_BAND_Z_M, _LINE_Z_M = 0.045, 0.06
_BAND_WIDTH_M = 0.34
_DASH_M, _GAP_M = 0.5, 0.3
_TOLERANCE_M = 0.02

PickRoad = Callable[[str, tuple[float, float]], Awaitable[None]]


@dataclass(slots=True)
class _Band:
    road: Road
    mesh: viser.MeshHandle


class RoadLayer:
    """Draws roads for one client; changes only what differs from what it drew last."""

    def __init__(self, client: viser.ClientHandle, pick: PickRoad) -> None:
        self._client = client
        self._pick = pick
        self.theme = DARK
        self.root = client.scene.add_frame("/road", show_axes=False)
        self._bands: dict[str, _Band] = {}
        self._roads: dict[str, Road] | None = None
        self._line = client.scene.add_line_segments(
            "/road/line", np.zeros((1, 2, 3), dtype=np.float32), self.theme.road, thickness=2.5,
            thickness_units="screen", visible=False,
        )  # fmt: skip

    @property
    def drawn(self) -> dict[str, Road]:
        """The roads as drawn."""
        return {road_id: band.road for road_id, band in self._bands.items()}

    def show(self, roads: dict[str, Road], network: RoadNetwork, selected_id: str | None) -> None:
        """Draw the roads of a draft, and the network that they make."""
        if roads is not self._roads:
            self._roads = roads
            with self._client.atomic():
                self._show_line(network)
                self._show_bands(roads)
        for road_id, band in self._bands.items():
            band.mesh.color = self._colour(band.road, road_id == selected_id)

    def set_theme(self, theme: Theme) -> None:
        """Draw in other colours from now on."""
        self.theme = theme
        self._line.colors = np.array(theme.road, dtype=np.uint8)

    def _show_line(self, network: RoadNetwork) -> None:
        pieces = [meshes.line_segments(meshes.simplified(line, _TOLERANCE_M), _LINE_Z_M) for line in network.lines]
        self._line.visible = bool(pieces)
        if pieces:
            self._line.points = np.concatenate(pieces).astype(np.float32)

    def _show_bands(self, roads: dict[str, Road]) -> None:
        for road_id in self._bands.keys() - roads.keys():
            self._bands.pop(road_id).mesh.remove()
        for road in roads.values():
            band = self._bands.get(road.id)
            if band is None or band.road != road:
                self._bands[road.id] = _Band(road, self._add_band(road))

    def _add_band(self, road: Road) -> viser.MeshHandle:
        path = meshes.simplified(np.array(road.points_m), _TOLERANCE_M)
        pieces = meshes.dashes(path, _DASH_M, _GAP_M) if road.origin == "drawn" else [path]
        mesh = meshes.ribbon(pieces, _BAND_WIDTH_M)
        handle = self._client.scene.add_mesh_simple(
            f"/road/{road.id}", mesh.vertices_m, mesh.faces, color=self._colour(road, False), side="double",
            position=(0.0, 0.0, _BAND_Z_M), material="toon3", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

        async def picked(event: viser.SceneNodePointerEvent) -> None:  # type: ignore[type-arg]
            await self._pick(road.id, event.screen_pos)

        handle.on_click(picked)
        return handle

    def _colour(self, road: Road, is_selected: bool) -> Rgb:
        if is_selected:
            return self.theme.selected
        return self.theme.drawn if road.origin == "drawn" else self.theme.recorded
