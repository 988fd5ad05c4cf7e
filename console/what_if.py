"""What-if: recorded walks guided again under other settings, each in a process of its own, one at a time.

The process is the device's own replay (``vbr walks replay``), which gives way to everything else, has only so long, and
can be ended. What has been found is remembered for the same walk and the same values, until the console ends.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import shutil
import tempfile
import threading
from collections import OrderedDict, deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from console.errors import ConflictError, NotFoundError
from console.past_walks import PastWalk, PastWalks
from console.what_if_result import WhatIfResult, compared, read_decisions
from navcore.command_process import CommandProcess
from navcore.errors import InputError, VbrError
from navcore.settings import SettingValue, not_replayed, spec_of

MAX_RUN_S = 600.0
MAX_WAITING_COUNT = 8
REMEMBERED_COUNT = 24
_JOIN_TIMEOUT_S = 10.0
_SAME_OR_DIFFERENT = (0, 1)
"""How a replay that came to its end tells whether everything was as it was then."""
_NOTHING_TO_JUDGE = (
    "None of these can be judged by a recorded walk: poses, what stands in the way and the device's pace are in it as"
    " they were then."
)
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class WhatIfRun:
    """A question, and how far its answer has come."""

    run_id: str
    walk_id: str
    changes: Mapping[str, SettingValue]
    last_s: float | None
    """So much of the walk's end is looked at; None for all of it."""
    not_judged: tuple[str, ...]
    """Settings whose effect a replay cannot show."""
    files: tuple[Path, ...]
    state: Literal["waiting", "running", "done", "failed", "cancelled"] = "waiting"
    percent: int = 0
    why: str = ""
    """Why there is no result, as a sentence."""
    result: WhatIfResult | None = None


@dataclass(slots=True)
class _Work:
    """What runs just now."""

    run_id: str
    process: CommandProcess = field(default_factory=CommandProcess)


