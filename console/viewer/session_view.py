"""Everything that one browser window sees and does: its editor, its layers, its panel.

Made when a client connects, dropped when it goes. What is done with the editor runs beside the scene's loop, one thing
after the other; all else runs in the loop. ``tick`` (20 Hz) brings the picture in line with model and hub, and sends
only what differs.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial

import numpy as np
import viser
from viser._gui_handles import GuiModalHandle

from console.edits import Thing, ThingKind
from console.presence import Doing
from console.publishing import UnconfirmedError, publish
from console.roles import EDITING, TUNING, SignedIn
from console.services import Services
from console.view_requests import EndPast, FlyToPoi, FlyToPoint, FollowDevice, MoveCamera, ShowPast, ViewRequest
from console.viewer.appearance import LIGHT, THEMES, Theme
from console.viewer.begun import Drawing, FloorPoint, Mode
from console.viewer.cloud import FloorBounds
from console.viewer.cloud_layer import CloudColours, CloudLayer
from console.viewer.editor import Editor
from console.viewer.graph_layer import GraphHandlers, GraphLayer, Highlight
from console.viewer.keyboard import Keyboard
from console.viewer.label_layer import LabelLayer
from console.viewer.live_layer import LiveLayer
from console.viewer.live_view import LiveView
from console.viewer.map_panel import MapPanel
from console.viewer.meshes import floor_point
from console.viewer.past_playback import PastPlayback
from console.viewer.people_layer import PeopleLayer, words_of
from console.viewer.preview_layer import PreviewLayer
from console.viewer.road_layer import RoadLayer
from console.viewer.shortcuts import ARROWS, SHORTCUTS, Shortcut, help_groups
from console.viewer.tag import HEAD_Z_M
from console.viewer.theming import add_floor, set_theme
from console.viewer.tuning_panel import TuningPanel
from console.viewer.view_panel import ViewPanel
from console.viewer.walker_panel import WalkerPanel
from console.viewer.widgets import Act, at_once, on_press
from console.viewer.wording import keys_table
from navcore.errors import VbrError

_log = logging.getLogger(__name__)
_NOTICE_S = 6.0
_WORKING_S = 0.5
"""What takes longer says that it goes on."""
_PRESENCE_S = 4.0
"""A window says this often that it is still there (:mod:`console.presence` forgets the silent)."""


class SessionView:
    """The scene of one signed-in person in one window."""

    def __init__(
        self,
        client: viser.ClientHandle,
        person: SignedIn,
        services: Services,
        bounds: FloorBounds,
        colours: CloudColours,
        theme: Theme,
        is_open: Callable[[], bool],
    ) -> None:
        self.client = client
        self.person = person
        self._services = services
        self._bounds = bounds
        self._is_open = is_open
        self._last_pick_px: FloorPoint | None = None
        self._drawn: tuple[object, ...] = ()
        self._said: tuple[object, ...] = ()
        self._said_at_s = -np.inf
        self._others: tuple[object, ...] = ()
        self._help: GuiModalHandle | None = None
        self._loop = asyncio.get_running_loop()
        self._order = asyncio.Lock()
        """Held while an action has the editor."""
        self._taken: set[asyncio.Task[None]] = set()
        self._publishing: Future[None] | None = None
        self.editor = Editor(services.model, person, self.tell)
        self.keyboard = Keyboard(self.editor, self._camera_floor, services.hub.now_s)
        may_edit = self.editor.may_edit
        kinds: tuple[ThingKind, ...] = ("poi", "edge", "road")
        pick_poi, pick_edge, pick_road = (partial(self._pick, kind) for kind in kinds)
        self.roads = RoadLayer(client, pick_road)
        self.graph = GraphLayer(client, GraphHandlers(pick_poi, pick_edge, self._drag_poi if may_edit else None))
        self.preview = PreviewLayer(client)
        self.people = PeopleLayer(client)
        self.labels = LabelLayer(client, self.graph)
        self.live = LiveLayer(client)
        self.past = PastPlayback(client)
        self._build_panel(CloudLayer(client, colours), colours.cloud.sentence)
        client.scene.on_click()(self._click_floor)  # type: ignore[arg-type]
        client.scene.on_click(modifier="shift")(self._click_floor)  # type: ignore[arg-type]
        self._add_shortcuts()
        if theme is LIGHT:
            self.set_theme(theme)
        self.refresh()

    # ------------------------------------------------------------------------------------------------- panel
    def _build_panel(self, cloud: CloudLayer, sentence: str) -> None:
        gui, hub = self.client.gui, self._services.hub
        tabs = gui.add_tab_group()
        with tabs.add_tab("Map"):
            guide = self._guide_to if self.person.role in EDITING else None
            self.map_panel = MapPanel(self.client, self.editor, self.act, self.publish, guide)
        with tabs.add_tab("Walker"):
            self.walker_panel = WalkerPanel(self.client, hub, self.person, self.tell)
        with tabs.add_tab("View"):
            self.view_panel = ViewPanel(
                self.client, self._bounds, cloud, self.roads.root, sentence, lambda name: self.set_theme(THEMES[name])
            )
        self.tuning_panel: TuningPanel | None = None
        if self.person.role in TUNING:
            with tabs.add_tab("Tuning"):
                self.tuning_panel = TuningPanel(self.client, hub, self._services.tuning, self.person, self.tell)
        followed = self._services.views.followed(self.person.session_id)
        if followed is not None:
            self.walker_panel.device_id = followed

    def set_theme(self, theme: Theme) -> None:
        """Draw this window dark or light."""
        set_theme(self.client.gui, theme)
        add_floor(self.client.scene, self._bounds, theme)
        for layer in (self.roads, self.graph, self.preview):
            layer.set_theme(theme)
        self.refresh()

    def _add_shortcuts(self) -> None:
        editor, keyboard = self.editor, self.keyboard
        actions: dict[str, Callable[[], object]] = {
            "select": partial(editor.set_mode, Mode.SELECT), "tag": partial(editor.set_mode, Mode.TAG),
            "connect": partial(editor.set_mode, Mode.CONNECT), "draw": partial(editor.set_mode, Mode.DRAW),
            "propose": editor.propose, "publish": self.publish, "accept": self.map_panel.accept,
            "escape": self._escape, "take_back": editor.take_back, "delete": editor.delete_selected,
            "undo": editor.undo, "redo": editor.redo, "pick": keyboard.click,
            "next_place": partial(keyboard.cycle, "poi", 1), "previous_place": partial(keyboard.cycle, "poi", -1),
            "next_connection": partial(keyboard.cycle, "edge", 1),
            "previous_connection": partial(keyboard.cycle, "edge", -1),
            "next_road": partial(keyboard.cycle, "road", 1), "previous_road": partial(keyboard.cycle, "road", -1),
            **{name: partial(keyboard.arrow, *step) for name, step in ARROWS.items()},
        }  # fmt: skip
        views: dict[str, Callable[[], object]] = {
            "overview": self.view_panel.overview, "above": self.view_panel.from_above,
            "follow": self.view_panel.follow, "help": self.show_help,
        }  # fmt: skip
        for shortcut in SHORTCUTS:
            if shortcut.action in views:
                self._add_shortcut(shortcut, views[shortcut.action], at_once)
            elif editor.may_edit or not shortcut.is_editing:
                self._add_shortcut(shortcut, actions[shortcut.action], self.act)

    def _add_shortcut(self, shortcut: Shortcut, action: Callable[[], object], act: Act) -> None:
        command = self.client.gui.add_command(shortcut.words, hotkey=shortcut.key, modifier=shortcut.modifier)

        async def triggered(_: object) -> None:
            await act(action)

        command.on_trigger(triggered)

    def show_help(self) -> None:
        """Show the keys; once more closes them."""
        if self._help is not None:
            self._close_help()
            return
        self._help = self.client.gui.add_modal("Keys and mouse")
        with self._help:
            self.client.gui.add_html(keys_table(help_groups(self.editor.may_edit)))
            on_press(self.client.gui.add_button("Close (H)"), self._close_help, at_once)

    def _close_help(self) -> None:
        if self._help is not None:
            self._help.close()
            self._help = None

    def _escape(self) -> None:
        if self._help is not None:
            # What lies on top goes; what was begun below it stays.
            self._close_help()
            return
        if self.walker_panel.question.close():
            return
        self.keyboard.forget()
        self.editor.escape()

    # ----------------------------------------------------------------------------------------------- actions
    async def act(self, action: Callable[[], object]) -> None:
        """Do something with the editor, then redraw: one action after the other, in the order in which they were asked.

        An edit of a long road takes seconds: not in the loop that moves everybody's picture.
        """
        try:
            async with self._order:
                working = self._loop.call_later(_WORKING_S, self.map_panel.show_working)
                try:
                    await asyncio.to_thread(self._do, action)
                finally:
                    working.cancel()
        finally:
            self.refresh()

    def _do(self, action: Callable[[], object]) -> None:
        action()
        # Drawing the roads takes their network, which is worked out when it is first asked for.
        _ = self._services.model.network

    async def idle(self) -> None:
        """Wait until what was asked for until now is done."""
        while self._taken:
            await asyncio.wait(self._taken)
        async with self._order:
            pass

    def tell(self, title: str, sentence: str) -> None:
        """Show a notice in this window for a few seconds."""
        if not self._is_open():
            return
        self.client.add_notification(title, sentence, auto_close_seconds=_NOTICE_S, color="orange")

    def publish(self) -> None:
        """Give the draft to the devices."""
        if not self.editor.may_edit:
            self.tell("Not published", "Your role may look at the map, and not publish it: ask an editor.")
            return
        self.editor.put_down()
        # The draft is checked first, which may take seconds: not in the loop that moves everybody's picture.
        self._publishing = asyncio.run_coroutine_threadsafe(self._publish(), self._loop)

    async def published(self) -> None:
        """Wait until what was asked to be published last is published, or refused."""
        if self._publishing is not None:
            await asyncio.wrap_future(self._publishing)

    async def _publish(self) -> None:
        services, who = self._services, self.person.user_name
        try:
            published = await asyncio.to_thread(publish, services.model, services.checks, who)
        except UnconfirmedError as error:
            self.tell("Not published", f"{error} See the page Checks; Versions publishes all the same.")
        except VbrError as error:
            self.tell("Not published", str(error))
        except Exception:
            _log.exception("The draft of %s could not be published.", who)
            self.tell("Not published", "Something unexpected went wrong, which is in the console's log: try again.")
        else:
            sentence = f"The devices are given version {published.version}."
            self.client.add_notification("Published", sentence, auto_close_seconds=_NOTICE_S, color="green")
            self.refresh()

    def _guide_to(self, poi_id: str) -> None:
        self.walker_panel.guide_to(poi_id)

    async def _pick(self, kind: ThingKind, key: str, screen_pos: tuple[float, float]) -> None:
        def pick() -> None:
            if kind != "poi" and self.editor.wants_floor:
                # The click on the floor behind it, which comes next, is the one that is meant.
                return
            self._last_pick_px = screen_pos
            self.keyboard.forget()
            self.editor.pick((kind, key))

        await self.act(pick)

    async def _click_floor(self, event: viser.SceneClickEvent) -> None:
        point_m = floor_point(event.ray_origin, event.ray_direction)

        def pick() -> None:
            # Viser reports a click on a node, and then the same click on the scene behind it.
            picked_px, self._last_pick_px = self._last_pick_px, None
            if picked_px is not None and event.screen_pos == picked_px:
                return
            self.keyboard.forget()
            self.editor.pick_floor(point_m, is_free=event.modifier == "shift")

        await self.act(pick)

    async def _drag_poi(self, poi_id: str, event: viser.SceneNodeDragEvent) -> None:  # type: ignore[type-arg]
        eye_m = self.client.camera.position
        ray = np.asarray(event.end_position) - eye_m
        point_m = floor_point(tuple(eye_m), tuple(ray), HEAD_Z_M)
        if not self._is_open():
            # Reloaded, or the connection is lost: nobody has let go of the place there.
            self.editor.escape_move()
            return
        if event.phase == "end":
            await self.act(partial(self.editor.drop, poi_id, point_m))
            return
        async with self._order:
            # A thread for each movement of the mouse would cost more than working out where the place is.
            self.editor.drag_to(poi_id, point_m)
        self.refresh()

    def take(self, request: ViewRequest) -> None:
        """Do what the page around asks for. Called in the scene's loop."""
        match request:
            case FollowDevice(device_id):
                if device_id is not None:
                    self.walker_panel.choose(device_id)
            case MoveCamera(to):
                move = self.view_panel.follow if to == "walker" else self.view_panel.overview
                move()
            case ShowPast():
                self.past.take(request, self._services.hub.now_s())
            case EndPast():
                self.past.end()
            case FlyToPoi(poi_id):
                poi = self.editor.graph.pois.get(poi_id)
                if poi is not None:
                    self._fly_to(poi.x_m, poi.y_m, ("poi", poi.id))
            case FlyToPoint(x_m, y_m, thing):
                self._fly_to(x_m, y_m, thing)

    def _fly_to(self, x_m: float, y_m: float, thing: Thing | None) -> None:
        self.view_panel.fly_to(x_m, y_m)
        task = self._loop.create_task(self.act(partial(self.editor.select, thing)))
        self._taken.add(task)
        task.add_done_callback(self._taken.discard)

    def leave(self) -> None:
        """The window is closed: what was begun is dropped, and others no longer see this person here."""
        self._services.presence.leave(self.person, self._window_id)

    def _camera_floor(self) -> tuple[FloorPoint, FloorPoint]:
        camera = self.client.camera
        ahead = np.asarray(camera.look_at - camera.position)[:2]
        length = float(np.linalg.norm(ahead))
        towards = (float(ahead[0] / length), float(ahead[1] / length)) if length > 1e-9 else (0.0, 1.0)
        return (float(camera.look_at[0]), float(camera.look_at[1])), towards

    # ----------------------------------------------------------------------------------------------- drawing
    def refresh(self) -> None:
        """Draw the graph and the editor's panel as they are now; an action that has the editor draws when it ends."""
        if self._order.locked() or not self._is_open():
            return
        editor, model = self.editor, self._services.model
        editor.keep_up()
        selected = dict([editor.selected]) if editor.selected is not None else {}
        self.graph.show(editor.graph, Highlight(selected.get("poi"), selected.get("edge"), editor.moving_id))
        self.roads.show(model.graph.roads, model.network, selected.get("road"))
        snapped = editor.snapped_m if isinstance(editor.begun, Drawing) else ()
        self.preview.show(editor.begun, snapped, self.keyboard.cursor_m)
        self.map_panel.show(unpublished=model.graph.version != model.published.version)
        self._drawn = (model.graph.version, model.published.version)
        self.labels.forget()
        self._say_presence()

    def tick(self, view: LiveView) -> None:
        """Bring the picture in line with what is known now."""
        model, hub = self._services.model, self._services.hub
        if not self._order.locked():
            self._keep_up(hub.now_s())
        self._say_presence()
        self._show_people()
        self.live.hide_details(not self.view_panel.details.value)
        shown = self.past.view(view)
        self.live.show(shown)
        self.walker_panel.show(view, hub.devices(), model.published)
        if self.tuning_panel is not None:
            self.tuning_panel.tick(view.device)
        self.view_panel.tick(shown)
        cue = self.live.cue_spot
        kept_clear = (*self.people.spots, cue) if cue is not None else self.people.spots
        poi = self.editor.poi
        self.labels.arrange(poi.id if poi is not None else None, self.view_panel.lengths.value, kept_clear)

    def _keep_up(self, now_s: float) -> None:
        model, was_moving = self._services.model, self.editor.moving
        self.editor.rest(now_s)
        is_current = self._drawn == (model.graph.version, model.published.version) and self.graph.is_complete
        if not is_current or was_moving is not self.editor.moving:
            self.refresh()

    # ---------------------------------------------------------------------------------------------- presence
    @property
    def _window_id(self) -> str:
        return f"scene-{self.client.client_id}"

    def _say_presence(self) -> None:
        now_s = self._services.hub.now_s()
        said = (self._doing, self.editor.selected)
        if said == self._said and now_s - self._said_at_s < _PRESENCE_S:
            return
        self._said, self._said_at_s = said, now_s
        self._services.presence.say(self.person, self._window_id, "scene", *said)

    @property
    def _doing(self) -> Doing:
        editor = self.editor
        if editor.moving is not None:
            return "dragging"
        if isinstance(editor.begun, Drawing):
            return "drawing"
        return "editing" if editor.may_edit and (editor.begun or editor.selected) else "looking"

    def _show_people(self) -> None:
        others = self._services.presence.others(self.person.user_name)
        shown = (others, self._services.model.graph.version)
        if shown == self._others:
            return
        self._others = shown
        graph = self._services.model.graph
        self.people.show(others, graph)
        self.map_panel.show_people([words_of(present, graph) for present in others])
