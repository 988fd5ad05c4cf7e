"""``vbr experiments`` as a command: what is kept, what is asked for, what is written, and what is refused."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from device_agent.cli import main
from device_agent.demo_site import MAP_VERSION
from device_agent.experiments import running
from device_agent.experiments.design import FIRST_REPORTING_SEED, PATHS, Trial, trials
from device_agent.experiments.running import RATE_HZ, SIZE_PX, Figures, digest
from navcore.settings import Settings
from navcore.site import Site, save_site
from navcore.slam.map_arrays import descriptor_kind

SEED = 4242
ROUTES = {
    "A→B": [[15.0, 2.6], [15.0, 6.0]],
    "D→C": [[19.0, 16.9], [19.0, 14.0], [23.0, 14.0]],
    "E→B": [[15.0, 10.0], [15.0, 6.0]],
}


def figures_of(trial: Trial, **others: object) -> Figures:
    """What a walk might have come to: each another mean, so that tables tell them apart."""
    number = trial.experiment + 2 * [path.name for path in PATHS].index(trial.path.name)
    values: dict[str, object] = {
        "key": trial.key, "experiment": trial.experiment, "policy": trial.policy, "path": trial.path.name,
        "sight": trial.sight, "seed": trial.seed, "arrived": True, "outcome": "arrived", "contacts": 0,
        "deviation_max_m": 0.5, "deviation_mean_m": number / 100, "deviation_variance_m2": 0.01, "seconds": 30.0,
        "stopped_s": 1.0, "localized_share": 1.0, "localization_rmse_m": 0.01, "cycle_median_ms": 8.0,
        "route_m": ROUTES[trial.path.name], "path_m": ROUTES[trial.path.name],
    }  # fmt: skip
    return Figures(**{**values, **others})  # type: ignore[arg-type]


def note_that_the_map_fits(out: Path) -> None:
    note = {
        "map_version": MAP_VERSION, "features": descriptor_kind().tobytes().hex(), "size_px": list(SIZE_PX),
        "rate_hz": RATE_HZ,
    }  # fmt: skip
    (out / "map" / "demo.json").write_text(json.dumps(note), encoding="utf-8")


@pytest.fixture
def out(tmp_path: Path, small_site: Site) -> Path:
    """The folder of a batch whose map has been made."""
    save_site(small_site, tmp_path / "batch" / "map" / "site")
    note_that_the_map_fits(tmp_path / "batch")
    return tmp_path / "batch"


def walk_all(out: Path, seeds: range, settings: Settings | None = None, **others: object) -> None:
    """Leave behind what a batch leaves that has walked all walks of these walkers."""
    stamp = digest(out / "map" / "site", Settings() if settings is None else settings)
    (out / "walks").mkdir(exist_ok=True)
    for trial in trials(seeds):
        running._keep(out / "walks", figures_of(trial, **others), stamp)


def run(out: Path, *options: str) -> int:
    return main(["experiments", "--out", str(out), "--first-seed", str(SEED), "--seeds", "1", *options])


def table_of(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / "experiments.csv").read_text(encoding="utf-8").splitlines()))


def made(out: Path) -> set[str]:
    return {file.name for file in out.iterdir() if file.is_file()}


def state_of(folder: Path) -> dict[str, tuple[int, int]]:
    return {file.name: (file.stat().st_ino, file.stat().st_mtime_ns) for file in folder.iterdir()}


def test_what_was_walked_is_not_walked_anew_and_gives_the_same_page(out: Path, capsys: pytest.CaptureFixture[str]):
    walk_all(out, range(SEED, SEED + 1))
    before = state_of(out / "walks")
    assert run(out, "--experiment", "1", "--path", "DC") == 0
    first = {name: (out / name).read_bytes() for name in made(out)}
    assert run(out, "--experiment", "1", "--path", "DC") == 0
    assert {name: (out / name).read_bytes() for name in made(out)} == first
    assert state_of(out / "walks") == before
    assert "4 walks, 0 of them with a contact or without arrival" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "count", "experiments", "paths", "policies", "pictures"),
    [
        (("--experiment", "1", "--path", "DC"), 4, {"1"}, {"D→C"}, {"paper", "road_centred"},
         {"figure-8-paper-DC.jpg", "figure-8-road_centred-DC.jpg"}),
        (("--path", "EB", "--policy", "paper"), 4, {"1", "2"}, {"E→B"}, {"paper"},
         {"figure-8-paper-EB.jpg", "figure-9-paper-EB.jpg"}),
        (("--experiment", "2", "--policy", "road_centred", "--path", "AB"), 2, {"2"}, {"A→B"}, {"road_centred"},
         {"figure-9-road_centred-AB.jpg"}),
    ],
)  # fmt: skip
def test_only_what_is_asked_for_is_in_table_page_and_pictures(
    out: Path, options: tuple[str, ...], count: int, experiments: set[str], paths: set[str], policies: set[str],
    pictures: set[str], capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    walk_all(out, range(SEED, SEED + 1))
    assert run(out, *options) == 0
    rows = table_of(out)
    assert len(rows) == count, "a row for each walker"
    assert {row["experiment"] for row in rows} == experiments
    assert {row["path"] for row in rows} == paths
    assert {row["policy"] for row in rows} == policies
    assert made(out) == {"experiments.csv", "experiments.md", *pictures}
    for row in rows:
        number = int(row["experiment"]) + 2 * [path.name for path in PATHS].index(row["path"])
        assert float(row["mean_m"]) == pytest.approx(number / 100)
    page = (out / "experiments.md").read_text(encoding="utf-8")
    assert f"vbr experiments --seeds 1 --first-seed {SEED} --out batch" in page
    assert ("without obstacles" in page, "with obstacles" in page) == ("1" in experiments, "2" in experiments)
    assert f"{count} walks" in capsys.readouterr().out


def test_walks_that_went_wrong_are_named(out: Path, capsys: pytest.CaptureFixture[str]):
    walk_all(out, range(SEED, SEED + 1), contacts=2, arrived=False, outcome="lost for good")
    assert run(out, "--experiment", "1", "--path", "DC", "--policy", "paper") == 0
    said = capsys.readouterr().out
    assert f"e1-paper-DC-totally-{SEED:05d}: 2 contacts, lost for good" in said
    assert "2 walks, 2 of them with a contact or without arrival" in said
    assert {row["contacts"] for row in table_of(out)} == {"2"}
    assert {row["arrived"] for row in table_of(out)} == {"0"}


def test_a_row_is_the_mean_over_the_walkers_that_were_asked_for(out: Path):
    walk_all(out, range(SEED, SEED + 3))
    walk_all(out, range(SEED + 1, SEED + 2), deviation_mean_m=0.31)
    assert run(out, "--experiment", "1", "--path", "DC", "--policy", "paper", "--seeds", "2") == 0
    rows = table_of(out)
    assert {row["walks"] for row in rows} == {"2"}
    assert [float(row["mean_m"]) for row in rows] == pytest.approx(2 * [(0.03 + 0.31) / 2])
    assert f"(seeds {SEED} to {SEED + 1})" in (out / "experiments.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_walk_that_is_gone_is_walked_again_in_a_process_of_its_own_and_the_others_are_not(
    tmp_path: Path, office_site: Path
):
    out, trial = tmp_path / "batch", Trial(1, "road_centred", PATHS[0], "totally blind", 5)
    shutil.copytree(office_site, out / "map" / "site")
    note_that_the_map_fits(out)
    walk_all(out, range(5, 6))
    gone = out / "walks" / f"{trial.key}.json"
    gone.unlink()
    before = state_of(out / "walks")
    options = "--experiment", "1", "--path", "AB", "--policy", "road_centred", "--first-seed", "5"
    assert run(out, *options) == 0
    after = state_of(out / "walks")
    assert set(after) - set(before) == {gone.name}
    assert {name: after[name] for name in before} == before
    walked = running.kept(out / "walks", trial, digest(office_site, Settings()))
    assert walked is not None
    assert walked.arrived
    assert walked.contacts == 0
    (blind,) = (row for row in table_of(out) if row["sight"] == "totally blind")
    assert float(blind["mean_m"]) == pytest.approx(walked.deviation_mean_m)
    assert run(out, *options) == 0
    assert state_of(out / "walks") == after
    again = running.run_trial(trial, office_site, Settings())
    assert replace(again, cycle_median_ms=0.0) == replace(walked, cycle_median_ms=0.0)


def test_with_other_settings_what_was_walked_does_not_count(out: Path):
    changed = Settings().changed({"follower.lead_s": 1.1})
    walk_all(out, range(SEED, SEED + 1), changed)
    assert run(out, "--set", "follower.lead_s=1.1", "--experiment", "1", "--path", "DC") == 0
    assert "--set follower.lead_s=1.1" in (out / "experiments.md").read_text(encoding="utf-8")
    stamp = digest(out / "map" / "site", Settings())
    assert all(running.kept(out / "walks", trial, stamp) is None for trial in trials(range(SEED, SEED + 1)))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--experiment", "3"), "argument --experiment: invalid choice: 3"),
        (("--path", "BA"), "argument --path: invalid choice: 'BA'"),
        (("--policy", "fastest"), "argument --policy: invalid choice: 'fastest'"),
        (("--seeds", "0"), "argument --seeds: '0' is no number of one or more"),
        (("--jobs", "-2"), "argument --jobs: '-2' is no number of one or more"),
        (("--seeds", "many"), "argument --seeds: invalid"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_the_word_that_is_wrong(
    out: Path, options: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit) as refused:
        run(out, *options)
    assert refused.value.code == 2
    assert words in capsys.readouterr().err
    assert made(out) == set()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("follower.lead_s", "is not of the form group.name=value"),
        ("follower.leads=1", "follower.leads"),
        ("follower.lead_s=fast", "follower.lead_s cannot be 'fast'"),
        ("follower.lead_s=99", "follower.lead_s"),
        ("follower.policy=mine", "follower.policy"),
    ],
)
def test_a_setting_that_there_is_not_is_refused_in_one_sentence(
    out: Path, text: str, words: str, capsys: pytest.CaptureFixture[str]
):
    assert run(out, "--set", text) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said
    assert made(out) == set()


def test_where_no_folder_can_be_made_that_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert run(tmp_path / "file") == 2
    said = capsys.readouterr().err
    assert str(tmp_path / "file") in said
    assert "Traceback" not in said


def test_nothing_is_walked_without_a_place_for_it(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        main(["experiments"])
    assert "--out" in capsys.readouterr().err


def test_the_help_names_the_walker_that_a_batch_begins_with(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        main(["experiments", "--help"])
    assert f"(default: {FIRST_REPORTING_SEED})" in " ".join(capsys.readouterr().out.split())
