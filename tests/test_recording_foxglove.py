"""Recordings read by others: MCAP's own reader, with the schemas that are in the file."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from test_device_agent import Rig, pose_at
from test_recording_replay import spoiled, wide_picture

from device_agent.recording import foxglove
from device_agent.recording.channels import CHANNELS, GUIDANCE, SETTINGS, Channel, schema_of, table_markdown
from device_agent.recording.json_schema import plain_schema
from device_agent.recording.options import RecordingOptions
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.walk_files import parts_in
from navcore.errors import InputError
from navcore.geometry import Transform, rotation_from_quat_xyzw
from navcore.types import CameraIntrinsics, Frame, Localization, LocalizationQuality, ObstacleScan
from navcore.walk_messages import depths_of, pixels_of
from navcore.wire import ApplySettings, Say, SetDestination

DOCS = Path(__file__).resolve().parent.parent / "docs"


class Recorded:
    """What MCAP's own reader finds in a file."""

    def __init__(self, path: Path) -> None:
        self.protobuf: dict[str, list[Any]] = defaultdict(list)
        self.json: dict[str, list[Any]] = defaultdict(list)
        self.schemas: dict[str, tuple[str, str, bytes]] = {}
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            self.summary = reader.get_summary()
            self.metadata = {each.name: each.metadata for each in reader.iter_metadata()}
            for schema, channel, message in reader.iter_messages():
                assert schema is not None
                self.schemas[channel.topic] = (schema.name, schema.encoding, schema.data)
                if channel.message_encoding == "json":
                    self.json[channel.topic].append(json.loads(message.data))
            for _, channel, _, decoded in reader.iter_decoded_messages(
                topics=[topic for topic in self.schemas if topic not in self.json]
            ):
                self.protobuf[channel.topic].append(decoded)


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recorded, list[Frame], Rig]:
    """A walk with pictures, recorded and read again; the frames of then, and the device."""
    folder = tmp_path_factory.mktemp("pictures")
    recorder = WalkRecorder(RecordingOptions(folder, pictures=True, reserve_bytes=0))
    frames: list[Frame] = []

    def keep(frame: Frame) -> Frame:
        frames.append(spoiled(frame))
        return frames[-1]

    rig = Rig(tap=recorder, spoil=keep, pose=pose_at(2.0, 0.3, 0.4))
    rig.agent.submit(SetDestination("bar"))
    for number in range(30):
        if number == 15:
            rig.agent.submit(ApplySettings(7, {"follower.sub_goal_distance_m": 1.5}))
            rig.agent.submit(Say("Good day."))
        rig.cycles(1)
        recorder.check()
    recorder.close()
    return Recorded(parts_in(folder)[0]), frames, rig


def test_every_channel_of_the_table_is_in_the_file_with_its_schema(walked: tuple[Recorded, list[Frame], Rig]) -> None:
    recorded, _, _ = walked
    assert set(recorded.schemas) == {channel.topic for channel in CHANNELS}
    for channel in CHANNELS:
        assert recorded.schemas[channel.topic] == (channel.schema_name, channel.schema_encoding, schema_of(channel))
    assert recorded.summary is not None
    assert recorded.summary.statistics is not None
    assert recorded.summary.statistics.message_count == sum(
        len(each) for each in (*recorded.protobuf.values(), *recorded.json.values())
    )
    assert recorded.metadata["walk"]["site_id"] == "hall-site"
    for topic in ("/guidance", "/localization", "/sonar", "/stages", "/device"):
        assert len(recorded.json[topic]) == 30
    for topic in ("/camera/colour", "/camera/depth", "/tf", "/walker/pose", "/obstacles", "/replay/cycle"):
        assert len(recorded.protobuf[topic]) == 30


def known_values(value: Any) -> Any:
    """Return a value without what is not known: null has no schema of its own, since viewers have no word for it."""
    if isinstance(value, dict):
        return {key: known_values(each) for key, each in value.items() if each is not None}
    return [known_values(each) for each in value] if isinstance(value, list) else value


