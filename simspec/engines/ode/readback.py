"""What ODE says it holds, in the world's frames and order.

Masses, gravity, shapes and laws are asked of ODE and of the table that its contacts are made from. Where joints are, how they
are damped and what coordinates they have is said by the part in C, which lays the bodies: ODE's own joints, made at the joints'
zero, must say the same (``inventory.py``).
"""

from __future__ import annotations

import ctypes
import dataclasses
import math
from typing import Any

import numpy as np

from simspec.engines.kit.hulls import vertices_of
from simspec.engines.kit.world_simulation import free_joint, visual_shape
from simspec.engines.ode.building import CONES, Mass, Numbers, numbers
from simspec.engines.ode.simulation import Simulation, quaternions
from simspec.formats.world.tree import AxisJoint, FixedJoint, FreeJoint, JsonBody, JsonShape, parent_of
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, Inertial, Joint, PairContact, Pose, Quaternion, ReadBack, Shape, Surface, Vector3

CLASSES = {0: "sphere", 1: "box", 2: "capsule", 3: "cylinder", 4: "plane"}
"""ODE's numbers of classes of geoms."""
TOLD = 25
"""Numbers that the part in C says of a body."""
LAW = 8


def asked(function: Any, of: Any, count: int) -> list[float]:
    """Numbers that one of ODE's functions writes."""
    held = (ctypes.c_double * max(4, count))()
    function(of, ctypes.cast(held, Numbers))
    return list(held[:count])


