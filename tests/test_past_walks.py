"""Walks that devices have sent to the console: put together, read, measured; whole, damaged, and with parts missing."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
import math
import statistics
from pathlib import Path
from typing import Any

import msgspec
import pytest
from console_room import DialledDevice, Person, hello_of, invited, until
from mcap.reader import make_reader
from recorded_walk import STORED_WALK, record, walk_among_boxes

from console.errors import NotFoundError
from console.live_panel import device_view
from console.past_walks import PastWalk, PastWalks
from console.recordings import Recordings
from console.server import ConsoleServer
from console.timeline import NamedPlace
from console.view_requests import EndPast, ShowPast, ViewRequest
from console.walk_comparison import compared_with
from console.walk_figures import Deviation, WalkFigures, figures_of
from console.walk_library import WalkLibrary
from console.walk_reading import read_walk
from console.walk_timeline import state_of
from device_agent.recording.options import RecordingOptions
from device_agent.recording.reading import RecordedPart
from device_agent.recording.recorder import WalkRecorder
from device_agent.recording.walk_files import parts_in
from navcore.recording_upload import RecordingOffer
from navcore.silhouette import silhouette_jpeg
from navcore.wire import RouteChanged, WalkerState, WireCandidate

CLOCK_S = 1_800_000_000.0


def take(recordings: Recordings, data: bytes, name: str = "walk-001", device: str = "Glasses") -> str:
    """Take a file in as if a device had sent it; return its checksum."""
    sha256 = hashlib.sha256(data).hexdigest()
    recordings.offer(RecordingOffer("walk", name, len(data), sha256), device)
    assert recordings.add(sha256, 0, data).complete
    return sha256


@pytest.fixture
def recordings(tmp_path: Path) -> Recordings:
    return Recordings(tmp_path / "recordings", lambda: CLOCK_S)


def test_a_walk_says_itself_where_it_was_walked_and_when(recordings: Recordings) -> None:
    take(recordings, STORED_WALK.read_bytes())
    (walk,) = PastWalks(recordings).all()
    assert (walk.walk_id, walk.device, walk.site_id) == ("20261201T005257Z-glasses-70d9cfae-w1", "Glasses", "boxes")
    assert walk.map_checksum == "boxes-map"
    assert walk.began_at_s == 1796086378.273, "2026-12-01 00:52:58 UTC"
    assert walk.length_s == pytest.approx(16.4)
    assert (walk.has_pictures, walk.troubles, len(walk.parts)) == (False, (), 1)
    assert PastWalks(recordings).named(walk.walk_id) == walk


def test_a_damaged_file_and_one_that_is_no_walk_are_told_and_stop_no_other(recordings: Recordings) -> None:
    whole = STORED_WALK.read_bytes()
    take(recordings, whole[: len(whole) // 2], device="Cut")
    take(recordings, b"this is no walk at all", device="Foreign")
    take(recordings, whole)
    walks = {walk.device: walk for walk in PastWalks(recordings).all()}
    assert walks["Glasses"].troubles == ()
    assert 1.0 < walks["Cut"].length_s < 15.0
    assert "ends in the middle" in walks["Cut"].troubles[0]
    assert "no MCAP file" in walks["Foreign"].troubles[0]
    assert walks["Foreign"].length_s == 0.0


def test_what_has_been_kept_for_long_enough_is_deleted_with_all_that_was_found_in_it(tmp_path: Path) -> None:
    clock_s = [CLOCK_S]
    recordings = Recordings(tmp_path / "recordings", lambda: clock_s[0])
    old = take(recordings, STORED_WALK.read_bytes(), device="Old")
    recordings.companion(old, "figures").write_text("{}")
    map_walk = RecordingOffer("recording", "map", 1, hashlib.sha256(b"x").hexdigest())
    recordings.offer(map_walk, "Old")
    recordings.offer(RecordingOffer("walk", "half", 9, "0" * 64), "Old")
    clock_s[0] += 100.0
    new = take(recordings, STORED_WALK.read_bytes()[:-40], device="New")
    assert recordings.delete_before(CLOCK_S + 50.0) == 2
    kept = {path.name.partition(".")[0].rpartition("-")[2] for path in recordings.folder.iterdir()}
    assert kept == {new, map_walk.sha256}
    (walk,) = (walks := PastWalks(recordings)).all()
    assert walk.device == "New"
    assert recordings.delete_before(CLOCK_S + 200.0) == 1
    with pytest.raises(NotFoundError, match="deleted"):
        walks.named(walk.walk_id)


def test_a_walk_whose_middle_file_is_missing_says_so_and_is_shown_with_its_gap(
    recordings: Recordings, tmp_path: Path
) -> None:
    recorder = WalkRecorder(RecordingOptions(tmp_path / "walks", False, max_part_bytes=1, reserve_bytes=0))
    walk_among_boxes(recorder, max_s=4.0, rate_hz=5.0)
    recorder.close()
    paths = parts_in(tmp_path / "walks")
    assert len(paths) >= 3
    middle = len(paths) // 2
    for path in paths[:middle] + paths[middle + 1 :]:
        take(recordings, path.read_bytes(), path.stem)
    (walk,) = (walks := PastWalks(recordings)).all()
    assert walk.troubles == (f"Missing: file {middle + 1} of this walk has not come from the device.",)
    gap = WalkLibrary(walks).timeline(walk)
    assert gap.troubles == walk.troubles
    take(recordings, paths[middle].read_bytes(), paths[middle].stem)
    (whole,) = walks.all()
    assert (whole.troubles, len(whole.parts)) == ((), len(paths))
    # Nothing is made up for the gap: it has the cycles of the other files, and no others.
    read = WalkLibrary(walks).timeline(whole)
    assert set(gap.stamps_s) < set(read.stamps_s)
    assert gap.state_at(len(gap.stamps_s) - 1) == read.state_at(len(read.stamps_s) - 1)


# ------------------------------------------------------------------------------------------------- over the network
@pytest.fixture
def walk(server: ConsoleServer) -> PastWalk:
    """The stored walk, sent to a real console."""
    take(server.services.recordings, STORED_WALK.read_bytes())
    (found,) = server.services.walks.all()
    return found


def recorded_states() -> list[dict[str, Any]]:
    """What the device told in the stored walk, read without the console's code."""
    with STORED_WALK.open("rb") as file:
        return [json.loads(message.data) for _, _, message in make_reader(file).iter_messages("/device")]


