"""What the lock files say: every distribution with its versions and hashes, and who needs it.

    .ci/locked.py [EXTRA ...]        the lock of the base install and these extras alone

Reads the lock files and ``pyproject.toml`` alone, and needs nothing but Python itself.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOCKS = ("requirements.lock", "requirements-cameras.lock")
DEVELOPMENT = "dev"
"""The extra of which nothing is handed to anybody."""
_PINNED = re.compile(r"^([A-Za-z0-9._-]+)==(\S+?)(?: ; (.+?))?(?: \\)?$")
_HASH = re.compile(r"^ +--hash=(\w+):([0-9a-f]+)(?: \\)?$")
_PARENT = re.compile(r"^ +#(?: via)? +(\S.*)$")


class LockError(Exception):
    """A lock file, or what is stated of licences, is not as it should be; the sentence says what to do."""


@dataclass(frozen=True)
class Pin:
    """One version of a distribution, for the machines that its marker names."""

    name: str
    version: str
    marker: str
    hashes: tuple[tuple[str, str], ...]
    """Algorithm and hexadecimal digest of each file that may be installed."""
    parents: frozenset[str]
    """Names of the distributions that need it; the empty one is this project."""


def normal(name: str) -> str:
    """Return a distribution's name as the lock files write it, without its extras."""
    return re.sub(r"[-_.]+", "-", name.partition("[")[0].strip()).lower()


def read_lock(path: Path) -> list[Pin]:
    """Return what a lock file pins. Raises LockError for a line of another kind, or a pin without hashes."""
    pins: list[Pin] = []
    head: tuple[str, str, str] | None = None
    hashes: list[tuple[str, str]] = []
    parents: set[str] = set()

    def close() -> None:
        if head is not None:
            if not hashes:
                raise LockError(f"{path.name}: {head[0]} has no hash: run make lock.")
            pins.append(Pin(*head, tuple(hashes), frozenset(parents)))

    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if found := _PINNED.match(line):
            close()
            head, hashes, parents = (normal(found[1]), found[2], found[3] or ""), [], set()
        elif head is not None and (found := _HASH.match(line)):
            hashes.append((found[1], found[2]))
        elif head is not None and (found := _PARENT.match(line)):
            if found[1] != "via":
                parents.add("" if found[1].endswith("(pyproject.toml)") else normal(found[1]))
        elif line.strip():
            raise LockError(f"{path.name}, line {number}: {line.strip()[:80]!r} pins nothing by hash: run make lock.")
    close()
    return pins


def all_pins(root: Path = ROOT) -> list[Pin]:
    """Return what both lock files pin, each version once. Raises LockError where the two differ."""
    pins: dict[tuple[str, str, str], Pin] = {}
    for lock in LOCKS:
        for pin in read_lock(root / lock):
            key = (pin.name, pin.version, pin.marker)
            before = pins.get(key)
            if before is not None and set(before.hashes) != set(pin.hashes):
                raise LockError(f"{lock} has other hashes of {pin.name} {pin.version}: run make lock.")
            parents = pin.parents | (before.parents if before else frozenset())
            pins[key] = Pin(*key, pin.hashes, parents)
    for name in {pin.name for pin in pins.values()}:
        mine = {(pin.version, pin.marker) for pin in pins.values() if pin.name == name}
        if len({marker for _, marker in mine}) < len(mine):
            raise LockError(f"The lock files pin {name} twice for the same machine: run make lock.")
    return list(pins.values())


def project(root: Path = ROOT) -> dict[str, list[str]]:
    """Return the direct dependencies by extra, as ``pyproject.toml`` writes them; "" is the base install."""
    table = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {"": table["dependencies"], **table["optional-dependencies"]}


def requirement_name(requirement: str) -> str:
    """Return which distribution a requirement such as ``numpy>=2.1`` asks for."""
    found = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert found is not None
    return normal(found[0])


def children(pins: Iterable[Pin]) -> dict[str, set[str]]:
    """Return what each distribution needs directly, by the lock files."""
    needs: dict[str, set[str]] = {}
    for pin in pins:
        needs.setdefault(pin.name, set())
        for parent in pin.parents - {""}:
            needs.setdefault(parent, set()).add(pin.name)
    return needs


def needed_by(extras: Iterable[str], pins: Iterable[Pin], root: Path = ROOT) -> set[str]:
    """Return every distribution that an install with these extras may need ("" is the base install)."""
    wanted, needs, direct = set(), children(pins), project(root)
    waiting = [requirement_name(each) for extra in extras for each in direct[extra]]
    while waiting:
        name = waiting.pop()
        if name not in wanted:
            wanted.add(name)
            waiting += needs.get(name, ())
    return wanted


def given_to_others(pins: Iterable[Pin], root: Path = ROOT) -> set[str]:
    """Return what somebody may need who uses the product: all but what is for development alone."""
    return needed_by([extra for extra in project(root) if extra != DEVELOPMENT], pins, root)


def subset(extras: Iterable[str], root: Path = ROOT) -> str:
    """Return the lock of an install with these extras alone, with every hash. Raises LockError for an unknown extra."""
    asked = list(extras)
    unknown = sorted(set(asked) - set(project(root)))
    if unknown:
        raise LockError(
            f"There is no extra {unknown[0]!r}: choose among {', '.join(sorted(set(project(root)) - {''}))}."
        )
    pins = all_pins(root)
    names = needed_by(["", *asked], pins, root)
    lines = []
    for pin in sorted(pins, key=lambda pin: (pin.name, pin.version)):
        if pin.name in names:
            marker = f" ; {pin.marker}" if pin.marker else ""
            hashes = [f"    --hash={algorithm}:{digest}" for algorithm, digest in pin.hashes]
            lines.append(" \\\n".join([f"{pin.name}=={pin.version}{marker}", *hashes]))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    try:
        sys.stdout.write(subset(sys.argv[1:]))
    except LockError as error:
        sys.exit(str(error))
