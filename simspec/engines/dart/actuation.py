"""Hinges and slides of a DART simulation, read and driven at every step with as few calls as it allows."""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any

import numpy as np

from simspec.engines.dart.coordinates import DartTree
from simspec.engines.dart.simulation import DartSimulation
from simspec.engines.kit.arrays import motor_limit, motor_rate
from simspec.engines.kit.contract import Actuation, Engine
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.kinematics import natively_driven, trees
from simspec.world.types import World

NATIVE = (
    "DART's servo is a velocity motor: v' = v* + kp/(kd + dt kp) (q* − q) within the effort limit, so that only "
    "the ratio kp/kd matters and loads cause no position error. At the limit joint damping d is weaker by 1 + dt d "
    "/ I"
)


def no_springs(world: World) -> Refinement | None:
    """Not supported where a natively driven joint has a spring."""
    sprung = [body.name for body in world.bodies if body.joint.spring_stiffness]
    served = [name for name in natively_driven(world.bodies, world) if name in sprung]
    if not served:
        return None
    return unsupported_if(f"DART's servos allow no other effort on their joint, and {served[0]!r} has a spring")


def none_on_servos(world: World) -> Refinement | None:
    """Not supported where a force acts on a tree with natively driven joints."""
    return _alone_on_servos(world, {force.body for force in world.forces})


def no_weights_on_servos(world: World) -> Refinement | None:
    """Not supported where a body of a tree with natively driven joints has another weight than its mass's."""
    return _alone_on_servos(world, {body.name for body in world.bodies if body.gravity_scale != 1.0})


def no_fluid_on_servos(world: World) -> Refinement | None:
    """Not supported where a body of a tree with natively driven joints feels a fluid."""
    return _alone_on_servos(world, {body.name for body in world.bodies if body.box is not None})


def _alone_on_servos(world: World, pushed: Container[str]) -> Refinement | None:
    for bodies in trees(world).values():
        served = natively_driven(bodies, world)
        if served and any(body.name in pushed for body in bodies):
            return unsupported_if(f"DART's servos allow no other effort on their joint, and {served[0]!r} has one")
    return None


def none_along_servos(world: World) -> Refinement | None:
    """Not supported where a spring or damper acts along a sum of which a joint is natively driven."""
    owner = {body.joint.name: body for body in world.bodies}
    for sum_ in world.sums:
        if served := natively_driven([owner[joint] for joint, _ in sum_.joints], world):
            return unsupported_if(
                f"DART's servos allow no other effort on their joint, and {served[0]!r} is in {sum_.name!r}"
            )
    return None


def _driven(sim: DartSimulation, v: np.ndarray) -> Iterator[tuple[DartTree, np.ndarray, np.ndarray]]:
    """Of each tree its degrees of freedom on the hinges and slides at the places ``v`` (n,), and where these stand in ``v``."""
    order = {int(place): index for index, place in enumerate(v)}
    for tree in sim.coordinates.trees:
        places = [(start, order[place]) for start, place in tree.straight if place in order]
        if places:
            dofs, rows = np.array(places, dtype=int).T.copy()
            yield tree, dofs, rows


class DartJointArrays(Actuation):
    """One call for each skeleton to read positions, velocities, and one to drive. For simulations without efforts of their own
    (damping, springs, armature) and without rotations to be corrected, which need more."""

    def __init__(self, engine: Engine, sim: DartSimulation, q: np.ndarray, v: np.ndarray):
        super().__init__(engine, q, v)
        self._sim = sim
        self._trees = [
            (tree.skeleton, dofs, rows, np.zeros(tree.dofs.stop - tree.dofs.start))
            for tree, dofs, rows in _driven(sim, v)
        ]
        self._positions, self._velocities = np.zeros(len(v)), np.zeros(len(v))

    @staticmethod
    def suits(sim: DartSimulation) -> bool:
        """Whether a simulation needs no further actuation."""
        return not sim.efforts.driven and not (sim.exact_rotation and sim.coordinates.turners)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        self._sim.check_contact_cap()
        positions, velocities = self._positions, self._velocities
        for skeleton, dofs, rows, _ in self._trees:
            positions[rows] = skeleton.getPositions()[dofs]
            velocities[rows] = skeleton.getVelocities()[dofs]
        return positions, velocities

    def give(self, effort: np.ndarray) -> None:
        for skeleton, dofs, rows, total in self._trees:
            total[dofs] = effort[rows]
            skeleton.setForces(total)

    def step(self) -> None:
        self._sim.plain_step()


class DartJointServos:
    """Some hinges and slides with DART's actuator type SERVO."""

    def __init__(
        self, sim: DartSimulation, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray
    ):
        self._rate = motor_rate(stiffness, damping, sim.timestep)
        limit = motor_limit(stiffness, damping, limit)
        kind = sim.dartpy.dynamics.ActuatorType.SERVO
        self._trees: list[tuple[Any, list[int], np.ndarray]] = []
        for tree, dofs, rows in _driven(sim, v):
            every = [tree.skeleton.getJoint(index) for index in range(tree.skeleton.getNumJoints())]
            joints = {joint.getIndexInSkeleton(0): joint for joint in every if joint.getNumDofs() == 1}
            for dof, row in zip(dofs.tolist(), rows.tolist(), strict=True):
                joint = joints[dof]
                joint.setActuatorType(kind)
                joint.setForceLowerLimit(0, -limit[row])
                joint.setForceUpperLimit(0, limit[row])
                # DART drops the efforts that are set on a servo's joint, in which the joint's damping is otherwise
                joint.setDampingCoefficient(0, sim.efforts.damping[tree.dofs][dof])
            self._trees.append((tree.skeleton, dofs.tolist(), rows))

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for skeleton, dofs, rows in self._trees:
            away = position[rows] - skeleton.getPositions()[dofs]
            skeleton.setCommands(dofs, velocity[rows] + self._rate[rows] * away)
