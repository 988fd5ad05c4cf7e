"""The point cloud: shared by all windows as it was seen, and in other colours for the window that asks for them."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from console.viewer.cloud import CloudPart, ShownCloud
from console.viewer.cloud_colours import Colouring, Colours, by_height, by_localization, shaded
from navcore.site import Site


class CloudColours:
    """The cloud of a site in other colours; worked out when somebody first asks, and kept once for all windows."""

    def __init__(self, site: Site, cloud: ShownCloud) -> None:
        self._site = site
        self.cloud = cloud
        self._known: dict[Colouring, tuple[Colours, ...]] = {}

    def of(self, colouring: Colouring) -> tuple[Colours, ...]:
        """Return the colours of each part of the cloud below the ceiling."""
        if colouring is Colouring.SEEN:
            return tuple(part.colours_rgb for part in self.cloud.parts)
        if colouring not in self._known:
            self._known[colouring] = tuple(self._coloured(part, colouring) for part in self.cloud.parts)
        return self._known[colouring]

    def _coloured(self, part: CloudPart, colouring: Colouring) -> Colours:
        if colouring is Colouring.HEIGHT:
            return by_height(part.points_m)
        return shaded(by_localization(part.points_m, self._site.map_arrays), part.colours_rgb)


class CloudLayer:
    """The cloud in one window: the shared one, or, in its place, this window's own in other colours."""

    def __init__(self, client: viser.ClientHandle, colours: CloudColours) -> None:
        self._client = client
        self._colours = colours
        # A node of the window's own at the name of the shared one: it hides the shared one here alone.
        self._shared = client.scene.add_frame("/map/cloud", show_axes=False)
        self._own = client.scene.add_frame("/own_cloud", show_axes=False)
        self._own_parts: list[viser.PointCloudHandle] = []
        self._is_visible = True
        self.colouring = Colouring.SEEN

    @property
    def visible(self) -> bool:
        """Whether the cloud is shown."""
        return self._is_visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._is_visible = visible
        self._show()

    def colour(self, colouring: Colouring) -> None:
        """Show the cloud in these colours."""
        if colouring is self.colouring:
            return
        self.colouring = colouring
        for node in self._own_parts:
            node.remove()
        self._own_parts = []
        if colouring is not Colouring.SEEN:
            size_m = self._colours.cloud.point_size_m
            for part, colours in zip(self._colours.cloud.parts, self._colours.of(colouring), strict=True):
                name = f"/own_cloud/{part.name.rsplit('/', 1)[1]}"
                self._own_parts.append(add_points(self._client.scene, name, part.points_m, colours, size_m))
        self._show()

    def _show(self) -> None:
        is_shared = self.colouring is Colouring.SEEN
        self._shared.visible = self._is_visible and is_shared
        self._own.visible = self._is_visible and not is_shared


def add_points(
    scene: viser.SceneApi, name: str, points_m: NDArray[np.float32], colours_rgb: Colours, size_m: float
) -> viser.PointCloudHandle:
    """Add a cloud of round points as they are, without shading."""
    return scene.add_point_cloud(
        name, points_m, colours_rgb, point_size=size_m, precision="float32", point_shape="circle", point_shading="flat"
    )
