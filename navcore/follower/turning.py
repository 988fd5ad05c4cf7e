"""Turning to where the route leads, on the spot: at a corner, at the start, or around.

Somebody who faces away from the route may turn around by either side. Which of them is nearer changes with every sway
of the head, so that the side that was said is kept until the turn is well begun.
"""

from __future__ import annotations

import math

from navcore.angles import RelativeAngle, relative_angle
from navcore.types import TurnKind

AROUND_RAD = math.radians(135.0)
"""What lies farther to the side than this lies behind."""
_EITHER_SIDE_RAD = math.radians(150.0)
"""Beyond this, the other way round is hardly longer."""
_FAR_RAD = math.radians(90.0)
_FULL_RAD = math.radians(179.0)


def turn_to_route(
    error: RelativeAngle, before: TurnKind | None, last: RelativeAngle | None, lost: RelativeAngle | None = None
) -> tuple[TurnKind, RelativeAngle]:
    """Return the kind of the turn, and by how much to turn.

    Args:
        error: the expected direction relative to the heading.
        before: the kind of turn of the frame before, if that turned to the route as well; a U-turn stays one.
        last: by how much that frame turned; None where it did not.
        lost: where the place was lost in an earlier turn, relative to the heading; None where it was not. Who must
            turn far turns by the side on which that does not lie.
    """
    is_around = abs(error) >= AROUND_RAD or before is TurnKind.AROUND
    side, kept, least_rad = error, last, _EITHER_SIDE_RAD
    if lost is not None:
        passes = error * lost > 0.0 and abs(lost) < abs(error)
        kept, least_rad = relative_angle(-error if passes else error) if last is None else last, _FAR_RAD
    if kept is not None and abs(error) > least_rad and error * kept < 0.0:
        side = relative_angle(math.copysign(_FULL_RAD, kept))
    return (TurnKind.AROUND if is_around else TurnKind.ALONG), side
