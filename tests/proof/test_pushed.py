"""Level L7 of forces: where the probe begins, and what it says where nothing can be compared."""

from __future__ import annotations

import dataclasses

from simspec.dynamics.oracle import Oracle
from simspec.proof import forces
from simspec.proof.checks import Check
from simspec.world.forces import Force
from simspec.world.frames import compose, inverse
from simspec.world.kinematics import poses
from simspec.world.types import Connect
from tests import worlds


def pushed_loop():
    """A loop of five hinges whose first begins near a limit, pushed."""
    world = worlds.world(worlds.tree(["fixed", *["hinge"] * 5], 7), "loop")
    bodies, place = list(world.bodies), poses(world)
    root, last = bodies[0].name, bodies[-1].name
    point = compose(inverse(place[root]), place[last]).position
    joint = bodies[1].joint
    limits = (joint.position[0] - 0.01, joint.position[0] + 0.5)
    bodies[1] = dataclasses.replace(bodies[1], joint=dataclasses.replace(joint, position_limits=limits))
    pin, force = Connect("pin", root, last, point, (0.0, 0.0, 0.0)), Force(last, (1.0, 0.0, 0.0), until=0.01)
    return dataclasses.replace(world, bodies=tuple(bodies), constraints=(pin,), forces=(force,))


def test_loops_are_pushed_from_within_their_limits():
    world = pushed_loop()
    pushed = forces.plan(world, Oracle(world))
    assert pushed is not None
    assert pushed.ends == ""
    assert pushed.halved < 10


def test_motion_that_cannot_be_compared_is_a_check_that_failed():
    world = pushed_loop()
    pushed = forces.plan(world, Oracle(world))
    assert pushed is not None
    (check,) = forces.forces_checks(
        dataclasses.replace(pushed, ends="it diverges"), {"pose": pushed.poses * float("nan")}
    )
    assert isinstance(check, Check)
    assert (check.count, check.passed) == (0, False)
    assert "it diverges" in check.detail
