"""A console that is killed while people and devices work with it, and what must hold after each kill.

Seven clients work at the same time, each over real HTTP (or a device's WebSocket), each with one request on its way:
what was acknowledged must be there after the kill; what was on its way must be there whole, or not at all; and asked
again, it must be there once. The seed decides on every request, and on the moment of the kill.
"""

from __future__ import annotations

import hashlib
import io
import json
import random
import sqlite3
import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
from websockets.exceptions import ConnectionClosed, InvalidHandshake

from benchmarks.kills.glasses import Glasses
from benchmarks.kills.keeper import Keeper
from benchmarks.kills.nursery import BrokenPromiseError, Nursery, Victim, must, say
from benchmarks.kills.sites import MAP_WALK_NAME, small_site
from benchmarks.kills.surveyor import Surveyor
from console.alerts.alert_store import AlertRecord, AlertStore
from console.alerts.rules import Priority
from console.config import ConsoleConfig
from console.server import ConsoleServer, Ready
from console.store import DATABASE_FILE, Store
from navcore.recording_upload import OFFERS_PATH, piece_path
from navcore.site import load_poi_graph, load_site, map_checksum, save_site
from navcore.site_archive import write_site_archive

PASSWORD = "seven quiet corridors"
LIFE_S = 20.0
"""A console that answers nothing for so long has failed."""
LONGEST_DELAY_S = 0.03
_ALERTS_COUNT = 24
_OLD_SHARE = _KILLED_AGAIN_SHARE = 0.25
_LONGEST_START_S = 1.0
_LONGEST_COMING_S = 0.01
_VALUES = {"planning.replan_hold_s": 5.0}
_DAY_S = 86_400.0
_GONE = (httpx.TransportError, ConnectionClosed, InvalidHandshake, ConnectionError, EOFError)


def serve(site: str, data: str, port: str, token_file: str) -> None:
    """Serve until killed; the role of a victim."""
    config = ConsoleConfig(Path(site), Path(data), port=int(port))
    server = ConsoleServer(config, device_token_file=Path(token_file), with_scene=False)

    def tell(ready: Ready) -> None:
        say(json.dumps({"url": ready.url, "first_link": ready.first_link}))

    server.run(tell)


ROLES = {"console": serve}


@dataclass(slots=True)
class Request:
    """A request that changes something, and what must be true once it was carried out."""

    send: Callable[[], httpx.Response]
    applied: Callable[[Any], Any]
    """From what a client sees before it to what it sees after it."""
    words: str = ""


class Client:
    """Somebody who works, request after request; what they see must be what was acknowledged, or one request more."""

    def __init__(self, http: httpx.Client, dice: random.Random) -> None:
        self.http, self.dice = http, dice
        self.acknowledged: Any = None
        self.pending: Request | None = None
        self.done_count = 0

    def see(self) -> Any:
        """Return what is there, as a value."""
        raise NotImplementedError

    def next(self) -> Request:
        """Return what to ask for next."""
        raise NotImplementedError

    def turn(self) -> None:
        """Ask for one thing, and take in the answer."""
        self.pending = self.next()
        self._answered(self.pending.send())

    def check(self) -> None:
        """After a kill: look whether everything is there, and ask again for what was on its way."""
        seen = self.see()
        if self.acknowledged is None:
            self.acknowledged = seen
            return
        if self.pending is None:
            must(seen == self.acknowledged, f"{type(self).__name__}: not as acknowledged:", seen, self.acknowledged)
            return
        after = self.pending.applied(self.acknowledged)
        must(
            seen in (self.acknowledged, after), f"{type(self).__name__}: half done ({self.pending.words}):", seen,
            self.acknowledged, after,
        )  # fmt: skip
        was_done = seen == after
        answer = self.pending.send()
        # Asked again, it is done once: now, or before.
        must(answer.status_code < 500, "asked again:", self.pending.words, answer.status_code, answer.text)
        if not was_done:
            # What is refused now would have been refused in the first place, too; and some changes change nothing.
            refused = answer.status_code >= 400
            after = self.acknowledged if refused else self.pending.applied(self.acknowledged)
        seen = self.see()
        must(seen == after, f"{type(self).__name__}: done twice, or lost ({self.pending.words}):", seen, after)
        self.acknowledged, self.pending = after, None

    def _answered(self, answer: httpx.Response) -> None:
        assert self.pending is not None
        if answer.status_code >= 500:
            raise BrokenPromiseError(f"{self.pending.words}: {answer.status_code} {answer.text}")
        if answer.status_code < 300:
            self.acknowledged = self.pending.applied(self.acknowledged)
        self.pending = None
        self.done_count += 1


