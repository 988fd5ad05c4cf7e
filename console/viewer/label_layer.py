"""Which names and lengths are visible in one window, from where its camera is."""

from __future__ import annotations

import viser

from console.viewer.graph_layer import GraphLayer
from console.viewer.labels import LabelSpot, Lens, readable
from console.viewer.tag import NAME_SCALE, NAME_Z_M

_LENGTH_SCALE = 0.75


class LabelLayer:
    """Shows and hides the labels of a graph; works only when the camera has moved or the graph has changed."""

    def __init__(self, client: viser.ClientHandle, graph: GraphLayer) -> None:
        self._client = client
        self._graph = graph
        self._arranged_for: tuple[object, ...] = ()

    def forget(self) -> None:
        """The graph has changed: arrange anew."""
        self._arranged_for = ()

    def arrange(self, selected_id: str | None, with_lengths: bool, kept_clear: tuple[LabelSpot, ...]) -> None:
        """Make visible what can be read beside ``kept_clear``: the selected place first, then the others."""
        camera = self._client.camera
        seen = (camera.update_timestamp, with_lengths, kept_clear)
        if seen == self._arranged_for:
            return
        self._arranged_for = seen
        height_px = max(camera.image_height, 1)
        lens = Lens(camera.position, camera.wxyz, camera.fov, max(camera.image_width, 1), height_px)
        shown = readable([*self._spots(selected_id, with_lengths), *kept_clear], lens)
        with self._client.atomic():
            for key, tag in self._graph.tags.items():
                tag.label.visible = f"poi {key}" in shown
            for key, label in self._graph.length_labels.items():
                label.visible = f"edge {key}" in shown

    def _spots(self, selected_id: str | None, with_lengths: bool) -> list[LabelSpot]:
        spots = [
            LabelSpot(f"poi {key}", tag.label.text, (tag.poi.x_m, tag.poi.y_m, NAME_Z_M),
                      3 if key == selected_id else 1 if tag.poi.kind == "junction" else 2, NAME_SCALE, raised=True)
            for key, tag in self._graph.tags.items()
        ]  # fmt: skip
        if with_lengths:
            for key, label in self._graph.length_labels.items():
                x_m, y_m, z_m = (float(part) for part in label.position)
                spots.append(LabelSpot(f"edge {key}", label.text, (x_m, y_m, z_m), 0, _LENGTH_SCALE))
        return spots
