"""Every reader of the product that takes what comes as a file, and small valid files for each.

A reader may return, or raise what its documentation says: an error of :mod:`navcore.errors`, whose sentence names what
is wrong. Anything else that it raises is a fault of the product, and so is a law that does not hold afterwards, which
the target asserts.
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import cv2
import msgspec
import numpy as np

from console.alerts.incidents import Incidents
from console.hub import DeviceHub
from console.incident_timeline import incident_timeline
from console.map_geometry.survey import load_survey
from console.message_log import read_messages
from console.past_walks import PastWalk, PastWalks
from console.recordings import Recordings
from console.walk_figures import found_in
from console.walk_library import KEPT_AS, WalkLibrary
from console.walk_reading import read_walk
from console.what_if_result import compared, read_decisions
from device_agent.calibration_store import CalibrationStore, read_calibration_file
from device_agent.device_command import read_token
from device_agent.device_store import DeviceStore
from device_agent.journal import refuse_damaged
from device_agent.logs import readable_line
from device_agent.map_walk.walk_folder import STATE_FILE, WalkState, read_state
from device_agent.recording import exact
from device_agent.recording.notes import CycleNotes, Opening
from device_agent.recording.reading import RecordedPart
from device_agent.recording.settled import SENT_FILE
from device_agent.recording_queues import WalkQueue
from fuzz import seeds
from fuzz.bundle import unbundled, write_bundle
from navcore.cloud_files import read_cloud
from navcore.errors import VbrError
from navcore.fisheye_recording import fisheye_calibration_text, read_fisheye_camera
from navcore.graph_import import imported
from navcore.live_recording import COVERAGE_FILE, mend_recording
from navcore.planning.edits import validate
from navcore.recorded_files import read_image
from navcore.recording import calibration_text, open_recording, read_calibration, read_marks, read_trajectory
from navcore.recording_archive import unpack_recording
from navcore.recording_upload import RecordingOffer
from navcore.settings import Settings, parse_assignment
from navcore.site import GRAPH_FILE, load_poi_graph, load_site, map_checksum, save_site, unpack_site
from navcore.site_archive import ARCHIVE_MANIFEST, ArchiveManifest, unpack_site_archive
from navcore.site_files import MANIFEST, Manifest, entry_of, manifest_bytes
from navcore.slam.road import build_roads
from navcore.slam.slam_map import SlamMap
from navcore.weak_stretches import read_coverage

Form = Literal["lines", "json", "xml", "binary", "bundle"]
"""How a file is best spoiled: line by line, value by value, byte by byte, or one file of several at a time."""
STREAM_BYTES = 1 << 20
"""So much may come out of a recording that is sent."""


@dataclass(frozen=True)
class Target:
    """A reader, and what it reads."""

    name: str
    form: Form
    read: Callable[[bytes, Path], object]
    """Called with the file's bytes and an empty folder of its own."""
    make_seeds: Callable[[], list[bytes]]

    @property
    def seeds(self) -> list[bytes]:
        """Small valid files."""
        return _seeds(self.make_seeds)


@cache
def _seeds(make: Callable[[], list[bytes]]) -> list[bytes]:
    return make()


TARGETS: dict[str, Target] = {}


def _target(form: Form, make_seeds: Callable[[], list[bytes]]) -> Callable[[Callable[[bytes, Path], object]], None]:
    def register(read: Callable[[bytes, Path], object]) -> None:
        name = read.__name__.lstrip("_")
        TARGETS[name] = Target(name, form, read, make_seeds)

    return register