class Draughtsman(Client):
    """Edits the draft, takes back, makes again, goes back, names, imports and publishes."""

    def __init__(self, http: httpx.Client, dice: random.Random, site: Path) -> None:
        super().__init__(http, dice)
        self._site = site
        self.history: dict[int, str] = {}
        self.published: set[int] = set()
        self._contents: tuple[int, Any] | None = None
        self._imported: tuple[int, set[str]] | None = None
        """Version that an import makes, and the places that it brings."""

    def see(self) -> tuple[int, int, int]:
        """Return the draft's version, the published one, and how many names there are; look at all the rest as well."""
        graph = self.http.get("/api/graph").raise_for_status().json()
        for entry in self.http.get("/api/history").raise_for_status().json()["history"]:
            words = f"{entry['kind']} {entry['author']} {entry['at_s']} {entry['words']}"
            must(self.history.setdefault(entry["version"], words) == words, "history was changed:", words)
        must(sorted(self.history) == list(range(1, graph["version"] + 1)), "history has gaps:", sorted(self.history))
        versions = self.http.get("/api/versions").raise_for_status().json()["versions"]
        names = [row["name"] for row in versions if row["name"] is not None]
        must(len(set(names)) == len(names), "a name was given twice:", names)
        published = {row["version"] for row in versions if row["name"] is None}
        must(self.published <= published, "a publication is gone:", self.published, published)
        self.published = published
        self._look_into(graph)
        must(max(published) == graph["published_version"], "published:", published, graph["published_version"])
        self.graph = graph
        return graph["version"], graph["published_version"], len(names)

    def _look_into(self, graph: dict[str, Any]) -> None:
        """What an acknowledged request answered is what is there; a later version is of a request that was cut off."""
        seen = _contents_of(graph)
        if self._contents is not None and self._contents[0] == graph["version"]:
            must(seen == self._contents, "the draft is not what was acknowledged:", seen, self._contents)
        if self._imported is not None and self._imported[0] == graph["version"]:
            left_out = self._imported[1] - {poi["name"] for poi in graph["pois"]}
            must(not left_out, "an import is half there, these are missing:", left_out)
        self._contents = seen

    def check(self) -> None:
        """Look also at the copy in the site's folder."""
        super().check()
        on_disk = load_poi_graph(self._site)
        must(on_disk.version == self.acknowledged[1], "the site's own graph:", on_disk.version, self.acknowledged)

    def next(self) -> Request:
        """Return one of all that can be done to a draft."""
        version = self.acknowledged[0]
        key = {"Idempotency-Key": f"{self.dice.getrandbits(96):024x}"}
        kinds = ["edit"] * 8 + ["undo"] * 2 + ["import"] * 2 + ["redo", "publish", "publish", "roll-back", "name"]
        kind = self.dice.choice(kinds)
        self._imported = None
        if kind in ("undo", "redo"):
            return self._stepping(lambda: self.http.post(f"/api/{kind}", headers=key), kind, version)
        if kind == "roll-back" and version > 1:
            wanted, body = self.dice.randrange(1, version), {"base_version": version}
            path = f"/api/versions/{wanted}/roll-back"
            return self._stepping(lambda: self.http.post(path, json=body, headers=key), path, version)
        if kind == "publish":
            body = {"confirmed": True, "version": version}
            return Request(
                lambda: self.http.post("/api/publish", json=body), lambda seen: (seen[0], seen[0], seen[2]), "publish"
            )
        if kind == "name":
            body = {"name": f"name {self.dice.getrandbits(40)}"}
            return Request(
                lambda: self.http.post("/api/versions", json=body), lambda seen: (seen[0], seen[1], seen[2] + 1), "name"
            )
        if kind == "import":
            return self._import(version)
        edit = self._edit()
        path = f"/api/edits?base_version={version}"
        return self._stepping(lambda: self.http.post(path, json=edit, headers=key), str(edit), version)

    def _stepping(self, send: Callable[[], httpx.Response], words: str, version: int) -> Request:
        """A request that makes one version, or, where nothing changes, none: its answer tells."""

        def sent() -> httpx.Response:
            answer = send()
            if answer.status_code < 300:
                self.graph = answer.json()
                self._contents = _contents_of(self.graph)
                made = self.graph["version"]
                must(made in (version, version + 1), f"{words} made", made, "of", version)
                request.applied = lambda seen: (made, seen[1], seen[2])
            return answer

        request = Request(sent, lambda seen: (version + 1, seen[1], seen[2]), words)
        return request

    def _import(self, version: int) -> Request:
        """Bring places in with a file; asked again with the same preview, it is done once."""
        names = {f"Imported {self.dice.getrandbits(32)}" for _ in range(self.dice.randrange(1, 4))}
        features = [
            {
                "geometry": {"type": "Point", "coordinates": [round(self.dice.uniform(0.0, 6.0), 3), 0.0]},
                "properties": {"name": name, "kind": "room"},
            }
            for name in sorted(names)
        ]
        data = json.dumps({"type": "FeatureCollection", "features": features}).encode()
        preview = self.http.post("/api/import/graph", content=data).raise_for_status().json()
        if preview["unused"]:
            names = set()
        self._imported = version + 1, names

        def send() -> httpx.Response:
            answer = self.http.post("/api/import/graph", content=data, params={"confirm": preview["token"]})
            if answer.status_code < 300:
                must(answer.json()["draft_version"] == version + 1, "an import made", answer.text, "of", version)
            else:
                must(answer.status_code == 400, "an import is refused:", answer.status_code, answer.text)
            return answer

        return Request(send, lambda seen: (version + 1, seen[1], seen[2]), f"import of {sorted(names)}")

    def _edit(self) -> dict[str, Any]:
        pois, edges = ([each["id"] for each in self.graph[name]] for name in ("pois", "edges"))
        x_m = round(self.dice.uniform(0.0, 6.0), 3)
        number = self.dice.getrandbits(32)
        choices: list[dict[str, Any]] = [
            {"edit": "add_poi", "name": f"Place {number}", "kind": "room", "x_m": x_m, "y_m": 0.0},
        ]
        if pois:
            poi = self.dice.choice(pois)
            choices += [
                {"edit": "move_poi", "poi_id": poi, "x_m": x_m, "y_m": 0.0},
                {"edit": "update_poi", "poi_id": poi, "name": f"Name {number}"},
                {"edit": "propose_edges"},
            ]
        if len(pois) > 6:
            choices += [{"edit": "delete_poi", "poi_id": self.dice.choice(pois)}] * 2
        if edges:
            edge = self.dice.choice(edges)
            choices += [
                {"edit": "set_edge", "edge_id": edge, "width_m": round(self.dice.uniform(0.8, 3.0), 3)},
                {"edit": "delete_edge", "edge_id": edge},
            ]
        return self.dice.choice(choices)


