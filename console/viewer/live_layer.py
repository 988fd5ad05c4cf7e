"""The walker in the scene of one client: figure, view, trail, route, sub-goal, candidates, scan, direction, sonar, cue.

All nodes are made once, with fixed names, and only their properties change: viser sends what differs, and a slow
browser gets the newest alone.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from console.live import Freshness
from console.viewer import appearance as look
from console.viewer import meshes
from console.viewer.appearance import Rgb
from console.viewer.labels import LabelSpot
from console.viewer.live_view import LiveView
from console.viewer.others_layer import OthersLayer
from console.viewer.scan_points import scan_points
from navcore.geometry import FloatArray
from navcore.wire import WalkerState

_SONAR_RANGE_M = 4.25
_SONAR_HALF_FIELD_RAD = math.radians(7.5)
_ARROW_LENGTH_M = 1.1
_CUE_SCALE = 1.25
_ROUTE_Z_M, _TRAIL_Z_M, _DOT_Z_M, _FAN_Z_M = 0.10, 0.05, 0.16, 0.22
_BEAT_EVERY_S = 0.5
_PAST_RING_M = 0.9
_FAR_OFF_M = 1.0
"""So far off the route the trail has its strongest colour."""
_FLAT: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


class LiveLayer:
    """Draws :class:`LiveView` values for one client."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        scene = client.scene
        self._root = scene.add_frame("/walker", show_axes=False, visible=False)
        self._figure = _Figure(client)
        self._extras = _Extras(client)
        self._others = OthersLayer(client)
        # Never drawn: the page around reads there how old the scene is (static/scene_age.js).
        self._beat = scene.add_frame("/live/beat", show_axes=False, visible=False)
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._trail = scene.add_line_segments(
            "/live/trail", nothing, look.TRAIL, thickness=3.0, thickness_units="screen", visible=False
        )
        self._route = scene.add_line_segments(
            "/live/route", nothing, look.ROUTE, thickness=9.0, thickness_units="screen", visible=False
        )
        self._off = scene.add_line_segments(
            "/live/off", nothing, look.CLOSEST, thickness=2.0, thickness_units="screen", visible=False
        )
        self._dots = {
            name: scene.add_icosphere(
                f"/live/{name}", radius=radius_m, color=colour, subdivisions=2, visible=False, **_FLAT
            )
            for name, radius_m, colour in (
                ("sub_goal", 0.16, look.SUB_GOAL), ("closest", 0.11, look.CLOSEST), ("position", 0.11, look.WALKER),
            )
        }  # fmt: skip

    def show(self, view: LiveView) -> None:
        """Draw the walker as known now; what is old is grey, dated, and as uncertain as a walker who went on."""
        state = view.state
        with self._client.atomic():
            console_s = view.now_s if view.past is None else view.past.console_s
            self._beat.position = (console_s - console_s % _BEAT_EVERY_S, 0.0, 0.0)
            self._others.show(view.others, view.now_s)
            self._show_routes(view)
            if state is None or state.pose is None:
                self._root.visible = self._off.visible = False
                self._dot("position", None)
                self._dot("sub_goal", None)
                self._dot("closest", None)
                return
            x_m, y_m, eye_m, heading_rad = state.pose
            self._root.position = (x_m, y_m, 0.0)
            self._root.wxyz = meshes.quat_about_z(heading_rad)
            self._root.visible = True
            believed = view.is_believed
            self._figure.show(view, eye_m, believed)
            self._extras.show(state, eye_m, believed)
            self._extras.show_silhouette(view)
            self._dot("position", (x_m, y_m))
            self._dot("sub_goal", state.sub_goal if believed else None)
            closest_m = view.closest_m if believed else None
            self._dot("closest", closest_m)
            self._off.visible = closest_m is not None
            if closest_m is not None:
                self._off.points = meshes.line_segments(np.array([(x_m, y_m), closest_m]), _DOT_Z_M).astype(np.float32)

    @property
    def cue_spot(self) -> LabelSpot | None:
        """The words above the walker, as other labels must keep clear of them."""
        if not (self._root.visible and self._figure.words):
            return None
        x_m, y_m, _ = (round(float(part), 1) for part in self._root.position)
        return LabelSpot("cue", self._figure.words, (x_m, y_m, 2.05), 9, _CUE_SCALE, raised=True)

    def hide_details(self, hidden: bool) -> None:
        """Show the walker alone, without candidates, sonar and camera."""
        self._extras.hidden = hidden

    def _show_routes(self, view: LiveView) -> None:
        _show_path(self._trail, view.trail_m, _TRAIL_Z_M)
        _show_path(self._route, view.route_m, _ROUTE_Z_M)
        colour = look.ROUTE if view.freshness is Freshness.LIVE else look.dimmed(look.ROUTE, 0.5)
        is_of_now = view.is_believed and view.past is None
        self._route.colors = np.array(colour if is_of_now else look.WALKER_STALE, dtype=np.uint8)
        if self._trail.visible:
            self._trail.colors = trail_colours(view)

    def _dot(self, name: str, place_m: tuple[float, float] | None) -> None:
        dot = self._dots[name]
        if place_m is not None:
            dot.position = (place_m[0], place_m[1], _DOT_Z_M)
        dot.visible = place_m is not None


