"""No name and no text that people give holds what nobody can see: it would turn sentences round, or not be spoken."""

from __future__ import annotations

import json
from typing import Any

import pytest
from console_room import Person

from navcore import graph_geojson, graph_graphml
from navcore.errors import InputError
from navcore.graph_import import imported
from navcore.planning.poi_graph import Poi, PoiGraph

HIDDEN = ["\u0000a", "Lift\nA", "a\u202egnp.exe", "a\u2066b", "\ufeffa", "a\u200bb", "a\u2028b", "a\x7f", "a\x85b"]
SEEN = ["لیفت می\u200cرود", "क्\u200dष", "Café", "洗手间", "👩\u200d🦯", "Lift – A"]


def poi(admin: Person) -> dict[str, Any]:
    return next(each for each in admin.graph()["pois"] if each["id"] == "b")


@pytest.mark.parametrize("text", HIDDEN)
def test_what_nobody_can_see_is_refused_in_a_sentence_and_nothing_is_changed(admin: Person, text: str) -> None:
    before = admin.graph()
    for path, body in (
        ("/api/edits", {"edit": "add_poi", "name": text, "kind": "lift", "x_m": 3.0, "y_m": 0.0}),
        ("/api/edits", {"edit": "update_poi", "poi_id": "b", "name": text}),
        ("/api/edits", {"edit": "update_poi", "poi_id": "b", "spoken_name": text}),
        ("/api/edits", {"edit": "update_poi", "poi_id": "b", "notes": text.replace("\n", "\u202e")}),
        ("/api/versions", {"name": text}),
        ("/api/alerts/none/acknowledge", {"note": text.replace("\n", "\u202e")}),
    ):  # fmt: skip
        answer = admin.http.post(path, json=body)
        assert answer.status_code == 400, (path, body, answer.text)
        assert "a character that nobody can see (U+" in answer.json()["error"]
        assert answer.json()["error"].endswith(".")
    assert admin.graph() == before


def test_a_place_whose_name_shows_nothing_has_none(admin: Person) -> None:
    answer = admin.edit("update_poi", poi_id="b", name="\u200d \u200c")
    assert (answer.status_code, answer.json()["error"]) == (400, "A place needs a name.")


@pytest.mark.parametrize("text", SEEN)
def test_every_script_is_written_as_it_is(admin: Person, text: str) -> None:
    admin.edit("update_poi", poi_id="b", name=text, spoken_name=text, notes=f"{text}\n\t{text}").raise_for_status()
    assert (poi(admin)["name"], poi(admin)["notes"]) == (text, f"{text}\n\t{text}")
    admin.http.post("/api/versions", json={"name": text}).raise_for_status()


@pytest.mark.parametrize("text", HIDDEN)
def test_no_file_brings_it_in(text: str) -> None:
    draft = PoiGraph(1, {"b": Poi("b", "Bar", "bar", 0.0, 0.0, on_road=False)})
    whole = PoiGraph(1, {"b": Poi("b", "Bar", "bar", 0.0, 0.0, on_road=False, spoken_name=text)})
    for file in (graph_geojson.encode(whole, "site", "Site"), graph_graphml.encode(whole, "site", "Site")):
        with pytest.raises(InputError, match="nobody can see"):
            imported(file, draft)
    feature = {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [0.0, 0.0]},
        "properties": {"name": text},
    }
    of_others = imported(json.dumps({"type": "FeatureCollection", "features": [feature]}).encode(), draft)
    assert not any(text in poi.name for poi in of_others.graph.pois.values())
