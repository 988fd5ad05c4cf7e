"""The link to the devices: what is stored, what is offered, and what becomes of orders."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import msgspec
import pytest
from console_room import DEFAULTS, PICTURE, DialledDevice, Person, heard_until, hello_of, invited, until
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed

from console.edits import UpdatePoi
from console.live import DELAYED_AFTER_S, LOST_AFTER_S, STALE_AFTER_S, Freshness, LiveDevice, freshness
from console.live_panel import device_view
from console.map_package import MapPackage
from console.server import ConsoleServer
from navcore.cues.texts import TEXTS
from navcore.modes import Mode
from navcore.site import Site, map_checksum, save_site, unpack_site
from navcore.wire import (
    ORDER_HOLDS_S,
    PROTOCOL_VERSION,
    ApplySettings,
    BeginMapWalk,
    DepthImage,
    EndMapWalk,
    Event,
    EventConfirmed,
    GraphRunning,
    Hello,
    MapAvailable,
    MapRunning,
    MapWalkRunning,
    MapWalkSeen,
    Pause,
    Ping,
    Pong,
    PublishGraph,
    Repeat,
    RouteChanged,
    Say,
    SetDestination,
    SettingsRunning,
    WalkerState,
    Welcome,
    expired_text,
)


def token_for(admin: Person, name: str = "Lead glasses") -> str:
    return str(admin.http.post("/api/tokens", json={"name": name}).raise_for_status().json()["token"])


@pytest.fixture
def device(server: ConsoleServer, admin: Person) -> Iterator[DialledDevice]:
    dialled = DialledDevice(server.ready.url, token_for(admin), hello_of(server))
    with dialled.socket:
        dialled.next(Welcome)
        yield dialled


def state(stamp_s: float = 1000.0, **changes: object) -> WalkerState:
    values = {"stamp_s": stamp_s, "quality": "localized", "action": "stop", "reason": "no_route"}
    return WalkerState(**(values | changes))  # type: ignore[arg-type]


def test_events_are_stored_once_and_in_order_over_a_broken_link(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    for sequence in (1, 2, 3, 2):
        device.send(Event(sequence, 1000.0 + sequence, "cue", f"event {sequence}"))
        assert device.next(EventConfirmed).sequence == sequence
    device.socket.close()
    token = token_for(admin)
    again = DialledDevice(server.ready.url, token, hello_of(server))
    assert again.next(Welcome).last_event_sequence == 3
    again.send(Event(3, 1003.0, "cue", "event 3"))
    again.send(Event(4, 1004.0, "arrived", "event 4"))
    while again.next(EventConfirmed).sequence < 4:
        pass
    stored = server.services.devices.latest_events("glasses", 100)
    assert [(event.sequence, event.text) for event in stored] == [(n, f"event {n}") for n in (1, 2, 3, 4)]
    shown = until(server.services.hub, lambda d: d.connected and len(d.events) >= 4)
    assert [event.sequence for event in shown.events] == [1, 2, 3, 4]
    again.socket.close()


def test_a_device_belongs_to_its_token(server: ConsoleServer, admin: Person, device: DialledDevice) -> None:
    other = DialledDevice(server.ready.url, token_for(admin, "Thief"), hello_of(server))
    code, reason = other.close_code()
    assert code == 4403
    assert "belongs to the token of 'Lead glasses'" in reason
    device.send(Event(1, 0.0, "cue", "still here"))
    assert device.next(EventConfirmed).sequence == 1


def test_admins_see_whose_token_is_in_use_now(server: ConsoleServer, admin: Person, device: DialledDevice) -> None:
    token_for(admin, "Spare")
    told = admin.http.get("/api/tokens").raise_for_status().json()["tokens"]
    assert {token["name"]: token["connected"] for token in told} == {"Lead glasses": True, "Spare": False}
    device.socket.close()
    until(server.services.hub, lambda seen: not seen.connected)
    told = admin.http.get("/api/tokens").raise_for_status().json()["tokens"]
    assert not any(token["connected"] for token in told)


def test_another_protocol_version_is_refused_with_the_reason(server: ConsoleServer, admin: Person) -> None:
    other = DialledDevice(server.ready.url, token_for(admin), hello_of(server, protocol_version=99))
    code, reason = other.close_code()
    assert code == 4403
    assert f"protocol {PROTOCOL_VERSION}, this device 99: update the console" in reason


@pytest.mark.parametrize("version", [1, PROTOCOL_VERSION + 1])
def test_a_hello_of_another_form_is_refused_by_its_version(server: ConsoleServer, admin: Person, version: int) -> None:
    other = DialledDevice(server.ready.url, token_for(admin), None)
    other.socket.send(msgspec.msgpack.encode({"type": "hello", "protocol_version": version, "unheard_of": [1, 2]}))
    code, reason = other.close_code()
    assert code == 4403
    assert f"protocol {PROTOCOL_VERSION}, this device {version}: update the" in reason


def test_whoever_sends_more_often_than_the_table_says_is_refused_with_a_sentence(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    flooding = DialledDevice(server.ready.url, token_for(admin, "Flood"), hello_of(server, "flood"))
    flooding.next(Welcome)
    with contextlib.suppress(ConnectionClosed):
        for number in range(5000):
            flooding.send(DepthImage(float(number), PICTURE))
    code, reason = flooding.close_code()
    assert code == 1007
    assert reason == "DepthImage comes more often than 2 times a second: update the device."
    device.send(Event(1, 0.0, "cue", "unharmed"))
    assert device.next(EventConfirmed).sequence == 1


@pytest.mark.parametrize(
    "data", [b"", b"\x00" * 100, b"\xc1", b"\x81" * 2000, "text", b"\x82\xa4type\xa5state\xa1x\x01"]
)
def test_what_cannot_be_read_closes_that_link_only(
    server: ConsoleServer, admin: Person, device: DialledDevice, data: bytes | str
) -> None:
    broken = DialledDevice(server.ready.url, token_for(admin, "Broken"), hello_of(server, "broken"))
    broken.next(Welcome)
    broken.socket.send(data)
    assert broken.close_code()[0] == 1007
    device.send(Event(1, 0.0, "cue", "unharmed"))
    assert device.next(EventConfirmed).sequence == 1


def test_a_link_must_begin_with_hello(server: ConsoleServer, admin: Person) -> None:
    silent = DialledDevice(server.ready.url, token_for(admin), None)
    silent.send(state())
    assert silent.close_code()[0] == 1007


def test_a_second_link_of_the_same_device_takes_over(server: ConsoleServer, admin: Person) -> None:
    token = token_for(admin)
    first = DialledDevice(server.ready.url, token, hello_of(server))
    first.next(Welcome)
    second = DialledDevice(server.ready.url, token, hello_of(server))
    second.next(Welcome)
    assert first.close_code()[0] == 4409
    second.send(state(mode=Mode.READY, last_cue="second"))
    until(server.services.hub, lambda d: d.connected and d.state is not None and d.state.last_cue == "second")
    second.socket.close()


def test_revoking_a_token_ends_its_link(admin: Person, device: DialledDevice) -> None:
    admin.http.post("/api/tokens/revoke", json={"name": "Lead glasses"}).raise_for_status()
    assert device.close_code()[0] == 4401


def test_the_clocks_are_compared_and_ages_come_from_capture_times(server: ConsoleServer, device: DialledDevice) -> None:
    hub = server.services.hub
    for _ in range(3):
        ping = device.next(Ping)
        device.send(Pong(ping.console_sent_s, ping.console_sent_s + 5000.0, ping.console_sent_s + 5000.0))
    device.send(state(hub.now_s() + 5000.0 - 2.0))
    shown = until(hub, lambda d: d.state is not None and d.round_trip_s is not None)
    age_s = shown.age_s(shown.state_arrival_s or 0.0)
    assert age_s is not None
    assert 1.5 <= age_s - shown.round_trip_s / 2 <= 2.5 + (shown.round_trip_s or 0.0)  # type: ignore[operator]
    assert shown.freshness(shown.state_arrival_s or 0.0) is Freshness.DELAYED


@given(st.floats(0, 100), st.floats(0, 100))
def test_nothing_gets_fresher_by_waiting(age_s: float, more_s: float) -> None:
    order = list(Freshness)
    assert order.index(freshness(age_s + more_s, True)) >= order.index(freshness(age_s, True))
    assert freshness(age_s, False) is freshness(None, True) is Freshness.LOST


def test_freshness_changes_where_the_design_says() -> None:
    for limit_s, below, above in (
        (DELAYED_AFTER_S, Freshness.LIVE, Freshness.DELAYED),
        (STALE_AFTER_S, Freshness.DELAYED, Freshness.STALE),
        (LOST_AFTER_S, Freshness.STALE, Freshness.LOST),
    ):
        assert freshness(limit_s, True) is below
        assert freshness(limit_s + 0.01, True) is above


# -------------------------------------------------------------------------------------------------------- orders
def asked(admin: Person, what: str, body: object = None) -> httpx.Response:
    return admin.http.post(f"/api/devices/glasses/{what}", json=body)


def fate(server: ConsoleServer, kind: str, state: str) -> str:
    device = until(server.services.hub, lambda d: any(c.kind == kind and c.state == state for c in d.commands))
    return next(c.refusal for c in reversed(device.commands) if c.kind == kind)


def test_a_destination_is_taken_or_refused(server: ConsoleServer, admin: Person, device: DialledDevice) -> None:
    assert asked(admin, "destination", {"poi_id": "b"}).json()["command"]["state"] == "sent"
    assert device.next(SetDestination).poi_id == "b"
    device.send(RouteChanged(1000.0, ((0.0, 0.0), (6.0, 0.0)), (("Bar", 6.0),), "b"))
    fate(server, "set_destination", "running")
    asked(admin, "destination", {"poi_id": "a"}).raise_for_status()
    device.send(RouteChanged(1001.0, refusal="No way leads there."))
    assert fate(server, "set_destination", "refused") == "No way leads there."
    assert asked(admin, "destination", {"poi_id": "nowhere"}).status_code == 404


def test_every_order_is_in_the_audit_log_whoever_gives_it(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    server.services.hub.set_destination("glasses", "b", "Somebody in the scene")
    asked(admin, "clear").raise_for_status()
    lines = [
        (line["who"], line["action"], line["detail"].strip()) for line in admin.http.get("/api/audit").json()["audit"]
    ]
    assert ("Somebody in the scene", "device_set_destination", "glasses b") in lines
    assert ("Ada", "device_clear", "glasses") in lines


def test_pause_resume_clear_and_say_are_seen_to_run(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    for what, answer in (
        ("pause", state(mode=Mode.PAUSED, destination_id="b")),
        ("resume", state(mode=Mode.GUIDING, destination_id="b")),
        ("clear", state(mode=Mode.READY)),
    ):
        asked(admin, what).raise_for_status()
        device.send(answer)
        fate(server, what, "running")
    asked(admin, "say", {"text": "Well  done."}).raise_for_status()
    assert device.next(Say).text == "Well done."
    device.send(Event(1, 1000.0, "cue", "Well done."))
    fate(server, "say", "running")
    asked(admin, "repeat").raise_for_status()
    assert isinstance(device.next(Repeat), Repeat)
    device.send(Event(2, 1001.0, "button", "The walker pressed: pause."))
    device.send(Event(3, 1001.0, "cue", "Well done."))
    fate(server, "repeat", "running")
    for bad in ({"text": ""}, {"text": "   "}, {"text": "x" * 301}, {"text": "a\x07b"}, {"word": "a"}, None):
        assert asked(admin, "say", bad).status_code == 400


def test_an_order_says_until_when_it_holds_on_the_devices_clock_and_one_that_came_too_late_is_shown_as_refused(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    hub = server.services.hub
    ping = device.next(Ping)
    device.send(Pong(ping.console_sent_s, ping.console_sent_s + 5000.0, ping.console_sent_s + 5000.0))
    until(hub, lambda d: d.clock_uncertainty_s is not None)
    before_s = hub.now_s()
    asked(admin, "pause").raise_for_status()
    order = device.next(Pause)
    assert order.expires_s is not None
    assert before_s <= order.expires_s - ORDER_HOLDS_S - 5000.0 <= hub.now_s() + 5.0
    device.send(Event(1, 1000.0, "link", expired_text(order)))
    assert fate(server, "pause", "refused") == "It came too late: the device does not carry it out."


def test_a_map_walk_is_begun_and_ended_and_what_it_sees_is_shown(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    asked(admin, "map-walk/begin").raise_for_status()
    device.next(BeginMapWalk)
    device.send(MapWalkRunning(False, "The walker is led to the destination."))
    refusal = fate(server, "begin_map_walk", "refused")
    assert refusal == "The walker is led to the destination."
    technician = invited(admin, "Tia", "technician")
    asked(technician, "map-walk/begin").raise_for_status()
    device.send(MapWalkRunning(True))
    fate(server, "begin_map_walk", "running")
    device.send(MapWalkSeen(1000.0, 12.0, 120, 1, 80, 0, 2.5, ("weak",), "slow_down", 999.0))
    seen = until(server.services.hub, lambda d: d.map_walk is not None)
    view = device_view(seen, server.services.hub.now_s())["map_walk"]
    assert (view["running"], view["seen"]["frame_count"]) == (True, 120)
    assert view["seen"]["troubles"] == [TEXTS["en"]["map_walk_weak"]]
    assert view["seen"]["last_advice"] == TEXTS["en"]["map_walk_slow_down"]
    assert view["seen"]["last_advice_age_s"] == pytest.approx(view["seen"]["age_s"] + 1.0)
    asked(technician, "map-walk/end").raise_for_status()
    device.next(EndMapWalk)
    device.send(MapWalkRunning(False))
    fate(server, "end_map_walk", "running")
    assert server.services.hub.device("glasses").map_walk is not None, "it can be looked at when it is over"
    device.send(MapWalkRunning(True))
    until(server.services.hub, lambda d: d.map_walk_running and d.map_walk is None)
    assert asked(invited(admin, "Vera", "viewer"), "map-walk/begin").status_code == 403


def test_orders_to_a_device_that_is_away_are_refused_and_waiting_ones_given_up(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    asked(admin, "destination", {"poi_id": "b"}).raise_for_status()
    device.socket.close()
    fate(server, "set_destination", "unanswered")
    answer = asked(admin, "pause")
    assert answer.status_code == 409
    assert "not connected" in answer.json()["error"]
    assert admin.http.post("/api/devices/unknown/pause").status_code == 404


def test_the_depth_silhouette_is_passed_on_as_it_came(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    assert admin.http.get("/api/devices/glasses/depth.jpg").status_code == 404
    device.send(DepthImage(1000.0, PICTURE))
    until(server.services.hub, lambda d: d.depth_image is not None)
    answer = admin.http.get("/api/devices/glasses/depth.jpg")
    assert (answer.content, answer.headers["content-type"]) == (PICTURE, "image/jpeg")


# ------------------------------------------------------------------------------------------------ settings, graph, map
def change(admin: Person, changes: dict[str, object], **more: object) -> httpx.Response:
    return admin.http.patch("/api/devices/glasses/settings", json={"changes": changes, **more})


@pytest.fixture
def tuned(server: ConsoleServer, device: DialledDevice) -> DialledDevice:
    """A device that has told what it runs."""
    device.send(SettingsRunning(0, dict(DEFAULTS)))
    until(server.services.hub, lambda d: d.settings is not None)
    return device


def test_settings_run_or_are_refused_and_both_are_kept(
    server: ConsoleServer, admin: Person, tuned: DialledDevice
) -> None:
    device = tuned
    change(admin, {"follower.sub_goal_distance_m": 2.5}, why="narrow corridor").raise_for_status()
    order = device.next(ApplySettings)
    assert order.values == {"follower.sub_goal_distance_m": 2.5}
    runs = DEFAULTS | order.values
    device.send(SettingsRunning(order.revision, runs))
    fate(server, "apply_settings", "running")
    change(admin, {"cues.announce_m": 8.0}).raise_for_status()
    second = device.next(ApplySettings)
    assert (second.values, second.base_revision) == ({"cues.announce_m": 8.0}, order.revision)
    device.send(SettingsRunning(order.revision, runs, second.revision, "Not while somebody walks."))
    assert fate(server, "apply_settings", "refused") == "Not while somebody walks."
    kept = admin.http.get("/api/devices/glasses/settings").json()
    assert kept["values"]["cues.announce_m"] == DEFAULTS["cues.announce_m"]
    newest, oldest = kept["revisions"]
    assert (newest["state"], newest["refusal"]) == ("refused", "Not while somebody walks.")
    assert (oldest["state"], oldest["why"], oldest["author"]) == ("running", "narrow corridor", "Ada")
    assert oldest["changes"] == {"follower.sub_goal_distance_m": [3.0, 2.5]}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"follower.sub_goal_distance_m": 99.0}, "from 0.5 to 10"),
        ({"follower.sub_goal_distance_m": "far"}, "from 0.5 to 10"),
        ({"follower.sub_goal_distance_m": None}, "cannot be used"),
        ({"no.such": 1}, "no setting"),
        ({}, "cannot be used"),
        ({"gate.clearance_m": 1.5}, "safety hangs on gate.clearance_m"),
        ({"obstacle.stop_distance_m": 2.0, "obstacle.clearance_m": 1.0}, "less than obstacle.narrow_clearance_m"),
    ],
)
def test_unfit_settings_are_refused_before_they_are_sent(
    admin: Person, tuned: DialledDevice, changes: dict[str, object], words: str
) -> None:
    answer = change(admin, changes)
    assert answer.status_code == 400
    assert words in answer.json()["error"]
    assert admin.http.get("/api/devices/glasses/settings").json()["revisions"] == []


def test_what_safety_hangs_on_needs_a_confirmation(admin: Person, tuned: DialledDevice) -> None:
    change(admin, {"gate.clearance_m": 1.5}, confirmed=True, why="glass doors").raise_for_status()
    assert tuned.next(ApplySettings).values["gate.clearance_m"] == 1.5


def test_a_published_graph_reaches_the_device_at_once_or_when_it_comes(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    server.services.model.apply(UpdatePoi("b", name="Tea bar"), "Ada")
    admin.http.post("/api/publish").raise_for_status()
    graph = device.next(PublishGraph).graph
    assert graph == server.services.model.for_devices
    device.send(GraphRunning(graph.version))
    until(server.services.hub, lambda d: d.graph_version == graph.version)
    late = DialledDevice(server.ready.url, token_for(admin, "Late"), hello_of(server, "late", graph_version=1))
    assert late.next(PublishGraph).graph == graph
    late.socket.close()


def test_a_device_with_another_map_fetches_ours_and_then_gets_the_graph(
    server: ConsoleServer, admin: Person, tmp_path: Path
) -> None:
    token = token_for(admin)
    stranger = DialledDevice(server.ready.url, token, hello_of(server, map_checksum="another", graph_version=0))
    offer = stranger.next(MapAvailable)
    package = httpx.get(
        server.ready.url + offer.path, headers={"Authorization": f"Bearer {token}"}, trust_env=False, timeout=20
    )
    assert len(package.content) == offer.size_bytes
    unpack_site(package.content, tmp_path / "fetched")
    assert map_checksum(tmp_path / "fetched") == offer.map_checksum
    assert hashlib.sha256(package.content).hexdigest() == offer.package_sha256
    stranger.send(MapRunning("another", "The disk is full."))
    until(server.services.hub, lambda d: d.map_refusal == "The disk is full.")
    stranger.send(MapRunning("another", waiting_checksum=offer.map_checksum))
    until(server.services.hub, lambda d: d.map_waiting == offer.map_checksum)
    stranger.send(MapRunning(offer.map_checksum))
    assert stranger.next(PublishGraph).graph == server.services.model.for_devices
    stranger.socket.close()


def test_a_package_is_fetched_in_pieces_and_only_by_a_device(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    packed = server.services.package.packed()
    whole = packed.file.read_bytes()
    headers = {"Authorization": f"Bearer {token_for(admin, 'Other')}"}
    with httpx.Client(base_url=server.ready.url, headers=headers, trust_env=False, timeout=20) as http:
        etag = http.get(packed.path).headers["ETag"]
        assert etag == f'"{packed.sha256}"'
        rest = http.get(packed.path, headers={"Range": "bytes=100-", "If-Range": etag})
        assert (rest.status_code, rest.content) == (206, whole[100:])
        assert rest.headers["Content-Range"] == f"bytes 100-{len(whole) - 1}/{len(whole)}"
        other = http.get(packed.path, headers={"Range": "bytes=100-", "If-Range": '"another"'})
        assert (other.status_code, other.content) == (200, whole)
        assert http.get(packed.path, headers={"Range": f"bytes={len(whole)}-"}).status_code == 416
        assert http.get(f"/api/device/map/{'0' * 64}").status_code == 404
    assert admin.http.get(packed.path).status_code == 401


def test_the_same_site_is_the_same_package_after_a_restart_of_the_console(
    server: ConsoleServer, tmp_path: Path
) -> None:
    first = server.services.package.packed()
    again = MapPackage(tmp_path / "site", tmp_path / "data" / "package").packed()
    assert (again.sha256, again.size_bytes) == (first.sha256, first.size_bytes)


def test_a_map_that_was_changed_under_the_console_is_not_offered_and_the_link_holds(
    server: ConsoleServer, admin: Person, small_site: Site, tmp_path: Path
) -> None:
    save_site(replace(small_site, roads_m=(small_site.roads_m[0] + 1.0,)), tmp_path / "site")
    stranger = DialledDevice(server.ready.url, token_for(admin), hello_of(server, map_checksum="another"))
    stranger.next(Welcome)
    stranger.send(Event(1, 0.0, "cue", "still linked"))
    while not isinstance(message := stranger.next(object), EventConfirmed):
        assert not isinstance(message, MapAvailable)
    stranger.socket.close()


def test_nothing_is_live_before_the_clocks_have_been_compared(server: ConsoleServer, device: DialledDevice) -> None:
    hub = server.services.hub
    ping = device.next(Ping)
    device.send(state(1000.0))
    shown = until(hub, lambda d: d.state is not None)
    assert shown.clock_uncertainty_s is None
    assert shown.freshness(shown.state_arrival_s or 0.0) is Freshness.DELAYED
    device.send(Pong(ping.console_sent_s, 1000.0, 1000.0))
    shown = until(hub, lambda d: d.clock_uncertainty_s is not None)
    assert shown.freshness(shown.connected_at_s) is Freshness.LIVE
    told = device.next(Ping)
    while told.offset_s is None:
        told = device.next(Ping)
    assert (told.offset_s, told.uncertainty_s) == (shown.clock_offset_s, shown.clock_uncertainty_s)


@pytest.mark.parametrize(
    ("uncertainty_s", "expected"), [(0.2, Freshness.LIVE), (0.6, Freshness.DELAYED), (5.0, Freshness.STALE)]
)
def test_what_may_be_old_is_not_called_live(uncertainty_s: float, expected: Freshness) -> None:
    hello = Hello(PROTOCOL_VERSION, "glasses", "0.1.0", "small", "c0ffee", 1, 0, 0.0)
    shown = LiveDevice("glasses", "Glasses", hello, True, 0.0, 0.0, uncertainty_s, state=state(9.5))
    assert shown.age_s(10.0) == 0.5
    assert shown.freshness(10.0) is expected


def test_the_stream_tells_the_whole_picture(server: ConsoleServer, admin: Person, device: DialledDevice) -> None:
    device.send(state(mode=Mode.GUIDING, action="walk", reason="ok", destination_id="b", deviation_m=0.25))
    until(server.services.hub, lambda d: d.state is not None)
    with admin.live() as socket:
        picture = heard_until(socket, lambda told: told["devices"][0]["state"] is not None)
    shown = picture["devices"][0]
    assert (shown["name"], shown["connected"]) == ("Lead glasses", True)
    assert shown["state"]["reason"] == "The way is free."
    assert shown["state"]["deviation_m"] == 0.25
    assert picture["draft_version"] == picture["published_version"]
