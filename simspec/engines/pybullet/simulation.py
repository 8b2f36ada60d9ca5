"""One PyBullet client with a world loaded: loading, state in and out, efforts, and the probes of its dynamics."""

from __future__ import annotations

import sys
from collections.abc import Container, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from simspec.dialects.pybullet.sidecar import PybulletCollisionFilter, PybulletSidecar
from simspec.engines.kit.messages import captured
from simspec.engines.pybullet.constraints import WHOLE, hold
from simspec.engines.pybullet.geometry import uses_faces, with_stl
from simspec.engines.pybullet.trees import Called, Client, Loader, PybulletFrames, Sleepers, carriers, rub, turn_of
from simspec.errors import EngineError
from simspec.world import frames
from simspec.world.rotations import conjugate, cross, from_xyzw_of, multiply, positive, rotate, to_xyzw_of
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Vector3

GREETING = "build time"
"""PyBullet prints when it was built; that is no news."""


def import_pybullet() -> Any:
    """PyBullet's module. Raises EngineError where it is not installed."""
    try:
        import pybullet
    except ImportError as error:
        raise EngineError("pybullet", f"not installed here ({error}); pip install simspec-physics[pybullet]") from error
    return pybullet


class PybulletSimulation:
    """A PyBullet client holding the artifacts of ``folder``; ``anchors``: where it holds welds (``holding.py``)."""

    def __init__(self, folder: Path, sidecar: PybulletSidecar, anchors: Mapping[str, Vector3] = MappingProxyType({})):
        self.log: list[str] = []
        self.calls: list[Called] = []
        """PyBullet's input while loading."""
        self._anchors = anchors
        self.client = -1
        self.bullet: Any = None
        try:
            with captured(sys.stdout, self.log, (GREETING,)):
                module = self._connect()
                self.bullet = Client(module, self.client, self.calls)
                self._load(folder, sidecar)
                self.bullet = Client(module, self.client)
        except EngineError as error:
            self.close()
            raise EngineError("pybullet", "; ".join([str(error).removeprefix("pybullet: "), *self.log])) from error
        except BaseException:
            self.close()
            raise

    def _connect(self) -> Any:
        """PyBullet's module, with a client made."""
        pybullet = import_pybullet()
        self.client = pybullet.connect(pybullet.DIRECT)
        if self.client < 0:
            raise EngineError("pybullet", "no physics client could be made")
        return pybullet

    # --- loading ----------------------------------------------------------------------------------------------

    def _load(self, folder: Path, sidecar: PybulletSidecar) -> None:
        self.settings = sidecar.settings
        self.sidecar = sidecar
        self.names = [body.name for body in sidecar.bodies]
        self.place = {name: index for index, name in enumerate(self.names)}
        self.kinds = [body.kind for body in sidecar.bodies]
        self.offsets = np.array([body.frame_offset for body in sidecar.bodies], dtype=float).reshape(-1, 3)
        self._lay_out()
        self._set_parameters(sidecar)
        self.folder = folder
        with with_stl(folder) as place:
            self.loaded_from = place
            """The folder by whose name PyBullet knows its files; it is gone when they are loaded."""
            faces = place != folder and uses_faces(place, float(self.settings["collision_margin"]))
            loader = Loader(self.bullet, place, self.settings, self.names, self.kinds, self._q, self._v, faces)
            self.trees = tuple(map(loader.load, sidecar.instances))
        self.carriers = carriers(self.trees, sidecar.instances)
        self.unit = {link: number for number, link in enumerate(self.carriers)}
        self.body_index = {link: body for link, (body, _) in self.carriers.items()}
        self._layered = any(tree.copies for tree in self.trees)
        self.layer: dict[tuple[int, int], int] = {}
        for tree, instance in zip(self.trees, sidecar.instances, strict=True):
            local = zip(tree.links, instance.layers, strict=True)
            self.layer.update(((tree.uid, link.link), layer) for link, layer in local)
            carried = zip(tree.copies, instance.copies, strict=True)
            self.layer.update(((tree.uid, link), copy.layer) for (link, _), copy in carried)
        self._collect()
        self.frames = PybulletFrames(sidecar.frames or (), self.place)
        self.stored_constraints = hold(self, sidecar.constraints or (), self._anchors)
        self._set_cone(sidecar)
        free = [tree.links[0] for tree in self.trees if tree.root == "free"]
        self._free = np.array([link.index for link in free], dtype=int)
        self._free_q = np.array([range(link.q.start, link.q.stop) for link in free], dtype=int)
        self._free_v = np.array([range(link.v.start, link.v.stop) for link in free], dtype=int)
        self._seen: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None
        # the sidecar names no sleepers when the setting is off
        may_sleep = set(sidecar.sleepers or ())
        self._sleepers = Sleepers(
            self,
            (tree.uid for tree in self.trees if self.names[tree.links[0].index] in may_sleep),
        )
        self._set_filter(sidecar.collision_filter)

    def _lay_out(self) -> None:
        self._q, self._v, self.nq, self.nv = [], [], 0, 0
        for kind in self.kinds:
            self._q.append(slice(self.nq, self.nq + POSITION_SIZE[kind]))
            self._v.append(slice(self.nv, self.nv + VELOCITY_SIZE[kind]))
            self.nq, self.nv = self._q[-1].stop, self._v[-1].stop

    def _set_parameters(self, sidecar: PybulletSidecar) -> None:
        given: Mapping[str, Any] = self.settings
        if not sidecar.native_contact:
            self.bullet.setPhysicsEngineParameter(contactERP=given["contact_erp"], contactSlop=given["contact_slop"])
        self.bullet.setPhysicsEngineParameter(
            numSolverIterations=given["iterations"],
            solverResidualThreshold=given["residual_threshold"],
            erp=self._joint_erp(sidecar),
            frictionERP=given["friction_erp"],
            restitutionVelocityThreshold=sidecar.restitution_threshold,
            contactBreakingThreshold=given["contact_breaking_threshold"],
            deterministicOverlappingPairs=int(given["deterministic_pairs"]),
            numSubSteps=0,
        )
        self.bullet.setGravity(*sidecar.gravity)
        self.bullet.setTimeStep(sidecar.timestep)

    @staticmethod
    def _joint_erp(sidecar: PybulletSidecar) -> Any:
        """The share of a violation that joints take back in a step: that of limits, or of closed loops, which is another."""
        closed = any(constraint.kind != "follow" for constraint in sidecar.constraints or ())
        return WHOLE if closed else sidecar.settings["joint_erp"]

    def _set_cone(self, sidecar: PybulletSidecar) -> None:
        """The elliptic cone where a link has friction. Where none has, it changes nothing, and took a third of the time of 216
        spheres (measured)."""
        links = [(tree.uid, link.link) for tree in self.trees for link in tree.links]
        links += [(tree.uid, link) for tree in self.trees for link, _ in tree.copies]
        query = self.bullet.getDynamicsInfo
        has_friction = any(query(uid, link)[1] for uid, link in links)
        elliptic = has_friction and sidecar.friction_cone == "elliptic"
        self.bullet.setPhysicsEngineParameter(enableConeFriction=int(elliptic))

    def disable_dry_friction(self, places: Container[int]) -> None:
        """Take away the dry friction of the hinges and slides at these places of v."""
        for tree in self.trees:
            for link in tree.movers:
                if link.kind != "ball" and link.v.start in places:
                    rub(self.bullet, tree, link, 0.0)

    def _collect(self) -> None:
        """The engine's masses and inertial frames of all bodies, as arrays."""
        count = len(self.names)
        self.mass = np.zeros(count)
        self.moments = np.zeros((count, 3))
        self.centre = np.zeros((count, 3))
        self.turn = np.zeros((count, 4))
        self.turn[[self.place[frame.name] for frame in self.sidecar.frames or ()], 0] = 1.0
        for tree in self.trees:
            for link in tree.links:
                info = self.bullet.getDynamicsInfo(tree.uid, link.link)
                self.mass[link.index], self.moments[link.index] = info[0], info[2]
                self.centre[link.index], self.turn[link.index] = info[3], link.turn

    @property
    def initial_state(self) -> tuple[np.ndarray, np.ndarray]:
        """The initial (q, v) of the sidecar."""
        q, v = np.zeros(self.nq), np.zeros(self.nv)
        for tree, instance in zip(self.trees, self.sidecar.instances, strict=True):
            for target, source, places in ((q, instance.position, "q"), (v, instance.velocity, "v")):
                start = 0
                for link in tree.links:
                    place = getattr(link, places)
                    stop = start + place.stop - place.start
                    target[place] = source[start:stop]
                    start = stop
        return q, v

    # --- collision filter --------------------------------------------------------------------------------------

    def _set_filter(self, content: PybulletCollisionFilter) -> None:
        where: dict[str, tuple[int, int]] = {}
        for tree, instance in zip(self.trees, self.sidecar.instances, strict=True):
            where.update((self.names[link.index], (tree.uid, link.link)) for link in tree.links)
            for (link, _), copy in zip(tree.copies, instance.copies, strict=True):
                where[copy.link] = (tree.uid, link)
        # by links, not as the file lists them: PyBullet finds pairs in this order, and its solver takes them in that; free
        # trees first, since a base of several hulls that lands on a fixed one of lower place is stopped at one point (measured)
        fixed = {tree.uid: tree.root != "free" for tree in self.trees}
        self._masks = sorted(
            ((*where[name], entry.group, entry.mask) for entry in content.classes for name in entry.links),
            key=lambda mask: (fixed[mask[0]], *mask),
        )
        for first, second in content.excluded:
            (uid, link), (other_uid, other_link) = where[first], where[second]
            self.bullet.setCollisionFilterPair(uid, other_uid, link, other_link, 0)
        self._forgotten = False
        self.forget_contacts()

    def forget_contacts(self) -> None:
        """Drop contact points of earlier steps: setting a filter mask, even the same, makes PyBullet forget a body's pairs."""
        if self._forgotten:
            return
        self._forgotten = True
        for uid, link, group, mask in self._masks:
            self.bullet.setCollisionFilterGroupMask(uid, link, group, mask)

    def detect_contacts(self) -> list[tuple[Any, ...]]:
        """PyBullet's contact points of the present state alone."""
        self.forget_contacts()
        self.bullet.performCollisionDetection()
        self._forgotten = False
        points = list(self.bullet.getContactPoints())
        if self._layered:
            self._check_layers(points)
        return points

    def _check_layers(self, points: list[tuple[Any, ...]]) -> None:
        """Copies of shapes meet in their own layer only: elsewhere they would add forces of another law."""
        for point in points:
            entry, other = (point[1], point[3]), (point[2], point[4])
            if point[8] <= 0.0 and self.layer[entry] != self.layer[other]:
                names = [self.names[self.body_index[link]] for link in (entry, other)]
                raise EngineError(
                    "pybullet",
                    f"lets copies of shapes of {names[0]!r} (layer {self.layer[entry]}) and {names[1]!r} (layer "
                    f"{self.layer[other]}) touch, which are in different layers",
                )

    def disable_contact(self) -> None:
        """No group, no mask: nothing touches anything from now on."""
        self._masks = [(uid, link, 0, 0) for uid, link, _, _ in self._masks]
        self._forgotten = False
        self.forget_contacts()
        self._masks = []

    # --- state -------------------------------------------------------------------------------------------------

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        self.move_to(q, v)
        self.forget_contacts()

    def move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        """The same with the contact points of earlier steps kept."""
        p = self.bullet
        q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
        self._seen = None
        self._sleepers.wake()
        for tree in self.trees:
            root = tree.links[0]
            if root.kind == "free":
                at, turn = q[root.q][:3], tuple(q[root.q][3:7].tolist())
                linear, angular = v[root.v][:3], frames.rotate(turn, tuple(v[root.v][3:].tolist()))
                p.resetBasePositionAndOrientation(tree.uid, at.tolist(), to_xyzw_of(frames.multiply(turn, root.turn)))
                p.resetBaseVelocity(tree.uid, linear.tolist(), list(angular))
            movers = tree.movers
            if movers:
                positions, velocities = [], []
                for link in movers:
                    if link.kind == "ball":
                        back = frames.conjugate(link.turn)
                        turn = frames.multiply(frames.multiply(back, tuple(q[link.q].tolist())), link.turn)
                        positions.append(to_xyzw_of(turn))
                        velocities.append(list(frames.rotate(back, tuple(v[link.v].tolist()))))
                    else:
                        positions.append(q[link.q].tolist())
                        velocities.append(v[link.v].tolist())
                p.resetJointStatesMultiDof(tree.uid, [link.link for link in movers], positions, velocities)

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        p = self.bullet
        q, v = np.zeros(self.nq), np.zeros(self.nv)
        if len(self._free):
            at, raw, linear, angular = (part[self._free] for part in self.inertial_states())
            turn = positive(multiply(raw, conjugate(self.turn[self._free])))
            q[self._free_q] = np.concatenate([at, turn], axis=1)
            v[self._free_v] = np.concatenate([linear, rotate(conjugate(turn), angular)], axis=1)
        for tree in self.trees:
            if not tree.movers:
                continue
            joints = [link.link for link in tree.movers]
            states = p.getJointStatesMultiDof(tree.uid, joints)
            for link, state in zip(tree.movers, states, strict=True):
                if link.kind == "ball":
                    turned = frames.multiply(link.turn, turn_of(state[0]))
                    q[link.q] = frames.multiply(turned, frames.conjugate(link.turn))
                    v[link.v] = frames.rotate(link.turn, state[1])
                else:
                    q[link.q], v[link.v] = state[0], state[1]
        return q, v

    def keep_awake(self, uid: int) -> None:
        """Let the tree ``uid`` sleep no more. Costs a step and setting the state anew where it could have slept."""
        if uid in self._sleepers:
            q, v = self.get_state()
            self._sleepers.forbid(uid)
            self.set_state(q, v)

    def advance(self, count: int) -> None:
        """Step ``count`` times."""
        self._seen = None
        self._forgotten = False
        self._sleepers.stepped()
        step = self.bullet.stepSimulation
        for _ in range(count):
            step()

    def inertial_states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of every body's inertial frame: position (n, 3), orientation w x y z (n, 4), linear velocity of the centre
        of mass and angular velocity (n, 3) in world axes. Queried once per state."""
        if self._seen is None:
            self._seen = self._ask_inertial_states()
        return self._seen

    def _ask_inertial_states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        p, count = self.bullet, len(self.names)
        at, turn = np.zeros((count, 3)), np.zeros((count, 4))
        linear, angular = np.zeros((count, 3)), np.zeros((count, 3))
        for tree in self.trees:
            links = tree.links
            if links[0].link < 0:
                index = links[0].index
                at[index], raw = p.getBasePositionAndOrientation(tree.uid)
                turn[index] = from_xyzw_of(raw)
                linear[index], angular[index] = p.getBaseVelocity(tree.uid)
                links = links[1:]
            if links:
                states = p.getLinkStates(tree.uid, [link.link for link in links], 1, 1)
                for link, state in zip(links, states, strict=True):
                    # [4] and [5], the link frame, have single precision (measured: 1e-8 to 4e-7)
                    raw = state[1]
                    at[link.index], turn[link.index] = state[0], from_xyzw_of(raw)
                    linear[link.index], angular[link.index] = state[6], state[7]
        if self.sidecar.frames:
            self.frames.place(at, turn, linear, angular, self.centre, self.turn)
        return at, turn, linear, angular

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7) and velocities (n, 6) of the body frames as the files have them."""
        at, raw, linear, angular = self.inertial_states()
        turn = positive(multiply(raw, conjugate(self.turn)))
        lever = rotate(turn, self.centre)
        poses = np.concatenate([at - lever, turn], axis=1)
        return poses, np.concatenate([linear - cross(angular, lever), angular], axis=1)

    def energy(self) -> tuple[float, float]:
        """Kinetic energy of the bodies and their potential in gravity (J)."""
        at, turn, linear, angular = self.inertial_states()
        local = rotate(conjugate(turn), angular)
        kinetic = 0.5 * float(np.sum(self.mass * np.sum(linear**2, axis=1)) + np.sum(self.moments * local**2))
        return kinetic, -float(np.sum(self.mass * (at @ np.array(self.sidecar.gravity))))

    def messages(self) -> list[str]:
        """PyBullet's messages while loading."""
        return list(self.log)

    def close(self) -> None:
        if self.client >= 0:
            self.bullet.disconnect()
            self.client = -1
