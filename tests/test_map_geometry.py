"""Geometry of the map: clouds made smaller and cleaner, floor, walls, clearance, and the floor plan."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from corridor_cloud import LENGTH_M, ROAD_M, WIDTH_M, box, corridor
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from console.map_geometry.clearance import REACH_M, path_clearance, place_clearance
from console.map_geometry.cloud_cleaning import (
    JUDGED_COUNT,
    evenly_thinned,
    one_per_voxel,
    shown_points,
    without_outliers,
)
from console.map_geometry.floor_levels import floor_levels
from console.map_geometry.floor_plan import FloorPlan, floor_plan
from console.map_geometry.floor_plan_svg import floor_plan_svg
from console.map_geometry.label_places import Label, label_boxes
from console.map_geometry.occupancy import Occupancy, occupancy_of
from console.map_geometry.plan_layout import MAX_SIDE_PX, PALETTES, PlanPlace, Theme
from console.map_geometry.survey import Survey, load_survey, save_survey
from console.map_geometry.wall_segments import wall_segments
from navcore.errors import InputError
from navcore.geometry import FloatArray
from navcore.map_check.clearance import Bound

CLOUD = corridor()


# ------------------------------------------------------------------------------------------------------ cleaning
@settings(max_examples=40, deadline=None)
@given(
    count=st.integers(0, 400),
    max_count=st.integers(1, 300),
    seed=st.integers(0, 99),
    extent_m=st.sampled_from([0.0, 0.01, 3.0, 5000.0]),
    gaps=st.integers(0, 5),
)
def test_a_thinned_cloud_is_a_part_of_the_cloud_and_no_more_than_was_asked_for(
    count: int, max_count: int, seed: int, extent_m: float, gaps: int
) -> None:
    rng = np.random.default_rng(seed)
    points = (rng.uniform(0.0, 1.0, (count, 3)) * extent_m).astype(np.float32)
    points[: min(gaps, count), 1] = np.nan
    kept = evenly_thinned(points, max_count)
    assert len(kept) <= max_count
    assert (np.diff(kept) > 0).all()
    assert np.isfinite(points[kept]).all()
    assert np.array_equal(kept, evenly_thinned(points, max_count))
    finite = max(0, count - gaps)
    assert bool(len(kept)) == bool(finite)
    if finite <= max_count:
        assert len(kept) == finite


def test_thinning_keeps_what_was_seen_once_and_thins_what_was_seen_often() -> None:
    rng = np.random.default_rng(1)
    sparse = rng.uniform((0.0, 0.0, 0.0), (10.0, 10.0, 0.0), (2_000, 3))
    dense = rng.uniform((20.0, 0.0, 0.0), (22.0, 2.0, 0.0), (50_000, 3))
    points = np.vstack([sparse, dense])
    kept = evenly_thinned(points, 1_000)
    assert len(kept) > 800
    of_dense = int((points[kept, 0] > 15.0).sum())
    # 4 of 104 m² are seen densely: by chance alone, 96 % of the points would be from there.
    assert of_dense < 0.2 * len(kept)
    # No place that has been seen is left bare.
    assert float(cKDTree(points[kept]).query(points)[0].max()) < 0.6


def test_points_by_themselves_go_and_surfaces_stay() -> None:
    stray = np.array([[6.0, 0.0, 1.2], [3.0, 0.5, 1.0], [14.0, 5.0, 7.0]])
    kept = without_outliers(np.vstack([CLOUD, stray]))
    assert not set(range(len(CLOUD), len(CLOUD) + 3)) & set(kept.tolist())
    assert len(kept) > 0.98 * len(CLOUD)


def test_points_by_themselves_go_from_a_large_cloud_too() -> None:
    rng = np.random.default_rng(2)
    large = np.repeat(CLOUD, 10, axis=0) + rng.normal(0.0, 0.01, (10 * len(CLOUD), 3))
    assert len(large) > JUDGED_COUNT
    stray = np.array([[6.0, 0.0, 1.2], [14.0, 5.0, 7.0]])
    kept = without_outliers(np.vstack([large, stray]))
    assert len(kept) == len(set(kept.tolist()) - {len(large), len(large) + 1})
    assert len(kept) > 0.98 * len(large)


def test_what_belongs_to_each_point_can_follow() -> None:
    colours = np.arange(len(CLOUD))
    kept = shown_points(CLOUD, 5_000)
    assert 3_500 < len(kept) <= 5_000
    assert np.array_equal(CLOUD[colours[kept]], CLOUD[kept])


def test_one_point_of_each_voxel() -> None:
    points = np.array([[0.01, 0.0, 0.0], [0.02, 0.0, 0.0], [0.11, 0.0, 0.0], [np.inf, 0.0, 0.0]])
    assert one_per_voxel(points, 0.1).tolist() == [0, 2]


def test_sizes_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match="from 1"):
        evenly_thinned(CLOUD, 0)
    with pytest.raises(InputError, match="positive"):
        one_per_voxel(CLOUD, float("nan"))


# --------------------------------------------------------------------------------------------------------- floor
def test_floor_of_two_heights_is_found_and_a_table_is_none() -> None:
    low = box((0.0, 0.0, 0.0), (6.0, 4.0, 0.0))
    platform = box((6.0, 0.0, 0.4), (10.0, 4.0, 0.4))
    table = box((1.0, 2.0, 0.75), (3.0, 3.5, 0.75))
    walked = np.array([[0.5, 1.0], [9.5, 1.0]])
    heights = [float(level.coefficients[2]) for level in floor_levels(np.vstack([low, platform, table]), [walked])]
    assert heights == pytest.approx([0.0, 0.4], abs=0.02)


def test_a_platform_that_nobody_has_walked_is_no_floor() -> None:
    points = np.vstack([box((0.0, 0.0, 0.0), (6.0, 4.0, 0.0)), box((6.0, 0.0, 0.4), (10.0, 4.0, 0.4))])
    assert len(floor_levels(points, [np.array([[0.5, 1.0], [5.0, 1.0]])])) == 1


def test_what_stands_on_a_platform_is_measured_from_the_platform() -> None:
    # A step of 0.1 m on a platform at 0.4 m is no obstacle there, a box of 0.3 m is; both would be at z = 0.4 and more.
    points = np.vstack([
        box((0.0, 0.0, 0.0), (6.0, 4.0, 0.0)), box((6.0, 0.0, 0.4), (10.0, 4.0, 0.4)),
        box((8.0, 1.6, 0.4), (8.3, 2.0, 0.7)),
    ])  # fmt: skip
    walked = np.array([[0.5, 1.0], [9.5, 1.0]])
    occupancy = occupancy_of(points, [walked])
    room = path_clearance(occupancy, walked)
    beside_box = (room.points_m[:, 0] > 8.05) & (room.points_m[:, 0] < 8.25)
    assert room.left_m[beside_box] == pytest.approx(0.6, abs=0.1)
    away = (room.points_m[:, 0] > 6.5) & (room.points_m[:, 0] < 7.5)
    assert (room.left_m[away] >= REACH_M).all()


def test_without_floor_there_is_none() -> None:
    assert floor_levels(np.zeros((0, 3)), []) == ()
    assert floor_levels(box((0.0, 0.0, 0.0), (0.0, 5.0, 3.0)), []) == ()


# --------------------------------------------------------------------------------------------------------- walls
def test_walls_end_at_doors() -> None:
    walls = wall_segments(corridor(door_m=(4.0, 5.2)))
    right = [wall for wall in walls if abs(wall[:, 1].mean() + WIDTH_M / 2) < 0.1]
    left = sorted((wall for wall in walls if abs(wall[:, 1].mean() - WIDTH_M / 2) < 0.1), key=lambda w: w[:, 0].min())
    assert [sorted(wall[:, 0]) for wall in right] == [pytest.approx([0.0, LENGTH_M], abs=0.25)]
    assert [sorted(wall[:, 0]) for wall in left] == [
        pytest.approx([0.0, 4.0], abs=0.25),
        pytest.approx([5.2, LENGTH_M], abs=0.25),
    ]


def test_the_side_of_a_counter_is_no_wall() -> None:
    counter = box((5.0, -0.6, 0.0), (7.0, -0.6, 1.1))
    assert len(wall_segments(np.vstack([corridor(), counter]))) == 2


def test_the_same_cloud_gives_the_same_walls_and_floor() -> None:
    assert np.array_equal(wall_segments(CLOUD), wall_segments(CLOUD))
    first, second = (floor_levels(CLOUD, [ROAD_M])[0].coefficients for _ in range(2))
    assert np.array_equal(first, second)


# ----------------------------------------------------------------------------------------------------- clearance
def seen(*extra: FloatArray, floor: bool = True, walked: bool = True) -> Occupancy:
    return occupancy_of(np.vstack([corridor(floor=floor), *extra]), [ROAD_M] if walked else [])


def test_the_room_in_a_corridor_is_half_of_it_to_each_side() -> None:
    room = path_clearance(seen(), ROAD_M)
    assert room.left_m == pytest.approx(WIDTH_M / 2, abs=0.08)
    assert room.right_m == pytest.approx(WIDTH_M / 2, abs=0.08)
    assert set(room.left_bound) | set(room.right_bound) == {Bound.OBSTACLE}


@pytest.mark.parametrize(
    ("thing", "is_in_the_way"),
    [
        (box((6.0, 0.5, 0.0), (6.0, 0.5, 1.0)), True),  # a pole, one point wide
        (box((6.0, 0.4, 1.7), (6.0, 0.6, 1.8)), True),  # a sign at the height of the head
        (box((5.5, 0.3, 2.0), (6.5, 0.8, 2.2)), False),  # a lamp above it
        (box((5.5, 0.3, 0.0), (6.5, 0.8, 0.05)), False),  # a carpet
        (np.array([[6.0, 0.5, 1.0], [6.01, 0.52, 1.4]]), False),  # stray points
    ],
)
def test_what_stands_between_knee_and_head_narrows_the_way(thing: FloatArray, is_in_the_way: bool) -> None:
    room = path_clearance(seen(thing), ROAD_M)
    least_m = float(room.left_m.min())
    assert least_m == pytest.approx(0.5 if is_in_the_way else WIDTH_M / 2, abs=0.1)
    assert float(room.right_m.min()) == pytest.approx(WIDTH_M / 2, abs=0.08)


def test_where_no_floor_has_been_seen_the_room_is_unknown_and_not_free() -> None:
    cloud = corridor()
    hole = (cloud[:, 0] > 4.0) & (cloud[:, 0] < 8.0) & (cloud[:, 1] > 0.5) & (np.abs(cloud[:, 2]) < 0.1)
    room = path_clearance(occupancy_of(cloud[~hole], [ROAD_M]), ROAD_M)
    beside = (room.points_m[:, 0] > 4.4) & (room.points_m[:, 0] < 7.6)
    assert (room.left_bound[beside] == Bound.UNKNOWN).all()
    assert room.left_m[beside] == pytest.approx(0.5 + 0.2, abs=0.08)
    assert (room.right_bound[beside] == Bound.OBSTACLE).all()


def test_where_somebody_walked_there_is_floor_though_nobody_saw_it() -> None:
    walked, not_walked = (path_clearance(seen(floor=False, walked=way), ROAD_M) for way in (True, False))
    assert (walked.width_m > 0.4).all()
    assert (walked.width_m < 0.6).all()
    assert (not_walked.width_m == 0.0).all()
    assert set(not_walked.left_bound) == set(walked.left_bound) == {Bound.UNKNOWN}


def test_beyond_the_cloud_nothing_is_known() -> None:
    room = path_clearance(seen(), np.array([[100.0, 0.0], [101.0, 0.0]]))
    assert set(room.left_bound) | set(room.right_bound) == {Bound.UNKNOWN}
    assert not place_clearance(seen(), 100.0, 0.0).is_known


def test_the_room_around_a_place() -> None:
    occupancy = seen()
    middle, beside_wall = place_clearance(occupancy, 6.0, 0.0), place_clearance(occupancy, 6.0, 0.9)
    assert middle.radius_m == pytest.approx(WIDTH_M / 2, abs=0.08)
    assert beside_wall.radius_m == pytest.approx(0.3, abs=0.08)
    assert middle.is_known


def test_a_stray_point_a_kilometre_off_does_not_make_the_picture_larger() -> None:
    with_stray = seen(np.array([[1000.0, -2000.0, 1.0]]))
    assert with_stray.is_occupied.size < 2 * seen().is_occupied.size


@settings(max_examples=25, deadline=None)
@given(
    path=st.lists(st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)), min_size=1, max_size=4),
)
def test_any_path_can_be_measured(path: list[tuple[float, float]]) -> None:
    room = path_clearance(ANYWHERE, np.array(path))
    assert len(room.points_m) == len(room.arc_m) == len(room.left_m) >= 2
    assert np.isfinite(room.width_m).all()


ANYWHERE = seen()


# ---------------------------------------------------------------------------------------------------- floor plan
SVG = "{http://www.w3.org/2000/svg}"
PLACES = (PlanPlace("Hall", 1.0, 0.0), PlanPlace("Größe 厕所 & <b>", 1.1, 0.05), PlanPlace("Bar", 11.0, 0.0))


def drawn(theme: Theme = "light", places: tuple[PlanPlace, ...] = PLACES) -> tuple[FloorPlan, FloatArray]:
    plan = floor_plan(ANYWHERE, wall_segments(CLOUD), [ROAD_M], places, theme)
    return plan, cv2.imdecode(np.frombuffer(plan.png, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]


def colour_at(plan: FloorPlan, image: FloatArray, x_m: float, y_m: float) -> tuple[int, ...]:
    """The colour at a place of the map, found by the picture's world file as another program would."""
    a, _, _, e, c, f = (float(line) for line in plan.world_file.split())
    return tuple(image[round((y_m - f) / e), round((x_m - c) / a)].tolist())


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_plan_shows_floor_walls_road_and_places_where_they_are(theme: Theme) -> None:
    plan, image = drawn(theme)
    palette = PALETTES[theme]
    assert image.shape[:2] == (plan.height_px, plan.width_px)
    assert colour_at(plan, image, 6.0, 0.6) == palette.floor
    assert colour_at(plan, image, 6.0, WIDTH_M / 2) == palette.wall
    assert colour_at(plan, image, 6.0, 0.0) == palette.road
    assert colour_at(plan, image, 11.0, 0.0) == palette.place
    assert colour_at(plan, image, 6.0, 1.7) == palette.ground


