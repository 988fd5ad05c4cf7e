"""The link's own look-ups of names, where threads run out."""

from __future__ import annotations

import asyncio
import socket
import threading

import pytest

from device_agent.link_loop import LinkLoop

LOOPBACK = "127.0.0.1"


def test_a_look_up_without_a_thread_fails_and_the_same_name_is_found_once_there_are_threads_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A name that once could not be asked for would else never be asked for again: no link until a restart."""

    def no_more(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    async def ask() -> None:
        with monkeypatch.context() as patched:
            patched.setattr(threading.Thread, "start", no_more)
            for _ in range(2):
                with pytest.raises(OSError, match="can't start new thread"):
                    await asyncio.wait_for(loop.getaddrinfo(LOOPBACK, 80, type=socket.SOCK_STREAM), 10.0)
        found = await asyncio.wait_for(loop.getaddrinfo(LOOPBACK, 80, type=socket.SOCK_STREAM), 10.0)
        assert found[0][4] == (LOOPBACK, 80)

    loop = LinkLoop()
    try:
        loop.run_until_complete(ask())
    finally:
        loop.close()
