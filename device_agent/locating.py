"""How the loop comes by its pose: in line, or from a thread of its own for which it waits no longer than a deadline.

::

    cycle       1            2              3           4
    loop        gives A      A is late      takes A     takes C
                waits        waits for      gives C     in time
                             nothing        waits
    localizer   |--- A ------------------|  |-- C --|

One frame at a time is worked on, and it is always the newest one that is given: those that come meanwhile are never
located, so nothing waits in a queue. A pose that is not there in time comes with a later cycle, as the pose of its own
frame; until then the loop goes on with the depth image of the present one. What came when is the loop's to note.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from device_agent.ports import LocalizerPort
from navcore.settings import Settings
from navcore.types import Frame, Localization

WaitFor = Callable[[threading.Condition, Callable[[], bool], float], object]
"""Waits on a condition, which is held, until something is true, or for so many seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What a cycle asks for."""

    frame: Frame
    feature_fraction: float | None
    """Share (0, 1] of the frame's features that is used; None leaves the frame out."""
    rests: bool
    """The frame is left out as well where the pose of an earlier one comes only now."""
    wait_s: float
    """How long the frame's pose is waited for; where time does not count, it is waited for in any case."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a cycle gets: poses that the localizer has found."""

    own: Localization | None = None
    """That of the cycle's frame; None where it was left out, or is not there in time."""
    late: Localization | None = None
    """That of an earlier frame, which has come since; it is given once."""


class Locator(Protocol):
    """Asks a localizer on behalf of the loop, from the loop's thread alone."""

    def locate(self, request: Request) -> Answer:
        """Return what there is. Raises what the localizer has raised, once, also of an earlier frame."""
        ...

    def apply(self, settings: Settings) -> None:
        """Run other settings from the next frame on."""
        ...

    def close(self) -> None:
        """Nothing is asked any more. Whatever hangs is not waited for."""
        ...


class DirectLocator(Locator, Protocol):
    """Asks a localizer itself, not through others that note what is asked."""

    @property
    def working_since_s(self) -> float | None:
        """Stamp of the frame that is being located beside the loop; None where none is."""
        ...


class InLine:
    """Waits for each pose: where time stands still meanwhile, or does not count."""

    working_since_s: float | None = None

    def __init__(self, localizer: LocalizerPort) -> None:
        self._localizer = localizer

    def locate(self, request: Request) -> Answer:
        """Return the pose of the frame, unless it is left out."""
        if request.feature_fraction is None:
            return Answer()
        self._localizer.use_features(request.feature_fraction)
        return Answer(self._localizer.locate(request.frame))

    def apply(self, settings: Settings) -> None:
        """Run other settings from the next frame on."""
        self._localizer.apply(settings)

    def close(self) -> None:
        """Nothing runs beside the loop."""


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """What the thread is to do next."""

    frame: Frame
    feature_fraction: float
    settings: Settings | None
    """What is to run from this frame on, where it is not what ran before."""


def _in_real_time(changed: threading.Condition, is_true: Callable[[], bool], timeout_s: float) -> object:
    return changed.wait_for(is_true, timeout_s)


class Beside:
    """Locates in a thread of its own: a localizer that is slow, or hangs, does not hold up who is being led."""

    def __init__(self, localizer: LocalizerPort, wait_for: WaitFor = _in_real_time) -> None:
        """``wait_for`` decides how long a deadline is: a test says itself when it has passed."""
        self._localizer, self._wait_for = localizer, wait_for
        self._changed = threading.Condition()
        self._work: _Work | None = None
        self._busy_since_s: float | None = None
        self._result: Localization | Exception | None = None
        self._settings: Settings | None = None
        self._closed = False
        threading.Thread(target=self._run, name="localizer", daemon=True).start()

    @property
    def working_since_s(self) -> float | None:
        """Stamp of the frame that is being located; a thread that has died works on it for ever."""
        return self._busy_since_s

    def locate(self, request: Request) -> Answer:
        """Return what has come since, and the frame's own pose where it comes in time."""
        with self._changed:
            late = self._taken()
            left_out = late is not None and request.rests
            if self._busy_since_s is not None or left_out or request.feature_fraction is None:
                return Answer(late=late)
            self._work = _Work(request.frame, request.feature_fraction, self._settings)
            self._settings, self._busy_since_s = None, request.frame.stamp_s
            self._changed.notify_all()
            self._wait_for(self._changed, lambda: self._result is not None, request.wait_s)
            return Answer(self._taken(), late)

    def apply(self, settings: Settings) -> None:
        """Run other settings from the next frame on that is given."""
        self._settings = settings

    def close(self) -> None:
        """End the thread when it has done what it does."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _taken(self) -> Localization | None:
        """Return what has been found, once; None where nothing has. Raises what the localizer has raised."""
        result, self._result = self._result, None
        if result is None:
            return None
        self._busy_since_s = None
        if isinstance(result, Exception):
            raise result
        return result

    def _run(self) -> None:
        while (work := self._next()) is not None:
            result = self._done(work)
            with self._changed:
                self._result = result
                self._changed.notify_all()

    def _next(self) -> _Work | None:
        with self._changed:
            self._changed.wait_for(lambda: self._work is not None or self._closed)
            work, self._work = self._work, None
            return None if self._closed else work

    def _done(self, work: _Work) -> Localization | Exception:
        try:
            if work.settings is not None:
                self._localizer.apply(work.settings)
            self._localizer.use_features(work.feature_fraction)
            return self._localizer.locate(work.frame)
        except Exception as error:
            return error
