"""The paper's experiments: what is walked, what is kept and taken up again, and the table beside the paper's."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from device_agent.experiments.course import COURSES, with_course, with_people_starting
from device_agent.experiments.design import FIRST_REPORTING_SEED, PATHS, trials
from device_agent.experiments.least import forced_means_m, least_line_m, stations_of
from device_agent.experiments.pictures import draw_all
from device_agent.experiments.running import Figures, digest, kept
from device_agent.experiments.tables import PAPER, as_csv, as_markdown, rows
from device_agent.simulation.building import Building, push_from_solids, touchable
from navcore.geometry import FloatArray
from navcore.planning.road_joining import evenly_spaced
from navcore.settings import Settings
from navcore.site import Site, save_site

FIGURES = Figures(
    key="k", experiment=1, policy="paper", path="A→B", sight="totally blind", seed=2000, arrived=True,
    outcome="arrived", contacts=0, deviation_max_m=0.4, deviation_mean_m=0.1, deviation_variance_m2=0.01,
    seconds=30.0, stopped_s=1.0,
    localized_share=1.0, localization_rmse_m=0.01, cycle_median_ms=8.0, route_m=[[15.0, 2.6], [15.0, 6.0]],
    path_m=[[15.0, 2.6], [15.1, 4.0], [15.0, 6.0]],
)  # fmt: skip


def test_every_combination_is_walked_once_by_the_same_people() -> None:
    wanted = list(trials(range(2)))
    assert len(wanted) == len({trial.key for trial in wanted}) == 2 * 2 * 3 * 2 * 2
    by_person = {(trial.seed, trial.sight): trial.walker() for trial in wanted}
    assert all(trial.walker() == by_person[trial.seed, trial.sight] for trial in wanted)
    assert {trial.seed for trial in wanted[: len(wanted) // 2]} == {0}, "a batch that is stopped has whole rows"
    assert FIRST_REPORTING_SEED > 1000


def test_the_papers_rows_are_there_and_a_row_is_the_mean_over_its_walks() -> None:
    assert set(PAPER) == {(e, p.name, s) for e in (1, 2) for p in PATHS for s in ("partially sighted", "totally blind")}
    others = [replace(FIGURES, seed=1, deviation_max_m=0.8, contacts=2), replace(FIGURES, seed=2, arrived=False)]
    unknown = replace(FIGURES, seed=3, deviation_max_m=None, deviation_mean_m=None)
    (row,) = rows([FIGURES, *others, unknown])
    assert (row.walks, row.arrived, row.contacts) == (4, 3, 2)
    assert row.largest_m == 0.8
    assert row.max_m == pytest.approx((0.4 + 0.8 + 0.4) / 3)
    read = list(csv.DictReader(io.StringIO(as_csv([row], {}))))
    assert float(read[0]["paper_mean_m"]) == PAPER[1, "A→B", "totally blind"].mean_m
    assert float(read[0]["mean_m"]) == pytest.approx(row.mean_m, abs=1e-4)
    page = as_markdown([row], {}, [2000, 2001], "vbr experiments --seeds 2")
    assert "3 of 4" in page
    assert "320×240" in page
    assert math.isnan(rows([unknown])[0].max_m)


STATIONS, LEFT = stations_of(np.array([[0.0, 0.0], [10.0, 0.0]]))


def _post(y_m: float) -> Callable[[float, float], float]:
    return lambda x, y: math.hypot(x - 5.0, y - y_m)


def test_the_least_line_keeps_the_distance_and_is_on_the_road_elsewhere() -> None:
    line_m = least_line_m(STATIONS, LEFT, _post(0.2), 0.35)
    assert line_m is not None
    assert line_m.min() == pytest.approx(-0.15, abs=0.021), "to the side that is nearer to the road"
    assert np.all(line_m[np.abs(STATIONS[:, 0] - 5.0) > 1.0] == 0.0)
    assert np.abs(np.diff(line_m)).max() <= 0.4 * 0.1 + 1e-9, "no steeper than people are led"
    mirrored_m = least_line_m(STATIONS, LEFT, _post(-0.2), 0.35)
    assert mirrored_m is not None
    assert mirrored_m == pytest.approx(-line_m)


def test_there_is_no_least_line_where_nobody_fits() -> None:
    assert least_line_m(STATIONS, LEFT, lambda x, _y: abs(x - 5.0), 0.35) is None


def test_what_a_course_forces_is_the_least_line_and_the_walkers_own_sway() -> None:
    steady = replace(
        FIGURES, policy="road_centred", path="D→C",
        route_m=[[19.0, 16.9], [19.0, 14.0], [23.0, 14.0]], path_m=[[19.0, 16.9 - 0.1 * k] for k in range(29)]
        + [[19.0 + 0.1 * k, 14.0] for k in range(36)],
    )  # fmt: skip
    swaying = replace(steady, path_m=[[x, y + 0.1 * (-1) ** k] for k, (x, y) in enumerate(steady.path_m)])
    key = steady.path, steady.sight
    (least_m,) = forced_means_m([steady], 0.35).values()
    assert 0.0 < least_m < 0.2, "a low box stands beside the way"
    assert forced_means_m([swaying], 0.35)[key] > least_m
    assert forced_means_m([steady], 0.45)[key] > least_m
    assert forced_means_m([replace(steady, policy="paper"), replace(steady, experiment=2)], 0.35) == {}
    row = rows([replace(steady, experiment=2)])
    page = as_markdown(row, {key: least_m}, [1], "vbr experiments")
    assert f"*forced* | | | | {least_m:.3f} m" in page
    read = list(csv.DictReader(io.StringIO(as_csv(row, {key: least_m}))))
    assert float(read[0]["forced_mean_m"]) == pytest.approx(least_m, abs=1e-4)


def test_what_was_walked_with_other_code_or_cannot_be_read_is_walked_again(tmp_path: Path) -> None:
    trial = next(iter(trials([7])))
    file = tmp_path / f"{trial.key}.json"
    file.write_text(json.dumps({"digest": "now", "figures": asdict(FIGURES)}), encoding="utf-8")
    assert kept(tmp_path, trial, "now") == FIGURES
    assert kept(tmp_path, trial, "other") is None
    for damaged in ("", "[]", "{", '{"digest": "now"}', '{"digest": "now", "figures": {"key": 1}}'):
        file.write_text(damaged, encoding="utf-8")
        assert kept(tmp_path, trial, "now") is None


def test_pictures_show_the_trajectories_over_the_plan(tmp_path: Path) -> None:
    (picture,) = draw_all([FIGURES], tmp_path)
    assert picture.name == "figure-8-paper-AB.jpg"
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.name)
def test_every_course_leaves_room_for_a_person_beside_each_thing(path: object, office: Building) -> None:
    """Along the road there is, at each of its points, a place within 1 m of it where somebody can stand."""
    solids = touchable(with_course(office, path.name).solids)  # type: ignore[attr-defined]
    for place in _road(office):
        across = [
            max(push_from_solids(solids, place[0] + dx, place[1] + dy)[0] for dx, dy in _around(radius))
            for radius in (0.0, 0.4, 0.7, 1.0)
        ]
        assert max(across) > 0.3, place
    assert len(COURSES[path.name].pieces) >= 2  # type: ignore[attr-defined]


def test_people_begin_when_the_seed_says(office: Building) -> None:
    building = with_course(office, "A→B")
    first, same, other = (with_people_starting(building, seed).movers for seed in (3, 3, 4))
    assert first == same
    assert first != other


def test_other_settings_are_another_batch(tmp_path: Path, small_site: Site) -> None:
    save_site(small_site, tmp_path / "site")
    stamp = digest(tmp_path / "site", Settings())
    assert digest(tmp_path / "site", Settings()) == stamp
    assert digest(tmp_path / "site", Settings().changed({"follower.lead_s": 1.1})) != stamp


def _road(office: Building) -> FloatArray:
    return evenly_spaced(np.array(office.road_waypoints, dtype=np.float64), 0.5)


def _around(radius_m: float) -> list[tuple[float, float]]:
    return [(radius_m * math.cos(k * math.pi / 4), radius_m * math.sin(k * math.pi / 4)) for k in range(8)]
