"""DART's read-back, in the world's frames and order; and files as DART's own parsers make them."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.dialects.dart.sidecar import DartShapeEntry
from simspec.engines.dart.coordinates import JOINT_KINDS, NAME, collision_nodes, shape_nodes
from simspec.engines.dart.simulation import DartSimulation
from simspec.engines.kit.building import bound, inertial_of, merged, pose_of, range_of, vector
from simspec.engines.kit.foreign import (
    MESH,
    REFUSED,
    Effect,
    EngineAddition,
    EngineLink,
    Reads,
    bodies_of_links,
    box_support,
    distinct_names,
)
from simspec.engines.kit.messages import captured
from simspec.errors import EngineError
from simspec.formats.kit.contract import restore_frames
from simspec.formats.skel.format import world_name
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import Body, EngineValue, Inertial, Joint, Pose, ReadBack, Shape, Surface

SHAPE_KINDS: Mapping[str, tuple[str, Callable[[Any], tuple[float, ...]]]] = {
    "SphereShape": ("sphere", lambda shape: (shape.getRadius(),)),
    "BoxShape": ("box", lambda shape: vector(shape.getSize())),
    "CylinderShape": ("cylinder", lambda shape: (shape.getRadius(), shape.getHeight())),
    "CapsuleShape": ("capsule", lambda shape: (shape.getRadius(), shape.getHeight())),
    "EllipsoidShape": ("ellipsoid", lambda shape: vector(shape.getRadii())),
    "PlaneShape": ("plane", lambda shape: ()),
}
"""DART's shape types, and what gives the size of each."""

MESH_SHAPE = "MeshShape"
"""DART's type of a mesh. It does not tell the vertices: they are those of the file that it names, which must have the box that
it reports of its own."""
BOX_TOLERANCE = 1e-6
"""Share of a mesh's extent by which that box may be off: DART keeps single precision."""
COPY_TOLERANCE = 1e-12
"""How far a node may be from the one it is welded to: the tolerance of text, proof level L0. DART computes the weld's place
from the two nodes' own, to the last bit."""


def read_back(sim: DartSimulation, q: np.ndarray, v: np.ndarray, unreadable: dict[str, str]) -> ReadBack:
    """The model as DART stores it, and its present state ``q``, ``v``."""
    shapes: dict[str, list[tuple[int, DartShapeEntry]]] = {}
    for number, entry in enumerate(sim.sidecar.shapes):
        shapes.setdefault(entry.body, []).append((number, entry))
    bodies = []
    for row, (name, node, model) in enumerate(zip(sim.names, sim.bodies, sim.sidecar.models, strict=True)):
        joint = _joint(sim, node.getParentJoint(), row, q, v)
        bodies.append(Body(name, model, inertial(node), joint, _shapes(sim, row, shapes.get(name, []))))
    offsets = {name: tuple(offset) for name, offset in zip(sim.names, sim.offsets.tolist(), strict=True) if any(offset)}
    restored, gravity = restore_frames(tuple(bodies), offsets), vector(sim.world.getGravity())
    return ReadBack(restored, gravity, float(sim.world.getTimeStep()), _cone(sim), dict(unreadable))


def transform_pose(transform: Any) -> Pose:
    """A pose of one of DART's."""
    return pose_of(transform.translation(), transform.rotation())


def inertial(node: Any) -> Inertial:
    """The mass properties of a node of DART's."""
    inertia = node.getInertia()
    return inertial_of(inertia.getMass(), inertia.getLocalCOM(), inertia.getMoment())


def shape_size(shape: Any) -> tuple[str, tuple[float, ...]] | None:
    """The kind and size of one of DART's shapes; None of a mesh and of kinds that the world does not have."""
    if shape.getType() not in SHAPE_KINDS:
        return None
    kind, size_of = SHAPE_KINDS[shape.getType()]
    return kind, size_of(shape)


