"""PyBullet's bodies, loaded from files and held against the sidecar; what PyBullet adds to them is switched off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simspec.dialects.pybullet.sidecar import Instance
from simspec.engines.pybullet.turns import told_turn
from simspec.errors import EngineError
from simspec.language.vocabulary import TREE_JOINTS
from simspec.world.rotations import to_xyzw_of
from simspec.world.types import Quaternion

JOINT_KINDS = {0: "hinge", 1: "slide", 2: "ball", 4: "fixed"}
"""PyBullet's JOINT_ numbers."""
UNCLAMPED = 1e30
"""For PyBullet's velocity clamp (100 by default) and for limits that must never act."""


@dataclass(frozen=True, slots=True)
class Link:
    """One body of the world in PyBullet: ``index`` in the world, ``link`` in its tree (−1 the base), joint ``kind``,
    the slices of its coordinates in q and v, and ``turn``, its principal axes in its frame."""

    index: int
    link: int
    kind: str
    q: slice
    v: slice
    turn: Quaternion


@dataclass(frozen=True, slots=True)
class Tree:
    """One PyBullet body: its unique id and its links in the order of the file."""

    uid: int
    root: str
    links: tuple[Link, ...]
    movers: tuple[Link, ...]
    """The links on hinges, slides and balls."""
    copies: tuple[tuple[int, int], ...] = ()
    """Links that only carry shapes: (link, index of the body in the world), in the sidecar's order."""


class Loader:
    """Loads trees into a client, from ``folder``.

    ``names``, ``kinds``, ``q``, ``v``: of the world's bodies, with their slices of the coordinates.
    """

    def __init__(
        self,
        bullet: Any,
        client: int,
        folder: Path,
        settings: Mapping[str, Any],
        names: Sequence[str],
        kinds: Sequence[str],
        q: Sequence[slice],
        v: Sequence[slice],
        hull_faces: bool,
    ):
        self._hull_faces = hull_faces
        self.bullet, self.client, self.folder, self.settings = bullet, client, folder, settings
        self.kinds, self._q, self._v = kinds, q, v
        self.place = {name: index for index, name in enumerate(names)}
        self._file_links: dict[str, list[str]] = {}

    def load(self, instance: Instance) -> Tree:
        """One tree. Raises EngineError where PyBullet refuses the file or holds another tree than the sidecar says."""
        p, path = self.bullet, self.folder / instance.file
        if not path.is_file():
            raise EngineError("pybullet", f"the file {instance.file!r} is missing")
        base = instance.base
        flags = (
            p.URDF_USE_INERTIA_FROM_FILE
            | p.URDF_USE_IMPLICIT_CYLINDER
            | p.URDF_MAINTAIN_LINK_ORDER
            | p.URDF_USE_SELF_COLLISION
            | p.URDF_USE_SELF_COLLISION_INCLUDE_PARENT
            | (p.URDF_INITIALIZE_SAT_FEATURES if self._hull_faces else 0)
        )
        try:
            uid = p.loadURDF(
                str(path),
                basePosition=base.position,
                baseOrientation=to_xyzw_of(base.quaternion),
                useFixedBase=int(instance.root != "free"),
                flags=flags,
                physicsClientId=self.client,
            )
        except p.error as error:
            raise EngineError("pybullet", f"refused {instance.file!r}: {error}") from error
        extra = int(instance.root == "world link")
        self._check_links(uid, extra, instance)
        links = []
        for position, name in enumerate(instance.bodies):
            index, link = self.place[name], position - 1 + extra
            turn = told_turn(p.getDynamicsInfo(uid, link, physicsClientId=self.client)[4])
            self._check_kind(uid, link, name, instance.root)
            links.append(Link(index, link, self.kinds[index], self._q[index], self._v[index], turn))
        movers = tuple(link for link in links if link.kind in TREE_JOINTS)
        first = len(instance.bodies) - 1 + extra
        copies = tuple((first + k, self.place[copy.body]) for k, copy in enumerate(instance.copies))
        tree = Tree(uid, instance.root, tuple(links), movers, copies)
        self._quieten(tree)
        return tree

    def _check_links(self, uid: int, extra: int, instance: Instance) -> None:
        """The links must be those of the sidecar, in its order; ``extra`` world links come before them."""
        p, client = self.bullet, self.client
        held = [p.getBodyInfo(uid, physicsClientId=client)[0].decode()]
        held += [
            p.getJointInfo(uid, joint, physicsClientId=client)[12].decode()
            for joint in range(p.getNumJoints(uid, physicsClientId=client))
        ]
        own = [*instance.bodies, *(copy.link for copy in instance.copies)]
        wanted = self._file_links.setdefault(instance.file, own)
        if held[extra:] != wanted or len(wanted) != len(own):
            raise EngineError(
                "pybullet", f"{instance.file!r} holds the links {held[extra:]}, the sidecar names {wanted}"
            )

    def _check_kind(self, uid: int, link: int, name: str, root: str) -> None:
        """The joint above a link must be of the kind that the sidecar says."""
        if link < 0:
            held = "free" if root == "free" else "fixed"
        else:
            number = self.bullet.getJointInfo(uid, link, physicsClientId=self.client)[2]
            held = JOINT_KINDS.get(number, f"its type {number}")
        if held != self.kinds[self.place[name]]:
            told = self.kinds[self.place[name]]
            raise EngineError("pybullet", f"holds the joint of {name!r} as {held}, the sidecar says {told}")

    def _quieten(self, tree: Tree) -> None:
        """Switch off what PyBullet adds: damping, motors, velocity clamps, margins. Set dry friction."""
        p, client = self.bullet, self.client
        anchor = {"frictionAnchor": 1} if self.settings["friction_erp"] else {}
        for number in range(-1, p.getNumJoints(tree.uid, physicsClientId=client)):
            p.changeDynamics(
                tree.uid,
                number,
                linearDamping=0.0,
                angularDamping=0.0,
                maxJointVelocity=UNCLAMPED,
                contactProcessingThreshold=self.settings["contact_processing_threshold"],
                collisionMargin=self.settings["collision_margin"],
                **anchor,
                physicsClientId=client,
            )
        for link in tree.movers:
            if link.kind == "ball":
                p.setJointMotorControlMultiDof(
                    tree.uid,
                    link.link,
                    p.POSITION_CONTROL,
                    targetPosition=[0.0, 0.0, 0.0, 1.0],
                    positionGain=0.0,
                    velocityGain=0.0,
                    force=[0.0, 0.0, 0.0],
                    physicsClientId=client,
                )
            else:
                rub(p, client, tree, link, p.getJointInfo(tree.uid, link.link, physicsClientId=client)[7])


def rub(bullet: Any, client: int, tree: Tree, link: Link, friction: float) -> None:
    """Give a hinge or slide dry friction: a velocity motor with target 0 and ``friction`` as its largest force."""
    bullet.setJointMotorControl2(
        tree.uid, link.link, bullet.VELOCITY_CONTROL, targetVelocity=0.0, force=friction, physicsClientId=client
    )
