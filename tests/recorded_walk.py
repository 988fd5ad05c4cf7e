"""A short walk among boxes with all that can happen in it, recorded; and the stored one that tests compare with.

``python tests/recorded_walk.py`` makes the stored walk, and the list of what is heard in it, anew: needed only where
the form of a recording has changed. Where guidance is meant to have changed,
``vbr walks replay tests/data/walk.mcap --cues tests/data/walk_cues.jsonl`` writes the list alone.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

from closed_loop import BoxWorld, NoisyTruth, box

from device_agent.ports import Button, ButtonPress, PressKind
from device_agent.recording import part_writer
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.replay import cue_line, replay
from device_agent.recording.tap import Tap
from device_agent.recording.walk_files import parts_in
from device_agent.simulation.building import Start
from device_agent.simulation.walker import drawn_walker
from device_agent.state import DeviceState
from device_agent.walk import Moment, lead
from navcore.cues.table import Cue
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.settings import Settings
from navcore.types import Guidance
from navcore.wire import ApplySettings, Pause, Resume, Say

DATA = Path(__file__).resolve().parent / "data"
STORED_WALK, STORED_CUES = DATA / "walk.mcap", DATA / "walk_cues.jsonl"
_WALLS = (box(-2.0, 1.2, 9.2, 1.4), box(-2.0, -1.4, 9.2, -1.2), box(8.0, -1.2, 8.2, 1.2), box(-2.2, -1.4, -2.0, 1.4))
_IN_THE_WAY = box(3.0, -1.0, 3.4, -0.1)
_GRAPH = PoiGraph(
    1,
    {"a": Poi("a", "Door", "door", 0.0, 0.0), "b": Poi("b", "Window", "other", 6.5, 0.0)},
    {"ab": Edge("ab", "a", "b", ((0.0, 0.0), (6.5, 0.0)), 6.5)},
)
_ORDERS = (
    (1.4, ButtonPress(1.4, Button.REPEAT, PressKind.SHORT)), (2.0, Pause()),
    (2.6, Resume()), (4.0, Say("Mind the step.")),
    (4.5, ApplySettings(7, {"follower.sub_goal_distance_m": 1.5})),
)  # fmt: skip
"""What the walker, and somebody at the console, ask for, and when."""


@dataclass(frozen=True)
class Walked:
    """What came of the walk while it was walked."""

    guidance: tuple[Guidance, ...]
    cues: tuple[Cue, ...]
    modes: tuple[str, ...]


def walk_among_boxes(tap: Tap, max_s: float = 40.0, rate_hz: float = 10.0, seed: int = 1) -> Walked:
    """Walk round a box, with a pause, a message, another setting, and without a pose for a second; then close."""
    world = BoxWorld((*_WALLS, _IN_THE_WAY), (), drawn_walker(seed), Start(0.0, 0.0, 0.0), seed)
    localizer = NoisyTruth(world, seed)
    localizer.lost_s = (6.0, 7.0)
    orders = list(_ORDERS)

    def meanwhile(moment: Moment) -> None:
        while orders and moment.world.now_s() >= orders[0][0]:
            moment.agent.submit(orders.pop(0)[1])

    state = DeviceState(Settings(), _GRAPH, "boxes", "boxes-map")
    samples, cues = lead(world, state, localizer, "b", max_s=max_s, rate_hz=rate_hz, tap=tap, meanwhile=meanwhile)
    return Walked(tuple(each.cycle.guidance for each in samples), cues, tuple(each.mode for each in samples))


def record(folder: Path, *, pictures: bool = False, max_s: float = 40.0, rate_hz: float = 10.0) -> Walked:
    """Record the walk in one file, and complete it."""
    recorder = WalkRecorder(RecordingOptions(folder, pictures, reserve_bytes=0))
    walked = walk_among_boxes(recorder, max_s, rate_hz)
    recorder.close()
    return walked


def heard_again(path: Path) -> list[dict[str, object]]:
    """Return what the loop of today says in a recorded walk."""
    return [cue_line(cue) for cycle in replay([RecordedPart(path)]) for cue in cycle.cues]


def main() -> None:
    """Make the stored walk anew."""
    DATA.mkdir(exist_ok=True)
    # Many chunks, however fast the walk is made: tests cut it in the middle.
    part_writer._CHUNK_BYTES = 1 << 16
    with tempfile.TemporaryDirectory() as folder:
        record(Path(folder), rate_hz=5.0)
        shutil.copy(parts_in(Path(folder))[0], STORED_WALK)
    lines = [json.dumps(line, ensure_ascii=False) + "\n" for line in heard_again(STORED_WALK)]
    STORED_CUES.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