def test_our_values_keep_to_their_schemas(walked: tuple[Recorded, list[Frame], Rig]) -> None:
    recorded, _, _ = walked
    for topic, values in recorded.json.items():
        validator = jsonschema.Draft202012Validator(json.loads(recorded.schemas[topic][2]))
        for value in values:
            validator.validate(known_values(value))


def assert_lichtblick_reads(schema: dict[str, Any], where: str) -> None:
    """Lichtblick shows nothing of a channel whose schema has more than this in it."""
    assert schema["type"] == "object", where
    assert "oneOf" not in schema
    for name, each in schema["properties"].items():
        inner = each["items"] if each["type"] == "array" else each
        assert inner["type"] in ("boolean", "string", "number", "integer", "object"), f"{where}.{name}"
        assert "contentEncoding" not in inner
        if inner["type"] == "object":
            assert_lichtblick_reads(inner, f"{where}.{name}")


@pytest.mark.parametrize("channel", [each for each in CHANNELS if not each.is_protobuf], ids=lambda each: each.topic)
def test_every_viewer_understands_the_schemas(channel: Channel) -> None:
    schema = json.loads(schema_of(channel))
    assert_lichtblick_reads(schema, channel.topic)
    assert "$ref" not in json.dumps(schema)


def test_the_decision_trace_can_be_plotted() -> None:
    trace = json.loads(schema_of(GUIDANCE))["properties"]["trace"]["properties"]
    assert {"deviation_m", "expected", "sonar_m", "candidates", "sub_goal", "rule"} <= set(trace)
    assert trace["candidates"]["items"]["properties"]["clearance_m"]["type"] == "number"
    settings = json.loads(schema_of(SETTINGS))["properties"]["settings"]["properties"]
    assert settings["gate"]["properties"]["clearance_m"]["type"] == "number"


@pytest.mark.parametrize(
    "schema",
    [{"type": "string"}, {"anyOf": [{"type": "object", "properties": {}}, {"type": "string"}]}, {"enum": [1, "a"]}, {}],
)
def test_what_is_no_object_is_no_message(schema: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="only objects"):
        plain_schema(schema)


def test_pictures_and_depth_are_what_the_loop_saw(walked: tuple[Recorded, list[Frame], Rig]) -> None:
    recorded, frames, _ = walked
    encodings = set()
    for number, frame in enumerate(frames):
        colour = recorded.protobuf["/camera/colour"][number]
        assert (colour.encoding, colour.frame_id, colour.step) == ("rgb8", "camera", 3 * colour.width)
        shown = np.frombuffer(colour.data, np.uint8).reshape(colour.height, colour.width, 3)
        assert np.array_equal(shown, frame.colour_rgb)
        depth = recorded.protobuf["/camera/depth"][number]
        encodings.add(depth.encoding)
        values = np.frombuffer(depth.data, {"16UC1": "<u2", "32FC1": "<f4"}[depth.encoding])
        values = values.reshape(depth.height, depth.width)
        if depth.encoding == "16UC1":
            metres = np.where(values == 0, np.nan, values / 1000.0)
            np.testing.assert_allclose(metres, frame.depth_m, rtol=1e-6)
        else:
            assert np.array_equal(values, frame.depth_m, equal_nan=True)
        assert frame.fisheye is not None
        wide = recorded.protobuf["/fisheye/grey"][number]
        assert (wide.encoding, wide.frame_id) == ("mono8", "fisheye")
        assert np.array_equal(np.frombuffer(wide.data, np.uint8).reshape(wide.height, -1), frame.fisheye.grey)
    assert encodings == {"16UC1", "32FC1"}


