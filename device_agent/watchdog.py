"""The watchdog: no guidance, stale guidance or a failed loop is the cue *Stop*.

It stands outside the loop and does not trust it: it has a thread of its own, reads the clock itself, and speaks
directly to the output. :func:`keep_watch` is its whole logic, a pure function; a lock-step driver calls
:meth:`Watchdog.check` instead of running the thread.
"""

from __future__ import annotations

import enum
import logging
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

from device_agent.ports import Clock, CueOutput
from navcore.cues.synthesis import stop_cue
from navcore.cues.table import Cue
from navcore.cues.texts import Language
from navcore.types import Reason
from navcore.wire import GUIDANCE_IS_FRESH

REPEAT_AFTER_S = 2.0
"""Time between two cues *Stop* of one incident."""
CHECK_EVERY_S = 0.05
CLOCKS_DIFFER_S = 0.1
"""So far a sensor's clock may be ahead of the device's."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """What the loop last said of itself."""

    stamp_s: float
    """Capture time of the frame behind the last guidance."""
    leading: bool = False
    """Somebody walks by this guidance, so that its absence must be heard."""
    timeout_s: float = 0.5
    """Age at which guidance is stale."""
    fault: str = ""
    """What was raised in the loop; empty while all is well."""


@dataclass(frozen=True, slots=True)
class Vigil:
    """What the watchdog remembers between two looks."""

    alarmed: bool = False
    last_stop_s: float = 0.0


class Verdict(enum.Enum):
    """What a look at the heartbeat results in."""

    QUIET = "quiet"
    ALARM = "alarm"
    """A new incident: *Stop* now."""
    REPEAT = "repeat"
    """The incident lasts: *Stop* again."""
    RECOVERED = "recovered"


def is_fresh(stamp_s: float, now_s: float, timeout_s: float) -> bool:
    """Return whether a stamp is recent; one that is no number, or of the future, would otherwise be so for ever."""
    return -CLOCKS_DIFFER_S <= now_s - stamp_s <= timeout_s


def keep_watch(vigil: Vigil, heartbeat: Heartbeat, now_s: float) -> tuple[Vigil, Verdict]:
    """Look at the heartbeat once; return what to remember, and what to do."""
    stale = bool(heartbeat.fault) or not is_fresh(heartbeat.stamp_s, now_s, heartbeat.timeout_s)
    if not stale:
        return Vigil(), Verdict.RECOVERED if vigil.alarmed else Verdict.QUIET
    if not vigil.alarmed:
        return Vigil(True, now_s), Verdict.ALARM
    if now_s - vigil.last_stop_s >= REPEAT_AFTER_S:
        return replace(vigil, last_stop_s=now_s), Verdict.REPEAT
    return vigil, Verdict.QUIET


class Watchdog:
    """Applies :func:`keep_watch` to the loop's heartbeat and plays *Stop* while somebody is being led."""

    def __init__(
        self,
        clock: Clock,
        output: CueOutput,
        report: Callable[[float, str], None],
        language: Callable[[], Language] = lambda: "en",
    ) -> None:
        """``report(stamp_s, text)`` hears of every incident, and of its end."""
        self._clock = clock
        self._output = output
        self._report = report
        self._language = language
        self._heartbeat = Heartbeat(clock.now_s())
        self._vigil = Vigil()
        self._stop_count = 0
        self._stale_s = -math.inf
        self._lock = threading.Lock()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def stop_count(self) -> int:
        """How often *Stop* was played; the loop sees by it that its own instructions were overruled."""
        return self._stop_count

    @property
    def alarmed(self) -> bool:
        """Whether guidance is stale or has failed, as of the last look."""
        return self._vigil.alarmed

    @property
    def stale_s(self) -> float:
        """When guidance was last found stale or failed; the loop lets nobody walk again too soon after it."""
        return self._stale_s

    def beat(self, heartbeat: Heartbeat) -> None:
        """Take the loop's sign of life."""
        self._heartbeat = heartbeat

    def fault(self, what: str) -> None:
        """Take note that the loop raised something, and act at once."""
        self._heartbeat = replace(self._heartbeat, fault=what)
        self.check()

    def check(self) -> Verdict:
        """Look once, and play *Stop* where it is due."""
        with self._lock:
            now_s, heartbeat = self._clock.now_s(), self._heartbeat
            # What will be stale at the next look is told of now: "within half a second" holds for what is heard.
            early = replace(heartbeat, timeout_s=heartbeat.timeout_s - CHECK_EVERY_S)
            self._vigil, verdict = keep_watch(self._vigil, early, now_s)
            if self._vigil.alarmed:
                self._stale_s = now_s
        if verdict in (Verdict.ALARM, Verdict.REPEAT) and heartbeat.leading:
            reason = Reason.OK if heartbeat.fault else Reason.SENSOR_STALE
            self._play(stop_cue(now_s, reason, self._language()))
        if verdict is Verdict.ALARM:
            text = heartbeat.fault or f"No guidance for {now_s - heartbeat.stamp_s:.1f} s."
            _log.warning("%s", text)
            self._tell(now_s, text)
        elif verdict is Verdict.RECOVERED:
            self._tell(now_s, GUIDANCE_IS_FRESH)
        return verdict

    def _play(self, cue: Cue) -> None:
        try:
            self._output.play(cue)
        except Exception:
            # Whoever guards the loop must outlive an output that fails: the next Stop is tried again.
            _log.exception("the cue %r could not be played", cue.text)
        else:
            self._stop_count += 1

    def _tell(self, stamp_s: float, text: str) -> None:
        try:
            self._report(stamp_s, text)
        except Exception:
            _log.exception("%r could not be reported", text)

    def start(self) -> None:
        """Watch in a thread of its own until :meth:`stop`; one that watches already goes on."""
        if self._thread is not None:
            return
        self._thread = threading.Thread(target=self._run, name="watchdog", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread at its next look."""
        self._stopped.set()

    def _run(self) -> None:
        while not self._stopped.is_set():
            self.check()
            self._clock.sleep_until(self._clock.now_s() + CHECK_EVERY_S)
