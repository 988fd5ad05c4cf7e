"""A live device that records a walk until it is killed; says which cycle it has done, and when."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from test_device_agent import Rig

from device_agent.adapters.clocks import SystemClock
from device_agent.recording.options import RecordingOptions
from device_agent.recording.recorder import WalkRecorder
from navcore.wire import SetDestination


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


if __name__ == "__main__":
    main()
