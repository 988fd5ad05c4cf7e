"""From the draft to the devices: checked first; with errors only where somebody has seen and confirmed them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from console.checks import MapChecks
from console.errors import ConflictError
from console.model import SiteModel
from navcore.map_check.finding import Finding
from navcore.planning.poi_graph import PoiGraph

CHECK_WAIT_S = 20.0
"""A check that takes longer (the cloud is being measured for the first time) is waited for on its own page."""


class UnconfirmedError(ConflictError):
    """The draft has errors, or could not be checked, and nobody has confirmed that it is published all the same."""

    def __init__(self, errors: Sequence[Finding], version: int) -> None:
        first = errors[0].text
        more = f" And {len(errors) - 1} more." if len(errors) > 1 else ""
        super().__init__(f"{first}{more} Mend it, or publish all the same.")
        self._errors, self._version = tuple(errors), version

    def details(self) -> dict[str, Any]:
        """Return the errors, and the version that they are of: whoever confirms says which they have seen."""
        return {"findings": self._errors, "version": self._version}


def publish(model: SiteModel, checks: MapChecks, who: str, *, confirmed_version: int | None = None) -> PoiGraph:
    """Publish the draft; it is checked first where it has not been. Blocks while it is.

    Raises UnconfirmedError where errors are found, or the check has not ended, and nobody has confirmed them; and
    ConflictError where the draft is no longer the ``confirmed_version`` whose errors somebody has seen.
    """
    version = model.graph.version if confirmed_version is None else confirmed_version
    if version == model.published.version == model.graph.version:
        return model.published
    if confirmed_version is None and (errors := _checked(checks, version)):
        raise UnconfirmedError(errors, version)
    return model.publish(who, version)


def _checked(checks: MapChecks, version: int) -> Sequence[Finding]:
    errors = checks.unconfirmed_errors(version)
    # A check that runs already may be of an older version: then one more is begun.
    for _ in range(2):
        if all(finding.code != "not_checked" for finding in errors):
            break
        checks.start()
        checks.wait(CHECK_WAIT_S)
        errors = checks.unconfirmed_errors(version)
    return errors
