"""What is walked: the paper's two experiments, three paths, two kinds of walkers, and both guidance policies."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from device_agent.simulation.walker import WalkerParameters, drawn_partially_sighted_walker, drawn_walker

Policy = Literal["paper", "road_centred"]
Sight = Literal["partially sighted", "totally blind"]
POLICIES: tuple[Policy, ...] = ("paper", "road_centred")
SIGHTS: tuple[Sight, ...] = ("partially sighted", "totally blind")
EXPERIMENTS = (1, 2)
"""Without obstacles, and with."""
FIRST_REPORTING_SEED = 12100
"""Walkers from this seed on are for the next table: nobody has looked at them, whatever came of those below."""


@dataclass(frozen=True, slots=True)
class Path:
    """One of the paper's three ways."""

    name: str
    start: str
    destination: str


PATHS = (Path("A→B", "Hall", "Wash room"), Path("D→C", "Lounge", "Bar"), Path("E→B", "Room 3308", "Wash room"))


@dataclass(frozen=True, slots=True)
class Trial:
    """One walk."""

    experiment: int
    policy: Policy
    path: Path
    sight: Sight
    seed: int

    @property
    def key(self) -> str:
        """Name of the file in which its result is kept."""
        path = self.path.name.replace("→", "")
        return f"e{self.experiment}-{self.policy}-{path}-{self.sight.split()[0]}-{self.seed:05d}"

    def walker(self) -> WalkerParameters:
        """The person who walks: the same one for both policies, and with and without obstacles."""
        drawn = drawn_walker if self.sight == "totally blind" else drawn_partially_sighted_walker
        return drawn(self.seed)


def trials(seeds: Sequence[int]) -> Iterator[Trial]:
    """Return all walks; those of one seed together, so that a batch that is stopped has whole rows."""
    for seed, experiment, path, policy, sight in itertools.product(seeds, EXPERIMENTS, PATHS, POLICIES, SIGHTS):
        yield Trial(experiment, policy, path, sight, seed)
