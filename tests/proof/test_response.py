"""The step response of level L7: it begins away from limits, and ends near them."""

from __future__ import annotations

import dataclasses
import math

import pytest

import simspec
from simspec.dynamics.oracle import angles_of
from simspec.proof import probes
from simspec.world.actions import JointController
from simspec.world.kinematics import layout_of
from tests.constrained import pushed_loop


def test_loops_answer_from_within_their_limits():
    """Settled anywhere, the first joint of the loop was near its limit, and nothing was compared."""
    world = pushed_loop()
    driven = world.bodies[-1].joint.name
    law = JointController("law", (driven,), kp=(0.1,), kd=(0.01,), effort_limits=(None,))
    response = probes.plan(dataclasses.replace(world, controllers=(law,), forces=()))
    assert response is not None
    assert response.steps >= 10 * probes.EVERY
    low, high = world.bodies[1].joint.position_limits
    at = float(response.q[layout_of(world).position[1].start])
    assert low + probes.INSIDE * (high - low) <= at <= high - probes.INSIDE * (high - low)


@pytest.mark.parametrize(
    ("begins", "steps"), [(0.999, probes.RESPONSE_STEPS), (0.5, probes.RESPONSE_STEPS), (0.0, probes.RESPONSE_STEPS)]
)
def test_a_ball_begins_inside_its_limit(begins, steps):
    """A ball that stands at its limit is turned back; without that its stop acts, which the oracle does not know."""
    inertia = {"mass": 1, "inertia": {"principal": [0.1, 0.2, 0.3]}}
    turn = [math.cos(0.4 * begins), math.sin(0.4 * begins), 0, 0]
    ball = {"type": "ball", "limits": {"angle": 0.8}, "position": {"quat": turn}, "damping": 5}
    bodies = {
        "base": {"fixed": True},
        "upper": {**inertia, "parent": "base", "joint": ball},
        "lower": {**inertia, "parent": "upper", "joint": {"type": "hinge", "axis": [0, 1, 0], "name": "elbow"}},
    }
    law = {"law": "pd", "joints": ["elbow"], "kp": 1.0, "kd": 0.1}
    data = {"simspec": 1, "name": "ball", "physics": {"gravity": [0, 0, 0]}, "bodies": bodies, "control": {"law": law}}
    response = probes.plan(simspec.Spec.from_data(data).resolve())
    assert response is not None
    assert response.steps == steps
    assert angles_of(response.q[None, :4])[0] == pytest.approx(0.8 * min(begins, 1.0 - probes.INSIDE), abs=1e-12)


def test_a_ball_that_comes_near_its_limit_ends_the_comparison():
    inertia = {"mass": 1, "inertia": {"principal": [0.1, 0.2, 0.3]}, "centre_of_mass": [0, 0, 0.3]}
    ball = {"type": "ball", "limits": {"angle": 0.3}, "position": {"quat": [1, 0.05, 0, 0]}}
    bodies = {
        "base": {"fixed": True},
        "upper": {**inertia, "parent": "base", "joint": ball},
        "lower": {**inertia, "parent": "upper", "joint": {"type": "hinge", "axis": [0, 1, 0], "name": "elbow"}},
    }
    law = {"law": "pd", "joints": ["elbow"], "kp": 1.0, "kd": 0.1}
    response = probes.plan(
        simspec.Spec.from_data({"simspec": 1, "name": "falls", "bodies": bodies, "control": {"law": law}}).resolve()
    )
    assert response is not None
    assert probes.EVERY < response.steps < probes.RESPONSE_STEPS