def shown(person: Person, walk_id: str, **query: float) -> list[dict[str, Any]]:
    answer = person.http.get(f"/api/walks/{walk_id}/instants", params=query).raise_for_status()
    instants: list[dict[str, Any]] = answer.json()["instants"]
    return instants


def test_an_instant_of_the_past_is_what_the_live_page_was_shown_then(
    server: ConsoleServer, admin: Person, walk: PastWalk
) -> None:
    """A device dials in and tells the same state: but for its age, the same stands in both views."""
    states = recorded_states()
    then = states[20]
    (instant,) = shown(admin, walk.walk_id, **{"from": then["stamp_s"], "to": then["stamp_s"]})
    assert instant["at_s"] == pytest.approx(then["stamp_s"])
    token = admin.http.post("/api/tokens", json={"name": "Glasses"}).raise_for_status().json()["token"]
    device = DialledDevice(server.ready.url, token, hello_of(server))
    try:
        device.send(msgspec.convert(then, WalkerState))
        seen = until(server.services.hub, lambda each: each.state is not None)
        live = json.loads(msgspec.json.encode(device_view(seen, seen.connected_at_s)))
    finally:
        device.socket.close()
    past = instant["view"]
    assert set(past) == set(live)
    for ages in ("last_cue_age_s",):
        past["state"].pop(ages), live["state"].pop(ages)
    assert past["state"] == live["state"]
    assert past["age_s"] == pytest.approx(0.0, abs=1e-6)


def test_events_settings_and_the_way_are_those_of_the_instant(admin: Person, walk: PastWalk) -> None:
    early, late = shown(admin, walk.walk_id, **{"from": 1.0, "to": 15.0, "step": 14.0})
    words = [event["text"] for event in late["view"]["events"]]
    assert words[0] == "You have arrived: Window."
    assert "The walker pressed: repeat." in words
    assert [event["text"] for event in early["view"]["events"]][-1] == "Leading to Window."
    assert (early["view"]["settings_revision"], late["view"]["settings_revision"]) == (0, 7)
    assert (early["view"]["state"]["mode"], late["view"]["state"]["mode"]) == ("guiding", "arrived")
    assert early["depth_at_s"] is None


def test_a_walk_that_ends_on_a_few_steps_back_was_to_its_destination_all_the_same(walk: PastWalk) -> None:
    timeline = read_walk(walk)
    back = RouteChanged(timeline.stamps_s[-1] - 1.0, ((3.0, 0.0), (0.0, 0.0)), (), "window")
    figures = figures_of(dataclasses.replace(timeline, routes=(*timeline.routes, back)), ())
    assert figures.to_place == figures_of(timeline, ()).to_place == "Window"


