"""Recordings in the TUM RGB-D layout: a folder that holds what the cameras saw.

``rgb/`` and ``depth/`` (16-bit PNG), ``associations.txt`` (``t_rgb rgb t_depth depth``), ``calib.txt`` (``name value``
lines: fx fy cx cy in pixels, k1 k2 p1 p2 k3 where the colour image is distorted, depth_factor in units per metre) and,
where somebody measured it, ``groundtruth.txt`` (``t tx ty tz qx qy qz qw``). A camera with an accelerometer adds
``gravity.txt`` (``t x y z``): the unit vector that points down, in the camera's frame, of the frames with these stamps.
The sighted person who records the road can name places on the way: ``marks.txt`` (``t kind name``), a line each.

A second, wide camera adds three things; a recording without them is whole as well. ``fisheye/`` holds its grey
pictures, ``fisheye.txt`` (``t fisheye/name``) says when each was taken, on the depth camera's clock, and
``fisheye_calib.txt`` (``name value`` lines) describes it: fx fy in pixels per radian, cx cy in pixels, k1 k2 k3 k4 of
Kannala and Brandt's model, max_angle_deg (half the field of view), and its mounting, the depth camera seen from the
fisheye camera (``fisheye_from_camera``): tx ty tz in metres and the quaternion qx qy qz qw; its width and height, which
tell a live camera what to deliver, may be there too. A frame gets the picture that was taken nearest to it, at most
MAX_FISHEYE_GAP_S away; frames without one go on with the depth camera alone.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.errors import RecordingError
from navcore.fisheye_recording import FisheyeRecording, FisheyeWriter, open_fisheye
from navcore.geometry import FloatArray, Transform
from navcore.planning.poi_graph import POI_KINDS, PoiKind
from navcore.recorded_files import is_inside, is_number, read_image, read_values
from navcore.types import CameraIntrinsics, DepthImage, FisheyeCamera, FisheyeImage, Frame

MAX_DEPTH_UNITS = 65_535
MAX_NAME_LENGTH = 80
_DISTORTION_NAMES = ("k1", "k2", "p1", "p2", "k3")
_FOCAL_WIDTHS = (0.2, 20.0)
"""Focal lengths that a camera can have, in picture widths: fields of view from 136° to 3°."""
_MAX_DISTORTION = 1000.0
_DEPTH_FACTORS = (10.0, 100_000.0)
"""Depth units per metre: 16 bits hold nothing useful in coarser or finer ones."""


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """Where one frame of a recording lies on disk."""

    stamp_s: float
    colour_path: Path
    depth_path: Path
    gravity: tuple[float, float, float] | None = None
    """Unit vector along gravity in the camera's frame, where an accelerometer told it."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A place that the recording person named while standing at it."""

    stamp_s: float
    kind: PoiKind
    name: str


