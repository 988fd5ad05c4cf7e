"""Who may call what, row by row: ``console.rules`` and ``console.roles`` against the statement that reads neither.

Pure, so that a fault in any row can be put in and looked for within milliseconds (.ci/mutants); that the console
does what they say is shown by real requests in test_authorization_matrix.
"""

from __future__ import annotations

import pytest
from authorization_statement import GROUPS, IN_GROUP, MAY, routes_of

from console.roles import EDITING, MANAGING, MAPPING, ROLES, SIGNED_IN, TUNING
from console.rules import MAX_BODY_BYTES, RULES
from navcore.graph_import import MAX_GRAPH_FILE_BYTES
from navcore.site_archive import MAX_ARCHIVE_BYTES

LARGE_BODIES = {
    ("POST", "/api/import/graph"): MAX_GRAPH_FILE_BYTES, ("POST", "/api/import/site"): MAX_ARCHIVE_BYTES,
}  # fmt: skip


def test_every_rule_stands_in_one_group() -> None:
    assert set(RULES) == set(IN_GROUP)
    assert sum(len(routes_of(group)) for group in GROUPS) == len(IN_GROUP)


@pytest.mark.parametrize("role", [None, *ROLES])
def test_each_role_may_do_exactly_what_the_statement_says(role: str | None) -> None:
    may = MAY[role or "nobody"].split()
    wrong = {key for key, group in IN_GROUP.items() if RULES[key].permits(role) != (group in may)}  # type: ignore[arg-type]
    assert not wrong


def test_devices_have_their_own_routes_and_no_other() -> None:
    asked_for_a_device_token = {key for key, rule in RULES.items() if rule.who == "devices"}
    assert asked_for_a_device_token == {key for key, group in IN_GROUP.items() if group == "be-a-device"}


def test_the_sets_of_roles_are_those_of_the_statement() -> None:
    """Forms, and the scene, ask them directly."""
    assert set(ROLES) == set(MAY) - {"nobody", "device"}
    for group, roles in {
        "look": SIGNED_IN,
        "edit": EDITING,
        "tune": TUNING,
        "map": MAPPING,
        "manage": MANAGING,
    }.items():
        assert roles == {role for role in ROLES if group in MAY[role].split()}, group


def test_only_imports_have_large_bodies() -> None:
    assert MAX_BODY_BYTES == 1 << 18
    assert {key: RULES[key].max_body_bytes for key in RULES} == dict.fromkeys(RULES, MAX_BODY_BYTES) | LARGE_BODIES
