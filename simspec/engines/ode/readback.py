"""The model that ODE stores, in the world's frames and order.

Masses, gravity and shapes are read from ODE, laws from the table from which its contacts are made. Places, damping and
coordinates of joints are read from the part in C, which lays the bodies: ODE's own joints, made at the joints' zero, must agree
(``inventory.py``).
"""

from __future__ import annotations

import ctypes
import dataclasses
import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from simspec.engines.kit.hulls import vertices_of
from simspec.engines.kit.readback import inertial_of, range_of, vector
from simspec.engines.kit.world_simulation import free_joint, pose_of_row, visual_shape
from simspec.engines.ode.building import CONES, Mass, Numbers, numbers
from simspec.engines.ode.simulation import OdeSimulation, quaternions
from simspec.formats.world import AxisJoint, FixedJoint, FreeJoint, JsonBody, JsonShape, parent_of
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, Inertial, Joint, PairContact, Pose, Quaternion, ReadBack, Shape, Surface, Vector3

CLASSES = {0: "sphere", 1: "box", 2: "capsule", 3: "cylinder", 4: "plane"}
"""ODE's numbers of classes of geoms."""
BODY_VALUES = 25
"""Numbers of a body in the part in C."""
LAW = 8


def queried(function: Any, of: Any, count: int) -> list[float]:
    """Numbers that one of ODE's functions writes."""
    values = (ctypes.c_double * max(4, count))()
    function(of, ctypes.cast(values, Numbers))
    return list(values[:count])


