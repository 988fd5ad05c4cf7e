"""A device that walks in lock step beside a real link: ``URL TOKEN FOLDER MAP_CHECKSUM``, told what to do line by line.

``walk N`` goes round N times and says ``walked HASH`` of all decisions and cues so far; ``events N`` hands over N
events and says ``kept M`` when they are on the disk; ``record N`` leaves a recording of N bytes that is to be sent;
``link`` says how the link stands; ``open`` says how many threads, file handles and look-ups there are; ``stop`` ends in
good order.
"""

from __future__ import annotations

import hashlib
import math
import os
import sys
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
from device_hall import Rig, pose_at

from device_agent.adapters.clocks import SystemClock
from device_agent.journal import EventJournal
from device_agent.link import ConsoleLink
from device_agent.link_settings import LinkSettings
from device_agent.map_walk.walk_folder import WalkState, new_walk, write_state
from device_agent.ports import EventKind, Uplink
from device_agent.sharing import LinkStands
from device_agent.state import MapWalkTold
from navcore.types import Action
from navcore.wire import ConsoleMessage, Hello, WalkerState

STEP_M, BACK_TO_M, FAR_M = 0.05, 0.5, 18.0


class LockStepWalk:
    """A walker in an empty hall who goes where they are told, and begins again before they are there."""

    def __init__(self, link: Uplink | None = None) -> None:
        self.rig = Rig(link=link)
        self._x_m, self._digest, self._cues = BACK_TO_M, hashlib.sha256(), 0
        self.rig.lead_to()

    def walk(self, count: int, pause_s: float = 0.0) -> str:
        """Go round; return the hash of all that was decided and said so far."""
        for _ in range(count):
            (cycle,) = self.rig.cycles(1)
            guidance = cycle.guidance
            said = [(cue.kind.value, cue.text) for cue in self.rig.output.cues[self._cues :]]
            self._cues = len(self.rig.output.cues)
            decided = (guidance.action.value, guidance.reason.value, repr(guidance.direction), said)
            self._digest.update(repr(decided).encode())
            self._x_m = self._x_m + STEP_M if guidance.action is Action.WALK else self._x_m
            self._x_m = BACK_TO_M if self._x_m > FAR_M else self._x_m
            self.rig.pose = pose_at(self._x_m)
            time.sleep(pause_s)
        return self._digest.hexdigest()


class InRealTime(ConsoleLink):
    """A link that stamps what a lock-step walk tells with the time of now, so that ages are true ones."""

    def state(self, state: WalkerState) -> None:
        """Offer the newest state."""
        super().state(msgspec.structs.replace(state, stamp_s=self._clock.now_s(), last_cue_stamp_s=None))

    def event(self, stamp_s: float, kind: EventKind, text: str) -> None:
        """Hand over an event."""
        super().event(self._clock.now_s(), kind, text)


class Device:
    """What the link needs of a device."""

    def __init__(self, map_checksum: str) -> None:
        self.walk: LockStepWalk | None = None
        self._map_checksum = map_checksum

    def hello(self) -> Hello:
        """Return a hello of a device that has the console's map already."""
        assert self.walk is not None
        return msgspec.structs.replace(self.walk.rig.agent.hello(), map_checksum=self._map_checksum)

    def submit(self, order: ConsoleMessage | MapWalkTold | LinkStands, holds_s: float = math.inf) -> None:
        """Hand an order to the loop."""
        if isinstance(order, MapWalkTold):
            say(f"told {order.phrases[0].key}")
            return
        assert self.walk is not None
        self.walk.rig.agent.submit(order, holds_s)

    def map_arrived(self, staging: Path, checksum: str) -> None:
        """None is offered."""


def say(line: str) -> None:
    """Tell the test."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    """Do as told."""
    url, token, folder, map_checksum = sys.argv[1:]
    journal = EventJournal(Path(folder) / "events.sqlite")
    settings = LinkSettings(
        url, token, Path(folder) / "incoming", first_pause_s=0.1, longest_pause_s=0.5, answer_timeout_s=2.0,
        map_walks=Path(folder) / "map-walks",
    )  # fmt: skip
    link, device = InRealTime(settings, journal, SystemClock()), Device(map_checksum)
    device.walk = LockStepWalk(link)
    link.start(device)
    say("ready")
    handed_over = 0
    for line in sys.stdin:
        what, _, number = line.strip().partition(" ")
        match what:
            case "walk":
                say(f"walked {device.walk.walk(int(number), pause_s=0.02)}")
            case "events":
                for _ in range(int(number)):
                    link.event(0.0, "link", f"told {handed_over}")
                    handed_over += 1
                journal.flush()
                say(f"kept {handed_over}")
            case "record":
                recorded(Path(folder) / "map-walks", int(number))
                link.recording_waits()
            case "link":
                say(f"link {link.link_state.condition.value}")
            case "open":
                # The executor of the link's loop has up to its few threads whenever there was work for them at once.
                names = [each.name for each in threading.enumerate() if not each.name.startswith("asyncio_")]
                say(f"open {len(names)} {len(os.listdir('/proc/self/fd'))} {names.count('look-up')}")
            case _:
                break
    link.stop()
    journal.close()
    say("stopped")


def recorded(folder: Path, size_bytes: int) -> None:
    """Leave a recording that waits to be sent."""
    walk = new_walk(folder, "2026-11-29")
    (walk / "rgb").mkdir()
    (walk / "rgb" / "0.png").write_bytes(np.random.default_rng(5).bytes(size_bytes))
    write_state(walk, WalkState("handed_over", "2026-11-29"))


if __name__ == "__main__":
    main()
