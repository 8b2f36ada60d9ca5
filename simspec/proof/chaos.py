"""Worlds whose contact-free motion cannot be compared, since round-off alone makes two computations of it differ."""

from __future__ import annotations

from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import DOUBLE
from simspec.proof import motion
from simspec.proof.motionless import motionless
from simspec.proof.precision import PRECISIONS
from simspec.proof.touch.plan import oracle_of
from simspec.world.canonical import derived
from simspec.world.types import World


@derived
def chaotic(world: World, precision: str = DOUBLE) -> str:
    """Why level L6 cannot compare the motion of a world in numbers of a precision; "" where it can.

    From the world alone, so that a certificate that says so can be judged. It costs a plan of the motion.
    """
    if motionless(world):
        return ""
    oracle: Oracle = oracle_of(world)
    planned = motion.plan(world, oracle, PRECISIONS[precision])
    return planned.chaos
