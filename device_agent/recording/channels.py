"""The channels of a recording, in one table: topic, schema, and what is in it. The page of the docs is made from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import msgspec
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message
from google.protobuf.wrappers_pb2 import BytesValue

from device_agent.recording.json_schema import plain_schema
from device_agent.recording.messages import SETTINGS_SCHEMA, PoseMessage, StageTimesMessage
from navcore.types import Guidance, SonarReading
from navcore.walk_messages import (
    CUES_TOPIC,
    DEPTH_TOPIC,
    DEVICE_TOPIC,
    LOG_TOPIC,
    ORDERS_TOPIC,
    ROAD_TOPIC,
    ROUTE_TOPIC,
    SETTINGS_TOPIC,
    WAY_TOPIC,
    HeardCue,
    OrderMessage,
    SettingsMessage,
)
from navcore.wire import RouteChanged, WalkerState


@dataclass(frozen=True, slots=True)
class Channel:
    """One line of the table."""

    topic: str
    kind: type[Any]
    """A Foxglove message (protobuf), or a value of ours (JSON)."""
    meaning: str
    when: str
    pictures: bool = False
    """Only in recordings with pictures."""

    @property
    def is_protobuf(self) -> bool:
        """Whether its messages are protobuf; else they are JSON."""
        return issubclass(self.kind, Message)

    @property
    def encoding(self) -> Literal["protobuf", "json"]:
        """The encoding of its messages, as MCAP calls it."""
        return "protobuf" if self.is_protobuf else "json"

    @property
    def schema_name(self) -> str:
        """The name of its schema."""
        return str(self.kind.DESCRIPTOR.full_name) if self.is_protobuf else f"vbr.{self.kind.__name__}"

    @property
    def schema_encoding(self) -> Literal["protobuf", "jsonschema"]:
        """The encoding of its schema, as MCAP calls it."""
        return "protobuf" if self.is_protobuf else "jsonschema"


COLOUR = Channel(
    "/camera/colour", RawImage, "What the camera saw (rgb8), as it was: nothing is lost.", "each frame", True
)
DEPTH = Channel(
    DEPTH_TOPIC, RawImage,
    "Depth: whole millimetres (16UC1) where the frame's depths are that, metres (32FC1) where they are not.",
    "each frame", True,
)  # fmt: skip
FISHEYE = Channel("/fisheye/grey", RawImage, "What the fisheye camera saw (mono8).", "each frame with one", True)
CALIBRATION = Channel("/camera/calibration", CameraCalibration, "The camera's geometry.", "at the beginning")
FISHEYE_CALIBRATION = Channel(
    "/fisheye/calibration", CameraCalibration, "The fisheye camera's lens.", "with its first picture", True
)
TRANSFORMS = Channel(
    "/tf", FrameTransforms, "`map` → `walker` (on the floor, heading ahead) → `camera` (z ahead) → `fisheye`.",
    "each frame with a pose",
)  # fmt: skip
POSE = Channel("/walker/pose", PoseInFrame, "Where the camera is in the map.", "each frame with a pose")
OBSTACLES = Channel("/obstacles", LaserScan, "The nearest obstacle or drop in each bearing.", "each frame")
ROAD = Channel(ROAD_TOPIC, SceneUpdate, "The virtual blind road and its places.", "at the beginning, and on change")
ROUTE = Channel(ROUTE_TOPIC, SceneUpdate, "The way that is walked.", "at the beginning, and on change")
WAY = Channel(
    WAY_TOPIC, RouteChanged, "The way that is walked, its destination and the places that it passes.",
    "at the beginning, and on change",
)  # fmt: skip
ADVICE = Channel("/guidance/scene", SceneUpdate, "Sub-goal, and where guidance leads.", "each cycle")
LOG = Channel(LOG_TOPIC, Log, "Events, and every word that the walker heard.", "as they happen")
GUIDANCE = Channel("/guidance", Guidance, "What guidance decided, with the whole decision trace.", "each cycle")
LOCALIZATION = Channel("/localization", PoseMessage, "Pose, quality and standard deviation.", "each frame")
SONAR = Channel("/sonar", SonarReading, "The rangefinder's reading.", "each frame")
CUES = Channel(CUES_TOPIC, HeardCue, "What the walker heard, words and tones, and who said it.", "as they are played")
SETTINGS = Channel(
    SETTINGS_TOPIC, SettingsMessage, "The settings, and their revision.", "at the beginning, and on change"
)
DEVICE = Channel(DEVICE_TOPIC, WalkerState, "What the console is told of the device.", "each cycle")
ORDERS = Channel(ORDERS_TOPIC, OrderMessage, "What somebody asked of the device.", "as they are carried out")
STAGES = Channel("/stages", StageTimesMessage, "How long each stage took.", "each cycle")
REPLAY = Channel("/replay/cycle", BytesValue, "All that a replay needs, to the last bit (msgpack).", "each cycle")

CHANNELS: tuple[Channel, ...] = (
    COLOUR, DEPTH, FISHEYE, CALIBRATION, FISHEYE_CALIBRATION, TRANSFORMS, POSE, OBSTACLES, ROAD, ROUTE, WAY, ADVICE,
    LOG,
    GUIDANCE, LOCALIZATION, SONAR, CUES, SETTINGS, DEVICE, ORDERS, STAGES, REPLAY,
)  # fmt: skip
"""All of them."""


@cache
def schema_of(channel: Channel) -> bytes:
    """Return the channel's schema, as MCAP's registry wants it."""
    if channel.is_protobuf:
        return _descriptors(channel.kind)
    schema = SETTINGS_SCHEMA if channel.kind is SettingsMessage else msgspec.json.schema(channel.kind)
    return msgspec.json.encode(plain_schema(schema))


def encoder_of(channel: Channel) -> Callable[[Any], bytes]:
    """Return what makes bytes of a channel's messages; numbers that are none become null in JSON."""
    return _serialized if channel.is_protobuf else msgspec.json.encode


def table_markdown() -> str:
    """Return the table as the docs have it."""
    lines = ["| topic | schema | what is in it | when |", "| --- | --- | --- | --- |"]
    for each in CHANNELS:
        when = each.when + (" (with pictures)" if each.pictures else "")
        lines.append(f"| `{each.topic}` | `{each.schema_name}` | {each.meaning} | {when} |")
    return "\n".join(lines) + "\n"


def _serialized(message: Message) -> bytes:
    return message.SerializeToString()


def _descriptors(kind: type[Message]) -> bytes:
    """Return a FileDescriptorSet of the file that declares a message, and of all that it imports, imports first."""
    # protobuf has several implementations of its descriptors, and one name for all of them only in its stubs.
    files: dict[str, Any] = {}

    def collect(file: Any) -> None:
        for imported in file.dependencies:
            if imported.name not in files:
                collect(imported)
        files[file.name] = file

    collect(kind.DESCRIPTOR.file)
    whole = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(whole.file.add())
    return whole.SerializeToString()
