"""How far SAPIEN 3.0.3 is from the law in contact of several bodies, and what of it must be accepted by name.

Measured by ``tools/coupled.py`` at 1 to 16 ms, frictions of 0.2 to 1, restitutions of 0 to 1 and ratios of masses of 1 to 1000;
each size with 15 % more.
"""

from __future__ import annotations

from simspec.engines.kit.coupled import by_ratio, by_timestep, heavy_on_light
from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Support

_LEANS = "friction holds what leans or is piled by a spring to where it lay: it slips too little near its threshold"
_HEAVY = "sweeps over one contact after another leave overlaps where heavy bodies lie on light ones"
_SPINS = "friction acts aside of the slip where a body spins as it slides"

DEVIATIONS: tuple[Deviation, ...] = (
    *by_timestep(
        "rod-slips",
        _LEANS,
        {0.001: 1.2},
    ),
    *by_timestep("clamp", _LEANS, {0.001: 0.0027}, relative=False),
    *by_timestep("pile", _LEANS, {0.016: 0.15}, relative=False),
    *by_timestep(
        "pile-slips",
        _LEANS,
        {0.001: 1.2, 0.016: 1.3},
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {
            0.001: (0, 0, 0.00029),
            0.002: (0, 0, 0.0059),
            0.004: (0, 0.00084, 0.12),
            0.008: (0, 0.12, 0.12),
            0.016: (0.12, 0.12, 0.12),
        },
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {
            0.001: (0, 0, 0.0047),
            0.002: (0, 0.0025, 0.063),
            0.004: (0.0034, 0.054, 0.2),
            0.008: (0.017, 0.24, 0.27),
            0.016: (0.29, 0.29, 3.0),
        },
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.001: 0.73, 0.002: 0.88},
    ),
)
"""See the module."""
MASS_RATIO: Support = heavy_on_light(
    {0.0: 100.1, 0.002: 10.01, 0.004: 0.0},
    "heavy bodies push light ones aside: 4 mm at a ratio of 1000 and 1 ms, and sink through at 4 ms; less with iterations: 255",
    "1000 times the mass moves 4 mm aside at 1 ms, and sinks through at 4 ms",
)