def _contents_of(graph: dict[str, Any]) -> tuple[int, Any]:
    """Return a draft's version, and what it holds, whatever the order."""
    by_id = [{each["id"]: each for each in graph[kind]} for kind in ("pois", "edges")]
    return graph["version"], by_id


class Clerk(Client):
    """Manages people, tokens, presets, the days of keeping, and brings in sites."""

    def __init__(self, http: httpx.Client, dice: random.Random, maps: Path, archive: bytes) -> None:
        super().__init__(http, dice)
        self._maps, self._archive = maps, archive

    def see(self) -> dict[str, Any]:
        """Return all of it."""
        users = self.http.get("/api/users").raise_for_status().json()["users"]
        tokens = self.http.get("/api/tokens").raise_for_status().json()["tokens"]
        presets = self.http.get("/api/settings/presets").raise_for_status().json()["presets"]
        # What is hidden is still coming in; the maps among them are the surveyor's.
        sites = [path for path in self._maps.glob("*") if not path.name.startswith((".", MAP_WALK_NAME))]
        for site in sites:
            load_site(site)
        self.ids = {each["name"]: each["id"] for each in users}
        return {
            "users": {each["name"]: (each["role"], each["disabled"]) for each in users if each["name"] != "Ada"},
            "tokens": {each["name"]: each["revoked"] for each in tokens if each["name"] != "glasses"},
            "presets": {each["name"]: each["values"] for each in presets if not each["built_in"]},
            "days": self.http.get("/api/privacy").raise_for_status().json()["days"],
            "sites": len(sites),
        }

    def next(self) -> Request:
        """Return one of all that an admin does."""
        seen, number = self.acknowledged, f"{self.dice.getrandbits(40):010x}"
        choices: list[Callable[[], Request]] = [
            lambda: self._post("/api/users", {"name": f"Person {number}", "role": "viewer"}, "users",
                               {f"Person {number}": ("viewer", False)}),
            lambda: self._post("/api/tokens", {"name": f"Token {number}"}, "tokens", {f"Token {number}": False}),
            lambda: self._post("/api/settings/presets", {"name": f"Preset {number}", "values": _VALUES}, "presets",
                               {f"Preset {number}": _VALUES}),
            self._days,
        ]  # fmt: skip
        if seen["users"]:
            choices.append(self._change_user)
        if seen["tokens"]:
            name = self.dice.choice(sorted(seen["tokens"]))
            choices.append(lambda: self._post("/api/tokens/revoke", {"name": name}, "tokens", {name: True}))
        if seen["presets"]:
            choices.append(self._change_preset)
        if self.dice.random() < 0.08:
            return self._import()
        return self.dice.choice(choices)()

    def _post(self, path: str, body: dict[str, Any], kind: str, change: dict[str, Any]) -> Request:
        return Request(
            lambda: self.http.post(path, json=body), lambda seen: seen | {kind: seen[kind] | change}, f"{path} {body}"
        )

    def _days(self) -> Request:
        days = self.dice.randrange(2, 9)
        return Request(
            lambda: self.http.post("/api/privacy/days", json={"days": days}), lambda seen: seen | {"days": days}, "days"
        )

    def _change_user(self) -> Request:
        name = self.dice.choice(sorted(self.acknowledged["users"]))
        role, disabled = self.dice.choice(["viewer", "editor", "technician"]), self.dice.random() < 0.5

        def send() -> httpx.Response:
            if name not in self.ids:
                self.see()
            return self.http.patch(f"/api/users/{self.ids[name]}", json={"role": role, "disabled": disabled})

        return Request(send, lambda seen: seen | {"users": seen["users"] | {name: (role, disabled)}}, f"user {name}")

    def _change_preset(self) -> Request:
        name = self.dice.choice(sorted(self.acknowledged["presets"]))

        def without(seen: dict[str, Any]) -> dict[str, Any]:
            return {key: value for key, value in seen["presets"].items() if key != name}

        if self.dice.random() < 0.6:
            return Request(
                lambda: self.http.delete(f"/api/settings/presets/{name}"),
                lambda seen: seen | {"presets": without(seen)},
                f"delete {name}",
            )
        other = f"Preset {self.dice.getrandbits(40):010x}"
        return Request(
            lambda: self.http.patch(f"/api/settings/presets/{name}", json={"name": other}),
            lambda seen: seen | {"presets": without(seen) | {other: seen["presets"].get(name, _VALUES)}},
            f"rename {name} to {other}",
        )

    def _import(self) -> Request:
        key = {"Idempotency-Key": f"{self.dice.getrandbits(96):024x}"}
        return Request(
            lambda: self.http.post("/api/import/site", content=self._archive, headers=key),
            lambda seen: seen | {"sites": seen["sites"] + 1}, "import of a site",
        )  # fmt: skip