def test_the_figures_are_those_of_an_independent_computation(
    server: ConsoleServer, admin: Person, walk: PastWalk
) -> None:
    states = recorded_states()
    off_m = [
        state["deviation_m"] for state in states
        if state["mode"] in ("guiding", "lost") and state["deviation_m"] is not None
    ]  # fmt: skip
    assert len(off_m) > 40
    assert server.services.walk_library.found(walk) is None, "it is being read"
    assert server.services.walk_library.wait(60.0)
    (row,) = admin.http.get("/api/walks").raise_for_status().json()["walks"]
    figures = row["figures"]
    assert figures["deviation"]["mean_m"] == pytest.approx(statistics.fmean(off_m), abs=1e-6)
    assert figures["deviation"]["max_m"] == pytest.approx(max(off_m), abs=1e-6)
    assert figures["deviation"]["variance_m2"] == pytest.approx(statistics.pvariance(off_m), abs=1e-6)
    assert (figures["from_place"], figures["to_place"], figures["arrived"]) == ("Door", "Window", True)
    led = [state["mode"] in ("guiding", "lost", "paused") for state in states]
    stamps_s = [state["stamp_s"] for state in states]
    seconds = sum(b - a for a, b, was in zip(stamps_s, stamps_s[1:], led, strict=False) if was)
    assert figures["seconds"] == pytest.approx(seconds, abs=1e-3)
    # Kept: another console over the same folder reads no walk for it.
    again = WalkLibrary(PastWalks(server.services.recordings))
    assert again.found(again.walks.named(walk.walk_id)) == server.services.walk_library.found(walk)
    table = list(csv.DictReader(io.StringIO(
        admin.http.get("/api/walk-figures.csv", params={"walk": walk.walk_id}).raise_for_status().text
    )))  # fmt: skip
    assert float(table[0]["deviation_mean_m"]) == pytest.approx(statistics.fmean(off_m), abs=1e-4)
    assert (table[0]["from"], table[0]["to"], table[0]["stops"]) == ("Door", "Window", str(figures["stop_count"]))


def test_all_that_was_read_of_a_walk_goes_with_it_and_who_sees_what_was_found_has_looked(
    server: ConsoleServer, admin: Person, walk: PastWalk
) -> None:
    library, tom = server.services.walk_library, invited(admin, "Tom", "technician")
    library.timeline(walk)
    library.found(walk)
    assert library.wait(60.0)
    asked = {"walk_id": walk.walk_id, "changes": {"gate.clearance_m": 1.5}}
    run_id = admin.http.post("/api/what-if", json=asked).raise_for_status().json()["run_id"]
    tom.http.get(f"/api/what-if/{run_id}").raise_for_status()
    log = admin.http.get("/api/privacy").json()["accesses"]
    assert ("Tom", "past_walk", walk.walk_id) in {(each["who"], each["what"], each["detail"]) for each in log}
    assert server.services.retention._kinds["Walks"](math.inf) == 1
    assert (library._timelines, library._found) == ({}, {})
    assert tom.http.get(f"/api/what-if/{run_id}").status_code == 404
    assert server.services.what_ifs._runs == {}


def test_a_walk_begins_at_the_place_that_somebody_named(walk: PastWalk) -> None:
    timeline = read_walk(walk)
    first = next(route for route in timeline.routes if route.points_m)
    x_m, y_m = first.points_m[0]
    route = msgspec.structs.replace(first, stops=(("Junction 4", 0.5), *first.stops))

    def begin(away_m: float) -> str:
        places = (NamedPlace("Junction 4", x_m, y_m), NamedPlace("Wash room", x_m + away_m, y_m))
        return figures_of(dataclasses.replace(timeline, routes=(route,), places=places), ()).from_place

    assert (begin(4.0), begin(6.0)) == ("Wash room", "Junction 4")


def test_marks_tell_what_happened_when_and_where(admin: Person, walk: PastWalk) -> None:
    marks = admin.http.get(f"/api/walks/{walk.walk_id}").raise_for_status().json()["marks"]
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for mark in marks:
        by_kind.setdefault(mark["kind"], []).append(mark)
    # From 6 to 7 s no pose was given: lost then, and told within a cycle or two.
    (weak,) = by_kind["weak"]
    assert weak["at_s"] == pytest.approx(6.0, abs=0.5)
    assert weak["length_s"] == pytest.approx(1.0, abs=0.5)
    assert weak["text"] == "The place in the map was lost."
    assert any("Guidance is paused" in mark["text"] for mark in by_kind["stop"] + by_kind["event"])
    assert "The console said: “Mind the step.”" in [mark["text"] for mark in by_kind["order"]]
    assert [mark["text"] for mark in by_kind["cue"]][-1] == "You have arrived: Window."
    assert all(0.0 <= mark["at_s"] <= 16.4 for mark in marks)
    assert marks == sorted(marks, key=lambda mark: mark["at_s"])


