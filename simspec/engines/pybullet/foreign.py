"""A URDF, MJCF or SDF file as PyBullet's own loaders make it, with their default flags.

Facts marked *measured*: pybullet 3.2.7.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.engines.kit.foreign import (
    MESH,
    REFUSED,
    Effect,
    EngineAddition,
    EngineLink,
    Reads,
    bodies_of_links,
    distinct_names,
    support,
)
from simspec.engines.kit.messages import captured
from simspec.engines.pybullet.simulation import GREETING
from simspec.engines.pybullet.trees import JOINT_KINDS, SHAPE_KINDS, Client, joint_fields, pose_at, shape_size
from simspec.errors import EngineError
from simspec.formats.kit.contract import tensor
from simspec.world import frames
from simspec.world.types import EngineValue, Inertial, Joint, Pose, ReadBack, Shape, Surface

# Changes of PyBullet's loaders to plain files (pybullet 3.2.7), measured by tests/formats/test_readers.py.

MEASURED: Final = "3.2.7"
ALWAYS: Final = (
    Effect(
        "joints_held_by_motors", "a hinge or a slide", "holds hinges and slides by motors until they are given none"
    ),
    Effect("velocity_clamp", "a hinge or a slide", "lets no joint move faster than 100 rad/s or m/s", seen="elsewhere"),
)
DAMPING: Final = "damps what moves freely by 4 % of its speed a second"
SELF: Final = "lets no links of one tree touch each other"
MARGIN: Final = Effect(
    "collision_margin", "a shape that is no sphere", "adds up to 1 mm of collision margin around shapes"
)
HULLS: Final = Effect("shapes", "cylinder", "replaces cylinders by hulls of points")
TENSORS: Final = "computes inertia tensors from the shapes' boxes"
SHAPES: Final = (
    Effect("inertia", "mass that moves, other than a uniform sphere or box", TENSORS, seen="may"),
    HULLS,
    MARGIN,
)
URDF: Final = (
    *ALWAYS,
    Effect("linear_damping", "a free body", DAMPING, profiles=("fixed-base",)),
    *SHAPES,
    Effect("self_collision", "several links", SELF, profiles=("fixed-base",)),
    Effect("self_collision", "every file", SELF, profiles=("floating",)),
    Effect(
        "joint.type",
        "free root",
        "reads no floating joint: the root is fixed to the world; the profile fixed-base keeps it free",
        profiles=("floating",),
    ),
)
SCENE: Final = (
    Effect("gravity", "gravity", "reads no gravity"),
    Effect("timestep", "every file", "reads no timestep: 1/240 s"),
)
MJCF: Final = (
    *ALWAYS,
    *SCENE,
    Effect("linear_damping", "free root or fixed root with mass or volume", DAMPING),
    Effect("self_collision", "several bodies in a tree, or a hinge or a slide", SELF),
    *(
        Effect(quantity, "root on a ball joint", "lets a root on a ball joint move freely", seen="may")
        for quantity in ("joint.type", "joint.origin.xyz", "mass")
    ),
    Effect("joint.type", "hinge or slide", "puts each joint on a further link, to which the body is fixed"),
    Effect("joint.type", "fixed root with mass or volume", "lets a body that is fixed to the world move freely"),
    Effect("mass", "fixed root with volume, without mass", "gives a body without mass that of its shapes as water"),
    Effect("inertia", "mass, other than a uniform sphere, box or cylinder", TENSORS, seen="may"),
    Effect("body", "body on a ball joint, or on such a body", "drops bodies on ball joints, and all that they carry"),
)
NEW: Final = ("1.9",)
ELSEWHERE: Final = "reads no quaternions and no relative places: links and shapes stand elsewhere; use --profile 1.6"
SDF: Final = (
    Effect(REFUSED, "something joined to the world", "refuses files in which a joint joins something to the world"),
    Effect(REFUSED, "a ball joint", "refuses files with ball joints"),
    Effect(REFUSED, "an ellipsoid", "refuses files with ellipsoids", profiles=NEW),
    *ALWAYS,
    *SCENE,
    Effect("linear_damping", "a free body", DAMPING),
    *SHAPES,
    Effect("self_collision", "several bodies in a tree", SELF),
    *(
        Effect(quantity, "every file", ELSEWHERE, profiles=NEW, seen="may")
        for quantity in ("joint.origin.xyz", "joint.type", "shapes", "pose", "inertia", "mass", "centre_of_mass")
    ),
)

FOREIGN: Final[Mapping[str, Reads]] = {
    "urdf": Reads("pybullet.loadURDF(file)", (".urdf",), "robot", version=MEASURED, effects=URDF),
    "mjcf": Reads("pybullet.loadMJCF(file)", (".xml", ".mjcf"), "mujoco", version=MEASURED, effects=MJCF),
    "sdf": Reads("pybullet.loadSDF(file)", (".sdf", ".world"), "sdf", version=MEASURED, effects=SDF),
}
LOADERS: Final = {"urdf": "loadURDF", "mjcf": "loadMJCF", "sdf": "loadSDF"}
FOREIGN_ADDITIONS: Final[Mapping[str, EngineAddition]] = {
    "gravity_set": EngineAddition(None, "default", "there is no gravity before setGravity"),
    "timestep": EngineAddition(None, "default", "1/240 s, by default"),
    "linear_damping": EngineAddition(
        0.0,
        "physics",
        "share of its speed that what moves loses each second; set linearDamping and angularDamping to 0",
    ),
    "joints_held_by_motors": EngineAddition(
        0, "physics", "hinges and slides start with a motor that holds them; give VELOCITY_CONTROL with force 0"
    ),
    "velocity_clamp": EngineAddition(None, "physics", "no joint moves faster (rad/s, m/s); set maxJointVelocity"),
    "self_collision": EngineAddition(
        True, "physics", "links of one body touch each other only with URDF_USE_SELF_COLLISION"
    ),
    "collision_margin": EngineAddition(
        0.0, "physics", "largest margin (m) that is added around a shape; set collisionMargin to 0"
    ),
}
"""PyBullet's additions to a file."""
GEOMETRIES: Final = {**SHAPE_KINDS, 5: MESH}
TREE_JOINTS: Final = {**JOINT_KINDS, 3: "planar", 5: "point to point", 6: "gear"}
CRASHING: Final = {"mjcf": "getCollisionShapeData crashes with trees of loadMJCF (measured)"}
"""Languages whose shapes are not queried, with the reason."""
MOST_SPEED: Final = 1e4
"""rad/s or m/s given to a joint to see whether its speed is clamped."""
CLAMP: Final = 100.0
"""The speed that PyBullet lets no joint exceed by default."""
STOPPED: Final = 0.5
"""Share of a small speed below which a joint is said to be held after one step."""
TRIED: Final = 1e-3
"""That small speed (rad/s, m/s): centrifugal forces, and a part of the damping, grow with its square."""


