"""What a browser may send to the scene: message types by role, sizes, and the rate.

Viser trusts its clients: it looks at no role, and a GuiUpdate may assign any attribute of a widget. So every message
is read here first, before viser sees it. What a role may not send is dropped; what cannot be read closes the socket,
and so does a flood that goes on.
"""

from __future__ import annotations

import enum
from collections.abc import Collection
from typing import Any

import msgspec

from console import roles

MAX_MESSAGE_BYTES = 64 << 10
MAX_MESSAGES_PER_S = 300.0
BURST_COUNT = 900.0
_MAX_TEXT_LENGTH = 4000

LOOKING = frozenset(
    {"ViewerCameraMessage", "GuiUpdateMessage", "CommandTriggerMessage", "SceneNodeClickMessage",
     "ScenePointerMessage"}
)  # fmt: skip
"""Messages that everybody may send: moving the camera, widgets and shortcuts of their own session, clicks."""
EDITING = frozenset({"SceneNodeDragMessage"})
"""Messages of somebody who may change the PoI-graph."""


class Verdict(enum.Enum):
    """What becomes of a message."""

    PASS = "pass"  # noqa: S105 - a verdict, no password
    DROP = "drop"
    CLOSE = "close"


class InboundGuard:
    """Judges the messages of one connection. Not thread-safe: one connection is read by one task."""

    def __init__(self, visitor: roles.SignedIn) -> None:
        self._permitted = LOOKING | EDITING if visitor.role in roles.EDITING else LOOKING
        self._tokens_count = BURST_COUNT
        self._last_s: float | None = None

    def judge(self, raw: bytes, now_s: float) -> Verdict:
        """Judge one message (msgpack, as the viser client sends it); ``now_s`` is a monotonic clock."""
        if len(raw) > MAX_MESSAGE_BYTES:
            return Verdict.CLOSE
        if not self._within_rate(now_s):
            return Verdict.DROP if self._tokens_count > -BURST_COUNT else Verdict.CLOSE
        try:
            message = msgspec.msgpack.decode(raw)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            return Verdict.CLOSE
        if not isinstance(message, dict) or not isinstance(message.get("type"), str):
            return Verdict.CLOSE
        return Verdict.PASS if _is_permitted(message, self._permitted) else Verdict.DROP

    def _within_rate(self, now_s: float) -> bool:
        elapsed_s = 0.0 if self._last_s is None else max(0.0, now_s - self._last_s)
        self._last_s = now_s
        self._tokens_count = min(BURST_COUNT, self._tokens_count + elapsed_s * MAX_MESSAGES_PER_S)
        self._tokens_count -= 1.0
        return self._tokens_count >= 0.0


def _is_permitted(message: dict[str, Any], permitted: Collection[str]) -> bool:
    if message["type"] not in permitted:
        return False
    if message["type"] != "GuiUpdateMessage":
        return True
    updates = message.get("updates")
    # Any other key would assign an attribute of the widget's state in the server: "removed", "update_cb", …
    return isinstance(updates, dict) and set(updates) == {"value"} and _is_plain(updates["value"])


def _is_plain(value: object) -> bool:
    return isinstance(value, (bool, int, float)) or (isinstance(value, str) and len(value) <= _MAX_TEXT_LENGTH)
