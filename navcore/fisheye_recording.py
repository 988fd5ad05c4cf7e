"""The second, wide camera of a recording: its pictures, when they were taken, and how it is mounted.

The layout is described in :mod:`navcore.recording`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from navcore.errors import InputError, RecordingError
from navcore.geometry import Transform
from navcore.recorded_files import is_inside, is_number, read_image, read_values
from navcore.types import FisheyeCamera, FisheyeImage, FisheyeIntrinsics

MAX_FISHEYE_GAP_S = 0.05
"""A fisheye picture belongs to a frame that was taken at most this much earlier or later."""
_FISHEYE_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "max_angle_deg")
_SIZE_NAMES = ("width", "height")
_MOUNTING_NAMES = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")


@dataclass(frozen=True, slots=True)
class FisheyePicture:
    """Where one picture of the fisheye camera lies on disk, and when it was taken."""

    stamp_s: float
    path: Path


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeRecording:
    """What the fisheye camera contributed to a recording."""

    camera: FisheyeCamera
    pictures: tuple[FisheyePicture, ...]

    def nearest(self, stamp_s: float) -> FisheyePicture | None:
        """Return the picture that was taken nearest to a time, or None where that is more than the gap away."""
        picture = min(self.pictures, key=lambda p: abs(p.stamp_s - stamp_s))
        return picture if abs(picture.stamp_s - stamp_s) <= MAX_FISHEYE_GAP_S else None

    def read(self, picture: FisheyePicture) -> FisheyeImage:
        """Read one picture. Raises RecordingError where it is missing, damaged or of another size."""
        grey = read_image(picture.path, cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise _missing(picture)
        lens = self.camera.intrinsics
        if grey.shape != (lens.height_px, lens.width_px):
            raise RecordingError(
                f"{picture.path} is {grey.shape[1]}×{grey.shape[0]} pixels, but the recording's fisheye pictures are"
                f" {lens.width_px}×{lens.height_px}: use the pictures of one camera."
            )
        return FisheyeImage(picture.stamp_s, np.ascontiguousarray(grey, dtype=np.uint8), self.camera)


def open_fisheye(folder: Path) -> FisheyeRecording | None:
    """Open the fisheye part of a recording; None where it has none. Raises RecordingError."""
    table = folder / "fisheye.txt"
    if not table.exists():
        return None
    pictures = _read_pictures(folder, table)
    first = read_image(pictures[0].path, cv2.IMREAD_GRAYSCALE)
    if first is None:
        raise _missing(pictures[0])
    camera = read_fisheye_calibration(folder / "fisheye_calib.txt", first.shape[1], first.shape[0])
    return FisheyeRecording(camera, pictures)


def _missing(picture: FisheyePicture) -> RecordingError:
    return RecordingError(f"{picture.path} is missing or damaged: record again, or remove its line from fisheye.txt.")


def read_fisheye_calibration(path: Path, width_px: int, height_px: int) -> FisheyeCamera:
    """Read ``fisheye_calib.txt`` of pictures of a size. Raises RecordingError."""
    values = read_values(path, "a fisheye camera needs a calibration with fx fy cx cy k1 k2 k3 k4 and its mounting")
    for name in (*_FISHEYE_NAMES, *_MOUNTING_NAMES):
        if name not in values:
            raise RecordingError(f"{path} has no {name}: write a line with the name and its value.")
    try:
        fx, fy, cx, cy, k1, k2, k3, k4, max_angle_deg = (values[name] for name in _FISHEYE_NAMES)
        lens = FisheyeIntrinsics(width_px, height_px, fx, fy, cx, cy, k1, k2, k3, k4, math.radians(max_angle_deg))
        mounting = np.array([values[name] for name in _MOUNTING_NAMES])
        return FisheyeCamera(lens, Transform.from_quat_xyzw(mounting[3:], mounting[:3]))
    except InputError as error:
        raise RecordingError(f"{path}: {error}") from error
    except ValueError as error:
        raise RecordingError(f"{path}: {error}; calibrate the camera again.") from error


def read_fisheye_camera(path: Path) -> FisheyeCamera:
    """Read the calibration of a camera that is not in a recording: it also says ``width`` and ``height``, pixels.

    Raises RecordingError.
    """
    values = read_values(path, "a fisheye camera needs a calibration with its picture's width and height")
    for name in _SIZE_NAMES:
        if not 16 <= values.get(name, 0.0) <= 10_000:
            raise RecordingError(
                f"{path} has no {name} of 16 to 10000: write a line with the picture's {name}, pixels."
            )
    return read_fisheye_calibration(path, round(values["width"]), round(values["height"]))


def _read_pictures(folder: Path, path: Path) -> tuple[FisheyePicture, ...]:
    """Read ``fisheye.txt``: the stamp and the file of every fisheye picture."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read: write lines of 't fisheye/name' in UTF-8.") from error
    pictures: list[FisheyePicture] = []
    for number, line in enumerate(lines, 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if len(words) != 2 or "\0" in line or not is_number(words[0]):
            raise RecordingError(f"{path}, line {number}: expected 't fisheye/name', found {line.strip()!r}.")
        file = folder / words[1]
        if not is_inside(file, folder):
            raise RecordingError(f"{path}, line {number}: {file} lies outside the recording; use paths inside it.")
        pictures.append(FisheyePicture(float(words[0]), file))
    if not pictures:
        raise RecordingError(f"{path} lists no pictures: remove it, or record again.")
    return tuple(pictures)


def write_fisheye_picture(folder: Path, image: FisheyeImage) -> str:
    """Write a fisheye picture into a recording; return its line of ``fisheye.txt``. Raises OSError."""
    name = f"{image.stamp_s:.6f}"
    grey = cv2.imencode(".jpg", image.grey, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
    (folder / "fisheye" / f"{name}.jpg").write_bytes(grey.tobytes())
    return f"{name} fisheye/{name}.jpg\n"


class FisheyeWriter:
    """Writes the fisheye part of a recording; ``close`` writes its tables."""

    def __init__(self, folder: Path, camera: FisheyeCamera) -> None:
        self._folder = folder
        self._camera = camera
        self._lines: list[str] = []
        (folder / "fisheye").mkdir(parents=True, exist_ok=True)

    def add(self, image: FisheyeImage) -> None:
        """Write one picture."""
        self._lines.append(write_fisheye_picture(self._folder, image))

    def close(self) -> None:
        """Write calibration and table, where there were pictures."""
        if self._lines:
            (self._folder / "fisheye_calib.txt").write_text(fisheye_calibration_text(self._camera), encoding="utf-8")
            (self._folder / "fisheye.txt").write_text("".join(self._lines), encoding="utf-8")


def fisheye_calibration_text(camera: FisheyeCamera) -> str:
    """Return what ``fisheye_calib.txt`` says of a camera."""
    lens, mounting = camera.intrinsics, camera.fisheye_from_camera
    max_angle_deg = math.degrees(lens.max_angle_rad)
    optics = (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion, max_angle_deg)
    place = [*mounting.translation.tolist(), *mounting.quat_xyzw.tolist()]
    size = (float(lens.width_px), float(lens.height_px))
    lines = [f"{name} {value!r}" for name, value in zip(_FISHEYE_NAMES, optics, strict=True)]
    lines += [f"{name} {value!r}" for name, value in zip(_MOUNTING_NAMES, place, strict=True)]
    lines += [f"{name} {value!r}" for name, value in zip(_SIZE_NAMES, size, strict=True)]
    return "\n".join(lines) + "\n"
