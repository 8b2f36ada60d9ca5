"""Checks of the whole world: initial positions within limits, masses and moments that mechanics needs, joints that are
stable."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from simspec.errors import Problem
from simspec.language.joints import OUTSIDE, scaled_to, within
from simspec.language.joints import ROUND_OFF as OF_ANGLE
from simspec.language.locate import locate
from simspec.language.moments import principal_moments
from simspec.language.sources import Source
from simspec.world import frames
from simspec.world.damping import IMPLICIT
from simspec.world.inertia import lumped, rigid_members, singular, summed_inertial
from simspec.world.kinematics import is_carrier, joint_displacement, owner_of
from simspec.world.types import Body, Inertial, Pose, World

# Joints that begin beyond their limits; joints whose own damping or spring, and bodies whose resistance by a fluid, diverges
# at the world's timestep.


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
    return Problem(message, path, locate(source, path), found=found, allowed=allowed, hint=hint, code="S501")


def unstable_joints(source: Source, world: World) -> list[Problem]:
    """One problem for each tree that has such joints. Without Pinocchio, which knows the mass matrix, no statement is
    possible."""
    local = any(
        body.joint.damping or body.joint.angular_damping or body.joint.spring_stiffness for body in world.bodies
    )
    fluid = world.physics.fluid
    local = local or (fluid is not None and fluid.viscosity > 0.0)
    if not local and not any(joint_sum.damping or joint_sum.stiffness for joint_sum in world.sums):
        return []
    try:
        from simspec.dynamics.stability import SingularError, unstable

        try:
            instabilities = unstable(world)
        except SingularError as error:
            path = f"bodies.{error.root}"
            message = "the mass matrix of this body and what hangs on it is singular in double precision"
            hint = "masses and moments of inertia that are not 1e16 times as large as others of the same tree"
            return [Problem(message, path, locate(source, path), hint=hint, code="S506")]
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
        if instability.damping and path.startswith("bodies.") and world.physics.damping != IMPLICIT:
            hint = "physics: {damping: implicit}, which is stable at every timestep; or a smaller physics.timestep"
        found_there = f"a timestep of {instability.timestep:g} s"
        problems.append(
            Problem(
                str(instability), path, locate(source, path), found=found_there, allowed=largest, hint=hint, code="S505"
            )
        )
    return problems


# Whether what moves has an inertia: of bodies that are joined rigidly the sum counts.


def without_inertia(source: Source, bodies: Sequence[Body]) -> list[Problem]:
    """The problems of rigid groups that move and have no mass, or a tensor of inertia that is singular. Single bodies are not
    looked at: ``language/checks.py`` has done so."""
    problems = []
    for top, members in rigid_members(bodies).items():
        others = [body.name for body, _ in members[1:]]
        if not others:
            continue
        whole = summed_inertial((body.inertial, pose) for body, pose in members)
        if not singular(whole):
            continue
        path = f"bodies.{top}"
        names = ", ".join(others[:6]) + (", ..." if len(others) > 6 else "")
        if not whole.mass:
            message, found = f"this body moves, and neither it nor what is fixed to it ({names}) has a mass", None
            hint = "a mass of one of them, or shapes with density"
        else:
            moments = ", ".join(f"{moment:.6g}" for moment in principal_moments(whole.inertia))
            message = f"the principal moments of this body and what is fixed to it ({names}) must be above 0"
            found, hint = f"{moments} kg m²", "a point mass needs others that are not on one line with it"
        problems.append(Problem(message, path, locate(source, path), found=found, hint=hint, code="S506"))
    return problems


def unlike_weights(source: Source, bodies: Sequence[Body], kinematic: Container[str]) -> list[Problem]:
    """The problems of rigid groups that engines receive as a single body and in which bodies have unlike parts of their
    weights, and of kinematic bodies, whose weight counts for nothing, with a part of it."""
    problems = []
    gathers = lumped(World("", tuple(bodies)))
    for top, members in rigid_members(bodies).items():
        scales = {body.gravity_scale for body, _ in members if body.inertial.mass > 0.0}
        named = next((body.name for body, _ in members if body.gravity_scale != 1.0), None)
        if named is None:
            continue
        path = f"bodies.{named}.gravity_scale"
        if top in kinematic:
            message = "the weight of a kinematic body, and of what is fixed to it, counts for nothing"
            problems.append(Problem(message, path, locate(source, path), hint="remove it", code="S410"))
        elif top in gathers and len(scales) > 1:
            message = (
                "bodies that are fixed to each other, one of them without inertia of its own, have one gravity_scale"
            )
            values = ", ".join(f"{scale:g}" for scale in sorted(scales))
            problems.append(Problem(message, path, locate(source, path), found=values, code="S410"))
    return problems


DEPENDENT = 1e-9
"""Smallest eigenvalue of the mass matrix of one body's joints, scaled to a unit diagonal, from which on they are independent:
0 where they move the body in fewer ways than they are many, 1e-16 with round-off."""


def dependent_joints(source: Source, bodies: Sequence[Body]) -> list[Problem]:
    """The problems of bodies with several joints that begin where these move them in fewer directions than there are joints:
    links between such joints have no mass, and could not be accelerated."""
    known = {body.name: body for body in bodies}
    groups = rigid_members(bodies)
    problems = []
    for body in bodies:
        if is_carrier(body.name) or body.joint.parent is None or not is_carrier(body.joint.parent):
            continue
        row = [body]
        while (above := row[0].joint.parent) is not None and is_carrier(above):
            row.insert(0, known[above])
        whole = summed_inertial((member.inertial, pose) for member, pose in groups[body.name])
        mass = _mass_matrix(row, whole)
        scale = np.sqrt(np.diag(mass))
        if scale.min() > 0.0 and np.linalg.eigvalsh(mass / np.outer(scale, scale)).min() > DEPENDENT:
            continue
        path = f"bodies.{owner_of(body.name)}.joints"
        message = "at their initial positions these joints move the body in fewer ways than they are many"
        hint = "axes of hinges through one point that are not in one plane, slides that are not either; or another position"
        problems.append(
            Problem(message, path, locate(source, path), found=f"{len(row)} joints", hint=hint, code="S506")
        )
    return problems


def _mass_matrix(row: Sequence[Body], whole: Inertial) -> np.ndarray:
    """M of the joints of ``row``, which move ``whole`` one after the other, at their initial positions, without armature,
    which not every engine has in its own mass matrix."""
    frame = Pose()
    columns: list[tuple[np.ndarray, np.ndarray]] = []  # velocity of the world's origin, angular velocity
    for body in row:
        frame = frames.compose(frame, body.joint.origin)
        placed = frames.compose(frame, joint_displacement(body, body.joint.position))
        turn = np.array(frames.matrix(placed.quaternion))
        axes = turn.T if body.joint.kind == "ball" else [turn @ np.array(body.joint.axis)]
        for axis in axes:
            straight = body.joint.kind == "slide"
            columns.append((axis, 0.0 * axis) if straight else (-np.cross(axis, np.array(frame.position)), axis))
        frame = placed
    centre = np.array(frames.add(frame.position, frames.rotate(frame.quaternion, whole.centre_of_mass)))
    xx, yy, zz, xy, xz, yz = frames.rotate_inertia(frame.quaternion, whole.inertia)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moving = [(linear + np.cross(angular, centre), angular) for linear, angular in columns]
    mass: np.ndarray = np.array([[whole.mass * (v @ w) + a @ tensor @ b for w, b in moving] for v, a in moving])
    return mass
