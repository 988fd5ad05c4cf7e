"""Our values as Foxglove's messages, so that its panels, and Lichtblick's, show them without any help.

Conventions: the frame ``map`` is the site's (metres, z up); ``walker`` stands on its floor below the camera, x ahead;
``camera`` and ``fisheye`` are optical frames (x right, y down, z forward). Stamps are the device's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from navcore.angles import in_world
from navcore.errors import InputError
from navcore.geometry import Transform, rotation_about_z
from navcore.planning.poi_graph import PoiGraph
from navcore.recording import depth_from_units, units_from_depth
from navcore.types import (
    Action,
    CameraIntrinsics,
    DepthImage,
    FisheyeCamera,
    Guidance,
    ImageGrey,
    ImageRgb,
    Localization,
    ObstacleScan,
    Route,
)
from navcore.walk_file import NS_PER_S

MAP, WALKER, CAMERA, FISHEYE = "map", "walker", "camera", "fisheye"
_MM_PER_M = 1000.0
_ABOVE_FLOOR_M = 0.02
"""Lines lie a little above the floor, so that a grid drawn there does not hide them."""
_ROAD = Color(r=0.4, g=0.6, b=1.0, a=0.8)
_WAY = Color(r=0.2, g=0.9, b=0.3, a=1.0)
_PLACE = Color(r=1.0, g=1.0, b=1.0, a=1.0)
_ADVICE = {
    Action.WALK: Color(r=0.2, g=0.9, b=0.3, a=1.0),
    Action.TURN: Color(r=1.0, g=0.8, b=0.1, a=1.0),
    Action.STOP: Color(r=1.0, g=0.2, b=0.2, a=1.0),
}


def nanoseconds(stamp_s: float) -> int:
    """Return a stamp as MCAP has it; what is no time, or before its beginning, is its beginning."""
    return max(0, round(stamp_s * NS_PER_S)) if math.isfinite(stamp_s) else 0


def timestamp(stamp_s: float) -> Timestamp:
    """Return a stamp as protobuf has it."""
    seconds, nanos = divmod(nanoseconds(stamp_s), NS_PER_S)
    return Timestamp(seconds=seconds, nanos=nanos)


# --------------------------------------------------------------------------------------------------- pictures
def picture(stamp_s: float, frame_id: str, pixels: ImageRgb | ImageGrey) -> RawImage:
    """Return a colour (h, w, 3) or grey (h, w) picture as it is.

    PNG would be two thirds of it after the file's own packing, and take the processor twenty times as long, which the
    loop needs more than the disk needs the room.
    """
    return _raw(stamp_s, frame_id, pixels, "rgb8" if pixels.ndim == 3 else "mono8")


def pixels_of(image: RawImage) -> NDArray[np.uint8]:
    """Return the pixels of a picture, (h, w, 3) red first, or (h, w) grey. Raises InputError."""
    channels = {"rgb8": (3,), "mono8": ()}.get(image.encoding)
    return _values(image, "u1", channels).astype(np.uint8)


def depth_image(stamp_s: float, depth_m: DepthImage) -> RawImage:
    """Return depths (h, w), metres, without loss: as whole millimetres where they are that, else as they are."""
    millimetres = units_from_depth(depth_m, _MM_PER_M)
    if np.array_equal(depth_from_units(millimetres, _MM_PER_M), depth_m, equal_nan=True):
        return _raw(stamp_s, CAMERA, millimetres.astype("<u2"), "16UC1")
    return _raw(stamp_s, CAMERA, depth_m.astype("<f4"), "32FC1")


def depths_of(image: RawImage) -> DepthImage:
    """Return the depths (h, w), metres. Raises InputError."""
    if image.encoding == "16UC1":
        return depth_from_units(_values(image, "<u2", ()).astype(np.uint16), _MM_PER_M)
    return _values(image, "<f4", () if image.encoding == "32FC1" else None).astype(np.float32)


def _raw(stamp_s: float, frame_id: str, values: NDArray[Any], encoding: str) -> RawImage:
    height, width = values.shape[:2]
    return RawImage(
        timestamp=timestamp(stamp_s), frame_id=frame_id, width=width, height=height, encoding=encoding,
        step=values.nbytes // max(1, height), data=values.tobytes(),
    )  # fmt: skip


def _values(image: RawImage, dtype: str, channels: tuple[int, ...] | None) -> NDArray[Any]:
    try:
        if channels is None:
            raise ValueError(image.encoding)
        return np.frombuffer(image.data, dtype).reshape(image.height, image.width, *channels)
    except ValueError as error:
        raise InputError(
            "A picture of the recording is damaged: replay it without --site, from poses and scans."
        ) from error


def calibration(stamp_s: float, camera: CameraIntrinsics) -> CameraCalibration:
    """Return a pinhole camera; depth is registered to its ideal picture, as P says."""
    matrix = camera.matrix
    distortion = camera.distortion or (0.0,) * 5
    return CameraCalibration(
        timestamp=timestamp(stamp_s), frame_id=CAMERA, width=camera.width_px, height=camera.height_px,
        distortion_model="plumb_bob", D=distortion, K=matrix.ravel(), R=np.eye(3).ravel(),
        P=np.column_stack([matrix, np.zeros(3)]).ravel(),
    )  # fmt: skip


def fisheye_calibration(stamp_s: float, camera: FisheyeCamera) -> CameraCalibration:
    """Return a fisheye lens after Kannala and Brandt."""
    lens = camera.intrinsics
    matrix = np.array([[lens.fx_px, 0.0, lens.cx_px], [0.0, lens.fy_px, lens.cy_px], [0.0, 0.0, 1.0]])
    return CameraCalibration(
        timestamp=timestamp(stamp_s), frame_id=FISHEYE, width=lens.width_px, height=lens.height_px,
        distortion_model="kannala_brandt", D=lens.distortion, K=matrix.ravel(), R=np.eye(3).ravel(),
        P=np.column_stack([matrix, np.zeros(3)]).ravel(),
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------ places
def transforms(located: Localization, fisheye: FisheyeCamera | None) -> FrameTransforms | None:
    """Return map → walker → camera (→ fisheye); None where the pose is lost."""
    map_from_camera = located.world_from_camera
    map_from_walker = _map_from_walker(located)
    if map_from_camera is None or map_from_walker is None:
        return None
    steps = [
        _step(located.stamp_s, MAP, WALKER, map_from_walker),
        _step(located.stamp_s, WALKER, CAMERA, map_from_walker.inverse() @ map_from_camera),
    ]
    if fisheye is not None:
        steps.append(_step(located.stamp_s, CAMERA, FISHEYE, fisheye.fisheye_from_camera.inverse()))
    return FrameTransforms(transforms=steps)


def pose(located: Localization) -> PoseInFrame | None:
    """Return where the camera is; None where the pose is lost."""
    if located.world_from_camera is None:
        return None
    return PoseInFrame(timestamp=timestamp(located.stamp_s), frame_id=MAP, pose=_pose(located.world_from_camera))


def obstacles(stamp_s: float, scan: ObstacleScan) -> LaserScan | None:
    """Return the nearest distances, inf where free, NaN where unknown; None where the scan has no two bearings.

    Foxglove's bearings are evenly spaced, those of a scan may have gaps: these are unknown there.
    """
    bearing_rad, nearest_m = scan.bearing_rad, scan.nearest_m
    if len(bearing_rad) < 2:
        return None
    step_rad = max(float(np.diff(bearing_rad).min()), math.radians(0.1))
    count = round(float(bearing_rad[-1] - bearing_rad[0]) / step_rad) + 1
    ranges = np.full(count, np.nan)
    ranges[np.round((bearing_rad - bearing_rad[0]) / step_rad).astype(int)] = nearest_m
    return LaserScan(
        timestamp=timestamp(stamp_s), frame_id=WALKER, pose=_pose(Transform.identity()),
        start_angle=float(bearing_rad[0]), end_angle=float(bearing_rad[0]) + (count - 1) * step_rad, ranges=ranges,
    )  # fmt: skip


def road(stamp_s: float, graph: PoiGraph) -> SceneUpdate:
    """Return the PoI-graph: its edges as lines, its PoIs as spheres with their names."""
    places = [(poi.name, poi.x_m, poi.y_m) for poi in graph.pois.values()]
    lines = [_line(edge.path_m, _ROAD, 0.05) for edge in graph.edges.values()]
    return _scene(stamp_s, MAP, "road", lines=lines, spheres=_spheres(places), texts=_texts(places))


def route(stamp_s: float, way: Route | None) -> SceneUpdate:
    """Return the way that is walked; nothing where nobody is led."""
    if way is None:
        return _scene(stamp_s, MAP, "route")
    return _scene(stamp_s, MAP, "route", lines=[_line(way.points_m.tolist(), _WAY, 0.1)])


def advice(guidance: Guidance) -> SceneUpdate:
    """Return the sub-goal, and an arrow in the direction of guidance, red and upright where it is *stop*."""
    trace, colour = guidance.trace, _ADVICE[guidance.action]
    if trace.position is None or trace.heading is None:
        return _scene(guidance.stamp_s, MAP, "guidance")
    goal = trace.sub_goal
    spheres = [] if goal is None else [_sphere(goal.x_m, goal.y_m, 0.2, colour)]
    if guidance.direction is None:
        rotation = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    else:
        rotation = rotation_about_z(in_world(guidance.direction, trace.heading))
    at = Transform.from_rotation_translation(rotation, np.array([*trace.position, _ABOVE_FLOOR_M]))
    arrow = ArrowPrimitive(
        pose=_pose(at), shaft_length=0.6, shaft_diameter=0.06, head_length=0.2, head_diameter=0.16, color=colour
    )
    return _scene(guidance.stamp_s, MAP, "guidance", spheres=spheres, arrows=[arrow])


def log(stamp_s: float, name: str, text: str, *, warning: bool = False) -> Log:
    """Return a line of the log."""
    level = Log.WARNING if warning else Log.INFO
    return Log(timestamp=timestamp(stamp_s), level=level, message=text, name=name)


def _map_from_walker(located: Localization) -> Transform | None:
    where = located.pose
    if where is None:
        return None
    return Transform.from_rotation_translation(rotation_about_z(where.heading), np.array([where.x_m, where.y_m, 0.0]))


def _step(stamp_s: float, parent: str, child: str, parent_from_child: Transform) -> FrameTransform:
    placed = _pose(parent_from_child)
    return FrameTransform(
        timestamp=timestamp(stamp_s), parent_frame_id=parent, child_frame_id=child,
        translation=placed.position, rotation=placed.orientation,
    )  # fmt: skip


def _pose(a_from_b: Transform) -> Pose:
    x, y, z = a_from_b.translation.tolist()
    qx, qy, qz, qw = a_from_b.quat_xyzw.tolist()
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def _at(x_m: float, y_m: float) -> Pose:
    return Pose(position=Vector3(x=x_m, y=y_m, z=_ABOVE_FLOOR_M), orientation=Quaternion(w=1.0))


def _line(points_m: Sequence[Sequence[float]], colour: Color, thickness_m: float) -> LinePrimitive:
    points = [Point3(x=point[0], y=point[1], z=_ABOVE_FLOOR_M) for point in points_m]
    return LinePrimitive(
        type=LinePrimitive.LINE_STRIP, pose=Pose(orientation=Quaternion(w=1.0)), thickness=thickness_m, points=points,
        color=colour,
    )  # fmt: skip


def _sphere(x_m: float, y_m: float, size_m: float, colour: Color) -> SpherePrimitive:
    return SpherePrimitive(pose=_at(x_m, y_m), size=Vector3(x=size_m, y=size_m, z=size_m), color=colour)


def _spheres(places: Iterable[tuple[str, float, float]]) -> list[SpherePrimitive]:
    return [_sphere(x_m, y_m, 0.15, _PLACE) for _, x_m, y_m in places]


def _texts(places: Iterable[tuple[str, float, float]]) -> list[TextPrimitive]:
    return [
        TextPrimitive(pose=_at(x_m, y_m), billboard=True, font_size=0.25, color=_PLACE, text=name)
        for name, x_m, y_m in places
    ]


def _scene(
    stamp_s: float,
    frame_id: str,
    key: str,
    *,
    lines: Sequence[LinePrimitive] = (),
    spheres: Sequence[SpherePrimitive] = (),
    texts: Sequence[TextPrimitive] = (),
    arrows: Sequence[ArrowPrimitive] = (),
) -> SceneUpdate:
    """Return a scene of one entity; an empty one takes away what was shown before."""
    stamp = timestamp(stamp_s)
    if not (lines or spheres or texts or arrows):
        return SceneUpdate(deletions=[SceneEntityDeletion(timestamp=stamp, id=key)])
    entity = SceneEntity(
        timestamp=stamp, frame_id=frame_id, id=key, lines=lines, spheres=spheres, texts=texts, arrows=arrows
    )
    return SceneUpdate(entities=[entity])
