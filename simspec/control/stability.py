"""Whether explicit laws are stable at a world's timestep, predicted from the world's mass matrix.

About a posture q the driven joints obey M(q) v̇ = −K e − D ė, with e = q − q*, the joints' own damping among D and their
springs among K, and one step is e' = e + dt v', v' = v − dt M⁻¹ (K e + D v). The law is stable where no eigenvalue of this
step is larger than one; gravity's and the Coriolis force's change with the state is left out (slow compared with gains that
hold a robot). Of a law whose efforts are held for m steps, τ is taken every m steps and kept: then the product of as many
steps counts. computed-torque has M⁻¹ K = ω² and M⁻¹ D = 2 ζ ω on its joints: one joint is stable while (ω dt)² + 4 ζ ω dt <
4, for ζ = 1 while ω dt < 0.828.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simspec.dynamics.oracle_tree import OracleTree
from simspec.world.actions import JointController
from simspec.world.constraints import JointSums
from simspec.world.kinematics import initial_state, layout, sprung_trees, within
from simspec.world.types import Body, World

POSTURES = 20
"""Postures of the trajectory that are looked at, evenly over its points, besides the initial one; M changes slowly along it."""
SLACK = 1e-9
"""An eigenvalue of a mode without stiffness is one, give or take round-off."""
LARGEST = 10.0
"""A timestep (s) above which no limit is reported: a law stable there is called stable at any."""
SMALLEST = 1e-9
"""A timestep (s) below which the search ends: no step helps a system that is unstable in itself."""
MOST_STEPS = 60
"""Steps after which laws with different intervals act at once again, up to which all are followed; beyond, all are taken to
act as seldom as the slowest."""
RESOLUTION = 1e-3
"""Relative: the largest stable step is named to three digits."""


Floats = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class ControlInstability:
    """A controller that diverges: the world's timestep (s), the largest step (s) at which it would not, and by what factor the
    fastest growing deviation grows in a step."""

    controller: str
    timestep: float
    largest_stable_step: float
    growth: float
    hold: int = 1
    """For how many steps efforts are held at most."""


def unstable(world: World) -> list[ControlInstability]:
    """The explicit controllers that are unstable at the world's timestep. Those of one tree, or of several that sums join, are
    looked at together, and blamed together when each alone is stable; implicit ones only take energy out, and are left out."""
    instabilities, timestep = [], world.physics.timestep
    for bodies in sprung_trees(world):
        names = {body.joint.name for body in bodies}
        controllers = [
            controller
            for controller in world.controllers
            if names & set(controller.joints) and controller.law != "native" and controller.discretisation == "explicit"
        ]
        postures = _postures(world, bodies) if controllers else []
        if not controllers or _worst(_systems(world, bodies, controllers, postures), timestep) <= 1.0 + SLACK:
            continue
        alone = {controller.name: _systems(world, bodies, [controller], postures) for controller in controllers}
        blamed = {name: systems for name, systems in alone.items() if _worst(systems, timestep) > 1.0 + SLACK}
        together = {
            ", ".join(controller.name for controller in controllers): _systems(world, bodies, controllers, postures)
        }
        for name, systems in (blamed or together).items():
            hold = max(int(system.hold.max(initial=1)) for system in systems)
            instabilities.append(ControlInstability(name, timestep, _largest(systems), _worst(systems, timestep), hold))
    return instabilities


class System(NamedTuple):
    """The driven tree at one posture."""

    mobility: Floats
    """M⁻¹ (n, n)."""
    joints: tuple[Floats, Floats]
    """K and D (n, n) of the joints' own springs and damping."""
    law: tuple[Floats, Floats]
    """K and D (n, n) of the laws."""
    hold: NDArray[np.int64]
    """For how many steps each joint's effort is held (n,)."""


def _postures(world: World, bodies: Sequence[Body]) -> list[np.ndarray]:
    """Positions (nq of the tree,): the initial ones, and with the trajectory's."""
    local = layout(bodies)
    start, _ = initial_state(dataclasses.replace(world, bodies=tuple(bodies)))
    trajectory, postures = world.trajectory, [start]
    if trajectory is None:
        return postures
    place = {body.joint.name: part.start for body, part in zip(bodies, local.position, strict=True)}
    columns = [(index, place[name]) for index, name in enumerate(trajectory.joints) if name in place]
    count = len(trajectory.times)
    for row in sorted({round(k * (count - 1) / max(1, POSTURES - 1)) for k in range(POSTURES)}):
        posture = start.copy()
        for index, at in columns:
            posture[at] = trajectory.positions[row][index]
        postures.append(posture)
    return postures


