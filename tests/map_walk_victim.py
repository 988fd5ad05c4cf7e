"""A live device in a map walk until it is killed; says which frame it has taken, and when."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from map_walk_rig import walk_frames

from device_agent.adapters.clocks import SystemClock
from device_agent.localization import make_localizer
from device_agent.map_walk.map_walks import DeviceMapWalks, WalkPlan
from device_agent.simulation.sensors import head_camera
from navcore.settings import Settings


def main() -> None:
    """Walk to the end, and then to and fro on the last frames."""
    frames, clock = walk_frames(max_length_m=2.5), SystemClock()
    folder = Path(sys.argv[1])
    walks = DeviceMapWalks(
        WalkPlan(folder / "map-walks", folder / "site"), head_camera(320, 240), make_localizer, lambda order: None
    )
    walks.begin(Settings())
    number = 0
    while True:
        clock.sleep_until(clock.now_s() + 0.1)
        shown = frames[number] if number < len(frames) else frames[-1 - number % 2]
        walks.take(replace(shown, stamp_s=clock.now_s()))
        if number == 3:
            walks.mark("Place 1")
        number += 1
        sys.stdout.write(f"{number} {clock.now_s()!r}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
