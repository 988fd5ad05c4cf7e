"""Who may do what: roles, and the sets of roles that rules are written with.

viewer < editor < admin and viewer < technician < admin; editor and technician stand side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

Role = Literal["viewer", "editor", "technician", "admin"]
ROLES: tuple[Role, ...] = get_args(Role)

SIGNED_IN: frozenset[Role] = frozenset(ROLES)
"""Everybody who is signed in."""
EDITING: frozenset[Role] = frozenset({"editor", "admin"})
"""Who may change the PoI-graph, publish it, and lead the walker."""
TUNING: frozenset[Role] = frozenset({"technician", "admin"})
"""Who may change settings of a device."""
MAPPING: frozenset[Role] = EDITING | TUNING
"""Who may have a building recorded, and maps built."""
MANAGING: frozenset[Role] = frozenset({"admin"})
"""Who may manage people and devices."""


@dataclass(frozen=True, slots=True)
class SignedIn:
    """A signed-in person on one browser."""

    session_id: str
    """Names the session; it is the hash of its token, and of no use for signing in."""
    user_id: int
    user_name: str
    role: Role
