"""Dark and light: viser's own panels, and the floor below everything."""

from __future__ import annotations

import viser

from console.viewer.appearance import BRAND, Theme
from console.viewer.cloud import FloorBounds


def set_theme(gui: viser.GuiApi, theme: Theme) -> None:
    """Give viser's panels a theme: of one window, or of all."""
    gui.configure_theme(
        dark_mode=theme.name == "dark", show_logo=False, show_share_button=False, control_width="small",
        brand_color=BRAND,
    )  # fmt: skip


def add_floor(scene: viser.SceneApi, bounds: FloorBounds, theme: Theme) -> None:
    """Draw the floor with its grid of 1 m and 5 m; of a window's own, it takes the place of the shared one there."""
    x_m, y_m = bounds.centre_m
    scene.add_grid(
        "/map/floor", width=bounds.width_m + 2.0, height=bounds.depth_m + 2.0, position=(x_m, y_m, -0.02),
        cell_size=1.0, section_size=5.0, cell_color=theme.grid, section_color=theme.grid_section,
        plane_color=theme.floor, plane_opacity=1.0, shadow_opacity=0.0, fade_distance=400.0,
    )  # fmt: skip
