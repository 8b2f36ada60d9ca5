"""What DART says it holds, in the world's frames and order."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.dart.sidecar import ShapeEntry
from simspec.engines.dart.coordinates import JOINT_KINDS, NAME
from simspec.engines.dart.nodes import collision_nodes, shape_nodes
from simspec.engines.dart.simulation import Simulation
from simspec.errors import EngineError
from simspec.formats.kit.contract import restore_frames
from simspec.formats.skel.format import world_name
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, Pose, ReadBack, Shape, Surface, Vector3

SHAPE_KINDS: Mapping[str, tuple[str, Callable[[Any], tuple[float, ...]]]] = {
    "SphereShape": ("sphere", lambda shape: (shape.getRadius(),)),
    "BoxShape": ("box", lambda shape: _vector(shape.getSize())),
    "CylinderShape": ("cylinder", lambda shape: (shape.getRadius(), shape.getHeight())),
    "CapsuleShape": ("capsule", lambda shape: (shape.getRadius(), shape.getHeight())),
    "EllipsoidShape": ("ellipsoid", lambda shape: _vector(shape.getRadii())),
    "PlaneShape": ("plane", lambda shape: ()),
}
"""DART's shape types, and what gives the size of each."""

MESH = "MeshShape"
"""DART's type of a mesh. It does not tell the vertices: they are those of the file that it names, which must have the box that
it tells of its own."""
BOX_TOLERANCE = 1e-6
"""Share of a mesh's extent by which that box may be off: DART keeps single precision."""
COPY_TOLERANCE = 1e-12
"""How far a node may be from the one it is welded to: the tolerance of text, proof level L0. DART computes the weld's place
from the two nodes' own, to the last bit."""


def read_back(sim: Simulation, q: np.ndarray, v: np.ndarray, unreadable: dict[str, str]) -> ReadBack:
    """The model as DART holds it, and its present state ``q``, ``v``."""
    names: dict[str, list[tuple[int, ShapeEntry]]] = {}
    for number, entry in enumerate(sim.sidecar.shapes):
        names.setdefault(entry.body, []).append((number, entry))
    bodies = []
    for index, (name, node) in enumerate(zip(sim.names, sim.bodies, strict=True)):
        joint = _joint(sim, node.getParentJoint(), index, q, v)
        bodies.append(
            Body(name, sim.sidecar.models[index], _inertial(node), joint, _shapes(sim, index, names.get(name, [])))
        )
    offsets = {name: tuple(offset) for name, offset in zip(sim.names, sim.offsets.tolist(), strict=True) if any(offset)}
    return ReadBack(
        restore_frames(tuple(bodies), offsets),
        _vector(sim.world.getGravity()),
        float(sim.world.getTimeStep()),
        _cone(sim),
        dict(unreadable),
    )


def _vector(values: Any) -> Vector3:
    x, y, z = np.asarray(values).tolist()
    return (x + 0.0, y + 0.0, z + 0.0)


def _pose(transform: Any) -> Pose:
    turn = tuple(map(tuple, transform.rotation().tolist()))
    return Pose(_vector(transform.translation()), frames.from_matrix(turn))  # type: ignore[arg-type]


def _cone(sim: Simulation) -> str:
    """The cone of DART's solver; that of the request where no shape has friction, and no solver makes use of it."""
    if sim.nodes.without_friction():
        return sim.sidecar.friction_cone
    solver = sim.solver.getBoxedLcpSolver()
    kind = sim.dartpy.constraint.NsgsFrictionSolver
    if isinstance(solver, kind):
        law = solver.getOptions().law
        if law == kind.Law.Coulomb:
            return "elliptic"
        if law != kind.Law.Box:
            raise EngineError(NAME, f"holds the friction law {law}, unknown here")
    return "pyramid-circumscribed"


def _inertial(node: Any) -> Inertial:
    inertia = node.getInertia()
    m = inertia.getMoment().tolist()
    tensor = (m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2])
    return Inertial(float(inertia.getMass()), _vector(inertia.getLocalCOM()), tensor)


def _joint(sim: Simulation, joint: Any, index: int, q: np.ndarray, v: np.ndarray) -> Joint:
    kind = JOINT_KINDS[joint.getType()]
    if np.any(joint.getTransformFromChildBodyNode().matrix() != np.eye(4)):
        raise EngineError(NAME, f"joint {joint.getName()!r} is not at its child's frame")
    above = joint.getParentBodyNode()
    parent = None if above is None else world_name(above.getName())
    position, velocity = (
        tuple(q[sim.coordinates.q_places[index]].tolist()),
        tuple(v[sim.coordinates.v_places[index]].tolist()),
    )
    held = Joint(joint.getName(), kind, parent, _pose(joint.getTransformFromParentBodyNode()))
    if kind == "fixed":
        return held
    if kind == "free":
        start = held.origin
        place = frames.compose(start, Pose(position[:3], frames.normalise(position[3:])))
        angular = frames.rotate(place.quaternion, velocity[3:])
        return dataclasses.replace(
            held,
            origin=Pose(),
            position=(*place.position, *place.quaternion),
            velocity=(*frames.rotate(start.quaternion, velocity[:3]), *angular),
        )
    if joint.getSpringStiffness(0):
        raise EngineError(NAME, f"joint {joint.getName()!r} has a spring of DART's own, which is implicit in time")
    efforts = sim.efforts
    dof = efforts.place(joint).start
    held = dataclasses.replace(
        held,
        # DART's own damping stands for the armature; what it has beyond that damps
        damping=float(efforts.damping[dof] + joint.getDampingCoefficient(0) - efforts.armature[dof] / sim.timestep),
        spring_stiffness=float(efforts.stiffness[dof]),
        position=position if kind != "ball" else frames.normalise(position),
        velocity=velocity,
    )
    if kind == "ball":
        return held
    lower, upper = joint.getPositionLowerLimit(0), joint.getPositionUpperLimit(0)
    limited = joint.areLimitsEnforced() and (np.isfinite(lower) or np.isfinite(upper))
    effort = joint.getForceUpperLimit(0)
    return dataclasses.replace(
        held,
        axis=_vector(joint.getAxis()),
        position_limits=(lower, upper) if limited else None,
        effort_limit=float(effort) if np.isfinite(effort) else None,
        dry_friction=joint.getCoulombFriction(0),
        armature=float(efforts.armature[dof]),
        spring_rest=float(efforts.rest[dof]),
    )


