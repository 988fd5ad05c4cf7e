"""Many devices as small rows, a stream for each page that holds no more than it shows, and what time it is."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from typing import Any

import pytest
from console_room import DialledDevice, Person, hello_of, until
from hypothesis import given
from hypothesis import strategies as st
from viewer_fixtures import RecordingOutlet
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from console.hub import DeviceHub
from console.live import LiveDevice
from console.live_panel import device_view
from console.overview import differences, overview_row
from console.overview_socket import ROWS_AT_ONCE_COUNT, messages
from console.place_words import PlaceWords
from console.server import ConsoleServer
from navcore.modes import Mode
from navcore.planning.poi_graph import PoiGraph
from navcore.site import Site
from navcore.wire import PROTOCOL_VERSION, Event, Hello, WalkerState, Welcome

WAIT_S = 20.0
ROWS = st.dictionaries(
    st.sampled_from("abcdef"),
    st.fixed_dictionaries({"name": st.sampled_from("xy"), "left_m": st.one_of(st.none(), st.integers(0, 3))}),
)


@given(st.lists(ROWS, max_size=6))
def test_a_page_that_takes_in_every_difference_has_the_rows_of_the_console(states: list[dict[str, Any]]) -> None:
    page: dict[str, dict[str, Any]] = {}
    before: dict[str, Any] = {}
    for rows in states:
        changed, gone = differences(before, rows)
        for key, fields in changed.items():
            page[key] = page.get(key, {}) | fields
        for key in gone:
            del page[key]
        assert page == rows
        assert differences(rows, rows) == ({}, [])
        before = rows


def test_no_message_of_the_overview_holds_more_than_a_few_rows() -> None:
    rows = {f"device-{number}": {"name": f"Device {number}"} for number in range(120)}
    told = list(messages({}, rows))
    assert max(len(message["rows"]) for message in told) == ROWS_AT_ONCE_COUNT
    assert {key for message in told for key in message["rows"]} == set(rows)
    assert list(messages(rows, rows)) == [{"rows": {}, "gone": [], "count": 120, "anew": False}], (
        "silence is never sent"
    )


def test_a_place_is_told_in_the_words_of_the_map(small_site: Site) -> None:
    places = PlaceWords(small_site.poi_graph)
    assert places.at(0.5, 0.2) == "at Hall"
    assert places.at(5.0, 1.0) == "at Bar"
    assert places.at(3.0, 0.0) == "between Hall and Bar"
    assert places.at(4.5, 9.0) == "9 m off the road, near Bar"
    assert PlaceWords(PoiGraph()).at(0.0, 0.0) == ""
    assert PlaceWords(PoiGraph(pois=small_site.poi_graph.pois)).at(6.0, 4.0) == "4 m from Bar"


def test_a_device_that_joins_anew_and_has_not_told_its_state_is_not_shown_with_the_old_one(small_site: Site) -> None:
    graph, places = small_site.poi_graph, PlaceWords(small_site.poi_graph)
    hello = Hello(PROTOCOL_VERSION, "glasses", "0.1", "small", "x", 1, 0, 0.0)
    before, now = (
        overview_row(LiveDevice("glasses", "Glasses", hello, True, 0.0, 0.0, state=told), graph, places)
        for told in (state(), None)
    )
    assert set(before) == set(now), "a field that is left out would stay on the page"
    assert (before["mode"], now["mode"], now["captured_s"], now["is_told"]) == ("guiding", None, None, True)
    device = LiveDevice("glasses", "Glasses", hello, True, 0.0, 0.0, state=state())
    unseen = overview_row(device, graph, places, is_watched=False)
    assert set(unseen) == set(now)
    assert (unseen["mode"], unseen["captured_s"], unseen["is_told"]) == (None, None, False)


# ------------------------------------------------------------------------------------------------- a real console
@pytest.fixture
def glasses(server: ConsoleServer) -> Iterator[list[DialledDevice]]:
    """Two devices that have told where they are."""
    dialled = []
    for name in ("left", "right"):
        token = server.services.devices.create_token(f"Glasses {name}", "test")
        device = DialledDevice(server.ready.url, token, hello_of(server, name))
        device.next(Welcome)
        device.send(state())
        dialled.append(device)
        until(server.services.hub, lambda d, name=name: d.device_id == name and d.state is not None)  # type: ignore[misc]
    yield dialled
    for device in dialled:
        device.socket.close()


def state(**changes: Any) -> WalkerState:
    values: dict[str, Any] = {
        "stamp_s": 1000.0, "quality": "localized", "action": "walk", "reason": "ok", "mode": Mode.GUIDING,
        "pose": (3.0, 0.0, 1.6, 0.0), "destination_id": "b", "remaining_m": 3.0, "sonar_state": "no_echo",
    }  # fmt: skip
    return WalkerState(**(values | changes))


def heard(socket: ClientConnection) -> dict[str, Any]:
    picture: dict[str, Any] = json.loads(socket.recv(timeout=WAIT_S))
    return picture


def test_a_stream_of_one_device_holds_nothing_of_the_others_but_who_they_are(
    server: ConsoleServer, admin: Person, glasses: list[DialledDevice]
) -> None:
    with admin.live(path="/live?devices=one&device=right") as socket:
        picture = heard(socket)
        assert [device["id"] for device in picture["devices"]] == ["right"]
        assert [(each["id"], each["name"]) for each in picture["roster"]] == [
            ("left", "Glasses left"), ("right", "Glasses right"),
        ]  # fmt: skip
        assert all("state" not in each for each in picture["roster"])
        assert "roster" not in heard(socket), "who is there is told when that changes"
        glasses[0].socket.close()
        while "roster" not in (picture := heard(socket)):
            pass
        assert [each["connected"] for each in picture["roster"]] == [False, True]
    with admin.live(path="/live?devices=none") as socket:
        assert heard(socket)["devices"] == []


def test_a_page_that_named_no_device_keeps_the_one_that_it_was_given(
    server: ConsoleServer, admin: Person, glasses: list[DialledDevice]
) -> None:
    glasses[0].socket.close()
    until(server.services.hub, lambda d: d.device_id == "left" and not d.connected)
    with admin.live(path="/live?devices=one") as socket:
        assert heard(socket)["devices"][0]["id"] == "right", "one that is connected comes first"
        token = server.services.devices.create_token("Glasses a", "test")
        first = DialledDevice(server.ready.url, token, hello_of(server, "a"))
        while len(heard(socket).get("roster", ())) != 3:
            pass
        assert heard(socket)["devices"][0]["id"] == "right", "nobody finds another walker below their hands"
        first.socket.close()


def test_the_overview_tells_every_device_once_and_then_what_differs(
    server: ConsoleServer, admin: Person, glasses: list[DialledDevice]
) -> None:
    with admin.live(path="/live/overview") as socket:
        picture = heard(socket)
        assert set(picture["rows"]) == {"left", "right"}
        while picture["rows"].get("left", {}).get("place") is None:
            picture = heard(socket)  # the walkers are told first that somebody watches
        row = {"name": "Glasses left"} | picture["rows"]["left"]
        assert (row["name"], row["place"]) == ("Glasses left", "between Hall and Bar")
        assert (row["destination"], row["remaining_m"]) == ("Bar", 3.0)
        assert picture["now_s"] - row["captured_s"] >= 0.0
        glasses[0].send(state(stamp_s=1000.5, remaining_m=2.0))
        while not (rows := heard(socket)["rows"]):
            pass
        assert set(rows["left"]) <= {"captured_s", "remaining_m", "uncertainty_s"}, "what is the same is not told again"
        assert rows["left"]["remaining_m"] == 2.0
        assert "right" not in rows


def test_a_page_that_asks_is_told_the_consoles_time_and_one_that_talks_nonsense_is_shown_out(
    server: ConsoleServer, admin: Person
) -> None:
    hub = server.services.hub
    with admin.live(path="/live/overview") as socket:
        before_s = hub.now_s()
        socket.send('{"type": "clock", "page_sent_s": 12.5}')
        while (told := heard(socket)).get("type") != "clock":
            pass
        assert told["page_sent_s"] == 12.5
        assert before_s <= told["console_received_s"] <= told["console_sent_s"] <= hub.now_s()
    beyond = '{"type": "clock", "page_sent_s": 1, "more": 2}'
    for nonsense in ("hello", "[" * 200, '{"type": "clock"}', beyond, "x" * 9999):
        with admin.live() as socket:
            socket.send(nonsense)
            assert code_after(socket) == 1008


def code_after(socket: ClientConnection) -> int | None:
    """Read until the console closes; return its code."""
    with contextlib.suppress(ConnectionClosed):
        while True:
            heard(socket)
    return socket.close_code


def test_an_order_tells_how_long_it_took_until_the_device_had_done_it() -> None:
    now = [100.0]
    hub = DeviceHub(now_s=lambda: now[0], wall_s=lambda: 0.0)
    outlet = RecordingOutlet()
    hub.connect(Hello(PROTOCOL_VERSION, "glasses", "0.1", "small", "x", 1, 0, 0.0), "Glasses", outlet)

    def commands() -> list[dict[str, Any]]:
        shown: list[dict[str, Any]] = device_view(hub.device("glasses"), now[0])["commands"]
        return shown

    hub.say("glasses", "Well done.", "Ada")
    now[0] = 100.4
    (waiting,) = commands()
    assert (waiting["state"], waiting["took_s"], waiting["age_s"]) == ("sent", None, pytest.approx(0.4))
    hub.receive("glasses", Event(1, 0.0, "cue", "Well done."))
    hub.repeat("glasses", "Ada")
    now[0] = 103.0
    hub.disconnect("glasses", outlet)
    shown = [(command["state"], command["took_s"]) for command in commands()]
    assert shown == [("running", pytest.approx(0.4)), ("unanswered", pytest.approx(2.6))]