def test_the_transforms_lead_from_the_map_to_the_cameras(walked: tuple[Recorded, list[Frame], Rig]) -> None:
    recorded, frames, rig = walked
    assert rig.pose is not None
    tree = {each.child_frame_id: each for each in recorded.protobuf["/tf"][-1].transforms}
    assert {child: each.parent_frame_id for child, each in tree.items()} == {
        "walker": "map", "camera": "walker", "fisheye": "camera"
    }  # fmt: skip
    walker, camera, wide = (_transform(tree[name]) for name in ("walker", "camera", "fisheye"))
    np.testing.assert_allclose((walker @ camera).matrix, rig.pose.matrix, atol=1e-9)
    np.testing.assert_allclose(walker.translation, [2.0, 0.3, 0.0], atol=1e-9)
    assert frames[-1].fisheye is not None
    mounted = frames[-1].fisheye.camera.fisheye_from_camera
    np.testing.assert_allclose(wide.inverse().matrix, mounted.matrix, atol=1e-9)
    pose = recorded.protobuf["/walker/pose"][-1]
    assert pose.frame_id == "map"
    at = pose.pose.position
    np.testing.assert_allclose([at.x, at.y, at.z], rig.pose.translation)
    stamp = pose.timestamp
    assert stamp.seconds + stamp.nanos / 1e9 == pytest.approx(frames[-1].stamp_s, abs=1e-8)


def _transform(message: Any) -> Transform:
    q, t = message.rotation, message.translation
    return Transform.from_rotation_translation(
        rotation_from_quat_xyzw(np.array([q.x, q.y, q.z, q.w])), np.array([t.x, t.y, t.z])
    )


def test_road_route_and_advice_are_shown_in_the_map(walked: tuple[Recorded, list[Frame], Rig]) -> None:
    recorded, _, rig = walked
    (road,) = recorded.protobuf["/road"]
    assert road.entities[0].frame_id == "map"
    assert [text.text for text in road.entities[0].texts] == ["Hall", "Bar", "Attic"]
    empty, way = recorded.protobuf["/route"]
    assert empty.deletions
    assert rig.agent.state.route is not None
    points = [(point.x, point.y) for point in way.entities[0].lines[0].points]
    np.testing.assert_allclose(points, rig.agent.state.route.points_m)
    assert recorded.protobuf["/guidance/scene"][-1].entities[0].arrows
    scan = recorded.protobuf["/obstacles"][-1]
    assert scan.frame_id == "walker"
    assert len(scan.ranges) > 20
    assert -math.pi < scan.start_angle < 0.0 < scan.end_angle < math.pi


def test_settings_orders_cues_and_log_tell_what_happened(walked: tuple[Recorded, list[Frame], Rig]) -> None:
    recorded, _, rig = walked
    assert [each["revision"] for each in recorded.json["/settings"]] == [0, 7]
    assert recorded.json["/settings"][1]["settings"]["follower"]["sub_goal_distance_m"] == 1.5
    assert [each["kind"] for each in recorded.json["/orders"]] == ["SetDestination", "ApplySettings", "Say"]
    heard = [each["cue"]["text"] for each in recorded.json["/cues"] if each["speaker"] == "loop"]
    assert heard == [cue.text for cue in rig.output.cues]
    said = [each.message for each in recorded.protobuf["/log"] if each.name == "said by loop"]
    assert said == [text for text in heard if text]
    assert any("Leading to Bar" in each.message for each in recorded.protobuf["/log"])
    traces = [each["trace"] for each in recorded.json["/guidance"]]
    assert traces[-1]["rule"]
    assert traces[-1]["candidates"]


def test_cameras_are_described_by_their_lenses(walked: tuple[Recorded, list[Frame], Rig]) -> None:
    recorded, _, _ = walked
    (pinhole,) = recorded.protobuf["/camera/calibration"]
    assert (pinhole.width, pinhole.distortion_model, list(pinhole.K[:3])) == (160, "plumb_bob", [116.0, 0.0, 79.5])
    assert len(pinhole.P) == 12
    (wide,) = recorded.protobuf["/fisheye/calibration"]
    assert (wide.distortion_model, list(wide.D)) == ("kannala_brandt", [0.01, 0.0, 0.0, 0.0])
    distorted = CameraIntrinsics(4, 3, 5.0, 5.0, 2.0, 1.5, (0.1, 0.2, 0.3, 0.4, 0.5))
    assert list(foxglove.calibration(0.0, distorted).D) == list(distorted.distortion)


