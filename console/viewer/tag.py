"""One PoI in the scene: a head in the colour and shape of its kind, on a stem on the road, with its name above."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import viser

from console.viewer import appearance as look
from console.viewer import meshes
from console.viewer.appearance import KindLook
from navcore.planning.poi_graph import Poi

HEAD_Z_M = 0.7
NAME_SCALE = 1.2
"""Size of the names, in times of viser's own; lengths and other labels are smaller."""
_RADIUS_M = 0.24

ScreenPos = tuple[float, float]
Pick = Callable[[str, ScreenPos], Awaitable[None]]
Drag = Callable[[str, viser.SceneNodeDragEvent], Awaitable[None]]  # type: ignore[type-arg]
_Head = viser.IcosphereHandle | viser.BoxHandle | viser.CylinderHandle


class Tag:
    """The nodes of one PoI; moved and changed in place."""

    def __init__(self, client: viser.ClientHandle, poi: Poi, pick: Pick, drag: Drag | None) -> None:
        self._scene = client.scene
        self._id = poi.id
        self._pick, self._drag = pick, drag
        self._name = f"/graph/poi/{poi.id}"
        self._frame = self._scene.add_frame(self._name, show_axes=False, position=(poi.x_m, poi.y_m, 0.0))
        self._stem = self._scene.add_cylinder(
            f"{self._name}/stem", radius=0.025, height=HEAD_Z_M, color=(215, 220, 230),
            position=(0.0, 0.0, HEAD_Z_M / 2), cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        halo = meshes.ring(0.5, 0.1)
        self._halo = self._scene.add_mesh_simple(
            f"{self._name}/halo", halo.vertices_m, halo.faces, color=(255, 255, 255), side="double",
            position=(0.0, 0.0, 0.04), visible=False, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self.label = self._scene.add_label(
            f"{self._name}/name",
            poi.name,
            position=(0.0, 0.0, HEAD_Z_M + 0.3),
            anchor="bottom-center",
            font_screen_scale=NAME_SCALE,
        )
        self._look = look.KINDS[poi.kind]
        self._head = self._make_head(self._look)
        self.poi = poi
        self._drawn: tuple[Poi, bool] | None = None

    def show(self, poi: Poi, *, selected: bool) -> None:
        """Draw the PoI as it is now; nothing to do where it is the very one that is drawn."""
        if self._drawn is not None and self._drawn[0] is poi and self._drawn[1] is selected:
            return
        self._drawn = poi, selected
        self.poi = poi
        self._frame.position = (poi.x_m, poi.y_m, 0.0)
        self.label.text = poi.name if poi.on_road else f"{poi.name} (off the road)"
        self._halo.visible = selected
        kind_look = look.KINDS[poi.kind]
        if kind_look != self._look:
            self._look = kind_look
            self._head = self._make_head(kind_look)
        self._head.opacity = 1.0 if poi.on_road else 0.45

    def remove(self) -> None:
        """Take the tag out of the scene."""
        self._frame.remove()

    def _make_head(self, kind_look: KindLook) -> _Head:
        head = self._shape(kind_look)

        async def picked(event: viser.SceneNodePointerEvent) -> None:  # type: ignore[type-arg]
            await self._pick(self._id, event.screen_pos)

        async def dragged(event: viser.SceneNodeDragEvent) -> None:  # type: ignore[type-arg]
            assert self._drag is not None
            await self._drag(self._id, event)

        head.on_click(picked)
        if self._drag is not None:
            head.on_drag("left")(dragged)
        return head

    def _shape(self, kind_look: KindLook) -> _Head:
        name, place = f"{self._name}/head", (0.0, 0.0, HEAD_Z_M)
        if kind_look.shape == "box":
            size = 1.6 * _RADIUS_M
            return self._scene.add_box(
                name, dimensions=(size, size, size), color=kind_look.colour, position=place, cast_shadow=False
            )
        if kind_look.shape == "post":
            return self._scene.add_cylinder(
                name, radius=0.85 * _RADIUS_M, height=2.0 * _RADIUS_M, color=kind_look.colour, position=place,
                cast_shadow=False,
            )  # fmt: skip
        diamond = kind_look.shape == "diamond"
        return self._scene.add_icosphere(
            name, radius=_RADIUS_M * (0.85 if diamond else 1.0), color=kind_look.colour, flat_shading=diamond,
            subdivisions=0 if diamond else 3, position=place, cast_shadow=False,
        )  # fmt: skip
