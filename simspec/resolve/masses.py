"""Whether what moves has an inertia: of bodies that are joined rigidly the sum counts."""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np

from simspec.errors import Problem
from simspec.language.locate import locate
from simspec.language.moments import principal_moments
from simspec.language.sources import Source
from simspec.world import frames
from simspec.world.inertia import lumped, rigid_members, singular, summed_inertial
from simspec.world.kinematics import is_carrier, joint_displacement, owner_of
from simspec.world.types import Body, Inertial, Pose, World


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
        problems.append(Problem(message, path, locate(source, path), found=found, hint=hint))
    return problems


def unlike_weights(source: Source, bodies: Sequence[Body], kinematic: Container[str]) -> list[Problem]:
    """The problems of rigid groups that are told as one and whose bodies have unlike parts of their weights, and of kinematic
    bodies, whose weight counts for nothing, with a part of it."""
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
            problems.append(Problem(message, path, locate(source, path), hint="remove it"))
        elif top in gathers and len(scales) > 1:
            message = (
                "bodies that are fixed to each other, one of them without inertia of its own, have one gravity_scale"
            )
            values = ", ".join(f"{scale:g}" for scale in sorted(scales))
            problems.append(Problem(message, path, locate(source, path), found=values))
    return problems


DEPENDENT = 1e-9
"""Smallest eigenvalue of the mass matrix of one body's joints, scaled to a unit diagonal, from which on they are independent:
0 where they move the body in fewer ways than they are many, 1e-16 with round-off."""


def dependent_joints(source: Source, bodies: Sequence[Body]) -> list[Problem]:
    """The problems of bodies with several joints that begin where these move them in fewer ways than they are many: what is
    between such joints has no mass, and could not be accelerated."""
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
        problems.append(Problem(message, path, locate(source, path), found=f"{len(row)} joints", hint=hint))
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
