"""Everything that one browser window sees and does: its editor, its layers, its panel.

Made when a client connects, dropped when it goes. All of it runs in the scene's own loop, one thing after the other;
``tick`` (20 Hz) brings the picture in line with model and hub, and sends only what differs.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
import viser

from console.errors import ConsoleError
from console.roles import EDITING, TUNING, SignedIn
from console.services import Services
from console.view_requests import FlyToPoi, FollowDevice, ViewRequest
from console.viewer.appearance import PREVIEW
from console.viewer.cloud import FloorBounds, ShownCloud
from console.viewer.editor import Editor, Mode
from console.viewer.graph_layer import GraphHandlers, GraphLayer, Highlight
from console.viewer.labels import LabelSpot, Lens, readable
from console.viewer.live_layer import LiveLayer
from console.viewer.live_view import LiveView
from console.viewer.map_panel import MapPanel
from console.viewer.meshes import floor_point, ring
from console.viewer.tag import HEAD_Z_M, NAME_SCALE
from console.viewer.tuning_panel import TuningPanel
from console.viewer.view_panel import ViewPanel
from console.viewer.walker_panel import WalkerPanel

_log = logging.getLogger(__name__)
_NOTICE_S = 6.0


class SessionView:
    """The scene of one signed-in person in one window."""

    def __init__(
        self, client: viser.ClientHandle, person: SignedIn, services: Services, bounds: FloorBounds, cloud: ShownCloud
    ) -> None:
        self.client = client
        self.person = person
        self._services = services
        self._last_pick_px: tuple[float, float] | None = None
        self._drawn: tuple[object, ...] = ()
        self._labels_for: tuple[object, ...] = ()
        self.editor = Editor(services.model, person, self.tell)
        self.graph = GraphLayer(
            client,
            GraphHandlers(self._pick_poi, self._pick_edge, self._drag_poi if self.editor.may_edit else None),
        )
        self.live = LiveLayer(client)
        self._pending = _pending_marker(client)
        self._build_panel(bounds, cloud)
        client.scene.on_click()(self._click_floor)  # type: ignore[arg-type]
        self._add_shortcuts()
        self.view_panel.fit_first_view()
        self.refresh()

    # ------------------------------------------------------------------------------------------------- panel
    def _build_panel(self, bounds: FloorBounds, cloud: ShownCloud) -> None:
        gui, hub = self.client.gui, self._services.hub
        tabs = gui.add_tab_group()
        with tabs.add_tab("Map"):
            guide = self._guide_to if self.person.role in EDITING else None
            self.map_panel = MapPanel(self.client, self.editor, self.refresh, self.publish, guide)
        with tabs.add_tab("Walker"):
            self.walker_panel = WalkerPanel(self.client, hub, self.person, self.tell)
        with tabs.add_tab("View"):
            self.view_panel = ViewPanel(self.client, bounds, cloud)
        self.tuning_panel: TuningPanel | None = None
        if self.person.role in TUNING:
            with tabs.add_tab("Tuning"):
                self.tuning_panel = TuningPanel(self.client, hub, self._services.tuning, self.person, self.tell)
        followed = self._services.views.followed(self.person.session_id)
        if followed is not None:
            self.walker_panel.device_id = followed

    def _add_shortcuts(self) -> None:
        editor = self.editor
        self._shortcut("Overview", self.view_panel.overview, "O")
        self._shortcut("Follow the walker", self.view_panel.follow, "F")
        self._shortcut("Let go of what was begun", editor.escape, "escape")
        if not editor.may_edit:
            return
        self._shortcut("Select and move", lambda: editor.set_mode(Mode.SELECT), "1")
        self._shortcut("Tag a place", lambda: editor.set_mode(Mode.TAG), "2")
        self._shortcut("Connect two places", lambda: editor.set_mode(Mode.CONNECT), "3")
        self._shortcut("Accept", self.map_panel.accept, "enter")
        self._shortcut("Delete what is selected", editor.delete_selected, "delete")
        self._shortcut("Undo", editor.undo, "Z", "cmd/ctrl")
        self._shortcut("Redo", editor.redo, "Z", "cmd/ctrl+shift")
        self._shortcut("Join all neighbours along the road", editor.propose_edges, None)
        self._shortcut("Publish the map", self.publish, None)

    def _shortcut(
        self, label: str, action: Callable[[], object], hotkey: str | None, modifier: str | None = None
    ) -> None:
        command = self.client.gui.add_command(label, hotkey=hotkey, modifier=modifier)  # type: ignore[arg-type]

        async def triggered(_: object) -> None:
            action()
            self.refresh()

        command.on_trigger(triggered)

    # ----------------------------------------------------------------------------------------------- actions
    def tell(self, title: str, sentence: str) -> None:
        """Show a notice in this window for a few seconds."""
        self.client.add_notification(title, sentence, auto_close_seconds=_NOTICE_S, color="orange")

    def publish(self) -> None:
        """Give the draft to the devices."""
        if not self.editor.may_edit:
            self.tell("Not published", "Your role may look at the map, and not publish it: ask an editor.")
            return
        try:
            version = self._services.model.publish(self.person.user_name).version
        except ConsoleError as error:
            self.tell("Not published", str(error))
        else:
            self.client.add_notification(
                "Published", f"The devices are given version {version}.", auto_close_seconds=_NOTICE_S, color="green"
            )

    def _guide_to(self, poi_id: str) -> None:
        self.walker_panel.guide_to(poi_id)

    async def _pick_poi(self, poi_id: str, screen_pos: tuple[float, float]) -> None:
        self._last_pick_px = screen_pos
        self.editor.pick_poi(poi_id)
        self.refresh()

    async def _pick_edge(self, edge_id: str, screen_pos: tuple[float, float]) -> None:
        if self.editor.mode is not Mode.SELECT:
            return
        self._last_pick_px = screen_pos
        self.editor.pick_edge(edge_id)
        self.refresh()

    async def _click_floor(self, event: viser.SceneClickEvent) -> None:
        # Viser reports a click on a node, and then the same click on the scene behind it.
        if self._last_pick_px is not None and event.screen_pos == self._last_pick_px:
            self._last_pick_px = None
            return
        self._last_pick_px = None
        self.editor.pick_floor(floor_point(event.ray_origin, event.ray_direction))
        self.refresh()

    async def _drag_poi(self, poi_id: str, event: viser.SceneNodeDragEvent) -> None:  # type: ignore[type-arg]
        eye_m = self.client.camera.position
        ray = np.asarray(event.end_position) - eye_m
        point_m = floor_point(tuple(eye_m), tuple(ray), HEAD_Z_M)
        if event.phase == "end":
            self.editor.drop(poi_id, point_m)
        else:
            self.editor.drag_to(poi_id, point_m)
        self.refresh()

    def take(self, request: ViewRequest) -> None:
        """Do what the page around asks for. Called in the scene's loop."""
        if isinstance(request, FollowDevice):
            if request.device_id is not None:
                self.walker_panel.choose(request.device_id)
        elif isinstance(request, FlyToPoi):
            poi = self.editor.graph.pois.get(request.poi_id)
            if poi is not None:
                self.editor.select(poi_id=poi.id)
                self.view_panel.fly_to(poi.x_m, poi.y_m)
        self.refresh()

    # ----------------------------------------------------------------------------------------------- drawing
    def refresh(self) -> None:
        """Draw the graph and the editor's panel as they are now."""
        editor, model = self.editor, self._services.model
        if editor.poi is None and editor.edge is None:
            editor.select()
        highlight = Highlight(editor.poi_id, editor.edge_id, editor.moving_id)
        self.graph.show(editor.graph, highlight)
        if editor.moving_id is None:
            self.graph.show_preview(editor.pending_edge.path_m if editor.pending_edge is not None else None)
        self._pending.visible = editor.pending_tag is not None
        if editor.pending_tag is not None:
            self._pending.position = (*editor.pending_tag, 0.06)
        self.map_panel.show(unpublished=model.graph.version != model.published.version)
        self._drawn = (model.graph.version, model.published.version)
        self._labels_for = ()

    def tick(self, view: LiveView) -> None:
        """Bring the picture in line with what is known now."""
        model, hub = self._services.model, self._services.hub
        if self._drawn != (model.graph.version, model.published.version):
            self.refresh()
        self.live.hide_details(not self.view_panel.details.value)
        self.live.show(view)
        self.walker_panel.show(view, hub.devices(), model.published)
        if self.tuning_panel is not None:
            self.tuning_panel.tick(view.device)
        self.view_panel.tick(view)
        self._arrange_labels()

    def _arrange_labels(self) -> None:
        camera = self.client.camera
        lengths = self.view_panel.lengths.value
        seen = (camera.update_timestamp, lengths, self.live.cue_spot)
        if seen == self._labels_for:
            return
        self._labels_for = seen
        height_px = max(camera.image_height, 1)
        lens = Lens(camera.position, camera.wxyz, camera.fov, max(camera.image_width, 1), height_px)
        selected = self.editor.poi_id
        spots = [
            LabelSpot(f"poi {key}", tag.label.text, (tag.poi.x_m, tag.poi.y_m, HEAD_Z_M + 0.3),
                      3 if key == selected else 1 if tag.poi.kind == "junction" else 2, NAME_SCALE, raised=True)
            for key, tag in self.graph.tags.items()
        ]  # fmt: skip
        for key, label in self.graph.length_labels.items():
            x_m, y_m, z_m = (float(part) for part in label.position)
            spots.append(LabelSpot(f"edge {key}", label.text, (x_m, y_m, z_m), 0, 0.75))
        cue = self.live.cue_spot
        shown = readable([*spots, cue] if cue is not None else spots, lens)
        with self.client.atomic():
            for key, tag in self.graph.tags.items():
                tag.label.visible = f"poi {key}" in shown
            for key, label in self.graph.length_labels.items():
                label.visible = lengths and f"edge {key}" in shown


def _pending_marker(client: viser.ClientHandle) -> viser.MeshHandle:
    mesh = ring(0.3, 0.12)
    return client.scene.add_mesh_simple(
        "/graph/pending", mesh.vertices_m, mesh.faces, color=PREVIEW, side="double", visible=False, cast_shadow=False,
        receive_shadow=False,
    )  # fmt: skip
