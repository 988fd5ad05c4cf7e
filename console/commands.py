"""``vbr console``: serve the console of a site; make device tokens; let an admin in who has no way in.

``vbr alerts``: what it alerts people to.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from console.audit_command import add_audit_command, command_line
from console.backup_commands import add_backup_commands, data_folder_of
from console.config import ConsoleConfig
from navcore.errors import InputError

if TYPE_CHECKING:
    from console.device_store import DeviceStore
    from console.server import Ready
    from console.store import Store

DEFAULT_PORT = 8765
_ENDS = "The link of a device that is signed in with it ends within seconds."


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr console`` and what stands below it."""
    parser = subparsers.add_parser(
        "console", help="serve the map editor, monitor and settings of a site in the browser"
    )
    _add_places(parser, None)
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument("--port", type=_port, default=DEFAULT_PORT, help="port; 0 takes any free one")
    parser.add_argument("--tls-cert", type=Path, metavar="FILE", help="certificate chain (PEM), for other machines")
    parser.add_argument("--tls-key", type=Path, metavar="FILE", help="its private key (PEM)")
    parser.add_argument("--insecure-listen", action="store_true", help="listen beyond this machine without TLS")
    parser.add_argument(
        "--public-host", action="append", default=[], metavar="NAME", help="host name of a proxy in front"
    )
    parser.add_argument(
        "--device-token-file",
        type=Path,
        metavar="FILE",
        help="let in the device with this token; made where missing; one that was taken back stays so",
    )
    parser.add_argument(
        "--ready-file", type=Path, metavar="FILE", help="write address and one-time link as JSON once it serves"
    )
    parser.set_defaults(run=run_console)
    below = parser.add_subparsers(metavar="COMMAND", required=False)
    _add_token_command(below)
    add_audit_command(below, partial(_add_places, default=argparse.SUPPRESS), _open_store)
    add_backup_commands(below, partial(_add_places, default=argparse.SUPPRESS))
    link = below.add_parser("admin-link", help="print a one-time link that makes one more admin")
    _add_places(link, argparse.SUPPRESS)
    link.set_defaults(run=run_admin_link)
    alerts = subparsers.add_parser("alerts", help="list the alerts that the console raises, with their limits")
    alerts.add_argument("--markdown", action="store_true", help="as the page of the docs")
    alerts.set_defaults(run=run_alerts)


def _add_token_command(below: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    token = below.add_parser(
        "token",
        help="make the token that a device signs in with, list the tokens, or take one back",
        description="Print a new token for a device. Each device has one: a new one takes the place of an earlier one,"
        " and says so.",
    )
    token.add_argument("name", nargs="?", help="name of the device")
    what = token.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="list the devices that have a token, and when they were seen")
    what.add_argument("--revoke", action="store_true", help="the device's token is void from now on")
    _add_places(token, argparse.SUPPRESS)
    token.set_defaults(run=run_token)


def _add_places(parser: argparse.ArgumentParser, default: str | None) -> None:
    parser.add_argument("--site", type=Path, metavar="DIR", default=default, help="the site's folder")
    parser.add_argument(
        "--data", type=Path, metavar="DIR", default=default, help="folder of the database (default: SITE.console)"
    )


def run_console(arguments: argparse.Namespace) -> None:
    """Serve until Ctrl-C."""
    from console.server import ConsoleServer

    if arguments.site is None:
        raise InputError("Which site? Name its folder with --site DIR; `vbr map build` makes one.")
    _refuse_unwritable(arguments.ready_file)
    server = ConsoleServer(config_of(arguments), device_token_file=arguments.device_token_file)

    def say(ready: Ready) -> None:
        if arguments.ready_file is not None:
            ready.write(arguments.ready_file)
        sys.stdout.write(f"The console of {server.services.model.site.name} is at {ready.url}\n")
        if ready.first_link is not None:
            sys.stdout.write(f"Nobody has an account yet. Choose name and password here, once:\n  {ready.first_link}\n")
        sys.stdout.write("Ctrl-C ends it.\n")
        if ready.warning is not None:
            sys.stderr.write(f"vbr: {ready.warning}\n")
        sys.stdout.flush()

    server.run(say)


