"""Arrivals at the limit of a ball joint: the stop removes the velocity into it, damping the velocity deflected before."""

from __future__ import annotations

import numpy as np
import pytest

import simspec
from simspec.dynamics.oracle import Oracle
from simspec.proof import limits


def world(damping):
    bodies = {
        "base": {"fixed": True},
        "bob": {
            "mass": 0.7,
            "inertia": {"principal": [0.0003, 0.0012, 0.0011]},
            "centre_of_mass": [0.005, -0.01, 0.01],
            "parent": "base",
            "joint": {"type": "ball", "limits": {"angle": 1.2}, "damping": damping},
        },
    }
    return simspec.Spec.from_data({"simspec": 1, "name": "bob", "bodies": bodies}).resolve()


def arrived(damping):
    """The trial of an arrival, and the velocities with which an ideal stop leaves it: it acts in the second step."""
    entry = world(damping)
    oracle = Oracle(entry)
    plan = limits.plan(entry, oracle)
    assert plan is not None
    trial = next(trial for trial in plan.trials if trial.name.startswith("arrives"))
    q, v = oracle.step(trial.q, trial.v, trial.effort)
    _, v = oracle.step(q, v, trial.effort)
    axis = q[1:] / np.linalg.norm(q[1:])
    taken = np.linalg.solve(oracle.mass_matrix(q), axis)
    left = v - taken * float(axis @ v) / float(axis @ taken)
    return entry, plan, trial, left


@pytest.mark.parametrize("damping", [0.03, 0.06, 0.1])
def test_velocity_deflected_by_damping_is_no_fault_of_a_stop(damping):
    """Of a light body on a ball with damping, an ideal stop leaves more than a stop may leave else."""
    entry, plan, trial, left = arrived(damping)
    rest = np.zeros_like(left)
    share = np.abs(left).max() / np.abs(trial.free).max()
    assert share > 0.01
    rows = [left if other is trial else rest for other in plan.trials]
    (check,) = plan.checks(entry, {"v": np.array(rows)})
    assert check.passed
    missing = [trial.free if other is trial else rest for other in plan.trials]
    (check,) = plan.checks(entry, {"v": np.array(missing)})
    assert not check.passed


def test_without_damping_nothing_is_allowed():
    _, _, trial, _ = arrived(0.0)
    assert trial.turned < 2e-3 * np.abs(trial.free).max()
