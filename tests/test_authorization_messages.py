"""Every message of viser, and every message between device and console, × everybody who may send it.

As authorization_statement does for routes, the tables say once more what was decided: a viser with another message, or
an order that is added, fails here until somebody has decided who may send it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import viser._messages as viser_messages
from authorization_room import DEVICE_ID, ROLES, Room, authorization_room
from console_room import DEFAULTS
from viewer_client import FakeBrowser
from viewer_fixtures import connect_device, scene_over, services_of_crossing

from console.edits import AddPoi
from console.roles import Role, SignedIn
from console.services import Services
from console.viewer.guard import InboundGuard, Verdict
from console.viewer.scene import Scene
from navcore.errors import WireError
from navcore.planning.edits import validate
from navcore.wire import MESSAGES, SettingsRunning, decode_from_device
from navcore.wire_row import Direction

MAY_SEND = {
    "ViewerCameraMessage": ROLES, "GuiUpdateMessage": ROLES, "CommandTriggerMessage": ROLES,
    "SceneNodeClickMessage": ROLES, "ScenePointerMessage": ROLES, "SceneNodeDragMessage": ("editor", "admin"),
}  # fmt: skip
NOBODY_MAY_SEND = """
    AmbientLightMessage ArrowMessage BackgroundImageMessage BatchedAxesMessage BatchedGlbMessage BatchedMeshesMessage
    BoxMessage CameraFrustumMessage CatmullRomSplineMessage CommandUpdateMessage CubicBezierSplineMessage
    CylinderMessage DirectionalLightMessage EnableLightsMessage EnvironmentMapMessage FileTransferPart
    FileTransferPartAck FileTransferStartDownload FileTransferStartUpload FogMessage FrameMessage
    GaussianSplatsMessage GetRenderRequestMessage GetRenderResponseMessage GlbMessage GridMessage Gui3DMessage
    GuiButtonGroupMessage GuiButtonHoldMessage GuiButtonMessage GuiCheckboxMessage GuiCloseModalMessage
    GuiDividerMessage GuiDropdownMessage GuiFolderMessage GuiFormDirtyMessage GuiFormMessage GuiFormSubmitMessage
    GuiHtmlMessage GuiImageMessage GuiMarkdownMessage GuiModalMessage GuiMultiSliderMessage GuiNumberMessage
    GuiPanelMessage GuiPanelRemoveMessage GuiPlotlyMessage GuiProgressBarMessage GuiRemoveMessage GuiRgbMessage
    GuiRgbaMessage GuiSetPanelCollapsedMessage GuiSetPanelHeightMessage GuiSetPanelPositionMessage
    GuiSetPanelWidthMessage GuiSliderMessage GuiTabGroupMessage GuiTextMessage GuiUploadButtonMessage GuiUplotMessage
    GuiVector2Message GuiVector3Message HemisphereLightMessage IcosphereMessage ImageMessage LabelMessage
    LineSegmentsMessage LocalStorageClearMessage LocalStorageGetItemRequestMessage LocalStorageGetItemResponseMessage
    LocalStorageRemoveItemMessage LocalStorageSetItemMessage MeshMessage NotificationShowMessage
    NotificationUpdateMessage PointCloudMessage PointLightMessage RectAreaLightMessage RegisterCommandMessage
    RemoveCommandMessage RemoveNotificationMessage RemoveSceneNodeMessage ReplayDoneMessage ResetGuiMessage
    RunJavascriptMessage SceneNodeUpdateMessage ScenePointerEnableMessage SetBoneOrientationMessage
    SetBonePositionMessage SetCameraFarMessage SetCameraFovMessage SetCameraLookAtMessage
    SetCameraMaxOrbitDistanceMessage SetCameraMinOrbitDistanceMessage SetCameraNearMessage SetCameraPositionMessage
    SetCameraUpDirectionMessage SetGuiPanelLabelMessage SetOrientationMessage SetPositionMessage
    SetSceneNodeClickBindingsMessage SetSceneNodeDragBindingsMessage SetSceneNodeVisibilityMessage ShareUrlDisconnect
    ShareUrlRequest ShareUrlUpdated SkinnedMeshMessage SpotLightMessage ThemeConfigurationMessage
    TransformControlsDragEndMessage TransformControlsDragStartMessage TransformControlsMessage
    TransformControlsUpdateMessage
    """
NEVER_SENT_TO_A_BROWSER = {
    "RunJavascriptMessage", "ShareUrlUpdated", "FileTransferStartDownload", "GuiMarkdownMessage", "GuiPlotlyMessage",
    "LocalStorageGetItemRequestMessage", "LocalStorageSetItemMessage", "GetRenderRequestMessage",
}  # fmt: skip
"""Of these a scene could run code, read what the browser keeps, or put text through Markdown."""

LEAD, WATCH, MAP, TUNE = ("editor", "admin"), ROLES, ("editor", "technician", "admin"), ("technician", "admin")
ORDERS: dict[str, tuple[tuple[str, ...], str, str, Any]] = {
    "SetDestination": (LEAD, "POST", "destination", {"poi_id": "bar"}),
    "ClearDestination": (LEAD, "POST", "clear", None),
    "Pause": (LEAD, "POST", "pause", None),
    "Resume": (LEAD, "POST", "resume", None),
    "Repeat": (WATCH, "POST", "repeat", None),
    "Say": (WATCH, "POST", "say", {"text": "Hello."}),
    "AskColour": (WATCH, "POST", "colour", {"why": "which door"}),
    "BeginMapWalk": (MAP, "POST", "map-walk/begin", None),
    "EndMapWalk": (MAP, "POST", "map-walk/end", None),
    "ApplySettings": (TUNE, "PATCH", "settings", {"changes": {"follower.lead_s": 0.8}, "confirmed": True}),
    "KeepSettings": (TUNE, "POST", "settings/keep", {"revision": 1}),
}
"""Who may cause it, and by which request; all else that the console sends a device no person causes."""
OF_ITSELF = {"Welcome", "Ping", "EventConfirmed", "Watchers", "Accesses", "MapAvailable", "PublishGraph"}


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Room]:
    with authorization_room(tmp_path) as room:
        room.services.hub.receive(DEVICE_ID, SettingsRunning(0, DEFAULTS))
        yield room


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Services, Scene]]:
    with services_of_crossing(tmp_path_factory.mktemp("scene"), 200) as services, scene_over(services) as scene:
        yield services, scene


# ---------------------------------------------------------------------------------------------------------- viser
def test_of_every_message_of_viser_it_was_decided_who_may_send_it() -> None:
    there_are = set(viser_messages.Message._subclass_from_type_string())
    decided = [*MAY_SEND, *NOBODY_MAY_SEND.split()]
    assert there_are == set(decided)
    assert len(decided) == len(set(decided))


@pytest.mark.parametrize("role", ROLES)
def test_each_role_may_send_exactly_what_the_table_says(role: Role) -> None:
    for name in (
        *MAY_SEND,
        *NOBODY_MAY_SEND.split(),
        "NewMessage",
        "",
        "viewercameramessage",
        "ViewerCameraMessage\x00",
    ):
        guard = InboundGuard(SignedIn("s", 1, "Ada", role))
        message = {"type": name, "uuid": "u", "updates": {"value": 1}}
        passes = guard.judge(msgspec.msgpack.encode(message), 0.0) is Verdict.PASS
        assert passes is (role in MAY_SEND.get(name, ())), f"{role} sends {name!r}"


@pytest.mark.parametrize("role", ROLES)
def test_no_browser_is_sent_what_could_run_code_or_has_more_than_its_role(
    role: Role, scene: tuple[Services, Scene]
) -> None:
    browser = FakeBrowser(scene[1], role, client_id=200 + ROLES.index(role))
    try:
        browser.tick()
        shared = scene[1].embedded.server._websock_server._broadcast_buffer.message_from_id.values()
        names = {type(message).__name__ for message in (*browser.outbox, *shared)}
        assert len(names) > 10
        assert not names & NEVER_SENT_TO_A_BROWSER
        labels = {getattr(getattr(message, "props", None), "label", "") for message in browser.outbox}
        assert ("Tag a place (2)" in labels) is (role in LEAD)
    finally:
        browser.disconnect()


def test_no_window_drives_the_widgets_and_shortcuts_of_another(scene: tuple[Services, Scene]) -> None:
    services, shown = scene
    editor = FakeBrowser(shown, "editor", "Eve", client_id=300)
    viewer = FakeBrowser(shown, "viewer", "Vera", client_id=301)
    try:
        version = services.model.graph.version
        gui = editor.view.client.gui
        widgets = dict(gui._gui_input_handle_from_uuid)
        before = {key: getattr(handle, "value", None) for key, handle in widgets.items()}
        for command in tuple(gui._command_handle_from_uuid):
            viewer.send(viser_messages.CommandTriggerMessage(command))
        for uuid in widgets:
            forged = viser_messages.GuiUpdateMessage(uuid, {"value": True})
            object.__setattr__(forged, "owner", str(editor.client_id))
            viewer.send(forged)
        viewer.tick()
        editor.tick()
        assert {key: getattr(handle, "value", None) for key, handle in widgets.items()} == before
        assert services.model.graph.version == version
        assert editor.view.editor.selected is None
    finally:
        viewer.disconnect()
        editor.disconnect()


# --------------------------------------------------------------------------------------------- device and console
def test_of_every_message_to_a_device_it_was_decided_who_may_cause_it() -> None:
    down = {row.name for row in MESSAGES.values() if row.direction is Direction.DOWN}
    assert down == set(ORDERS) | OF_ITSELF


@pytest.mark.parametrize("caller", ["nobody", *ROLES, "device"])
def test_an_order_reaches_a_device_from_whoever_may_give_it_and_from_nobody_else(room: Room, caller: str) -> None:
    for name, (who, method, path, body) in ORDERS.items():
        if name == "KeepSettings" and caller in who:
            values = room.services.tuning.running_values(room.services.hub.device(DEVICE_ID))
            running = SettingsRunning(1, values | {"follower.lead_s": 0.8}, revert_at_s=room.clock.s + 60.0)
            room.services.settings.note_running(DEVICE_ID, running)
            room.services.hub.receive(DEVICE_ID, running)
        room.outlet.sent.clear()
        answer = room.call(room.callers[caller], method, f"/api/devices/{DEVICE_ID}/{path}", body)
        reached = [type(message).__name__ for message in room.outlet.sent if type(message).__name__ in ORDERS]
        assert reached == ([name] if caller in who else []), f"{caller} {name}: {answer.status} {answer.body!r}"
        commands = room.services.hub.device(DEVICE_ID).commands
        assert all(command.who == caller for command in commands), "nobody orders in another's name"


def test_a_device_cannot_say_what_a_console_says() -> None:
    for kind, row in MESSAGES.items():
        tag = str(kind.__struct_config__.tag)
        raw = msgspec.msgpack.encode({"type": tag, "text": "Hello.", "poi_id": "bar", "names": ["Eve"], "revision": 1})
        with pytest.raises(WireError) as refused:
            decode_from_device(raw)
        if row.direction is Direction.DOWN:
            assert f"type cannot be '{tag}'" in str(refused.value), "not even its name is known"


def test_markup_in_names_stays_text_in_every_widget_of_the_scene(scene: tuple[Services, Scene]) -> None:
    services, shown = scene
    markup = "<img src=x onerror=alert(1)>"
    poi = services.model.apply(AddPoi(markup, "room", 5.0, 0.0), markup)
    assert poi is not None
    person = SignedIn("elsewhere", 9, markup, "editor")
    services.presence.say(person, "w", "tables", "editing", ("poi", "hall"))
    browser = FakeBrowser(shown, "editor", "Eve", client_id=400)
    try:
        poi_id = next(key for key, each in services.model.graph.pois.items() if each.name == markup)
        for other in ("hall", poi_id):
            browser.click_poi(other)
            browser.tick()
        contents = [content for message in browser.outbox if (content := _html_of(message))]
        assert any("&lt;img" in content for content in contents), "somebody of that name is here"
        assert not [content for content in contents if "<img" in content]
    finally:
        browser.disconnect()


HOSTILE: tuple[Any, ...] = (
    True, False, float("nan"), float("inf"), -1e9, 1e300, 10**18, "", "<b>", "x" * 4000, "no such choice"
)  # fmt: skip


@pytest.mark.parametrize("role", ["viewer", "technician", "editor"])
def test_no_value_of_any_widget_and_no_shortcut_does_more_than_the_role_may(role: Role, tmp_path: Path) -> None:
    """Disabled and hidden widgets as well, with values that no hand could choose: viser holds none of that back."""
    with services_of_crossing(tmp_path, 200) as services, scene_over(services) as shown:
        outlet = connect_device(services)
        services.hub.receive(DEVICE_ID, SettingsRunning(0, DEFAULTS))
        before = services.model.graph
        browser = FakeBrowser(shown, role, "Mallory", client_id=500)
        try:
            browser.tick()
            services.watching.look()
            browser.tick()
            _use_everything(browser)
            if "hall" in services.model.graph.pois:
                browser.click_poi("hall")
            _use_everything(browser)
            for edge_id in tuple(services.model.graph.edges)[:1]:
                browser.click_edge(edge_id)
            _use_everything(browser)
        finally:
            browser.disconnect()
        caused = {type(message).__name__ for message in outlet.sent} & set(ORDERS)
        assert caused <= {name for name, (who, *_) in ORDERS.items() if role in who}
        assert caused or role not in LEAD, "the buttons that lead the walker were pressed"
        validate(services.model.graph)
        if role not in LEAD:
            assert (services.model.graph, services.model.published.version) == (before, before.version)


def _use_everything(browser: FakeBrowser) -> None:
    gui = browser.view.client.gui
    for uuid, handle in tuple(gui._gui_input_handle_from_uuid.items()):
        for value in (*HOSTILE, *getattr(handle, "options", ())):
            with contextlib.suppress(ValueError, TypeError, OverflowError, AssertionError):
                browser.send(viser_messages.GuiUpdateMessage(uuid, {"value": value}))
    for uuid in tuple(gui._command_handle_from_uuid):
        browser.send(viser_messages.CommandTriggerMessage(uuid))
    browser.tick()


def _html_of(message: Any) -> str:
    updates = getattr(message, "updates", None)
    if isinstance(message, viser_messages.GuiUpdateMessage) and isinstance(updates, dict):
        return str(updates.get("content", "") or updates.get("_markdown", ""))
    return str(getattr(message.props, "content", "")) if isinstance(message, viser_messages.GuiHtmlMessage) else ""
