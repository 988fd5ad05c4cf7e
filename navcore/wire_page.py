"""The link's page of the docs, made from the message table."""

from __future__ import annotations

from navcore.recording_upload import MAX_RECORDING_BYTES, OFFERS_PATH, PIECE_BYTES
from navcore.wire import MESSAGES, PING_EVERY_S, PROTOCOL_VERSION
from navcore.wire_row import Delivery, Direction, MessageRow

_BEFORE = """# The link between device and console

Made by `make docs` from the table in `navcore/wire.py`; both ends take rate, priority and size limit from it.

The device dials the console (it is behind a router), on one WebSocket, `/device`, with a token of its own. Each frame
is one message in msgpack. Guidance never depends on any of this: without a console the device walks on.
"""
_AFTER = f"""
## Versions

This is protocol {PROTOCOL_VERSION}. *Since* is the version in which a message got its present form. Device and console
speak one version each; of any other greeting only the version is read, so that both ends say which of the two is to be
updated, whatever else has changed. A device that is refused goes on guiding, and asks again once a minute.

## When the link breaks

The device joins again by itself. The pause doubles with each failure, from half a second to half a minute, and lies
somewhere in its upper half, by a seed of the device: a hundred devices do not come back at one instant. A network that
swallows everything without closing anything is found out by pings within twenty seconds. The state of
the link (dialling, joined, waiting, refused, since when, why) is in the device's state folder as `link.json`.

What cannot be read, is larger than the table allows, or comes more often than the table allows over half
a minute, closes the link with a sentence, and it is joined anew; neither side ends, and guidance notices nothing of it.

## Events

An event is written to a SQLite journal on the device in a thread of its own; what waits is one transaction, and is on
the disk (`fsync`) when it ends. Whoever kills the device loses, at most, what was handed over within that write.
Sending begins afterwards; the console stores before it confirms, and knows each event by its number, so a repeated one
is stored once. The journal holds 100 000 events. When it is full the *oldest* go, and in their place stands an event
that says how many are missing; nothing is dropped silently. A journal that is damaged is put aside, said so, and a new
one begun: its events are numbered after those that the console has, and so are those of a journal in memory, where the
disk takes none. What waits on the disk meanwhile is numbered after these in turn; only then may an event come twice:
one that the console had stored, but not confirmed, before the disk was passed over.

A disk that is full, at either end, does not end the link. The device's journal goes on telling what it holds, notes in
memory what is confirmed, and tries every 5 s to store what the disk did not take. The console shows an event that it
cannot store, and confirms it when it has stored it; a device that it knows is taken in all the same. Of very many it
keeps the first alone; once these are stored it ends the link, and the device joins anew and sends the others again.
What was shown before is known by all that it says, and not shown again.

## Clocks

Every {PING_EVERY_S:g} seconds the console asks for the device's clock; ping and answer carry the four times of NTP. The
true offset lies within half of the time on the way, so each answer gives an interval; the narrowest of late is
believed, and is widened as it ages, for clocks drift. Intervals that exclude each other prove that a clock has jumped:
the earlier ones are forgotten. The console dates what it shows by the offset, and tells it to the device. Nothing is
called live before the clocks have been compared, or where the uncertainty could hide that it is old. All clocks on the
link are steady ones: setting the time of either machine changes nothing.

## Maps

A map is offered with its size and the SHA-256 of its package. The device fetches it to its disk, piece by piece, and
goes on where it was after any interruption, its own restart included. Only a package of the right size and checksum is
unpacked; only a site that loads, and is the map that was offered, waits to be taken. It is swapped in as a whole when
nobody is being led and no map is being recorded (never while guiding or paused), and the device then tells which map it
runs. What is damaged, or newer than the device's program, is refused with a sentence, and the old map stays. The map
before is kept beside the site: a device whose map is found damaged at its start goes back to it by itself.

## Recordings

The recording of a map walk goes to the console's machine over HTTP, with the device's token (the forms are in
`navcore/recording_upload.py`). The device offers it with size and SHA-256 (`POST {OFFERS_PATH}`), and is
told which byte is missing next; it puts pieces of {PIECE_BYTES >> 10} KiB
(`PUT {OFFERS_PATH}/SHA256?offset=BYTE`), and is told the same after each. So it goes on after any
interruption, and after `kill -9` of either side, where it was; a piece that does not follow changes nothing. One
recording goes at a time. A piece is only sent while the console is joined and has confirmed every event, and after each
there is a pause as long as the piece took: never more than half of a link is used. The console takes up to
{MAX_RECORDING_BYTES >> 30} GiB, leaves 1 GiB of its disk free, and gives the recording its name in one step when the
checksum fits; what has come damaged is asked for anew. What has not come whole belongs to whoever offered it last, so a
device with a new token goes on with it. A recording that is interrupted again and again lets the next go first. The
recording stays on the device as well. The files of recorded walks go the same way, after the map walks, where the
walker shares them ([recording.md](recording.md)).
"""


def link_markdown() -> str:
    """Return docs/link.md."""
    parts = [_BEFORE]
    for direction in Direction:
        rows = sorted((row for row in MESSAGES.values() if row.direction is direction), key=lambda row: row.priority)
        parts.append(f"\n## {direction.value[0].upper()}{direction.value[1:]}\n\n" + _table(rows))
    fates = [f"- *{delivery.name.lower()}*: {delivery.value}." for delivery in Delivery]
    parts.append("\n## On a slow or broken link\n\n" + "\n".join(fates) + "\n")
    return "".join([*parts, _AFTER])


def _table(rows: list[MessageRow]) -> str:
    lines = ["| message | since | sent | priority | on a slow link | at most | says |", "|---|---|---|---|---|---|---|"]
    lines += [_row(row) for row in rows]
    return "\n".join(lines) + "\n"


def _row(row: MessageRow) -> str:
    rate = f", at most {row.rate_hz:g} Hz" if row.rate_hz is not None else ""
    return (
        f"| `{row.name}` | {row.since_version} | {row.when}{rate} | {row.priority} | {row.delivery.name.lower()} |"
        f" {row.max_bytes >> 10} KiB | {row.meaning} |"
    )
