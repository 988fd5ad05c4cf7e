"""A device's link in a process of its own, there to be killed: ``URL TOKEN FOLDER RUN``.

Each line of its input is a number of events to hand over; when they are on the disk, it says how many there are so far.
Maps that it is offered are fetched to ``FOLDER/incoming``; it says ``map CHECKSUM`` when one has come. Recordings of
map walks in ``FOLDER/map-walks`` go to the console; it says ``told KEY`` of what is to be said then.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from device_agent.adapters.clocks import SystemClock
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.state import MapWalkTold
from navcore.wire import PROTOCOL_VERSION, ConsoleMessage, Hello

DEVICE_ID = "glasses"


def say(line: str) -> None:
    """Tell the test."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


class Device:
    """What the link needs of a device."""

    def hello(self) -> Hello:
        """Return a hello of a device that runs another map than the console's."""
        return Hello(PROTOCOL_VERSION, DEVICE_ID, "0.1.0", "small", "another", 0, 0, 0.0)

    def submit(self, order: ConsoleMessage | MapWalkTold, holds_s: float = math.inf) -> None:
        """Nobody gives orders here; what is to be said of a map walk is said."""
        if isinstance(order, MapWalkTold):
            say(f"told {order.phrases[0].key}")

    def map_arrived(self, staging: Path, checksum: str) -> None:
        """Tell of the map."""
        say(f"map {checksum}")


def linked(url: str, token: str, folder: str) -> tuple[ConsoleLink, EventJournal, SystemClock]:
    """Return a link that dials, with its journal and clock."""
    journal = EventJournal(Path(folder) / "events.sqlite")
    settings = LinkSettings(
        url, token, Path(folder) / "incoming", first_pause_s=0.02, longest_pause_s=0.1,
        map_walks=Path(folder) / "map-walks",
    )  # fmt: skip
    clock = SystemClock()
    link = ConsoleLink(settings, journal, clock)
    link.start(Device())
    return link, journal, clock


def talk(url: str, token: str, folder: str, run: str, count: str) -> None:
    """Hand over events, one after the other, and say of each that it is on the disk; at last that all are confirmed.

    A role of :mod:`benchmarks.kills.nursery`.
    """
    link, journal, clock = linked(url, token, folder)
    for number in range(int(count)):
        link.event(clock.now_s(), "cue", f"{run} {number}")
        journal.flush()
        say(str(number + 1))
    while journal.pending(0, 1):
        clock.sleep_until(clock.now_s() + 0.02)
    say("all confirmed")


ROLES = {"talk": talk}


def main() -> None:
    """Hand over events as asked."""
    url, token, folder, run = sys.argv[1:]
    link, journal, clock = linked(url, token, folder)
    said = 0
    say("ready")
    for line in sys.stdin:
        for _ in range(int(line)):
            link.event(clock.now_s(), "cue", f"{run} {said}")
            said += 1
        journal.flush()
        say(str(said))


if __name__ == "__main__":
    main()
