"""A URDF, SDF, MJCF or skel file as DART's own parsers make it, with their default options.

Facts marked *measured*: dartpy 6.20.0.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.engines.dart.coordinates import JOINT_KINDS, NAME
from simspec.engines.dart.nodes import shape_nodes
from simspec.engines.dart.readback import inertial, shape_size, surfaces_of, transform_pose
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
from simspec.engines.kit.readback import bound, range_of, vector
from simspec.errors import EngineError
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import EngineValue, Joint, Pose, ReadBack, Shape

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
        _joint(joint, anchor),
        anchor.position if joint.getType() != "FreeJoint" else (0.0, 0.0, 0.0),
        tuple(map(_shape, shape_nodes(node))),
    )


def _limits(joint: Any) -> tuple[float, float] | None:
    if MOVES.get(joint.getType()) not in SCALAR_JOINTS:
        return None
    return range_of(joint.getPositionLowerLimit(0), joint.getPositionUpperLimit(0))


def _joint(joint: Any, anchor: Pose) -> Joint:
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


def _shape(node: Any) -> Shape:
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
