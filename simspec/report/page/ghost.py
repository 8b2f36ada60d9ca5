"""Where the targets of driven joints would have their bodies, at recorded times: beside what a run made of them."""

from __future__ import annotations

import numpy as np

from simspec.report.page.frames import Rows
from simspec.report.page.packing import Numbers
from simspec.runner.run import Run
from simspec.runner.store import driven_joints
from simspec.world.kinematics import layout_of
from simspec.world.rotations import exponential, multiply, rotate
from simspec.world.types import Body, World


def driven_bodies(world: World, run: Run) -> list[int]:
    """The bodies that a driven joint moves: those of the joints, and all that hang on them; parents first."""
    joints = set(driven_joints(run.provenance))
    driven: set[str] = set()
    for body in world.bodies:
        if body.joint.name in joints or body.joint.parent in driven:
            driven.add(body.name)
    return [index for index, body in enumerate(world.bodies) if body.name in driven]


def target_poses(world: World, run: Run, rows: Rows, bodies: list[int]) -> Numbers:
    """Poses (rows, all bodies, 7) in which ``bodies`` are where q* has them: driven joints at their targets, the others as the
    run had them. What does not hang on a driven joint is as the run had it."""
    poses = np.array(run.arrays["pose"][rows], dtype=np.float64)
    targets = np.asarray(run.arrays["control.target"][rows])
    q = np.asarray(run.arrays["q"][rows])
    column = {joint: index for index, joint in enumerate(driven_joints(run.provenance))}
    slots = layout_of(world).position
    index = {body.name: k for k, body in enumerate(world.bodies)}
    for k in bodies:
        body = world.bodies[k]
        joint = body.joint
        own = targets[:, column[joint.name], None] if joint.name in column else q[:, slots[k]]
        if joint.parent is None:
            start = np.broadcast_to(_row(body), (len(rows), 7))
        else:
            start = _after(poses[:, index[joint.parent]], _row(body))
        poses[:, k] = _after(start, _displacement(body, own))
    return poses


def _row(body: Body) -> Numbers:
    """The pose of a joint's frame in its parent's, (7,)."""
    return np.array([*body.joint.origin.position, *body.joint.origin.quaternion])


def _after(first: Numbers, second: Numbers) -> Numbers:
    """Poses (rows, 7): ``second``, given in the frames ``first``."""
    place = first[..., :3] + rotate(first[..., 3:], second[..., :3])
    return np.concatenate([place, multiply(first[..., 3:], second[..., 3:])], axis=-1)


def _displacement(body: Body, q: Numbers) -> Numbers:
    """Poses (rows, 7) of the body frame in its joint's, at joint positions (rows, n)."""
    rows = len(q)
    result = np.zeros((rows, 7))
    result[:, 3] = 1.0
    axis = np.array(body.joint.axis)
    if body.joint.kind == "hinge":
        result[:, 3:] = exponential(q * axis)
    elif body.joint.kind == "slide":
        result[:, :3] = q * axis
    elif body.joint.kind == "ball":
        result[:, 3:] = q
    return result
