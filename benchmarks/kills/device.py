"""What a device keeps on its disk, and that it is whole after a kill at any moment.

A victim does one thing after the other that a device does to its disk, each decided by the seed and its number, and
says when it is done. After a kill each kind of thing is as the last one that was done left it, or as the one that was
on its way would have; a new start finds it so, and clears up what was half-written.
"""

from __future__ import annotations

import itertools
import random
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.kills.nursery import Nursery, must, say
from benchmarks.kills.sites import small_site
from device_agent.calibration_store import CalibrationStore
from device_agent.device_store import DeviceStore
from device_agent.journal import EventJournal, refuse_damaged
from device_agent.map_walk.walk_folder import WalkState, new_walk, read_state, walks_in, write_state
from device_agent.recording.settled import SENT_FILE
from device_agent.recording_queues import WalkQueue
from device_agent.sharing import Consent
from navcore.calibration import Calibration, FloorCalibration
from navcore.planning.poi_graph import PoiGraph
from navcore.settings import Settings
from navcore.site import load_poi_graph, save_site
from navcore.wire import Access, Accesses

Values = dict[str, Any]
KINDS = ("settings", "consent", "accesses", "graph", "map", "walk", "calibration", "events", "settled")
_EVENTS_AT_ONCE = 5
_LONGEST_DELAY_S = 0.02
_MOST_DONE = 25