class _Figure:
    """The person, the disc of uncertainty, and the words above."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self.words = ""
        scene = client.scene
        body, disc, cone = meshes.walker_body(), meshes.lathe([(0.0, 0.0), (1.0, 0.0)], 48), meshes.unit_cone()
        self._frame = scene.add_frame("/walker/figure", show_axes=False)
        self._body = scene.add_mesh_simple(
            "/walker/figure/body", body.vertices_m, body.faces, color=look.WALKER, side="double", opacity=1.0, **_FLAT
        )
        self._head = scene.add_icosphere(
            "/walker/figure/head", radius=0.13, color=look.WALKER, position=(0.0, 0.0, 1.60), opacity=1.0, **_FLAT
        )
        self._nose = scene.add_mesh_simple(
            "/walker/figure/nose", cone.vertices_m, cone.faces, color=(255, 255, 255), side="double",
            scale=(0.05, 0.05, 0.14), position=(0.17, 0.0, 1.60), wxyz=(math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0),
            **_FLAT,
        )  # fmt: skip
        self._disc = scene.add_mesh_simple(
            "/walker/disc", disc.vertices_m, disc.faces, color=look.WALKER, side="double", opacity=0.25,
            position=(0.0, 0.0, 0.03), **_FLAT,
        )  # fmt: skip
        self._past = scene.add_line_segments(
            "/walker/past", meshes.dashed_ring(_PAST_RING_M, _DOT_Z_M).astype(np.float32), look.WALKER_STALE,
            thickness=4.0, thickness_units="screen", visible=False,
        )  # fmt: skip
        self._cue = scene.add_label(
            "/walker/cue",
            "",
            position=(0.0, 0.0, 2.05),
            anchor="bottom-center",
            font_screen_scale=_CUE_SCALE,
            visible=False,
        )

    def show(self, view: LiveView, eye_m: float, believed: bool) -> None:
        is_live = view.freshness is Freshness.LIVE and view.past is None
        colour: Rgb = look.WALKER if is_live else look.WALKER_STALE
        self._past.visible = view.past is not None
        height = float(np.clip(eye_m / meshes.FIGURE_EYE_HEIGHT_M, 0.5, 1.3))
        opacity = 1.0 if believed and view.past is None else 0.35
        for part in (self._body, self._head):
            part.color, part.opacity = colour, opacity
        self._body.scale = height
        self._head.position = (0.0, 0.0, 1.60 * height)
        self._nose.position = (0.17, 0.0, 1.60 * height)
        self._disc.color = colour
        self._disc.scale = (round(max(view.uncertainty_m, 0.3), 2),) * 2 + (1.0,)
        text = self._words(view)
        self._cue.text = text
        self._cue.visible = bool(text)
        self.words = text
        self._cue.position = (0.0, 0.0, 2.05 * height)

    @staticmethod
    def _words(view: LiveView) -> str:
        age_s = view.age_s or 0.0
        if view.past is not None:
            return view.past.words
        if view.freshness is not Freshness.LIVE:
            return f"{view.freshness.value.upper()}, seen {look.age_text(age_s)}"
        return f"“{view.cue}”" if view.cue else ""


class _Extras:
    """What the walker's device perceives and decides: view, candidates, chosen direction, sonar."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self.hidden = False
        scene = client.scene
        cone = meshes.horizontal_cone(_SONAR_HALF_FIELD_RAD, 1.0)
        self._sonar = scene.add_mesh_simple(
            "/walker/sonar", cone.vertices_m, cone.faces, color=look.SONAR, opacity=0.22, side="double", visible=False,
            **_FLAT,
        )  # fmt: skip
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._fan = scene.add_line_segments(
            "/walker/fan", nothing, look.CANDIDATE, thickness=2.5, thickness_units="screen", visible=False
        )
        self._chosen = scene.add_arrows(
            "/walker/chosen", nothing + 1e-3, look.CHOSEN, shaft_radius=0.05, head_radius=0.13, head_length=0.28,
            visible=False,
        )  # fmt: skip
        self._camera = scene.add_camera_frustum(
            "/walker/camera", fov=0.85, aspect=4 / 3, scale=0.34, thickness=2.0, thickness_units="screen",
            color=(235, 235, 235), wxyz=(0.5, -0.5, 0.5, -0.5), format="jpeg", jpeg_quality=70, visible=False,
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self._scan = scene.add_point_cloud(
            "/walker/scan", nothing[0], look.CANDIDATE, point_size=0.07, point_shape="circle", visible=False
        )
        self._silhouette_id = 0

    def show(self, state: WalkerState, eye_m: float, believed: bool) -> None:
        shown = believed and not self.hidden
        self._show_sonar(state, eye_m, shown)
        self._fan.visible = shown and bool(state.candidates)
        if self._fan.visible:
            self._fan.points = fan_segments(state).astype(np.float32)
        self._chosen.visible = believed and state.direction_rad is not None and state.action != "stop"
        if self._chosen.visible and state.direction_rad is not None:
            tip = np.array([math.cos(state.direction_rad), math.sin(state.direction_rad), 0.0])
            lift = np.array([0.0, 0.0, _FAN_Z_M + 0.1])
            ends = np.stack([lift + 0.35 * tip, lift + (0.35 + _ARROW_LENGTH_M) * tip])[None]
            self._chosen.points = ends.astype(np.float32)
        self._show_scan(state, shown)
        self._camera.position = (0.0, 0.0, eye_m)
        self._camera.visible = shown

    def show_silhouette(self, view: LiveView) -> None:
        """Put the latest silhouette on the camera's image plane, while it may still hold."""
        image = view.silhouette_rgb if view.is_silhouette_believed else None
        silhouette_id = 0 if image is None else id(image)
        if silhouette_id != self._silhouette_id:
            self._silhouette_id = silhouette_id
            self._camera.image = image

    def _show_scan(self, state: WalkerState, shown: bool) -> None:
        scan = getattr(getattr(state, "trace", None), "scan", None)
        points_m, colours_rgb = scan_points(scan) if shown and scan is not None else (np.zeros((0, 3)), None)
        self._scan.visible = len(points_m) > 0
        if colours_rgb is not None and self._scan.visible:
            self._scan.points, self._scan.colors = points_m.astype(np.float16), colours_rgb

    def _show_sonar(self, state: WalkerState, eye_m: float, shown: bool) -> None:
        self._sonar.visible = shown and state.sonar_state in ("ok", "no_echo")
        if not self._sonar.visible:
            return
        reach_m = state.sonar_m if state.sonar_state == "ok" and state.sonar_m is not None else _SONAR_RANGE_M
        self._sonar.scale = round(reach_m, 2)
        self._sonar.position = (0.0, 0.0, max(eye_m - 0.1, 0.3))
        self._sonar.color = look.SONAR_NEAR if reach_m < 2.0 else look.SONAR
        self._sonar.opacity = 0.3 if reach_m < 2.0 else 0.12


def trail_colours(view: LiveView) -> NDArray[np.uint8]:
    """Return colours for the ends of the trail's pieces (n − 1, 2, 3): the farther off the route, the stronger."""
    is_of_now = view.is_believed and view.past is None
    if not is_of_now or view.trail_deviations_m is None:
        colour = look.TRAIL if is_of_now else look.WALKER_STALE
        return np.full((len(view.trail_m) - 1, 2, 3), colour, dtype=np.uint8)
    far = np.nan_to_num(np.clip(view.trail_deviations_m / _FAR_OFF_M, 0.0, 1.0))[:, None]
    colours = ((1.0 - far) * look.TRAIL + far * look.SONAR_NEAR).astype(np.uint8)
    return np.stack([colours[:-1], colours[1:]], axis=1)


def fan_segments(state: WalkerState) -> FloatArray:
    """Return the candidate directions as segments (n, 2, 3) in the walker's frame, as long as they are clear."""
    ends = [(c.clearance_m * math.cos(c.angle_rad), c.clearance_m * math.sin(c.angle_rad)) for c in state.candidates]
    segments = np.zeros((len(ends), 2, 3))
    segments[:, :, 2] = _FAN_Z_M
    segments[:, 1, :2] = ends
    return segments


def _show_path(handle: viser.LineSegmentsHandle, path_m: FloatArray, z_m: float) -> None:
    handle.visible = len(path_m) > 1
    if handle.visible:
        handle.points = meshes.line_segments(path_m, z_m).astype(np.float32)
