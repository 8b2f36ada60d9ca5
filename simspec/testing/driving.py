"""Worlds with driven joints, and joints driven in the oracle."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from simspec.control.law import Control
from simspec.dynamics.oracle import Oracle
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.testing import worlds
from simspec.world.actions import Controller, Trajectory
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Inertial, Joint, Physics, World


def driven(world: World, law: str = "computed-torque", joints: tuple[str, ...] | None = None, **more: Any) -> World:
    """``world`` with one controller on all its hinges and slides (or ``joints``), and gains that suit a body of 1 kg."""
    if joints is None:
        joints = tuple(body.joint.name for body in world.bodies if body.joint.kind in SCALAR_JOINTS)
    given: dict[str, Any] = {"effort_limits": (None,) * len(joints)}
    if law == "computed-torque":
        given |= {"natural_frequency": 20.0, "damping_ratio": 1.0}
    else:
        given |= {"kp": (40.0,) * len(joints), "kd": (3.0,) * len(joints)}
    return dataclasses.replace(world, controllers=(Controller("all", joints, law, **(given | more)),))


def native(base: World, kp: float = 40.0, kd: float = 3.0, limit: float | None = None) -> World:
    """``base`` with its hinges and slides under the engine's own controllers."""
    joints = tuple(body.joint.name for body in base.bodies if body.joint.kind in SCALAR_JOINTS)
    count = len(joints)
    one = Controller("all", joints, "native", kp=(kp,) * count, kd=(kd,) * count, effort_limits=(limit,) * count)
    return dataclasses.replace(base, controllers=(one,))


def with_targets(world: World, targets: np.ndarray, joints: tuple[str, ...] | None = None) -> World:
    """``world`` with constant targets: a trajectory of one point."""
    joints = joints or world.controllers[0].joints
    return dataclasses.replace(world, trajectory=Trajectory(joints, (0.0,), (tuple(map(float, targets)),)))


def chain(kinds: tuple[str, ...] = ("hinge", "slide", "hinge", "hinge"), timestep: float = 0.001, **more: Any) -> World:
    """A chain of random bodies on a fixed base, at rest, under gravity."""
    bodies = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=(0.0,) * len(body.joint.velocity)))
        for body in worlds.tree(list(kinds), 5, **more)
    )
    return worlds.world(bodies, physics=Physics(timestep=timestep, steps=1000))


def wheel(inertia: float = 0.02, timestep: float = 0.001) -> World:
    """One hinge about the vertical, with its centre of mass on the axis: M = inertia, h = 0."""
    joint = Joint("wheel_joint", "hinge", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    body = Body("wheel", "wheel", Inertial(1.0, inertia=(inertia, inertia, inertia, 0.0, 0.0, 0.0)), joint)
    return worlds.world((body,), physics=Physics(timestep=timestep, steps=1000))


class OracleJoints:
    """The driven joints, in the oracle's motion of the whole world."""

    def __init__(self, world: World, control: Control):
        self.oracle = Oracle(world)
        self.q, self.v = initial_state(world)
        self._effort = np.zeros(self.oracle.nv)
        self._control = control
        self._done = 0

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self.q[self._control.q_places], self.v[self._control.v_places]

    def give(self, effort: np.ndarray) -> None:
        self._effort[self._control.v_places] = effort

    def step(self) -> None:
        pushed = pushes(self.oracle, self.q, self._done)
        states, speeds = self.oracle.motion(self.q, self.v, self._effort + pushed, 1, 1)
        self.q, self.v = states[-1], speeds[-1]
        self._done += 1


def pushes(oracle: Oracle, q: np.ndarray, step: int) -> np.ndarray:
    """The efforts (nv,) of a world's forces on bodies in a step, by the oracle's own Jacobians."""
    dt, effort = oracle.timestep, np.zeros(oracle.nv)
    for force in oracle.world.forces:
        until = np.inf if force.until is None else force.until / dt
        share = min(step + 1.0, until) - max(float(step), force.start / dt)
        effort += float(np.clip(share, 0.0, 1.0)) * oracle.effort_of(q, force)
    return effort
