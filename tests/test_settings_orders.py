"""Related settings: which must stay below which, row by row."""

from __future__ import annotations

import pytest

from navcore.errors import SettingError
from navcore.settings import ORDERS, Settings, spec_of

BELOW = """
    obstacle.stop_distance_m      < obstacle.narrow_clearance_m
    obstacle.narrow_clearance_m  <= obstacle.clearance_m
    obstacle.stop_distance_m      < gate.clearance_m
    follower.turn_settled_deg     < follower.turn_angle_deg
    cues.straight_within_deg      < follower.turn_angle_deg
    follower.turning_reached_m    < follower.sub_goal_distance_m
    follower.off_road_distance_m <= planning.replan_deviation_m
    planning.blocked_hold_s       < planning.blocked_memory_s
    deadlines.capture_s           < deadlines.capture_to_cue_s
    deadlines.capture_to_cue_s    < watchdog.guidance_timeout_s
    map_walk.covered_fraction    <= map_walk.valid_depth_fraction
    """
ROWS = [tuple(line.split()) for line in BELOW.strip().splitlines()]


def test_these_are_all_and_the_defaults_keep_them() -> None:
    assert [(o.lower, "<=" if o.may_equal else "<", o.upper) for o in ORDERS] == ROWS
    for order in ORDERS:
        order.check(Settings())


@pytest.mark.parametrize(("lower", "relation", "upper"), ROWS)
def test_each_is_kept_at_its_very_edge(lower: str, relation: str, upper: str) -> None:
    order = next(o for o in ORDERS if (o.lower, o.upper) == (lower, upper))
    meet = max(spec_of(key).low or 0.0 for key in (lower, upper))
    both = Settings().model_copy(update=_groups({lower: meet, upper: meet}))
    if relation == "<=":
        order.check(both)
    else:
        with pytest.raises(SettingError) as refused:
            order.check(both)
        assert "be less than" in str(refused.value)
    above = Settings().model_copy(update=_groups({lower: meet * 1.5 + 0.1, upper: meet}))
    with pytest.raises(SettingError) as refused:
        order.check(above)
    assert refused.value.keys == (lower, upper)
    assert ("not be more than" if relation == "<=" else "be less than") in str(refused.value)


@pytest.mark.parametrize(
    ("lower", "low", "upper", "high", "said"),
    [
        ("obstacle.stop_distance_m", 1.0, "gate.clearance_m", 0.5,
         "(1 m) must be less than gate.clearance_m (0.5 m): "),
        ("map_walk.covered_fraction", 0.2, "map_walk.valid_depth_fraction", 0.1,
         "(0.2) must not be more than map_walk.valid_depth_fraction (0.1): "),
    ],
)  # fmt: skip
def test_a_refusal_says_both_values_with_their_unit(lower: str, low: float, upper: str, high: float, said: str) -> None:
    order = next(o for o in ORDERS if (o.lower, o.upper) == (lower, upper))
    with pytest.raises(SettingError) as refused:
        order.check(Settings().model_copy(update=_groups({lower: low, upper: high})))
    assert str(refused.value) == f"{lower} {said}{order.why}. Change both together."


def _groups(changes: dict[str, float]) -> dict[str, object]:
    """Return groups with values changed, unchecked."""
    groups: dict[str, object] = {}
    for key, value in changes.items():
        group, name = key.split(".")
        before = groups.get(group, getattr(Settings(), group))
        groups[group] = before.model_copy(update={name: value})  # type: ignore[attr-defined]
    return groups
