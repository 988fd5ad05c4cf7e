"""What other settings would have changed in a recorded walk: the device's own replay in a process of its own."""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from device_hall import Rig
from mcap.reader import make_reader
from recorded_walk import STORED_WALK
from test_past_walks import take

from console.errors import ConflictError, NotFoundError
from console.past_walks import PastWalks
from console.recordings import Recordings
from console.what_if import MAX_WAITING_COUNT, WhatIfRun, WhatIfs
from console.what_if_result import Decision, DecisionPair, compared, read_decisions
from device_agent.cli import main
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import decision_line, replay
from device_agent.recording.walk_files import parts_in
from navcore.errors import InputError, SettingError
from navcore.settings import Settings, SettingValue, setting_specs
from navcore.wire import ApplySettings, SetDestination

WALK = "20261201T005257Z-glasses-70d9cfae-w1"
WAIT_S = 120.0


@pytest.fixture
def what_ifs(tmp_path: Path) -> Iterator[WhatIfs]:
    recordings = Recordings(tmp_path / "recordings", lambda: 1_800_000_000.0)
    take(recordings, STORED_WALK.read_bytes())
    asked = WhatIfs(PastWalks(recordings), tmp_path / "what-if")
    yield asked
    asked.close()


def answered(what_ifs: WhatIfs, run: WhatIfRun) -> WhatIfRun:
    """Wait until a question is settled; the process that answers it tells nobody."""
    deadline_s = time.monotonic() + WAIT_S
    while run.state in ("waiting", "running"):
        assert time.monotonic() < deadline_s, "it was never answered"
        threading.Event().wait(0.05)
        run = what_ifs.run(run.run_id)
    return run


def decision(
    action: str, reason: str = "ok", direction_deg: float | None = 0.0, cues: tuple[str, ...] = ()
) -> Decision:
    sentence = f"{action.capitalize()}: because of {reason}."
    return Decision(action, reason, "a rule", direction_deg, 0.2, cues, sentence)  # type: ignore[arg-type]


def pairs(*sides: tuple[Decision, Decision], step_s: float = 0.5) -> tuple[DecisionPair, ...]:
    found = []
    for number, (then, now) in enumerate(sides):
        names = [name for name in Decision.__struct_fields__ if getattr(then, name) != getattr(now, name)]
        found.append(DecisionPair(number, 10.0 + number * step_s, tuple(names), then, now))
    return tuple(found)


def test_other_settings_are_compared_with_then_and_remembered(what_ifs: WhatIfs) -> None:
    changes: dict[str, SettingValue] = {"follower.policy": "paper", "obstacle.low_height_m": 0.2}
    run = answered(what_ifs, what_ifs.start(WALK, changes))
    assert (run.state, run.why, run.percent) == ("done", "", 100)
    assert run.not_judged == ("obstacle.low_height_m",), "never no change"
    assert run.result is not None
    assert run.result.cycle_count == 83
    assert 0.0 < run.result.different_s < run.result.length_s
    assert run.result.then.seconds["walk"] == pytest.approx(52 * 0.2, abs=0.25)
    assert sum(run.result.now.seconds.values()) == pytest.approx(run.result.length_s)
    assert what_ifs.start(WALK, dict(reversed(changes.items()))) is run, "the same question is not asked twice"
    part = answered(what_ifs, what_ifs.start(WALK, changes, last_s=10.0)).result
    assert part is not None
    assert part.length_s == pytest.approx(10.0, abs=0.5)


def test_what_no_recording_can_show_is_said_and_nothing_is_started(what_ifs: WhatIfs) -> None:
    run = what_ifs.start(WALK, {"localization.feature_count": 800})
    assert (run.state, run.not_judged) == ("failed", ("localization.feature_count",))
    assert run.why.startswith("None of these can be judged")
    with pytest.raises(SettingError):
        what_ifs.start(WALK, {"no.such": 1})
    with pytest.raises(NotFoundError):
        what_ifs.start("another", {"gate.clearance_m": 1.5})
    failed = answered(what_ifs, what_ifs.start(WALK, {"gate.clearance_m": 99.0}))
    assert failed.state == "failed"
    assert "from 0.5 to 4" in failed.why


def test_what_was_asked_of_a_deleted_walk_is_forgotten(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path / "recordings", lambda: 1_800_000_000.0)
    take(recordings, STORED_WALK.read_bytes())
    what_ifs = WhatIfs(PastWalks(recordings), tmp_path / "what-if")
    try:
        settled = what_ifs.cancel(what_ifs.start(WALK, {"gate.clearance_m": 2.5}).run_id)
        what_ifs.forget_deleted()
        assert what_ifs.run(settled.run_id).state == "cancelled", "its walk is still here"
        going_on = what_ifs.start(WALK, {"gate.clearance_m": 3.0})
        assert recordings.delete_before(1_900_000_000.0) == 1
        what_ifs.forget_deleted()
        for run in (settled, going_on):
            with pytest.raises(NotFoundError):
                what_ifs.run(run.run_id)
    finally:
        what_ifs.close()


