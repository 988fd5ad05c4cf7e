"""A console's incidents in a process of their own, there to be killed: ``FOLDER``. Says the incident's id, and then the
number of each state that is on its way to the disk.
"""

from __future__ import annotations

import sys
from pathlib import Path

from test_alerts_engine import Room

from navcore.modes import Mode


def main() -> None:
    """Keep an incident for ever."""
    room = Room(Path(sys.argv[1]))
    room.call()
    room.walk(3.0, mode=Mode.FAULT, action="stop", reason="sensor_stale")
    sys.stdout.write(room.alerts.active()[0].record.incident_id + "\n")
    number = 0
    while True:
        room.now_s += 1e-6
        room.state(inlier_count=number)
        room.incidents.write()
        sys.stdout.write(f"{number}\n")
        sys.stdout.flush()
        number += 1


if __name__ == "__main__":
    main()