def read_back(sim: OdeSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as ODE stores it, and its present state."""
    lib = sim.library
    q, v = sim.get_state()
    solid = {(shape.owner.row, shape.place): shape.number for shape in sim.built.walk.shapes}
    bodies = []
    for row, body in enumerate(sim.document.bodies):
        shapes = tuple(
            _shape(sim, row, solid[row, place], shape) if (row, place) in solid else visual_shape(shape)
            for place, shape in enumerate(body.shapes)
        )
        values = BodyValues.of(sim, row)
        joint = _joint(body, values, q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist())
        bodies.append(Body(body.name, body.model, _inertial(sim, row, values.centre), joint, shapes))
    gravity = vector(queried(lib.dWorldGetGravity, lib.sim_world(sim.sim), 3))
    timestep, cone = float(lib.sim_timestep(sim.sim)), CONES[lib.sim_cone(sim.sim)]
    laws = tuple(
        PairContact(first, second, sliding, bounce, torsional, rolling, threshold)
        for first, second, (sliding, bounce, threshold, rolling, torsional, *_) in read_laws(sim)
    )
    return sim.model(bodies, gravity, timestep, unreadable, cone, laws)


class BodyValues(NamedTuple):
    """The values that the part in C stores of a body and its joint."""

    origin: Pose
    axis: Vector3
    centre: Vector3
    damping: float
    stiffness: float
    rest: float
    dry_friction: float
    armature: float
    lower: float
    upper: float

    @classmethod
    def of(cls, sim: OdeSimulation, row: int) -> BodyValues:
        n = queried(lambda of, values: sim.library.sim_body_values(of, row, values), sim.sim, BODY_VALUES)
        (turn,) = quaternions(np.array(n[3:12]).reshape(1, 3, 3)).tolist()
        return cls(Pose(tuple(n[:3]), tuple(turn)), vector(n[12:15]), tuple(n[15:18]), *n[18:])  # type: ignore[arg-type]


def _inertial(sim: OdeSimulation, row: int, centre: Vector3) -> Inertial:
    """The mass properties of a body; the document's of static ones, for which ODE has no body."""
    body = sim.library.sim_body_of(sim.sim, row)
    if not body:
        given = sim.document.bodies[row]
        static = sim.library.sim_carrier(sim.sim, row) < 0
        return Inertial(given.mass, given.centre_of_mass, given.inertia) if static else NO_INERTIA
    mass = Mass()
    sim.library.dBodyGetMass(body, ctypes.byref(mass))
    offset = np.array(centre) + mass.centre[:3]
    return inertial_of(mass.mass, offset, np.reshape(mass.inertia, (3, 4)))


def _joint(body: JsonBody, values: BodyValues, position: list[float], velocity: list[float]) -> Joint:
    joint = body.joint
    if isinstance(joint, FreeJoint):
        return free_joint(joint.name, position, velocity)
    found = Joint(
        joint.name,
        joint.kind,
        parent_of(joint),
        values.origin,
        position=tuple(position),
        velocity=tuple(velocity),
    )
    if isinstance(joint, FixedJoint):
        return found
    found = dataclasses.replace(found, damping=values.damping, spring_stiffness=values.stiffness)
    if not isinstance(joint, AxisJoint):
        return found
    return dataclasses.replace(
        found,
        axis=values.axis,
        position_limits=range_of(values.lower, values.upper),
        velocity_limit=joint.velocity_limit,
        effort_limit=joint.effort_limit,
        dry_friction=values.dry_friction,
        armature=values.armature,
        spring_rest=values.rest,
    )


def _shape(sim: OdeSimulation, row: int, number: int, shape: JsonShape) -> Shape:
    """A collision shape as ODE stores it, with the visual part of the file."""
    geom = sim.library.sim_geom(sim.sim, number)
    kind = "mesh" if sim.library.hull_is(geom) else CLASSES[sim.library.dGeomGetClass(geom)]
    return dataclasses.replace(
        visual_shape(shape),
        kind=kind,
        size=_size(sim.library, geom, kind),
        pose=frames.compose(frames.inverse(pose_of_row(sim.file_frames()[0][row])), _pose(sim.library, geom, kind)),
        collision=True,
        surfaces=(Surface(0.0, 0.0, 0.0, 0.0),),
    )


def _size(lib: Any, geom: Any, kind: str) -> tuple[float, ...]:
    """The size of a geom as the world has it."""
    if kind == "sphere":
        return (float(lib.dGeomSphereGetRadius(geom)),)
    if kind == "box":
        return tuple(queried(lib.dGeomBoxGetLengths, geom, 3))
    if kind == "plane":
        return ()
    if kind == "mesh":
        return vertices_of(lib, geom)
    radius, length = numbers((0.0,)), numbers((0.0,))
    (lib.dGeomCapsuleGetParams if kind == "capsule" else lib.dGeomCylinderGetParams)(geom, radius, length)
    return radius[0], length[0]


def _pose(lib: Any, geom: Any, kind: str) -> Pose:
    """The pose of a geom in the world."""
    if kind == "plane":
        a, b, c, d = queried(lib.dGeomPlaneGetParams, geom, 4)
        return Pose((a * d, b * d, c * d), _turn_to((a, b, c)))
    turn = frames.normalise(tuple(queried(lib.dGeomGetQuaternion, geom, 4)))  # type: ignore[arg-type]
    return Pose(tuple(lib.dGeomGetPosition(geom)[:3]), turn)


def _turn_to(normal: Vector3) -> Quaternion:
    """A turn that brings z to a normal."""
    x, y, z = normal
    if z < -0.5:  # by way of x, half a turn about which brings z to −z
        return frames.multiply((0.0, 1.0, 0.0, 0.0), _turn_to((x, -y, -z)))
    return frames.normalise((1.0 + z, -y, x, 0.0))


def read_laws(sim: OdeSimulation) -> Iterator[tuple[str, str, list[float]]]:
    """The laws of materials that touch: friction, restitution, threshold, rolling, torsional, soft_erp, soft_cfm, touches."""
    for first, second in itertools.combinations_with_replacement(enumerate(sim.built.materials), 2):
        law = queried(lambda of, v: sim.library.sim_law_values(of, first[0], second[0], v), sim.sim, LAW)  # noqa: B023
        if law[7]:
            yield first[1], second[1], law
