"""Small valid files of every kind that the product reads, made by the product's own writers."""

from __future__ import annotations

import hashlib
import io
import json
import sqlite3
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import msgspec
import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.wrappers_pb2 import BytesValue
from mcap.records import Attachment
from mcap.writer import CompressionType, Writer

from console.alerts.incidents import Cause, Incident, Versions
from console.map_geometry.occupancy import Occupancy
from console.map_geometry.survey import Survey, save_survey
from console.message_log import MAGIC
from console.past_walks import PastWalk
from console.recordings import RecordingEntry
from console.walk_figures import found_in
from console.walk_reading import read_walk
from console.walk_timeline import state_of
from console.what_if_result import Decision, DecisionPair
from device_agent.calibration_store import FORMAT, SCHEMA_VERSION, StoredCalibration
from device_agent.map_walk.walk_folder import WalkState
from device_agent.recording.reading import RecordedPart
from device_agent.sharing import Consent
from fuzz.bundle import bundled, unbundled
from navcore.calibration import Calibration, FloorCalibration
from navcore.cloud_files import write_cloud
from navcore.geometry import Transform
from navcore.graph_geojson import encode as geojson
from navcore.graph_graphml import encode as graphml
from navcore.live_recording import LiveRecording
from navcore.planning.poi_graph import Edge, Poi, PoiGraph, Road
from navcore.recording import Mark, RecordingWriter, calibration_text, write_trajectory
from navcore.recording_archive import RecordingArchive
from navcore.recording_upload import RecordingOffer
from navcore.settings import Settings
from navcore.site import Site, pack_site, save_site
from navcore.site_archive import write_site_archive
from navcore.site_files import MANIFEST, FileEntry
from navcore.types import CameraIntrinsics, FisheyeCamera, FisheyeImage, FisheyeIntrinsics, Frame
from navcore.walk_messages import DEPTH_TOPIC, ORDERS_TOPIC, OrderMessage
from navcore.wire import PROTOCOL_VERSION, Access, Accesses, DepthImage, Event, Hello, RouteChanged, encode

CAMERA = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5, (0.1, 0.0, 0.0, 0.0, 0.0))
GRAPH = PoiGraph(
    7,
    {"a": Poi("a", "Hall", "hall", 0.0, 0.0), "b": Poi("b", "Bär", "bar", 6.0, 0.0, notes="to the left\n")},
    {"e1": Edge("e1", "a", "b", ((0.0, 0.0), (6.0, 0.0)), 6.0, width_m=0.9, caution_side="left")},
    {"r1": Road("r1", ((0.0, 0.0), (6.0, 0.0)), "drawn")},
)
INCIDENT_ID = "0123456789abcdef"
STORED_WALK = Path(__file__).resolve().parents[1] / "data" / "walk.mcap"


def made(write: Callable[[Path], object], name: str = "file") -> bytes:
    """Return the file that ``write`` writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def folder_of(write: Callable[[Path], object]) -> bytes:
    """Return the folder that ``write`` writes, as a bundle."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "folder"
        write(folder)
        return bundled(files_below(folder))


def files_below(folder: Path) -> dict[str, bytes]:
    """Return the contents of all files below a folder, by name."""
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


# ------------------------------------------------------------------------------------------------- recordings
def _frames(fisheye: FisheyeCamera | None) -> list[Frame]:
    rng = np.random.default_rng(1)
    flat = np.repeat(rng.integers(0, 256, (2, 1, 1, 3)), 48, axis=1).repeat(64, axis=2).astype(np.uint8)
    grey = np.full((16, 16), 90, np.uint8)
    return [
        Frame(
            1.0 + 0.1 * i, flat[i], np.full((48, 64), 2.0, np.float32),
            None if fisheye is None else FisheyeImage(1.0 + 0.1 * i, grey, fisheye), np.array([0.0, 1.0, 0.0]),
        )
        for i in range(2)
    ]  # fmt: skip


def fisheye() -> FisheyeCamera:
    return FisheyeCamera(FisheyeIntrinsics(16, 16, 6.0, 6.0, 7.5, 7.5, 0.0, 0.0, 0.0, 0.0, 1.2), Transform.identity())


def recordings() -> list[bytes]:
    """Recordings in the TUM layout, with and without a second camera."""

    def with_everything(folder: Path) -> None:
        writer = RecordingWriter(folder, CAMERA, fisheye=fisheye())
        for frame in _frames(fisheye()):
            writer.add(frame, Transform.identity())
        writer.mark(Mark(1.05, "lift", "The lift"))
        writer.close()

    def live(folder: Path) -> None:
        recording = LiveRecording(folder, CAMERA)
        for frame in _frames(None):
            recording.add(frame)
        recording.cover(1.1, ("slow_down", "dark"))
        recording.close()

    return [folder_of(with_everything), folder_of(live)]


