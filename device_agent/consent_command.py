"""``vbr consent``: what the walker shares with the console, and who has looked; also while the device runs."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

from device_agent.device_store import DeviceStore
from device_agent.sharing import NOTHING_SHARED, Consent
from device_agent.state_folder import add_state_options, state_folder_of
from navcore.cues.privacy_words import accesses_text
from navcore.errors import InputError

_YES_NO = ("yes", "no")


def add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``vbr consent``."""
    parser = subparsers.add_parser("consent", help="what the walker shares with the console, and who has looked")
    add_state_options(parser)
    parser.add_argument("--silhouettes", choices=_YES_NO, help="whether the console gets depth pictures")
    parser.add_argument("--walks", choices=_YES_NO, help="whether the console gets recordings of walks")
    parser.set_defaults(run=_run)


def _kept(store: DeviceStore) -> Consent:
    try:
        return store.load_consent()
    except InputError:
        # Whatever is not said anew is not shared.
        return NOTHING_SHARED


def _run(arguments: argparse.Namespace) -> int:
    store = DeviceStore(state_folder_of(arguments), Path())
    wanted = {
        name: value == "yes" for name in ("silhouettes", "walks") if (value := getattr(arguments, name)) is not None
    }
    consent = _kept(store)
    if wanted:
        try:
            consent = store.change_consent(lambda kept: replace(kept, **wanted, version=kept.version + 1))
        except OSError as error:
            raise InputError(f"What is shared cannot be kept in {store.state_folder} ({error.strerror}).") from error
    sys.stdout.write(
        f"Depth pictures to the console:      {_YES_NO[not consent.silhouettes]}\n"
        f"Recordings of walks to the console: {_YES_NO[not consent.walks]}\n"
        "Colour pictures:                    only when the walker allows them, for one minute\n"
    )
    told = store.load_accesses(time.time())
    if told is not None:
        sys.stdout.write(accesses_text(told.entries, told.now_s, told.utc_offset_s, "en") + "\n")
    return 0
