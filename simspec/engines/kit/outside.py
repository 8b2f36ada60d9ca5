"""Constraints, and springs and dampers along sums of joint positions, that simspec computes outside an engine, as an effort
before every step, and in which worlds that is exact.

What acts along sums is an effort of the state alone, like the springs and dampers of joints: exact in every world.

λ follows from the engine's own M, h, poses and state: J M⁻¹ Jᵀ λ = J v* + φ/dt with v* = v + dt M⁻¹(τ − h), and −Jᵀ λ/dt is
added to the effort τ. What the engine itself adds in the step as an impulse (contact, dry friction, its own controllers) is not
in v*, so that worlds in which that may happen to a held body are refused.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit.contract import Engine
from simspec.support.declarations import Refinement, Support, outside, unsupported_if
from simspec.support.features import Feature
from simspec.world.actions import JointSum
from simspec.world.constraints import Violation, multipliers
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import constrained_trees, layout_of, members, natively_driven, rigid_groups, within
from simspec.world.passive_forces import JointForces, JointSums
from simspec.world.types import Body, Constraint, ReadBack, World

HOW = (
    "−Jᵀ λ/dt from the engine's own M and h before every step, for trees that nothing touches; a joint that arrives at a limit "
    "stops alone, and the constraint is taken up again in the next steps"
)

Array = NDArray[np.float64]


def computed(feature: Feature, title: str, refine: Callable[[World], Refinement | None]) -> Support:
    """That simspec computes the constraints of ``feature`` outside an engine (``title``), where ``refine`` has nothing
    against it. Each feature of each engine has a short reason of its own."""
    noun = feature.value.rpartition(".")[2]
    short = f"a {noun} as an effort before every step, outside {title}, where nothing touches the held trees"
    return outside(HOW, refine, short)


def constraints_felt(world: World, title: str) -> Refinement | None:
    """Not supported where something in a held tree would not feel a constraint that is computed outside the engine
    (``title``)."""
    allowed, groups = CollisionFilter(world), rigid_groups(world)
    for bodies, held in held_parts(world):
        name = held[0].name
        if served := natively_driven(bodies, world):
            return unsupported_if(f"{served[0]!r} has {title}'s own controller, whose impulses would ignore {name!r}")
        if rough := next((body.name for body in bodies if body.joint.dry_friction), None):
            return unsupported_if(f"the joint of {rough!r} has dry friction, whose impulses would ignore {name!r}")
        for body in bodies:
            for other in world.bodies:
                if groups[body.name] != "world" and allowed.may_touch(body.name, other.name):
                    return unsupported_if(f"{body.name!r} may touch {other.name!r}, and contact would ignore {name!r}")
    return None


def held_parts(world: World) -> Iterable[tuple[tuple[Body, ...], tuple[Constraint, ...]]]:
    """The bodies of the trees that constraints hold together, and those constraints; trees without any are left out."""
    held = {name for constraint in world.constraints for name in members(constraint)}
    for bodies in constrained_trees(world):
        if any(body.name in held or body.joint.name in held for body in bodies):
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
        held = engine.read_back()
        world = World("", held.bodies, constraints=tuple(constraints), sums=tuple(sums))
        self._constraints = world.constraints
        self._along = JointSums(world.bodies, sums)
        self._engine, self._timestep = engine, held.timestep
        self._nv = layout_of(world).nv
        self._parts = [_part(world, bodies, own) for bodies, own in held_parts(world)]

    def told(self, held: ReadBack) -> ReadBack:
        """What an engine holds, with what is applied here."""
        return dataclasses.replace(held, constraints=self._constraints, sums=self._along.sums)

    def energy(self) -> float:
        """What the springs along sums store at the present state (J)."""
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
            own_q, own_v, own_poses = q[part.q], v[part.v], poses[part.rows]
            jacobian = part.violation.jacobian(own_poses)
            force = total[part.v] + part.joints.effort(own_q, own_v) - bias[part.v]
            solved = np.linalg.solve(mass, np.column_stack([force, jacobian.T]))
            free = own_v + dt * solved[:, 0]
            wanted = jacobian @ free + part.violation.of(own_q, own_poses) / dt
            total[part.v] -= jacobian.T @ multipliers(jacobian @ solved[:, 1:], wanted) / dt
        return total


def _part(world: World, bodies: Sequence[Body], constraints: Sequence[Constraint]) -> _Part:
    row = {body.name: index for index, body in enumerate(world.bodies)}
    whole = layout_of(world)
    rows = np.array([row[body.name] for body in bodies], dtype=np.intp)
    at_q = np.concatenate([np.r_[whole.position[index]] for index in rows]).astype(np.intp)
    at_v = np.concatenate([np.r_[whole.velocity[index]] for index in rows]).astype(np.intp)
    return _Part(rows, at_q, at_v, Violation(bodies, constraints), JointForces(bodies))