def _file(data: bytes, folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


@contextlib.contextmanager
def _tried() -> Iterator[None]:
    """Go on with what else is to be read of the same file."""
    with contextlib.suppress(VbrError):
        yield


# ------------------------------------------------------------------------------------------------- recordings
@_target("bundle", seeds.recordings)
def _recording(data: bytes, folder: Path) -> None:
    write_bundle(data, walk := folder / "walk")
    with _tried():
        read_marks(walk / "marks.txt")
    with _tried():
        read_coverage(walk / COVERAGE_FILE)
    with _tried():
        read_trajectory(walk / "groundtruth.txt")
    with _tried():
        for frame in open_recording(walk).frames():
            assert frame.colour_rgb.shape[:2] == frame.depth_m.shape
            assert not (frame.depth_m < 0.0).any()
    # What is left of one that broke off can be mended again, to the same.
    kept = mend_recording(walk)
    before = seeds.files_below(walk)
    assert mend_recording(walk) == kept
    assert seeds.files_below(walk) == before


@_target("lines", lambda: [calibration_text(seeds.CAMERA, 1000.0).encode()])
def _calib_txt(data: bytes, folder: Path) -> None:
    read_calibration(_file(data, folder, "calib.txt"))


@_target("lines", lambda: [fisheye_calibration_text(seeds.fisheye()).encode()])
def _fisheye_calib_txt(data: bytes, folder: Path) -> None:
    read_fisheye_camera(_file(data, folder, "fisheye_calib.txt"))


@_target("lines", seeds.trajectories)
def _trajectory(data: bytes, folder: Path) -> None:
    stamps_s, poses = read_trajectory(_file(data, folder, "road.tum"))
    for road in build_roads(stamps_s, np.array([pose.translation for pose in poses]).reshape(-1, 3)):
        assert np.isfinite(road).all()


@_target("binary", seeds.pictures)
def _picture(data: bytes, folder: Path) -> None:
    read_image(_file(data, folder, "1.png"), cv2.IMREAD_UNCHANGED)
    read_image(folder / "1.png", cv2.IMREAD_COLOR)


@_target("binary", seeds.recording_streams)
def _recording_stream(data: bytes, folder: Path) -> None:
    try:
        unpack_recording(_file(data, folder, "walk.tar"), folder / "new", STREAM_BYTES, 50)
    finally:
        inside = seeds.files_below(folder / "new")
        assert set(seeds.files_below(folder)) == {"walk.tar", *(f"new/{name}" for name in inside)}
        assert sum(map(len, inside.values())) <= STREAM_BYTES
        assert len(inside) <= 50


# ------------------------------------------------------------------------------------------------------ sites
@_target("json", seeds.manifests)
def _site_manifest(data: bytes, folder: Path) -> None:
    save_site(seeds.site(), folder / "site")
    _file(data, folder / "site", MANIFEST)
    load_site(folder / "site").name.encode()
    map_checksum(folder / "site")


@_target("bundle", seeds.sites)
def _site_folder(data: bytes, folder: Path) -> None:
    """Whoever writes a site can give it the right checksums: the manifest is made to fit."""
    write_bundle(data, folder / "site")
    files = seeds.files_below(folder / "site")
    entries = {name: entry_of(content) for name, content in files.items() if name not in (MANIFEST, GRAPH_FILE)}
    _file(manifest_bytes(Manifest("vbr-site", 3, "s", "S", entries)), folder / "site", MANIFEST)
    site = load_site(folder / "site")
    with _tried():
        SlamMap.from_arrays(site.map_arrays)


@_target("json", lambda: [msgspec.json.encode(seeds.GRAPH)])
def _poi_graph(data: bytes, folder: Path) -> None:
    validate(load_poi_graph(_file(data, folder, GRAPH_FILE).parent))


@_target("binary", seeds.site_packages)
def _site_package(data: bytes, folder: Path) -> None:
    _unpacked(data, folder, lambda path, target: unpack_site(path, target))


@_target("binary", seeds.site_archives)
def _site_archive(data: bytes, folder: Path) -> None:
    _unpacked(data, folder, lambda path, target: unpack_site_archive(path, target))


@_target("bundle", seeds.sites)
def _site_package_members(data: bytes, folder: Path) -> None:
    _unpacked(seeds.zipped(unbundled(data)), folder, lambda path, target: unpack_site(path, target))


@_target("bundle", seeds.sites)
def _site_archive_members(data: bytes, folder: Path) -> None:
    """An archive whose list of files fits what is in it."""
    files = [(f"site/{name}", content) for name, content in unbundled(data)]
    listed = {name.encode("utf-8", "replace").decode(): entry_of(content) for name, content in files}
    map_sha256 = ""
    with _tried():
        write_bundle(data, folder / "site")
        map_sha256 = map_checksum(folder / "site")
    shutil.rmtree(folder / "site")
    manifest = ArchiveManifest(
        "vbr-site-archive", 1, seeds.archive_id(listed), None, "small", "Small site", map_sha256, 7, listed
    )
    members = [(ARCHIVE_MANIFEST, msgspec.json.encode(manifest)), *files]
    _unpacked(seeds.zipped(members), folder, lambda path, target: unpack_site_archive(path, target))


def _unpacked(data: bytes, folder: Path, unpack: Callable[[Path, Path], object]) -> None:
    """Whatever comes is a whole site, or nothing."""
    (folder / "there").mkdir()
    try:
        unpack(_file(data, folder, "upload.zip"), folder / "there" / "site")
    except BaseException:
        assert {path.name for path in folder.iterdir()} == {"there", "upload.zip"}
        assert not list((folder / "there").iterdir()), "something was left behind"
        raise
    assert [path.name for path in (folder / "there").iterdir()] == ["site"]
    load_site(folder / "there" / "site")


# -------------------------------------------------------------------------------------------- graphs, clouds
def _import(data: bytes, folder: Path) -> None:
    found = imported(data, seeds.GRAPH)
    validate(found.graph)
    assert found.graph.version == seeds.GRAPH.version + 1
    for sentence in (*found.unused, *found.notes):
        assert len(sentence) < 1000


@_target("json", seeds.geojsons)
def _geojson(data: bytes, folder: Path) -> None:
    _import(data, folder)


@_target("xml", seeds.graphmls)
def _graphml(data: bytes, folder: Path) -> None:
    _import(data, folder)


def _cloud(path: Path) -> None:
    cloud = read_cloud(path)
    assert cloud.points_m.shape == cloud.colours_rgb.shape
    assert np.isfinite(cloud.points_m).all()


@_target("binary", lambda: seeds.clouds(".ply"))
def _ply(data: bytes, folder: Path) -> None:
    _cloud(_file(data, folder, "cloud.ply"))


@_target("binary", lambda: seeds.clouds(".pcd"))
def _pcd(data: bytes, folder: Path) -> None:
    _cloud(_file(data, folder, "cloud.pcd"))


# ------------------------------------------------------------------------------------------------------ walks
def _past_walk(path: Path) -> PastWalk:
    return PastWalk("w", "Glasses", "s", "0", 0.0, 0.0, (path,), False, "", 0, "0" * 64, path.stat().st_size)


def _read_walk(path: Path) -> None:
    with _tried():
        timeline = read_walk(_past_walk(path))
        found_in(timeline)
        for at_s in (timeline.began_s, timeline.ended_s):
            with _tried():
                timeline.device_at(at_s)
            with _tried():
                timeline.depth_jpeg(at_s)
    part = RecordedPart(path)
    with _tried():
        part.rehearsal()
    with _tried():
        for _ in part.cycles():
            pass
    part.length_s()
    part.repair(path.with_name("repaired.mcap"))
    RecordedPart(path.with_name("repaired.mcap"))


@_target("binary", seeds.walk_files)
def _walk_file(data: bytes, folder: Path) -> None:
    _read_walk(_file(data, folder, "walk.mcap"))


@_target("bundle", lambda: [seeds.walk_bundle()])
def _walk_messages(data: bytes, folder: Path) -> None:
    """A whole file with anything in its messages."""
    _read_walk(_file(seeds.walk_file(unbundled(data)), folder, "walk.mcap"))


@_target("binary", lambda: [dict(unbundled(seeds.walk_bundle()))["attachment opening"]])
def _walk_opening(data: bytes, folder: Path) -> None:
    exact.encode(exact.decode(data, Opening))


@_target("binary", seeds.cycle_notes)
def _walk_cycle(data: bytes, folder: Path) -> None:
    exact.encode(exact.decode(data, CycleNotes))


@_target("lines", seeds.decision_lists)
def _decisions(data: bytes, folder: Path) -> None:
    compared(read_decisions(_file(data, folder, "decisions.jsonl")))


def _incident_log(data: bytes, folder: Path) -> None:
    (manifest,) = seeds.incidents()
    (folder / seeds.INCIDENT_ID).mkdir()
    _file(manifest, folder / seeds.INCIDENT_ID, "manifest.json")
    log = _file(data, folder / seeds.INCIDENT_ID, "messages.vbrlog")
    (incident,) = Incidents(folder, DeviceHub()).all()
    incident_timeline(incident, read_messages(log)).marks()


@_target("binary", seeds.message_logs)
def _message_log(data: bytes, folder: Path) -> None:
    _incident_log(data, folder)


@_target("bundle", seeds.message_bundles)
def _incident_messages(data: bytes, folder: Path) -> None:
    """A whole log with anything in its messages."""
    _incident_log(seeds.message_log([content for _, content in unbundled(data)]), folder)


@_target("json", seeds.incidents)
def _incident_manifest(data: bytes, folder: Path) -> None:
    (folder / seeds.INCIDENT_ID).mkdir()
    _file(data, folder / seeds.INCIDENT_ID, "manifest.json")
    _file(b"", folder / seeds.INCIDENT_ID, "messages.vbrlog")
    incidents = Incidents(folder, DeviceHub())
    for incident in incidents.all():
        assert incident == incidents.named(seeds.INCIDENT_ID)
        msgspec.json.encode(incident)


@_target("json", seeds.recording_entries)
def _recording_entry(data: bytes, folder: Path) -> None:
    _file(data, folder, f"{'0' * 64}.json")
    recordings = Recordings(folder, lambda: 1e9)
    for stored in recordings.all():
        msgspec.json.encode(stored.entry)
    PastWalks(recordings).all()
    recordings.delete_before(2e9)


@_target("json", seeds.walks_found)
def _walk_found(data: bytes, folder: Path) -> None:
    recordings = Recordings(folder, lambda: 1e9)
    file = seeds.STORED_WALK.read_bytes()[:20_000]
    sha256 = hashlib.sha256(file).hexdigest()
    recordings.offer(RecordingOffer("walk", "walk-1", len(file), sha256), "Glasses")
    recordings.add(sha256, 0, file)
    recordings.keep_beside(sha256, KEPT_AS, data)
    library = WalkLibrary(PastWalks(recordings))
    (walk,) = library.walks.all()
    library.found(walk)
    assert library.wait(60.0)


@_target("binary", seeds.surveys)
def _survey(data: bytes, folder: Path) -> None:
    load_survey(_file(data, folder, "survey.npz"))


# ------------------------------------------------------------------------------------------ what a device keeps
@_target("json", seeds.calibrations)
def _calibration(data: bytes, folder: Path) -> None:
    """With the checksum that it must have; and as it is."""
    with _tried():
        read_calibration_file(_file(data, folder, "calibration.json"))
    _file(seeds.resealed(data), folder, "calibration.json")
    found, error = CalibrationStore(folder).load_or_kept()
    assert (found is None) == (error is not None)


@_target("json", seeds.device_settings)
def _device_settings(data: bytes, folder: Path) -> None:
    _file(data, folder, "settings.json")
    store = DeviceStore(folder, folder / "site")
    store.load_settings()
    settings, revision = store.stored_settings()
    assert 0 <= revision <= 1 << 53, "no message holds it"
    store.save_settings(settings, revision)
    assert store.stored_settings() == (settings, revision)


@_target("json", seeds.consents)
def _consent(data: bytes, folder: Path) -> None:
    _file(data, folder, "consent.json")
    store = DeviceStore(folder, folder / "site")
    try:
        consent = store.load_consent()
    finally:
        store.save_consent(store.change_consent(lambda kept: kept))
    assert store.load_consent() == consent


@_target("json", seeds.access_lists)
def _accesses(data: bytes, folder: Path) -> None:
    _file(data, folder, "accesses.json")
    store = DeviceStore(folder, folder / "site")
    accesses = store.load_accesses(1e9)
    assert accesses is not None
    store.save_accesses(accesses)


@_target("json", seeds.walk_states)
def _map_walk_state(data: bytes, folder: Path) -> None:
    _file(data, folder, STATE_FILE)
    assert isinstance(read_state(folder), WalkState)


@_target("json", seeds.sent_lists)
def _sent_walks(data: bytes, folder: Path) -> None:
    _file(data, folder, SENT_FILE)
    shutil.copy(seeds.STORED_WALK, folder / "walk-3.mcap")
    queue = WalkQueue(folder, lambda: True)
    queue.settle(folder / "walk-3.mcap", "")
    assert queue.waiting() == ()


@_target("binary", seeds.journals)
def _journal(data: bytes, folder: Path) -> None:
    refuse_damaged(_file(data, folder, "events.sqlite"))


@_target("lines", lambda: [b"gate.clearance_m=1.2", b"cues.language=en", b"obstacle.leave_frames_count=3"])
def _setting(data: bytes, folder: Path) -> None:
    key, value = parse_assignment(data.decode(errors="surrogateescape"))
    Settings().changed({key: value})


@_target("lines", lambda: [b'{"time":"2026","level":"INFO","logger":"a","text":"b","thread":"c","n":1.5}'])
def _log_line(data: bytes, folder: Path) -> None:
    readable_line(data.decode(errors="replace"))


@_target("lines", lambda: [b"a" * 43 + b"\n"])
def _token(data: bytes, folder: Path) -> None:
    read_token(_file(data, folder, "glasses.token"))
