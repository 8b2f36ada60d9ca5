"""What gz sim's server says its components hold, in the world's frames and order, before its first step.

Components are what the server has made of the SDF; its physics system makes its own world of them, which cannot be asked.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from simspec.engines.gzsim.bindings import NAME
from simspec.engines.gzsim.simulation import Server, Simulation
from simspec.engines.kit.world_simulation import free_joint
from simspec.errors import EngineError
from simspec.formats.sdf.format import UNLIMITED
from simspec.formats.world.tree import AxisJoint, FreeJoint, JsonBody
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, Pose, Quaternion, ReadBack, Shape, Vector3

KINDS = {"FIXED": "fixed", "REVOLUTE": "hinge", "PRISMATIC": "slide"}
"""SDF's types of joints, as its bindings call them."""
WORLD = "world"


def read_back(sim: Simulation, unreadable: dict[str, str]) -> ReadBack:
    """The model that the server's components hold, and the present state as it is told."""
    held: list[ReadBack] = []
    q, v = sim.get_state()

    def ask(server: Server, info: Any, components: Any) -> None:
        bodies = []
        for row, told in enumerate(sim.document.bodies):
            state = q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist()
            joint = free_joint(told.joint.name, *state) if isinstance(told.joint, FreeJoint) else None
            joint = joint or dataclasses.replace(
                _joint(sim, server, components, row), position=tuple(state[0]), velocity=tuple(state[1])
            )
            bodies.append(Body(told.name, told.model, _inertial(server, components, row), joint, _seen(told)))
        gravity, step = server.world.gravity(components), info.dt.total_seconds()
        if gravity is None:
            raise EngineError(NAME, "tells no gravity")
        held.append(sim.model(bodies, _vector(gravity), step, unreadable))

    sim.query(ask)
    return held[0]


def _joint(sim: Simulation, server: Server, components: Any, row: int) -> Joint:
    joint, told = server.joints[row], sim.document.bodies[row].joint
    parents = {f"b{number}": number for number in range(len(sim.names))}
    above, below = joint.parent_link_name(components), joint.child_link_name(components)
    if below != f"b{row}" or (above != WORLD and above not in parents):
        raise EngineError(NAME, f"has joint {told.name!r} between {above!r} and {below!r}")
    kind = KINDS.get(joint.type(components).name)
    if kind is None:
        raise EngineError(NAME, f"has joint {told.name!r} as {joint.type(components).name}")
    at = _place(server, components, row)
    origin = at if above == WORLD else frames.compose(frames.inverse(_place(server, components, parents[above])), at)
    origin = frames.compose(origin, _pose(joint.pose(components)))
    found = Joint(told.name, kind, None if above == WORLD else sim.names[parents[above]], origin)
    if kind == "fixed" or not isinstance(told, AxisJoint):
        return found
    (axis,) = joint.axis(components)
    limits = (float(axis.lower()), float(axis.upper()))
    return dataclasses.replace(
        found,
        axis=_vector(axis.xyz()),
        position_limits=limits if any(abs(limit) < UNLIMITED for limit in limits) else None,
        effort_limit=float(axis.effort()) if 0.0 <= axis.effort() < UNLIMITED else None,
        dry_friction=float(axis.friction()),
        # what the server applies by itself, and what simspec applies
        damping=float(axis.damping()) + told.damping,
        spring_stiffness=float(axis.spring_stiffness()) + told.spring_stiffness,
        spring_rest=told.spring_rest,
    )


def _inertial(server: Server, components: Any, row: int) -> Inertial:
    """Mass, centre and tensor in the axes of the link, of which gz sim tells those in the world's."""
    held, place = server.links[row].world_inertial(components), _place(server, components, row)
    if held is None:
        raise EngineError(NAME, "tells no inertia of a link")
    centre = frames.compose(frames.inverse(place), Pose(_vector(held.pose().pos()))).position
    tensor = held.moi()
    told = (*(tensor(i, i) for i in range(3)), tensor(0, 1), tensor(0, 2), tensor(1, 2))
    return Inertial(
        float(held.mass_matrix().mass()), centre, frames.rotate_inertia(frames.conjugate(place.quaternion), told)
    )


def _seen(told: JsonBody) -> tuple[Shape, ...]:
    return tuple(
        Shape(shape.name, shape.kind, shape.size, shape.pose, collision=False, visual=True) for shape in told.shapes
    )


def _place(server: Server, components: Any, row: int) -> Pose:
    return _pose(server.links[row].world_pose(components))


def _pose(told: Any) -> Pose:
    turn: Quaternion = (told.rot().w(), told.rot().x(), told.rot().y(), told.rot().z())
    return Pose(_vector(told.pos()), frames.normalise(turn))


def _vector(told: Any) -> Vector3:
    return (told.x() + 0.0, told.y() + 0.0, told.z() + 0.0)
