"""The live stream: made once for all pages, and each page hears what seldom changes when it changes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from console_room import DialledDevice, Person, heard_until, hello_of, until

from console.alerts.alerts import Alert
from console.live import Command, LiveDevice
from console.live_pictures import LivePictures, Told
from console.server import ConsoleServer
from navcore.wire import PROTOCOL_VERSION, Event, Hello, RouteChanged, WalkerState

WALKER = LiveDevice(
    "glasses", "Glasses", Hello(PROTOCOL_VERSION, "glasses", "0.1", "small", "x", 1, 0, 0.0), True, 0.0, 0.0, 0.001,
    state=WalkerState(10.0, "localized", "walk", "ok"), events=(Event(1, 9.0, "cue", "Move forward."),),
    commands=(Command(1, "say", "Well done.", "Ada", 0.0), Command(2, "apply_settings", "3", "Ada", 0.0)),
    route=RouteChanged(9.0, ((0.0, 0.0), (1.0, 0.0)), (), "b"),
)  # fmt: skip


class NoAlerts:
    """No alert of anybody."""

    def active(self, device_id: str | None = None) -> tuple[Alert, ...]:
        return ()

    def views(self, device_id: str | None = None) -> list[dict[str, Any]]:
        return []


@pytest.fixture
def pictures() -> LivePictures:
    return LivePictures(NoAlerts())


def parts_of(news: dict[str, Any]) -> dict[str, Any]:
    return {name: json.loads(bytes(part)) for name, part in news.get("parts", {}).get("glasses", {}).items()}


def test_all_pages_share_a_picture_until_the_device_tells_something_or_it_grows_old(pictures: LivePictures) -> None:
    first = pictures.of(WALKER, 10.1, is_watched=True)
    again = pictures.of(WALKER, 10.12, is_watched=True)
    assert (again.changing is first.changing, again.made_s) == (True, 10.1), "its ages are those at 10.1 s"
    assert json.loads(bytes(again.changing))["age_s"] == pytest.approx(0.1)
    moved = replace(WALKER, state=WalkerState(10.11, "lost", "stop", "pose_lost"))
    assert json.loads(bytes(pictures.of(moved, 10.13, is_watched=True).changing))["state"]["action"] == "stop"
    later = pictures.of(moved, 15.2, is_watched=True)
    assert (later.made_s, json.loads(bytes(later.changing))["freshness"]) == (15.2, "stale")


def test_each_page_is_told_a_part_once_and_again_when_it_changes(pictures: LivePictures) -> None:
    ada, ben = Told(), Told()
    assert set(parts_of(ada.news([pictures.of(WALKER, 10.1, is_watched=True)]))) == {
        "events", "commands", "route", "alerts",
    }  # fmt: skip
    moved = replace(WALKER, state=WalkerState(11.0, "localized", "walk", "ok"))
    assert ada.news([pictures.of(moved, 11.1, is_watched=True)]) == {}
    spoken = replace(moved, events=(*moved.events, Event(2, 12.0, "cue", "Stop.")))
    told = parts_of(ada.news([pictures.of(spoken, 12.5, is_watched=True)]))
    assert [each["text"] for each in told["events"]["value"]] == ["Stop.", "Move forward."]
    assert (set(told), told["events"]["now_s"]) == ({"events"}, 12.5)
    assert [each["age_s"] for each in told["events"]["value"]] == pytest.approx([0.5, 3.5])
    late = parts_of(ben.news([pictures.of(spoken, 20.0, is_watched=True)]))
    assert late["events"] == told["events"], "who comes later is told the same, dated as it was"
    assert late["route"]["value"]["age_s"] == pytest.approx(late["route"]["now_s"] - 9.0)


def test_a_clock_that_is_known_better_dates_the_parts_anew(pictures: LivePictures) -> None:
    told = Told()
    told.news([pictures.of(WALKER, 10.1, is_watched=True)])
    better = replace(WALKER, clock_offset_s=5.0)
    assert parts_of(told.news([pictures.of(better, 10.2, is_watched=True)]))["route"]["value"]["age_s"] > 6.0


def test_a_device_that_was_away_is_told_whole(pictures: LivePictures) -> None:
    told = Told()
    shown = [pictures.of(WALKER, 10.1, is_watched=True)]
    told.news(shown)
    assert told.news([]) == {}
    assert set(parts_of(told.news(shown))) >= {"events", "route"}


def test_who_ceases_to_watch_is_told_that_nothing_is_shown_any_more(pictures: LivePictures) -> None:
    told = Told()
    told.news([pictures.of(WALKER, 10.1, is_watched=True)])
    shown = pictures.of(WALKER, 10.1, is_watched=False)
    parts = parts_of(told.news([shown]))
    assert (parts["events"]["value"], parts["route"]["value"]) == ([], None)
    assert [each["kind"] for each in parts["commands"]["value"]] == ["apply_settings"]
    view = json.loads(bytes(shown.changing))
    assert (view["state"], view["depth_stamp_s"], view["connected"]) == (None, None, True)


@pytest.fixture
def device(server: ConsoleServer) -> Iterator[DialledDevice]:
    dialled = DialledDevice(server.ready.url, server.services.devices.create_token("Glasses", "test"), hello_of(server))
    yield dialled
    dialled.socket.close()


def tells_events(told: dict[str, Any]) -> bool:
    return bool(told.get("parts", {}).get("glasses", {}).get("events", {}).get("value"))


def test_a_page_that_comes_again_is_told_everything(
    server: ConsoleServer, admin: Person, device: DialledDevice
) -> None:
    device.send(Event(1, 999.0, "cue", "Move forward."))
    until(server.services.hub, lambda known: bool(known.events))
    for _ in range(2):
        with admin.live(path="/live?devices=one") as socket:
            events = heard_until(socket, tells_events)["parts"]["glasses"]["events"]["value"]
            assert [each["text"] for each in events] == ["Move forward."]
            device.send(WalkerState(1000.0, "lost", "stop", "pose_lost"))
            while (told := json.loads(socket.recv(timeout=20)))["devices"][0]["state"] is None:
                pass
            assert "events" not in told.get("parts", {}).get("glasses", {})
