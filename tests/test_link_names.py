"""The console's name is unknown, has no address, or nobody answers: guidance, the link and the device's end go on."""

from __future__ import annotations

from pathlib import Path

import pytest
from namespace_fixtures import Dial, asked, console, dial, rooms, until
from net_device import LockStepWalk
from network_rooms import CONSOLE_IP, Names, Rooms, why_impossible

NAME = "console.vbr-test.example"
__all__ = ["console", "dial", "rooms"]
pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(why := why_impossible()), reason=why)]


def test_a_name_that_nobody_knows_or_a_name_server_that_is_silent_holds_up_nothing(
    rooms: Rooms, dial: Dial, tmp_path: Path
) -> None:
    resolver = tmp_path / "resolv.conf"
    resolver.write_text(f"nameserver {CONSOLE_IP}\noptions timeout:30 attempts:3\n")
    within = ("unshare", "--mount", "sh", "-c", f'mount --bind {resolver} /etc/resolv.conf && exec "$@"', "sh")
    alone, names = LockStepWalk(), Names(rooms)
    try:
        device = dial(NAME, *within)
        assert asked(device, "walk 50") == alone.walk(50)
        until(lambda: names.asked_count > 0)
        # The link has asked again and again meanwhile; one look-up hangs, and no others behind it.
        until(lambda: asked(device, "open").split()[2] in ("1", "2"))
        device.tell("stop")
        # A resolver hangs for a minute and a half here.
        assert device.ended(30.0) == 0
        names.answers = "denied"
        device = dial(NAME, *within)
        for answers in ("denied", "empty"):
            names.answers, before = answers, names.asked_count
            until(lambda before=before: names.asked_count > before + 2)
            assert asked(device, "link") in ("waiting", "dialling")
        names.answers = "here"
        until(lambda: asked(device, "link") == "joined")
        device.tell("stop")
        assert device.ended() == 0
    finally:
        names.close()
