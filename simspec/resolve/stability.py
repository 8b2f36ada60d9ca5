"""Joints whose own damping or spring, and bodies whose resistance by a fluid, diverges at the world's timestep."""

from __future__ import annotations

from simspec.errors import Problem
from simspec.language.locate import locate
from simspec.language.sources import Source
from simspec.world.types import World


def unstable_joints(source: Source, world: World) -> list[Problem]:
    """One problem for each tree that has such joints. Without Pinocchio, which knows the mass matrix, nothing can be told."""
    own = any(body.joint.damping or body.joint.angular_damping or body.joint.spring_stiffness for body in world.bodies)
    fluid = world.physics.fluid
    own = own or (fluid is not None and fluid.viscosity > 0.0)
    if not own and not any(one.damping or one.stiffness for one in world.sums):
        return []
    try:
        from simspec.dynamics.stability import SingularError, unstable

        try:
            instabilities = unstable(world)
        except SingularError as error:
            path = f"bodies.{error.root}"
            message = "the mass matrix of this body and what hangs on it is singular in double precision"
            hint = "masses and moments of inertia that are not 1e16 times as large as others of the same tree"
            return [Problem(message, path, locate(source, path), hint=hint)]
    except ModuleNotFoundError:
        return []
    problems = []
    for instability in instabilities:
        path = f"bodies.{instability.bodies[0]}.joint." + ("damping" if instability.damping else "spring.stiffness")
        if instability.along:
            path = f"constraints.{instability.along}.sum." + ("damping" if instability.damping else "stiffness")
        if instability.fluid:
            path = "physics.fluid.viscosity"
        largest = f"up to {instability.largest_stable_step:.3g} s"
        less = "viscosity" if instability.fluid else "damping" if instability.damping else "stiffness"
        hint = f"less {less}; or a smaller physics.timestep"
        found_there = f"a timestep of {instability.timestep:g} s"
        problems.append(
            Problem(str(instability), path, locate(source, path), found=found_there, allowed=largest, hint=hint)
        )
    return problems
