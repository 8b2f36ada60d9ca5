"""Values at which ``deviations.py`` measures contact of several bodies: the grid of the tables, and that between its points."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from simspec.engines.kit.refinements import SLIDING
from simspec.proof.contact.normal import DROP_RESTITUTION
from simspec.proof.contact.probe import Probe, ProbeLaw
from simspec.proof.contact.run import COUPLED, PROBES
from simspec.world.reach import MaterialReach
from simspec.world.types import PairContact


@dataclass(frozen=True)
class Values:
    """Values that a probe is measured at: each friction with each restitution and ratio of masses, where the law applies."""

    frictions: Sequence[float]
    restitutions: Sequence[float] = (0.0,)
    ratios: Sequence[float] = (1.0,)


@dataclass(frozen=True)
class Grid:
    """Values by kind of probe (see ``kind_of``), and default timesteps (ms); ``local``: around single points."""

    values: Mapping[str, Sequence[Values]]
    timesteps: Sequence[float]
    coupled_timesteps: Sequence[float]
    local: bool = False

    def points(self, probe: Probe) -> list[tuple[float, float, float]]:
        """Friction, restitution and ratio of masses."""
        return [
            point
            for values in self.values.get(kind_of(probe), ())
            for point in itertools.product(values.frictions, values.restitutions, values.ratios)
        ]

    def bouncing(self) -> Grid:
        """The points at which coupled probes have restitution."""
        coupled = [values for values in self.values["coupled"] if min(values.restitutions) > 0.0]
        timesteps = BOUNCING_TIMESTEPS[self.local]
        return Grid({"coupled": coupled}, timesteps, timesteps, self.local)

    def without_bouncing(self) -> Grid:
        """The other points."""
        coupled = [values for values in self.values["coupled"] if min(values.restitutions) == 0.0]
        return dataclasses.replace(self, values={**self.values, "coupled": coupled})

    def laws(self, probe: Probe, cone: str, timestep: float) -> Iterator[ProbeLaw]:
        laws = (law_of(*point, cone, timestep) for point in self.points(probe))
        return (law for law in laws if probe.applies(law))


FIRST_RESTITUTION, LAST_RESTITUTION = 0.5, 0.9
"""Of coupled probes: the first grid has the former, 0.35, 0.7 and 1, where a bounce loses no energy; the other has 0.25 and the
latter. Engines but MuJoCo and PyBullet were measured without 0.35 and 0.7, MuJoCo and PyBullet with them at 1 to 8 ms."""
BOUNCING_TIMESTEPS = ((1.0, 2.0, 4.0, 8.0, 16.0), (20.0, 8.0, 2.0, 0.5))
"""ms, of coupled probes with restitution: of the first grid, and between."""
RATIOS = (1.0, 10.0, 100.0, 1000.0)
_RESTING = (0.0, DROP_RESTITUTION)
TABLES = Grid(
    {
        "impact": [Values((0.0, 0.1, 0.3, 0.6, 1.0), (0.0, 0.5, 1.0))],
        "stack": [Values((0.5,), _RESTING, RATIOS)],
        "sliding stack": [Values((0.05, 0.1, 0.3, 0.6, 1.2), _RESTING, (1.0, 4.0, *RATIOS[1:]))],
        "coupled": [
            Values((0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.2)),
            Values((0.05, 0.2, 0.5, 0.8, 1.2), (0.35, FIRST_RESTITUTION, 0.7, 1.0)),
        ],
    },
    (1.0, 4.0),
    (1.0, 4.0),
)
_BETWEEN_RATIOS = (1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0, 50.0, 100.0, 150.0, 300.0, 600.0, 1000.0)
BETWEEN = Grid(
    {
        "impact": [Values((0.5, 0.8, 1.5), (0.0, 0.5))],
        "stack": [
            Values((0.0, 0.25, 0.5, 0.8, 1.0, 1.5), (0.0,), _BETWEEN_RATIOS),
            Values((0.5,), (DROP_RESTITUTION,), _BETWEEN_RATIOS),
        ],
        "sliding stack": [Values((0.2, 0.45, 0.8, 1.0, 1.5), _RESTING, _BETWEEN_RATIOS)],
        "coupled": [
            Values((0.25, 0.7, 0.9, 1.1, 1.5, 2.0)),
            Values((0.07, 0.25, 0.7, 1.0, 1.5), (0.25, LAST_RESTITUTION)),
        ],
        "pair": [Values((0.07, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0), (0.0, 0.25, 0.6, 0.9))],
    },
    (20.0, 16.0, 12.5, 10.0, 8.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.7, 0.5, 0.2),
    (20.0, 16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.2),
    local=True,
)
SOME = 0.01
"""Restitution from which rows of probes with restitution count."""
LONGEST = 22.0
"""ms: local rows of the largest timestep count below it."""
IMPACTS = ("strike", "row", "edge")


def kind_of(probe: Probe) -> str:
    kinds = dict.fromkeys(IMPACTS, "impact") | {"stack": "stack", "stack-slides": "sliding stack"}
    return kinds.get(probe.NAME) or ("coupled" if probe.NAME in COUPLED else "pair")


def bounces(probe: str, restitution: float) -> bool:
    """Whether a figure, or a row that counts from a restitution on, is of a coupled probe with restitution."""
    return bool(restitution) and kind_of(probe_of(probe)) == "coupled"


def law_of(friction: float, restitution: float, ratio: float, cone: str, timestep: float) -> ProbeLaw:
    reach = MaterialReach(True, True, True, True, ratio, 3, crosses=True, jams=True, squeezes=True, plane=True)
    return ProbeLaw(PairContact("base", "body", friction, restitution), cone, timestep, reach=reach)


def probe_of(name: str) -> Probe:
    """A probe that is measured at the points of the figure ``name``: for figures of other names one of its kind."""
    if name in SLIDING:
        return PROBES["stack-slides"]
    several = [probe for probe in COUPLED.values() if name.startswith(probe.NAME)]
    return max(several, key=lambda probe: len(probe.NAME)) if several else PROBES["push"]
