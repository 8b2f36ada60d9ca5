"""How far PyBullet 3.2.7 is from the law in contact of several bodies, and what of it must be accepted by name.

Measured by ``tools/coupled.py`` at 1 to 16 ms, frictions of 0.2 to 1, restitutions of 0 to 1 and ratios of masses of 1 to 1000;
each size with 15 % more.
"""

from __future__ import annotations

from simspec.engines.kit.coupled import by_ratio, by_timestep, heavy_on_light
from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Support

_LEANS = "steps of 16 ms are few for what slips"
_ASIDE = "the elliptic cone brakes aside of the slip (accepted by name: contact.cone.elliptic)"
_HEAVY = "sweeps over one contact after another leave overlaps where heavy bodies lie on light ones"
_CARRIED = "what lies on a turning carrier moves along its tangent for a step, and shifts as it first settles"
_SPINS = "friction acts aside of the slip where a body spins as it slides"

DEVIATIONS: tuple[Deviation, ...] = (
    *by_timestep("pile-slips", _ASIDE, {0.001: 0.17}, friction_cone="elliptic"),
    *by_timestep("pile-slips", _LEANS, {0.016: 0.2}, friction_cone="elliptic"),
    *by_ratio(
        "stack",
        _HEAVY,
        {
            0.001: (0, 0.00031, 0.0057),
            0.002: (0, 0.0012, 0.023),
            0.004: (0, 0.0048, 0.12),
            0.008: (0, 0.12, 0.12),
            0.016: (0.00017, 0.12, 0.12),
        },
        friction_cone="elliptic",
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {
            0.001: (0, 0.00015, 0.0028),
            0.002: (0, 0.00067, 0.045),
            0.004: (0, 0.004, 0.31),
            0.008: (0, 0.4, 0.4),
            0.016: (0.00031, 0.25, 0.25),
        },
        friction_cone="elliptic",
    ),
    *by_timestep("carrier", _CARRIED, {0.008: 0.00062, 0.016: 0.0025}, relative=False, friction_cone="elliptic"),
    *by_timestep("slide-spin", _SPINS, {0.001: 0.43, 0.002: 0.47}, friction_cone="elliptic"),
    *by_timestep("pile-slips", _LEANS, {0.016: 0.19}, friction_cone="pyramid-circumscribed"),
    *by_ratio(
        "stack",
        _HEAVY,
        {
            0.001: (0, 0.00031, 0.0057),
            0.002: (0, 0.0012, 0.023),
            0.004: (0, 0.0048, 0.12),
            0.008: (0, 0.12, 0.12),
            0.016: (0.0037, 0.12, 0.12),
        },
        friction_cone="pyramid-circumscribed",
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {
            0.001: (0, 0.00014, 0.0027),
            0.002: (0, 0.00066, 0.045),
            0.004: (0, 0.0039, 0.3),
            0.008: (0, 0.27, 0.27),
            0.016: (0.0054, 0.24, 0.24),
        },
        friction_cone="pyramid-circumscribed",
    ),
    *by_timestep(
        "carrier", _CARRIED, {0.008: 0.00062, 0.016: 0.0025}, relative=False, friction_cone="pyramid-circumscribed"
    ),
)
"""See the module."""
MASS_RATIO: Support = heavy_on_light(
    {0.0: 10.01, 0.016: 0.0},
    "heavy bodies sink into light ones: 0.3 mm at a ratio of 100, 5 mm at 1000 (1 ms)",
    "100 times the mass sinks 0.3 mm in at 1 ms, 1000 times 5 mm",
)
