"""PyBullet's bodies, loaded from files and held against the sidecar; PyBullet's additions are switched off."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simspec.dialects.pybullet.sidecar import FixedFrame, PybulletInstance
from simspec.errors import EngineError
from simspec.language.vocabulary import SCALAR_JOINTS, TREE_JOINTS
from simspec.world import frames
from simspec.world.rotations import conjugate, cross, from_xyzw_of, multiply, positive, rotate, to_xyzw_of
from simspec.world.types import Body, Inertial, Joint, Pose, Quaternion

# Rotations as PyBullet returns them.


def turn_of(q: Sequence[float]) -> Quaternion:
    """The rotation of a quaternion x y z w, brought to unit length: some that PyBullet reports have single precision."""
    return frames.normalise(from_xyzw_of(q))


def pose_at(values: Sequence[Any], place: int) -> Pose:
    """The pose of the position at ``place`` of PyBullet's answer and the rotation after it."""
    return Pose(tuple(values[place]), turn_of(values[place + 1]))


def joint_pose(info: Sequence[Any], parent: Pose, child: Pose) -> Pose:
    """The place of a joint in the parent's frame, from getJointInfo and the inertial frames of both links. PyBullet's is in the
    parent's inertial frame, with the rotation from there to the child's inertial axes, inverted (measured)."""
    turn = frames.multiply(parent.quaternion, frames.conjugate(turn_of(info[15])))
    place = frames.add(parent.position, frames.rotate(parent.quaternion, tuple(info[14])))
    return Pose(place, frames.multiply(turn, frames.conjugate(child.quaternion)))


def joint_fields(info: Sequence[Any], kind: str, inertial: Pose) -> dict[str, Any]:
    """The fields of a joint from getJointInfo; ``inertial``: the inertial frame of its link."""
    damping = 0.0 if kind == "fixed" else info[6]
    if kind not in SCALAR_JOINTS:
        return {"damping": damping}
    lower, upper, effort, velocity = info[8:12]
    return {
        "axis": frames.rotate(inertial.quaternion, tuple(info[13])),
        "position_limits": (lower, upper) if lower <= upper else None,
        "velocity_limit": velocity if velocity > 0.0 else None,
        "effort_limit": effort if effort > 0.0 else None,
        "damping": damping,
        "dry_friction": info[7],
    }


def shape_size(kind: str, numbers: Sequence[float]) -> tuple[float, ...]:
    """The size of a shape that is no mesh."""
    if kind == "sphere":
        return (numbers[0],)
    if kind == "box":
        return tuple(numbers[:3])
    return (numbers[1], numbers[0]) if kind in ("cylinder", "capsule") else ()  # PyBullet has the length first


SHAPE_KINDS = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule"}
"""PyBullet's GEOM_ numbers."""
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
class PybulletTree:
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
        folder: Path,
        settings: Mapping[str, Any],
        names: Sequence[str],
        kinds: Sequence[str],
        q: Sequence[slice],
        v: Sequence[slice],
        hull_faces: bool,
    ):
        self._hull_faces = hull_faces
        self.bullet, self.folder, self.settings = bullet, folder, settings
        self.kinds, self._q, self._v = kinds, q, v
        self.place = {name: index for index, name in enumerate(names)}
        self._file_links: dict[str, list[str]] = {}

    def load(self, instance: PybulletInstance) -> PybulletTree:
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
            )
        except p.error as error:
            raise EngineError("pybullet", f"refused {instance.file!r}: {error}") from error
        extra = int(instance.root == "world link")
        self._check_links(uid, extra, instance)
        links = []
        for position, name in enumerate(instance.bodies):
            index, link = self.place[name], position - 1 + extra
            turn = turn_of(p.getDynamicsInfo(uid, link)[4])
            self._check_kind(uid, link, name, instance.root)
            links.append(Link(index, link, self.kinds[index], self._q[index], self._v[index], turn))
        movers = tuple(link for link in links if link.kind in TREE_JOINTS)
        first = len(instance.bodies) - 1 + extra
        copies = tuple((first + k, self.place[copy.body]) for k, copy in enumerate(instance.copies))
        tree = PybulletTree(uid, instance.root, tuple(links), movers, copies)
        self._quieten(tree)
        return tree

    def _check_links(self, uid: int, extra: int, instance: PybulletInstance) -> None:
        """The links must be those of the sidecar, in its order; ``extra`` world links come before them."""
        p = self.bullet
        actual = [p.getBodyInfo(uid)[0].decode()]
        actual += [p.getJointInfo(uid, joint)[12].decode() for joint in range(p.getNumJoints(uid))]
        names = [*instance.bodies, *(copy.link for copy in instance.copies)]
        wanted = self._file_links.setdefault(instance.file, names)
        if actual[extra:] != wanted or len(wanted) != len(names):
            raise EngineError(
                "pybullet", f"{instance.file!r} holds the links {actual[extra:]}, the sidecar names {wanted}"
            )

    def _check_kind(self, uid: int, link: int, name: str, root: str) -> None:
        """The joint above a link must be of the kind that the sidecar says."""
        if link < 0:
            joint_kind = "free" if root == "free" else "fixed"
        else:
            number = self.bullet.getJointInfo(uid, link)[2]
            joint_kind = JOINT_KINDS.get(number, f"its type {number}")
        if joint_kind != self.kinds[self.place[name]]:
            kind = self.kinds[self.place[name]]
            raise EngineError("pybullet", f"holds the joint of {name!r} as {joint_kind}, the sidecar says {kind}")

    def _quieten(self, tree: PybulletTree) -> None:
        """Switch off what PyBullet adds: damping, motors, velocity clamps, margins. Set dry friction."""
        p = self.bullet
        anchor = {"frictionAnchor": 1} if self.settings["friction_erp"] else {}
        for number in range(-1, p.getNumJoints(tree.uid)):
            p.changeDynamics(
                tree.uid,
                number,
                linearDamping=0.0,
                angularDamping=0.0,
                maxJointVelocity=UNCLAMPED,
                contactProcessingThreshold=self.settings["contact_processing_threshold"],
                collisionMargin=self.settings["collision_margin"],
                **anchor,
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
                )
            else:
                rub(p, tree, link, p.getJointInfo(tree.uid, link.link)[7])


