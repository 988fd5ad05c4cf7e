"""What is shown, and from where: layers and camera."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable

import numpy as np
import viser

from console.viewer.cloud import CameraView, FloorBounds, overview, plan_view
from console.viewer.cloud_colours import Colouring, legend
from console.viewer.cloud_layer import CloudLayer
from console.viewer.live_view import LiveView
from console.viewer.widgets import at_once, on_change, on_choice
from console.viewer.wording import card, legend_card

_FOLLOW_BACK_M, _FOLLOW_UP_M = 5.0, 5.0
_PANEL_PX = 272.0
_MOST_COVERED_SHARE = 0.3
_NARROW_ASPECT = 1.05
"""A narrower window than this (a phone) has its panel below."""
_BEFORE_FIRST_M = (3.0, 3.0, 3.0)
"""Where viser's client says that it is before it has been told where to be."""
_COLOURINGS = {each.value for each in Colouring}


class CameraMode(enum.Enum):
    """Who moves the camera."""

    FREE = "Free"
    FOLLOW = "Follow the walker"


class ViewPanel:
    """Layers and camera of one client."""

    def __init__(
        self,
        client: viser.ClientHandle,
        bounds: FloorBounds,
        cloud: CloudLayer,
        road: viser.FrameHandle,
        sentence: str,
        set_theme: Callable[[str], None],
    ) -> None:
        self._client = client
        self._bounds = bounds
        self._cloud = cloud
        self.mode = CameraMode.FREE
        self._is_first = True
        self._last_target_m: tuple[float, float] | None = None
        gui = client.gui
        camera = gui.add_button_group(
            "Camera", ("Overview", "From above", "Follow"), hint="O: overview, P: from above, F: follow the walker"
        )
        on_choice(camera, {"Overview": self.overview, "From above": self.from_above, "Follow": self.follow}, at_once)
        ceiling = client.scene.add_frame("/map/ceiling", show_axes=False, visible=False)
        for layer, word in ((cloud, "Point cloud"), (ceiling, "Ceiling"), (road, "Road")):
            self._add_layer(gui, layer, word)
        self._colouring = gui.add_dropdown("Colour", tuple(each.value for each in Colouring))
        on_change(self._colouring, self._colour, at_once)
        self._legend = gui.add_html("", visible=False)
        self.lengths = gui.add_checkbox("Lengths", True)
        self.details = gui.add_checkbox("What the walker's device sees", True)
        theme = gui.add_button_group("Theme", ("Dark", "Light"))
        on_choice(theme, {"Dark": lambda: set_theme("dark"), "Light": lambda: set_theme("light")}, at_once)
        gui.add_html(card(sentence))

    @staticmethod
    def _add_layer(gui: viser.GuiApi, layer: CloudLayer | viser.FrameHandle, word: str) -> None:
        box = gui.add_checkbox(word, layer.visible)

        def toggle() -> None:
            layer.visible = box.value

        on_change(box, toggle, at_once)

    def _colour(self) -> None:
        colouring = Colouring(self._colouring.value) if self._colouring.value in _COLOURINGS else Colouring.SEEN
        self._cloud.colour(colouring)
        rows = legend(colouring)
        self._legend.visible = bool(rows)
        self._legend.content = legend_card(f"Colour: {colouring.value.lower()}", rows)

    def _fit_first_view(self) -> None:
        """Show the whole floor in this very window, unless its camera has been moved already (after a reconnect)."""
        position_m = self._client.camera.position
        if np.allclose(position_m, _BEFORE_FIRST_M, atol=0.05):
            return
        self._is_first = False
        if np.allclose(position_m, overview(self._bounds).position_m, atol=0.05):
            self.overview()

    def overview(self) -> None:
        """Show the whole floor at an angle."""
        self.mode = CameraMode.FREE
        self._look(overview(self._bounds, self._aspect, self._covered))

    def from_above(self) -> None:
        """Show the whole floor as a plan."""
        self.mode = CameraMode.FREE
        self._look(plan_view(self._bounds, self._aspect, self._covered))

    def follow(self) -> None:
        """Keep behind the walker from now on, until another view is chosen."""
        self.mode = CameraMode.FOLLOW
        self._last_target_m = None

    def fly_to(self, x_m: float, y_m: float) -> None:
        """Look at a place of the floor from near."""
        self.mode = CameraMode.FREE
        self._look(CameraView((x_m, y_m - 5.0, 6.0), (x_m, y_m, 0.3)))

    def tick(self, view: LiveView) -> None:
        """Move the camera with the walker, where it follows."""
        if self._is_first:
            self._fit_first_view()
        state = view.state
        if self.mode is not CameraMode.FOLLOW or state is None or state.pose is None:
            return
        x_m, y_m, _, heading_rad = state.pose
        if self._last_target_m is None:
            back = np.array([math.cos(heading_rad), math.sin(heading_rad)]) * _FOLLOW_BACK_M
            self._look(CameraView((x_m - back[0], y_m - back[1], _FOLLOW_UP_M), (x_m, y_m, 1.2)))
        else:
            # Moved along, not turned: the person's own orbit around the walker stays as it is.
            step = np.array([x_m - self._last_target_m[0], y_m - self._last_target_m[1], 0.0])
            if float(np.linalg.norm(step)) < 0.01:
                return
            camera = self._client.camera
            with self._client.atomic():
                camera.position, camera.look_at = camera.position + step, camera.look_at + step
        self._last_target_m = (x_m, y_m)

    @property
    def _aspect(self) -> float:
        return max(self._client.camera.aspect, 0.3)

    @property
    def _covered(self) -> float:
        """The share of the window's width behind the panel."""
        if self._aspect < _NARROW_ASPECT:
            return 0.0
        return min(_PANEL_PX / max(self._client.camera.image_width, 1), _MOST_COVERED_SHARE)

    def _look(self, view: CameraView) -> None:
        camera = self._client.camera
        with self._client.atomic():
            camera.position = view.position_m
            camera.look_at = view.look_at_m
