"""Files that are sent to a real console to do harm: refused with a sentence, and the disk stays as it was."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import socket
import struct
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

import httpx
import pytest
from console_room import Person, first_admin, invited, serving
from fuzz.seeds import site
from test_console_recordings import Sender

from console.rules import MAX_BODY_BYTES
from console.server import ConsoleServer
from navcore.graph_import import MAX_GRAPH_FILE_BYTES
from navcore.recording_upload import MAX_RECORDING_BYTES, OFFERS_PATH, PIECE_BYTES, piece_path
from navcore.site import save_site

GRAPH, SITE = "/api/import/graph", "/api/import/site"
WAIT_S = 20.0
EMPTY_GRAPH = b'{"type":"FeatureCollection","features":[]}'


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ConsoleServer]:
    folder = tmp_path_factory.mktemp("attacked")
    save_site(site(), folder / "site")
    with serving(folder / "site", folder / "data") as running:
        yield running


@pytest.fixture(scope="module")
def editor(server: ConsoleServer) -> Person:
    return invited(first_admin(server), "Eve", "admin")


@pytest.fixture(scope="module")
def archive(editor: Person) -> bytes:
    return editor.http.get("/api/export/site.zip").raise_for_status().content


@pytest.fixture(scope="module")
def sender(server: ConsoleServer, editor: Person) -> Sender:
    return Sender(server, editor)


@pytest.fixture(autouse=True)
def _nothing_changes(server: ConsoleServer, archive: bytes, request: pytest.FixtureRequest) -> Iterator[None]:
    """After every attack the console answers, and draft and files are what they were."""
    draft, before = server.services.model.graph, _disk(server)
    yield
    assert server.services.model.graph is draft
    # Whoever hung up is noticed a moment later.
    deadline_s = time.monotonic() + WAIT_S
    while (after := _disk(server)) != before and time.monotonic() < deadline_s:
        threading.Event().wait(0.05)
    assert after == before
    assert request.getfixturevalue("editor").http.get("/api/graph").status_code == 200


def _disk(server: ConsoleServer) -> dict[str, str]:
    """Return all files of the console but its database and cache, those beside its folders among them."""
    everything = server.services.config.data_folder.parent.rglob("*")
    found = {}
    with contextlib.suppress(FileNotFoundError):
        # The console may be taking away what an attack has left: that is looked at again.
        for path in everything:
            if path.is_file() and not path.name.startswith("console.sqlite3") and path.suffix != ".log":
                found[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def refused(answer: httpx.Response, *statuses: int) -> str:
    """Return the sentence by which a request was refused."""
    assert answer.status_code in statuses, answer.text[:300]
    sentence: str = answer.json()["error"]
    assert sentence.endswith(".")
    assert len(sentence) <= 1000
    return sentence


# ------------------------------------------------------------------------------------------------- as HTTP has it
def raw(person: Person, path: str, head: str, body: bytes = b"") -> int | None:
    """Send a request as it stands, and no more; return the status of the answer, None where there is none."""
    address = urlsplit(person.url)
    cookies = "; ".join(f"{name}={value}" for name, value in person.http.cookies.items())
    with socket.create_connection((address.hostname, address.port), timeout=WAIT_S) as plain:
        lines = f"POST {path} HTTP/1.1\r\nHost: {address.netloc}\r\nOrigin: {person.url}\r\nCookie: {cookies}\r\n"
        plain.sendall(f"{lines}{head}\r\n".encode() + body)
        plain.shutdown(socket.SHUT_WR)
        answer = plain.recv(4096)
    return int(answer.split(b" ", 2)[1]) if answer.startswith(b"HTTP/") else None


CHUNKED = "Transfer-Encoding: chunked\r\n"
JSON = "Content-Type: application/json\r\n"
BODIES = {
    "more is promised": ("Content-Length: 5000\r\n", EMPTY_GRAPH),
    "less than nothing": ("Content-Length: -1\r\n", EMPTY_GRAPH),
    "two lengths": ("Content-Length: 4\r\nContent-Length: 42\r\n", EMPTY_GRAPH),
    "beyond any disk": (f"Content-Length: {'9' * 26}\r\n", EMPTY_GRAPH),
    "digits of another script": ("Content-Length: ٣\r\n", EMPTY_GRAPH),
    "hexadecimal": ("Content-Length: 0x10\r\n", EMPTY_GRAPH),
    "an endless chunk": (CHUNKED, b"ffffffffffffffff\r\n" + EMPTY_GRAPH),
    "a chunk of less than nothing": (CHUNKED, b"-2\r\nab\r\n0\r\n\r\n"),
    "a chunk that breaks off": (CHUNKED, b'4\r\n{"ty'),
    "a chunk with a long remark": (CHUNKED, b"2;" + b"x" * 70_000 + b"\r\n{}\r\n0\r\n\r\n"),
    "chunks and a length": (f"{CHUNKED}Content-Length: 2\r\n", b"2\r\n{}\r\n0\r\n\r\nGET /x HTTP/1.1\r\n\r\n"),
    "two encodings": ("Transfer-Encoding: gzip, chunked\r\n", b"2\r\n{}\r\n0\r\n\r\n"),
    "packed": ("Content-Encoding: gzip\r\nContent-Length: 2\r\n", b"\x1f\x8b"),
}


@pytest.mark.parametrize("path", [GRAPH, SITE])
@pytest.mark.parametrize("what", BODIES)
def test_a_body_that_lies_about_its_length_is_none(editor: Person, path: str, what: str) -> None:
    status = raw(editor, path, *BODIES[what])
    assert status is None or 400 <= status < 500


@pytest.mark.parametrize("path", [GRAPH, SITE])
def test_a_body_without_a_length_is_taken_no_further_than_it_may_be(editor: Person, path: str) -> None:
    pieces = (b"PK\x03\x04" + bytes((1 << 20) - 4) for _ in range((MAX_GRAPH_FILE_BYTES >> 20) + 4))
    refused(editor.http.post(path, content=pieces), 400, 413)


@pytest.mark.parametrize("path", ["/api/users", "/api/settings/presets", "/api/edits"])
def test_a_body_in_chunks_is_too_large_where_it_is_whoever_reads_it(editor: Person, path: str) -> None:
    for length, status in ((MAX_BODY_BYTES, 400), (MAX_BODY_BYTES + 1, 413)):
        assert raw(editor, path, JSON + CHUNKED, in_chunks(b"x" * length)) == status


def in_chunks(body: bytes) -> bytes:
    pieces = (body[at : at + 50_000] for at in range(0, len(body), 50_000))
    return b"".join(b"%x\r\n%b\r\n" % (len(piece), piece) for piece in pieces) + b"0\r\n\r\n"


# --------------------------------------------------------------------------------------------------------- sites
def zipped(members: dict[str, bytes], edit: Callable[[zipfile.ZipInfo], None] = lambda _: None) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in members.items():
            info = zipfile.ZipInfo("x", (1980, 1, 1, 0, 0, 0))
            info.filename, info.compress_type = name, zipfile.ZIP_DEFLATED
            edit(info)
            archive.writestr(info, content)
    return out.getvalue()


def members_of(archive: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(archive)) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


def claiming(data: bytes, name: str, size_bytes: int) -> bytes:
    """Return a zip file in which a member claims to be of another size, wherever that stands."""
    changed = bytearray(data)
    for sign, at_size, at_name in ((b"PK\x03\x04", 22, 30), (b"PK\x01\x02", 24, 46)):
        place = data.find(sign)
        while place >= 0:
            if data[place + at_name :].startswith(name.encode()):
                struct.pack_into("<I", changed, place + at_size, size_bytes)
            place = data.find(sign, place + 4)
    return bytes(changed)


def overlapping(data: bytes, count: int) -> bytes:
    """Return a zip file whose list names one packed member many times."""
    with zipfile.ZipFile(io.BytesIO(data)) as opened:
        start = opened.start_dir
    directory, end = data[start:-22], bytearray(data[-22:])
    entry = directory[: directory.find(b"PK\x01\x02", 4) if directory.count(b"PK\x01\x02") > 1 else None]
    entries = directory + entry * count
    struct.pack_into("<HHI", end, 8, *([len(entries) // len(entry)] * 2), len(entries))
    return data[:start] + entries + bytes(end)


POINTS = "site/cloud/points_m.npy"
ZEROS = bytes(64 << 20)


def with_first(archive: bytes, name: str) -> bytes:
    return zipped({name: b"x"} | members_of(archive))


def with_zeros(archive: bytes) -> bytes:
    return zipped(members_of(archive) | {POINTS: ZEROS})


def with_a_link(archive: bytes) -> bytes:
    def linked(info: zipfile.ZipInfo) -> None:
        if info.filename == POINTS:
            info.external_attr = 0o120777 << 16

    return zipped(members_of(archive), linked)


SITES: dict[str, Callable[[bytes], bytes]] = {
    "a folder above": lambda archive: with_first(archive, "../evil"),
    "an absolute name": lambda archive: with_first(archive, "/tmp/evil"),
    "a drive": lambda archive: with_first(archive, "C:\\evil"),
    "backslashes": lambda archive: with_first(archive, "site\\..\\..\\evil"),
    "a name that ends early": lambda archive: with_first(archive, "site/evil\0.npy"),
    "a link": with_a_link,
    "a bomb": with_zeros,
    "a bomb that says it is small": lambda archive: claiming(with_zeros(archive), POINTS, 188),
    "one that says it is 4 GB": lambda archive: claiming(archive, POINTS, 0xFFFFFFFE),
    "one packed file under many names": lambda archive: overlapping(archive, 3000),
    "a list of files that is a bomb": lambda archive: zipped({"archive.json": b"[" * len(ZEROS)}),
    "a list nested without end": lambda archive: zipped({"archive.json": b'{"files":' * 100_000}),
    "two archives": lambda archive: archive + archive,
    "something before it": lambda archive: b"#!/bin/sh\n" + archive,
    "a comment behind it": lambda archive: archive[:-2] + b"\x04\x00rm -",
}


@pytest.mark.parametrize("what", SITES)
def test_an_archive_that_does_harm_is_refused(editor: Person, archive: bytes, what: str) -> None:
    assert "site archive" in refused(editor.http.post(SITE, content=SITES[what](archive)), 400)


# ---------------------------------------------------------------------------------------------------- recordings
def test_a_recording_is_named_by_a_checksum_and_nothing_else(sender: Sender) -> None:
    for name in (
        "../../../etc/passwd",
        "0" * 63,
        "0" * 64 + "/..",
        "G" * 64,
        "0" * 64,
        "%2e%2e%2fevil",
        "0" * 64 + "%00",
    ):
        answer = sender.http.put(f"{OFFERS_PATH}/{name}?offset=0", content=b"evil")
        assert 400 <= answer.status_code < 500, name
    for offset in ("-1", "9" * 30, "9" * 5000, "1e3", "NaN", "", "0x0"):
        answer = sender.http.put(f"{OFFERS_PATH}/{'0' * 64}?offset={offset}", content=b"evil")
        assert 400 <= answer.status_code < 500, offset


@pytest.mark.parametrize(
    "body",
    [
        b"", b"[" * 500, b"\xff\xfe", b'{"kind":"walk"}' * 2, b'{"kind":"walk","name":"x","size_bytes":1e400}',
        json.dumps({"kind": "walk", "name": "x" * 5000, "size_bytes": 5, "sha256": "0" * 64}).encode(),
        json.dumps({"kind": "walk", "name": "x", "size_bytes": 5, "sha256": "0" * 64 + "\n"}).encode(),
        json.dumps({"kind": "walk", "name": "x", "size_bytes": MAX_RECORDING_BYTES + 1, "sha256": "0" * 64}).encode(),
        json.dumps({"kind": "../x", "name": "x", "size_bytes": 5, "sha256": "0" * 64}).encode(),
    ],
)  # fmt: skip
def test_an_offer_of_nothing_sensible_is_refused(sender: Sender, body: bytes) -> None:
    refused(sender.http.post(OFFERS_PATH, content=body), 400, 413)


def test_no_piece_is_larger_than_pieces_are(sender: Sender) -> None:
    refused(sender.http.put(piece_path("0" * 64, 0), content=bytes(PIECE_BYTES + (1 << 20))), 413)