class PybulletForeignFile:
    """A client with a file loaded."""

    def __init__(self, bullet: Any, log: list[str]):
        self._p, self._log, self._language = Client(bullet, bullet.connect(bullet.DIRECT)), log, ""

    def close(self) -> None:
        """Free the client."""
        self._p.disconnect()

    def load(self, file: Path, language: str) -> ReadBack:
        """A file as PyBullet stores it. Raises EngineError where it refuses it."""
        p, self._language = self._p, language
        try:
            with captured(sys.stdout, self._log, (GREETING,)):
                loaded = getattr(p, LOADERS[language])(str(file))
        except p.error as error:
            raise EngineError("pybullet", "; ".join([f"refuses the file: {error}", *self._log[-3:]])) from error
        trees = [loaded] if isinstance(loaded, int) else list(loaded)
        with captured(sys.stdout, self._log, (GREETING,)):
            links = [link for uid in trees for link in self._links(uid)]
            bodies = bodies_of_links(_with_distinct_names(links))
            parameters = p.getPhysicsEngineParameters()
            inventory = self._inventory(trees, parameters)
        unreadable: dict[str, str] = {}
        if language in CRASHING:
            unreadable["shapes"] = CRASHING[language]
        gravity = tuple(parameters[f"gravityAcceleration{axis}"] for axis in "XYZ")
        return ReadBack(
            bodies,
            gravity,
            parameters["fixedTimeStep"],
            unreadable=unreadable,
            inventory=inventory,
        )

    # --- the model ----------------------------------------------------------------------------------------------------

    def _links(self, uid: int) -> list[EngineLink]:
        p = self._p
        count = p.getNumJoints(uid)
        model = p.getBodyInfo(uid)
        infos = [p.getJointInfo(uid, joint) for joint in range(count)]
        names = distinct_names(
            [model[0].decode(errors="replace"), *(info[12].decode(errors="replace") for info in infos)]
        )
        return [self._link(uid, link, names, infos) for link in range(-1, count)]

    def _link(self, uid: int, link: int, names: list[str], infos: list[Any]) -> EngineLink:
        p = self._p
        dynamics = p.getDynamicsInfo(uid, link)
        inertial = pose_at(dynamics, 3)
        turned = tensor(tuple(dynamics[2]), inertial.quaternion)
        mass = Inertial(float(dynamics[0]), inertial.position, turned)
        shapes = self._shapes(uid, link, inertial, dynamics)
        if link < 0:
            pose = frames.compose(pose_at(p.getBasePositionAndOrientation(uid), 0), frames.inverse(inertial))
            # a base without mass does not move (measured)
            joint = Joint("", "free" if dynamics[0] else "fixed")
            return EngineLink(names[0], None, pose, mass, joint, shapes=shapes)
        if infos[link][2] in (0, 1):
            p.resetJointState(uid, link, 0.0)
        state = p.getLinkState(uid, link, computeForwardKinematics=1)
        pose = pose_at(state, 4)
        joint = _joint(infos[link], inertial)
        return EngineLink(names[link + 1], names[infos[link][16] + 1], pose, mass, joint, shapes=shapes)

    def _shapes(self, uid: int, link: int, inertial: Pose, dynamics: Any) -> tuple[Shape, ...]:
        p = self._p
        surface = (Surface(dynamics[1], dynamics[7], dynamics[6], dynamics[5]),)
        shapes = []
        for number, entry in enumerate(self._colliders(uid, link)):
            kind = GEOMETRIES.get(entry[2], f"its kind {entry[2]}")
            pose = frames.compose(inertial, pose_at(entry, 5))
            size = shape_size(kind, entry[3])
            if kind == MESH:
                size, pose = self._mesh(uid, link, number), inertial
            shapes.append(Shape("", kind, size, pose, visual=False, surfaces=surface))
        for entry in p.getVisualShapeData(uid):
            if entry[1] == link:
                kind = GEOMETRIES.get(entry[2], f"its kind {entry[2]}")
                pose = pose_at(entry, 5)
                size = () if kind == MESH else shape_size(kind, entry[3])
                shapes.append(Shape("", kind, size, pose, collision=False))
        return tuple(shapes)

    def _colliders(self, uid: int, link: int) -> Any:
        if self._language in CRASHING:
            return ()
        return self._p.getCollisionShapeData(uid, link)

    def _mesh(self, uid: int, link: int, number: int) -> tuple[float, ...]:
        """The support function of a collision mesh, in the link's inertial frame: PyBullet has vertices there (measured)."""
        p = self._p
        count, vertices = p.getMeshData(uid, link, collisionShapeIndex=number)
        return support(np.array(vertices, dtype=float).reshape(-1, 3)) if count else ()

    # --- what is added ------------------------------------------------------------------------------------------------

    def _inventory(self, trees: list[int], parameters: Mapping[str, Any]) -> dict[str, EngineValue]:
        """Additions that are never in a file; measured, where PyBullet does not report them, by single steps without
        gravity."""
        p = self._p
        found: dict[str, EngineValue] = {
            "gravity_set": any(parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"),
            "timestep": parameters["fixedTimeStep"],
        }
        if any(p.getNumJoints(uid) for uid in trees):
            found["self_collision"] = False  # as it is loaded: without the flag (measured, in the tests)
        links = [(uid, link) for uid in trees for link in range(-1, p.getNumJoints(uid))]
        margins = [
            p.getDynamicsInfo(uid, link)[11]
            for uid, link in links
            if any(entry[2] != 2 for entry in self._colliders(uid, link))
        ]
        found["collision_margin"] = float(max(margins, default=0.0))
        movers = [(uid, link) for uid, link in links if link >= 0 and p.getJointInfo(uid, link)[2] in (0, 1)]
        p.setGravity(0, 0, 0)
        for uid, link in links:
            p.setCollisionFilterGroupMask(uid, link, 0, 0)
        free = [uid for uid in trees if p.getDynamicsInfo(uid, -1)[0]]
        if free:
            found["linear_damping"] = self._damping(free, parameters["fixedTimeStep"])
        if movers:
            found |= self._motors(movers)
        return found

    def _damping(self, free: list[int], timestep: float) -> float:
        """Share of the speed that a body loses in a second, from one step of all trees that are free, moved as a whole."""
        p = self._p
        for uid in free:
            p.resetBaseVelocity(uid, [TRIED, 0.0, 0.0], [0.0, 0.0, 0.0])
        p.stepSimulation()
        lost = [1.0 - p.getBaseVelocity(uid)[0][0] / TRIED for uid in free]
        for uid in free:
            p.resetBaseVelocity(uid, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
        return float(round(max(lost) / timestep, 3) + 0.0)

    def _motors(self, movers: list[tuple[int, int]]) -> dict[str, EngineValue]:
        p = self._p
        number = 0
        for uid, link in movers:
            p.resetJointState(uid, link, 0.0, TRIED)
        p.stepSimulation()
        for uid, link in movers:
            number += abs(p.getJointState(uid, link)[1]) < STOPPED * TRIED
            p.resetJointState(uid, link, 0.0, 0.0)
        for uid, link in movers:
            p.setJointMotorControl2(uid, link, p.VELOCITY_CONTROL, force=0.0)
        uid, link = movers[-1]
        p.resetJointState(uid, link, 0.0, MOST_SPEED)
        p.stepSimulation()
        speed = abs(p.getJointState(uid, link)[1])
        # a speed after joint damping or a limit has acted too says nothing of the clamp
        clamped: dict[str, EngineValue] = {"velocity_clamp": CLAMP} if abs(speed - CLAMP) <= CLAMP * TRIED else {}
        return {"joints_held_by_motors": number, **clamped}


def _with_distinct_names(links: list[EngineLink]) -> list[EngineLink]:
    """Links of several trees, whose names may be the same."""
    seen: dict[str, int] = {}
    renamed: list[EngineLink] = []
    names: dict[str, str] = {}
    for link in links:
        if link.parent is None:
            names = {}
        count = seen[link.name] = seen.get(link.name, 0) + 1
        names[link.name] = link.name if count == 1 else f"{link.name}#{count}"
        parent = None if link.parent is None else names[link.parent]
        renamed.append(dataclasses.replace(link, name=names[link.name], parent=parent))
    return renamed


def _joint(info: Any, inertial: Pose) -> Joint:
    kind = TREE_JOINTS.get(info[2], f"its kind {info[2]}")
    return Joint(info[1].decode(errors="replace"), kind, **joint_fields(info, kind, inertial))
