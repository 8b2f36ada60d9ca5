"""The common part of engines that work by a simulation object, made when artifacts are loaded and dropped when closed; and the
efforts that it is given before every step, for forces and constraints that the engine does not have."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from simspec.dialects.kit.sidecar import Around, Passive, fluid_of, with_passive
from simspec.engines.kit.arrays import pick_blocks, restore_velocities
from simspec.engines.kit.contract import Engine, enter
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Level, Refinement, Support, outside, unsupported_if
from simspec.support.features import Feature
from simspec.world.actions import JointSum
from simspec.world.constraints import Drag, JointForces, JointSums, Violation, multipliers
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import constrained_trees, layout_of, members, natively_driven, rigid_groups, within
from simspec.world.rotations import matrices
from simspec.world.types import Body, Constraint, ReadBack, World

# Forces that act on bodies at all times. A weight that is not mass × gravity differs from it by the force (s − 1) m g at the
# centre of mass, s ``gravity_scale``; damping of a free body is −d v, −d ω of its own coordinates; the efforts of a fluid are
# defined in ``world/actions.py``. All follow from the engine's own masses, poses and velocities before the step, and act in it
# as a constant effort, as its own gravity and explicit damping would: exact, also in contact.

# Constraints, and springs and dampers along sums of joint positions. A spring or damper along a sum is an effort of the state
# alone, like those of joints: exact in every world. λ of a constraint follows from the engine's own M, h, poses and state: J
# M⁻¹ Jᵀ λ = J v* + φ/dt with v* = v + dt M⁻¹(τ − h), and −Jᵀ λ/dt is added to the effort τ. Impulses that the engine adds in
# the step are not in v*: a contact force on a constraint opens it, by a known compliance (IN_CONTACT), and worlds with dry
# friction or controllers of the engine in a constrained tree are refused.

HOW = (
    "simspec applies −Jᵀ λ/dt before each step, from the engine's mass matrix and bias force, to trees without "
    "contact. A joint that reaches a limit stops alone; the constraint acts again in the next steps"
)

Array = NDArray[np.float64]


IN_CONTACT = Refinement(
    Level.APPROXIMATE,
    "simspec's forces follow from the motion without contact: a contact force on a constraint opens it by the force times "
    "J M⁻¹ Jᵀ dt², the compliance of a spring that is critical for the timestep; see docs/records/constraints-in-contact.md",
    "in contact a constraint yields by the force on it times J M⁻¹ Jᵀ dt²",
)
"""Of constraints whose trees have contact. Contact lowers the mobility to a share r of J M⁻¹ Jᵀ, 0 < r ≤ 1: then the error of a
constraint decreases by √(1 − r) in each step, so that its forces are stable."""


def outside_constraints(title: str) -> dict[Feature, Support]:
    """That simspec computes constraints outside an engine (``title``): exactly where everything in the constrained trees feels
    them."""
    return {
        feature: dataclasses.replace(
            outside(
                HOW,
                functools.partial(constraints_felt, title=title),
                f"a {noun} by efforts before each step, outside {title}, while nothing touches the constrained trees",
            ),
            cases=(IN_CONTACT,),
        )
        for feature, noun in ((Feature.CONSTRAINT_LOOP, "loop"), (Feature.CONSTRAINT_COUPLING, "coupling"))
    }


def constraints_felt(world: World, title: str) -> Refinement | None:
    """Approximate where contact may press on a constraint that is computed outside the engine (``title``), and not supported
    where dry friction or a controller of the engine would."""
    allowed, groups, found = CollisionFilter(world), rigid_groups(world), None
    for bodies, actual in constrained_parts(world):
        name = actual[0].name
        if served := natively_driven(bodies, world):
            return unsupported_if(f"{served[0]!r} has {title}'s own controller, whose impulses would ignore {name!r}")
        if rough := next((body.name for body in bodies if body.joint.dry_friction), None):
            return unsupported_if(
                f"the joint of {rough!r} has dry friction in {title}, whose impulses would ignore {name!r}"
            )
        touched = any(
            groups[body.name] != "world" and allowed.may_touch(body.name, other.name)
            for body in bodies
            for other in world.bodies
        )
        found = IN_CONTACT if touched else found
    return found


def constrained_parts(world: World) -> Iterable[tuple[tuple[Body, ...], tuple[Constraint, ...]]]:
    """The bodies of the trees that constraints hold together, and those constraints; trees without any are left out."""
    constraints = {name for constraint in world.constraints for name in members(constraint)}
    for bodies in constrained_trees(world):
        if any(body.name in constraints or body.joint.name in constraints for body in bodies):
            yield bodies, within(world, bodies).constraints


@dataclass(frozen=True)
class _Part:
    """Trees that constraints hold together: their bodies, and the places of their coordinates."""

    rows: NDArray[np.intp]
    q: NDArray[np.intp]
    v: NDArray[np.intp]
    violation: Violation
    joints: JointForces


class Outside:
    """The constraints of a loaded engine, and what acts along sums, computed from what it holds."""

    def __init__(self, engine: Engine, constraints: Sequence[Constraint], sums: Sequence[JointSum]):
        back = engine.read_back()
        world = World("", back.bodies, constraints=tuple(constraints), sums=tuple(sums))
        self._constraints = world.constraints
        self._along = JointSums(world.bodies, sums)
        self._engine, self._timestep = engine, back.timestep
        self._nv = layout_of(world).nv
        self._parts = [_part(world, bodies, local) for bodies, local in constrained_parts(world)]

    def set_timestep(self, timestep: float) -> None:
        """Compute for steps of another length (s)."""
        self._timestep = timestep

    def completed(self, back: ReadBack) -> ReadBack:
        """The engine's model, with the efforts that are applied here."""
        return dataclasses.replace(back, constraints=self._constraints, sums=self._along.sums)

    def energy(self) -> float:
        """The energy that the springs along sums store at the present state (J)."""
        return self._along.energy(self._engine.get_state()[0])

    def effort(self, given: Array | None) -> Array:
        """The effort (nv,) to apply for one step, for one that is ``given`` (None: zero)."""
        engine, dt = self._engine, self._timestep
        total = np.zeros(self._nv) if given is None else np.array(given, dtype=float)
        q, v = engine.get_state()
        total += self._along.effort(q, v)
        if not self._parts:
            return total
        poses, _ = engine.body_states()
        bias = engine.bias_force()
        masses = engine.mass_blocks([part.v for part in self._parts])
        for part, mass in zip(self._parts, masses, strict=True):
            local_q, local_v, local_poses = q[part.q], v[part.v], poses[part.rows]
            jacobian = part.violation.jacobian(local_poses)
            force = total[part.v] + part.joints.effort(local_q, local_v) - bias[part.v]
            solved = np.linalg.solve(mass, np.column_stack([force, jacobian.T]))
            free = local_v + dt * solved[:, 0]
            wanted = jacobian @ free + part.violation.of(local_q, local_poses) / dt
            total[part.v] -= jacobian.T @ multipliers(jacobian @ solved[:, 1:], wanted) / dt
        return total


