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

    def __init__(self, errors: Sequence[Finding]) -> None:
        first = errors[0].text
        more = f" And {len(errors) - 1} more." if len(errors) > 1 else ""
        super().__init__(f"{first}{more} Mend it, or publish all the same.")
        self._errors = tuple(errors)

    def details(self) -> dict[str, Any]:
        """Return the errors."""
        return {"findings": self._errors}


def publish(model: SiteModel, checks: MapChecks, who: str, *, confirmed: bool = False) -> PoiGraph:
    """Publish the draft; it is checked first where it has not been. Blocks while it is.

    Raises UnconfirmedError where errors are found, or the check has not ended, and ``confirmed`` is not said.
    """
    version = model.graph.version
    if version == model.published.version:
        return model.published
    if not confirmed:
        errors = checks.unconfirmed_errors(version)
        if any(finding.code == "not_checked" for finding in errors):
            checks.start()
            checks.wait(CHECK_WAIT_S)
            errors = checks.unconfirmed_errors(version)
        if errors:
            raise UnconfirmedError(errors)
    return model.publish(who, version)
