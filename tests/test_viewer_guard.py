"""What of a browser's messages reaches viser; which types a role may send, says test_authorization_messages."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from console.roles import Role, SignedIn
from console.viewer.guard import BURST_COUNT, MAX_MESSAGE_BYTES, MAX_MESSAGES_PER_S, InboundGuard, Verdict


def judge(role: Role, message: Any) -> Verdict:
    return InboundGuard(SignedIn("s", 1, "Ada", role)).judge(msgspec.msgpack.encode(message), 0.0)


@pytest.mark.parametrize(
    "updates",
    [
        {"removed": True}, {"update_cb": []}, {"value": 1, "removed": True}, {}, None, [["value", 1]],
        {"value": {"a": 1}}, {"value": [1, 2]}, {"value": "x" * 5000},
    ],
)  # fmt: skip
def test_a_widget_takes_a_plain_value_and_nothing_else(updates: Any) -> None:
    assert judge("admin", {"type": "GuiUpdateMessage", "uuid": "u", "updates": updates}) is Verdict.DROP


@pytest.mark.parametrize(
    "raw",
    [b"", b"\xc1", b"\x81\xa4type", msgspec.msgpack.encode([1]), msgspec.msgpack.encode({"type": 3}),
     b"\x81\xa4type\xa2\xff\xff", b"\x91" * 5000],
)  # fmt: skip
def test_what_cannot_be_read_closes_the_socket(raw: bytes) -> None:
    assert InboundGuard(SignedIn("s", 1, "Ada", "admin")).judge(raw, 0.0) is Verdict.CLOSE


def test_a_message_that_is_too_large_closes_the_socket() -> None:
    raw = msgspec.msgpack.encode({"type": "ViewerCameraMessage", "x": "y" * MAX_MESSAGE_BYTES})
    assert InboundGuard(SignedIn("s", 1, "Ada", "admin")).judge(raw, 0.0) is Verdict.CLOSE


def test_a_flood_is_dropped_and_a_steady_stream_passes() -> None:
    raw = msgspec.msgpack.encode({"type": "ViewerCameraMessage"})
    flooded = InboundGuard(SignedIn("s", 1, "Ada", "admin"))
    verdicts = [flooded.judge(raw, 1.0) for _ in range(int(BURST_COUNT) + 50)]
    assert verdicts.count(Verdict.DROP) == 50
    going_on = [flooded.judge(raw, 1.0) for _ in range(int(BURST_COUNT))]
    assert going_on[-1] is Verdict.CLOSE, "whoever goes on costs everybody's time"
    assert flooded.judge(raw, 100.0) is Verdict.PASS
    steady = InboundGuard(SignedIn("s", 1, "Ada", "admin"))
    step_s = 1.5 / MAX_MESSAGES_PER_S
    assert {steady.judge(raw, i * step_s) for i in range(5000)} == {Verdict.PASS}