def _part(world: World, bodies: Sequence[Body], constraints: Sequence[Constraint]) -> _Part:
    row = {body.name: index for index, body in enumerate(world.bodies)}
    whole = layout_of(world)
    rows = np.array([row[body.name] for body in bodies], dtype=np.intp)
    at_q = np.concatenate([np.r_[whole.position[index]] for index in rows]).astype(np.intp)
    at_v = np.concatenate([np.r_[whole.velocity[index]] for index in rows]).astype(np.intp)
    return _Part(rows, at_q, at_v, Violation(bodies, constraints), JointForces(bodies))


class GivenForces:
    """Efforts that a loaded engine receives before each of its steps, from its sidecar; ``bias_force`` and ``energy`` differ
    from the engine's by them."""

    def __init__(self, engine: Engine, passive: Passive):
        back = engine.read_back()
        world = World("", back.bodies)
        layout = layout_of(world)
        self._engine, self._nv = engine, layout.nv
        self._bodies, self._places = world.bodies, layout.velocity
        rows = {body.name: row for row, body in enumerate(world.bodies)}
        self._parents = [-1 if body.joint.parent is None else rows[body.joint.parent] for body in world.bodies]
        gravity = np.array(back.gravity)
        self._lifted = [
            (row, (entry.scale - 1.0) * body.inertial.mass * gravity, np.array(body.inertial.centre_of_mass))
            for entry in passive.gravity_scales
            for row in (rows[entry.body],)
            for body in (world.bodies[row],)
        ]
        self._damping = np.zeros(layout.nv)
        for damped in passive.free_damping:
            at = self._places[rows[damped.body]].start
            self._damping[at : at + 3], self._damping[at + 3 : at + 6] = damped.linear, damped.angular
        self._centres = [
            np.array(lumped_inertial(world, body).centre_of_mass if body.joint.kind == "free" else (0.0, 0.0, 0.0))
            for body in world.bodies
        ]
        self._axes = [np.array(body.joint.axis) for body in world.bodies]
        self._drag = None if passive.around is None else _Drag(world, passive.around)

    def weight(self) -> Array:
        """The effort (nv,) by which weights differ from mass × gravity, at the present state."""
        if not self._lifted:
            return np.zeros(self._nv)
        poses, _ = self._engine.body_states()
        turns = matrices(poses[:, 3:])
        forces, moments = np.zeros((2, len(poses), 3))  # of each body and all that it carries, about the world's origin
        for row, force, centre in self._lifted:
            forces[row] += force
            moments[row] += np.cross(poses[row, :3] + turns[row] @ centre, force)
        return self._efforts(poses[:, :3], turns, forces, moments)

    def _efforts(self, at: Array, turns: Array, forces: Array, moments: Array) -> Array:
        effort = np.zeros(self._nv)
        for row in range(len(at) - 1, -1, -1):
            kind, place, force = self._bodies[row].joint.kind, self._places[row], forces[row]
            about = moments[row] - np.cross(at[row] + turns[row] @ self._centres[row], force)
            if kind in SCALAR_JOINTS:
                effort[place] = turns[row] @ self._axes[row] @ (force if kind == "slide" else about)
            elif kind == "ball":
                effort[place] = about @ turns[row]
            elif kind == "free":
                effort[place] = np.concatenate([force, about @ turns[row]])
            if self._parents[row] >= 0:
                forces[self._parents[row]] += force
                moments[self._parents[row]] += moments[row]
        return effort

    def loss(self) -> Array:
        """The effort (nv,) of what takes energy, at the present state."""
        effort = np.zeros(self._nv)
        if self._damping.any():
            effort -= self._damping * self._engine.get_state()[1]
        if self._drag is not None:
            poses, velocities = self._engine.body_states()
            turns = matrices(poses[:, 3:])
            effort += self._efforts(poses[:, :3], turns, *self._drag.wrenches(poses[:, :3], turns, velocities))
        return effort

    def potential(self) -> float:
        """Energy (J) of the differences of weights, zero at the world's origin."""
        if not self._lifted:
            return 0.0
        poses, _ = self._engine.body_states()
        turns = matrices(poses[:, 3:])
        return -sum(float(force @ (poses[row, :3] + turns[row] @ centre)) for row, force, centre in self._lifted)


