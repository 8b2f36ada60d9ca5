"""How far DART 6.12 of Gazebo is from the law in contact of several bodies, and what of it must be accepted by name.

Measured by ``tools/coupled.py`` at 1 to 16 ms, frictions of 0.2 to 1, restitutions of 0 to 1 and ratios of masses of 1 to 1000;
each size with 15 % more.
"""

from __future__ import annotations

from simspec.engines.kit.coupled import by_ratio, by_timestep, heavy_on_light
from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Support

_LEANS = "bounds of friction follow from the last pass's normal forces"
_HEAVY = "sweeps over one contact after another leave overlaps where heavy bodies lie on light ones"
_SPINS = "steps of 2 ms and more are few for a body whose normal forces change as it spins and slides"

DEVIATIONS: tuple[Deviation, ...] = (
    *by_timestep("rod-slips", _LEANS, {0.001: 1.2}, friction_cone="elliptic", setting=("contact_solver", "dantzig")),
    *by_timestep(
        "pile",
        _LEANS,
        {0.016: 0.00062},
        relative=False,
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep("pile-slips", _LEANS, {0.016: 0.24}, friction_cone="elliptic", setting=("contact_solver", "dantzig")),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.004: (0, 0, 0.0002), 0.016: (0.00016, 0.00045, 0.003)},
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.001: 0.66, 0.004: 0.75},
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "pile-slips",
        _LEANS,
        {0.016: 0.22},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.004: (0, 0, 0.0002), 0.016: (0.00016, 0.00045, 0.003)},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "rod", _LEANS, {0.016: 0.0029}, relative=False, friction_cone="elliptic", setting=("contact_solver", "pgs")
    ),
    *by_timestep("rod-slips", _LEANS, {0.001: 1.2}, friction_cone="elliptic", setting=("contact_solver", "pgs")),
    *by_timestep(
        "clamp",
        _LEANS,
        {0.004: 0.00052, 0.016: 0.0041},
        relative=False,
        friction_cone="elliptic",
        setting=("contact_solver", "pgs"),
    ),
    *by_timestep(
        "pile", _LEANS, {0.016: 0.00059}, relative=False, friction_cone="elliptic", setting=("contact_solver", "pgs")
    ),
    *by_timestep("pile-slips", _LEANS, {0.016: 0.23}, friction_cone="elliptic", setting=("contact_solver", "pgs")),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.001: (0.00027, 0.0035, 0.12), 0.004: (0.0047, 0.12, 0.12), 0.016: (0.12, 0.12, 0.12)},
        friction_cone="elliptic",
        setting=("contact_solver", "pgs"),
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {0.001: (0.00057, 0.006, 0.31), 0.004: (0.022, 0.25, 0.25), 0.016: (0.23, 0.23, 0.27)},
        friction_cone="elliptic",
        setting=("contact_solver", "pgs"),
    ),
    *by_timestep(
        "slide-spin", _SPINS, {0.001: 0.66, 0.004: 0.75}, friction_cone="elliptic", setting=("contact_solver", "pgs")
    ),
    *by_timestep(
        "rod",
        _LEANS,
        {0.016: 0.0029},
        relative=False,
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "pgs"),
    ),
    *by_timestep(
        "clamp",
        _LEANS,
        {0.004: 0.00052, 0.016: 0.0041},
        relative=False,
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "pgs"),
    ),
    *by_timestep(
        "pile",
        _LEANS,
        {0.016: 0.0024},
        relative=False,
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "pgs"),
    ),
    *by_timestep(
        "pile-slips", _LEANS, {0.016: 0.34}, friction_cone="pyramid-circumscribed", setting=("contact_solver", "pgs")
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.001: (0.00027, 0.0035, 0.12), 0.004: (0.0047, 0.12, 0.12), 0.016: (0.12, 0.12, 0.12)},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "pgs"),
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {0.001: (0.00057, 0.006, 0.31), 0.004: (0.022, 0.25, 0.25), 0.016: (0.23, 0.23, 0.27)},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "pgs"),
    ),
)
"""See the module."""
MASS_RATIO: Support = heavy_on_light(
    {0.0: 0.0},
    "pgs leaves overlaps where heavy bodies lie on light ones: 0.3 mm at a ratio of 10, 4 mm at 100 (1 ms)",
    "with pgs 100 times the mass sinks 4 mm in at 1 ms",
    "gazebo",
    ("contact_solver", "pgs"),
)
