"""Somebody who keeps incidents, and deletes them: what was kept is there with what was heard until then."""

from __future__ import annotations

import io
import json
import random
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx

from benchmarks.kills.nursery import must

_KEEP_SHARE, _DELETE_SHARE = 0.5, 0.2


class Keeper:
    """Keeps what was heard of the glasses; ``confirmed`` tells how many of their events were."""

    def __init__(self, http: httpx.Client, dice: random.Random, folder: Path, confirmed: Callable[[], int]) -> None:
        self.http, self.dice, self._folder, self._confirmed = http, dice, folder, confirmed
        self._asks: dict[str, int] = {}
        """How often somebody was told that this incident is kept."""
        self._heard: dict[str, int] = {}
        """Event that was confirmed before it was asked for, of those that have not been looked into since."""
        self._ended: set[str] = set()
        self._is_asking = False
        self._deleting = ""
        self.done_count = 0

    def check(self) -> None:
        """Every incident is closed and can be read; of what was on its way there is one more, whole, or none."""
        there = self._there()
        if self._deleting:
            self._settle_deletion(there)
        missing = self._asks.keys() - there.keys()
        must(not missing, "incidents that were kept are gone:", missing)
        unknown = there.keys() - self._asks.keys()
        must(len(unknown) <= self._is_asking, "incidents are there that nobody has asked for:", unknown)
        more = sum(len(there[each]["causes"]) - count for each, count in self._asks.items())
        must(0 <= more <= self._is_asking - len(unknown), "asked for, and lost, or noted twice:", more, self._asks)
        for incident_id in (*unknown, *self._heard):
            self._look_into(there[incident_id], self._heard.get(incident_id, 0))
        folders = {path.name for path in self._folder.iterdir()} if self._folder.is_dir() else set()
        must(folders == there.keys(), "half incidents are there:", folders ^ there.keys())
        self._asks = {each: len(incident["causes"]) for each, incident in there.items()}
        self._heard, self._ended, self._is_asking = {}, set(there), False

    def turn(self) -> None:
        """Ask for one to be kept, delete one, or look."""
        dice = self.dice.random()
        if dice < _KEEP_SHARE:
            self._keep()
        elif dice < _KEEP_SHARE + _DELETE_SHARE and self._ended:
            self._delete(self.dice.choice(sorted(self._ended)))
        else:
            must(self._asks.keys() <= self._there().keys(), "an incident is gone:", self._asks)
        self.done_count += 1

    def _keep(self) -> None:
        heard = self._confirmed()
        self._is_asking = True
        incident_id = self.http.post("/api/devices/glasses/keep").raise_for_status().json()["incident_id"]
        self._is_asking = False
        self._asks[incident_id] = self._asks.get(incident_id, 0) + 1
        self._heard.setdefault(incident_id, heard)

    def _delete(self, incident_id: str) -> None:
        self._deleting = incident_id
        self.http.delete(f"/api/incidents/{incident_id}").raise_for_status()
        self._forget(incident_id)

    def _settle_deletion(self, there: dict[str, Any]) -> None:
        if self._deleting in there:
            self._look_into(there[self._deleting], 0)
            self._deleting = ""
        else:
            self._forget(self._deleting)

    def _forget(self, incident_id: str) -> None:
        del self._asks[incident_id]
        self._ended.discard(incident_id)
        self._deleting = ""

    def _there(self) -> dict[str, Any]:
        rows = self.http.get("/api/incidents").raise_for_status().json()["incidents"]
        return {row["incident_id"]: row for row in rows}

    def _look_into(self, incident: dict[str, Any], heard: int) -> None:
        must(incident["state"] in ("cut_off", "complete"), "an incident is being kept for ever:", incident)
        whole = self.http.get(f"/api/incidents/{incident['incident_id']}/bundle.zip")
        must(whole.status_code == 200, "an incident cannot be read:", whole.status_code, whole.text)
        with zipfile.ZipFile(io.BytesIO(whole.content)) as archive:
            lines = [json.loads(line)["message"] for line in archive.read("messages.jsonl").splitlines()]
        must(incident["message_count"] == len(lines), "another count of messages:", incident, len(lines))
        must(lines[0]["type"] == "hello", "an incident begins otherwise:", lines[0])
        events = [line["sequence"] for line in lines if line["type"] == "event"]
        must(events == list(range(events[0], events[0] + len(events))), "events are missing:", events)
        must(events[-1] >= heard, "what was heard before somebody asked is missing:", events[-1], heard)
