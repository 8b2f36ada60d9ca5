"""Damping and springs of joints as efforts, against the oracle, which has an implementation of its own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.world import frames
from simspec.world.constraints import JointForces
from simspec.world.types import Body, Inertial, Joint, Pose, World

DAMPED = {
    "hinge": {"damping": 0.3, "spring_stiffness": 2.0, "spring_rest": 0.4},
    "slide": {"damping": 0.7, "spring_stiffness": 5.0, "spring_rest": -0.2},
    "ball": {"damping": 0.2, "spring_stiffness": 3.0},
    "free": {},
    "fixed": {},
}


def body(name: str, kind: str, parent: str | None, **numbers) -> Body:
    joint = Joint(f"{name}_joint", kind, parent=parent, origin=Pose((0.1, 0.2, 0.3)), axis=(0.0, 0.6, 0.8), **numbers)
    if kind == "free":
        joint = dataclasses.replace(joint, origin=Pose(), position=(0, 0, 1, 1, 0, 0, 0), velocity=(0.0,) * 6)
    elif kind == "ball":
        joint = dataclasses.replace(joint, position=(1, 0, 0, 0), velocity=(0.0,) * 3)
    inertial = Inertial(1.3, (0.02, 0.0, 0.1), (0.02, 0.03, 0.04, 0.001, 0.0, 0.002))
    return Body(name, name, inertial, joint)


def test_the_effort_agrees_with_the_acceleration_of_the_oracle():
    """The difference between worlds with and without damping and springs, whose state is the same."""
    tree = [
        ("root", "free", None),
        ("arm", "hinge", "root"),
        ("tip", "ball", "arm"),
        ("plate", "fixed", "tip"),
        ("rod", "slide", "arm"),
    ]
    having, bare = (
        World(
            "damped", tuple(body(name, kind, parent, **(DAMPED[kind] if local else {})) for name, kind, parent in tree)
        )
        for local in (True, False)
    )
    oracle, without = Oracle(having), Oracle(bare)
    forces = JointForces(having.bodies)
    assert forces.needed
    assert not JointForces(bare.bodies).needed
    falling = World("falling", (body("root", "free", None, damping=0.5, angular_damping=0.05),))
    assert not JointForces(falling.bodies).needed
    random = np.random.default_rng(3)
    for _ in range(5):
        q, v = random.normal(size=oracle.nq), random.normal(size=oracle.nv)
        for start in (3, 8):
            q[start : start + 4] = frames.normalise(tuple(q[start : start + 4]))
        effort = forces.effort(q, v)
        expected = oracle.acceleration(q, v, np.zeros(oracle.nv))
        assert without.acceleration(q, v, effort) == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert np.abs(expected - without.acceleration(q, v, np.zeros(oracle.nv))).max() > 0.1