def surfaces_of(node: Any) -> tuple[Surface, ...]:
    """The surface of a node with a collision shape; empty without one."""
    if not (node.hasCollisionAspect() and node.getCollisionAspect().isCollidable() and node.hasDynamicsAspect()):
        return ()
    aspect = node.getDynamicsAspect()
    return (Surface(aspect.getFrictionCoeff(), restitution=aspect.getRestitutionCoeff()),)


def _cone(sim: DartSimulation) -> str:
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


def _joint(sim: DartSimulation, joint: Any, index: int, q: np.ndarray, v: np.ndarray) -> Joint:
    kind = JOINT_KINDS[joint.getType()]
    if np.any(joint.getTransformFromChildBodyNode().matrix() != np.eye(4)):
        raise EngineError(NAME, f"joint {joint.getName()!r} is not at its child's frame")
    above = joint.getParentBodyNode()
    parent = None if above is None else world_name(above.getName())
    position = tuple(q[sim.coordinates.q_places[index]].tolist())
    velocity = tuple(v[sim.coordinates.v_places[index]].tolist())
    found = Joint(joint.getName(), kind, parent, transform_pose(joint.getTransformFromParentBodyNode()))
    if kind == "fixed":
        return found
    if kind == "free":
        start = found.origin
        place = frames.compose(start, Pose(position[:3], frames.normalise(position[3:])))
        angular = frames.rotate(place.quaternion, velocity[3:])
        return dataclasses.replace(
            found,
            origin=Pose(),
            position=(*place.position, *place.quaternion),
            velocity=(*frames.rotate(start.quaternion, velocity[:3]), *angular),
        )
    if joint.getSpringStiffness(0):
        raise EngineError(NAME, f"joint {joint.getName()!r} has a spring of DART's own, which is implicit in time")
    efforts = sim.efforts
    dof = efforts.place(joint).start
    found = dataclasses.replace(
        found,
        # DART's own damping stands for the armature; the rest of it damps
        damping=float(efforts.damping[dof] + joint.getDampingCoefficient(0) - efforts.armature[dof] / sim.timestep),
        armature=float(efforts.armature[dof]),
        spring_stiffness=float(efforts.stiffness[dof]),
        position=position if kind != "ball" else frames.normalise(position),
        velocity=velocity,
    )
    if kind == "ball":
        return found
    limits = range_of(joint.getPositionLowerLimit(0), joint.getPositionUpperLimit(0))
    return dataclasses.replace(
        found,
        axis=vector(joint.getAxis()),
        position_limits=limits if joint.areLimitsEnforced() else None,
        effort_limit=bound(joint.getForceUpperLimit(0)),
        dry_friction=joint.getCoulombFriction(0),
        spring_rest=float(efforts.rest[dof]),
    )


def _mesh(sim: DartSimulation, shape: Any) -> tuple[float, ...]:
    """The vertices of a mesh, scaled as DART scales them."""
    name = Path(shape.getMeshPath()).relative_to(sim.folder).as_posix()
    vertices = np.array(sim.meshes[name]).reshape(-1, 3) * np.ravel(shape.getScale())
    box = shape.getBoundingBox()
    low, high = np.ravel(box.getMin()), np.ravel(box.getMax())
    deviation = max(np.abs(low - vertices.min(axis=0)).max(), np.abs(high - vertices.max(axis=0)).max())
    if deviation > BOX_TOLERANCE * np.abs(vertices).max():
        raise EngineError(NAME, f"holds another mesh than {name!r}: its box is {deviation:g} m off")
    return tuple(vertices.ravel().tolist())


