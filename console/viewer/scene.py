"""The scene of a site: the static map for everybody, and a view of their own for each window.

Only what never changes is shared (viser replays every shared message to each newcomer, and the cost of that grows with
their number since the start); everything live, editable, or dependent on a role belongs to one connection.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from functools import partial

import cv2
import numpy as np
import viser
from fastapi import FastAPI
from numpy.typing import NDArray

from console.live import LiveDevice
from console.services import Services
from console.view_requests import ViewRequest
from console.viewer.appearance import DARK, LIGHT
from console.viewer.cloud import (
    FOV_RAD,
    FloorBounds,
    ShownCloud,
    floor_bounds,
    overview,
    shown_cloud,
)
from console.viewer.cloud_layer import CloudColours, add_points
from console.viewer.embedded import EmbeddedViser
from console.viewer.live_view import LiveView, Trail
from console.viewer.mount import Authenticate, mount
from console.viewer.session_view import SessionView
from console.viewer.theming import add_floor, set_theme
from navcore.errors import WireError
from navcore.jpeg_size import refuse_picture
from navcore.wire import DepthImage

_log = logging.getLogger(__name__)
TICK_S = 0.05
_NO_TRAIL = Trail()


class Scene:
    """The 3D scene of one site, for any number of windows.

    ``tick_s`` is the time between two looks at model and hub; with None, somebody else calls :meth:`tick`. ``thin``
    chooses the points that are shown of a large cloud.
    """

    def __init__(self, services: Services, tick_s: float | None = TICK_S) -> None:
        self._services = services
        site = services.model.site
        self.cloud = shown_cloud(site.cloud_points_m, site.cloud_colours_rgb)
        self._colours = CloudColours(site, self.cloud)
        self.bounds = floor_bounds(site.cloud_points_m, site.roads_m)
        if self.cloud.shown_count < self.cloud.total_count:
            _log.warning("%s", self.cloud.sentence)
        self.embedded = EmbeddedViser()
        self.views: dict[int, SessionView] = {}
        self._unsubscribe: dict[int, Callable[[], None]] = {}
        self._trails: dict[str, Trail] = {}
        self._silhouettes: dict[str, tuple[DepthImage, NDArray[np.uint8] | None]] = {}
        server = self.embedded.server
        _configure(server)
        draw_map(server, self.cloud, self.bounds)
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._disconnected)
        self._ticking = None
        if tick_s is not None:
            self._ticking = asyncio.run_coroutine_threadsafe(self._tick_for_ever(tick_s), self.embedded.loop)

    def stop(self) -> None:
        """End all windows and the scene's own thread."""
        if self._ticking is not None:
            self._ticking.cancel()
        self.embedded.stop()

    # ----------------------------------------------------------------------------------------------- windows
    async def _connected(self, client: viser.ClientHandle) -> None:
        try:
            person = self.embedded.visitor_of(client)
        except KeyError:
            return
        theme = LIGHT if self.embedded.prefers_light(client) else DARK
        is_open = partial(self.embedded.is_open, client)
        view = SessionView(client, person, self._services, self.bounds, self._colours, theme, is_open)
        loop = self.embedded.loop

        def asked(request: ViewRequest) -> None:
            loop.call_soon_threadsafe(view.take, request)

        self._services.watching.opened(view, person.user_name, says=True, counts_alone=True)
        self.views[client.client_id] = view
        self._unsubscribe[client.client_id] = self._services.views.subscribe(person.session_id, asked)

    async def _disconnected(self, client: viser.ClientHandle) -> None:
        view = self.views.pop(client.client_id, None)
        if view is not None:
            self._services.watching.closed(view)
            view.leave()
        unsubscribe = self._unsubscribe.pop(client.client_id, None)
        if unsubscribe is not None:
            unsubscribe()

    # -------------------------------------------------------------------------------------------------- time
    async def _tick_for_ever(self, tick_s: float) -> None:
        while True:
            self.tick()
            await asyncio.sleep(tick_s)

    def tick(self) -> None:
        """Bring every window in line with model and hub. Called in the scene's loop."""
        devices = {device.device_id: device for device in self._services.hub.devices()}
        for device_id in self._trails.keys() - devices.keys():
            del self._trails[device_id]
            self._silhouettes.pop(device_id, None)
        for device in devices.values():
            if device.state is not None:
                self._trails.setdefault(device.device_id, Trail()).add(device.state)
        for view in tuple(self.views.values()):
            try:
                view.tick(self._live_view(view, devices))
            except Exception:
                # One window that fails must not freeze the others.
                _log.exception("A window of %s could not be brought up to date.", view.person.user_name)

    def _watched_by(self, view: SessionView, devices: Mapping[str, LiveDevice]) -> LiveDevice | None:
        """Return the device that a window shows, where its walker is told that it does."""
        device = devices.get(view.walker_panel.device_id or "")
        if device is None:
            return None
        self._services.watching.shows(view, frozenset({device.device_id}))
        return device if self._services.watching.scene_sees(view, device.device_id) else None

    def _live_view(self, view: SessionView, devices: Mapping[str, LiveDevice]) -> LiveView:
        now_s = self._services.hub.now_s()
        shown_id, device = view.walker_panel.device_id or "", self._watched_by(view, devices)
        sees, who = self._services.watching.person_sees, view.person.user_name
        others = tuple(other for key, other in devices.items() if key != shown_id and sees(who, key))
        if device is None:
            return LiveView(None, now_s, others=others)
        trail = self._trails.get(shown_id, _NO_TRAIL)
        return LiveView(device, now_s, self._silhouette(device), trail.points_m, trail.deviations_m, others)

    def _silhouette(self, device: LiveDevice) -> NDArray[np.uint8] | None:
        """Return the latest silhouette, decoded once for all windows."""
        image = device.depth_image
        if image is None:
            return None
        known = self._silhouettes.get(device.device_id)
        if known is None or known[0] is not image:
            known = self._silhouettes[device.device_id] = (image, decoded(image.jpeg))
        return known[1]


