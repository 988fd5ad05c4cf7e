"""Newest wins: a source is read by a thread of its own; neither a slow loop nor a slow driver holds the other up."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from device_agent.adapters.reopening import Source
from device_agent.ports import Clock
from navcore.errors import SensorError

T = TypeVar("T")
HANGS_AFTER_S = 15.0
"""A driver that has not returned for so long will not: OpenCV's waits 10 s for a camera."""
MAX_ABANDONED = 4
"""Threads that may be left behind in a driver at a time; after so many only a restart of the device helps."""
CLOSED_WITHIN_S = 3.0
"""Drivers look up from waiting for their device once in a second."""
_RETRY_AFTER_S = 0.2


class NewestReader(Generic[T]):
    """Reads a source again and again; keeps the newest item, and the newest error.

    A driver that hangs holds up only the thread here; where it hangs for good, it is left behind with its thread, and
    ``abandon`` lets the source be opened anew.
    """

    def __init__(
        self, name: str, source: Source[T], clock: Clock, abandon: Callable[[], None] | None = None, keep: int = 1
    ) -> None:
        """``keep`` is the number of newest items for :meth:`recent`; ``name`` names the thread."""
        self._name = name
        self._source = source
        self._clock = clock
        self._abandon = abandon
        self._arrived = threading.Condition()
        self._recent: deque[T] = deque(maxlen=keep)
        self._is_new = False
        self._error: SensorError | None = None
        self._closed = threading.Event()
        self._called_s = clock.now_s()
        self._left_behind: list[threading.Thread] = []
        self._thread = self._started()

    def wait(self, timeout_s: float) -> T | None:
        """Return the newest item that was not given yet, None when none has come in time.

        Raises SensorError where the source has failed since, and has given nothing newer.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: self._is_new or self._error or self._closed.is_set(), timeout_s)
            self._refuse_when_closed()
            is_new, self._is_new = self._is_new, False
            error, self._error = self._error, None
            if is_new:
                return self._recent[-1]
        if error is not None:
            raise error
        self._replace_hanging_thread()
        return None

    def recent(self) -> tuple[T, ...]:
        """Return the newest items, oldest first, without waiting. Raises SensorError where the source has failed."""
        with self._arrived:
            self._refuse_when_closed()
            recent, error = tuple(self._recent), self._error
        if error is not None:
            raise error
        self._replace_hanging_thread()
        return recent

    def close(self) -> None:
        """Let the thread close the source and end; one that hangs in its driver is not waited for."""
        self._closed.set()
        with self._arrived:
            self._arrived.notify_all()
        self._thread.join(CLOSED_WITHIN_S)

    def _refuse_when_closed(self) -> None:
        if self._closed.is_set():
            raise SensorError(f"The {self._name} is closed: start the device again.")

    def _started(self) -> threading.Thread:
        self._called_s = self._clock.now_s()
        thread = threading.Thread(target=self._fetch, name=self._name, daemon=True)
        self._thread = thread
        thread.start()
        return thread

    def _replace_hanging_thread(self) -> None:
        hangs = self._clock.now_s() - self._called_s > HANGS_AFTER_S
        if not hangs or self._abandon is None or self._closed.is_set():
            return
        self._left_behind = [thread for thread in self._left_behind if thread.is_alive()]
        if len(self._left_behind) < MAX_ABANDONED:
            self._left_behind.append(self._thread)
            self._abandon()
            self._started()

    def _fetch(self) -> None:
        me = threading.current_thread()
        while not self._closed.is_set() and me is self._thread:
            self._called_s = self._clock.now_s()
            try:
                item = self._source.read()
            except SensorError as error:
                self._leave(me, None, error)
            except Exception as error:
                self._leave(
                    me,
                    None,
                    SensorError(f"The {self._name} failed ({type(error).__name__}: {error}): check its cable."),
                )
            else:
                self._leave(me, item, None)
                continue
            self._closed.wait(_RETRY_AFTER_S)
        if me is self._thread:
            # Here, and not in whoever closes: SDKs crash that are closed by one thread while another reads.
            self._source.close()

    def _leave(self, me: threading.Thread, item: T | None, error: SensorError | None) -> None:
        with self._arrived:
            if me is not self._thread:
                # This thread was given up; another one reads by now.
                return
            if item is not None:
                self._recent.append(item)
                self._is_new, self._error = True, None
            else:
                self._error = error
            self._arrived.notify_all()