class Keeping:
    """A device's folders, the things that it does to them, and what is in them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.store = DeviceStore(folder / "state", folder / "site")
        self.walks, self.recordings = folder / "map-walks", folder / "walks"
        self.calibrations = CalibrationStore(folder / "state")

    def begin(self) -> Values:
        """Make what a device has before its first start; return the values."""
        self.recordings.mkdir()
        self.store.state_folder.mkdir()
        save_site(small_site(), self.store.site_folder)
        return {"settings": 0, "consent": 0, "accesses": 0, "site": ("Small site", 1), "walk": (), "calibration": 0,
                "events": (), "settled": {}}  # fmt: skip

    def do(self, kind: str, number: int, journal: EventJournal) -> None:
        """Do the ``number``-th thing, of a kind."""
        match kind:
            case "settings":
                self.store.save_settings(Settings().changed({"planning.replan_hold_s": 1.0 + number % 20}), number)
            case "consent":
                self.store.save_consent(Consent(walks=number % 2 == 0, version=number))
            case "accesses":
                self.store.save_accesses(Accesses((Access("Ada", "watch", 0.0, float(number)),), 0.0, 0.0))
            case "graph":
                self.store.save_graph(PoiGraph(version=number))
            case "map":
                staging = self.folder / ".site-incoming" / "new"
                shutil.rmtree(staging.parent, ignore_errors=True)
                save_site(replace(small_site(), name=f"Map {number}"), staging)
                self.store.swap_map(staging)
            case "walk" if number % 3 == 0 or not walks_in(self.walks):
                new_walk(self.walks, str(number))
            case "walk":
                write_state(walks_in(self.walks)[-1], WalkState("recorded", str(number)))
            case "calibration":
                floor = FloorCalibration(float(number), 1.6, 0.01, 0.1, 0.01, 0.0, 0.01, 30)
                self.calibrations.store(Calibration(floor), float(number))
            case "events":
                for index in range(_EVENTS_AT_ONCE):
                    journal.append(float(number), "cue", f"{number} {index}")
                journal.flush()
            case "settled":
                recording = self.recordings / _recording(number)
                recording.touch()
                WalkQueue(self.recordings, lambda: True).settle(recording, str(number))

    def after(self, values: Values, kind: str, number: int) -> Values:
        """Return the values after that."""
        match kind:
            case "graph":
                return values | {"site": (values["site"][0], number)}
            case "map":
                return values | {"site": (f"Map {number}", 1)}
            case "walk" if number % 3 == 0 or not values["walk"]:
                return values | {"walk": (*values["walk"], str(number))}
            case "walk":
                return values | {"walk": (*values["walk"][:-1], str(number))}
            case "events":
                return values | {"events": (*values["events"], *(f"{number} {i}" for i in range(_EVENTS_AT_ONCE)))}
            case "settled":
                return values | {"settled": values["settled"] | {_recording(number): str(number)}}
            case _:
                return values | {kind: number}

    def found(self) -> Values:
        """Start as a device does, and return the values that it finds."""
        self.store.clear_up([*walks_in(self.walks), self.recordings])
        site = self.store.load_map()
        must(self.store.went_back == "", "the map could not be read:", self.store.went_back)
        accesses = self.store.load_accesses(0.0)
        stored = self.calibrations.load()
        made_s = 0.0 if stored is None or stored.calibration.floor is None else stored.calibration.floor.made_s
        settled = self.recordings / SENT_FILE
        known = msgspec.json.decode(settled.read_bytes()) if settled.exists() else {}
        return {
            "settings": self.store.stored_settings()[1],
            "consent": self.store.load_consent().version,
            "accesses": 0 if accesses is None else int(accesses.entries[0].ended_s),
            "site": (site.name, load_poi_graph(self.store.site_folder).version),
            "walk": tuple(read_state(walk).date for walk in walks_in(self.walks)),
            "calibration": int(made_s),
            "events": self._events(),
            "settled": {name: each["failure"] for name, each in known.items()},
        }

    def _events(self) -> tuple[str, ...]:
        refuse_damaged(self.store.journal_path)
        journal = EventJournal(self.store.journal_path)
        must(journal.damaged is None, "the journal is damaged")
        events = journal.pending(0, 1_000_000)
        journal.close()
        must([event.sequence for event in events] == list(range(1, len(events) + 1)), "the journal has gaps")
        return tuple(event.text for event in events)

    def leftovers(self) -> list[Path]:
        """Return what was half-written and is still there."""
        meant = {".site-previous", ".site-incoming", ".new-walk", "events.sqlite-wal", "events.sqlite-shm"}
        found = [path for path in self.folder.rglob(".*") if not meant & set(path.parts)]
        return found + [path for path in self.folder.rglob("*.new") if not meant & set(path.parts)]


def _recording(number: int) -> str:
    return f"20260101T000000Z-glasses-{number + 100}.mcap"


def _thing(seed: int, number: int) -> str:
    return random.Random(f"{seed} {number}").choice(KINDS)


def keep(folder: str, seed: str, number: str) -> None:
    """Do things from the ``number``-th on until killed; the role of a victim."""
    keeping = Keeping(Path(folder))
    journal = EventJournal(keeping.store.journal_path)
    for each in itertools.count(int(number)):
        keeping.do(_thing(int(seed), each), each, journal)
        say(str(each))


ROLES = {"keep": keep}


class KilledDevice:
    """What a device keeps, and one life of it after the other."""

    def __init__(self, folder: Path, seed: int, nursery: Nursery) -> None:
        """``folder`` must be empty."""
        self._nursery, self._seed, self._dice = nursery, seed, random.Random(seed)
        self._keeping = Keeping(folder)
        self._values = self._keeping.begin()
        self._number = 1
        self.kill_count = self.request_count = 0

    def kill_once(self) -> None:
        """Let it work, kill it somewhere, and look whether all is whole."""
        victim = self._nursery.bear("keep", self._keeping.folder, self._seed, self._number)
        done = [victim.says() for _ in range(self._dice.randrange(_MOST_DONE))]
        time.sleep(self._dice.uniform(0.0, _LONGEST_DELAY_S))
        done += victim.kill()
        self.kill_count += 1
        self.request_count += len(done)
        for line in done:
            must(int(line) == self._number, "out of order:", line, self._number)
            self._values = self._keeping.after(self._values, _thing(self._seed, self._number), self._number)
            self._number += 1
        kind = _thing(self._seed, self._number)
        after = self._keeping.after(self._values, kind, self._number)
        found = self._keeping.found()
        # What was on its way is whole, or was not begun; of events, the first few may have been kept.
        for each, value in found.items():
            before = self._values[each]
            is_some = each == "events" and kind == "events" and after[each][: len(value)] == value
            is_well = value in (before, after[each]) or (is_some and len(value) >= len(before))
            must(is_well, f"{each} after the kill at {self._number} ({kind}):", value, before)
        must(self._keeping.leftovers() == [], "half-written files stay:", self._keeping.leftovers())
        self._values = found
        self._number += 1

    def close(self) -> None:
        """Nobody is left behind."""
