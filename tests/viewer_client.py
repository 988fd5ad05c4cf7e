"""A browser that is none: a client of the scene inside the test's own process, driven by the messages of a real one."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import viser._messages as messages
from viser.infra._async_message_buffer import AsyncMessageBuffer
from viser.infra._infra import ClientId, WebsockClientConnection, _ClientHandleState

from console.roles import Role, SignedIn
from console.viewer.labels import Lens, project
from console.viewer.scene import Scene
from console.viewer.session_view import SessionView
from console.viewer.shortcuts import SHORTCUTS
from console.viewer.tag import HEAD_Z_M
from navcore.geometry import quat_xyzw_from_rotation

T = TypeVar("T")
WINDOW_PX = (1200, 800)


class FakeBrowser:
    """One connected window: real buffers and handles, no socket. What it does goes through viser's own handlers."""

    def __init__(self, scene: Scene, role: Role = "editor", user_name: str = "Ada", client_id: int = 100) -> None:
        self.scene = scene
        self._server = scene.embedded.server
        self.person = SignedIn(f"session-{client_id}", client_id, user_name, role)
        self.client_id = client_id
        self._loop = scene.embedded.loop
        self.run(self._connect())
        self.view: SessionView = scene.views[client_id]

    def run(self, action: Coroutine[Any, Any, T]) -> T:
        """Run something in the scene's loop, and wait for it."""
        return asyncio.run_coroutine_threadsafe(action, self._loop).result(timeout=60)

    async def _connect(self) -> None:
        self._buffer = AsyncMessageBuffer(self._loop, persistent_messages=False)
        state = _ClientHandleState(self._buffer, self._loop)
        websock = self._server._websock_server
        self._connection = WebsockClientConnection(self.client_id, state)
        websock._client_state_from_id[ClientId(self.client_id)] = state
        websock._live_connections[ClientId(self.client_id)] = SimpleNamespace(identity=self.person)
        for callback in websock._client_connect_cb:
            await callback(self._connection)
        await self._deliver(self._camera())

    def disconnect(self) -> None:
        """Close the window."""

        async def leave() -> None:
            websock = self._server._websock_server
            websock._client_state_from_id.pop(ClientId(self.client_id), None)
            websock._live_connections.pop(ClientId(self.client_id), None)
            for callback in websock._client_disconnect_cb:
                await callback(self._connection)

        self.run(leave())

    async def _deliver(self, message: messages.Message) -> None:
        websock = self._server._websock_server
        await websock._handle_incoming_message(ClientId(self.client_id), message)
        await self._connection._handle_incoming_message(ClientId(self.client_id), message)

    def send(self, message: messages.Message) -> None:
        """Deliver one message, as if the browser had sent it and the guard had let it pass."""
        self.run(self._deliver(message))

    def begin(self, message: messages.Message) -> Future[None]:
        """Deliver one message, and return at once: what comes of it may take a while."""
        return asyncio.run_coroutine_threadsafe(self._deliver(message), self._loop)

    # -------------------------------------------------------------------------------------------- the camera
    def _camera(self) -> messages.ViewerCameraMessage:
        position, look_at = np.array([10.0, -14.0, 14.0]), np.array([10.0, 0.0, 0.0])
        forward = (look_at - position) / np.linalg.norm(look_at - position)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.column_stack([right, np.cross(forward, right), forward])
        self.lens = Lens(position, _quat_wxyz(rotation), 1.2, *WINDOW_PX)
        return messages.ViewerCameraMessage(
            tuple(self.lens.quat_wxyz), tuple(position), 1.2, 0.01, 1000.0, WINDOW_PX[1], WINDOW_PX[0],
            tuple(look_at), (0.0, 0.0, 1.0),
        )  # fmt: skip

    def _ray(self, place_m: tuple[float, float, float]) -> tuple[Any, Any, Any]:
        """Return origin, direction and place in the window (0–1) of a click at a place in the world."""
        origin = self.lens.position_m
        direction = np.array(place_m) - origin
        pixels, _ = project(np.array([place_m]), self.lens)
        return tuple(origin), tuple(direction / np.linalg.norm(direction)), tuple(pixels[0] / np.array(WINDOW_PX))

    # ------------------------------------------------------------------------------------ what a person does
    def click_floor(self, x_m: float, y_m: float, modifier: messages.KeyModifier | None = None) -> None:
        """Click at a place of the floor."""
        origin, direction, screen = self._ray((x_m, y_m, 0.0))
        self.send(messages.ScenePointerMessage("click", origin, direction, (screen,), modifier))

    def click_node(
        self, name: str, place_m: tuple[float, float, float], instance: int | None = None, owner: int | None = None
    ) -> None:
        """Click on a node: viser sends the click on the node, then the one on the scene behind it.

        ``owner`` names the window that the node belongs to: another one is a forged message.
        """
        origin, direction, screen = self._ray(place_m)
        self.send(
            messages.SceneNodeClickMessage(
                name, instance, origin, direction, screen, None, owner=str(self.client_id if owner is None else owner)
            )
        )
        self.send(messages.ScenePointerMessage("click", origin, direction, (screen,), None))

    def click_poi(self, poi_id: str) -> None:
        """Click on the tag of a place."""
        poi = self.view.editor.graph.pois[poi_id]
        self.click_node(f"/graph/poi/{poi_id}/head", (poi.x_m, poi.y_m, HEAD_Z_M))

    def click_edge(self, edge_id: str) -> None:
        """Click on an edge."""
        x_m, y_m = self.view.editor.graph.edges[edge_id].path_m[0]
        self.click_node("/graph/edges", (x_m, y_m, 0.07), self.view.graph.instances.index(edge_id))

    def click_road(self, road_id: str, x_m: float, y_m: float) -> None:
        """Click on the band of a road, above a place of the floor."""
        self.click_node(f"/road/{road_id}", (x_m, y_m, 0.0))

    def tick(self) -> None:
        """Let the scene look at model and hub once, and wait until what was asked for is done."""
        self.look()
        self.run(self.view.idle())

    def look(self) -> None:
        """Let the scene look at model and hub once, whatever is going on."""

        async def look() -> None:
            self.scene.tick()

        self.run(look())

    def drag_poi(self, poi_id: str, phase: str, x_m: float, y_m: float) -> None:
        """Press, move or let go of the mouse with a tag in hand, above a place of the floor."""
        place = (x_m, y_m, HEAD_Z_M)
        _, _, screen = self._ray(place)
        self.send(
            messages.SceneNodeDragMessage(
                phase,
                f"/graph/poi/{poi_id}/head",
                None,
                place,
                screen,
                place,
                screen,
                "left",
                None,
                owner=str(self.client_id),
            )
        )

    def press(self, label: str) -> None:
        """Trigger a shortcut by its label."""
        self.send(self._trigger(label))

    def _trigger(self, label: str) -> messages.Message:
        commands = self.view.client.gui._command_handle_from_uuid
        uuid = next(key for key, command in commands.items() if command._impl.props.label == label)
        return messages.CommandTriggerMessage(uuid)

    def key(self, action: str) -> None:
        """Press the key of an action of the table of shortcuts."""
        self.press(_label_of(action))

    def begin_key(self, action: str) -> Future[None]:
        """Press a key, and return at once."""
        return self.begin(self._trigger(_label_of(action)))

    def set_widget(self, label: str, value: object) -> None:
        """Change, or press, the first visible widget of this label."""
        handles = self.view.client.gui._gui_input_handle_from_uuid
        uuid = next(
            key for key, handle in handles.items()
            if getattr(handle._impl.props, "label", None) == label and _is_shown(handle)
        )  # fmt: skip
        self.send(messages.GuiUpdateMessage(uuid, {"value": value}))

    @property
    def notices(self) -> list[str]:
        """The sentences of the notices that were sent to this window and are not delivered yet."""
        return [m.props.body for m in self.outbox if isinstance(m, messages.NotificationShowMessage)]

    @property
    def outbox(self) -> list[messages.Message]:
        """Messages for this window, in order, coalesced as viser does."""
        return list(self._buffer.message_from_id.values())  # type: ignore[arg-type]

    @property
    def node_names(self) -> set[str]:
        """Names of the nodes that this window alone has."""
        return set(self.view.client.scene._handle_from_node_name)


def _label_of(action: str) -> str:
    return next(each.words for each in SHORTCUTS if each.action == action)


def _is_shown(handle: Any) -> bool:
    """Whether a widget and the folders around it are visible."""
    impl = handle._impl
    while impl is not None:
        if not getattr(impl.props, "visible", True):
            return False
        parent = impl.gui_api._container_handle_from_uuid.get(impl.parent_container_id)
        impl = getattr(parent, "_impl", None)
    return True


def _quat_wxyz(rotation: Any) -> Any:
    x, y, z, w = quat_xyzw_from_rotation(rotation)
    return np.array([w, x, y, z])