def rub(bullet: Any, tree: PybulletTree, link: Link, friction: float) -> None:
    """Give a hinge or slide dry friction: a velocity motor with target 0 and ``friction`` as its largest force."""
    bullet.setJointMotorControl2(tree.uid, link.link, bullet.VELOCITY_CONTROL, targetVelocity=0.0, force=friction)


# Which shapes which of PyBullet's links carries (see ``dialects/pybullet/sidecar.py``).


def solid_on_link(instance: PybulletInstance, position: int) -> list[str]:
    """The names of the collision shapes on the own link of a tree's body: all of its first solid shape's material. Links of
    their own carry the other materials, and further copies of the first."""
    seen = set(instance.visual_only[position])
    solid = [name for index, name in enumerate(instance.shapes[position]) if index not in seen]
    carried = [copy.shapes for copy in instance.copies if copy.body == instance.bodies[position]]
    again = next((names for names in carried if solid and solid[0] in names), None)
    elsewhere = {name for names in carried for name in names}
    return [name for name in solid if (name in again if again is not None else name not in elsewhere)]


def carriers(
    trees: Iterable[Any], instances: Iterable[PybulletInstance]
) -> dict[tuple[int, int], tuple[int, tuple[str, ...]]]:
    """Of every link (tree's uid, link) that stands for a body or carries its shapes: the body's index and those shapes' names.

    ``trees`` are ``pybullet_simulation.Tree``s, in the order of the sidecar's ``instances``.
    """
    found = {}
    for tree, instance in zip(trees, instances, strict=True):
        for position, link in enumerate(tree.links):
            found[tree.uid, link.link] = (link.index, tuple(solid_on_link(instance, position)))
        for (link, index), copy in zip(tree.copies, instance.copies, strict=True):
            found[tree.uid, link] = (index, tuple(copy.shapes))
    return found


def link_names(sim: Any) -> dict[tuple[int, int], str]:
    """The names of all links: a body's name for its own, ``BODY__MATERIAL.LAYER`` for one of its copies, ``BODY/world`` for the
    massless base that stands for the world below that root."""
    found = {}
    for tree, instance in zip(sim.trees, sim.sidecar.instances, strict=True):
        found.update({(tree.uid, link.link): sim.names[link.index] for link in tree.links})
        copies = zip(tree.copies, instance.copies, strict=True)
        found.update({(tree.uid, link): copy.link for (link, _), copy in copies})
        if tree.links[0].link >= 0:
            found[tree.uid, -1] = f"{sim.names[tree.links[0].index]}/world"
    return found


# Bodies that simspec does not pass to PyBullet, since they are only frames: their poses follow from the bodies that carry them.

Array = np.ndarray