# ----------------------------------------------------------------------------------------------------- laws
@given(st.integers(0, 10**6), st.sampled_from([1000.0, 5000.0, 7.3]), st.booleans())
@settings(deadline=None, max_examples=40)
def test_depth_comes_back_bit_for_bit_whatever_its_unit(seed: int, factor: float, holes: bool) -> None:
    rng = np.random.default_rng(seed)
    depth_m = (np.round(rng.uniform(0.2, 9.0, (7, 9)) * factor) / factor).astype(np.float32)
    if holes:
        depth_m[rng.random(depth_m.shape) < 0.3] = np.nan
    again = depths_of(foxglove.depth_image(1.0, depth_m))
    assert again.dtype == np.float32
    assert np.array_equal(again, depth_m, equal_nan=True)


def test_a_millimetre_camera_is_kept_in_millimetres() -> None:
    units = np.arange(12, dtype=np.uint16).reshape(3, 4) * 700
    depth_m = np.where(units == 0, np.nan, units.astype(np.float32) * np.float32(0.001)).astype(np.float32)
    image = foxglove.depth_image(1.0, depth_m)
    assert (image.encoding, image.step) == ("16UC1", 8)
    for odd in (np.float32(np.inf), np.float32(-1.0), np.float32(0.0), np.float32(70.0)):
        strange = depth_m.copy()
        strange[1, 1] = odd
        assert np.array_equal(depths_of(foxglove.depth_image(1.0, strange)), strange, equal_nan=True)


def test_a_scan_with_gaps_keeps_its_bearings() -> None:
    bearing_rad = np.radians([-30.0, -29.0, -28.0, 5.0, 6.0])
    scan = ObstacleScan(bearing_rad, np.array([1.0, np.inf, np.nan, 2.0, 3.0]), np.zeros(5, np.int8), (), 1.0)
    shown = foxglove.obstacles(0.0, scan)
    assert shown is not None
    angles = np.linspace(shown.start_angle, shown.end_angle, len(shown.ranges))
    known = {round(math.degrees(angle)): value for angle, value in zip(angles, shown.ranges, strict=True)}
    assert {angle: known[angle] for angle in (-30, -29, 5, 6)} == {-30: 1.0, -29: math.inf, 5: 2.0, 6: 3.0}
    assert all(math.isnan(known[angle]) for angle in range(-28, 5))
    assert foxglove.obstacles(0.0, replace(scan, bearing_rad=np.zeros(1))) is None


def test_a_lost_pose_has_no_place() -> None:
    lost = Localization(1.0, LocalizationQuality.LOST, None)
    assert foxglove.transforms(lost, None) is None
    assert foxglove.pose(lost) is None


@pytest.mark.parametrize("stamp_s", [math.nan, math.inf, -5.0, 0.0, 1.9999999999])
def test_every_stamp_is_a_time(stamp_s: float) -> None:
    stamp = foxglove.timestamp(stamp_s)
    assert 0 <= stamp.nanos < foxglove.NS_PER_S
    assert stamp.seconds >= 0


def test_damaged_pictures_are_refused_in_words() -> None:
    good = foxglove.picture(0.0, "camera", wide_picture(0.0).grey)
    good.data = good.data[:20]
    with pytest.raises(InputError, match="damaged"):
        pixels_of(good)
    good.data = b""
    with pytest.raises(InputError, match="damaged"):
        pixels_of(good)
    depth = foxglove.depth_image(0.0, np.ones((3, 4), np.float32))
    for change in ({"width": 5}, {"encoding": "mono8"}, {"data": b"123"}, {"height": 2**31}):
        spoilt = type(depth)()
        spoilt.CopyFrom(depth)
        for name, value in change.items():
            setattr(spoilt, name, value)
        with pytest.raises(InputError, match="damaged"):
            depths_of(spoilt)


def test_the_page_of_the_docs_has_the_table_of_the_code() -> None:
    assert table_markdown() in (DOCS / "recording.md").read_text(encoding="utf-8")
