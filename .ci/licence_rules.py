"""Which licence each distribution has, and whether it may be given to others with what is Apache-2.0.

From the installed packages' own metadata and the table ``licences.toml``: nothing is fetched.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from client_packages import CARRIER, ClientPackage, client_packages
from license_expression import ExpressionError, LicenseExpression, ParseError, get_spdx_licensing
from locked import ROOT, LockError, Pin, given_to_others, read_lock
from packaging.markers import Marker

TABLE = Path(__file__).resolve().parent / "licences.toml"
_LICENSING = get_spdx_licensing()
_CLASSIFIERS = {
    "Apache Software License": "Apache-2.0", "ISC License (ISCL)": "ISC", "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0", "Python Software Foundation License": "PSF-2.0",
}  # fmt: skip
"""Of those that the packages use, the ones that name one licence; "BSD License" does not."""
_LIBRARY = re.compile(r"^(lib.+?)(?:-[0-9a-f]{8}[.0-9]*)*\.so[.0-9a-z]*$")


@dataclass(frozen=True)
class Table:
    """What ``licences.toml`` says."""

    permitted: frozenset[str]
    development: frozenset[str]
    stated: dict[str, str]
    judged: dict[str, str]
    bundled: dict[str, str]
    bundled_judged: dict[str, str]
    client_stated: dict[str, str]
    client_judged: dict[str, str]

    @classmethod
    def read(cls, path: Path = TABLE) -> Table:
        """Read the table."""
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        return cls(
            frozenset(data["permitted"]), frozenset(data["development"]), data["stated"], data["judged"],
            data["bundled"], data["bundled_judged"], data["client_stated"], data["client_judged"],
        )  # fmt: skip


def spdx(words: str) -> LicenseExpression | None:
    """Return words as an SPDX expression, or None where they are none."""
    try:
        return _LICENSING.parse(words, validate=True)
    except (ExpressionError, ParseError):
        return None


def is_within(expression: LicenseExpression | None, permitted: frozenset[str]) -> bool:
    """Say whether an expression permits what the ``permitted`` ones permit: of "or" one, of "and" all."""
    if isinstance(expression, _LICENSING.OR):
        return any(is_within(each, permitted) for each in expression.args)
    if isinstance(expression, _LICENSING.AND):
        return all(is_within(each, permitted) for each in expression.args)
    return str(expression) in permitted


def is_installed(name: str) -> bool:
    """Say whether a distribution is installed here."""
    try:
        metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def licence_of(name: str, table: Table) -> str:
    """Return an installed distribution's licence as an SPDX expression: in its own words, else as the table states it.

    Raises LockError where neither names one, or where a statement is no longer needed.
    """
    own = _own_words(name)
    if own and name in table.stated:
        raise LockError(f"{name} says by itself that it is {own}: take it out of [stated] in .ci/licences.toml.")
    if not own and name not in table.stated:
        raise LockError(
            f"{name} does not say clearly under which licence it is: read its licence file, and state it in [stated] of"
            " .ci/licences.toml."
        )
    return own or table.stated[name]


def _own_words(name: str) -> str:
    about = metadata.metadata(name)
    for words in (*about.get_all("License-Expression", []), *about.get_all("License", [])):
        if words and (expression := spdx(words)) is not None:
            return str(expression)
    prefix = "License :: OSI Approved :: "
    named = [line.removeprefix(prefix) for line in about.get_all("Classifier", []) if line.startswith(prefix)]
    known = {_CLASSIFIERS.get(each, "") for each in named}
    return known.pop() if len(known) == 1 else ""


def bundled_libraries(name: str) -> set[str]:
    """Return the shared libraries, wherever they lie, that an installed wheel carries, without version and hash."""
    files = metadata.distribution(name).files or []
    return {found[1] for each in files if (found := _LIBRARY.match(each.name))}


def complaints(pins: Iterable[Pin], table: Table) -> Iterator[str]:
    """Yield a sentence for each licence that is unknown, or that nobody has judged."""
    pins = list(pins)
    given = given_to_others(pins)
    for name in sorted({pin.name for pin in pins}):
        if not is_installed(name):
            if any(_is_for_here(pin) for pin in pins if pin.name == name):
                yield f"{name} is not installed, so that its licence cannot be read: run make install."
            continue
        permitted = table.permitted if name in given else table.permitted | table.development
        try:
            licence = licence_of(name, table)
        except LockError as error:
            yield str(error)
            continue
        if not is_within(spdx(licence), permitted) and name not in table.judged:
            what = "given to others" if name in given else "only used for development"
            yield f"{name} is {licence}, which is not permitted for what is {what}: do without, or judge it."
        if name in given:
            yield from _bundled_complaints(name, table)
        if name == CARRIER:
            yield from client_complaints(client_packages(), table)
    for name in sorted((set(table.judged) | set(table.stated)) - {pin.name for pin in pins}):
        yield f"{name} is not in the lock files any more: take it out of .ci/licences.toml."


def _bundled_complaints(name: str, table: Table) -> Iterator[str]:
    for library in sorted(bundled_libraries(name)):
        licence = table.bundled.get(library)
        if licence is None:
            yield f"{name} carries {library} with it: find out its licence, and name it in [bundled]."
        elif not is_within(spdx(licence), table.permitted) and library not in table.bundled_judged:
            yield f"{name} carries {library} ({licence}) with it: do without it, or judge it in [bundled_judged]."


def client_licence(package: ClientPackage, table: Table) -> str:
    """Return the licence of what viser's client holds: its own words, else what the table states; empty if neither."""
    return package.licence or table.client_stated.get(package.name, "")


def client_complaints(packages: Iterable[ClientPackage], table: Table) -> Iterator[str]:
    """Yield a sentence for each package in viser's client whose licence is unknown or not permitted, and unjudged."""
    packages = list(packages)
    for each in packages:
        licence = client_licence(each, table)
        if not licence:
            yield f"{each.name}, in viser's client, names no licence: find it out, and name it in [client_stated]."
        elif not is_within(spdx(licence), table.permitted) and each.name not in table.client_judged:
            yield f"{each.name} ({licence}) is in viser's client: judge it in [client_judged], or do without viser."
    silent = {each.name for each in packages if not each.licence}
    for name in sorted(set(table.client_stated) - silent):
        yield f"{name} says its licence by itself, or is gone from viser's client: take it out of [client_stated]."
    for name in sorted(set(table.client_judged) - {each.name for each in packages}):
        yield f"{name} is not in viser's client any more: take it out of [client_judged]."


def _is_for_here(pin: Pin) -> bool:
    """Whether ``make install`` installs it on this machine; the cameras' SDKs are left out where nobody asked."""
    locked_names = {each.name for each in read_lock(ROOT / "requirements.lock")}
    return pin.name in locked_names and (not pin.marker or Marker(pin.marker).evaluate())