def _systems(
    world: World, bodies: tuple[Body, ...], controllers: Sequence[JointController], postures: Sequence[np.ndarray]
) -> list[System]:
    local_world = within(world, bodies)
    tree = OracleTree(local_world)
    where = {body.joint.name: part.start for body, part in zip(bodies, tree.layout.velocity, strict=True)}
    stiffness, damping = np.zeros(tree.nv), np.zeros(tree.nv)
    for body, part in zip(bodies, tree.layout.velocity, strict=True):
        damping[part] = body.joint.damping
        stiffness[part] = body.joint.spring_stiffness
    systems = []
    for posture in postures:
        mass = tree.mass_matrix(posture)
        total_k, total_d = np.zeros_like(mass), np.zeros_like(mass)
        hold = np.ones(tree.nv, dtype=np.int64)
        for controller in controllers:
            for index, name in enumerate(controller.joints):
                if name not in where:
                    continue
                at = where[name]
                hold[at] = controller.hold
                if controller.law == "computed-torque":
                    driven = np.array([where[other] for other in controller.joints if other in where])
                    total_k[at, driven] += controller.natural_frequency**2 * mass[at, driven]
                    total_d[at, driven] += (
                        2.0 * controller.damping_ratio * controller.natural_frequency * mass[at, driven]
                    )
                else:
                    total_k[at, at] += controller.kp[index]
                    total_d[at, at] += controller.kd[index]
        more_k, more_d = JointSums(bodies, local_world.sums).matrices()
        values = np.diag(stiffness) + more_k, np.diag(damping) + more_d
        systems.append(System(np.linalg.inv(mass), values, (total_k, total_d), hold))
    return systems


def _growth(system: System, timestep: float) -> float:
    """The largest |eigenvalue| of a step; of several, the mean factor of one."""
    if (system.hold > 1).any():
        return _growth_of_kept_efforts(system, timestep)
    stiffness, damping = (
        system.mobility @ (values + law) for values, law in zip(system.joints, system.law, strict=True)
    )
    count = len(stiffness)
    identity = np.eye(count)
    speed = np.hstack([-timestep * stiffness, identity - timestep * damping])
    step = np.vstack([np.hstack([identity, np.zeros((count, count))]) + timestep * speed, speed])
    return float(np.abs(np.linalg.eigvals(step)).max())


def _growth_of_kept_efforts(system: System, timestep: float) -> float:
    """The same where efforts are held: of e, v and the efforts, over the time after which all laws act at once again."""
    count = len(system.hold)
    hold = system.hold
    steps = int(np.lcm.reduce(hold))
    if steps > MOST_STEPS:
        hold, steps = np.full(count, hold.max()), int(hold.max())
    identity, nothing = np.eye(count), np.zeros((count, count))
    stiffness, damping = (timestep * system.mobility @ values for values in system.joints)
    whole = np.eye(3 * count)
    for step in range(steps):
        due = (step % hold == 0)[:, None]
        efforts = np.where(
            due, np.hstack([-system.law[0], -system.law[1], nothing]), np.hstack([nothing, nothing, identity])
        )
        speed = np.hstack([-stiffness, identity - damping, nothing]) + timestep * system.mobility @ efforts
        place = np.hstack([identity, nothing, nothing]) + timestep * speed
        whole = np.vstack([place, speed, efforts]) @ whole
    largest = float(np.abs(np.linalg.eigvals(whole)).max())
    return float(largest ** (1.0 / steps))


def _worst(systems: Sequence[System], timestep: float) -> float:
    return max(_growth(system, timestep) for system in systems)


def _largest(systems: Sequence[System]) -> float:
    """The largest timestep (s) at which all are stable, to ``RESOLUTION``, from below; 0 when there is none."""
    largest = LARGEST
    for system in systems:
        if _growth(system, largest) <= 1.0 + SLACK:
            continue
        stable, not_stable = 0.0, largest
        while not_stable - stable > RESOLUTION * not_stable and not_stable > SMALLEST:
            middle = (stable + not_stable) / 2.0
            if _growth(system, middle) <= 1.0 + SLACK:
                stable = middle
            else:
                not_stable = middle
        largest = stable
    return largest