class Watchman(Client):
    """Acknowledges and shelves alerts."""

    def see(self) -> dict[str, list[tuple[str, str]]]:
        """Return what people have done to each alert."""
        rows = self.http.get("/api/alerts", params={"count": 500}).raise_for_status().json()["recent"]
        return {
            row["id"]: [(step["what"], step["detail"]) for step in row["steps"] if step["who"]] for row in rows
        }  # fmt: skip

    def next(self) -> Request:
        """Return what can be done to an alert as it stands."""
        alert_id = self.dice.choice(sorted(self.acknowledged))
        steps = [what for what, _ in self.acknowledged[alert_id]]
        note = f"note {self.dice.getrandbits(32)}"
        shelved = bool(steps) and steps[-1] == "shelved"
        if shelved:
            return self._ask(alert_id, "unshelve", None, ("unshelved", ""))
        if "acknowledged" in steps or self.dice.random() < 0.4:
            body = {"minutes": 5, "reason": note}
            return self._ask(alert_id, "shelve", body, ("shelved", f"5 min: {note}"))
        return self._ask(alert_id, "acknowledge", {"note": note}, ("acknowledged", note))

    def _ask(self, alert_id: str, what: str, body: dict[str, Any] | None, step: tuple[str, str]) -> Request:
        return Request(
            lambda: self.http.post(f"/api/alerts/{alert_id}/{what}", json=body),
            lambda seen: seen | {alert_id: [*seen[alert_id], step]}, f"{what} {alert_id}",
        )  # fmt: skip