def _refuse_unwritable(path: Path | None) -> None:
    if path is not None and (path.is_dir() or not os.access(path.parent, os.W_OK)):
        raise InputError(f"The ready file {path} cannot be written: name a file in a folder that is there.")


def run_token(arguments: argparse.Namespace) -> None:
    """Print a new device token, list those there are, or revoke one."""
    from console.device_store import DeviceStore

    if not arguments.list and arguments.name is None:
        raise InputError("Which device? Give its name, as in `vbr console token glasses`, or list them with --list.")
    store = _open_store(arguments)
    devices = DeviceStore(store)
    try:
        if arguments.list:
            _list_tokens(devices)
        elif arguments.revoke:
            before_s = devices.revoke_token(arguments.name, command_line())
            sys.stdout.write(
                f"The token of {arguments.name} is void. {_ENDS}\n"
                if before_s is None
                else f"The token of {arguments.name} was revoked already on {_date(before_s)}, and stays void.\n"
            )
        else:
            _make_token(devices, arguments.name)
    finally:
        store.close()


def _make_token(devices: DeviceStore, name: str) -> None:
    before = devices.valid_token(name)
    sys.stdout.write(devices.create_token(name, command_line()) + "\n")
    if before is not None:
        # On stderr, for the token itself goes into a file.
        sys.stderr.write(
            f"It takes the place of the token of {before.name} that was made on {_date(before.created_at_s)} by"
            f" {before.created_by} (last signed in: {_date(before.last_seen_at_s)}): that one is void, so give the"
            f" device this one. {_ENDS}\n"
        )


def _list_tokens(devices: DeviceStore) -> None:
    tokens = devices.tokens()
    if not tokens:
        sys.stdout.write("No device has a token yet: make one with `vbr console token NAME`.\n")
    for token in tokens:
        state = "revoked" if token.revoked else "valid"
        sys.stdout.write(
            f"{token.name}: {state}, made by {token.created_by} on {_date(token.created_at_s)}, last signed in:"
            f" {_date(token.last_seen_at_s)}\n"
        )


def _date(stamp_s: float | None) -> str:
    return "never" if stamp_s is None else time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(stamp_s))


def run_admin_link(arguments: argparse.Namespace) -> None:
    """Print the path of a one-time link."""
    from console.accounts import Accounts

    store = _open_store(arguments)
    try:
        token = Accounts(store, store.wall_s).new_admin_link_token(command_line())
    finally:
        store.close()
    sys.stdout.write(f"Open this on the console, within 48 hours:\n  /first?token={token}\n")


def run_alerts(arguments: argparse.Namespace) -> None:
    """Print the table of rules."""
    from console.alerts.page import alerts_markdown
    from console.alerts.rules import RULES

    if arguments.markdown:
        sys.stdout.write(alerts_markdown())
        return
    for rule in RULES.values():
        limits = ", or ".join(f"{q.name} {q.side} {q.raise_at:g} {q.unit}" for q in rule.quantities)
        sys.stdout.write(f"{rule.title} ({rule.priority.word}): {rule.when_words}{limits and ': ' + limits}\n")


def config_of(arguments: argparse.Namespace) -> ConsoleConfig:
    """Return the configuration that the command line asks for."""
    return ConsoleConfig(
        site_folder=arguments.site,
        data_folder=data_folder_of(arguments),
        host=arguments.host,
        port=arguments.port,
        tls_certificate=arguments.tls_cert,
        tls_key=arguments.tls_key,
        insecure_listen=arguments.insecure_listen,
        public_hosts=frozenset(name.lower() for name in arguments.public_host),
    )


def _open_store(arguments: argparse.Namespace) -> Store:
    from console.folder_restore import finish_restore
    from console.store import Store
    from navcore.site import map_checksum

    finish_restore(data_folder_of(arguments))
    if arguments.data is None and arguments.site is not None:
        # A mistyped site must not get a database of its own.
        map_checksum(arguments.site)
    return Store.open(data_folder_of(arguments))


def _port(text: str) -> int:
    if not text.isdecimal() or len(text) > 5 or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is no port: give a number from 0 to 65535")
    return int(text)
