"""A live device that records a walk until it is killed; says which cycle it has done, and when."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from test_device_agent import Rig
from test_recorder import Times, recorded_rig, run

from benchmarks.kills.nursery import say
from device_agent.adapters.clocks import SystemClock
from device_agent.recording.options import RecordingOptions
from device_agent.recording.recorder import WalkRecorder
from navcore.wire import SetDestination

CYCLE_S = 0.1


def main() -> None:
    """Walk for ever."""
    recorder = WalkRecorder(RecordingOptions(Path(sys.argv[1]), sys.argv[2] == "pictures", reserve_bytes=0))
    rig = Rig(clock=SystemClock(), tap=recorder)
    recorder.start()
    rig.agent.submit(SetDestination("bar"))
    number = 0
    while True:
        rig.sonar.echo(None)
        rig.agent.run_cycle()
        number += 1
        # CLOCK_MONOTONIC is the same in all processes of a machine.
        sys.stdout.write(f"{number} {time.monotonic()!r}\n")
        sys.stdout.flush()


def walk(folder: str) -> None:
    """Walk for ever on clocks that are moved by hand: a role of :mod:`benchmarks.kills.nursery`."""
    times = Times()
    rig, recorder = recorded_rig(RecordingOptions(Path(folder), reserve_bytes=0), times)
    rig.agent.submit(SetDestination("bar"))
    number = 0
    while True:
        run(rig, recorder, times, 1, CYCLE_S)
        number += 1
        say(str(number))


ROLES = {"walk": walk}

if __name__ == "__main__":
    main()