@dataclass(frozen=True, slots=True)
class Recording:
    """An opened recording; frames are read when they are asked for."""

    folder: Path
    intrinsics: CameraIntrinsics
    depth_factor: float
    """Depth units per metre."""
    entries: tuple[RecordedFrame, ...]
    fisheye: FisheyeRecording | None = None
    """The second, wide camera and its pictures; None where the recording has none."""

    def __len__(self) -> int:
        return len(self.entries)

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order. Raises RecordingError at the first damaged image."""
        for entry in self.entries:
            yield self.read(entry)

    def read(self, entry: RecordedFrame) -> Frame:
        """Read one frame. Raises RecordingError where an image is missing, damaged or of another size."""
        colour = _read_colour(entry.colour_path)
        depth = read_image(entry.depth_path, cv2.IMREAD_UNCHANGED)
        if depth is None or depth.dtype != np.uint16 or depth.ndim != 2:
            raise RecordingError(f"{entry.depth_path} is missing, damaged or no 16-bit depth image: record again.")
        expected = (self.intrinsics.height_px, self.intrinsics.width_px)
        for path, shape in ((entry.colour_path, colour.shape[:2]), (entry.depth_path, depth.shape)):
            if shape != expected:
                raise RecordingError(
                    f"{path} is {shape[1]}×{shape[0]} pixels, but the recording's are {expected[1]}×{expected[0]}:"
                    " use the calibration and the images of one camera."
                )
        return Frame(
            entry.stamp_s,
            np.ascontiguousarray(colour[:, :, ::-1]),
            depth_from_units(depth, self.depth_factor),
            self._read_fisheye(entry),
            None if entry.gravity is None else np.array(entry.gravity),
        )

    def _read_fisheye(self, entry: RecordedFrame) -> FisheyeImage | None:
        if self.fisheye is None:
            return None
        picture = self.fisheye.nearest(entry.stamp_s)
        return None if picture is None else self.fisheye.read(picture)


def depth_from_units(units: np.ndarray, depth_factor: float) -> DepthImage:
    """Return metres (h, w) from a 16-bit depth image; 0 units means nothing was measured and becomes NaN."""
    depth_m: DepthImage = units.astype(np.float32)
    depth_m *= np.float32(1.0 / depth_factor)
    depth_m[units == 0] = np.nan
    return depth_m


def units_from_depth(depth_m: DepthImage, depth_factor: float) -> np.ndarray:
    """Return a 16-bit depth image (h, w) from metres; NaN, and what does not fit, becomes 0."""
    units = np.nan_to_num(np.round(depth_m * depth_factor), nan=0.0, posinf=0.0, neginf=0.0)
    units[(units < 0) | (units > MAX_DEPTH_UNITS)] = 0
    return units.astype(np.uint16)


def open_recording(folder: Path) -> Recording:
    """Open a recording. Raises RecordingError with what is wrong and what to do."""
    if not folder.is_dir():
        raise RecordingError(f"There is no recording at {folder}: name a folder in the TUM RGB-D layout.")
    entries = _with_gravity(folder / "gravity.txt", _read_associations(folder))
    calibration = read_calibration(folder / "calib.txt")
    height_px, width_px = _read_colour(entries[0].colour_path).shape[:2]
    intrinsics = CameraIntrinsics(
        width_px,
        height_px,
        calibration["fx"],
        calibration["fy"],
        calibration["cx"],
        calibration["cy"],
        tuple(calibration[name] for name in _DISTORTION_NAMES) if "k1" in calibration else (),
    )
    _refuse_foreign_calibration(folder / "calib.txt", intrinsics)
    return Recording(folder, intrinsics, calibration["depth_factor"], entries, open_fisheye(folder))


def _refuse_foreign_calibration(path: Path, camera: CameraIntrinsics) -> None:
    """Refuse what no camera of this picture size has: above all the calibration of the same camera at another size."""
    size = f"{camera.width_px}×{camera.height_px} image"
    advice = "use the calibration of the camera that recorded it, at this size"
    if not (_is_near_middle(camera.cx_px, camera.width_px) and _is_near_middle(camera.cy_px, camera.height_px)):
        raise RecordingError(
            f"{path} puts the optical axis at ({camera.cx_px:g}, {camera.cy_px:g}), far from the middle of the {size}:"
            f" {advice}."
        )
    low, high = _FOCAL_WIDTHS
    if not all(
        low * camera.width_px <= focal_px <= high * camera.width_px for focal_px in (camera.fx_px, camera.fy_px)
    ):
        raise RecordingError(
            f"{path} gives focal lengths of {camera.fx_px:g} and {camera.fy_px:g} px, which do not fit the {size}:"
            f" {advice}."
        )
    if not all(abs(value) <= _MAX_DISTORTION for value in camera.distortion):
        raise RecordingError(f"{path} gives a distortion beyond ±{_MAX_DISTORTION:g}, which no lens has: {advice}.")


def _is_near_middle(axis_px: float, size_px: int) -> bool:
    return 0.3 * size_px <= axis_px <= 0.7 * size_px


def _read_colour(path: Path) -> NDArray[np.uint8]:
    colour = read_image(path, cv2.IMREAD_COLOR)
    if colour is None:
        raise RecordingError(f"{path} is missing or damaged: record again, or remove its line from associations.txt.")
    return colour.astype(np.uint8, copy=False)


def read_calibration(path: Path) -> dict[str, float]:
    """Read ``calib.txt``: lines of ``name value``. Raises RecordingError."""
    values = read_values(path, "a recording needs a calibration with fx fy cx cy and depth_factor")
    for name in ("fx", "fy", "cx", "cy"):
        if name not in values:
            raise RecordingError(f"{path} has no {name}: write a line with the name and its value in pixels.")
    values.setdefault("depth_factor", 5000.0)
    for name in ("fx", "fy", "depth_factor"):
        if values[name] <= 0:
            raise RecordingError(f"{path}: {name} is {values[name]:g}, but must be greater than 0.")
    low, high = _DEPTH_FACTORS
    if not low <= values["depth_factor"] <= high:
        raise RecordingError(
            f"{path}: depth_factor is {values['depth_factor']:g}, but {low:g} to {high:g} units per metre make sense."
        )
    if any(name in values for name in _DISTORTION_NAMES):
        for name in _DISTORTION_NAMES:
            values.setdefault(name, 0.0)
    return values


def read_trajectory(path: Path) -> tuple[FloatArray, list[Transform]]:
    """Read a TUM trajectory: stamps (n,) in seconds and the poses. Raises RecordingError."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read: name a trajectory in the TUM format.") from error
    stamps: list[float] = []
    poses: list[Transform] = []
    for number, line in enumerate(lines, 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if len(words) != 8 or not all(is_number(word) for word in words):
            raise RecordingError(f"{path}, line {number}: expected 't tx ty tz qx qy qz qw', found {line.strip()!r}.")
        numbers = [float(word) for word in words]
        try:
            poses.append(Transform.from_quat_xyzw(np.array(numbers[4:]), np.array(numbers[1:4])))
        except ValueError as error:
            raise RecordingError(f"{path}, line {number}: {error}.") from error
        stamps.append(numbers[0])
    return np.array(stamps, dtype=np.float64), poses


def read_marks(path: Path) -> tuple[Mark, ...]:
    """Read ``marks.txt``; empty where there is none. Raises RecordingError with the line."""
    if not path.exists():
        return ()
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read: write lines of 't kind name' in UTF-8.") from error
    marks: list[Mark] = []
    for number, line in enumerate(lines, 1):
        words = line.split("#", 1)[0].split(maxsplit=2)
        if not words:
            continue
        if len(words) != 3 or not is_number(words[0]) or len(words[2].strip()) > MAX_NAME_LENGTH:
            raise RecordingError(f"{path}, line {number}: expected 't kind name', found {line.strip()!r}.")
        if words[1] not in POI_KINDS:
            kinds = ", ".join(POI_KINDS)
            raise RecordingError(f"{path}, line {number}: {words[1]!r} is no kind of place; use one of {kinds}.")
        marks.append(Mark(float(words[0]), cast(PoiKind, words[1]), words[2].strip()))
    return tuple(marks)


def write_trajectory(path: Path, stamped_poses: Iterable[tuple[float, Transform]], comment: str = "") -> None:
    """Write poses (``map_from_camera`` unless the comment says otherwise) in the TUM format."""
    with path.open("w", encoding="utf-8", newline="\n") as out:
        out.writelines(trajectory_lines(stamped_poses, comment))


def trajectory_lines(stamped_poses: Iterable[tuple[float, Transform]], comment: str = "") -> Iterator[str]:
    """Return the lines of a trajectory in the TUM format."""
    for line in comment.splitlines():
        yield f"# {line}\n"
    yield "# t tx ty tz qx qy qz qw\n"
    for stamp_s, pose in stamped_poses:
        numbers = [*pose.translation.tolist(), *pose.quat_xyzw.tolist()]
        yield f"{stamp_s:.6f} " + " ".join(f"{number:.7f}" for number in numbers) + "\n"


def write_pictures(folder: Path, frame: Frame, depth_factor: float) -> str:
    """Write a frame's two pictures into a recording; return its line of ``associations.txt``. Raises OSError."""
    name = f"{frame.stamp_s:.6f}"
    colour = cv2.imencode(".jpg", frame.colour_rgb[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
    depth = cv2.imencode(".png", units_from_depth(frame.depth_m, depth_factor), [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
    (folder / "rgb" / f"{name}.jpg").write_bytes(colour.tobytes())
    (folder / "depth" / f"{name}.png").write_bytes(depth.tobytes())
    return f"{name} rgb/{name}.jpg {name} depth/{name}.png\n"


def calibration_text(camera: CameraIntrinsics, depth_factor: float) -> str:
    """Return what ``calib.txt`` says of a camera."""
    lines = [f"fx {camera.fx_px!r}", f"fy {camera.fy_px!r}", f"cx {camera.cx_px!r}", f"cy {camera.cy_px!r}"]
    lines += [f"{name} {value!r}" for name, value in zip(_DISTORTION_NAMES, camera.distortion, strict=False)]
    return "\n".join([*lines, f"depth_factor {depth_factor!r}"]) + "\n"


def gravity_line(stamp_s: float, gravity: FloatArray) -> str:
    """Return the line of ``gravity.txt`` for a unit vector (3,)."""
    return f"{stamp_s:.6f} " + " ".join(f"{value:.6f}" for value in gravity) + "\n"


def mark_line(mark: Mark) -> str:
    """Return the line of ``marks.txt``."""
    return f"{mark.stamp_s:.6f} {mark.kind} {mark.name}\n"


class RecordingWriter:
    """Writes frames as a recording; ``close`` writes the tables, so an interrupted recording is seen as such."""

    def __init__(
        self,
        folder: Path,
        intrinsics: CameraIntrinsics,
        depth_factor: float = 1000.0,
        fisheye: FisheyeCamera | None = None,
    ) -> None:
        self._folder = folder
        self._fisheye = None if fisheye is None else FisheyeWriter(folder, fisheye)
        self._intrinsics = intrinsics
        self._depth_factor = depth_factor
        self._lines: list[str] = []
        self._truth: list[tuple[float, Transform]] = []
        self._gravity: list[str] = []
        self._marks: list[Mark] = []
        (folder / "rgb").mkdir(parents=True, exist_ok=True)
        (folder / "depth").mkdir(parents=True, exist_ok=True)

    def add(self, frame: Frame, world_from_camera: Transform | None = None) -> None:
        """Write one frame, and its true pose where it is known (a simulator's, a motion-capture system's)."""
        self._lines.append(write_pictures(self._folder, frame, self._depth_factor))
        if frame.gravity is not None:
            self._gravity.append(gravity_line(frame.stamp_s, frame.gravity))
        if self._fisheye is not None and frame.fisheye is not None:
            self._fisheye.add(frame.fisheye)
        if world_from_camera is not None:
            self._truth.append((frame.stamp_s, world_from_camera))

    def mark(self, mark: Mark) -> None:
        """Note that a place was named."""
        self._marks.append(mark)

    def close(self) -> None:
        """Write calibration, associations and, where poses were given, the ground truth."""
        calibration = calibration_text(self._intrinsics, self._depth_factor)
        (self._folder / "calib.txt").write_text(calibration, encoding="utf-8")
        (self._folder / "associations.txt").write_text("".join(self._lines), encoding="utf-8")
        if self._fisheye is not None:
            self._fisheye.close()
        if self._gravity:
            (self._folder / "gravity.txt").write_text("".join(self._gravity), encoding="utf-8")
        if self._marks:
            marks = "".join(mark_line(mark) for mark in self._marks)
            (self._folder / "marks.txt").write_text(marks, encoding="utf-8")
        if self._truth:
            write_trajectory(self._folder / "groundtruth.txt", self._truth, "world from camera")


def _read_associations(folder: Path) -> tuple[RecordedFrame, ...]:
    path = folder / "associations.txt"
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read: a recording needs lines of 't_rgb rgb t_depth depth'.") from error
    entries: list[RecordedFrame] = []
    for number, line in enumerate(lines, 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if len(words) != 4 or "\0" in line or not (is_number(words[0]) and is_number(words[2])):
            raise RecordingError(f"{path}, line {number}: expected 't_rgb rgb t_depth depth', found {line.strip()!r}.")
        colour, depth = folder / words[1], folder / words[3]
        for file in (colour, depth):
            if not is_inside(file, folder):
                raise RecordingError(f"{path}, line {number}: {file} lies outside the recording; use paths inside it.")
        entries.append(RecordedFrame(float(words[0]), colour, depth))
    if not entries:
        raise RecordingError(f"{path} lists no frames: record again.")
    if any(later.stamp_s <= earlier.stamp_s for earlier, later in itertools.pairwise(entries)):
        raise RecordingError(f"{path}: the times must grow from line to line; sort it by the first column.")
    return tuple(entries)


def _with_gravity(path: Path, entries: tuple[RecordedFrame, ...]) -> tuple[RecordedFrame, ...]:
    """Return the entries with what ``gravity.txt`` says of them, where there is one. Raises RecordingError."""
    if not path.exists():
        return entries
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read: write lines of 't x y z' in UTF-8.") from error
    found: dict[float, tuple[float, float, float]] = {}
    for number, line in enumerate(lines, 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if len(words) != 4 or not all(is_number(word) for word in words):
            raise RecordingError(f"{path}, line {number}: expected 't x y z', found {line.strip()!r}.")
        stamp_s, x, y, z = (float(word) for word in words)
        length = math.hypot(x, y, z)
        if not 0.99 <= length <= 1.01:
            raise RecordingError(f"{path}, line {number}: {line.strip()!r} is no unit vector: record again.")
        found[stamp_s] = x / length, y / length, z / length
    return tuple(replace(entry, gravity=found.get(entry.stamp_s)) for entry in entries)