class _Drag:
    """The forces of a fluid on bodies that move in it, all at once. Rows of boxes have the bodies of ``rows``."""

    def __init__(self, world: World, around: Around):
        at = {body.name: row for row, body in enumerate(world.bodies)}
        self._rows = np.array([at[entry.body] for entry in around.boxes], dtype=np.intp)
        lumped_inertials = (lumped_inertial(world, world.bodies[row]) for row in self._rows)
        self._centres = np.array([inertial.centre_of_mass for inertial in lumped_inertials])
        self._turns = matrices(np.array([entry.box.quaternion for entry in around.boxes]))
        self._flow = np.array(around.fluid.velocity)
        self._drag = Drag([entry.box.edges for entry in around.boxes], around.fluid)

    def wrenches(self, at: Array, turns: Array, velocities: Array) -> tuple[Array, Array]:
        """Forces, and moments about the world's origin, on all bodies (n, 3), for the places, orientations and velocities of
        their frames in world axes."""
        rows = self._rows
        arms = np.einsum("nij,nj->ni", turns[rows], self._centres)
        axes = turns[rows] @ self._turns
        spin = velocities[rows, 3:]
        flow = velocities[rows, :3] + np.cross(spin, arms) - self._flow
        pushes = [
            np.einsum("nij,nj->ni", axes, push)
            for push in self._drag.of(*(np.einsum("nji,nj->ni", axes, moving) for moving in (flow, spin)))
        ]
        forces, moments = np.zeros((2, len(at), 3))
        forces[rows] = pushes[0]
        moments[rows] = pushes[1] + np.cross(at[rows] + arms, pushes[0])
        return forces, moments


