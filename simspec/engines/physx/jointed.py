"""The joints of bodies as PhysX stores them: the frames, types, limits and drives of its links' joints."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from simspec.engines.kit.building import STATIC
from simspec.engines.kit.world_simulation import free_joint
from simspec.engines.physx.links import X, Y, Z, to_x
from simspec.engines.physx.simulation import PhysxSimulation
from simspec.engines.physx.units import NAME, SCALE, pose_of
from simspec.errors import EngineError
from simspec.formats.world import parent_of
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.world import frames
from simspec.world.types import Joint, Pose

TYPES = {"revolute_unwrapped": "hinge", "prismatic": "slide", "fixed": "fixed"}
"""SAPIEN's names of the types of joints that simspec makes."""
AXES = (X, Y, Z)
TURN = 2e-7
"""How far the frames of hinges that stand for a ball may be from being along x, y and z, in single precision."""


def joints(sim: PhysxSimulation) -> list[Joint]:
    """The joint of every body."""
    q, v = sim.get_state()
    return [_joint(sim, row, q, v) for row in range(len(sim.names))]


def _joint(sim: PhysxSimulation, row: int, q: np.ndarray, v: np.ndarray) -> Joint:
    placed, joint = sim.walk.bodies[row], sim.document.bodies[row].joint
    position, velocity = q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist()
    if row in sim.built.links.of:
        return _of_link(sim, row, position, velocity)
    if joint.kind == "free":
        return free_joint(joint.name, position, velocity)
    if placed.moves:  # parts of one body of PhysX
        home, above = sim.built.homes.of[row], sim.built.homes.of[placed.parent]
        pose = frames.compose(frames.inverse(above.pose), home.pose)
    else:
        pose = sim.static_pose(row)
        if placed.parent != STATIC:
            pose = frames.compose(frames.inverse(sim.static_pose(placed.parent)), pose)
    return Joint(joint.name, joint.kind, parent_of(joint), pose)


def _of_link(sim: PhysxSimulation, row: int, position: list[float], velocity: list[float]) -> Joint:
    """The joint of a body that is a link."""
    links, joint, parent = sim.built.links, sim.document.bodies[row].joint, sim.walk.bodies[row].parent
    made = links.joints[row]
    if made[-1].child_link != links.of[row]:
        raise EngineError(NAME, f"holds another link than that of joint {joint.name!r}")
    if joint.kind in QUATERNION_JOINTS:
        _check_chain(made, joint.name, len(made) - 3)
    if joint.kind == "free":
        return free_joint(joint.name, position, velocity)
    first, last = made[0], made[-1]
    axis_turn = pose_of(last.pose_in_child)
    origin = pose_of(first.pose_in_parent)
    if row in links.spacers:
        origin = frames.compose(pose_of(links.spacers[row].joint.pose_in_parent), origin)
    if parent != STATIC and sim.walk.bodies[parent].moves:
        origin = frames.compose(frames.inverse(sim.built.homes.of[parent].pose), origin)
    else:
        base = pose_of(links.of[row].articulation.root_pose)
        if parent != STATIC:
            base = frames.compose(frames.inverse(sim.static_pose(parent)), base)
        origin = frames.compose(base, origin)
    found = Joint(joint.name, joint.kind, parent_of(joint), origin, position=tuple(position), velocity=tuple(velocity))
    start = sim.v_places[row].start
    if joint.kind == "ball":
        start_turn = pose_of(first.pose_in_child).quaternion
        origin = frames.compose(origin, Pose(quaternion=frames.conjugate(start_turn)))
        return dataclasses.replace(
            found,
            origin=origin,
            damping=float(sim.damping[start]),
            spring_stiffness=float(sim.stiffness[start]),
        )
    kind = TYPES.get(last.type, last.type)
    if kind == "fixed":
        return dataclasses.replace(found, kind=kind, origin=frames.compose(origin, frames.inverse(axis_turn)))
    return dataclasses.replace(
        found,
        kind=kind,
        origin=frames.compose(origin, frames.inverse(axis_turn)),
        axis=frames.rotate(axis_turn.quaternion, (1.0, 0.0, 0.0)),
        damping=float(sim.damping[start]),
        spring_stiffness=float(sim.stiffness[start]),
        **_axis_values(sim, row, last),
    )


def _axis_values(sim: PhysxSimulation, row: int, made: Any) -> dict[str, Any]:
    """The values of a joint of one axis. PhysX has no place for ratings, which are the document's."""
    joint, slides = sim.document.bodies[row].joint, made.type == "prismatic"
    length, inertia = (SCALE, 1.0) if slides else (1.0, SCALE * SCALE)
    low, high = (float(end) / length for end in made.limits[0])
    return {
        "position_limits": (low, high) if math.isfinite(low) or math.isfinite(high) else None,
        "velocity_limit": getattr(joint, "velocity_limit", None),
        "effort_limit": getattr(joint, "effort_limit", None),
        "dry_friction": float(made.force_limit) / (inertia * length) if made.damping else 0.0,
        "armature": float(made.armature[0]) / inertia,
        "spring_rest": float(sim.rest[sim.v_places[row].start]),
    }


def _check_chain(made: list[Any], name: str, slides: int) -> None:
    """Raise EngineError unless the joints that stand for a ball or a free root are along x, y and z of one frame, and are free.
    The first stands in a frame of its parent, and the last has the ball's rotation in its child's frame."""
    for place, joint in enumerate(made):
        kind = "slide" if place < slides else "hinge"
        wanted = np.array([0.0, 0.0, 0.0, *to_x(AXES[place % 3])])
        frames_of = [pose_of(joint.pose_in_parent)] * (place > 0) + [pose_of(joint.pose_in_child)] * (
            joint is not made[-1]
        )
        off = [np.abs(np.array([*pose.position, *pose.quaternion]) - wanted).max() for pose in frames_of]
        if TYPES.get(joint.type) != kind or any(far > TURN for far in off):
            raise EngineError(NAME, f"holds other axes of {name!r} than x, y and z")
        if not all(math.isinf(end) for end in joint.limits[0]) or joint.damping:
            raise EngineError(NAME, f"holds limits or a drive of {name!r}")