def _shape(sim: DartSimulation, node: Any) -> Shape:
    stored = node.getShape()
    found = ("mesh", _mesh(sim, stored)) if stored.getType() == MESH_SHAPE else shape_size(stored)
    if found is None:
        raise EngineError(NAME, f"stores the shape {node.getName()!r} as {stored.getType()}, unknown here")
    kind, size = found
    if kind == "plane" and (vector(stored.getNormal()) != (0.0, 0.0, 1.0) or stored.getOffset() != 0.0):
        raise EngineError(NAME, f"the plane {node.getName()!r} is not the x-y plane of its frame")
    surfaces = surfaces_of(node)
    pose = transform_pose(node.getRelativeTransform())
    shape = Shape("", kind, size, pose, collision=bool(surfaces), visual=False, surfaces=surfaces)
    if node.hasVisualAspect():
        shape = dataclasses.replace(shape, visual=True, colour=tuple(node.getVisualAspect().getRGBA().tolist()))
    return shape


def _shapes(sim: DartSimulation, index: int, given: list[tuple[int, DartShapeEntry]]) -> tuple[Shape, ...]:
    """A body's shapes in the world's order. DART has a node for the visual of a shape and one for each of its copies: equal
    ones that the sidecar assigns to one shape are merged."""
    body = sim.bodies[index]
    copies: dict[int, list[Shape]] = {}
    for node in sim.nodes.of(index):
        place = _place_on(node, body)
        for collision in collision_nodes(node):
            shape, (number, _) = _shape(sim, collision), sim.nodes.copy(collision)
            moved = dataclasses.replace(shape, pose=frames.compose(place, shape.pose))
            copies.setdefault(number, []).append(moved)
    visuals = [_shape(sim, node) for node in shape_nodes(body) if node.hasVisualAspect()]
    if len(visuals) != sum(entry.visual for _, entry in given):
        return (*(shape for shapes in copies.values() for shape in shapes), *visuals)
    found: list[Shape] = []
    for number, entry in given:
        parts = copies.get(number, []) + ([visuals.pop(0)] if entry.visual else [])
        found += [dataclasses.replace(shape, name=entry.name) for shape in merged(parts)]
    return tuple(found)


def _place_on(node: Any, body: Any) -> Pose:
    """Where a further node of a body stands in the body's own; it must be welded to that and have no mass."""
    if node.getName() == body.getName():
        return Pose()
    joint, above = node.getParentJoint(), node.getParentBodyNode()
    if JOINT_KINDS[joint.getType()] != "fixed" or above is None or above.getName() != body.getName():
        raise EngineError(NAME, f"the copies on {node.getName()!r} are not welded to {body.getName()!r}")
    inertia = node.getInertia()
    if node.getMass() != 0.0 or np.any(inertia.getMoment()) or np.any(inertia.getLocalCOM()):
        raise EngineError(NAME, f"{node.getName()!r}, which holds copies of shapes, has a mass, or a centre of mass")
    transform = node.getTransform(body)
    return Pose() if np.abs(transform.matrix() - np.eye(4)).max() <= COPY_TOLERANCE else transform_pose(transform)


# A URDF, SDF, MJCF or skel file as DART's own parsers make it, with their default options. Facts marked *measured*: dartpy
# 6.20.0.

# Changes of DART's parsers to plain files (dartpy 6.20.0), measured by tests/formats/test_readers.py.

MEASURED: Final = "6.20.0"
LIMITS: Final = Effect(
    "limits_enforced", "a position limit", "does not enforce position limits unless they are enabled"
)
SELF: Final = Effect("self_collision", "several bodies in a tree", "lets no links of one tree touch each other")
EARTH: Final = Effect("gravity", "gravity other than 9.81 m/s² down", "reads no gravity: 9.81 m/s² along -z")
RATINGS: Final = (
    Effect("joint.velocity_limit", "velocity limit", "drops the velocity limits of joints"),
    Effect("joint.effort_limit", "effort limit", "drops the effort limits of joints"),
)
URDF: Final = (LIMITS, SELF)
MJCF: Final = (
    LIMITS,
    SELF,
    EARTH,
    RATINGS[1],
    Effect("timestep", "timestep other than 1 ms", "reads no timestep: 1 ms"),
    Effect("inertia", "mass that moves", "replaces every inertia tensor by the unit tensor"),
    Effect("mass", "no shape", "gives a body without shapes 1 kg"),
    Effect(
        "centre_of_mass", "no shape, centre elsewhere", "puts the centre of mass of a body without shapes at its origin"
    ),
    Effect("joint.dry_friction", "dry friction", "drops the dry friction of joints"),
    Effect("joint.spring_stiffness", "spring of a hinge or a slide", "drops the springs of joints"),
    Effect("joint.damping", "damping of a ball joint", "drops the damping of ball joints"),
    Effect("shapes", "plane", "replaces a plane by a cube of 1 m"),
)
SDF: Final = (
    Effect(REFUSED, "every file", "refuses versions above 1.6; use --profile 1.6", profiles=("1.9",)),
    SELF,
    EARTH,
    *RATINGS,
    Effect("joint.type", "tree that cannot move", "lets a static model move freely"),
    Effect("shapes", "plane", "replaces a plane by a box of 200 m x 200 m x 1 mm"),
)

