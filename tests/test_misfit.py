"""What cannot be used is told in our own words, with the field and what is expected, whoever sent it and wherever."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator
from typing import Any, get_args

import msgspec
import pytest
from console_room import DialledDevice, Person, hello_of
from pydantic import BaseModel, ValidationError
from test_console_recordings import Sender

from console import bodies
from console.edits import Edit
from console.server import ConsoleServer
from navcore.misfit import field_and_words, words_of
from navcore.recording_upload import OFFERS_PATH, RecordingOffer
from navcore.wire import GraphRunning, Welcome, encode

FOREIGN = re.compile(r"`|\$|Expected|Invalid|Object |Input should|[Vv]alid |malformed|JSON decode|should have|parsing")
"""What the libraries say that nobody else does."""
UNSAID = "does not have the form that is due"
HARSH: tuple[Any, ...] = (
    None, True, -1, 0, 7, 1 << 70, -0.5, 0.5, float("nan"), float("inf"), 1e300, "", "x", "x" * 5000, "\x00", "7",
    [], [0], [0] * 5000, {}, {"": {}}, {"x": None}, {"x": [1]}, b"x",
)  # fmt: skip
PLACE = {"edit": "add_poi", "name": "A", "kind": "room", "x_m": 1.0, "y_m": 0.0}

REQUESTS: list[tuple[str, Any, str]] = [
    ("/api/sign-in", {"name": "Ada"}, "password cannot be used: it is missing."),
    ("/api/sign-in", {"name": 5, "password": "x"}, "name cannot be used: it must be text."),
    ("/api/sign-in", {"name": "", "password": "x"}, "name cannot be used: it must not be empty."),
    ("/api/sign-in", {"name": "x" * 201, "password": ""}, "name cannot be used: it must have at most 200 characters."),
    ("/api/sign-in", [], "The request cannot be used: it must be an object."),
    ("/api/sign-in", b"{", "The request cannot be used: it is no JSON."),
    ("/api/sign-in", b'{"name": "\xff"}', "The request cannot be used: it is no text in UTF-8."),
    ("/api/sign-in", b"", "The request cannot be used: it is missing."),
    ("/api/users", {"name": "V", "role": "king"},
     "role cannot be used: it must be 'viewer', 'editor', 'technician' or 'admin'."),
    ("/api/users", {"name": "V", "role": "viewer", "age": 7}, "age cannot be used: it is not known here."),
    ("/api/privacy/days", {"days": "7"}, "days cannot be used: it must be a whole number."),
    ("/api/privacy/days", {"days": 0}, "days cannot be used: it must be 1 or more."),
    ("/api/publish", {"confirmed": "x"}, "confirmed cannot be used: it must be true or false."),
    ("/api/publish", {"confirmed": True}, "The request cannot be used: say which version's errors were seen."),
    ("/api/view", {"point": [1]}, "point.1 cannot be used: it is missing."),
    ("/api/view", {"point": ["x", 1]}, "point.0 cannot be used: it must be a number."),
    ("/api/view", {"point": [1e9, 1]}, "point.0 cannot be used: it must be 100000 or less."),
    ("/api/settings/presets", {"name": "A", "values": {"a.b": None}},
     "values.a.b cannot be used: it must be true or false, a whole number, a number or text."),
    ("/api/import/graph?confirm=X", b"{}",
     "confirm cannot be used: it must have no characters but hexadecimal digits."),
    ("/api/edits", b"{", "This edit cannot be made: it is cut off."),
    ("/api/edits", b"yes", "This edit cannot be made: it is no JSON."),
    ("/api/edits", b"\xff", "This edit cannot be made: it is no JSON."),
    ("/api/edits", b'{"edit":' * 30_000, "This edit cannot be made: it is nested too deeply."),
    ("/api/edits", [], "This edit cannot be made: it must be an object."),
    ("/api/edits", {}, "This edit cannot be made: edit is missing."),
    ("/api/edits", {"edit": "explode"}, "This edit cannot be made: edit cannot be 'explode'."),
    ("/api/edits", {"edit": "delete_poi"}, "This edit cannot be made: poi_id is missing."),
    ("/api/edits", {"edit": "delete_poi", "poi_id": "a", "also": 1},
     "This edit cannot be made: also is not known here."),
    ("/api/edits", {"edit": "delete_poi", "poi_id": "a", "x - at `$.y`\n": 1},
     "This edit cannot be made: x - at `$.y`  is not known here."),
    ("/api/edits", PLACE | {"name": 1}, "This edit cannot be made: name must be text."),
    ("/api/edits", PLACE | {"name": ""}, "This edit cannot be made: name must not be empty."),
    ("/api/edits", PLACE | {"x_m": 1e300}, "This edit cannot be made: x_m must be 100000 or less."),
    ("/api/edits", PLACE | {"x_m": "far"}, "This edit cannot be made: x_m must be a number."),
    ("/api/edits", PLACE | {"kind": "palace"}, "This edit cannot be made: kind cannot be 'palace'."),
]  # fmt: skip


@pytest.mark.parametrize(("path", "body", "sentence"), REQUESTS)
def test_a_spoiled_body_is_told_by_field_and_what_is_expected(
    admin: Person, path: str, body: Any, sentence: str
) -> None:
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    answer = admin.http.post(path, content=content, headers={"Content-Type": "application/json"})
    assert (answer.status_code, answer.json()["error"]) == (400, sentence)


def test_a_spoiled_query_and_a_spoiled_path_are_told_so_too(admin: Person) -> None:
    for path, sentence in (
        ("/api/audit?before=x", "before cannot be used: it must be a whole number."),
        ("/api/audit?before=-1", "before cannot be used: it must be 0 or more."),
        ("/api/versions/x/difference", "version cannot be used: it must be a whole number."),
    ):
        assert admin.http.get(path).json() == {"error": sentence}


def test_a_spoiled_file_is_told_so_too(admin: Person) -> None:
    place = {"type": "Feature", "geometry": {"type": "Point", "coordinates": ["x", 0]}, "properties": {"what": "place"}}
    marker = {"schema_version": 1, "graph_version": 1}
    for collection, words in (
        ({"type": "FeatureCollection", "features": 5}, "(features must be a list)"),
        ({"type": "FeatureCollection", "features": [place], "vbr_poi_graph": marker}, "(entry 0 must be a number)"),
        ({"type": "FeatureCollection", "features": [], "vbr_poi_graph": {}}, "(schema_version is missing)"),
    ):
        answer = admin.http.post("/api/import/graph", content=json.dumps(collection).encode())
        assert (answer.status_code, words in answer.json()["error"]) == (400, True), answer.text
        assert not FOREIGN.search(answer.json()["error"])


def test_devices_are_told_so_too(server: ConsoleServer, admin: Person) -> None:
    sender = Sender(server, admin)
    offer = msgspec.to_builtins(RecordingOffer("walk", "a walk", 5, "0" * 64))
    answer = sender.http.post(OFFERS_PATH, content=json.dumps(offer | {"size_bytes": -1}).encode())
    assert answer.json()["error"].startswith("This offer of a recording cannot be read (size_bytes must be 0 or more)")
    token = server.services.devices.create_token("Spoiled", "test")
    plain = msgspec.msgpack.decode(encode(GraphRunning(1)))
    for changes, words in (
        ({"version": "x"}, "version must be a whole number"), ({"version": -1}, "version must be 0 or more"),
        ({"type": "dance"}, "type cannot be 'dance'"),
    ):  # fmt: skip
        device = DialledDevice(server.ready.url, token, hello_of(server, "spoiled"))
        device.next(Welcome)
        device.socket.send(msgspec.msgpack.encode(plain | changes))
        code, reason = device.close_code()
        assert (code, reason.startswith(f"A message cannot be read ({words})")) == (1007, True), reason


# -------------------------------------------------------------------------------- whatever is spoiled in whatever way
def body_models() -> Iterator[type[BaseModel]]:
    for name, model in inspect.getmembers(bodies, inspect.isclass):
        if issubclass(model, BaseModel) and name.endswith("Body"):
            yield model


def test_no_body_is_refused_in_words_of_a_library() -> None:
    told = set[str]()
    for model in body_models():
        for spoiled in (*HARSH, {"also": 1}, *({field: harsh} for field in model.model_fields for harsh in HARSH)):
            try:
                model.model_validate(spoiled)
            except ValidationError as error:
                errors = [{**each, "loc": ("body", *each["loc"])} for each in error.errors()]
                told |= {field_and_words([each])[1] for each in errors} | {field_and_words(errors)[1]}
    assert len(told) > 20
    assert [words for words in told if FOREIGN.search(words) or UNSAID in words] == []


def test_no_edit_is_refused_in_words_of_a_library() -> None:
    told, decoder = set[str](), msgspec.json.Decoder(Edit)
    for kind in get_args(Edit):
        tag = kind.__struct_config__.tag
        for field in msgspec.structs.fields(kind):
            for harsh in HARSH[:-1]:
                spoiled = {"edit": tag, field.encode_name: harsh}
                try:
                    decoder.decode(json.dumps(spoiled))
                except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
                    told.add(words_of(error))
    assert len(told) > 20
    assert [words for words in told if FOREIGN.search(words) or UNSAID in words] == []
