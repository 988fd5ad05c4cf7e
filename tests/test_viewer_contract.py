"""What the scene relies on inside viser 1.1.1, thing by thing: with another version these fail, and say what moved."""

from __future__ import annotations

import asyncio
import dataclasses
import inspect
import socket
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser
import viser._assignable_props_api as assignable_props
import viser._messages as messages
import viser.infra._infra as infra
from viser.infra._messages import get_type_hints_cached

from console.viewer import guard
from console.viewer.embedded import SUBPROTOCOL, VISER_VERSION, EmbeddedViser, client_html, portions
from console.viewer.page import inline_scripts, scene_page


@pytest.fixture(scope="module")
def embedded() -> Iterator[EmbeddedViser]:
    embedded = EmbeddedViser()
    yield embedded
    embedded.stop()


def test_the_installed_viser_is_the_one_that_everything_here_was_written_for() -> None:
    assert version("viser") == viser.__version__ == VISER_VERSION


def test_no_port_is_opened_and_the_handler_is_captured(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("viser opened a port")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    monkeypatch.setenv("_VISER_PORT_OVERRIDE", "8099")
    embedded = EmbeddedViser()
    try:
        assert inspect.iscoroutinefunction(embedded._handler)
        assert list(inspect.signature(embedded._handler).parameters) == ["connection"]
    finally:
        embedded.stop()


def test_what_was_put_in_place_for_the_construction_is_taken_out_again(embedded: EmbeddedViser) -> None:
    import viser._client_autobuild as autobuild
    import websockets

    assert vars(infra)["websockets"] is websockets
    assert autobuild.ensure_client_is_built.__name__ == "ensure_client_is_built"


def test_the_client_build_is_not_started(monkeypatch: pytest.MonkeyPatch) -> None:
    import subprocess

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("viser started a process")

    monkeypatch.setattr(subprocess, "run", refuse)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    EmbeddedViser().stop()


def test_nobody_can_ask_for_a_public_share_tunnel(embedded: EmbeddedViser) -> None:
    handlers = embedded.server._websock_server._incoming_handlers
    assert messages.ShareUrlRequest not in handlers
    assert messages.ShareUrlDisconnect not in handlers


def test_the_parts_of_the_server_that_are_used_are_there(embedded: EmbeddedViser) -> None:
    websock = embedded.server._websock_server
    assert isinstance(websock._live_connections, dict)
    assert websock._background_event_loop is embedded.loop
    assert embedded.loop.is_running()


@pytest.mark.parametrize("name", sorted(guard.LOOKING | guard.EDITING))
def test_every_permitted_message_exists(name: str) -> None:
    assert name in messages.Message._subclass_from_type_string()


@pytest.mark.parametrize(
    ("message", "fields"),
    [
        (messages.SceneNodeClickMessage, {"name", "instance_index", "ray_origin", "ray_direction", "screen_pos"}),
        (messages.ScenePointerMessage, {"event_type", "ray_origin", "ray_direction", "screen_pos", "modifier"}),
        (messages.SceneNodeDragMessage, {"phase", "name", "end_position", "button", "modifier", "owner"}),
        (messages.GuiUpdateMessage, {"uuid", "updates"}),
        (messages.CommandTriggerMessage, {"uuid"}),
        (messages.ViewerCameraMessage, {"wxyz", "position", "fov", "look_at", "image_height", "image_width"}),
    ],
)
def test_messages_have_the_fields_that_are_relied_on(message: type, fields: set[str]) -> None:
    assert fields <= {field.name for field in dataclasses.fields(message)}


def test_the_client_page_has_the_form_that_the_policy_is_made_for() -> None:
    html = client_html()
    assert len(inline_scripts(html)) == 1
    page = scene_page(html, "Title", "/session", "/in")
    assert b"document.hasFocus" in page.body
    assert page.content_security_policy.count("'sha256-") == 2
    assert "unsafe-eval'" not in page.content_security_policy.replace("wasm-unsafe-eval'", "")
    assert "connect-src 'self'" in page.content_security_policy


def test_a_page_of_another_form_is_refused_loudly() -> None:
    with pytest.raises(ValueError, match="another form"):
        scene_page("<head><title>Viser</title></head><script>a</script><script>b</script>", "T", "/s", "/i")


def test_the_subprotocol_carries_the_version() -> None:
    assert f"viser-v{viser.__version__}" == SUBPROTOCOL


def test_what_is_shared_is_sent_in_portions_the_first_points_first(embedded: EmbeddedViser) -> None:
    """A newcomer's first message holds the first part of the cloud, not all of it."""
    for number in range(4):
        points = np.zeros((200_000, 3), np.float32)
        embedded.server.scene.add_point_cloud(f"/part{number}", points, (1, 2, 3), precision="float32")

    async def windows() -> list[list[str]]:
        generator = embedded.server._websock_server._broadcast_buffer.window_generator(7)
        found: list[list[str]] = []
        while "/part3" not in {name for window in found for name in window}:
            found.append([str(getattr(message, "name", "")) for message in await anext(generator)])
        await generator.aclose()
        assert 7 not in embedded.server._websock_server._broadcast_buffer.generator_cursors
        return found

    found = asyncio.run_coroutine_threadsafe(windows(), embedded.loop).result(20)
    (first,) = [window for window in found if "/part0" in window]
    assert "/part2" not in first
    names = list(dict.fromkeys(name for window in found for name in window if name.startswith("/part")))
    assert names == ["/part0", "/part1", "/part2", "/part3"], "in order"


def test_portions_lose_nothing_and_keep_the_order() -> None:
    sizes = (10, 5_000_000, 10, 3_000_000, 2_000_000, 10)
    sent = [_message(size) for size in sizes]
    cut = list(portions(sent, 4 << 20))
    assert [message for portion in cut for message in portion] == sent
    assert all(len(portion) == 1 or sum(message.props.points.nbytes for message in portion) <= 4 << 20
               for portion in cut)  # fmt: skip


def _message(size_bytes: int) -> Any:
    return SimpleNamespace(props=SimpleNamespace(points=np.zeros(size_bytes, np.uint8)))


def test_the_types_of_properties_are_read_once(embedded: EmbeddedViser) -> None:
    assert vars(assignable_props)["get_type_hints"] is get_type_hints_cached
    assert "get_type_hints(type(self._impl.props))" in inspect.getsource(assignable_props)
    assert get_type_hints_cached(messages.LabelProps)["text"] is str


def test_the_camera_takes_no_arrow_from_a_key_without_a_code() -> None:
    """What the page makes of an arrow reaches the shortcuts, by its key, and not the camera, which goes by the code."""
    source = (Path(viser.__file__).parent / "client" / "src" / "CameraControls.tsx").read_text(encoding="utf-8")
    assert "CAMERA_MOVEMENT_KEYS.has(event.code)" in source
    page = scene_page(client_html(), "Title", "/session", "/in")
    assert b"code: ''" in page.body
