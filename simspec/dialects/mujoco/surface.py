"""What MJCF's contact numbers mean: from friction, condim, solref and solimp back to a surface of the world.

For the independent reader of files and for the engine's read-back; it shares nothing with what writes these numbers. Every
contact of MuJoCo obeys a₁ + d (b v + k r) = (1 − d) a₀ (its documentation, "Computation": a₀ the acceleration without the
contact, a₁ with it, d the impedance); a spring-damper is an impedance near zero, a rigid contact one near one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from simspec.world.types import Hardness, Surface

MUJOCO_DEFAULT = ((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0))
"""MuJoCo's own solref and solimp."""
SOFT = 1e-3
"""Impedances below this leave a₀ to the other forces, up to a thousandth: springs. MuJoCo allows 1e-4 to 0.9999."""
ROUND_OFF = 1e-12
"""How far the error reduction, a quotient by the timestep's square, may be from the common law's."""


@dataclass(frozen=True, slots=True)
class CommonLaw:
    """What says that a contact holds the common law: the timestep, and the settings that give it its numbers."""

    timestep: float
    error_reduction: float
    solimps: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, timestep: float, settings: Mapping[str, Any]) -> CommonLaw:
        """From a sidecar's settings; the two impedances are the rigid one, and native friction's with its soft first touch."""
        high, cushion = float(settings["contact_impedance"]), float(settings["friction_cushion"])
        rigid = (high, high, 0.001, 0.5, 2.0)
        soft = () if settings["friction"] == "coulomb" else ((0.01, high, cushion, 0.5, 2.0),)
        return cls(timestep, float(settings["contact_error_reduction"]), (rigid, *soft))


def surface(
    condim: int,
    friction: Sequence[float],
    solref: Sequence[float],
    solimp: Sequence[float],
    common: CommonLaw,
    inverse_mass: float = 1.0,
) -> Surface:
    """The surface that one geom or one explicit pair holds.

    ``friction``: sliding, torsional, rolling.
    ``inverse_mass`` (1/kg): of an explicit pair the sum of both bodies'; a geom holds what it would be at 1 kg.
    """
    hardness = _hardness(solref, solimp, common, inverse_mass)
    return Surface(
        float(friction[0]) if condim >= 3 else 0.0,
        float(friction[1]) if condim >= 4 else 0.0,
        float(friction[2]) if condim >= 6 else 0.0,
        _restitution(float(solref[1]), common.timestep) if hardness.kind == "common" else 0.0,
        hardness,
    )


def _restitution(damping: float, timestep: float) -> float:
    """The damping of the common law's reference, per step, is one plus the restitution: the shortest number of which it is."""
    restitution = 0.0 - damping * timestep - 1.0
    # at timesteps of 13 ms and others the product rounds to 1 - 1e-16
    shortest = round(restitution, 14) + 0.0
    return shortest if 0.0 - (1.0 + shortest) / timestep == damping else restitution


def _hardness(solref: Sequence[float], solimp: Sequence[float], common: CommonLaw, inverse_mass: float) -> Hardness:
    stiffness, damping = (float(value) for value in solref)
    if (tuple(solref), tuple(solimp)) == MUJOCO_DEFAULT:
        return Hardness("native")
    constant = solimp[0] == solimp[1]
    if constant and stiffness > 0.0 and solimp[0] <= SOFT:
        return Hardness("time-constant", time_constant=stiffness, damping_ratio=damping)
    taken_back = 0.0 - stiffness * common.timestep * common.timestep
    if tuple(solimp) in common.solimps and abs(taken_back - common.error_reduction) <= ROUND_OFF:
        return Hardness("common")
    # a spring-damper by what holds a load: its depth is (1 − d) a₀ / k
    yielding = inverse_mass * (1.0 - solimp[0])
    if not yielding:
        return Hardness("stiffness")
    return Hardness("stiffness", stiffness=0.0 - stiffness / yielding, damping=0.0 - damping / yielding)
