"""The overlay for two eyes: the near has more disparity, a mirrored world gives the mirrored picture, Stop is Stop."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from navcore.angles import relative_angle, world_angle
from navcore.cues.overlay import drawn, overlay_scene, render_overlay
from navcore.cues.overlay_display import MID_GREY, DisplayGeometry, Eye, Head, Ink, contrast, luminance
from navcore.cues.overlay_shapes import Area, Label, Line, Shape
from navcore.geometry import world_from_camera_at
from navcore.settings import Settings
from navcore.types import (
    Action,
    BearingState,
    CornerAhead,
    DecisionTrace,
    Guidance,
    ObstacleScan,
    Reason,
    SubGoal,
    SubGoalCase,
)

DISPLAY, HEAD, SETTINGS = DisplayGeometry(), Head.level(), Settings()
LEAST_CONTRAST = 3.0


def guidance(action: Action, angle_deg: float | None = None, reason: Reason = Reason.OK, **trace) -> Guidance:
    direction = None if angle_deg is None else relative_angle(math.radians(angle_deg))
    trace = {"heading": world_angle(0.0), "position": (0.0, 0.0)} | trace
    return Guidance(0.0, action, direction, reason, DecisionTrace(**trace))


def a_scan(nearest_m: list[float], tops_m: list[float], states: list[int]) -> ObstacleScan:
    count = len(nearest_m)
    distance_m, state = np.array(nearest_m), np.array(states, np.int8)
    distance_m[state == BearingState.FREE] = np.inf
    return ObstacleScan(
        np.radians(np.linspace(-30, 30, count)), distance_m, state, (), 1.0, top_m=np.array(tops_m), eye_m=1.6
    )


NEAR_BOX = a_scan([1.5] * 20, [0.9] * 20, [BearingState.OBSTACLE] * 20)
WALK = guidance(Action.WALK, 0.0, remaining_m=20.0, sub_goal=SubGoal(4.0, 0.2, SubGoalCase.STRAIGHT, 9))
TURN = guidance(Action.TURN, 60.0)
STOP = guidance(Action.STOP, None, Reason.OBSTACLE_DEPTH)
ARRIVED = guidance(Action.STOP, None, Reason.ARRIVED)


def left_eye(each: Guidance | None, scan: ObstacleScan | None = None, now_s: float = 0.0) -> np.ndarray:
    return render_overlay(each, scan, HEAD, now_s, SETTINGS, DISPLAY).left_rgba


def grey(rgba: np.ndarray) -> np.ndarray:
    """Return what somebody sees who sees no colours, before a dark world, 0 to 1."""
    linear = (rgba[..., :3] / 255.0) ** 2.2
    return linear @ (0.2126, 0.7152, 0.0722)


# ---------------------------------------------------------------------------------------------------- two eyes
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.3, 10), st.floats(0.3, 10))
def test_nearer_things_have_more_disparity_and_both_eyes_see_them_on_one_row(
    x_share: float, y_share: float, first_m: float, second_m: float
) -> None:
    assume(abs(first_m - second_m) > 1e-3)
    near_m, far_m = sorted((first_m, second_m))
    points = np.array([(x_share * depth, y_share * depth, depth) for depth in (near_m, far_m)])
    left, right = (DISPLAY.project(points, eye) for eye in (Eye.LEFT, Eye.RIGHT))
    near_px, far_px = left[:, 0] - right[:, 0]
    assert near_px > far_px
    assert near_px == pytest.approx(DISPLAY.disparity_px(near_m), abs=1e-6)
    np.testing.assert_allclose(left[:, 1], right[:, 1])
    at_image = DISPLAY.at_image(np.array([100.0]), np.array([-50.0]))
    np.testing.assert_allclose(DISPLAY.project(at_image, Eye.LEFT), DISPLAY.project(at_image, Eye.RIGHT))


def test_the_arrow_lies_on_the_floor_row_by_row() -> None:
    """Each row of the arrow is shifted between the eyes as the floor that is seen there is far away."""
    pictures = [np.zeros(0)] * 2
    shapes = [shape for shape in overlay_scene(WALK, None, HEAD, 0.0, SETTINGS, DISPLAY) if is_way(shape)]
    pictures = [drawn(shapes, DISPLAY, eye)[..., 3].astype(float) for eye in (Eye.LEFT, Eye.RIGHT)]
    columns = np.arange(DISPLAY.width_px)
    checked = 0
    for row in range(DISPLAY.height_px):
        left, right = (picture[row] for picture in pictures)
        if left.sum() < 255 * 40:
            continue
        shift_px = (left @ columns) / left.sum() - (right @ columns) / right.sum()
        down_rad = math.radians(15.0) + math.atan((row - (DISPLAY.height_px - 1) / 2) / DISPLAY.focal_px)
        depth_m = HEAD.eye_m / math.sin(down_rad) * math.cos(down_rad - math.radians(15.0))
        assert shift_px == pytest.approx(DISPLAY.disparity_px(depth_m), abs=1.0)
        checked += 1
    assert checked > 80


def is_way(shape: Shape) -> bool:
    return isinstance(shape, Area) and shape.ink is Ink.WAY


def test_a_head_in_a_pose_sees_the_floor_where_a_level_head_does() -> None:
    points = np.array([(3.0, 0.5, 0.0), (5.0, -1.0, 1.2)])
    for heading in (0.0, 1.0, -2.5):
        pose = world_from_camera_at((2.0, -1.0, 1.6), heading, math.radians(15.0))
        np.testing.assert_allclose(Head.at(pose, 1.6).seen(points), HEAD.seen(points), atol=1e-9)
    nodding = Head.at(world_from_camera_at((0.0, 0.0, 1.6), 0.0, math.radians(25.0)), 1.6)
    assert (nodding.seen(points)[:, 1] < HEAD.seen(points)[:, 1]).all(), "whoever looks down sees it higher up"


# ---------------------------------------------------------------------------------------------------- mirrored
def mirrored(each: Guidance) -> Guidance:
    trace = each.trace
    goal, corner = trace.sub_goal, trace.corner
    trace = replace(
        trace,
        sub_goal=None if goal is None else replace(goal, y_m=-goal.y_m),
        corner=None if corner is None else replace(corner, bend=relative_angle(-corner.bend)),
    )
    return replace(each, direction=None if each.direction is None else relative_angle(-each.direction), trace=trace)


def mirrored_scan(scan: ObstacleScan) -> ObstacleScan:
    return replace(scan, nearest_m=scan.nearest_m[::-1], state=scan.state[::-1], top_m=scan.top_m[::-1])


walking = st.builds(
    lambda angle, x, y, case, bend, ahead, uncertain, action: guidance(
        action, angle, remaining_m=12.0, sub_goal=SubGoal(x, y, case, 3),
        corner=CornerAhead(3, ahead, relative_angle(math.radians(bend)), 1.0),
        uncertain_since_s=0.0 if uncertain else None,
    ),
    st.floats(-60, 60).filter(lambda angle: abs(angle) > 0.5), st.floats(1, 8), st.floats(-3, 3),
    st.sampled_from(list(SubGoalCase)), st.floats(45, 120) | st.floats(-120, -45), st.floats(0.5, 9), st.booleans(),
    st.sampled_from([Action.WALK, Action.TURN]),
)  # fmt: skip
scans = st.lists(
    st.tuples(st.floats(0.5, 5), st.floats(0.1, 1.9), st.sampled_from([0, 1, 1, 1, 2])), min_size=8, max_size=30
).map(lambda rows: a_scan(*(list(column) for column in zip(*rows, strict=True))))


@hypothesis_settings(deadline=None, max_examples=40)
@given(walking, scans, st.sampled_from(["degrees", "clock", "sides"]))
def test_a_mirrored_world_gives_the_mirrored_picture_with_the_eyes_changed(
    each: Guidance, scan: ObstacleScan, style: str
) -> None:
    settings = SETTINGS.changed({"cues.direction_style": style})
    scenes = [
        overlay_scene(one, seen, HEAD, 0.0, settings, DISPLAY)
        for one, seen in ((each, scan), (mirrored(each), mirrored_scan(scan)))
    ]
    labels = [[shape for shape in scene if isinstance(shape, Label)] for scene in scenes]
    for label, other in zip(*labels, strict=True):
        np.testing.assert_allclose(label.at_m, other.at_m * (-1.0, 1.0, 1.0), atol=1e-9)
    shapes, others = ([shape for shape in scene if not isinstance(shape, Label)] for scene in scenes)
    # Layer by layer, so that it does not matter which of two neighbours is drawn over the other.
    for ink in Ink:
        picture, other = (
            drawn([shape for shape in each_scene if shape.ink is ink], DISPLAY, eye)[..., 3].astype(int)
            for each_scene, eye in ((shapes, Eye.LEFT), (others, Eye.RIGHT))
        )
        differs = np.abs(picture - other[:, ::-1]) > 128
        assert differs.sum() <= 0.1 * (picture > 128).sum() + 30


def drawn_in(ink: Ink, shapes: list[Shape]) -> float:
    """Return how far right of the middle a colour lies on average, pixels, seen by the left eye."""
    alpha = drawn([shape for shape in shapes if shape.ink is ink], DISPLAY, Eye.LEFT)[..., 3].astype(float)
    assert alpha.sum() > 0
    return float(alpha.sum(axis=0) @ (np.arange(DISPLAY.width_px) - (DISPLAY.width_px - 1) / 2) / alpha.sum())


@pytest.mark.parametrize("left", [1.0, -1.0])
def test_what_is_on_the_left_is_drawn_on_the_left(left: float) -> None:
    half = [BearingState.FREE] * 12 + [BearingState.OBSTACLE] * 8
    scan = a_scan([2.0] * 20, [0.9] * 20, half if left > 0 else half[::-1])
    goal, corner = (
        SubGoal(4.0, 1.0 * left, SubGoalCase.STRAIGHT, 3),
        CornerAhead(3, 4.0, relative_angle(1.5 * left), 1.0),
    )
    scenes = {
        "way": (guidance(Action.WALK, 30.0 * left), Ink.WAY), "turn": (guidance(Action.TURN, 60.0 * left), Ink.WAY),
        "goal": (guidance(Action.WALK, 0.0, sub_goal=goal), Ink.GOAL),
        "far aside": (guidance(Action.WALK, 0.0, sub_goal=replace(goal, y_m=9.0 * left)), Ink.GOAL),
        "obstacle": (STOP, Ink.NEAR),
    }  # fmt: skip
    for name, (each, ink) in scenes.items():
        seen = scan if name == "obstacle" else None
        shapes = overlay_scene(each, seen, HEAD, 0.0, SETTINGS, DISPLAY)
        shapes = shapes[:1] if name == "obstacle" else shapes
        assert drawn_in(ink, shapes) * left < -8.0, name
    straight = overlay_scene(guidance(Action.WALK, 0.0), None, HEAD, 0.0, SETTINGS, DISPLAY)
    with_corner = overlay_scene(guidance(Action.WALK, 0.0, corner=corner), None, HEAD, 0.0, SETTINGS, DISPLAY)
    assert drawn_in(Ink.WAY, with_corner[len(straight) :]) * left < -100.0


# -------------------------------------------------------------------------------------------------------- stop
stale = st.floats(SETTINGS.watchdog.guidance_timeout_s + 1e-6, 1e6) | st.just(math.nan)


@hypothesis_settings(deadline=None, max_examples=30)
@given(walking, stale)
def test_old_or_absent_guidance_is_stop(each: Guidance, age_s: float) -> None:
    overlay = render_overlay(each, NEAR_BOX, HEAD, age_s, SETTINGS, DISPLAY)
    absent = render_overlay(None, None, HEAD, 0.0, SETTINGS, DISPLAY)
    assert overlay.is_stop
    assert absent.is_stop
    np.testing.assert_array_equal(overlay.left_rgba, absent.left_rgba)
    np.testing.assert_array_equal(overlay.right_rgba, absent.right_rgba)
    assert not render_overlay(each, NEAR_BOX, HEAD, 0.1, SETTINGS, DISPLAY).is_stop


@pytest.mark.parametrize("reason", Reason)
def test_whoever_is_stopped_sees_no_way(reason: Reason) -> None:
    shapes = overlay_scene(guidance(Action.STOP, None, reason), NEAR_BOX, HEAD, 0.0, SETTINGS, DISPLAY)
    assert shapes
    assert all(shape.ink is not Ink.WAY for shape in shapes)


def test_stop_is_read_without_colour() -> None:
    """In grey alone: an octagon, and in it the word, both where they are looked for first."""
    light = grey(left_eye(STOP, NEAR_BOX)) > 0.4
    (width_px, height_px), base_px = cv2.getTextSize("STOP", cv2.FONT_HERSHEY_DUPLEX, 48 / 22, 6)
    word = np.zeros((height_px + base_px + 12, width_px + 12), np.uint8)
    cv2.putText(word, "STOP", (6, height_px + 6), cv2.FONT_HERSHEY_DUPLEX, 48 / 22, 255, 6, cv2.LINE_AA)
    found = cv2.matchTemplate(light.astype(np.uint8) * 255, word, cv2.TM_CCOEFF_NORMED)
    assert found.max() > 0.85
    outlines, _ = cv2.findContours(light.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    biggest = max(outlines, key=cv2.contourArea)
    assert len(cv2.approxPolyDP(biggest, 0.03 * cv2.arcLength(biggest, True), True)) == 8
    x, _, width, height = cv2.boundingRect(biggest)
    assert abs(x + width / 2 - DISPLAY.width_px / 2) < 5
    assert min(width, height) > 0.5 * DISPLAY.height_px


def test_no_two_signs_have_the_same_shape() -> None:
    masks = [left_eye(each)[..., 3] > 128 for each in (WALK, TURN, STOP, ARRIVED)]
    masks += [left_eye(guidance(Action.STOP, None, reason))[220:, :, 3] > 128 for reason in (Reason.OBSTACLE_DEPTH,)]
    pictograms = [
        left_eye(guidance(Action.STOP, None, reason))[236:, :, 3] > 128
        for reason in Reason if reason not in (Reason.ARRIVED, Reason.OK)
    ]  # fmt: skip
    for group in (masks[:4], pictograms):
        for one, other in itertools.combinations(group, 2):
            assert (one & other).sum() < 0.6 * (one | other).sum()


# ---------------------------------------------------------------------------------------------------- contrast
@pytest.mark.parametrize("ink", [ink for ink in Ink if ink is not Ink.SIGN])
def test_every_ink_stands_out_before_dark_and_before_mid_grey(ink: Ink) -> None:
    for world in ((0, 0, 0), MID_GREY):
        assert contrast(ink.value, (0, 0, 0), world) >= LEAST_CONTRAST


def test_the_word_stands_out_from_its_sign() -> None:
    for world in ((0, 0, 0), MID_GREY):
        assert contrast(Ink.TEXT.value, Ink.SIGN.value, world) >= LEAST_CONTRAST
    assert contrast((255, 255, 255), (0, 0, 0)) == pytest.approx(21.0)
    assert luminance((255, 255, 255)) == pytest.approx(1.0)


def test_the_pictures_hold_those_inks_and_transparent_black() -> None:
    for each in (WALK, TURN, STOP, ARRIVED):
        rgba = left_eye(each, NEAR_BOX)
        assert rgba.shape == (DISPLAY.height_px, DISPLAY.width_px, 4)
        assert not rgba[rgba[..., 3] == 0].any(), "black where nothing is drawn"
        solid = rgba[rgba[..., 3] == 255][:, :3]
        inks = np.array([ink.value for ink in Ink])
        off = np.abs(solid[:, None].astype(int) - inks[None]).max(axis=2).min(axis=1)
        assert (off <= 3).mean() > 0.9


# ------------------------------------------------------------------------------------------------- what is near
@given(st.floats(0.5, 3.9), st.floats(0.5, 3.9))
def test_the_nearer_the_thicker(first_m: float, second_m: float) -> None:
    near_m, far_m = sorted((first_m, second_m))
    near, far = (outline(distance_m) for distance_m in (near_m, far_m))
    assert near.width_px >= far.width_px
    if far_m >= 2 * near_m and near_m < 2.0:
        assert near.width_px > far.width_px


def outline(distance_m: float, state: int = BearingState.OBSTACLE) -> Line:
    scan = a_scan([distance_m] * 20, [0.9] * 20, [state] * 20)
    shapes = overlay_scene(STOP, scan, HEAD, 0.0, SETTINGS, DISPLAY)
    assert isinstance(shapes[0], Line)
    return shapes[0]


def test_what_is_within_the_stop_distance_is_hatched_and_a_drop_is_toothed() -> None:
    def lines(distance_m: float) -> int:
        scan = a_scan([distance_m] * 20, [0.9] * 20, [BearingState.OBSTACLE] * 20)
        return sum(
            shape.ink in (Ink.NEAR, Ink.TEXT) for shape in overlay_scene(TURN, scan, HEAD, 0.0, SETTINGS, DISPLAY)
        )

    stop_m = SETTINGS.obstacle.stop_distance_m
    assert lines(stop_m - 0.05) > lines(stop_m + 0.05)
    assert outline(stop_m - 0.05).ink is not outline(stop_m + 0.05).ink
    drop = outline(2.5, BearingState.DROP).points_m
    depths = drop[:, 2]
    assert len(drop) == 20
    assert np.ptp(depths) > 0.1, "it goes to and fro"
    assert outline(3.9).points_m.shape[0] > 20
    free = a_scan([1.0] * 20, [0.0] * 20, [BearingState.FREE] * 20)
    unknown = replace(free, state=np.full(20, BearingState.UNKNOWN, np.int8), nearest_m=np.full(20, np.nan))
    for scan in (free, unknown):
        assert len(overlay_scene(STOP, scan, HEAD, 0.0, SETTINGS, DISPLAY)) == len(
            overlay_scene(STOP, None, HEAD, 0.0, SETTINGS, DISPLAY)
        )


@pytest.mark.parametrize(("style", "figure"), [("degrees", "60"), ("clock", "10"), ("sides", None)])
def test_a_turn_shows_the_figure_that_is_spoken(style: str, figure: str | None) -> None:
    settings = SETTINGS.changed({"cues.direction_style": style})
    shapes = overlay_scene(TURN, None, HEAD, 0.0, settings, DISPLAY)
    assert [shape.text for shape in shapes if isinstance(shape, Label)] == ([] if figure is None else [figure])


def test_everything_is_drawn_within_the_picture_at_its_place() -> None:
    corner = CornerAhead(3, 4.2, relative_angle(1.5), 1.0)
    labels = {
        shape.text: DISPLAY.project(shape.at_m[None], Eye.LEFT)[0]
        for shape in overlay_scene(
            replace(WALK, trace=replace(WALK.trace, corner=corner)), NEAR_BOX, HEAD, 0.0, SETTINGS, DISPLAY
        )
        if isinstance(shape, Label)
    }
    assert set(labels) == {"20 m", "4 m"}
    assert all(0 < u < DISPLAY.width_px and 0 < v < DISPLAY.height_px for u, v in labels.values())