class WhatIfs:
    """Asks what other settings would have changed. All methods may be called from any thread."""

    def __init__(self, walks: PastWalks, folder: Path, max_run_s: float = MAX_RUN_S) -> None:
        """``folder`` is for what is found on the way; what a console that was killed has left there goes."""
        self._walks, self._folder, self._max_run_s = walks, folder, max_run_s
        shutil.rmtree(folder, ignore_errors=True)
        self._lock = threading.Lock()
        self._runs: OrderedDict[str, WhatIfRun] = OrderedDict()
        self._waiting: deque[str] = deque()
        self._work: _Work | None = None
        self._thread: threading.Thread | None = None
        self._closed = False

    def start(self, walk_id: str, changes: Mapping[str, SettingValue], last_s: float | None = None) -> WhatIfRun:
        """Ask; what has been asked of the same walk and values already is given as it stands.

        Raises SettingError for a setting that does not exist, NotFoundError, or ConflictError where too many wait.
        """
        for key in changes:
            spec_of(key)
        walk = self._walks.named(walk_id)
        run = WhatIfRun(
            _key(walk, changes, last_s), walk_id, dict(changes), last_s, not_replayed(changes), walk.parts
        )  # fmt: skip
        if len(run.not_judged) == len(changes):
            return replace(run, state="failed", why=_NOTHING_TO_JUDGE)
        with self._lock:
            known = self._runs.get(run.run_id)
            if known is not None and known.state in ("waiting", "running", "done"):
                self._runs.move_to_end(run.run_id)
                return known
            if len(self._waiting) >= MAX_WAITING_COUNT:
                raise ConflictError("Many questions wait already: wait until some are answered.")
            self._remember(run)
            self._waiting.append(run.run_id)
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._work_off, name="what-if", daemon=True)
                self._thread.start()
        return run

    def run(self, run_id: str) -> WhatIfRun:
        """Return how a question stands. Raises NotFoundError, also where its walk was deleted."""
        run = self._known(run_id)
        self._walks.named(run.walk_id)
        return run

    def walk_of(self, run_id: str) -> PastWalk:
        """Return the walk that a question is about. Raises NotFoundError."""
        return self._walks.named(self._known(run_id).walk_id)

    def _known(self, run_id: str) -> WhatIfRun:
        with self._lock:
            run = self._runs.get(run_id)
        if run is None:
            raise NotFoundError("This question is not remembered any more: ask it again.")
        return run

    def cancel(self, run_id: str) -> WhatIfRun:
        """Give a question up, where it is not answered yet. Raises NotFoundError."""
        run = self.run(run_id)
        with self._lock:
            run = self._runs.get(run_id, run)
            if run.state not in ("waiting", "running"):
                return run
            if run_id in self._waiting:
                self._waiting.remove(run_id)
            run = self._runs[run_id] = replace(run, state="cancelled", why="It was given up.")
            if self._work is not None and self._work.run_id == run_id:
                self._work.process.stop()
        return run

    def forget_deleted(self) -> None:
        """Forget what was asked of walks, or parts of walks, that were deleted meanwhile."""
        with self._lock:
            gone = [run_id for run_id, run in self._runs.items() if not all(file.exists() for file in run.files)]
        for run_id in gone:
            with contextlib.suppress(NotFoundError):
                self.cancel(run_id)
            with self._lock:
                self._runs.pop(run_id, None)

    def close(self) -> None:
        """Give up what runs and waits."""
        with self._lock:
            self._closed = True
            self._waiting.clear()
            if self._work is not None:
                self._work.process.stop()
            thread = self._thread
        if thread is not None:
            thread.join(_JOIN_TIMEOUT_S)

    def _remember(self, run: WhatIfRun) -> None:
        self._runs[run.run_id] = run
        self._runs.move_to_end(run.run_id)
        settled = [key for key, each in self._runs.items() if each.state not in ("waiting", "running")]
        for key in settled[: max(0, len(self._runs) - REMEMBERED_COUNT)]:
            del self._runs[key]

    def _work_off(self) -> None:
        while (work := self._next()) is not None:
            try:
                found = self._answered(work)
            except VbrError as error:
                found = {"state": "failed", "why": str(error)[-400:]}
            except Exception as error:
                _log.exception("a what-if could not be answered")
                found = {"state": "failed", "why": f"{type(error).__name__}: {error}"[:400]}
            self._note(work.run_id, **found)

    def _next(self) -> _Work | None:
        with self._lock:
            if self._closed or not self._waiting:
                self._work = self._thread = None
                return None
            self._work = _Work(self._waiting.popleft())
            self._runs[self._work.run_id] = replace(self._runs[self._work.run_id], state="running")
            return self._work

    def _answered(self, work: _Work) -> dict[str, object]:
        run = self.run(work.run_id)
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryDirectory(dir=self._folder) as folder:
            decisions = Path(folder) / "decisions.jsonl"
            ended = work.process.run(
                _arguments(run, decisions), lambda percent: self._note(run.run_id, percent=percent), self._max_run_s
            )
            if ended.was_late:
                return {
                    "state": "failed",
                    "why": f"The replay has taken more than {self._max_run_s:g} s and was given up: choose a shorter"
                    " walk, or its last minutes.",
                }
            if ended.was_stopped:
                return {"state": "cancelled", "why": "It was given up."}
            if ended.code not in _SAME_OR_DIFFERENT or not ended.answer:
                raise InputError(ended.complaint or f"The replay ended with {ended.code}.")
            return {"state": "done", "percent": 100, "result": compared(read_decisions(decisions))}

    def _note(self, run_id: str, **found: object) -> None:
        with self._lock:
            run = self._runs.get(run_id)
            if run is not None and run.state == "running":
                self._runs[run_id] = replace(run, **found)  # type: ignore[arg-type]  # fields by their names


def _key(walk: PastWalk, changes: Mapping[str, SettingValue], last_s: float | None) -> str:
    """Name a question by the walk, as far as it has come, and the values."""
    files = [(part.name, part.stat().st_size) for part in walk.parts]
    question = json.dumps([walk.walk_id, files, last_s, sorted(changes.items())])
    return hashlib.sha256(question.encode()).hexdigest()[:32]


def _arguments(run: WhatIfRun, decisions: Path) -> list[str]:
    judged = {key: value for key, value in run.changes.items() if key not in run.not_judged}
    values = [f"--set={key}={value if isinstance(value, str) else json.dumps(value)}" for key, value in judged.items()]
    last = [] if run.last_s is None else [f"--last={run.last_s}"]
    files = [str(file) for file in run.files]
    return ["walks", "replay", *files, *values, *last, f"--decisions={decisions}", "--behind", "--json"]
