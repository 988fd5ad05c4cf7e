"""The event loop of the link, whose look-ups of names hold up nothing: neither other work nor the device's end.

A resolver that does not answer holds its thread for half a minute, and nobody can end that. In the loop's own executor
such threads would take the places of other work, and Python would wait for them when the device is to end. Here each
has a thread of its own that nobody waits for, and who asks for the same name meanwhile waits for the same answer.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from typing import Any

_Answer = list[tuple[Any, ...]]
_Question = tuple[Any, ...]


class LinkLoop(asyncio.SelectorEventLoop):
    """An event loop as any other, but for the look-ups."""

    def __init__(self) -> None:
        super().__init__()
        self._asked: dict[_Question, asyncio.Future[_Answer]] = {}

    async def getaddrinfo(
        self,
        host: bytes | str | None,
        port: bytes | str | int | None,
        *,
        family: int = 0,
        type: int = 0,
        proto: int = 0,
        flags: int = 0,
    ) -> _Answer:
        """Return the addresses of a name, as :func:`socket.getaddrinfo` does. Raises OSError."""
        question = (host, port, family, type, proto, flags)
        answer = self._asked.get(question)
        if answer is None:
            answer = self.create_future()
            self._begin(question, answer)
            # Only once somebody is on it: it is settled here, and not before this returns to the loop.
            self._asked[question] = answer
        # Who gives up waiting takes the answer from nobody else.
        return await asyncio.shield(answer)

    def _begin(self, question: _Question, answer: asyncio.Future[_Answer]) -> None:
        try:
            threading.Thread(target=self._look_up, args=(question, answer), name="look-up", daemon=True).start()
        except RuntimeError as error:
            # No memory, or too many threads: the link tries again, as with a network that is away.
            raise socket.gaierror(socket.EAI_AGAIN, f"No name can be looked up: {error}") from error

    def _look_up(self, question: _Question, answer: asyncio.Future[_Answer]) -> None:
        found: _Answer | OSError
        try:
            found = socket.getaddrinfo(*question)
        except OSError as error:
            found = error
        except Exception as error:
            # A name that no resolver takes, as one with an empty label.
            found = socket.gaierror(socket.EAI_NONAME, str(error))
        with contextlib.suppress(RuntimeError):
            # The loop is closed where the link was stopped meanwhile.
            self.call_soon_threadsafe(self._settle, question, answer, found)

    def _settle(self, question: _Question, answer: asyncio.Future[_Answer], found: _Answer | OSError) -> None:
        del self._asked[question]
        if isinstance(found, OSError):
            answer.set_exception(found)
            # Where nobody waits any more, nobody has to hear of it.
            answer.exception()
        else:
            answer.set_result(found)
