"""Somebody who has maps built while the console is killed: no half map is ever there, and none is built for ever."""

from __future__ import annotations

import hashlib
import json
import random
import time
from pathlib import Path
from typing import Any

import httpx

from benchmarks.kills.nursery import must
from benchmarks.kills.sites import MAP_WALK_NAME, small_map_walk
from navcore.recording_upload import OFFERS_PATH, PIECE_BYTES, piece_path
from navcore.site import load_site

_LONGEST_BUILD_S = 1200.0
"""A machine that compiles the program first, and has much else to do, takes minutes."""
_ASKS_SHARE = 0.3


class Surveyor:
    """Asks for maps of a map walk, and of recordings that are none, and looks what became of them."""

    def __init__(self, http: httpx.Client, device: httpx.Client, dice: random.Random, data: Path) -> None:
        self.http, self.dice, self._device = http, dice, device
        self._recordings, self._maps = data / "recordings", data / "maps"
        self._sha256 = ""
        self._asked: set[str] = set()
        self._built: set[str] = set()
        self.done_count = 0

    def check(self) -> None:
        """What was asked for is built or not, and says so; each map is whole, and has a recording that tells of it."""
        if not self._sha256:
            self._send_the_walk()
        told = self._told()
        for sha256, built in told.items():
            must(built["stage"] != "building", "a map is being built, and nobody builds it:", sha256, built)
            must(sha256 not in self._asked or built["stage"] != "none", "a map was asked for, and forgotten:", sha256)
        self._take(told)
        there = set(self._maps.glob(f"{MAP_WALK_NAME}-*"))
        missing = self._built - {path.name for path in there}
        must(not missing, "maps that were built are gone:", missing)
        for path in there:
            load_site(path)
        # Whatever came to its place without an answer is told of by its recording, which knows only the last one.
        untold = {path.name for path in there} - self._built
        must(not untold, "a map is there that nobody tells of:", untold)
        self._asked.clear()

    def turn(self) -> None:
        """Ask for a map, or look how far one is."""
        if self.dice.random() < _ASKS_SHARE:
            self._ask(self.dice.choice(sorted(self._told())))
        else:
            self._take(self._told())
        self.done_count += 1

    def wait_until_a_map_comes(self) -> None:
        """Have the map of the walk built; return when it is about to come to its place, or soon after."""
        deadline_s = time.monotonic() + _LONGEST_BUILD_S
        while self._sha256 not in self._asked:
            must(time.monotonic() < deadline_s, "no map is begun")
            self._ask(self._sha256)
        description = self._recordings / f"{self._sha256}.json"
        while not self._is_coming(description):
            must(time.monotonic() < deadline_s, "no map comes")

    def _is_coming(self, description: Path) -> bool:
        built = json.loads(description.read_bytes())["map"]
        must(built["stage"] != "failed", "the map of the walk cannot be built:", built["reason"])
        return bool(built["folder"])

    def _ask(self, sha256: str) -> None:
        answer = self.http.post(f"/api/recordings/{sha256}/map")
        if answer.status_code == 202:
            self._asked.add(sha256)
        else:
            must(answer.status_code == 409, "no map is begun:", answer.status_code, answer.text)

    def _told(self) -> dict[str, Any]:
        rows = self.http.get("/api/recordings").raise_for_status().json()["recordings"]
        return {row["sha256"]: row["map"] for row in rows if row["complete"] and row["kind"] == "recording"}

    def _take(self, told: dict[str, Any]) -> None:
        for built in told.values():
            must(bool(built["site"]) == (built["stage"] == "built"), "a map is offered before it is built:", built)
            if built["site"]:
                must(load_site(Path(built["site"])).report == built["report"], "another map is there:", built)
                self._built.add(Path(built["site"]).name)

    def _send_the_walk(self) -> None:
        walk = small_map_walk()
        self._sha256 = hashlib.sha256(walk).hexdigest()
        offer = {"kind": "recording", "name": MAP_WALK_NAME, "size_bytes": len(walk), "sha256": self._sha256}
        self._device.post(OFFERS_PATH, json=offer).raise_for_status()
        for begin in range(0, len(walk), PIECE_BYTES):
            piece = walk[begin : begin + PIECE_BYTES]
            self._device.put(piece_path(self._sha256, begin), content=piece).raise_for_status()
        must(self._sha256 in self._told(), "the map walk has not come whole")
