"""What Rapier has of cylinders: its search for the nearest points of round shapes ends before single precision does.

*Measured*, rapier3d 0.36.1: six random pairs of sizes, 60 random poses each, twice, 10 µm to 2 mm deep, against coal.

- With capsules 31 of 720 overlaps are missed, the deepest 38 µm; depths are up to 84 µm off (median 5 µm), normals up to 0.024
  rad (median 0.005).
- With each other one is missed, of 11 µm; depths are off by 0.25 µm (median) to 22 µm; normals by 7e-4 rad (median), 0.01 rad
  in 1 of 100, and by 0.1 and 0.9 rad where rims meet aslant.
- With boxes two are missed, the deepest 22 µm; depths are up to 9 µm off, normals by 2e-6 rad (median), 0.008 rad in 1 of 100,
  0.16 at most. With hulls alike: three are missed, the deepest 18 µm.
- With planes and balls all is right to 3e-7 m and 4e-6 rad, none missed.

Flat on flat they are exact: towers of seven stand as of boxes. Balls, capsules and boxes with each other are right to 3e-7 m.
"""

from __future__ import annotations

from collections.abc import Mapping

from simspec.engines.kit.refinements import approximate_pairs, met_pairs
from simspec.support.declarations import Refinement
from simspec.world.types import World

_FLAT = "flat on flat is exact; aslant "
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("box", "cylinder"): f"{_FLAT}one of 360 overlaps is missed (by 22 µm), the normal is 0.008 rad off in 1 of 100",
    (
        "capsule",
        "cylinder",
    ): "4 of 100 overlaps are missed (by up to 38 µm), depths are up to 84 µm off, normals 0.024 rad",
    (
        "cylinder",
        "cylinder",
    ): f"{_FLAT}one of 720 overlaps is missed, the normal is 0.01 rad off in 1 of 100 (0.9 rad once)",
    ("cylinder", "mesh"): f"{_FLAT}one of 240 overlaps is missed (by 18 µm), the normal is 0.008 rad off in 1 of 100",
}
"""Of pairs of kinds, what is lost."""
SHORT = "aslant normals of cylinders are 0.01 rad off, and 0.1 to 4 % of overlaps of 10 to 40 µm are missed"
CYLINDERS = approximate_pairs(APPROXIMATE, SHORT)
"""Where all of these pairs may meet, for tables."""


def cylinders(world: World) -> Refinement | None:
    """Cylinders that may meet more than planes and balls."""
    met = met_pairs(world, APPROXIMATE)
    return approximate_pairs(met, SHORT) if met else None