def recording_streams() -> list[bytes]:
    """What is sent of a recording's folder: tar."""

    def write(folder: Path) -> None:
        (folder / "rgb").mkdir(parents=True)
        (folder / "calib.txt").write_text(calibration_text(CAMERA, 1000.0))
        (folder / "rgb" / "1.0.jpg").write_bytes(bytes(700))

    with tempfile.TemporaryDirectory() as name:
        write(Path(name) / "walk")
        archive = RecordingArchive(Path(name) / "walk")
        return [archive.read(0, archive.size_bytes)]


def pictures() -> list[bytes]:
    """A JPEG and two PNG, as recordings hold them."""
    colour = _frames(None)[0].colour_rgb
    depth = np.full((48, 64), 2000, np.uint16)
    return [
        cv2.imencode(form, each)[1].tobytes() for form, each in ((".jpg", colour), (".png", colour), (".png", depth))
    ]


def trajectories() -> list[bytes]:
    """A way of some metres."""
    poses = [
        (float(i), Transform.from_quat_xyzw(np.array([0, 0, 0, 1.0]), np.array([0.5 * i, 0.0, 1.6]))) for i in range(9)
    ]
    return [made(lambda path: write_trajectory(path, poses, "world from camera"))]


# -------------------------------------------------------------------------------------------------------- sites
@cache
def site() -> Site:
    """A site of a few points; its map is none."""
    rng = np.random.default_rng(3)
    road = np.stack([np.linspace(0.0, 6.0, 7), np.zeros(7), np.full(7, 1.6)], axis=1)
    return Site(
        "small", "Small site", CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0),
        {"keyframe_poses": np.tile(np.eye(4), (1, 1, 1))}, (road,), rng.normal(size=(5, 3)).astype(np.float32),
        rng.integers(0, 256, (5, 3)).astype(np.uint8), GRAPH, {"keyframes": 2, "frames": 3},
    )  # fmt: skip


def sites() -> list[bytes]:
    """A site's folder."""
    return [folder_of(lambda folder: save_site(site(), folder))]


def manifests() -> list[bytes]:
    """A site's manifest; of the first schema, which has no checksum of its own."""
    with tempfile.TemporaryDirectory() as name:
        save_site(site(), Path(name) / "site")
        raw = json.loads((Path(name) / "site" / MANIFEST).read_bytes())
    return [json.dumps(raw | changes).encode() for changes in ({"schema_version": 1, "sha256": ""}, {})]


def site_archives() -> list[bytes]:
    """The whole site as one file."""
    with tempfile.TemporaryDirectory() as name:
        save_site(site(), Path(name) / "site")
        out = io.BytesIO()
        write_site_archive(Path(name) / "site", out)
        return [out.getvalue()]


def site_packages() -> list[bytes]:
    """The map as devices fetch it."""
    with tempfile.TemporaryDirectory() as name:
        save_site(site(), Path(name) / "site")
        return [pack_site(Path(name) / "site")]


