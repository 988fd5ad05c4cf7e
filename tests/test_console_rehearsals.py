"""Rehearsals through the console's API: over the draft, for whoever is signed in, with sound where there is a voice."""

from __future__ import annotations

import io
import threading
import time
import wave
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from console_room import WAIT_S, Person, first_admin, invited, serving

import console.rehearsals as rehearsals_module
from console.errors import ConflictError, NotFoundError, TooManyError
from console.rehearsals import LONGEST_M, Rehearsals, Sounds
from console.server import ConsoleServer
from navcore.cues.synthesis import steer_cue, tick_cue
from navcore.cues.table import Cue, CueKind, CuePriority
from navcore.espeak import SAMPLE_RATE_HZ
from navcore.planning.poi_graph import Edge, Poi, PoiGraph
from navcore.rehearsal.rehearsing import rehearse
from navcore.settings import Settings
from navcore.site import Site, save_site

WAY = {"start": "a", "destination": "b"}


def test_the_draft_is_rehearsed_for_whoever_is_signed_in(server: ConsoleServer, admin: Person) -> None:
    viewer = invited(admin, "Vera", "viewer")
    answer = viewer.http.post("/api/rehearsals", json=WAY)
    assert answer.status_code == 200, answer.text
    values = answer.json()
    done = rehearse(server.services.model.graph, "a", "b")
    assert values["arrived"] is True
    assert values["length_m"] == done.length_m == pytest.approx(6.0)
    assert values["edge_ids"] == ["a-b"]
    assert values["graph_version"] == server.services.model.graph.version
    assert [each["text"] for each in values["utterances"]] == [each.text for each in done.utterances]
    assert values["utterances"][-1] | {"sound": None} == {
        "stamp_s": done.utterances[-1].stamp_s, "x_m": done.utterances[-1].x_m, "y_m": done.utterances[-1].y_m,
        "along_m": done.utterances[-1].along_m, "kind": "arrived", "text": "You have arrived: Bar.",
        "lasts_s": done.utterances[-1].lasts_s, "angle_deg": None, "frequency_hz": None, "duration_s": 0.0,
        "pan": 0.0, "poi_id": "b", "distance_m": None, "edge_id": "a-b", "sound": None,
    }  # fmt: skip
    # What was edited a moment ago counts, published or not.
    admin.edit("set_edge", edge_id="a-b", closed=True).raise_for_status()
    refused = viewer.http.post("/api/rehearsals", json=WAY).json()
    assert (refused["arrived"], refused["refusal"]) == (
        False, "Bar cannot be reached: the way between Hall and Bar is closed.",
    )  # fmt: skip
    assert refused["utterances"][-1]["text"] == refused["refusal"]


def test_language_style_and_verbosity_can_be_chosen(admin: Person) -> None:
    chinese = admin.http.post("/api/rehearsals", json=WAY | {"language": "zh", "verbosity": "brief"}).json()
    assert chinese["language"] == "zh"
    assert chinese["utterances"][-1]["text"] == "您已到达Bar。"
    assert not {each["kind"] for each in chinese["utterances"]} & {"poi_ahead", "reassurance"}
    assert admin.http.post("/api/rehearsals", json=WAY | {"direction_style": "clock"}).status_code == 200


@pytest.mark.parametrize(
    ("body", "status", "sentence"),
    [
        (WAY | {"start": "gone"}, 404, "There is no place 'gone'"),
        (WAY | {"destination": "gone"}, 404, "There is no place 'gone'"),
        (WAY | {"language": "tlh"}, 400, "language"),
        (WAY | {"speed_m_s": 1}, 400, "speed_m_s"),
        ({"start": "a"}, 400, "destination"),
    ],
)
def test_what_cannot_be_rehearsed_is_refused_in_a_sentence(
    admin: Person, body: dict[str, object], status: int, sentence: str
) -> None:
    answer = admin.http.post("/api/rehearsals", json=body)
    assert (answer.status_code, sentence in answer.json()["error"]) == (status, True), answer.text


def test_a_way_of_any_length_is_no_burden(tmp_path: Path, small_site: Site) -> None:
    far = PoiGraph(
        1,
        {"a": Poi("a", "Hall", "hall", 0.0, 0.0), "b": Poi("b", "Moon", "other", 2.0 * LONGEST_M, 0.0)},
        {"ab": Edge("ab", "a", "b", ((0.0, 0.0), (2.0 * LONGEST_M, 0.0)), 2.0 * LONGEST_M)},
    )
    ticks = iter(range(1000))
    hurried = Rehearsals(lambda: float(next(ticks)), longest_s=5.0)
    with pytest.raises(ConflictError, match="takes too long"):
        hurried.rehearse(_shorter(far), "a", "b", Settings())
    save_site(replace(small_site, poi_graph=far), tmp_path / "site")
    with serving(tmp_path / "site", tmp_path / "data") as running:
        answer = first_admin(running).http.post("/api/rehearsals", json=WAY)
    assert answer.status_code == 400
    assert "rehearse it in parts" in answer.json()["error"]


def _shorter(graph: PoiGraph) -> PoiGraph:
    edge = Edge("ab", "a", "b", ((0.0, 0.0), (50.0, 0.0)), 50.0)
    return PoiGraph(1, graph.pois | {"b": Poi("b", "Moon", "other", 50.0, 0.0)}, {"ab": edge})


