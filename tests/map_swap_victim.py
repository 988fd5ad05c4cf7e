"""Swaps a map in and is killed at the given rename: ``SITE STAGING RENAME``; ends by itself where there are fewer."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

from device_agent.device_store import DeviceStore


def main() -> None:
    """Swap until killed."""
    site, staging, fatal = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    done = 0

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        # Python tells of each change of the disk before it is made.
        nonlocal done
        if event in ("os.rename", "shutil.rmtree"):
            if done == fatal:
                os.kill(os.getpid(), signal.SIGKILL)
            done += 1

    store = DeviceStore(site.parent / "state", site)
    sys.addaudithook(watch)
    store.swap_map(staging)


if __name__ == "__main__":
    main()