FOREIGN: Final[Mapping[str, Reads]] = {
    "urdf": Reads("dartpy.utils.DartLoader().parseWorld(file)", (".urdf",), "robot", version=MEASURED, effects=URDF),
    "sdf": Reads("dartpy.utils.SdfParser.readWorld(file)", (".sdf", ".world"), "sdf", version=MEASURED, effects=SDF),
    "mjcf": Reads(
        "dartpy.utils.MjcfParser.readWorld(file)", (".xml", ".mjcf"), "mujoco", version=MEASURED, effects=MJCF
    ),
    "skel": Reads("dartpy.utils.SkelParser.readWorld(file)", (".skel",), "skel", defines=True),
}
FOREIGN_ADDITIONS: Final[Mapping[str, EngineAddition]] = {
    "gravity": EngineAddition(
        None, "default", "-9.81 m/s² along z, or along y in files of DART's own, unless the file says another"
    ),
    "timestep": EngineAddition(None, "default", "1 ms, unless the file says another"),
    "limits_enforced": EngineAddition(True, "physics", "joints pass their limits until setLimitEnforcement(True)"),
    "self_collision": EngineAddition(
        True, "physics", "links of one skeleton touch each other after enableSelfCollisionCheck()"
    ),
    "mimic_joints": EngineAddition(
        None, "default", "joints that follow others: the follower is driven, and pushes nothing back"
    ),
}
"""DART's additions to a file."""
MOVES: Final = {
    **JOINT_KINDS,
    "PlanarJoint": "planar",
    "UniversalJoint": "universal",
    "EulerJoint": "ball (Euler angles)",
}


class DartForeignFile:
    """A world with a file loaded."""

    def __init__(self, dartpy: Any, log: list[str]):
        self._dart, self._log = dartpy, log

    def load(self, file: Path, language: str, packages: Mapping[str, str]) -> ReadBack:
        """A file as DART stores it. Raises EngineError where it refuses it."""
        try:
            with captured(sys.stderr, self._log):
                world = self._reader(language, packages)(self._dart.common.Uri.createFromPath(str(file)))
        except (RuntimeError, ValueError) as error:
            raise EngineError(NAME, "; ".join([f"refuses the file: {error}", *self._log[-3:]])) from error
        if world is None:
            raise EngineError(NAME, f"refuses the file: {' '.join(self._log) or 'no reason given'}")
        skeletons = [world.getSkeleton(index) for index in range(world.getNumSkeletons())]
        nodes = [node for skeleton in skeletons for node in skeleton.getBodyNodes()]
        names = distinct_names([node.getName() for node in nodes])
        for skeleton in skeletons:
            _to_zero(skeleton)
        placed = {(node.getSkeleton().getName(), node.getName()): name for node, name in zip(nodes, names, strict=True)}
        links = [_link(node, name, placed) for node, name in zip(nodes, names, strict=True)]
        joints = [node.getParentJoint() for node in nodes]
        inventory: dict[str, EngineValue] = {
            "gravity": tuple(vector(world.getGravity())),
            "timestep": float(world.getTimeStep()),
            "mimic_joints": sum("imic" in str(joint.getActuatorType()) for joint in joints),
        }
        limited = [joint for joint in joints if _limits(joint)]
        if limited:
            inventory["limits_enforced"] = all(joint.areLimitsEnforced() for joint in limited)
        if any(skeleton.getNumBodyNodes() > 1 for skeleton in skeletons):
            inventory["self_collision"] = all(skeleton.isEnabledSelfCollisionCheck() for skeleton in skeletons)
        return ReadBack(
            bodies_of_links(links),
            vector(world.getGravity()),
            float(world.getTimeStep()),
            unreadable={"armature": "DART has no armature"},
            inventory=inventory,
        )

    def _reader(self, language: str, packages: Mapping[str, str]) -> Callable[[Any], Any]:
        utils = self._dart.utils
        if language != "urdf":
            parsers = {"sdf": utils.SdfParser, "mjcf": utils.MjcfParser, "skel": utils.SkelParser}
            reader: Callable[[Any], Any] = parsers[language].readWorld
            return reader
        loader = utils.DartLoader()
        for name, folder in packages.items():
            loader.addPackageDirectory(name, folder)

        def read(uri: Any) -> Any:
            skeleton = loader.parseSkeleton(uri)
            if skeleton is None:
                return None
            world = self._dart.simulation.World()
            world.addSkeleton(skeleton)
            return world

        return read