def test_what_stands_on_the_floor_is_drawn() -> None:
    occupancy = seen(box((5.0, 0.5, 0.0), (6.0, 0.9, 0.7)))
    plan = floor_plan(occupancy, np.zeros((0, 2, 2)), [], ())
    image = cv2.imdecode(np.frombuffer(plan.png, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
    assert colour_at(plan, image, 5.5, 0.7) == PALETTES["light"].standing


def test_names_are_drawn_whatever_letters_they_have() -> None:
    _, named = drawn(places=(PlanPlace("厕所", 6.0, 0.0),))
    _, other = drawn(places=(PlanPlace("酒吧", 6.0, 0.0),))
    _, unknown = drawn(places=(PlanPlace("??", 6.0, 0.0),))
    assert not np.array_equal(named, other)
    assert not np.array_equal(named, unknown)


def test_the_scale_bar_is_as_long_as_it_says() -> None:
    plan, image = drawn()
    foot = image[plan.height_px - 14]
    dark = np.flatnonzero((foot == PALETTES["light"].text).all(axis=1))
    run = np.split(dark, np.flatnonzero(np.diff(dark) > 1) + 1)[0]
    assert len(run) * plan.metres_per_pixel in (pytest.approx(2.0, abs=0.1), pytest.approx(5.0, abs=0.1))


def test_a_campus_still_fits() -> None:
    far = (PlanPlace("Here", 0.0, 0.0), PlanPlace("There", 3000.0, 1000.0))
    plan, _ = drawn(places=far)
    assert plan.width_px <= MAX_SIDE_PX + 1
    assert plan.metres_per_pixel == pytest.approx(3001.0 / MAX_SIDE_PX, rel=0.01)


def test_a_plan_of_nothing_is_a_plan() -> None:
    empty = occupancy_of(np.zeros((0, 3)), [])
    assert floor_plan(empty, np.zeros((0, 2, 2)), [], ()).png.startswith(b"\x89PNG")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_same_plan_as_svg_has_every_name_once_and_lies_where_the_picture_lies(theme: Theme) -> None:
    names = ("Hall", "Größe 厕所 & <b>", "Bar\x07 <script>alert(1)</script>")
    places = [PlanPlace(name, x_m, 0.0) for name, x_m in zip(names, (1.0, 5.0, 11.0), strict=True)]
    root = ElementTree.fromstring(floor_plan_svg(ANYWHERE, wall_segments(CLOUD), [ROAD_M], places, theme))
    picture = floor_plan(ANYWHERE, wall_segments(CLOUD), [ROAD_M], places, theme)
    texts = [text.text for text in root.iter(f"{SVG}text")]
    assert texts[:-1] == [names[0], names[1], names[2].replace("\x07", "")]
    assert texts[-1] in ("2 m", "5 m")
    assert not list(root.iter(f"{SVG}script"))
    assert root.get("viewBox") == f"0 0 {picture.width_px} {picture.height_px}"
    assert float(root.attrib["data-left-m"]) == pytest.approx(picture.x_min_m, abs=1e-3)
    assert float(root.attrib["data-top-m"]) == pytest.approx(picture.y_max_m, abs=1e-3)
    bar = next(circle for circle in list(root.iter(f"{SVG}circle"))[2:])
    assert picture.x_min_m + float(bar.attrib["cx"]) * picture.metres_per_pixel == pytest.approx(11.0, abs=0.01)
    assert len(list(root.iter(f"{SVG}path"))) == 2


@settings(max_examples=40, deadline=None)
@given(
    spots=st.lists(st.tuples(st.floats(0, 300), st.floats(0, 200), st.floats(5, 120)), max_size=25),
)
def test_no_name_covers_another_name_or_a_place(spots: list[tuple[float, float, float]]) -> None:
    labels = [Label(x, y, width, 20.0) for x, y, width in spots]
    boxes = label_boxes(labels, np.zeros((200, 300), np.bool_))
    shown = [box for box in boxes if box is not None]
    for index, (left, top, right, bottom) in enumerate(shown):
        assert left >= 0.0
        assert top >= 0.0
        assert right <= 300.0
        assert bottom <= 200.0
        for other in shown[index + 1 :]:
            assert right <= other[0] or other[2] <= left or bottom <= other[1] or other[3] <= top
        for label in labels:
            assert not (left < label.x_px < right and top < label.y_px < bottom)


def test_a_name_rather_stands_beside_the_road_than_on_it() -> None:
    road = np.zeros((200, 300), np.bool_)
    road[95:106, :] = True
    (box,) = label_boxes([Label(150.0, 100.0, 60.0, 20.0)], road)
    assert box is not None
    assert box[3] <= 95.0 or box[1] >= 105.0


# -------------------------------------------------------------------------------------------------------- survey
def test_a_survey_can_be_read_back(tmp_path: Path) -> None:
    survey = Survey(ANYWHERE, wall_segments(CLOUD))
    save_survey(survey, tmp_path / "survey.npz")
    back = load_survey(tmp_path / "survey.npz")
    assert np.array_equal(back.occupancy.is_occupied, ANYWHERE.is_occupied)
    assert np.array_equal(back.occupancy.is_known, ANYWHERE.is_known)
    assert (back.occupancy.x_min_m, back.occupancy.y_min_m, back.occupancy.cell_m) == (
        ANYWHERE.x_min_m, ANYWHERE.y_min_m, ANYWHERE.cell_m,
    )  # fmt: skip
    assert np.array_equal(back.walls_m, survey.walls_m)
    assert [file.name for file in tmp_path.iterdir()] == ["survey.npz"]


@pytest.mark.parametrize("length", [0, 10, 700, -40])
def test_a_survey_that_was_cut_off_is_refused(tmp_path: Path, length: int) -> None:
    file = tmp_path / "survey.npz"
    save_survey(Survey(ANYWHERE, np.zeros((0, 2, 2))), file)
    file.write_bytes(file.read_bytes()[:length])
    with pytest.raises(InputError, match="measure the map again"):
        load_survey(file)


def test_arrays_of_another_form_are_no_survey(tmp_path: Path) -> None:
    file = tmp_path / "survey.npz"
    np.savez(file, frame=np.zeros(4), is_occupied=np.zeros(3), is_known=np.zeros(3), walls_m=np.zeros(3))
    with pytest.raises(InputError, match="another form"):
        load_survey(file)