def test_layers_of_two_walks_are_those_of_each_together(server: ConsoleServer, admin: Person, walk: PastWalk) -> None:
    take(server.services.recordings, STORED_WALK.read_bytes()[:-60], device="Other")
    library = server.services.walk_library
    ids = [each.walk_id for each in library.walks.all()]
    assert len(set(ids)) == 2, "two devices may call their walks the same"
    for each in library.walks.all():
        library.found(each)
    assert library.wait(60.0)

    def layers(*chosen: str) -> dict[str, Any]:
        answer = admin.http.get("/api/walk-overlays", params={"walk": chosen}).raise_for_status()
        return dict(answer.json()["layers"])

    one, both = layers(ids[0]), layers(*ids)
    assert one["deviation"], "somebody walked beside the road"
    assert [cell[:4] for cell in both["deviation"]] == [pytest.approx(cell[:4]) for cell in one["deviation"]]
    assert [cell[4] for cell in both["deviation"]] == [2 * cell[4] for cell in one["deviation"]]
    assert sum(cell[2] for cell in both["weak"]) == pytest.approx(2 * sum(cell[2] for cell in one["weak"]))
    assert len(both["stops"]) == 2 * len(one["stops"])
    states = [state for state in recorded_states() if state["mode"] in ("guiding", "lost")]
    assert sum(cell[4] for cell in one["deviation"]) == sum(state["deviation_m"] is not None for state in states)


def test_earlier_walks_of_the_same_way_stand_beside_a_walk() -> None:
    walks = [past_walk(number) for number in range(4)]
    means_m = (0.40, 0.30, 0.20, 0.10)
    figures = [figures_with(mean_m) for mean_m in means_m]
    other = msgspec.structs.replace(figures_with(9.0), to_place="Bar")
    lines = [*zip(walks, figures, strict=True), (past_walk(-1), other)]
    compared = compared_with(walks[3], lines)
    assert compared is not None
    assert [line.figures.deviation.mean_m for line in compared.lines] == list(means_m)
    assert compared.difference is not None
    assert compared.difference.mean_m == pytest.approx(-0.2)
    assert compared.trend_m == pytest.approx(-0.1)
    first = compared_with(walks[0], lines)
    assert first is not None
    assert (first.difference, first.trend_m, len(first.lines)) == (None, None, 1)


def past_walk(number: int) -> PastWalk:
    sha256 = f"{number + 10:064x}"
    return PastWalk(f"w{number}", "G", "s", "m", 1000.0 * number + 5000.0, 60.0, (), False, "", 0, sha256, 1)


def figures_with(mean_m: float) -> WalkFigures:
    deviation = Deviation(max_m=1.0, mean_m=mean_m, variance_m2=0.0)
    return WalkFigures("Hall", "Lounge", True, "Arrived.", 60.0, 5.0, 20.0, 20.0, deviation, 1, 0.0, 0.0, 0.0, ())