class BeforeSteps:
    """Efforts that simspec computes for an engine before each of its steps: constraints, and forces that act at all times."""

    def __init__(
        self,
        engine: Engine,
        passive: Passive | None,
        constraints: Sequence[Constraint] = (),
        sums: Sequence[JointSum] = (),
    ):
        self._engine, self.passive = engine, passive
        self.given = None if passive is None else GivenForces(engine, passive)
        self.outside = Outside(engine, constraints, sums) if constraints or sums else None

    @property
    def needed(self) -> bool:
        """Whether there is anything to compute."""
        return self.given is not None or self.outside is not None

    def effort(self, effort: Array | None) -> Array:
        """The effort (nv,) to apply for one step, for one that the caller gives (None: zero)."""
        given = self.given
        total = np.zeros(len(self._engine.get_state()[1])) if effort is None else np.asarray(effort, dtype=float)
        if given is not None:
            total = total + given.loss()
        if self.outside is not None:
            total = self.outside.effort(total)
        # the bias force that constraints are computed from has the weights as they are: the difference comes after them
        return total if given is None else total + given.weight()

    def set_timestep(self, timestep: float) -> None:
        """Compute for steps of another length (s)."""
        if self.outside is not None:
            self.outside.set_timestep(timestep)

    def bias_force(self, values: Array) -> Array:
        """h (nv,) in M v̇ + h = τ, from the engine's ``own``."""
        return values if self.given is None else values - self.given.weight()

    def potential(self) -> float:
        """The difference of the potential energy (J) from the engine's."""
        differs = 0.0 if self.given is None else self.given.potential()
        return differs if self.outside is None else differs + self.outside.energy()

    def completed(self, back: ReadBack) -> ReadBack:
        """A read-back of what the engine itself holds, completed by what it is given."""
        back = dataclasses.replace(back, bodies=with_passive(back.bodies, self.passive), fluid=fluid_of(self.passive))
        return back if self.outside is None else self.outside.completed(back)


class Simulated(Protocol):
    """A loaded world, in the engine's own terms; its results are as :class:`Engine` says."""

    offsets: np.ndarray
    """(bodies, 3): where the file's frame of each body stands in the world's."""

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None: ...

    def get_state(self) -> tuple[np.ndarray, np.ndarray]: ...

    def file_frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (bodies, 7) and velocities (bodies, 6) of the *file's* body frames."""
        ...

    def disable_contact(self) -> None: ...

    def messages(self) -> list[str]: ...

    def close(self) -> None: ...


S = TypeVar("S", bound=Simulated)


