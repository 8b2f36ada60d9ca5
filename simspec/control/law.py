"""The control laws at work (:mod:`simspec.world.actions` says what they are): state in, effort out, the same in every engine.

Runs in the engine's process, with numpy and, where a law needs the world's mass matrix or bias force, Pinocchio. Every law
is affine in the state but for M, h and g; the affine parts of many steps are made at once, ahead of them.
"""

from __future__ import annotations

import dataclasses
import itertools
import time
from typing import Any, Protocol

import numpy as np

from simspec.control.reference import Native, Reference, Servos, natives
from simspec.errors import SimspecError
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.processes import processor_clock
from simspec.world.actions import JointController
from simspec.world.kinematics import layout_of, trees
from simspec.world.types import Body, World

CHUNK = 1000
"""Steps whose references are made at once: a few hundred kB for a robot."""


class ControlError(SimspecError):
    """A law cannot work in this world or this environment."""

    code = "S705"


class Joints(Protocol):
    """The driven joints of a live simulation."""

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities (n,); valid until the next step."""

    def give(self, effort: np.ndarray) -> None:
        """Efforts (n,) for the next step; none on other joints."""

    def step(self) -> None:
        """One step under the efforts that were given."""


def needs_dynamics(controller: JointController) -> bool:
    """Whether a law needs M, h or g of the joint's tree."""
    implicit = controller.law == "pd" and controller.discretisation == "implicit"
    return controller.law == "computed-torque" or controller.gravity_compensation or implicit


@dataclasses.dataclass(frozen=True)
class _Rows:
    """The law of each joint of a group, as numbers: see :func:`_rows`."""

    columns: np.ndarray
    driven: np.ndarray
    implicit: np.ndarray
    torque: np.ndarray
    gravity: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    divisor: np.ndarray
    limit: np.ndarray
    hold: np.ndarray
    """For how many steps the effort is held, 1 where the joint has no law."""


def _rows(joints: list[str], world: World, reference: Reference) -> _Rows:
    """The laws of ``joints``, as acceleration or effort = (A − stiffness q − damping v) / divisor, A from the reference."""
    count, dt = len(joints), world.physics.timestep
    law = {
        name: (controller, index) for controller in world.controllers for index, name in enumerate(controller.joints)
    }
    place = {name: index for index, name in enumerate(reference.joints) if name in law}
    columns = np.array([place.get(name, -1) for name in joints], dtype=int)
    implicit, torque, gravity = (np.zeros(count, dtype=bool) for _ in range(3))
    stiffness, damping, divisor = np.zeros(count), np.zeros(count), np.ones(count)
    limit, hold = np.full(count, np.inf), np.ones(count, dtype=np.int64)
    for row, name in enumerate(joints):
        if name not in law:
            continue
        controller, index = law[name]
        implicit[row] = controller.discretisation == "implicit"
        gravity[row] = controller.gravity_compensation
        torque[row] = controller.law == "computed-torque"
        hold[row] = controller.hold
        time = controller.hold * dt
        if torque[row]:
            omega = controller.natural_frequency
            stiffness[row], damping[row] = omega**2, 2.0 * controller.damping_ratio * omega
            if implicit[row]:
                divisor[row] = 1.0 + damping[row] * time + stiffness[row] * time**2
        else:
            stiffness[row], damping[row] = controller.kp[index], controller.kd[index]
        if controller.effort_limits[index] is not None:
            limit[row] = controller.effort_limits[index]
    return _Rows(columns, columns >= 0, implicit, torque, gravity, stiffness, damping, divisor, limit, hold)