def _mesh(sim: Simulation, held: Any) -> tuple[float, ...]:
    """The vertices of a mesh, scaled as DART scales them."""
    name = Path(held.getMeshPath()).relative_to(sim.folder).as_posix()
    vertices = np.array(sim.meshes[name]).reshape(-1, 3) * np.ravel(held.getScale())
    box = held.getBoundingBox()
    low, high = np.ravel(box.getMin()), np.ravel(box.getMax())
    apart = max(np.abs(low - vertices.min(axis=0)).max(), np.abs(high - vertices.max(axis=0)).max())
    if apart > BOX_TOLERANCE * np.abs(vertices).max():
        raise EngineError(NAME, f"holds another mesh than {name!r}: its box is {apart:g} m off")
    return tuple(vertices.ravel().tolist())


def _shape(sim: Simulation, node: Any) -> Shape:
    held = node.getShape()
    if held.getType() == MESH:
        kind, size = "mesh", _mesh(sim, held)
    elif held.getType() in SHAPE_KINDS:
        kind, size_of = SHAPE_KINDS[held.getType()]
        size = size_of(held)
    else:
        raise EngineError(NAME, f"holds the shape {node.getName()!r} as {held.getType()}, unknown here")
    pose = _pose(node.getRelativeTransform())
    if kind == "plane" and (_vector(held.getNormal()) != (0.0, 0.0, 1.0) or held.getOffset() != 0.0):
        raise EngineError(NAME, f"the plane {node.getName()!r} is not the x-y plane of its frame")
    shape = Shape("", kind, size, pose, collision=False, visual=False)
    if node.hasVisualAspect():
        colour = node.getVisualAspect().getRGBA().tolist()
        shape = dataclasses.replace(shape, visual=True, colour=tuple(colour))
    if node.hasCollisionAspect() and node.getCollisionAspect().isCollidable():
        surface = node.getDynamicsAspect()
        shape = dataclasses.replace(
            shape,
            collision=True,
            surfaces=(Surface(surface.getFrictionCoeff(), restitution=surface.getRestitutionCoeff()),),
        )
    return shape


def _shapes(sim: Simulation, index: int, given: list[tuple[int, ShapeEntry]]) -> tuple[Shape, ...]:
    """A body's shapes in the world's order. DART has a node for the visual side of a shape and one for each of its copies;
    those that are alike and that the sidecar says are one are joined, all else is left as it is."""
    own = sim.bodies[index]
    copies: dict[int, list[Shape]] = {}
    for node in sim.nodes.of(index):
        place = _place_on(node, own)
        for one in collision_nodes(node):
            number, _ = sim.nodes.copy(one)
            copies.setdefault(number, []).append(_moved(_shape(sim, one), place))
    seen = [_shape(sim, one) for one in shape_nodes(own) if one.hasVisualAspect()]
    if len(seen) != sum(entry.visual for _, entry in given):
        return (*(shape for held in copies.values() for shape in held), *seen)
    found: list[Shape] = []
    for number, entry in given:
        parts = copies.get(number, []) + ([seen.pop(0)] if entry.visual else [])
        kept: list[Shape] = []
        for part in parts:
            alike = next((at for at, one in enumerate(kept) if _same(one, part)), None)
            if alike is None:
                kept.append(part)
            else:
                kept[alike] = _joined(kept[alike], part)
        found.extend(dataclasses.replace(shape, name=entry.name) for shape in kept)
    return tuple(found)


def _place_on(node: Any, own: Any) -> Pose:
    """Where a further node of a body stands in the body's own; it must be welded to that and have no mass."""
    if node.getName() == own.getName():
        return Pose()
    joint, above = node.getParentJoint(), node.getParentBodyNode()
    if JOINT_KINDS[joint.getType()] != "fixed" or above is None or above.getName() != own.getName():
        raise EngineError(NAME, f"the copies on {node.getName()!r} are not welded to {own.getName()!r}")
    held = node.getInertia()
    if node.getMass() != 0.0 or np.any(held.getMoment()) or np.any(held.getLocalCOM()):
        raise EngineError(NAME, f"{node.getName()!r}, which holds copies of shapes, has a mass, or a centre of mass")
    transform = node.getTransform(own)
    return Pose() if np.abs(transform.matrix() - np.eye(4)).max() <= COPY_TOLERANCE else _pose(transform)


def _moved(shape: Shape, place: Pose) -> Shape:
    return dataclasses.replace(shape, pose=frames.compose(place, shape.pose))


def _same(one: Shape, other: Shape) -> bool:
    """Whether two sides or copies of a shape are alike."""
    return (one.kind, one.size, one.pose) == (other.kind, other.size, other.pose)


def _joined(one: Shape, other: Shape) -> Shape:
    seen = one if one.visual else other
    return dataclasses.replace(
        one,
        collision=one.collision or other.collision,
        visual=one.visual or other.visual,
        colour=seen.colour,
        surfaces=one.surfaces + other.surfaces,
    )