@dataclass(slots=True)
class _Sending:
    """A recording that is being sent."""

    kind: str
    name: str
    data: bytes
    acknowledged_bytes: int = 0
    complete: bool = False

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.data).hexdigest()


class Sender:
    """A device that sends recordings, piece by piece, as :mod:`device_agent.recording_upload` does."""

    def __init__(self, http: httpx.Client, dice: random.Random, folder: Path) -> None:
        self.http, self.dice, self.folder = http, dice, folder
        self.sent: list[_Sending] = []
        self.too_old: list[_Sending] = []
        self.done_count = 0

    def turn(self) -> None:
        """Offer a recording, or send a piece of one."""
        current = self.sent[-1] if self.sent and not self.sent[-1].complete else None
        if current is None:
            size = self.dice.randrange(2_000, 200_000)
            kind = self.dice.choice(["walk", "recording"])
            self.sent.append(_Sending(kind, f"Walk {len(self.sent)}", self.dice.randbytes(size)))
            self._offer(self.sent[-1])
        else:
            end = current.acknowledged_bytes + self.dice.randrange(1, 64 << 10)
            piece = current.data[current.acknowledged_bytes : end]
            self._take(current, self.http.put(piece_path(current.sha256, current.acknowledged_bytes), content=piece))
        self.done_count += 1

    def check(self) -> None:
        """Whatever was acknowledged is there; what is whole is the same to the last byte, and has one name."""
        for each in self.too_old:
            self._wait_until_deleted(each)
        self.too_old.clear()
        for each in self.sent:
            self._offer(each)
        named = list(self.folder.iterdir()) if self.folder.is_dir() else []
        for path in named:
            must(not path.name.startswith("."), "a leftover among the recordings:", path.name)
        for each in self.sent:
            whole = list(self.folder.glob(f"*-{each.sha256}.*"))
            must(len(whole) == each.complete, "a recording has another name, or two:", whole, each.name)
            must(not each.complete or whole[0].read_bytes() == each.data, "a recording is damaged:", each.name)
            must(not (each.complete and (self.folder / f"{each.sha256}.part").exists()), "a part is left:", each.name)

    def let_one_grow_old(self) -> None:
        """While the console is dead: make a whole walk older than anything is kept; its next start deletes it."""
        walks = [each for each in self.sent if each.kind == "walk" and each.complete]
        if not walks:
            return
        old = self.dice.choice(walks)
        self.sent.remove(old)
        self.too_old.append(old)
        description = self.folder / f"{old.sha256}.json"
        entry = json.loads(description.read_bytes())
        description.write_text(json.dumps(entry | {"offered_at_s": entry["offered_at_s"] - 30 * _DAY_S}))

    def _wait_until_deleted(self, each: _Sending) -> None:
        deadline_s = time.monotonic() + LIFE_S
        while left := list(self.folder.glob(f"*{each.sha256}*")):
            must(time.monotonic() < deadline_s, "a walk that is too old stays, or half of it:", left)
            time.sleep(0.01)

    def _offer(self, each: _Sending) -> None:
        body = {"kind": each.kind, "name": each.name, "size_bytes": len(each.data), "sha256": each.sha256}
        self._take(each, self.http.post(OFFERS_PATH, json=body))

    def _take(self, each: _Sending, answer: httpx.Response) -> None:
        must(answer.status_code < 300, "a piece is refused:", answer.status_code, answer.text)
        held = answer.json()
        must(held["next_byte"] >= each.acknowledged_bytes, "bytes were lost:", held, each.acknowledged_bytes)
        must(held["complete"] or not each.complete, "a whole recording was lost:", held)
        each.acknowledged_bytes, each.complete = held["next_byte"], held["complete"]


