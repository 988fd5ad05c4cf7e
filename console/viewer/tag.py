"""One PoI in the scene: a pin in the colour and shape of its kind, with its name above.

On the road it stands on a stem. What stands free of the road has none: it hovers over a square on the floor.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from functools import cache

import viser

from console.viewer import appearance as look
from console.viewer import meshes
from console.viewer.appearance import Shape
from console.viewer.meshes import Mesh
from navcore.planning.poi_graph import Poi

HEAD_Z_M = 0.7
NAME_Z_M = HEAD_Z_M + 0.3
NAME_SCALE = 1.2
"""Size of the names, in times of viser's own; lengths and other labels are smaller."""
_RADIUS_M = 0.24

ScreenPos = tuple[float, float]
Pick = Callable[[str, ScreenPos], Awaitable[None]]
Drag = Callable[[str, viser.SceneNodeDragEvent], Awaitable[None]]  # type: ignore[type-arg]


class Tag:
    """The nodes of one PoI; moved and changed in place."""

    def __init__(self, client: viser.ClientHandle, poi: Poi, pick: Pick, drag: Drag | None) -> None:
        self._scene = client.scene
        self._pick, self._drag = pick, drag
        self._name = f"/graph/poi/{poi.id}"
        self._frame = self._scene.add_frame(self._name, show_axes=False, position=(poi.x_m, poi.y_m, 0.0))
        self.label = self._scene.add_label(
            f"{self._name}/name",
            label_text(poi),
            position=(0.0, 0.0, NAME_Z_M),
            anchor="bottom-center",
            font_screen_scale=NAME_SCALE,
        )
        self.poi = poi
        self._add_pin()

    def show(self, poi: Poi) -> None:
        """Draw the PoI as it is now; nothing to do where it is the very one that is drawn."""
        before, self.poi = self.poi, poi
        if before is poi:
            return
        self._frame.position = (poi.x_m, poi.y_m, 0.0)
        self.label.text = label_text(poi)
        if (before.kind, before.on_road) != (poi.kind, poi.on_road):
            self._add_pin()

    def remove(self) -> None:
        """Take the tag out of the scene."""
        self._frame.remove()

    def _add_pin(self) -> None:
        poi, kind_look = self.poi, look.KINDS[self.poi.kind]
        mesh = pin(kind_look.shape, poi.on_road)
        head = self._scene.add_mesh_simple(
            f"{self._name}/head", mesh.vertices_m, mesh.faces, color=kind_look.colour,
            flat_shading=kind_look.shape in ("box", "diamond"), position=(0.0, 0.0, HEAD_Z_M), side="double",
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

        async def picked(event: viser.SceneNodePointerEvent) -> None:  # type: ignore[type-arg]
            await self._pick(poi.id, event.screen_pos)

        async def dragged(event: viser.SceneNodeDragEvent) -> None:  # type: ignore[type-arg]
            assert self._drag is not None
            await self._drag(poi.id, event)

        head.on_click(picked)
        if self._drag is not None:
            head.on_drag("left")(dragged)


def label_text(poi: Poi) -> str:
    """What stands above a place."""
    return poi.name if poi.on_road else f"{poi.name} (off the road)"


@cache
def pin(shape: Shape, on_road: bool) -> Mesh:
    """The mesh of a place, its head at the origin, the floor ``HEAD_Z_M`` below."""
    head = {
        "ball": lambda: meshes.ball(_RADIUS_M),
        "box": lambda: meshes.upright(_RADIUS_M * 1.15, 1.5 * _RADIUS_M, 4),
        "post": lambda: meshes.upright(0.85 * _RADIUS_M, 2.0 * _RADIUS_M),
        "diamond": lambda: meshes.diamond(0.9 * _RADIUS_M),
    }[shape]()
    if not on_road:
        square = meshes.lathe([(0.24, 0.0), (0.24 + 0.1 * math.sqrt(2.0), 0.0)], 4)
        return meshes.merged((head, 0.0), (square, 0.05 - HEAD_Z_M))
    return meshes.merged((head, 0.0), (meshes.upright(0.03, HEAD_Z_M, 8), -HEAD_Z_M / 2))
