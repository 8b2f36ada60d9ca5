"""How far Drake 1.51.1 is from the law in contact of several bodies, and what of it must be accepted by name.

Measured by ``tools/coupled.py`` at 1 to 16 ms, frictions of 0.2 to 1, restitutions of 0 to 1 and ratios of masses of 1 to 1000;
each size with 15 % more.
"""

from __future__ import annotations

from simspec.engines.kit.coupled import by_ratio, by_timestep, heavy_on_light
from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Support

_LEANS = "TAMSI's friction is regularised by a speed"
_HEAVY = "sweeps over one contact after another leave overlaps where heavy bodies lie on light ones"
_SPINS = "steps of 2 ms and more are few for a body whose normal forces change as it spins and slides"

DEVIATIONS: tuple[Deviation, ...] = (
    *by_timestep("rod", _LEANS, {0.004: 0.00032}, relative=False),
    *by_timestep("clamp", _LEANS, {0.001: 0.00038}, relative=False),
    *by_timestep(
        "clamp-slips",
        _LEANS,
        {0.001: 0.063, 0.004: 0.86},
    ),
    *by_timestep(
        "pile-slips",
        _LEANS,
        {0.001: 0.043},
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.004: (0.00026, 0.0017, 0.011)},
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {0.004: (0.00027, 0.00027, 0.0003)},
    ),
    *by_timestep("rod", _LEANS, {0.004: 0.00032}, relative=False, setting=("contact_approximation", "sap")),
    *by_timestep("clamp-slips", _LEANS, {0.001: 0.85, 0.004: 0.86}, setting=("contact_approximation", "sap")),
    *by_timestep("pile-slips", _LEANS, {0.001: 0.043}, setting=("contact_approximation", "sap")),
    *by_ratio("stack", _HEAVY, {0.004: (0.00026, 0.0017, 0.011)}, setting=("contact_approximation", "sap")),
    *by_ratio("stack-sideways", _HEAVY, {0.004: (0.00027, 0.00027, 0.0003)}, setting=("contact_approximation", "sap")),
    *by_timestep("slide-spin", _SPINS, {0.001: 4.3, 0.004: 4.7}, setting=("contact_approximation", "sap")),
)
"""See the module."""
MASS_RATIO: Support = heavy_on_light(
    {0.004: 0.0},
    "heavy bodies sink into light ones in steps of 4 ms and more",
    "1000 times the mass sinks in at 4 ms",
)
