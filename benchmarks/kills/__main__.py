"""``python -m benchmarks.kills --kills 1000 --first-seed N``: kills console and device, and looks after each kill."""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from functools import partial
from pathlib import Path

from benchmarks.kills.console import KilledConsole
from benchmarks.kills.device import KilledDevice
from benchmarks.kills.nursery import Nursery

KILLS_PER_FOLDER = 25
MAPS_SHARE = 0.08
"""So many of the kills wait for a map that is built."""


def main() -> None:
    """Kill, and say how often all was well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("/dev/shm"), help="a disk that is quick")
    parser.add_argument("--what", choices=("console", "device"), default="console")
    arguments = parser.parse_args()
    kind = partial(KilledConsole, maps_share=MAPS_SHARE) if arguments.what == "console" else KilledDevice
    began_s = time.monotonic()
    done = requests = seed = 0
    while done < arguments.kills:
        folder = Path(tempfile.mkdtemp(prefix="vbr-kills-", dir=arguments.folder))
        nursery = Nursery(f"benchmarks.kills.{arguments.what}", folder / "log")
        killed = None
        try:
            (folder / "all").mkdir()
            killed = kind(folder / "all", arguments.first_seed + seed, nursery)
            for _ in range(min(KILLS_PER_FOLDER, arguments.kills - done)):
                killed.kill_once()
                done += 1
        except BaseException:
            print(f"seed {arguments.first_seed + seed}, kill {killed.kill_count if killed else 0}: see {folder}")
            raise
        finally:
            if killed is not None:
                killed.close()
            nursery.close()
        requests += killed.request_count
        seed += 1
        shutil.rmtree(folder)
        print(f"{done} kills, {requests} requests, {time.monotonic() - began_s:.0f} s", flush=True)


if __name__ == "__main__":
    main()
