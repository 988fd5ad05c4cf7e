"""Whether docs/dependencies.md says what pyproject.toml asks for, and nothing installs from the net without hashes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from licence_rules import Table, is_installed, licence_of
from locked import ROOT, project, requirement_name

PAGE = Path("docs/dependencies.md")
_COLUMNS = ("package", "extra", "why", "in the place of", "licence", "wheels")
_WITH_CARE = ("--require-hashes", "--no-deps")
"""Either each file's hash is asked for, or it is one file that is there already."""
INSTALLING = ("Makefile", "README.md", ".ci", "docs")


def rows(text: str) -> Iterator[dict[str, str]]:
    """Yield the rows of the page's tables."""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.startswith("|") and len(cells) == len(_COLUMNS) and cells[0] not in ("package", "---"):
            yield dict(zip(_COLUMNS, cells, strict=True))


def complaints(table: Table, root: Path = ROOT) -> Iterator[str]:
    """Yield a sentence for each disagreement of the page with pyproject.toml, or with a package's licence."""
    extras: dict[str, set[str]] = {}
    for extra, requirements in project(root).items():
        for requirement in requirements:
            extras.setdefault(requirement_name(requirement), set()).add(extra or "base")
    found = list(rows((root / PAGE).read_text(encoding="utf-8")))
    names = [row["package"] for row in found]
    for name in sorted(extras.keys() - set(names)):
        yield f"{PAGE} has no line for {name}: say why it is needed, its licence, and which wheels it has."
    for name in sorted({name for name in names if name not in extras or names.count(name) > 1}):
        yield f"{PAGE} has a line too many for {name}."
    for row in found:
        name = row["package"]
        if set(row["extra"].split(", ")) != extras.get(name, set()):
            yield f"{PAGE}: {name} belongs to {', '.join(sorted(extras.get(name, ())))}."
        if not (row["why"] and row["wheels"]):
            yield f"{PAGE}: say of {name} why it is needed, and which wheels it has."
        if is_installed(name) and row["licence"] != (licence := licence_of(name, table)):
            yield f"{PAGE}: {name} is under {licence}."


def careless_installs(root: Path = ROOT) -> Iterator[str]:
    """Yield a sentence for each command that would install what nobody has pinned by its hash."""
    for path in _files(root):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if re.search(r"\bpip install\b(?! *`)", line) and not any(each in line for each in _WITH_CARE):
                where = f"{path.relative_to(root)}, line {number}"
                yield f"{where}: this installs without hashes; use --require-hashes -r, or --no-deps with one file."


def _files(root: Path) -> Iterator[Path]:
    for name in INSTALLING:
        path = root / name
        inside = [path] if path.is_file() else sorted(each for each in path.rglob("*") if each.suffix in ("", ".md"))
        yield from (each for each in inside if each.is_file())
