"""A site whose form is real, and whose map is too small to be found in."""

from __future__ import annotations

import numpy as np

from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.site import Site
from navcore.types import CameraIntrinsics


def small_site() -> Site:
    """Return a site of a few points, two places and a road."""
    rng = np.random.default_rng(3)
    road = np.stack([np.linspace(0.0, 6.0, 61), np.zeros(61), np.full(61, 1.6)], axis=1)
    graph = PoiGraph(
        version=1,
        pois={"a": Poi("a", "Hall", "hall", 0.0, 0.0), "b": Poi("b", "Bar", "bar", 6.0, 0.0)},
        edges={"a-b": Edge("a-b", "a", "b", ((0.0, 0.0), (6.0, 0.0)), 6.0)},
    )
    return Site(
        site_id="small", name="Small site", intrinsics=CameraIntrinsics(320, 240, 230.0, 230.0, 160.0, 120.0),
        map_arrays={
            "keyframe_poses": np.tile(np.eye(4), (2, 1, 1)), "descriptors": rng.integers(0, 256, (5, 32), np.uint8)
        },
        roads_m=(road,), cloud_points_m=rng.normal(size=(50, 3)).astype(np.float32),
        cloud_colours_rgb=rng.integers(0, 256, (50, 3)).astype(np.uint8), poi_graph=graph, report={"keyframes": 2},
    )  # fmt: skip