class _JointGroup:
    """The driven joints of one tree; with dynamics, all its joints, in Pinocchio's order."""

    def __init__(self, world: World, bodies: tuple[Body, ...], reference: Reference):
        driven = {name for controller in world.controllers for name in controller.joints}
        movers = [body for body in bodies if body.joint.kind != "fixed"]
        self._timestep = world.physics.timestep
        self._tree: Any = None
        controllers = [controller for controller in world.controllers if needs_dynamics(controller)]
        names = {body.joint.name for body in bodies}
        if any(names & set(controller.joints) for controller in controllers):
            self._tree = tree = _dynamics(world, bodies, controllers)
            movers = [movers[index] for index in np.argsort(tree.v_index)]
        else:
            movers = [body for body in movers if body.joint.name in driven]
        self.bodies = [body.name for body in movers]
        self.joints = [body.joint.name for body in movers]
        self.rows = rows = _rows(self.joints, world, reference)
        self._reference = reference
        time = self._timestep * rows.hold
        self._ahead_damping = rows.damping + np.where(rows.implicit, time * rows.stiffness, 0.0)
        self._slope_q = rows.stiffness / rows.divisor
        self._slope_v = self._ahead_damping / rows.divisor
        self._only_torque = bool(rows.torque.all())
        self._pd = rows.driven & ~rows.torque
        self._solved = self._pd & rows.implicit
        self._ahead = np.where(self._solved, time * rows.damping + time**2 * rows.stiffness, 0.0)
        self._effort = np.zeros(len(movers))
        self._holds = bool((rows.hold > 1).any())
        self._kept, self._next = np.zeros(len(movers)), -1

    def prepare(self, first: int, count: int) -> np.ndarray:
        """Make the references of ``count`` steps from step ``first`` on; returns q* (count, n) at their ends.

        Efforts that are held go on from the steps prepared last, where these end at ``first``; else the laws act in it."""
        rows, dt = self.rows, self._timestep
        shape = (count, len(rows.columns))
        self._affine, self._feed = np.zeros(shape), np.zeros(shape)
        longest = int(rows.hold.max(initial=1))
        times = (first + np.arange(count + longest)) * dt
        position, speed, acceleration = self._reference.position.at(times, 2)
        (feed,) = self._reference.effort.at(times)
        lead = np.where(rows.implicit, rows.hold, 0)
        for ahead in np.unique(lead[rows.driven]).tolist():
            mine = rows.driven & (lead == ahead)
            local, at = rows.columns[mine], slice(ahead, ahead + count)
            wanted = rows.stiffness[mine] * position[at][:, local] + rows.damping[mine] * speed[at][:, local]
            wanted += np.where(rows.torque[mine], acceleration[at][:, local], 0.0)
            self._affine[:, mine] = wanted / rows.divisor[mine]
            self._feed[:, mine] = feed[at][:, local]
        self._affine[:, self._pd] += self._feed[:, self._pd]
        self._feed[:, self._pd] = 0.0
        if self._holds:
            self._due = (first + np.arange(count))[:, None] % rows.hold == 0
            self._due[0] |= first != self._next
            self._any, self._all, self._next = self._due.any(axis=1), self._due.all(axis=1), first + count
        return np.where(rows.driven, position[1 : count + 1][:, rows.columns], 0.0)

    def effort(self, k: int, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Efforts (n,), not yet clipped, at the k-th prepared step."""
        if not self._holds:
            return self._law(k, q, v)
        if self._any[k]:
            now = self._law(k, q, v)
            self._kept = now.copy() if self._all[k] else np.where(self._due[k], now, self._kept)
        return self._kept

    def _law(self, k: int, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The laws of all joints at the k-th prepared step."""
        wanted: np.ndarray = self._affine[k] - self._slope_q * q - self._slope_v * v
        tree, rows = self._tree, self.rows
        if tree is None:
            return wanted
        if self._only_torque:
            torque: np.ndarray = tree.pin_inverse(q, v, wanted) + self._feed[k]
            return torque
        effort = self._effort
        effort[:] = 0.0
        if rows.torque.any():
            accelerations = np.where(rows.torque, wanted, 0.0)
            effort[rows.torque] = (tree.pin_inverse(q, v, accelerations) + self._feed[k])[rows.torque]
        effort[self._pd] = wanted[self._pd]
        if rows.gravity.any():
            effort[rows.gravity] += tree.pin_gravity(q)[rows.gravity]
        if self._solved.any():
            effort[self._solved] -= (self._ahead * self._acceleration(q, v, effort))[self._solved]
        return effort

    def _acceleration(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """a of (M + ahead) a = effort + the joints' own efforts − h, joints without implicit law included."""
        tree = self._tree
        pin, model, data = tree.pin, tree.model, tree.data
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        local = tree.joint_effort(q[tree.v_index], v[tree.v_index])[np.argsort(tree.v_index)]
        free = effort + local - tree.pin_bias(q, v)
        return np.linalg.solve(mass + np.diag(self._ahead), free)


def _dynamics(world: World, bodies: tuple[Body, ...], controllers: list[JointController]) -> Any:
    unexpected = [body for body in bodies if body.joint.kind not in ("fixed", *SCALAR_JOINTS)]
    if unexpected:
        names = ", ".join(sorted({controller.name for controller in controllers}))
        raise ControlError(
            f"control.{names}: its law needs a tree of hinges and slides on a fixed base, and {unexpected[0].name!r} has a "
            f"{unexpected[0].joint.kind} joint; law: pd with discretisation: explicit and no gravity_compensation can be used"
        )
    try:
        from simspec.dynamics.oracle_tree import OracleTree

        return OracleTree(dataclasses.replace(world, bodies=bodies))
    except ModuleNotFoundError as error:
        raise ControlError(
            f"the law needs Pinocchio in the engine's environment ({error.name} is missing): pip install 'simspec-physics[pin]'"
        ) from None


class Control:
    """All controllers of a world at work.

    ``q_places`` and ``v_places``: where the joints that it reads and drives stand in the world's generalised coordinates;
    ``joints``: their names. Give it the live joints in this order with :meth:`advance`. ``native``: those of them that the
    engine's own controllers drive (None: no such joint), at ``native_places`` among ``joints``; their efforts are given as
    zero, and in ``applied`` they are NaN: only the engine knows them.
    Raises ControlError where a law cannot work.
    """

    def __init__(self, world: World, reference: Reference):
        lawful = tuple(controller for controller in world.controllers if controller.law != "native")
        lawful_joints = {name for controller in lawful for name in controller.joints}
        self.native = Native(world, reference) if natives(world) else None
        world = dataclasses.replace(world, controllers=lawful)
        self._groups = [
            _JointGroup(world, bodies, reference)
            for bodies in trees(world).values()
            if any(body.joint.name in lawful_joints for body in bodies)
        ]
        where = layout_of(world)
        index = {body.name: number for number, body in enumerate(world.bodies)}
        order = [index[name] for group in self._groups for name in group.bodies]
        self.joints = [name for group in self._groups for name in group.joints]
        limits = [group.rows.limit for group in self._groups]
        driven = [group.rows.driven for group in self._groups]
        sizes = np.cumsum([0, *(len(group.joints) for group in self._groups)])
        self._slices = [slice(first, last) for first, last in itertools.pairwise(sizes)]
        native = self.native
        if native is not None:  # some may be there already: laws with dynamics read all joints of their trees
            there = set(self.joints)
            more = [k for k, name in enumerate(native.joints) if name not in there]
            order += [index[native.bodies[k]] for k in more]
            self.joints += [native.joints[k] for k in more]
            limits.append(np.full(len(more), np.inf))
            driven.append(np.ones(len(more), dtype=bool))
        self.native_places = np.array([self.joints.index(name) for name in native.joints] if native else [], dtype=int)
        self.q_places = np.array([where.position[number].start for number in order], dtype=int)
        self.v_places = np.array([where.velocity[number].start for number in order], dtype=int)
        self._limit = np.concatenate(limits) if limits else np.zeros(0)
        self.driven = np.concatenate(driven) if limits else np.zeros(0, bool)
        self.driven[self.native_places] = True
        count = len(order)
        self.target, self.applied = np.zeros(count), np.zeros(count)
        """q* at the end of the last step, and the efforts of that step."""
        self.error = np.zeros(count)
        """Largest |q* − q| at the end of any step, by joint."""
        self.clipped = np.zeros(count, dtype=int)
        """Steps in which an effort was clipped, by joint."""
        self.seconds = {"step": 0.0, "cpu": 0.0, "control": 0.0, "control_cpu": 0.0}
        """Wall and processor time in the engine's step calls, and in the laws with passing states and efforts."""

    def advance(self, joints: Joints, first: int, count: int, servos: Servos | None = None) -> None:
        """Do steps ``first`` … ``first + count − 1`` of the run; with ``native`` joints, ``servos`` get their targets."""
        if (self.native is None) != (servos is None):
            raise ControlError("servos must be given exactly where joints have the engine's own controllers")
        for start in range(first, first + count, CHUNK):
            self._chunk(joints, start, min(CHUNK, first + count - start), servos)

    def follow(self, joints: Joints, steps: int, every: int) -> np.ndarray:
        """Do ``steps`` steps; returns the positions (n, driven joints in the world's order) before them and after every
        ``every`` of them."""
        order = np.flatnonzero(self.driven)[np.argsort(self.q_places[self.driven])]
        rows = [joints.read()[0][order]]
        for done in range(0, steps, every):
            self.advance(joints, done, min(every, steps - done))
            rows.append(joints.read()[0][order])
        return np.array(rows)

    def _chunk(self, joints: Joints, first: int, count: int, servos: Servos | None) -> None:
        clock, cpu_clock = time.perf_counter, processor_clock()
        begun, begun_cpu = clock(), cpu_clock()
        targets = np.zeros((count, len(self.joints)))
        for group, part in zip(self._groups, self._slices, strict=True):
            targets[:, part] = group.prepare(first, count)
        if self.native is not None:
            positions, velocities, targets[:, self.native_places] = self.native.prepare(first, count)
        aim = None if servos is None else servos.aim
        seen, efforts = np.empty_like(targets), np.empty_like(targets)
        read, give, step, limit = joints.read, joints.give, joints.step, self._limit
        lowest = -limit
        pairs = list(zip(self._groups, self._slices, strict=True))
        alone = self._groups[0].effort if len(pairs) == 1 and len(self._groups[0].joints) == len(self.joints) else None
        wanted = np.zeros(len(self.joints))
        minimum, maximum = np.minimum, np.maximum
        stepped = cpu = 0.0
        for k in range(count):
            q, v = read()
            if k:
                seen[k - 1] = q
            if alone is not None:
                wanted = alone(k, q, v)
            else:
                for group, part in pairs:
                    wanted[part] = group.effort(k, q[part], v[part])
            if aim is not None:
                aim(positions[k], velocities[k])
            efforts[k] = wanted
            give(maximum(minimum(wanted, limit), lowest))
            cpu_start = cpu_clock()
            start = clock()
            step()
            stepped += clock() - start
            cpu += cpu_clock() - cpu_start
        seen[count - 1] = joints.read()[0]
        away = np.where(self.driven, np.abs(targets - seen), 0.0)
        self.error = np.maximum(self.error, away.max(axis=0))
        self.clipped += (np.abs(efforts) > limit).sum(axis=0)
        self.target = targets[-1]
        self.applied = np.clip(efforts[-1], lowest, limit)
        self.applied[self.native_places] = np.nan
        self.seconds["step"] += stepped
        self.seconds["cpu"] += cpu
        self.seconds["control"] += clock() - begun - stepped
        # the clocks' own rounding must not make it fall
        self.seconds["control_cpu"] += max(0.0, cpu_clock() - begun_cpu - cpu)