class SimulatedEngine(Engine, Generic[S], abstract=True):
    """An engine that passes on to its simulation what needs nothing else."""

    def __init__(self) -> None:
        self._sim: S | None = None

    @property
    def _simulation(self) -> S:
        if self._sim is None:
            raise RuntimeError("load first")
        return self._sim

    def _make(self, folder: Path, sidecar: Mapping[str, Any]) -> S:
        """The simulation of the artifacts, in the world's initial state. Raises EngineError when the engine refuses a file."""
        raise NotImplementedError

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self.close()
        enter(type(self))
        self._sim = self._make(folder, sidecar)

    def set_state(self, q: np.ndarray, v: np.ndarray) -> None:
        self._simulation.set_state(q, v)

    def get_state(self) -> tuple[np.ndarray, np.ndarray]:
        return self._simulation.get_state()

    def body_states(self) -> tuple[np.ndarray, np.ndarray]:
        sim = self._simulation
        return restore_velocities(*sim.file_frames(), sim.offsets)

    def disable_contact(self) -> None:
        self._simulation.disable_contact()

    def log(self) -> list[str]:
        return self._simulation.messages()

    def close(self) -> None:
        sim, self._sim = self._sim, None
        if sim is not None:
            sim.close()


# The base of engines that receive such efforts.


class Given(Simulated, Protocol):
    """A loaded world that is stepped under an effort. The members below are the engine's, without these efforts."""

    @property
    def passive(self) -> Passive | None:
        """The forces that act at all times and that it is given."""
        ...

    @property
    def constraints(self) -> Sequence[Constraint]:
        """The constraints whose forces it is given."""
        ...

    @property
    def sums(self) -> Sequence[JointSum]:
        """The springs and dampers along sums of positions that it is given."""
        ...

    def advance(self, count: int, effort: np.ndarray | None) -> None:
        """Step ``count`` times under a constant effort (nv,), None = zero."""
        ...


class Stepped(Given, Protocol):
    """The same of an engine that reports masses, forces of inertia and energies."""

    def mass_parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The parts of M at the present state, armature included, each with its places in v: the entries between them are
        zero."""
        ...

    def bias(self) -> np.ndarray:
        """h (nv,) at the present state, in M v̇ + h = τ."""
        ...

    def energy(self) -> tuple[float, float]:
        """Kinetic and potential energy (J)."""
        ...


G = TypeVar("G", bound=Given)
T = TypeVar("T", bound=Stepped)


class GivenEngine(SimulatedEngine[G], Generic[G], abstract=True):
    """An engine whose simulation is given, before every step, the forces that it does not have (:class:`BeforeSteps`)."""

    def __init__(self) -> None:
        super().__init__()
        self._before: BeforeSteps | None = None

    def load(self, folder: Path, sidecar: Mapping[str, Any]) -> None:
        self._before = None
        super().load(folder, sidecar)
        simulation = self._simulation
        before = BeforeSteps(self, simulation.passive, simulation.constraints, simulation.sums)
        self._before = before if before.needed else None

    def _read_model(self) -> ReadBack:
        """The engine's model, with its inventory and its neutral values."""
        raise NotImplementedError

    def read_back(self) -> ReadBack:
        back = self._read_model()
        return back if self._before is None else self._before.completed(back)

    def step(self, count: int, effort: np.ndarray | None = None) -> None:
        if self._before is None:
            self._simulation.advance(count, effort)
            return
        for _ in range(count):
            self._simulation.advance(1, self._before.effort(effort))


class SteppedEngine(GivenEngine[T], Generic[T], abstract=True):
    """The same of an engine that reports masses, forces of inertia and energies."""

    def mass_blocks(self, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
        return pick_blocks(blocks, self._simulation.mass_parts())

    def bias_force(self) -> np.ndarray:
        bias = self._simulation.bias()
        return bias if self._before is None else self._before.bias_force(bias)

    def energy(self) -> tuple[float, float]:
        kinetic, potential = self._simulation.energy()
        return kinetic, potential + (0.0 if self._before is None else self._before.potential())
