"""Joints that begin beyond their limits; joints whose own damping or spring, and bodies whose resistance by a fluid, diverges
at the world's timestep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from simspec.errors import Problem
from simspec.language.joints import OUTSIDE, scaled_to, within
from simspec.language.joints import ROUND_OFF as OF_ANGLE
from simspec.language.locate import locate
from simspec.language.sources import Source
from simspec.world.types import Body, World


def beginning_within(source: Source, bodies: Sequence[Body]) -> tuple[tuple[Body, ...], list[Problem]]:
    """The bodies, with initial positions that are beyond a limit by round-off put at the limit; and one problem for each joint
    that begins beyond its limits by more. Engines move such a joint differently: some in one step, some as a stiff spring
    does, some never."""
    placed, problems = [], dict[object, Problem]()
    for body in bodies:
        joint, problem = body.joint, None
        if joint.position_limits is not None:
            position = within(joint.position[0], joint.position_limits)
            if position is None:
                problem = _beyond(source, body, joint.position_limits)
            elif position != joint.position[0]:
                body = replace(body, joint=replace(joint, position=(position,)))
        elif joint.angle_limit is not None:
            w, *vector = joint.position
            angle = 2.0 * math.atan2(math.hypot(*vector), abs(w))
            if angle > joint.angle_limit + OF_ANGLE:
                shown = ", ".join(f"{value:.9g}" for value in scaled_to(joint.position, joint.angle_limit))
                problem = _problem(
                    source,
                    body,
                    f"{angle:.9g} rad",
                    f"0 to {joint.angle_limit:g} rad",
                    f"position: {{quat: [{shown}]}}",
                )
        placed.append(body)
        if problem is not None:  # once for all copies of a model
            problems.setdefault(problem.location or problem.path, problem)
    return tuple(placed), list(problems.values())


def _beyond(source: Source, body: Body, limits: tuple[float, float]) -> Problem:
    position, unit = body.joint.position[0], "rad" if body.joint.kind == "hinge" else "m"
    allowed = min(max(position, limits[0]), limits[1])
    spread = f"{limits[0]:.9g} to {limits[1]:.9g} {unit}"
    return _problem(source, body, f"{position:.9g} {unit}", spread, f"position: {allowed!r}")


def _problem(source: Source, body: Body, found: str, allowed: str, nearest: str) -> Problem:
    path = f"bodies.{body.name}.joint.position"
    hint = f"{nearest}, the nearest allowed value; `positions:` where the model is placed"
    message = f"{body.joint.name}: {OUTSIDE}"
    return Problem(message, path, locate(source, path), found=found, allowed=allowed, hint=hint)


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
