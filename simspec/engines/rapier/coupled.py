"""How far Rapier 0.36.1 is from the law in contact of several bodies, and what of it must be accepted by name.

Measured by ``tools/coupled.py`` at 1 to 16 ms, frictions of 0.2 to 1, restitutions of 0 to 1 and ratios of masses of 1 to 1000;
each size with 15 % more.
"""

from __future__ import annotations

from simspec.engines.kit.coupled import by_ratio, by_timestep, heavy_on_light
from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Support

_LEANS = "steps of 4 ms and more are few for what clamps or slips"
_HEAVY = "sweeps over one contact after another leave overlaps where heavy bodies lie on light ones"
_SPINS = "friction acts aside of the slip where a body spins as it slides"

DEVIATIONS: tuple[Deviation, ...] = (
    *by_timestep("clamp", _LEANS, {0.004: 0.00041}, relative=False),
    *by_timestep(
        "pile-slips",
        _LEANS,
        {0.016: 0.085},
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {
            0.001: (0, 0, 0.00021),
            0.002: (0, 0, 0.00092),
            0.004: (0, 0.00047, 0.0056),
            0.008: (0, 0.0019, 0.12),
            0.016: (0, 0.12, 0.12),
        },
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {
            0.001: (0, 0, 0.00084),
            0.002: (0, 0.00061, 0.0037),
            0.004: (0, 0.0055, 0.039),
            0.008: (0.00047, 0.007, 0.19),
            0.016: (0.0043, 0.36, 0.36),
        },
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.001: 0.52, 0.002: 0.54},
    ),
)
"""See the module."""
MASS_RATIO: Support = heavy_on_light(
    {0.0: 100.1, 0.002: 10.01, 0.008: 0.0},
    "heavy bodies sink into light ones, and push them aside: 0.2 and 0.8 mm at a ratio of 1000 "
    "and 1 ms; with iterations of 500 a tenth of it",
    "1000 times the mass sinks 0.2 mm in and moves 0.8 mm aside at 1 ms",
)
