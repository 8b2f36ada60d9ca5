"""Level L7 of forces: where the probe begins, and what it says where nothing can be compared."""

from __future__ import annotations

import dataclasses

from simspec.dynamics.oracle import Oracle
from simspec.proof import forces
from simspec.proof.checks import Check
from tests.constrained import pushed_loop


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
    (check,) = dataclasses.replace(pushed, ends="it diverges").checks(world, {"pose": pushed.poses * float("nan")})
    assert isinstance(check, Check)
    assert (check.count, check.passed) == (0, False)
    assert "it diverges" in check.detail