def test_one_way_is_rehearsed_at_a_time(small_site: Site) -> None:
    begun, go_on, arrived = threading.Event(), threading.Event(), threading.Event()

    def clock_s() -> float:
        begun.set()
        assert go_on.wait(WAIT_S)
        return 0.0

    rehearsals = Rehearsals(clock_s, longest_s=0.05)

    def run() -> None:
        if rehearsals.rehearse(small_site.poi_graph, "a", "b", Settings()).arrived:
            arrived.set()

    first = threading.Thread(target=run)
    first.start()
    assert begun.wait(WAIT_S)
    with pytest.raises(TooManyError, match="try again"):
        rehearsals.rehearse(small_site.poi_graph, "b", "a", Settings())
    go_on.set()
    first.join(WAIT_S)
    assert arrived.is_set()
    assert rehearsals.rehearse(small_site.poi_graph, "b", "a", Settings()).arrived, "and then the next"


def test_few_wait_for_their_turn_and_the_others_are_told_at_once(small_site: Site) -> None:
    go_on = threading.Event()

    def clock_s() -> float:
        assert go_on.wait(WAIT_S)
        return 0.0

    rehearsals, ended = Rehearsals(clock_s), []

    def run() -> None:
        ended.append(rehearsals.rehearse(small_site.poi_graph, "a", "b", Settings()).arrived)

    running = [threading.Thread(target=run) for _ in range(3)]
    for thread in running:
        thread.start()
    deadline_s = time.monotonic() + WAIT_S
    while rehearsals._present._value and time.monotonic() < deadline_s:
        time.sleep(0.01)
    with pytest.raises(TooManyError, match="try again"):
        rehearsals.rehearse(small_site.poi_graph, "b", "a", Settings())
    assert ended == [], "nobody had to end before that was said"
    go_on.set()
    for thread in running:
        thread.join(WAIT_S)
    assert ended == [True] * 3


# ---------------------------------------------------------------------------------------------------------- sound
def samples_of(wav: bytes) -> np.ndarray:
    with wave.open(io.BytesIO(wav)) as sound:
        assert (sound.getnchannels(), sound.getsampwidth(), sound.getframerate()) == (2, 2, SAMPLE_RATE_HZ)
        return np.frombuffer(sound.readframes(sound.getnframes()), "<i2").reshape(-1, 2)


def test_each_utterance_can_be_heard(server: ConsoleServer, admin: Person) -> None:
    values = admin.http.post("/api/rehearsals", json=WAY).json()
    voiced = server.services.sounds.has_voice
    assert values["voice"] == ("espeak-ng" if voiced else "browser")
    for each in values["utterances"]:
        assert (each["sound"] is None) == (bool(each["text"]) and not voiced)
        if each["sound"] is None:
            continue
        answer = admin.http.get(each["sound"])
        assert (answer.status_code, answer.headers["content-type"]) == (200, "audio/wav")
        assert "immutable" in answer.headers["cache-control"]
        samples = samples_of(answer.content)
        assert len(samples) / SAMPLE_RATE_HZ == pytest.approx(each["lasts_s"], rel=0.5)
        assert np.abs(samples).max() > 1000
    tick = next(each for each in values["utterances"] if each["kind"] == "tick")
    assert admin.http.get(tick["sound"]).content == admin.http.get(tick["sound"]).content


def test_nothing_but_what_was_rehearsed_can_be_heard(server: ConsoleServer, admin: Person) -> None:
    for key in ("0" * 32, "../../etc/passwd", "x"):
        assert admin.http.get(f"/api/rehearsals/sounds/{key}").status_code == 404
    nobody = Person(server.ready.url)
    assert nobody.http.get(f"/api/rehearsals/sounds/{'0' * 32}").status_code == 401
    assert nobody.http.post("/api/rehearsals", json=WAY).status_code in (401, 403)


def test_a_sound_is_named_by_its_content_and_is_in_its_place() -> None:
    sounds = Sounds()
    left, right = (steer_cue(0.0, angle_deg) for angle_deg in (30.0, -30.0))
    keys = [sounds.key_of(cue, "en") for cue in (left, right, steer_cue(9.0, 30.0), tick_cue(0.0))]
    assert keys[0] == keys[2], "when it is heard does not matter"
    assert len({keys[0], keys[1], keys[3]}) == 3
    assert keys[0] is not None
    heard = samples_of(sounds.wav(keys[0])).astype(float)
    assert np.abs(heard[:, 0]).max() > 2 * np.abs(heard[:, 1]).max(), "left is louder on the left"


def test_without_a_voice_the_browser_speaks(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    sounds = Sounds()
    assert not sounds.has_voice
    assert sounds.key_of(Cue(0.0, CueKind.WALK, CuePriority.TURN, "Move forward."), "en") is None
    key = sounds.key_of(tick_cue(0.0), "en")
    assert key is not None
    assert len(samples_of(sounds.wav(key))) > 0


def test_old_sounds_make_room_for_new_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rehearsals_module, "_MAX_KNOWN", 3)
    monkeypatch.setattr(rehearsals_module, "_MAX_CACHED_BYTES", 20_000)
    sounds = Sounds()
    keys = [sounds.key_of(steer_cue(0.0, float(angle_deg)), "en") or "" for angle_deg in range(1, 6)]
    with pytest.raises(NotFoundError, match="rehearse the way again"):
        sounds.wav(keys[0])
    for key in keys[2:]:
        assert len(sounds.wav(key)) > 1000
    assert sounds._made_bytes == sum(map(len, sounds._made.values())) <= 20_000