def decoded(jpeg: bytes) -> NDArray[np.uint8] | None:
    """Return a JPEG as an image (height, width, 3), red first; None where it cannot be read or is too large."""
    try:
        refuse_picture(jpeg)
        image = cv2.imdecode(np.frombuffer(jpeg, dtype=np.uint8), cv2.IMREAD_COLOR)
    except (WireError, cv2.error):
        return None
    if image is None:
        return None
    return np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)


def draw_map(server: viser.ViserServer, cloud: ShownCloud, bounds: FloorBounds) -> None:
    """Draw what never changes: floor, cloud and ceiling, below nodes that a window can hide for itself."""
    scene = server.scene
    add_floor(scene, bounds, DARK)
    for name in ("/map/cloud", "/map/ceiling"):
        scene.add_frame(name, show_axes=False)
    for part in (*cloud.parts, *cloud.ceiling_parts):
        add_points(scene, part.name, part.points_m, part.colours_rgb, cloud.point_size_m)
    # Nobody has opened a window yet; each fits it to its own size.
    view = overview(bounds)
    server.initial_camera.position = view.position_m
    server.initial_camera.fov = FOV_RAD
    server.initial_camera.look_at = view.look_at_m


def _configure(server: viser.ViserServer) -> None:
    set_theme(server.gui, DARK)
    server.gui.set_panel_label("Virtual blind road")
    # Viser's picture of surroundings, which things mirror, takes seconds to work out where there is no graphics card.
    server.scene.configure_environment_map(None)
    server.scene.add_light_hemisphere("/sky", ground_color=(210, 210, 220), intensity=1.2)


def install(app: FastAPI, services: Services, authenticate: Authenticate) -> Scene:
    """Mount the scene of a console: page, WebSocket, windows. The application calls ``stop`` when it ends."""
    scene = Scene(services)
    mount(app, scene.embedded, authenticate, services.sockets, session_url="/api/session", sign_in_url="/signin")
    return scene
