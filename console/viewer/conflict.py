"""Two people at the same thing: the two versions in words, and what is kept of one's own until one has chosen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from console.edit_conflict import EditConflictError
from console.edits import DeleteEdge, DeletePoi, DeleteRoad, Edit, JoinRoads, MergePois

_HIDDEN = ("id", "a", "b")
_TAKING_AWAY = DeletePoi | DeleteEdge | DeleteRoad | MergePois | JoinRoads


@dataclass(frozen=True, slots=True)
class Conflict:
    """An edit that was not made, for somebody else has changed the same thing meanwhile."""

    edit: Edit
    sentence: str
    by: str
    version: int
    """The draft's version that was looked at when it was refused."""
    rows: tuple[tuple[str, str, str], ...]
    """What differs: field, theirs, yours."""
    can_insist: bool
    """Whether the edit can still be made."""

    @classmethod
    def of(cls, edit: Edit, error: EditConflictError) -> Conflict:
        """Take what the model has said."""
        details = error.details()["conflict"]
        theirs, yours = details["theirs"], details["yours"]
        # What takes the thing away leaves nothing of it to show, and can be insisted on all the same.
        can_insist = theirs is not None and (yours is not None or isinstance(edit, _TAKING_AWAY))
        return cls(
            edit, str(error), details["by"], details["version"], _rows(theirs, yours, details["by"]), can_insist
        )  # fmt: skip


def _rows(
    theirs: Mapping[str, Any] | None, yours: Mapping[str, Any] | None, by: str
) -> tuple[tuple[str, str, str], ...]:
    if theirs is None:
        return (("", f"deleted by {by}", "changed" if yours is not None else "deleted as well"),)
    if yours is None:
        return (("", f"changed by {by}", "deleted"),)
    fields = [name for name in {**theirs, **yours} if name not in _HIDDEN and theirs.get(name) != yours.get(name)]
    return tuple((name.replace("_", " "), _words(theirs.get(name)), _words(yours.get(name))) for name in fields)


def _words(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.2f}"
    return "–" if value in (None, "") else str(value)