class KilledConsole:
    """A console on a folder, its clients, and one life of it after the other."""

    def __init__(self, folder: Path, seed: int, nursery: Nursery, maps_share: float = 0.0) -> None:
        """Make a site, and start a first console in ``folder``, which must be empty.

        ``maps_share`` of the kills wait, some seconds each, until a map has been built.
        """
        self.dice = random.Random(seed)
        self._folder, self._nursery, self._maps_share = folder, nursery, maps_share
        self.site, self.data = folder / "site", folder / "data"
        save_site(small_site(), self.site)
        archive = io.BytesIO()
        write_site_archive(self.site, archive)
        self._token_file = folder / "glasses.token"
        self._port = 0
        self._victim: Victim | None = None
        self.kill_count = self.request_count = 0
        self.data.mkdir()
        _open_alerts(self.data)
        ready = self._start()
        url = str(ready["url"])
        self._port = urlsplit(url).port or 0
        people = httpx.Client(base_url=url, headers={"Origin": url}, trust_env=False, timeout=LIFE_S)
        token = parse_qs(urlsplit(str(ready["first_link"])).query)["token"][0]
        people.post("/api/first", json={"token": token, "name": "Ada", "password": PASSWORD}).raise_for_status()
        secret = self._token_file.read_text(encoding="ascii").strip()
        device = httpx.Client(
            base_url=url, headers={"Authorization": f"Bearer {secret}"}, trust_env=False, timeout=LIFE_S
        )  # fmt: skip

        def dice() -> random.Random:
            return random.Random(self.dice.getrandbits(64))

        self._sender = Sender(device, dice(), self.data / "recordings")
        self._surveyor = Surveyor(people, device, dice(), self.data)
        glasses = Glasses(people, dice(), secret, map_checksum(self.site), self.data)
        self.clients = (
            Draughtsman(people, dice(), self.site),
            Clerk(people, dice(), self.data / "maps", archive.getvalue()),
            Watchman(people, dice()),
            self._sender,
            glasses,
            self._surveyor,
            Keeper(people, dice(), self.data / "incidents", lambda: glasses.confirmed),
        )
        try:
            self._check_all()
        except BaseException:
            self.close()
            raise

    def kill_once(self) -> None:
        """Let all work, kill the console somewhere, start it again, and look whether everything is there."""
        if self.dice.random() < self._maps_share:
            self._kill_while_a_map_comes()
        else:
            self._work_until_killed()
        self.kill_count += 1
        with closing(sqlite3.connect(self.data / DATABASE_FILE)) as base:
            must(base.execute("PRAGMA integrity_check").fetchall() == [("ok",)], "the database is damaged")
        if self.dice.random() < _OLD_SHARE:
            self._sender.let_one_grow_old()
        if self.dice.random() < _KILLED_AGAIN_SHARE:
            self._kill_while_it_starts()
        self.start_and_check()

    def _kill_while_a_map_comes(self) -> None:
        """Where it is moved to its place: a moment that no other kill would meet, for a map takes seconds."""
        self._surveyor.wait_until_a_map_comes()
        time.sleep(self.dice.uniform(0.0, _LONGEST_COMING_S))
        assert self._victim is not None
        self._victim.kill()

    def _kill_while_it_starts(self) -> None:
        """Where it clears up, closes what was cut off, and deletes what is too old."""
        victim = self._nursery.bear("console", self.site, self.data, self._port, self._token_file)
        time.sleep(self.dice.uniform(0.0, _LONGEST_START_S))
        victim.kill()
        self.kill_count += 1

    def start_and_check(self) -> None:
        """Start it again, and look whether everything is there."""
        self._start()
        self._check_all()

    def close(self) -> None:
        """End the console."""
        if self._victim is not None:
            self._victim.kill()
            self._victim = None

    def _start(self) -> dict[str, Any]:
        self._victim = self._nursery.bear("console", self.site, self.data, self._port, self._token_file)
        ready: dict[str, Any] = json.loads(self._victim.says())
        return ready

    def _check_all(self) -> None:
        for client in self.clients:
            client.check()
        self._check_leftovers()

    def _check_leftovers(self) -> None:
        hidden = [path for path in self._folder.rglob(".*") if path.name not in (".request",)]
        must(hidden == [], "half-written files stay:", hidden)

    def _work_until_killed(self) -> None:
        wanted, delay_s = self.dice.randrange(1, 40), self.dice.uniform(0.0, LONGEST_DELAY_S)
        done = threading.Semaphore(0)
        failures: list[BaseException] = []

        def work(client: Client | Sender | Glasses | Surveyor | Keeper) -> None:
            try:
                while True:
                    client.turn()
                    done.release()
            except _GONE:
                return
            except BaseException as error:
                failures.append(error)
                done.release(wanted)

        threads = [threading.Thread(target=work, args=(client,), daemon=True) for client in self.clients]
        for thread in threads:
            thread.start()
        for _ in range(wanted):
            if not done.acquire(timeout=LIFE_S):
                failures.append(BrokenPromiseError("the console answers nothing"))
                break
        time.sleep(delay_s)
        assert self._victim is not None
        self._victim.kill()
        for thread in threads:
            thread.join()
        self.request_count = sum(client.done_count for client in self.clients)
        if failures:
            raise failures[0]


def _open_alerts(data: Path) -> None:
    """Leave alerts of devices that are away, as a console that ended leaves them."""
    store = Store.open(data)
    now_s = time.time()
    AlertStore(store).save(
        [
            AlertRecord(f"{n:016x}", f"glasses-{n}", f"Glasses {n}", "too_hot", Priority.LOW, "Hot.", now_s - n)
            for n in range(_ALERTS_COUNT)
        ],
        [],
    )
    store.close()