class PybulletFrames:
    """Frames on bodies that PyBullet has, each by its pose in the frame of that body; ``index``: of all bodies in the world."""

    def __init__(self, given: Sequence[FixedFrame], index: Mapping[str, int]):
        self._frames = tuple(given)
        on: dict[str, tuple[str, Pose]] = {}
        for frame in self._frames:
            carrier, pose = on.get(frame.parent, (frame.parent, Pose()))
            on[frame.name] = (carrier, frames.compose(pose, frame.pose))
        self._rows = np.array([index[name] for name in on], dtype=int)
        self._carrier = np.array([index[carrier] for carrier, _ in on.values()], dtype=int)
        self._position = np.array([pose.position for _, pose in on.values()], dtype=float).reshape(-1, 3)
        self._turn = np.array([pose.quaternion for _, pose in on.values()], dtype=float).reshape(-1, 4)

    def place(self, at: Array, turn: Array, linear: Array, angular: Array, centre: Array, axes: Array) -> None:
        """Fill in the rows of the frames, from those of the bodies that carry them.

        ``at`` (n, 3), ``turn`` (n, 4), ``linear`` and ``angular`` (n, 3): of every body's inertial frame in the world;
        ``centre`` (n, 3) and ``axes`` (n, 4): where that is in the body's own frame.
        """
        frame, carrier = self._rows, self._carrier
        turned = multiply(turn[carrier], conjugate(axes[carrier]))
        lever = rotate(turned, self._position - centre[carrier])
        at[frame] = at[carrier] + lever
        turn[frame] = positive(multiply(turned, self._turn))
        linear[frame] = linear[carrier] + cross(angular[carrier], lever)
        angular[frame] = angular[carrier]

    def bodies(self) -> dict[str, Body]:
        """The frames as bodies of a read-back, by name."""
        return {
            frame.name: Body(
                frame.name, frame.model, Inertial(0.0), Joint(frame.joint, "fixed", frame.parent, frame.pose)
            )
            for frame in self._frames
        }


# PyBullet's input while a world was loaded, for values that cannot be read back.
#
# PyBullet returns few of its settings, and its dump of the world (``bullet_file.py``) lacks some that act: the thresholds of
# its solver and of restitution, damping of free flight, velocity clamps, motors, pairs that do not touch. Of these the proof
# knows the calls themselves. Steps are not recorded, and what a run does later is not either.

CHANGING = ("set", "change", "create", "load", "remove", "apply", "enable", "vhacd")
"""Beginnings of the names of PyBullet's functions that change what is simulated; ``reset...`` sets the state, which is read
back."""

Called = tuple[str, tuple[Any, ...], dict[str, Any]]
"""A function's name, its positional arguments, and those by name."""


class Client:
    """The functions of PyBullet's module for one client, ``number``; ``calls``, where given, records those that change
    something."""

    def __init__(self, bullet: Any, number: int, calls: list[Called] | None = None):
        self._bullet, self.number, self._calls = bullet, number, calls

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._bullet, name)
        if callable(found) and not isinstance(found, type):
            found = functools.partial(found, physicsClientId=self.number)
            if self._calls is not None and name.startswith(CHANGING):
                found = functools.partial(self._recorded, name, found)
        setattr(self, name, found)
        return found

    def _recorded(self, name: str, function: Callable[..., Any], *positional: Any, **named: Any) -> Any:
        if self._calls is not None:
            self._calls.append((name, positional, named))
        return function(*positional, **named)


# Sleeping in PyBullet: which bodies may, and how they are woken. Facts marked *measured*: pybullet 3.2.7.

SLOW = 1e-4
"""v² + ω² (m²/s², rad²/s²) below which a body counts as at rest; PyBullet's own 0.05 stops what slides at 0.2 m/s (measured).
It falls asleep after 2 s of that, a time that PyBullet does not let one set."""


class Sleepers:
    """The bodies of one client that may fall asleep.

    Touching a sleeping body wakes it within the step. Efforts and new velocities do not: PyBullet drops them (measured).
    """

    def __init__(self, sim: Any, uids: Iterable[int]):
        self._sim, self._uids = sim, set(uids)
        bullet = sim.bullet
        self._any, self._stepped = bool(self._uids), False
        for uid in self._uids:
            self._change(uid, activationState=bullet.ACTIVATION_STATE_ENABLE_SLEEPING, sleepThreshold=SLOW)

    def _change(self, uid: int, **given: Any) -> None:
        self._sim.bullet.changeDynamics(uid, -1, **given)

    def __contains__(self, uid: int) -> bool:
        return uid in self._uids

    def stepped(self) -> None:
        """Time has gone by: something may sleep now."""
        self._stepped = True

    def wake(self) -> None:
        """Wake all, by a step that the caller must undo: a woken body is still left out of the next step (measured)."""
        if not (self._any and self._stepped):
            return
        bullet = self._sim.bullet
        for uid in self._uids:
            self._change(uid, activationState=bullet.ACTIVATION_STATE_WAKE_UP)
        bullet.stepSimulation()
        self._stepped = False

    def forbid(self, uid: int) -> None:
        """One body will sleep no more; ``wake`` must follow."""
        bullet = self._sim.bullet
        self._change(uid, activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING)
        self._change(uid, activationState=bullet.ACTIVATION_STATE_WAKE_UP)
        self._uids.discard(uid)
