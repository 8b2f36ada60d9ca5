"""How far DART 6.20.0 is from the law in contact of several bodies, and what of it must be accepted by name.

Measured by ``tools/coupled.py`` at 1 to 16 ms, frictions of 0.2 to 1, restitutions of 0 to 1 and ratios of masses of 1 to 1000;
each size with 15 % more.
"""

from __future__ import annotations

from simspec.engines.kit.coupled import by_ratio, by_timestep, heavy_on_light
from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Support

_LEANS = (
    "Dantzig's friction is bound by the normal forces of the frictionless problem: none where friction alone presses"
)
_TOGETHER = "friction in an impact on an edge is bound by the normal impulse of the frictionless problem"
_CREEPS = "NSGS stops at a residual of 1e-5, and a pile on little friction creeps by it (setting tolerance)"
_HEAVY = "sweeps over one contact after another leave overlaps where heavy bodies lie on light ones"
_SPINS = "steps of 2 ms and more are few for a body whose normal forces change as it spins and slides"

DEVIATIONS: tuple[Deviation, ...] = (
    *by_timestep(
        "pile",
        _CREEPS,
        {0.001: 0.0015, 0.002: 0.0023, 0.004: 0.0038, 0.008: 0.0054},
        relative=False,
        setting=("contact_solver", "nsgs"),
    ),
    *by_timestep(
        "pile", _LEANS, {0.001: 0.11}, relative=False, friction_cone="elliptic", setting=("contact_solver", "dantzig")
    ),
    *by_timestep("pile-slips", _LEANS, {0.016: 0.23}, friction_cone="elliptic", setting=("contact_solver", "nsgs")),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.002: (0, 0, 0.00015), 0.004: (0, 0, 0.089), 0.008: (0, 0, 0.13), 0.016: (0, 0.12, 0.12)},
        friction_cone="elliptic",
        setting=("contact_solver", "nsgs"),
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {0.002: (0, 0, 0.00085), 0.004: (0, 0.00017, 0.22), 0.008: (0, 0.00079, 0.32), 0.016: (0, 0.33, 0.34)},
        friction_cone="elliptic",
        setting=("contact_solver", "nsgs"),
    ),
    *by_timestep(
        "pile-slips", _LEANS, {0.016: 0.22}, friction_cone="pyramid-circumscribed", setting=("contact_solver", "nsgs")
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.002: (0, 0, 0.00015), 0.004: (0, 0, 0.0009), 0.008: (0, 0, 0.12), 0.016: (0, 0.12, 0.12)},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "nsgs"),
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {0.002: (0, 0, 0.00085), 0.004: (0, 0, 0.0097), 0.008: (0, 0.00039, 0.3), 0.016: (0, 0.48, 0.48)},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "nsgs"),
    ),
    *by_timestep(
        "rod",
        _LEANS,
        {0.001: 0.16, 0.016: 0.5},
        relative=False,
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep("rod-slips", _LEANS, {0.001: 2.4}, friction_cone="elliptic", setting=("contact_solver", "dantzig")),
    *by_timestep(
        "clamp",
        _LEANS,
        {0.001: 0.75, 0.016: 1.5},
        relative=False,
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep("clamp-slips", _LEANS, {0.001: 8.0}, friction_cone="elliptic", setting=("contact_solver", "dantzig")),
    *by_timestep(
        "pile-slips",
        _LEANS,
        {0.001: 2.9},
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep("edge", _TOGETHER, {0.001: 0.14}, friction_cone="elliptic", setting=("contact_solver", "dantzig")),
    *by_timestep(
        "edge",
        _TOGETHER,
        {0.001: 0.14},
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
        restitution=0.01,
    ),
    *by_timestep(
        "edge-energy",
        _TOGETHER,
        {0.001: 0.2},
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
        restitution=0.01,
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.004: (0, 0, 0.0002), 0.008: (0, 0, 0.00077), 0.016: (0, 0.0004, 0.0072)},
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.001: 0.51, 0.002: 0.69},
        friction_cone="elliptic",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "rod",
        _LEANS,
        {0.001: 0.16, 0.016: 0.5},
        relative=False,
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "rod-slips", _LEANS, {0.001: 2.4}, friction_cone="pyramid-circumscribed", setting=("contact_solver", "dantzig")
    ),
    *by_timestep(
        "clamp",
        _LEANS,
        {0.001: 0.75, 0.016: 1.5},
        relative=False,
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "clamp-slips",
        _LEANS,
        {0.001: 8.0},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "pile",
        _LEANS,
        {0.001: 0.079, 0.002: 0.08, 0.004: 0.084, 0.016: 0.087},
        relative=False,
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "pile-slips",
        _LEANS,
        {0.001: 2.9},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "edge", _TOGETHER, {0.001: 0.14}, friction_cone="pyramid-circumscribed", setting=("contact_solver", "dantzig")
    ),
    *by_timestep(
        "edge",
        _TOGETHER,
        {0.001: 0.14},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
        restitution=0.01,
    ),
    *by_timestep(
        "edge-energy",
        _TOGETHER,
        {0.001: 0.2},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
        restitution=0.01,
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {0.004: (0, 0, 0.0002), 0.008: (0, 0, 0.00077), 0.016: (0, 0.0004, 0.0072)},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.001: 0.31, 0.002: 0.32},
        friction_cone="pyramid-circumscribed",
        setting=("contact_solver", "dantzig"),
    ),
)
"""See the module."""
MASS_RATIO: Support = heavy_on_light(
    {0.002: 100.1, 0.004: 10.01},
    "NSGS leaves overlaps where heavy bodies lie on light ones, in steps of 2 ms and more",
    "1000 times the mass sinks through at 4 ms",
)