def read_back(sim: Simulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as ODE holds it, and its present state."""
    lib = sim.library
    q, v = sim.get_state()
    solid = {(one.owner.row, one.place): one.number for one in sim.built.walk.shapes}
    bodies = []
    for row, body in enumerate(sim.document.bodies):
        shapes = tuple(
            _shape(sim, row, solid[row, place], shape) if (row, place) in solid else visual_shape(shape)
            for place, shape in enumerate(body.shapes)
        )
        bodies.append(Body(body.name, body.model, inertial(sim, row), _joint(sim, row, body, q, v), shapes))
    x, y, z = asked(lib.dWorldGetGravity, lib.sim_world(sim.sim), 3)
    timestep, cone = float(lib.sim_timestep(sim.sim)), CONES[lib.sim_cone(sim.sim)]
    return sim.model(bodies, (x + 0.0, y + 0.0, z + 0.0), timestep, unreadable, cone, _laws(sim))


def held_mass(sim: Simulation, row: int) -> Mass | None:
    """The mass of a body; None of one that ODE has no body for."""
    body = sim.library.sim_body_of(sim.sim, row)
    if not body:
        return None
    mass = Mass()
    sim.library.dBodyGetMass(body, ctypes.byref(mass))
    return mass


def told_body(sim: Simulation, row: int) -> list[float]:
    """What the part in C goes by: origin 3, its turn 9, axis 3, centre 3, damping, stiffness, rest, dry friction, armature,
    lower, upper."""
    return asked(lambda of, held: sim.library.sim_told_body(of, row, held), sim.sim, TOLD)


def inertial(sim: Simulation, row: int) -> Inertial:
    """The mass properties of a body. What cannot move has no body in ODE: its mass is nothing's."""
    mass = held_mass(sim, row)
    if mass is None:
        still = sim.library.sim_carrier(sim.sim, row) < 0
        told = sim.document.bodies[row]
        return Inertial(told.mass, told.centre_of_mass, told.inertia) if still else NO_INERTIA
    m = list(mass.inertia)
    x, y, z = told_body(sim, row)[15:18]
    centre = (x + mass.centre[0], y + mass.centre[1], z + mass.centre[2])
    return Inertial(mass.mass, centre, (m[0], m[5], m[10], m[1], m[2], m[6]))


def _joint(sim: Simulation, row: int, body: JsonBody, q: np.ndarray, v: np.ndarray) -> Joint:
    joint, held = body.joint, told_body(sim, row)
    position, velocity = q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist()
    if isinstance(joint, FreeJoint):
        return free_joint(joint.name, position, velocity)
    x, y, z, *turn9 = held[:12]
    (turned,) = quaternions(np.array(turn9).reshape(1, 3, 3)).tolist()
    parent = parent_of(joint)
    found = Joint(
        joint.name,
        joint.kind,
        parent,
        Pose((x, y, z), tuple(turned)),
        position=tuple(position),
        velocity=tuple(velocity),
    )
    if isinstance(joint, FixedJoint):
        return found
    damping, stiffness, rest, dry, armature, lower, upper = held[18:]
    found = dataclasses.replace(found, damping=damping, spring_stiffness=stiffness)
    if not isinstance(joint, AxisJoint):
        return found
    return dataclasses.replace(
        found,
        axis=(held[12] + 0.0, held[13] + 0.0, held[14] + 0.0),
        position_limits=(lower, upper) if math.isfinite(lower) or math.isfinite(upper) else None,
        velocity_limit=joint.velocity_limit,
        effort_limit=joint.effort_limit,
        dry_friction=dry,
        armature=armature,
        spring_rest=rest,
    )


def _shape(sim: Simulation, row: int, number: int, shape: JsonShape) -> Shape:
    """A collision shape as ODE stores it, with the visual part of the file."""
    geom = sim.library.sim_geom(sim.sim, number)
    kind = kind_of(sim, geom)
    size, pose = size_of(sim, geom, kind), pose_of(sim, row, geom, kind)
    visual, surfaces = visual_shape(shape), (Surface(0.0, 0.0, 0.0, 0.0),)
    return dataclasses.replace(visual, kind=kind, size=size, pose=pose, collision=True, surfaces=surfaces)


def kind_of(sim: Simulation, geom: Any) -> str:
    """What a geom is: one of ODE's classes, or of the one of hulls."""
    return "mesh" if sim.library.hull_is(geom) else CLASSES[sim.library.dGeomGetClass(geom)]


def size_of(sim: Simulation, geom: Any, kind: str) -> tuple[float, ...]:
    """The size of a geom as the world has it."""
    lib = sim.library
    if kind == "sphere":
        return (float(lib.dGeomSphereGetRadius(geom)),)
    if kind == "box":
        return tuple(asked(lib.dGeomBoxGetLengths, geom, 3))
    if kind == "plane":
        return ()
    if kind == "mesh":
        return vertices_of(lib, geom)
    ask = lib.dGeomCapsuleGetParams if kind == "capsule" else lib.dGeomCylinderGetParams
    radius, length = numbers((0.0,)), numbers((0.0,))
    ask(geom, radius, length)
    return radius[0], length[0]


def pose_of(sim: Simulation, row: int, geom: Any, kind: str) -> Pose:
    """The pose of a geom on its body of the world."""
    lib = sim.library
    sim_poses, _ = sim.file_frames()
    body = Pose(tuple(sim_poses[row, :3].tolist()), tuple(sim_poses[row, 3:].tolist()))
    if kind == "plane":
        a, b, c, d = asked(lib.dGeomPlaneGetParams, geom, 4)
        place = Pose((a * d, b * d, c * d), _turn_to((a, b, c)))
        return frames.compose(frames.inverse(body), place)
    held = lib.dGeomGetPosition(geom)
    turn = asked(lib.dGeomGetQuaternion, geom, 4)
    place = Pose((held[0], held[1], held[2]), frames.normalise(tuple(turn)))  # type: ignore[arg-type]
    return frames.compose(frames.inverse(body), place)


def _turn_to(normal: Vector3) -> Quaternion:
    """A turn that brings z to a normal."""
    x, y, z = normal
    if z < -0.5:  # by way of x, half a turn about which brings z to −z
        w, a, b, c = _turn_to((x, -y, -z))
        return frames.multiply((0.0, 1.0, 0.0, 0.0), (w, a, b, c))
    return frames.normalise((1.0 + z, -y, x, 0.0))


def _laws(sim: Simulation) -> tuple[PairContact, ...]:
    """The table of laws, of the materials that meet."""
    found = []
    names = sim.built.materials
    for row, one in enumerate(names):
        for column in range(row, len(names)):
            held = told_law(sim, row, column)
            if held[7]:
                sliding, bounce, threshold, rolling, torsional = held[:5]
                found.append(PairContact(one, names[column], sliding, bounce, torsional, rolling, threshold))
    return tuple(found)


def told_law(sim: Simulation, one: int, other: int) -> list[float]:
    """Friction, restitution, threshold, rolling, torsional, soft_erp, soft_cfm, whether they touch."""
    return asked(lambda of, held: sim.library.sim_told_law(of, one, other, held), sim.sim, LAW)
