"""How hardware is named on the command line: a kind, and where it is (``serial:/dev/ttyUSB0``)."""

from __future__ import annotations

from dataclasses import dataclass

from navcore.errors import InputError


@dataclass(frozen=True, slots=True)
class SensorName:
    """Which adapter, and what it is to open."""

    kind: str
    where: str | None = None
    """A device, a serial number or a file, as the kind has it; None where none was named."""

    def __str__(self) -> str:
        """Return it as it is written on the command line."""
        return self.kind if self.where is None else f"{self.kind}:{self.where}"


@dataclass(frozen=True, slots=True)
class _Kind:
    form: str
    """How it is written."""
    needs_where: bool = False


_KINDS: dict[str, dict[str, _Kind]] = {
    "camera": {
        "realsense": _Kind("realsense[:SERIAL or FILE.db3]"),
        "oak": _Kind("oak[:ID]"),
    },
    "sonar": {"serial": _Kind("serial:/dev/ttyUSB0", needs_where=True)},
    "buttons": {
        "evdev": _Kind("evdev:/dev/input/event3", needs_where=True),
        "keyboard": _Kind("keyboard"),
    },
    "display": {"fb": _Kind("fb:/dev/fb0", needs_where=True)},
}


def names_of(what: str) -> str:
    """Return how the adapters of a port are written, for people."""
    return ", ".join(kind.form for kind in _KINDS[what].values())


def named(what: str, text: str | None) -> SensorName | None:
    """Return what a word on the command line names; None for None. Raises InputError with the names there are.

    Args:
        what: *camera*, *sonar*, *buttons* or *display*.
        text: the word.
    """
    if text is None:
        return None
    name, colon, where = text.partition(":")
    kind = _KINDS[what].get(name)
    if kind is None:
        raise InputError(f"There is no {what} {name!r}: use {names_of(what)}.")
    if (kind.needs_where and not where) or (colon and not where):
        raise InputError(f"--{what} {text} does not say where it is: write {kind.form}.")
    return SensorName(name, where or None)
