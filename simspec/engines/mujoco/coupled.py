"""Contact of several bodies in MuJoCo: what has to be accepted by name, and how far it is from the law.

Measured with MuJoCo 4.0.1 by ``tools/coupled.py`` at 0.5 to 16 ms, frictions of 0.05 to 1.3, restitutions of 0 to 1 and
ratios of masses of 1 to 1000; each size with 15 % more. MuJoCo's friction takes slip back at 100/s (setting
``friction_rate``) instead of within a step, so that it lags where normal forces change quickly or the direction of slip
turns. Coulomb's law around the solver (``friction: coulomb``) has none of that up to 4 ms.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from simspec.engines.kit.coupled import by_ratio, by_timestep, heavy_on_light
from simspec.engines.kit.deviations import Deviation
from simspec.support.declarations import Refine, Refinement, Support, approximate
from simspec.support.features import Feature
from simspec.world.types import World

_LEANS = "friction takes slip back at a rate of 100/s, so that what leans settles by millimetres, and slips too far"
_TOGETHER = "most of the friction of an impact is missing (accepted by name: contact.friction.impact)"
_ROW = "contacts with restitution are springs of some steps, which act one after the other: the last ball of a row leaves alone"
_HEAVY = "1 % of an overlap is taken back in a step, after 0.1 % of gravity: heavy bodies rest deeper, with dt squared"
_CARRIED = "what turns slips outwards at its acceleration over the friction rate of 100/s, whatever the timestep"
HELD = "friction of what is carried by a loop around MuJoCo's solver at every step (friction: coulomb)"
_SPINS = "friction lags behind normal forces that change as a body tilts or spins"

DEVIATIONS: tuple[Deviation, ...] = (
    *by_timestep("edge", _TOGETHER, {0.0005: 0.13}, friction_cone="elliptic", setting=("friction", "native")),
    *by_timestep("edge-energy", _TOGETHER, {0.0005: 0.47}, friction_cone="elliptic", setting=("friction", "native")),
    *by_timestep("clamp", _LEANS, {0.004: 0.0018}, relative=False, setting=("friction", "coulomb")),
    *by_timestep(
        "rod",
        _LEANS,
        {0.0005: 0.00044, 0.001: 0.00049, 0.002: 0.0006, 0.004: 0.011, 0.008: 0.04, 0.016: 0.28},
        relative=False,
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "rod-slips",
        _LEANS,
        {0.0005: 0.1, 0.001: 0.11, 0.002: 0.13, 0.004: 0.25, 0.008: 0.55, 0.016: 0.88},
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "clamp",
        _LEANS,
        {0.0005: 0.0045, 0.001: 0.0047, 0.002: 0.0049, 0.004: 0.0056, 0.008: 0.075, 0.016: 0.22},
        relative=False,
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "clamp-slips",
        _LEANS,
        {0.004: 0.57, 0.008: 0.82, 0.016: 1.4},
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "pile",
        _LEANS,
        {0.0005: 0.00055, 0.001: 0.00068, 0.002: 0.00083, 0.004: 0.0019, 0.008: 0.011, 0.016: 0.16},
        relative=False,
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "pile-slips",
        _LEANS,
        {0.0005: 0.29, 0.001: 0.38, 0.002: 0.69, 0.004: 0.99, 0.008: 2.1, 0.016: 3.9},
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep("strike", _TOGETHER, {0.0005: 0.48}, friction_cone="elliptic", setting=("friction", "native")),
    *by_timestep(
        "strike", _TOGETHER, {0.0005: 0.32}, friction_cone="elliptic", setting=("friction", "native"), restitution=0.01
    ),
    *by_timestep("strike-energy", _TOGETHER, {0.0005: 0.38}, friction_cone="elliptic", setting=("friction", "native")),
    *by_timestep(
        "strike-energy",
        _TOGETHER,
        {0.0005: 0.45},
        friction_cone="elliptic",
        setting=("friction", "native"),
        restitution=0.01,
    ),
    *by_timestep(
        "row", _ROW, {0.0005: 1.2}, friction_cone="elliptic", setting=("friction", "native"), restitution=0.01
    ),
    *by_timestep(
        "row-energy", _ROW, {0.0005: 0.19}, friction_cone="elliptic", setting=("friction", "native"), restitution=0.01
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {
            0.001: (0, 0, 0.00031),
            0.002: (0, 0.00014, 0.0012),
            0.004: (0, 0.00055, 0.0048),
            0.008: (0.00034, 0.0022, 0.019),
            0.016: (0.0014, 0.0087, 0.059),
        },
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "carrier",
        _CARRIED,
        {0.0005: 0.022, 0.004: 0.026, 0.008: 0.055, 0.016: 0.24},
        relative=False,
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.0005: 0.16, 0.001: 0.17, 0.002: 0.94, 0.004: 1.4, 0.016: 1.6},
        friction_cone="elliptic",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "rod",
        _LEANS,
        {0.004: 0.00034},
        relative=False,
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "rod-slips",
        _LEANS,
        {0.008: 0.11, 0.016: 0.21},
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "clamp",
        _LEANS,
        {0.001: 0.00033, 0.002: 0.00041},
        relative=False,
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "clamp-slips",
        _LEANS,
        {0.0005: 0.8, 0.001: 0.85, 0.002: 0.86},
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "pile-slips",
        _LEANS,
        {0.0005: 0.045, 0.001: 0.046, 0.004: 0.047, 0.016: 0.23},
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "strike",
        _TOGETHER,
        {0.0005: 0.24},
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
        restitution=0.01,
    ),
    *by_timestep(
        "row", _ROW, {0.0005: 1.2}, friction_cone="pyramid-inscribed", setting=("friction", "native"), restitution=0.01
    ),
    *by_timestep(
        "row-energy",
        _ROW,
        {0.0005: 0.19},
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
        restitution=0.01,
    ),
    *by_ratio(
        "stack", _HEAVY, {0.016: (0, 0, 0.00012)}, friction_cone="pyramid-inscribed", setting=("friction", "native")
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {0.004: (0.00051, 0.00051, 0.00051)},
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.0005: 1.7, 0.002: 1.8, 0.008: 1.9},
        friction_cone="pyramid-inscribed",
        setting=("friction", "native"),
    ),
    *by_timestep(
        "rod",
        _LEANS,
        {0.008: 0.0012, 0.016: 0.0046},
        relative=False,
        friction_cone="elliptic",
        setting=("friction", "coulomb"),
    ),
    *by_timestep(
        "clamp",
        _LEANS,
        {0.008: 0.00034, 0.016: 0.0011},
        relative=False,
        friction_cone="elliptic",
        setting=("friction", "coulomb"),
    ),
    *by_timestep(
        "clamp-slips", _LEANS, {0.008: 0.46, 0.016: 2.2}, friction_cone="elliptic", setting=("friction", "coulomb")
    ),
    *by_timestep("pile-slips", _LEANS, {0.016: 0.39}, friction_cone="elliptic", setting=("friction", "coulomb")),
    *by_timestep(
        "row", _ROW, {0.0005: 1.2}, friction_cone="elliptic", setting=("friction", "coulomb"), restitution=0.01
    ),
    *by_timestep(
        "row-energy", _ROW, {0.0005: 0.19}, friction_cone="elliptic", setting=("friction", "coulomb"), restitution=0.01
    ),
    *by_ratio(
        "stack",
        _HEAVY,
        {
            0.001: (0, 0, 0.00031),
            0.002: (0, 0.00014, 0.0012),
            0.004: (0, 0.00055, 0.0048),
            0.008: (0.00034, 0.0022, 0.019),
            0.016: (0.0014, 0.0087, 0.059),
        },
        friction_cone="elliptic",
        setting=("friction", "coulomb"),
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.002: 0.036, 0.004: 0.042, 0.008: 0.11, 0.016: 0.57},
        friction_cone="elliptic",
        setting=("friction", "coulomb"),
    ),
    *by_timestep(
        "rod",
        _LEANS,
        {0.004: 0.0004},
        relative=False,
        friction_cone="pyramid-inscribed",
        setting=("friction", "coulomb"),
    ),
    *by_timestep(
        "clamp-slips",
        _LEANS,
        {0.008: 0.53, 0.016: 2.1},
        friction_cone="pyramid-inscribed",
        setting=("friction", "coulomb"),
    ),
    *by_timestep(
        "pile-slips", _LEANS, {0.016: 0.36}, friction_cone="pyramid-inscribed", setting=("friction", "coulomb")
    ),
    *by_timestep(
        "row", _ROW, {0.0005: 1.2}, friction_cone="pyramid-inscribed", setting=("friction", "coulomb"), restitution=0.01
    ),
    *by_timestep(
        "row-energy",
        _ROW,
        {0.0005: 0.19},
        friction_cone="pyramid-inscribed",
        setting=("friction", "coulomb"),
        restitution=0.01,
    ),
    *by_ratio(
        "stack", _HEAVY, {0.016: (0, 0, 0.00012)}, friction_cone="pyramid-inscribed", setting=("friction", "coulomb")
    ),
    *by_ratio(
        "stack-sideways",
        _HEAVY,
        {0.004: (0.00033, 0.00033, 0.00033)},
        friction_cone="pyramid-inscribed",
        setting=("friction", "coulomb"),
    ),
    *by_timestep(
        "slide-spin",
        _SPINS,
        {0.002: 0.075, 0.004: 0.16, 0.008: 0.19, 0.016: 0.53},
        friction_cone="pyramid-inscribed",
        setting=("friction", "coulomb"),
    ),
)
"""See the module."""


def coupled_support(by_coulomb: Refinement, asked: Refine) -> Mapping[Feature, Support]:
    """What MuJoCo declares of contact of several bodies; ``asked``: the refinement of worlds that ask for Coulomb's law."""
    held = dataclasses.replace(by_coulomb, short=HELD)

    def carried(world: World) -> Refinement | None:
        return held if asked(world) else None

    return {
        Feature.CARRIED_FRICTION: approximate(
            "a body at rest on something that turns, or on a surface that moves, slips at a / friction_rate, a the "
            "acceleration by which its carrier's velocity turns or changes there, whatever the timestep: at 100/s and 1 rad/s "
            "by 8 mm/s at 0.8 m from the axis, without end; engines.mujoco.settings: {friction: coulomb} holds it at 1.3 to "
            "1.6 times the time of a step",
            short="what is carried around slips at a / friction_rate: 8 mm/s at 0.8 m and 1 rad/s",
            refine=carried,
            cases=(held,),
        ),
        Feature.MASS_RATIO: heavy_on_light(
            {0.0: 300.0, 0.002: 70.0, 0.004: 20.0, 0.008: 10.0},
            "heavy bodies sink into light ones: by 0.25 mm at a ratio of 1000 and 1 ms, with the square of the timestep",
            "1000 times the mass rests 0.25 mm deep at 1 ms, 50 mm at 16 ms",
        ),
    }