def test_what_is_damaged_missing_or_asked_for_wrongly_is_told(
    server: ConsoleServer, admin: Person, walk: PastWalk
) -> None:
    data = STORED_WALK.read_bytes()
    take(server.services.recordings, data[: len(data) // 2], device="Cut")
    take(server.services.recordings, b"no walk", device="Foreign")
    cut, foreign = (
        next(each for each in server.services.walks.all() if each.device == device) for device in ("Cut", "Foreign")
    )
    half = admin.http.get(f"/api/walks/{cut.walk_id}").raise_for_status().json()
    assert 3.0 < half["length_s"] < 14.0
    assert any("ends in the middle" in trouble for trouble in half["troubles"])
    nothing = admin.http.get(f"/api/walks/{foreign.walk_id}")
    assert nothing.status_code == 404
    assert "Nothing of this walk can be read" in nothing.json()["error"]
    for path, status in (
        ("/api/walks/none", 404), (f"/api/walks/{walk.walk_id}/depth.jpg?at=1", 404),
        (f"/api/walks/{walk.walk_id}/instants?from=0&to=99&step=0.1", 400),
        (f"/api/walks/{walk.walk_id}/instants?from=nan&to=1", 400), ("/api/walk-overlays?walk=none", 404),
    ):  # fmt: skip
        answer = admin.http.get(path)
        assert answer.status_code == status, path
        assert answer.json()["error"].endswith(".")
    # A file that has gone since the walk was opened is told, too.
    server.services.recordings.delete_before(server.services.store.wall_s() + 1.0)
    gone = admin.http.get(f"/api/walks/{walk.walk_id}/instants?from=0&to=1")
    assert (gone.status_code, "deleted" in gone.json()["error"]) == (404, True)


def test_who_looks_at_a_walk_is_noted(server: ConsoleServer, admin: Person, walk: PastWalk) -> None:
    admin.http.get(f"/api/walks/{walk.walk_id}").raise_for_status()
    seen = [(each.what, each.detail) for each in server.services.access.latest(10)]
    assert ("past_walk", walk.walk_id) in seen


def test_a_past_walk_is_shown_in_the_scenes_of_whoever_asks_and_in_no_other(
    server: ConsoleServer, admin: Person, walk: PastWalk
) -> None:
    heard: list[ViewRequest] = []
    (token,) = (cookie.value for cookie in admin.http.cookies.jar)
    person = server.services.accounts.signed_in(token)
    assert person is not None
    unsubscribe = server.services.views.subscribe(person.session_id, heard.append)
    server.services.views.subscribe("somebody else's", heard.append)
    then = recorded_states()[40]
    asked = {"walk": walk.walk_id, "at_s": then["stamp_s"] + 0.01, "clock": "12:03:10"}
    assert admin.http.post("/api/view/past", json=asked).raise_for_status().json() == {"scenes": 1}
    assert admin.http.delete("/api/view/past").raise_for_status().json() == {"scenes": 1}
    past, end = heard
    assert isinstance(past, ShowPast)
    assert isinstance(end, EndPast)
    assert past.words == "PAST WALK 12:03:10"
    assert past.device.state is not None
    assert past.device.state.pose == pytest.approx(then["pose"])
    assert past.trail_m[-1] == pytest.approx(then["pose"][:2], abs=0.5)
    seen = [(each.what, each.detail) for each in server.services.access.latest(10)]
    assert ("past_walk", walk.walk_id) in seen
    for wrong in (asked | {"incident": "x"}, asked | {"clock": "now"}, asked | {"walk": "none"}):
        assert admin.http.post("/api/view/past", json=wrong).status_code in (400, 404, 422)
    unsubscribe()


def test_the_depth_silhouette_of_an_instant_comes_from_the_recorded_picture(
    server: ConsoleServer, admin: Person, tmp_path: Path
) -> None:
    record(tmp_path / "walks", pictures=True, max_s=2.0, rate_hz=5.0)
    for path in parts_in(tmp_path / "walks"):
        take(server.services.recordings, path.read_bytes(), path.stem)
    (walk,) = server.services.walks.all()
    assert walk.has_pictures
    (instant,) = shown(admin, walk.walk_id, **{"from": 1.0, "to": 1.0})
    picture = admin.http.get(f"/api/walks/{walk.walk_id}/depth.jpg", params={"at": instant["depth_at_s"]})
    assert picture.headers["content-type"] == "image/jpeg"
    frames = [cycle.frame for path in parts_in(tmp_path / "walks") for cycle in RecordedPart(path).cycles()]
    began_s = recorded_began_s(walk)
    then = max(
        (frame for frame in frames if frame is not None and frame.stamp_s <= began_s + instant["depth_at_s"] + 1e-6),
        key=lambda frame: frame.stamp_s,
    )
    assert picture.content == silhouette_jpeg(then.depth_m)


def recorded_began_s(walk: PastWalk) -> float:
    with walk.parts[0].open("rb") as file:
        return next(float(message.log_time) / 1e9 for _, _, message in make_reader(file).iter_messages("/device"))


def test_numbers_that_json_does_not_know_do_not_lose_an_instant() -> None:
    known, beyond = WireCandidate(0.2, 3.0), WireCandidate(0.1, math.inf)
    state = WalkerState(
        1.0, "localized", "walk", "ok", pose=(math.nan, 0.0, 1.6, 0.0), sub_goal=(1.0, 2.0), candidates=(beyond, known)
    )
    read = state_of(msgspec.json.encode(state))
    assert read == msgspec.structs.replace(state, pose=None, candidates=(known,))
    assert state_of(b'{"type":"state","from":"another version"}') is None