def zipped(files: list[tuple[str, bytes]]) -> bytes:
    """Return a zip file with these members, whatever their names; the same name may come twice."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, strict_timestamps=False) as archive:
        for name, content in files:
            info = zipfile.ZipInfo("x", (1980, 1, 1, 0, 0, 0))
            info.filename, info.compress_type = name.encode("utf-8", "replace").decode(), zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    return out.getvalue()


# ------------------------------------------------------------------------------------------------ graphs, clouds
def geojsons() -> list[bytes]:
    """Ours, and one of another program."""
    foreign = {
        "type": "FeatureCollection",
        "features": [
            {"geometry": {"type": "Point", "coordinates": [3.0, 0.1]}, "properties": {"name": "Lift", "kind": "lift"}},
            {"geometry": {"type": "LineString", "coordinates": [[0, 1], [5, 2.5]]}, "properties": {"name": "Way"}},
            {"geometry": {"type": "Polygon", "coordinates": []}, "properties": None},
        ],
    }
    return [geojson(GRAPH, "small", "Small site"), json.dumps(foreign).encode()]


def graphmls() -> list[bytes]:
    """Ours, and one of another program."""
    foreign = (
        b'<graphml><key id="d0" for="node" attr.name="x"/><key id="d1" for="node" attr.name="y"/><graph>'
        b'<node id="n1"><data key="d0">1.5</data><data key="d1">2</data><data key="name">Lift</data></node>'
        b'<node id="n2"><data key="d0">3</data><data key="d1">0</data><data key="name">Door</data></node>'
        b'<edge source="n1" target="n2"/></graph></graphml>'
    )
    return [graphml(GRAPH, "small", "Small site"), foreign]


def clouds(ending: str) -> list[bytes]:
    """Clouds in every form of a kind of file."""
    rng = np.random.default_rng(4)
    points, colours = rng.normal(size=(4, 3)).astype(np.float32), rng.integers(0, 256, (4, 3)).astype(np.uint8)
    ours = made(lambda path: write_cloud(path, points, colours), f"cloud{ending}")
    return [ours, *(_PLY_FORMS if ending == ".ply" else _pcd_forms())]


_PLY_FORMS = (
    b"ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n"
    b"property uint16 red\nproperty uint16 green\nproperty uint16 blue\nend_header\n"
    + np.zeros(2, [(name, ">f8") for name in "xyz"] + [(name, ">u2") for name in "rgb"]).tobytes(),
    b"ply\r\nformat ascii 1.0\r\nelement camera 1\r\nproperty float f\r\nelement vertex 2\r\nproperty float z\r\n"
    b"property float x\r\nproperty float y\r\nproperty float red\r\nproperty float green\r\nproperty float blue\r\n"
    b"element face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n35.0\r\n"
    b"3 1 2 1 0 0\r\n6 4 5 0 0.5 0\r\n3 0 1 1\r\n",
)


def _pcd_forms() -> list[bytes]:
    head = "VERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 3\nHEIGHT 1\nDATA {}\n"
    plain = np.zeros(48, np.uint8)
    packed = b"\x0b" + plain[:12].tobytes() + b"\xe0\x1b\x0b"
    return [
        head.format("ascii").encode() + b"1 2 3 255\n4 5 6 65535\nnan 0 0 0\n",
        head.format("binary_compressed").encode() + struct.pack("<II", len(packed), 48) + packed,
    ]


# ------------------------------------------------------------------------------------------- records of walks
@cache
def walk_bundle() -> bytes:
    """A recorded walk, its messages by topic; the first cycles of the stored one."""
    part = RecordedPart(STORED_WALK)
    files: dict[str, bytes] = {"metadata": json.dumps(part.description).encode()}
    for record in part.records():
        if isinstance(record, Attachment):
            files[f"attachment {record.name}"] = record.data
    for count, (channel, message) in enumerate(part.messages(), 1):
        files[f"{count} {channel.topic}"] = message.data
        if count == 40:
            break
    log = Log(name="cue", message="Turn left.", level=2)  # type: ignore[arg-type]
    files |= {
        f"50 {ORDERS_TOPIC}": msgspec.json.encode(OrderMessage(1.0, "Say", "{}")),
        f"51 {DEPTH_TOPIC}": b"",
        "52 /log": log.SerializeToString(),
        "53 /road": SceneUpdate().SerializeToString(),
    }
    return bundled(files)


def walk_file(files: list[tuple[str, bytes]]) -> bytes:
    """Return an MCAP file of the messages in a bundle, without checksums or compression: spoiling it is seen."""
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.NONE, enable_crcs=False)
    writer.start()
    channels: dict[str, int] = {}
    schema = writer.register_schema("vbr", "jsonschema", b"{}")
    for number, (name, content) in enumerate(files):
        kind, _, rest = name.encode("utf-8", "replace").decode().partition(" ")
        if kind == "metadata":
            described = _texts(content)
            opening = dict(files).get("attachment opening")
            if opening is not None and "opening_crc32" in described:
                described["opening_crc32"] = f"{zlib.crc32(opening):08x}"
            writer.add_metadata("walk", described)
        elif kind == "attachment":
            writer.add_attachment(0, 0, rest, "application/msgpack", content)
        else:
            if rest not in channels:
                channels[rest] = writer.register_channel(rest, "json", schema)
            writer.add_message(channels[rest], number * 10_000_000, content, number * 10_000_000)
    writer.finish()
    return out.getvalue()


def _texts(content: bytes) -> dict[str, str]:
    try:
        return {str(name): str(value) for name, value in json.loads(content).items()}
    except (ValueError, AttributeError, RecursionError):
        return {}


def walk_files() -> list[bytes]:
    """An MCAP file as it is recorded, small, and one whose damage no checksum tells."""
    return [walk_file(unbundled(walk_bundle())[:12])]


def _messages() -> list[bytes]:
    hello = Hello(PROTOCOL_VERSION, "glasses", "0.1.0", "small", "0" * 64, 7, 0, 1000.0)
    state = next(content for name, content in unbundled(walk_bundle()) if name.endswith(" /device"))
    told = (
        hello, Event(1, 1001.0, "cue", "Turn left."), RouteChanged(1001.5, ((0.0, 0.0), (6.0, 0.0))),
        state_of(state), DepthImage(1002.0, b"\xff\xd8"),
    )  # fmt: skip
    return [encode(message) for message in told if message is not None]


def message_bundles() -> list[bytes]:
    """The messages of an incident."""
    return [bundled({str(i): each for i, each in enumerate(_messages())})]


def message_log(messages: list[bytes]) -> bytes:
    """Return a log of messages, with the checksums that it must have."""
    payloads = [msgspec.msgpack.encode((float(i), 0.0, each)) for i, each in enumerate(messages)]
    return MAGIC + b"".join(struct.pack("<II", len(each), zlib.crc32(each)) + each for each in payloads)


def message_logs() -> list[bytes]:
    """A log of messages."""
    return [message_log(_messages())]


def incidents() -> list[bytes]:
    """An incident's manifest."""
    cause = Cause(1e9, "asked", "Somebody has asked.", who="Eve")
    incident = Incident(
        INCIDENT_ID,
        "glasses",
        "Glasses",
        (cause,),
        1e9,
        1e9 + 60.0,
        5.0,
        Versions("0.1", 1, "0" * 64, 1, 1),
        "complete",
    )
    return [msgspec.json.encode(incident)]


