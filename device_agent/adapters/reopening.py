"""What is unplugged comes back by itself: a source that is opened again whenever it fails.

Every real sensor is read through :class:`Reopening`, and that by a thread of its own
(:mod:`device_agent.adapters.newest`). Nothing here waits: while a source is gone, reading it raises the reason, and now
and then tries to open it.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from device_agent.ports import Clock
from navcore.errors import SensorError

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
LONGEST_BACKOFF_S = 4.0
TOLERATED_S = 0.25
"""What cannot be used is passed over for so long: one picture that comes twice need not stop anybody."""
_MAX_PASSED_OVER = 10
"""And no more than so many: a source that repeats itself may do so without waiting."""
_FIRST_BACKOFF_S = 0.25
_log = logging.getLogger(__name__)


class Source(Protocol[T_co]):
    """Something that is open and can be read: a thin layer over one driver."""

    def read(self) -> T_co:
        """Wait for the next item, a second or so at the most. Raises SensorError, or whatever its driver raises."""
        ...

    def close(self) -> None: ...


def backoff_s(failure_count: int) -> float:
    """Return how long to wait after so many failures in a row (1 or more) before opening again."""
    doublings = min(failure_count - 1, 16)
    return min(_FIRST_BACKOFF_S * 2.0**doublings, LONGEST_BACKOFF_S)


class Reopening(Generic[T]):
    """Reads a source; closes it when it fails, and opens it anew, ever more patiently, until it delivers again."""

    def __init__(
        self,
        name: str,
        opener: Callable[[], Source[T]],
        check: Callable[[T, T | None], None],
        clock: Clock,
        restart_after_s: float = 3.0,
    ) -> None:
        """``opener`` opens the source, or raises.

        Args:
            name: what it is, to begin a sentence with ("The camera").
            opener: opens the source; raises SensorError, or whatever its driver raises.
            check: raises SensorError for an item that cannot be used; it is handed the last good one too.
            clock: the device's clock.
            restart_after_s: a source that delivers, but nothing of use for so long, is opened anew as well.
        """
        self._name = name
        self._opener = opener
        self._check = check
        self._clock = clock
        self._restart_after_s = restart_after_s
        self._source: Source[T] | None = None
        self._last: T | None = None
        self._good_s = clock.now_s()
        self._failure_count = 0
        self._retry_s = clock.now_s()
        self._why = SensorError(f"{name} is closed.")
        self._closed = False

    def open(self) -> Source[T]:
        """Return the open source; open it where it is not. Raises what the opener raises."""
        source = self._source
        if source is None:
            source = self._source = self._opener()
            self._good_s = self._clock.now_s()
        return source

    def read(self) -> T:
        """Return the next item that can be used. Raises SensorError with the reason where there is none."""
        self._refuse_when_closed()
        source = self._opened()
        # It may have been closed from another thread while it was being opened here.
        self._refuse_when_closed()
        passed_over = 0
        while True:
            item = self._next_of(source)
            fault = self._fault_of(source, item)
            if fault is None:
                return item
            passed_over += 1
            if passed_over >= _MAX_PASSED_OVER or self._clock.now_s() - self._good_s > TOLERATED_S:
                raise fault

    def abandon(self) -> None:
        """Leave a source alone whose driver does not return, without closing it, which might hang as well."""
        self._source = None
        self._failed(SensorError(f"{self._name} does not answer: unplug it and plug it in again."))

    def close(self) -> None:
        """Close the source for good; closing twice is harmless."""
        self._closed = True
        source, self._source = self._source, None
        if source is not None:
            _close(source)

    def _next_of(self, source: Source[T]) -> T:
        try:
            item = source.read()
        except Exception as error:
            raise self._given_up(source, error) from error
        if not self._is_current(source):
            # Somebody else has opened it anew while this call hung: what it gives now is too late.
            _close(source)
            raise SensorError(f"{self._name} did not answer.")
        return item

    def _fault_of(self, source: Source[T], item: T) -> SensorError | None:
        """Return why an item cannot be used, None where it can; give up a source that has given none for too long."""
        now_s = self._clock.now_s()
        try:
            self._check(item, self._last)
        except SensorError as error:
            return self._given_up(source, error) if now_s - self._good_s > self._restart_after_s else error
        self._last, self._good_s, self._failure_count = item, now_s, 0
        return None

    def _is_current(self, source: Source[T]) -> bool:
        return source is self._source

    def _refuse_when_closed(self) -> None:
        if self._closed:
            self.close()
            raise SensorError(f"{self._name} is closed: start the device again.")

    def _opened(self) -> Source[T]:
        if self._source is not None:
            return self._source
        if self._clock.now_s() < self._retry_s:
            raise self._why
        try:
            return self.open()
        except Exception as error:
            raise self._failed(error) from error

    def _given_up(self, source: Source[T], error: Exception) -> SensorError:
        if self._is_current(source):
            self._source = None
            failure = self._failed(error)
        else:
            failure = SensorError(f"{self._name} did not answer.")
        _close(source)
        return failure

    def _failed(self, error: Exception) -> SensorError:
        """Take note of a failure; return it as what the reader shall raise."""
        self._failure_count += 1
        self._retry_s = self._clock.now_s() + backoff_s(self._failure_count)
        self._why = (
            error
            if isinstance(error, SensorError)
            else SensorError(f"{self._name} failed ({type(error).__name__}: {error}): check its cable.")
        )
        if self._failure_count == 1:
            _log.warning("%s", self._why)
        return self._why


def _close(source: Source[object]) -> None:
    # A driver whose device is gone may raise anything; there is nothing left to be done about it.
    with contextlib.suppress(Exception):
        source.close()
