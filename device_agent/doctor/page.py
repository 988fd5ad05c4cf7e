"""The page ``docs/doctor.md``, made from the checks themselves."""

from __future__ import annotations

from collections.abc import Iterable

from device_agent.doctor.findings import Check, Status

_MEANINGS = {
    Status.OK: "all is well",
    Status.WARNING: "the device leads, but worse than it could, or not for long",
    Status.FAILED: "the device cannot lead anybody, or not safely; the exit code is 1",
}


def doctor_markdown(checks: Iterable[Check]) -> str:
    """Return the page."""
    meanings = "".join(f"- **{status.value}**: {meaning}.\n" for status, meaning in _MEANINGS.items())
    rows = "".join(f"| {check.name} | {check.looks_at} | {check.limit_s:g} s |\n" for check in checks)
    return (
        "# The doctor\n\n"
        "<!-- Made by `make docs` from device_agent/doctor/checks.py: change it there. -->\n\n"
        "`vbr doctor` looks at every part of the device, in this order, and says of each what was found and what to do."
        " It takes the same options as `vbr device` ([hardware.md](hardware.md)); stop the device first, for a camera"
        " serves one program at a time. `--json` prints the same for other programs.\n\n"
        f"{meanings}\n"
        "Whatever is raised in one check, and however long it hangs, the next one is made.\n\n"
        "| check | looks at | time limit |\n| --- | --- | --- |\n"
        f"{rows}"
    )
