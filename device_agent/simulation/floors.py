"""The floors that can be walked, by name."""

from __future__ import annotations

from collections.abc import Callable

from device_agent.simulation.blank_corridor import blank_corridor
from device_agent.simulation.building import Building
from device_agent.simulation.office_floor import office_floor
from device_agent.simulation.wide_hall import wide_hall
from navcore.errors import InputError

FLOORS: dict[str, Callable[[], Building]] = {
    "office": office_floor,
    "wide-hall": wide_hall,
    "blank-corridor": blank_corridor,
}


def floor_named(name: str) -> Building:
    """Return a floor by its name. Raises InputError."""
    if name not in FLOORS:
        raise InputError(f"There is no floor {name!r} in the simulation: choose one of {', '.join(FLOORS)}.")
    return FLOORS[name]()
