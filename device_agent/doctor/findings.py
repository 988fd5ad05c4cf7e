"""What a check comes to, and running checks so that none can stop or hold up the others."""

from __future__ import annotations

import enum
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from navcore.errors import VbrError


class Status(enum.Enum):
    """How bad it is."""

    OK = "ok"
    WARNING = "warning"
    """The device leads, but worse than it could, or not for long."""
    FAILED = "failed"
    """The device cannot lead anybody, or not safely."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check came to."""

    status: Status
    found: str
    """What there is, in a sentence or less."""
    advice: str = ""
    """What to do; empty where all is well."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that is looked at."""

    name: str
    looks_at: str
    """For people: what is looked at, and what is not good enough."""
    run: Callable[[], Finding]
    limit_s: float = 10.0
    """A check that takes longer has failed."""


@dataclass(frozen=True, slots=True)
class Checked:
    """A check that was made."""

    name: str
    finding: Finding
    took_s: float


def ok(found: str) -> Finding:
    """Return that all is well."""
    return Finding(Status.OK, found)


def warning(found: str, advice: str) -> Finding:
    """Return that something could be better."""
    return Finding(Status.WARNING, found, advice)


def failed(found: str, advice: str) -> Finding:
    """Return that something does not work."""
    return Finding(Status.FAILED, found, advice)


def made(checks: Iterable[Check]) -> Iterator[Checked]:
    """Make checks one after the other; whatever is raised in one, or however long it hangs, the next one is made."""
    for check in checks:
        began_s = time.monotonic()
        finding = _within_limit(check)
        yield Checked(check.name, finding, time.monotonic() - began_s)


def _within_limit(check: Check) -> Finding:
    results: list[Finding] = []

    def run() -> None:
        results.append(_caught(check))

    # A driver that hangs is left behind with its thread.
    thread = threading.Thread(target=run, name=f"check of {check.name}", daemon=True)
    thread.start()
    thread.join(check.limit_s)
    if not results:
        return failed(
            f"no answer within {check.limit_s:g} s", "unplug it and plug it in again, then start the device anew"
        )
    return results[0]


def _caught(check: Check) -> Finding:
    try:
        return check.run()
    except VbrError as error:
        return as_finding(failed, error)
    except Exception as error:
        return failed(
            f"the check itself failed: {type(error).__name__}: {error}"[:300],
            "run it again with the same options as `vbr --debug doctor`",
        )


def as_finding(status: Callable[[str, str], Finding], error: VbrError) -> Finding:
    """Return an error as a finding: its text says what is wrong, a colon, and what to do."""
    found, _, advice = str(error).rstrip(".").rpartition(": ")
    return status(found or advice, advice if found else "see docs/hardware.md")


def exit_code(checked: Iterable[Checked]) -> int:
    """Return 1 where something has failed, else 0."""
    return int(any(each.finding.status is Status.FAILED for each in checked))
