"""A small simulated building, quick to make: one room of 12 × 4 m, and a road from one end to the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from device_agent.simulation.building import Building, Place
from device_agent.simulation.sensors import head_camera
from device_agent.simulation.shapes import Piece, Solid, ceiling_quad, floor_quad, upright_quad
from device_agent.simulation.simulated_walk import simulated_walk
from navcore.geometry import Transform
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.recording import RecordingWriter
from navcore.site import Site
from navcore.slam.keyframes import SlamCamera
from navcore.slam.mapper import Mapper
from navcore.types import Frame

WEST_M, EAST_M, SOUTH_M, NORTH_M, HEIGHT_M = -1.0, 11.0, -2.0, 2.0, 2.7
START, END = Place("Start", "hall", 0.0, 0.0), Place("End", "bar", 9.0, 0.0)


def small_room() -> Building:
    """Return the room."""
    corners = [(WEST_M, SOUTH_M), (WEST_M, NORTH_M), (EAST_M, NORTH_M), (EAST_M, SOUTH_M)]
    textures = ("brick/west", "poster/north", "notice/east", "poster/south")
    walls = [
        upright_quad(corners[index], corners[(index + 1) % 4], 0.0, HEIGHT_M, textures[index]) for index in range(4)
    ]
    middle_x, middle_y = (WEST_M + EAST_M) / 2, (SOUTH_M + NORTH_M) / 2
    long_side, short_side = (EAST_M - WEST_M) / 2, (NORTH_M - SOUTH_M) / 2
    solids = (
        Solid("west wall", WEST_M - 0.1, middle_y, 0.1, short_side),
        Solid("east wall", EAST_M + 0.1, middle_y, 0.1, short_side),
        Solid("south wall", middle_x, SOUTH_M - 0.1, long_side, 0.1),
        Solid("north wall", middle_x, NORTH_M + 0.1, long_side, 0.1),
    )
    inside = Piece(
        (
            *walls,
            floor_quad(WEST_M, SOUTH_M, EAST_M, NORTH_M, 0.0, "terrazzo"),
            ceiling_quad(WEST_M, SOUTH_M, EAST_M, NORTH_M, HEIGHT_M, "ceiling"),
        ),
        solids,
    )
    return Building(
        "the room", {place.name: place for place in (START, END)}, inside.surfaces, inside.solids, (),
        ((2.0, 0.0, HEIGHT_M - 0.05), (7.0, 0.0, HEIGHT_M - 0.05)), ((0.0, 0.0), (9.0, 0.0), (0.0, 0.0)),
    )  # fmt: skip


WALK_M = 4.0


def record_room(folder: Path) -> tuple[list[Frame], list[Transform]]:
    """Record a sighted person's walk along the first four metres; return its frames and their true poses."""
    building = small_room()
    writer = RecordingWriter(folder, head_camera(320, 240))
    frames, poses = [], []
    for frame, pose in simulated_walk(building, seed=0, rate_hz=10.0, max_length_m=WALK_M):
        writer.add(frame, pose)
        frames.append(frame)
        poses.append(pose)
    writer.close()
    return frames, poses


def map_room(frames: list[Frame], poses: list[Transform]) -> Site:
    """Build the room's site from a recorded walk, by SLAM; its PoIs are named by hand, at both ends of the road.

    To keep this quick, the frame of reference is put where it belongs by the true pose of the first frame.
    """
    intrinsics = head_camera(320, 240)
    mapper = Mapper(intrinsics, SlamCamera.of(intrinsics, 0.08 * intrinsics.fx_px), 700)
    for frame in frames:
        mapper.add(frame)
    world_from_map = poses[0].matrix
    slam_map = mapper.finish().transformed(world_from_map)
    path = np.array([(world_from_map @ map_from_camera)[:2, 3] for _, map_from_camera in mapper.trajectory()])
    along_m = np.arange(path[0, 0], path[-1, 0], 0.1)
    points = np.column_stack([along_m, np.interp(along_m, path[:, 0], path[:, 1]), np.zeros(len(along_m))])
    line = tuple((float(x), float(y)) for x, y, _ in points)
    graph = PoiGraph(
        1,
        {
            "start": Poi("start", "Start", "hall", *line[0]),
            "end": Poi("end", "Far end", "bar", *line[-1]),
            "attic": Poi("attic", "Attic", "room", 0.0, 50.0),
        },
        {"road": Edge("road", "start", "end", line, line[-1][0] - line[0][0])},
    )
    empty = np.zeros((0, 3))
    return Site(
        "room", "The room", intrinsics, slam_map.to_arrays(), (points,), empty.astype(np.float32),
        empty.astype(np.uint8), graph,
    )  # fmt: skip