def _to_zero(skeleton: Any) -> None:
    """All coordinates to zero, but those of a free root."""
    for index in range(skeleton.getNumJoints()):
        joint = skeleton.getJoint(index)
        if joint.getType() != "FreeJoint":
            joint.setPositions(np.zeros(joint.getNumDofs()))


def _link(node: Any, name: str, placed: Mapping[tuple[str, str], str]) -> EngineLink:
    above, joint = node.getParentBodyNode(), node.getParentJoint()
    anchor = transform_pose(joint.getTransformFromChildBodyNode())
    return EngineLink(
        name,
        None if above is None else placed[above.getSkeleton().getName(), above.getName()],
        transform_pose(node.getWorldTransform()),
        inertial(node),
        _foreign_joint(joint, anchor),
        anchor.position if joint.getType() != "FreeJoint" else (0.0, 0.0, 0.0),
        tuple(map(_foreign_shape, shape_nodes(node))),
    )


def _limits(joint: Any) -> tuple[float, float] | None:
    if MOVES.get(joint.getType()) not in SCALAR_JOINTS:
        return None
    return range_of(joint.getPositionLowerLimit(0), joint.getPositionUpperLimit(0))


def _foreign_joint(joint: Any, anchor: Pose) -> Joint:
    kind = MOVES.get(joint.getType(), str(joint.getType()))
    if kind not in SCALAR_JOINTS:
        return Joint(joint.getName(), kind)
    return Joint(
        joint.getName(),
        kind,
        axis=frames.rotate(anchor.quaternion, vector(joint.getAxis())),
        position_limits=_limits(joint),
        velocity_limit=bound(joint.getVelocityUpperLimit(0)),
        effort_limit=bound(joint.getForceUpperLimit(0)),
        damping=joint.getDampingCoefficient(0),
        dry_friction=joint.getCoulombFriction(0),
        spring_stiffness=joint.getSpringStiffness(0),
        spring_rest=joint.getRestPosition(0),
    )


def _foreign_shape(node: Any) -> Shape:
    stored = node.getShape()
    kind, size = shape_size(stored) or (stored.getType(), ())
    if kind in ("MeshShape", "ConvexMeshShape"):
        box = stored.getBoundingBox()
        kind, size = MESH, box_support(box.getMin(), box.getMax())
    return Shape(
        node.getName(),
        kind,
        size,
        transform_pose(node.getRelativeTransform()),
        collision=node.hasCollisionAspect() and node.getCollisionAspect().isCollidable(),
        visual=node.hasVisualAspect(),
        surfaces=surfaces_of(node),
    )
