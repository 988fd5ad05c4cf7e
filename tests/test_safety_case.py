"""docs/safety.md against the code: what it names is there, and what safety hangs on is named."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import pytest

from navcore.settings import setting_specs
from navcore.types import Reason, Rule

TESTS = Path(__file__).resolve().parent
DOCS = TESTS.parent / "docs"
PAGE = (DOCS / "safety.md").read_text(encoding="utf-8")
NAMED_TEST = re.compile(r"`(test_\w+\.py)::(test_\w+)`")
FIELDS = ("Causes", "Risk", "Decided by", "Held by", "Shown by", "Remains")


def requirements() -> dict[str, str]:
    """Return the row of each safety requirement."""
    return {found[1]: found[0] for found in re.finditer(r"^\| (SR-\d+) \|.*$", PAGE, re.MULTILINE)}


def hazards() -> dict[str, dict[str, str]]:
    """Return the fields of each hazard."""
    text = PAGE.partition("\n## Hazards\n")[2].partition("\n## ")[0]
    parts = re.split(r"^### (H-\d+) .*$", text, flags=re.MULTILINE)[1:]
    return {
        name: {found[1]: " ".join(found[2].split()) for found in _FIELD.finditer(body)}
        for name, body in zip(parts[::2], parts[1::2], strict=True)
    }


_FIELD = re.compile(r"^- \*\*([\w ]+):\*\* (.*?)(?=^- \*\*|\Z)", re.MULTILINE | re.DOTALL)
HAZARDS = hazards()


@functools.cache
def defined_in(file: str) -> frozenset[str]:
    """Return the names of the tests that a file defines."""
    path = TESTS / file
    tree = ast.parse(path.read_text(encoding="utf-8")) if path.is_file() else ast.Module([], [])
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


def named_in_hazards(kind: str) -> set[str]:
    """Return the members of an enumeration, or the settings, by which hazards are said to be decided."""
    decided = " ".join(fields["Decided by"] for fields in HAZARDS.values())
    return set(re.findall(rf"`{kind}([\w.]+)`", decided))


def test_every_test_that_is_named_exists() -> None:
    named = NAMED_TEST.findall(PAGE)
    assert len(named) == PAGE.count(".py::"), "each is written as `file::test`"
    assert not [f"{file}::{test}" for file, test in named if test not in defined_in(file)]


def test_numbers_are_without_a_gap() -> None:
    assert list(requirements()) == [f"SR-{i + 1}" for i in range(len(requirements()))]
    assert list(HAZARDS) == [f"H-{i + 1}" for i in range(len(HAZARDS))]


def test_every_requirement_has_a_test_and_a_hazard_that_it_holds() -> None:
    held = {each for fields in HAZARDS.values() for each in re.findall(r"SR-\d+", fields["Held by"])}
    assert held == set(requirements())
    assert not [name for name, row in requirements().items() if not NAMED_TEST.search(row)]


@pytest.mark.parametrize("name", HAZARDS)
def test_every_hazard_says_what_holds_it_what_shows_that_and_what_remains(name: str) -> None:
    fields = HAZARDS[name]
    assert tuple(fields) == FIELDS
    assert re.fullmatch(r"S[123] · E[123] · [WCN]", fields["Risk"])
    assert NAMED_TEST.search(fields["Shown by"])
    assert fields["Remains"].endswith((".", ".**"))


def test_whatever_is_linked_is_there() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", PAGE)
    assert links
    assert not [link for link in links if not (DOCS / link).is_file()]


@pytest.mark.parametrize("kind", [Reason, Rule])
def test_every_reason_and_every_rule_belongs_to_a_hazard(kind: type[Reason | Rule]) -> None:
    assert named_in_hazards(f"{kind.__name__}\\.") == {member.name for member in kind}


def test_every_setting_that_safety_hangs_on_belongs_to_a_hazard() -> None:
    settings = {spec.key: spec for spec in setting_specs()}
    named = {each for each in named_in_hazards("") if each.partition(".")[0] not in ("Reason", "Rule")}
    assert named == {key for key, spec in settings.items() if spec.safety}