def test_questions_are_bounded_in_time_and_number_and_may_be_given_up(what_ifs: WhatIfs) -> None:
    runs = [what_ifs.start(WALK, {"gate.clearance_m": 1.0 + number / 10}) for number in range(MAX_WAITING_COUNT)]
    # How many of them have been taken up by now is nobody's promise.
    with pytest.raises(ConflictError, match="wait already"):
        _ = [what_ifs.start(WALK, {"gate.clearance_m": 2.0 + number / 10}) for number in range(2 * MAX_WAITING_COUNT)]
    for run in runs[1:]:
        assert what_ifs.cancel(run.run_id).state in ("cancelled", "done")
    assert what_ifs.start(WALK, {"gate.clearance_m": 1.7}).state in ("waiting", "running"), "given up, and asked anew"
    what_ifs.close()
    hurried = WhatIfs(what_ifs._walks, what_ifs._folder, max_run_s=0.05)
    late = answered(hurried, hurried.start(WALK, {"gate.clearance_m": 1.5}))
    hurried.close()
    assert (late.state, "choose a shorter walk" in late.why) == ("failed", True)


def test_what_was_found_in_a_walk_is_gone_with_it_and_so_is_what_a_killed_console_left(
    what_ifs: WhatIfs, tmp_path: Path
) -> None:
    run = what_ifs.start(WALK, {"gate.clearance_m": 1.5})
    recordings = what_ifs._walks.recordings
    recordings.delete_before(2e9)
    with pytest.raises(NotFoundError, match="deleted"):
        what_ifs.run(run.run_id)
    what_ifs.forget_deleted()
    take(recordings, STORED_WALK.read_bytes())
    with pytest.raises(NotFoundError, match="not remembered"):
        what_ifs.run(run.run_id)
    what_ifs.close()
    (tmp_path / "what-if" / "left").mkdir(parents=True, exist_ok=True)
    WhatIfs(what_ifs._walks, tmp_path / "what-if")
    assert not (tmp_path / "what-if").exists()


def test_unchanged_settings_replay_to_the_bit() -> None:
    """Set to the value of then, all comes to the same: the directions that are found anew as well."""
    then = Settings().values()
    same = {
        spec.key: then[spec.key] for spec in setting_specs() if spec.replayed and spec.group in ("obstacle", "gate")
    }
    cycles = list(replay([RecordedPart(STORED_WALK)], changes=same))
    assert len(cycles) == 83
    assert all(not cycle.differs_in and not decision_line(cycle)["differs_in"] for cycle in cycles)


def test_what_was_changed_on_the_way_then_does_not_undo_what_is_looked_at() -> None:
    """In the stored walk somebody sets d to 1.5 m on the way."""
    far, as_then = (
        {
            cycle.notes.number: cycle.cycle.guidance.trace.sub_goal
            for cycle in replay([RecordedPart(STORED_WALK)], changes={"follower.policy": "paper", **more})
            if 4.7 < cycle.notes.guidance.stamp_s < 6.0
        }
        for more in ({"follower.sub_goal_distance_m": 6.0}, {})
    )
    assert len(far) > 5
    for number, sub_goal in far.items():
        before = as_then[number]
        assert sub_goal is not None
        assert before is not None
        assert sub_goal.x_m > before.x_m + 1.0


def test_what_runs_again_after_a_trial_does_not_undo_what_is_looked_at(tmp_path: Path) -> None:
    """The recording begins while something is tried out, which ends on the way."""
    rig = Rig(tap=(recorder := WalkRecorder(RecordingOptions(tmp_path, reserve_bytes=0))))
    rig.agent.submit(ApplySettings(1, {"gate.clearance_m": 1.5}, revert_after_s=1.5))
    rig.cycles(2)
    rig.agent.submit(SetDestination("bar"))
    for _ in range(30):
        rig.cycles(1)
        recorder.check()
    recorder.close()
    (part,) = (each for each in map(RecordedPart, parts_in(tmp_path)) if each.opening.state.trial is not None)
    as_then = list(replay([part]))
    assert not any(cycle.differs_in for cycle in as_then)
    assert {cycle.cycle.guidance.trace.gate_m for cycle in as_then} >= {1.5, 2.0}, "it ended on the way"
    told_m = [
        cycle.cycle.guidance.trace.gate_m
        for cycle in replay([part], changes={"gate.clearance_m": 1.3})
        if cycle.cycle.guidance.trace.gate_m is not None
    ]
    assert len(told_m) > 20
    assert set(told_m) == {1.3}