def decision_lists() -> list[bytes]:
    """What a replay has decided."""
    then = Decision("walk", "ok", "a rule", 0.0, 0.2, (), "Walk: because of ok.")
    now = Decision("stop", "blocked", "a rule", None, None, ("Stop.",), "Stop: because of blocked.")
    pairs = [DecisionPair(i, 1.0 + 0.1 * i, ("action",), then, now if i else then) for i in range(3)]
    return [b"".join(msgspec.json.encode(pair) + b"\n" for pair in pairs)]


def surveys() -> list[bytes]:
    """What was measured in a map's cloud."""
    seen = np.zeros((3, 4), np.bool_)
    survey = Survey(Occupancy(0.0, 0.0, 0.1, seen, seen), np.zeros((1, 2, 2)))
    return [made(lambda path: save_survey(survey, path), "survey.npz")]


# --------------------------------------------------------------------------------------- what a device keeps
def calibrations() -> list[bytes]:
    """A stored calibration."""
    floor = FloorCalibration(1e9, 1.6, 0.01, 0.3, 0.01, 0.0, 0.01, 10, (0.0, 0.1, 0.0))
    return [resealed(msgspec.json.encode(StoredCalibration(FORMAT, SCHEMA_VERSION, 3, 1e9, Calibration(floor=floor))))]


def resealed(data: bytes) -> bytes:
    """Return a calibration file with the checksum that it must have, where it has the form of one."""
    try:
        stored = msgspec.convert(json.loads(data), StoredCalibration)
        plain = msgspec.structs.replace(stored, sha256="")
        sha256 = hashlib.sha256(msgspec.json.encode(plain, order="deterministic")).hexdigest()
        return json.dumps(json.loads(data) | {"sha256": sha256}).encode()
    except Exception:
        return data


def device_settings() -> list[bytes]:
    """The settings that ran last."""
    values = dict(list(Settings().values().items())[:12])
    return [json.dumps({"revision": 3, "values": values}, indent=1).encode()]


def consents() -> list[bytes]:
    """What the walker shares."""
    return [msgspec.json.encode(Consent(walks=True, version=4))]


def access_lists() -> list[bytes]:
    """Who has watched."""
    return [msgspec.json.encode(Accesses((Access("Eve", "watch", 1e9, 1e9 + 60.0),), 1e9))]


def walk_states() -> list[bytes]:
    """How far a map walk has come."""
    return [msgspec.json.encode(WalkState("recorded", "2026-11-29", 1, ""))]


def sent_lists() -> list[bytes]:
    """Which walks the console has."""
    return [b'{"walk-1.mcap":{"failure":""},"walk-2.mcap":{"failure":"too large"}}']


def recording_entries() -> list[bytes]:
    """What the console keeps beside a recording."""
    return [msgspec.json.encode(RecordingEntry(RecordingOffer("walk", "walk-1", 10, "0" * 64), "Glasses", 1e9))]


def archive_id(files: dict[str, FileEntry]) -> str:
    """Return what an archive of these files is called."""
    lines = (f"{name}\n{files[name].sha256}\n" for name in sorted(files))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def cycle_notes() -> list[bytes]:
    """What the loop noted in a cycle."""
    files = unbundled(walk_bundle())
    return [BytesValue.FromString(content).value for name, content in files if name.endswith("/replay/cycle")][:2]


def journals() -> list[bytes]:
    """An empty journal of events."""

    def write(path: Path) -> None:
        base = sqlite3.connect(path)
        base.execute("CREATE TABLE events (sequence INTEGER PRIMARY KEY, text TEXT)")
        base.commit()
        base.close()

    return [made(write)]


def walks_found() -> list[bytes]:
    """What is kept of a walk that was read."""
    walk = PastWalk("w", "Glasses", "s", "0", 0.0, 1.0, (STORED_WALK,), False, "", 0, "0" * 64, 1)
    return [msgspec.json.encode(found_in(read_walk(walk)))]
