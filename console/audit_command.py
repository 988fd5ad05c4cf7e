"""``vbr console audit``: who did what, from the command line; and by which name its own deeds stand there."""

from __future__ import annotations

import argparse
import json
import os
import pwd
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from console.store import Store
    from console.tables import AuditRow

_AT_ONCE_COUNT = 1000
OpenStore = Callable[[argparse.Namespace], "Store"]


def add_audit_command(
    below: argparse._SubParsersAction[argparse.ArgumentParser],
    add_places: Callable[[argparse.ArgumentParser], None],
    open_store: OpenStore,
) -> None:
    """Add it; ``add_places`` adds the options that name site and data."""
    audit = below.add_parser("audit", help="list who did what, newest first, as far back as it was written down")
    audit.add_argument("--who", default="", metavar="TEXT", help="only deeds of people whose name holds this")
    audit.add_argument("--action", default="", metavar="TEXT", help="only deeds of this kind, as sign_in_failed")
    audit.add_argument("--json", action="store_true", help="one JSON object a line")
    add_places(audit)
    audit.set_defaults(run=partial(_run_audit, open_store))


def command_line() -> str:
    """Return who stands in the audit log for what the command line does: the system's user, whoever that is."""
    try:
        return f"command line, {pwd.getpwuid(os.getuid()).pw_name}"
    except KeyError:
        return f"command line, user {os.getuid()}"


def _run_audit(open_store: OpenStore, arguments: argparse.Namespace) -> None:
    store = open_store(arguments)
    try:
        for row in _all_deeds(store, arguments.who, arguments.action):
            sys.stdout.write((_as_json(row) if arguments.json else _as_line(row)) + "\n")
    finally:
        store.close()


def _all_deeds(store: Store, who: str, action: str) -> Iterator[AuditRow]:
    before_id = None
    while rows := store.latest_audit(_AT_ONCE_COUNT, before_id=before_id, who=who, action=action):
        yield from rows
        before_id = rows[-1].id


def _as_json(row: AuditRow) -> str:
    return json.dumps({"id": row.id, "at_s": row.at_s, "who": row.who, "action": row.action, "detail": row.detail})


def _as_line(row: AuditRow) -> str:
    when = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(row.at_s))
    line = f"{when}  {row.who}: {row.action.replace('_', ' ')}  {row.detail}".rstrip()
    # Names and reasons are whatever people typed: none of it gives orders to a terminal.
    return "".join(each if each.isprintable() else " " for each in line)