def test_the_command_writes_each_decision_then_and_now(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "decisions.jsonl"
    assert main(["walks", "replay", str(STORED_WALK), f"--decisions={out}", "--json"]) == 0
    lines = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    assert len(lines) == json.loads(capsys.readouterr().out)["cycles"] == 83
    assert all(line["then"] == line["now"] and line["differs_in"] == [] for line in lines)
    assert len(read_decisions(out)) == 83
    # The words are those that the player of the same walk shows.
    with STORED_WALK.open("rb") as file:
        told = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages("/device")]
    for line, state in zip(lines, told, strict=True):
        assert line["then"]["sentence"].startswith(line["then"]["action"].capitalize())
        assert line["then"]["sentence"] == line["now"]["sentence"]
        assert line["then"]["action"] == state["action"]


def test_what_was_told_then_is_told_with_the_settings_of_then(tmp_path: Path) -> None:
    """How many pictures must agree before a stop ends is in the sentence: that of then must not be that of now."""
    out = tmp_path / "decisions.jsonl"
    change = "--set=obstacle.leave_frames_count=5"
    assert main(["walks", "replay", str(STORED_WALK), change, f"--decisions={out}", "--json"]) == 1
    needed = re.compile(r"\d of (\d) pictures in a row")
    pairs = read_decisions(out)
    assert {each for pair in pairs for each in needed.findall(pair.now.sentence)} == {"5"}
    assert {each for pair in pairs for each in needed.findall(pair.then.sentence)} <= {"3"}
    assert not any("The way is free" in sentence for pair in pairs for sentence in (pair.then.words, pair.now.words))


def test_what_differs_is_counted_as_a_walker_would_count_it() -> None:
    walk, stop = decision("walk"), decision("stop", "no_candidate", None, ("Stop.",))
    back, sonar = decision("walk", "off_road", 32.0), decision("stop", "obstacle_sonar", None)
    found = compared(pairs((walk, walk), (walk, stop), (walk, stop), (sonar, stop), (walk, back), (walk, walk)))
    assert (found.length_s, found.different_s) == (3.0, 2.0)
    assert found.then.seconds == {"walk": 2.5, "turn": 0.0, "stop": 0.5}
    assert found.now.seconds == {"walk": 1.5, "turn": 0.0, "stop": 1.5}
    assert (found.then.stop_count, found.now.stop_count) == (1, 1)
    assert found.now.stops_by_reason == {"No free direction in view.": 1}
    assert (found.then.no_way_count, found.now.no_way_count, found.now.off_road_count) == (0, 1, 1)
    assert (found.then.cue_count, found.now.cue_count) == (0, 3)
    arrives = compared(pairs((walk, walk), (decision("stop", "arrived", None), stop)))
    assert (arrives.then.stop_count, arrives.now.stop_count) == (0, 1), "to arrive is no stop"
    (stretch,) = found.different
    assert (stretch.from_s, stretch.to_s) == (0.5, 2.5)
    assert stretch.then == "Walk: because of ok."
    assert stretch.now == "Stop: because of no_candidate. “Stop.”"
    assert [(band.from_s, band.then, band.now) for band in found.bands] == [
        (0.0, "walk", "walk"), (0.5, "walk", "stop"), (1.5, "stop", "stop"), (2.0, "walk", "walk"),
    ]  # fmt: skip
    assert [one.at_s for one in found.instants] == [0.0, 0.5, 1.5, 2.0, 2.5], "at each change, and every second"
    assert found.instants[3].now == "Walk: because of off_road."


def test_a_gap_counts_for_no_decision_and_what_is_only_measured_is_no_difference() -> None:
    first, second = pairs((decision("walk"), decision("walk")), (decision("walk"), decision("walk")), step_s=60.0)
    measured = DecisionPair(2, 71.0, ("deviation_m", "rule"), decision("walk"), decision("walk"))
    found = compared((first, second, measured))
    assert found.then.seconds["walk"] == 3.0
    assert found.different == ()
    with pytest.raises(InputError, match="not one whole cycle"):
        compared(())


def test_damaged_decisions_are_told(tmp_path: Path) -> None:
    (tmp_path / "cut.jsonl").write_text('{"cycle": 1, "stamp_s": 0.2', encoding="utf-8")
    with pytest.raises(InputError, match="cannot be read"):
        read_decisions(tmp_path / "cut.jsonl")
    with pytest.raises(InputError, match="cannot be read"):
        read_decisions(tmp_path / "none.jsonl")
