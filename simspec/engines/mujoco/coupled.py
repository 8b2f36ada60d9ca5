"""Contact of several bodies in MuJoCo: what has to be accepted by name, and how far it is from the law.

The table is measured with MuJoCo 4.0.1 by ``tools/deviations.py`` at 0.5 to 16 ms, frictions of 0.05 to 1.2, restitutions of 0
to 1 and ratios of masses of 1 to 1000. MuJoCo's friction takes slip back at 100/s (setting
``friction_rate``) instead of within a step, so that it lags where normal forces change quickly or the direction of slip
turns. Coulomb's law around the solver (``friction: coulomb``) has none of that up to 4 ms.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from simspec.engines.kit.coupled import even_pressure, heavy_on_light, in_force, self_locking
from simspec.engines.kit.deviations import Deviation, Reason, read_deviations
from simspec.support.declarations import Refine, Refinement, Support, approximate
from simspec.support.features import Feature
from simspec.world.types import World

_LEANS = "friction takes slip back at a rate of 100/s, so that what leans settles by millimetres, and slips too far"
_PYRAMID = "under the pyramid what slides hops, and friction has no reference of its own"
_TOGETHER = "most of the friction of an impact is missing (accepted by name: contact.friction.impact)"
_ROW = "contacts with restitution are springs of some steps, which act one after the other: the last ball of a row leaves alone"
_HEAVY = "1 % of an overlap is taken back in a step, after 0.1 % of gravity: heavy bodies rest deeper, with dt squared"
_CARRIED = "what turns slips outwards at its acceleration over the friction rate of 100/s, whatever the timestep"
_SPINS = "friction lags behind normal forces that change as a body tilts or spins"
_FEW = "steps of some ms are few for what slips, clamps, spins or lies on crossing edges"
_LOOP = "the loop around MuJoCo's solver ends before friction and normal forces fit each other"
_LIFTED = "what slides is lifted, the cone being associated, so that it weighs on what is below it by turns"
_CREEPS = "friction near its limit creeps, the more the heavier the body that pushes"
_UNKNOWN = "measured; the cause is not known"
HELD = "friction of what is carried by a loop around MuJoCo's solver at every step (friction: coulomb)"
_NATIVE, _INSCRIBED = "friction=native", "pyramid-inscribed"

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (
        Reason("row*", _ROW),
        Reason("strike* edge*", _TOGETHER),
        Reason("stack-slides*", _LIFTED, _NATIVE),
        Reason("stack-stays*", _CREEPS),
        Reason("stack-slides*", _LOOP),
        Reason("stack-sideways", _UNKNOWN),
        Reason("stack", _HEAVY),
        Reason("carrier", _CARRIED),
        Reason("rod* clamp* jam* squeeze* pile* slide-spin", _PYRAMID, _NATIVE, _INSCRIBED),
        Reason("rod* clamp* jam* squeeze* pile*", _LEANS, _NATIVE),
        Reason("slide-spin", _SPINS, _NATIVE),
        Reason("jam*", _LOOP),
        Reason("*", _FEW),
    ),
)


def coupled_support(by_coulomb: Refinement, asked: Refine) -> Mapping[Feature, Support]:
    """Declarations of contact of several bodies; ``asked``: the refinement of worlds that request Coulomb's law."""
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
        Feature.SELF_LOCKING: self_locking(
            DEVIATIONS,
            in_force("mujoco"),
            "a clamp that jams slips by 20 mm in 0.3 s at 1 ms, and falls where a hundredth of the moment of its weight "
            "presses it on; by friction: coulomb it creeps by 0.5 mm at μ = 0.05 under the elliptic cone and 1 ms, and by "
            "5 mm at 4 ms, and falls under the pyramid at μ = 0.4 and 0.5 ms",
            "a clamp that jams slips by 20 mm in 0.3 s, or falls where little but friction presses it on",
        ),
        Feature.EVEN_PRESSURE: even_pressure(
            DEVIATIONS,
            in_force("mujoco"),
            "what slips between fingers falls 6 % too slowly under the pyramid, and from 4 ms on 7 to 15 % too far, turning "
            "by up to 0.14 rad; what they hold creeps by 0.5 mm at 4 ms, and falls at 16 ms",
            "from 4 ms on boxes between fingers creep by 0.5 mm, and turn as they slip",
        ),
        Feature.MASS_RATIO: heavy_on_light(
            # how native friction slides is accepted as contact.friction.impact
            [
                row
                for row in DEVIATIONS
                if row.setting != ("friction", "native") or not row.probe.startswith("stack-slides")
            ],
            in_force("mujoco"),
            "heavy bodies sink into light ones: by 0.25 mm at a ratio of 1000 and 1 ms, with the square of the timestep; what "
            "stands under one that slides is taken along at 1000, from 2 ms on. By friction: coulomb what slides with 1000 "
            "times its mass on it stops 10 % short at 1 ms, with 100 times 7 % at 4 ms",
            "1000 times the mass rests 0.25 mm deep at 1 ms, 50 mm at 16 ms",
        ),
    }
