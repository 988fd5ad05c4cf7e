"""The pure parts of the scene: what of the cloud is shown, cameras, paths, meshes, labels."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from viewer_site import crossing_corridors, crossing_roads

from console.viewer import meshes
from console.viewer.appearance import KINDS
from console.viewer.cloud import FOV_RAD, CameraView, FloorBounds, floor_bounds, overview, plan_view, shown_cloud
from console.viewer.cloud_colours import (
    Colouring,
    LocalizationGrade,
    by_height,
    by_localization,
    grades,
    legend,
    shaded,
)
from console.viewer.labels import LabelSpot, Lens, project, readable
from navcore.geometry import FloatArray, quat_xyzw_from_rotation, rotation_from_quat_xyzw
from navcore.planning.poi_graph import POI_KINDS


def lens_of(view: CameraView, aspect: float, height_px: float = 800.0) -> Lens:
    position, target = np.array(view.position_m), np.array(view.look_at_m)
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    x, y, z, w = quat_xyzw_from_rotation(np.column_stack([right, np.cross(forward, right), forward]))
    return Lens(position, np.array([w, x, y, z]), FOV_RAD, aspect * height_px, height_px)


# ------------------------------------------------------------------------------------------------------ the cloud
def test_a_large_cloud_is_thinned_and_says_so() -> None:
    site = crossing_corridors(5000)
    cloud = shown_cloud(site.cloud_points_m, site.cloud_colours_rgb, max_count=1000)
    assert 700 < cloud.shown_count <= 1000, "cleaned as well"
    assert f"{cloud.shown_count:,} of 5,000" in cloud.sentence
    whole = shown_cloud(site.cloud_points_m, site.cloud_colours_rgb)
    assert whole.sentence == "5,000 points"


def test_the_ceiling_is_a_layer_of_its_own_and_nothing_is_lost() -> None:
    site = crossing_corridors(5000)
    cloud = shown_cloud(site.cloud_points_m, site.cloud_colours_rgb, ceiling_m=2.2)
    (below,), (above,) = cloud.parts, cloud.ceiling_parts
    assert below.points_m[:, 2].max() <= 2.2 < above.points_m[:, 2].min()
    assert cloud.shown_count == 5000
    assert len(below.points_m) == len(below.colours_rgb)


def test_a_cloud_comes_coarse_first_and_every_part_is_spread_over_all_of_it() -> None:
    points = np.random.default_rng(0).uniform(0.0, 2.0, (400_000, 3)).astype(np.float32)
    points[:, 0] += np.linspace(0.0, 100.0, 400_000, dtype=np.float32)
    cloud = shown_cloud(points, np.zeros((400_000, 3), np.uint8))
    assert [len(part.points_m) for part in cloud.parts] == [80_000, 150_000, 150_000, 20_000]
    assert [part.name for part in cloud.parts[:2]] == ["/map/cloud/points", "/map/cloud/points1"]
    for part in cloud.parts:
        counts, _ = np.histogram(part.points_m[:, 0], bins=10, range=(0.0, 102.0))
        assert counts.min() > 0.8 * len(part.points_m) / 10
    together = np.vstack([part.points_m for part in cloud.parts])
    assert np.array_equal(np.sort(together, axis=0), np.sort(points, axis=0)), "nothing is lost or shown twice"


# ------------------------------------------------------------------------------------------------- the cloud's colours
def keyframes(places_m: list[tuple[float, float]], landmarks_count: int, std_m: float) -> dict[str, Any]:
    """The arrays of a map whose key frames stood at these places of the floor, each seeing so many landmarks."""
    count = len(places_m)
    camera_from_world = np.tile(np.eye(4), (count, 1, 1))
    camera_from_world[:, :2, 3] = -np.array(places_m).reshape(-1, 2)
    return {
        "camera_from_world": camera_from_world,
        "feature_start": np.arange(count + 1, dtype=np.int64) * (landmarks_count + 5),
        "feature_landmark": np.tile([*range(landmarks_count), -1, -1, -1, -1, -1], count).astype(np.int32),
        "keyframe_covariance": np.tile(np.eye(6) * std_m**2 / 3, (count, 1, 1)),
    }


@pytest.mark.parametrize(
    ("landmarks_count", "std_m", "grade"),
    [
        (300, 0.02, LocalizationGrade.GOOD), (90, 0.02, LocalizationGrade.FAIR), (30, 0.02, LocalizationGrade.POOR),
        (300, 0.5, LocalizationGrade.POOR),
    ],
)  # fmt: skip
def test_localization_is_graded_by_landmarks_and_certainty(
    landmarks_count: int, std_m: float, grade: LocalizationGrade
) -> None:
    arrays = keyframes([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)], landmarks_count, std_m)
    assert list(grades(np.array([[0.3, 0.3], [50.0, 0.0]]), arrays)) == [grade, LocalizationGrade.UNKNOWN]


def test_of_a_map_without_key_frames_nothing_is_known() -> None:
    assert list(grades(np.zeros((2, 2)), {})) == [LocalizationGrade.UNKNOWN] * 2
    assert list(grades(np.zeros((2, 2)), keyframes([], 10, 0.1))) == [LocalizationGrade.UNKNOWN] * 2


def test_colours_by_height_rise_from_the_floor_in_brightness() -> None:
    heights = np.column_stack([np.zeros(20), np.zeros(20), np.linspace(0.0, 2.2, 20)]).astype(np.float32)
    brightness = by_height(heights).astype(float) @ (0.2126, 0.7152, 0.0722)
    assert (np.diff(brightness) > 0).all()


def test_shading_darkens_and_keeps_the_order_of_the_channels() -> None:
    seen = np.array([[0, 0, 0], [255, 255, 255]], np.uint8)
    dark, bright = shaded(np.array([[200, 100, 50]] * 2, np.uint8), seen)
    assert tuple(bright) == pytest.approx((200, 100, 50), abs=1)
    assert (dark < bright).all()
    assert list(np.argsort(dark)) == list(np.argsort(bright))


def test_each_colouring_but_the_seen_one_has_a_legend() -> None:
    assert legend(Colouring.SEEN) == ()
    shown = {tuple(colour) for colour in by_localization(np.zeros((1, 3), np.float32), {})}
    assert shown <= {colour for colour, _ in legend(Colouring.LOCALIZATION)}
    assert len(legend(Colouring.HEIGHT)) > 3


# --------------------------------------------------------------------------------------------------------- the road
@given(
    st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=2, max_size=12).filter(
        lambda path: all(math.dist(a, b) > 0.5 for a, b in itertools.pairwise(path))
    )
)
@settings(max_examples=60, deadline=None)
def test_a_band_lies_on_its_path_and_no_corner_sticks_out_far(path: list[tuple[float, float]]) -> None:
    mesh = meshes.ribbon([np.array(path)], 0.4)
    left, right = mesh.vertices_m[::2, :2], mesh.vertices_m[1::2, :2]
    assert np.allclose((left + right) / 2, np.array(path), atol=1e-9)
    assert float(np.linalg.norm(left - right, axis=1).max()) <= 0.4 * 4.0 + 1e-9
    assert mesh.faces.max() < len(mesh.vertices_m)
    assert len(mesh.faces) == 2 * (len(path) - 1)


def test_points_that_are_no_numbers_are_left_out() -> None:
    points = np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [1.0, np.inf, 0.0]], dtype=np.float32)
    assert shown_cloud(points, np.zeros((3, 3), np.uint8)).shown_count == 1


def test_an_empty_site_has_a_floor_to_look_at() -> None:
    nothing = np.zeros((0, 3), dtype=np.float32)
    assert shown_cloud(nothing, np.zeros((0, 3), np.uint8)).shown_count == 0
    assert floor_bounds(nothing, ()).width_m > 0


def test_the_floor_holds_the_road_and_few_strays_do_not_stretch_it() -> None:
    site = crossing_corridors(5000)
    strays = np.vstack([site.cloud_points_m, [[900.0, 900.0, 0.0]] * 5]).astype(np.float32)
    bounds = floor_bounds(strays, site.roads_m)
    assert bounds.width_m < 25.0
    for road in crossing_roads():
        assert bounds.x_min_m < road[:, 0].min() <= road[:, 0].max() < bounds.x_max_m


# ------------------------------------------------------------------------------------------------------- cameras
@given(
    width_m=st.floats(3.0, 200.0), depth_m=st.floats(3.0, 200.0), aspect=st.floats(0.9, 2.4),
    x_m=st.floats(-50.0, 50.0), above=st.booleans(), covered=st.floats(0.0, 0.3),
)  # fmt: skip
@settings(deadline=None, max_examples=80)
def test_the_first_view_holds_the_whole_floor_clear_of_the_panel(
    width_m: float, depth_m: float, aspect: float, x_m: float, above: bool, covered: float
) -> None:
    bounds = FloorBounds(x_m, 0.0, x_m + width_m, depth_m)
    lens = lens_of((plan_view if above else overview)(bounds, aspect, covered), aspect)
    corners = np.array([[x, y, 0.0] for x in (bounds.x_min_m, bounds.x_max_m) for y in (0.0, depth_m)])
    pixels, depths = project(corners, lens)
    assert (depths > 0).all()
    assert (pixels >= 0).all()
    assert (pixels[:, 0] <= lens.width_px * (1.0 - covered)).all()
    assert (pixels[:, 1] <= lens.height_px).all()
    shares = (pixels.max(axis=0) - pixels.min(axis=0)) / np.array([lens.width_px * (1.0 - covered), lens.height_px])
    assert shares.max() > 0.4, "and not from farther than is needed"


# --------------------------------------------------------------------------------------------- paths and meshes
def wavy(count: int, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0.1, 0.1, (count, 2)), axis=0)


@given(count=st.integers(2, 60), seed=st.integers(0, 10_000))
@settings(deadline=None, max_examples=50)
def test_a_simplified_path_keeps_its_ends_and_stays_near(count: int, seed: int) -> None:
    path = wavy(count, seed)
    short = meshes.simplified(path, 0.05)
    assert (short[[0, -1]] == path[[0, -1]]).all()
    for point in path:
        assert min(_distance_m(point, a, b) for a, b in itertools.pairwise(short)) <= 0.05 + 1e-9


def _distance_m(point: FloatArray, a: FloatArray, b: FloatArray) -> float:
    chord = b - a
    share = np.clip((point - a) @ chord / max(chord @ chord, 1e-18), 0.0, 1.0)
    return float(np.linalg.norm(point - a - share * chord))


@given(count=st.integers(2, 40), seed=st.integers(0, 10_000))
@settings(deadline=None, max_examples=50)
def test_tubes_run_from_point_to_point(count: int, seed: int) -> None:
    path = wavy(count, seed)
    placed = meshes.along(path, 0.05, 0.1)
    half = placed.scales[:, 2:] / 2
    axes = np.array([rotation_from_quat_xyzw(q[[1, 2, 3, 0]])[:, 2] for q in placed.quats_wxyz])
    assert placed.positions_m - half * axes == pytest.approx(
        np.column_stack([path[:-1], [0.1] * (count - 1)]), abs=1e-9
    )
    assert placed.positions_m + half * axes == pytest.approx(np.column_stack([path[1:], [0.1] * (count - 1)]), abs=1e-9)


def test_a_direction_straight_down_has_a_turn_too() -> None:
    (quat,) = meshes.quats_from_z_to(np.array([[0.0, 0.0, -1.0]]))
    assert rotation_from_quat_xyzw(quat[[1, 2, 3, 0]])[:, 2] == pytest.approx([0, 0, -1])


def test_dashes_and_gaps_make_up_the_path() -> None:
    path = np.array([[0.0, 0.0], [10.0, 0.0]])
    pieces = meshes.dashes(path, 0.4, 0.6)
    assert sum(float(np.linalg.norm(p[1] - p[0])) for p in pieces) == pytest.approx(4.0)
    assert meshes.dashes(path[:1].repeat(2, axis=0), 0.4, 0.6) == []


def test_the_middle_of_a_path_is_half_way_along_it() -> None:
    assert meshes.middle_of(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0]])) == pytest.approx((3.0, 0.0))
    assert meshes.middle_of(np.array([[1.0, 2.0], [1.0, 2.0]])) == pytest.approx((1.0, 2.0))


@pytest.mark.parametrize(
    "mesh",
    [meshes.walker_body(), meshes.unit_cone(), meshes.unit_cylinder(), meshes.ring(1.0, 0.2),
     meshes.horizontal_cone(0.13, 1.0)],
)  # fmt: skip
def test_meshes_are_made_of_their_own_vertices(mesh: meshes.Mesh) -> None:
    assert mesh.faces.max() < len(mesh.vertices_m)
    assert np.isfinite(mesh.vertices_m).all()


def test_a_ray_meets_the_floor_where_it_should_and_never_behind_the_eye() -> None:
    assert meshes.floor_point((0, 0, 2), (1, 0, -1)) == pytest.approx((2.0, 0.0))
    assert meshes.floor_point((0, 0, 2), (1, 0, -1), z_m=1.0) == pytest.approx((1.0, 0.0))
    assert meshes.floor_point((0, 0, 2), (1, 0, 1)) is None
    assert meshes.floor_point((0, 0, 2), (1, 0, 0)) is None
    assert meshes.floor_point((0, 0, 2), (1, 0, -1e-5)) is None


# -------------------------------------------------------------------------------------------------------- labels
@given(seed=st.integers(0, 10_000), count=st.integers(1, 40))
@settings(deadline=None, max_examples=40)
def test_no_shown_label_covers_another_and_the_most_important_is_always_shown(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    lens = lens_of(overview(FloorBounds(0.0, -8.0, 20.0, 8.0), 1.5), 1.5)
    places = rng.uniform((0.0, -8.0, 0.0), (20.0, 8.0, 1.0), (count, 3))
    spots = [LabelSpot(str(i), "Room 3308", tuple(p), int(rng.integers(0, 5))) for i, p in enumerate(places)]  # type: ignore[arg-type]
    shown = readable(spots, lens)
    top = max(spot.importance for spot in spots)
    assert any(spot.key in shown for spot in spots if spot.importance == top)
    pixels, _ = project(places, lens)
    chosen = [pixels[int(key)] for key in shown]
    for i, a in enumerate(chosen):
        for b in chosen[i + 1 :]:
            assert abs(a[0] - b[0]) > 9 * 8.0 or abs(a[1] - b[1]) > 18.0


def test_labels_behind_the_camera_are_not_shown() -> None:
    lens = lens_of(CameraView((0.0, 0.0, 1.0), (10.0, 0.0, 1.0)), 1.5)
    spots = [LabelSpot("ahead", "A", (5.0, 0.0, 1.0), 1), LabelSpot("behind", "B", (-5.0, 0.0, 1.0), 2)]
    assert readable(spots, lens) == {"ahead"}


def test_every_kind_of_place_has_a_look_of_its_own() -> None:
    assert set(KINDS) == set(POI_KINDS)
    assert len({(look.colour, look.shape) for look in KINDS.values()}) == len(KINDS)
    assert len({look.word for look in KINDS.values()}) == len(KINDS)


def test_a_turn_about_the_vertical_points_the_walker_the_right_way() -> None:
    w, x, y, z = meshes.quat_about_z(math.radians(90))
    assert rotation_from_quat_xyzw(np.array([x, y, z, w])) @ [1, 0, 0] == pytest.approx([0, 1, 0])
