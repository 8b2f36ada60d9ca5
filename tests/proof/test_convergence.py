"""Proof in the limit of small timesteps: it accepts other methods of integration of the same model, and no other model."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.proof.checks import PRECISIONS
from simspec.proof.convergence import (
    ORDER,
    LimitMotion,
    amplified,
    eliminated,
    plan,
    pose_errors,
    ratio,
    with_errors,
)
from simspec.proof.motion import MOTION
from simspec.testing import worlds

WORLD = worlds.world(worlds.tree(["fixed", "hinge", "hinge"], 4), "pendulum")


def planned(world=WORLD, precision="double", order=1):
    found = plan(world, Oracle(world), PRECISIONS[precision].of_order(order))
    assert isinstance(found, LimitMotion)
    return found


def moved(world, motion, step=None, timesteps=None):
    """The poses of a motion by a method: ``step(oracle, q, v, effort, dt)``; None: semi-implicit Euler."""
    oracle, rows = Oracle(world), []
    for timestep in timesteps or motion.timesteps:
        finer = round(motion.timesteps[0] / timestep)
        q, v = motion.begun.q, motion.begun.v
        rows.append(oracle.body_poses(q))
        for _ in range(motion.steps // motion.begun.every):
            for _ in range(finer * motion.begun.every):
                if step is None:
                    (_, q), (_, v) = oracle.motion(q, v, motion.begun.effort, 1, 1, timestep=timestep)
                else:
                    q, v = step(oracle, q, v, motion.begun.effort, timestep)
            rows.append(oracle.body_poses(q))
    return {"pose": np.array(rows)}


def outcome(world, motion, answer):
    return {(check.level, check.name): check for check in motion.checks(world, answer)}


def explicit(oracle, q, v, effort, dt):
    """Explicit Euler, of first order: hinges alone."""
    return q + dt * v, v + dt * oracle.acceleration(q, v, effort)


def heun(oracle, q, v, effort, dt):
    """Heun's method, of second order: hinges alone."""
    a = oracle.acceleration(q, v, effort)
    b = oracle.acceleration(q + dt * v, v + dt * a, effort)
    return q + dt * (v + 0.5 * dt * a), v + 0.5 * dt * (a + b)


@pytest.fixture(scope="module")
def motion():
    return planned()


@pytest.mark.parametrize(("step", "order"), [(None, 1), (explicit, 1), (heun, 2)])
def test_another_method_of_the_declared_order_passes(motion, step, order):
    found = dataclasses.replace(motion, precision=motion.precision.of_order(order))
    checks = outcome(WORLD, found, moved(WORLD, found, step))
    assert checks[ORDER].passed, checks[ORDER].detail
    assert checks[MOTION].passed, checks[MOTION].detail
    assert checks[ORDER].worst < 0.02


@pytest.mark.parametrize(("step", "order"), [(explicit, 2), (heun, 1)])
def test_a_method_of_another_order_fails(motion, step, order):
    found = dataclasses.replace(motion, precision=motion.precision.of_order(order))
    assert not outcome(WORLD, found, moved(WORLD, found, step))[ORDER].passed


def test_an_engine_that_ignores_the_timestep_fails(motion):
    """All three motions by the coarsest timestep, seen as often."""
    rows = moved(WORLD, motion)["pose"].reshape(3, *motion.exact.shape)
    answer = {"pose": np.concatenate([rows[0], rows[0], rows[0]])}
    assert not outcome(WORLD, motion, answer)[ORDER].passed


def planted(joint=None, inertial=None):
    """The world with a defect of its last body."""
    last = WORLD.bodies[-1]
    last = dataclasses.replace(
        last,
        joint=dataclasses.replace(last.joint, **(joint or {})),
        inertial=dataclasses.replace(last.inertial, **(inertial or {})),
    )
    return dataclasses.replace(WORLD, bodies=(*WORLD.bodies[:-1], last))


def tilted(axis, angle):
    """An axis turned by an angle."""
    across = np.cross(axis, (0.3, -0.5, 0.8))
    return tuple(np.cos(angle) * np.array(axis) + np.sin(angle) * across / np.linalg.norm(across))


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("defect", ["damping", "axis", "armature", "mass"])
def test_defects_of_the_model_do_not_vanish_with_the_timestep(precision, defect):
    """In doubles a tenth of what must be seen in singles."""
    share = 0.1 if precision == "double" else 1.0
    last, motion = WORLD.bodies[-1], planned(precision=precision)
    world = {
        "damping": lambda: planted(joint={"damping": last.joint.damping + 1e-3 * share}),
        "axis": lambda: planted(joint={"axis": tilted(last.joint.axis, 1e-3 * share)}),
        "armature": lambda: planted(joint={"armature": last.joint.armature + 1e-3 * share}),
        "mass": lambda: planted(inertial={"mass": last.inertial.mass * (1.0 + 1e-2 * share)}),
    }[defect]()
    checks = outcome(WORLD, motion, moved(world, motion))
    assert not (checks[MOTION].passed and checks[ORDER].passed), (checks[MOTION].worst, motion.tolerance)


def test_too_large_a_timestep_is_named():
    """A spring that no explicit method holds, down to an eighth of 16 ms."""
    stiff = planted(joint={"spring_stiffness": 1e6})
    coarse = dataclasses.replace(stiff, physics=dataclasses.replace(stiff.physics, timestep=0.016))
    found = planned(coarse)
    (check,) = found.checks(coarse, {})
    assert check.detail.startswith("the order cannot be measured at 16 ms, nor down to 2 ms"), check.detail
    assert not check.passed
    assert found.operation(coarse) is None


def test_terms_are_eliminated():
    timesteps = np.array([1.0, 0.5, 0.25])
    errors = [np.array([3.0 * dt + 2.0 * dt**2 + 5.0 * dt**3]) for dt in timesteps]
    assert abs(eliminated(errors[1:], 1, 1)[0]) < abs(errors[2][0])
    assert eliminated([e - 5.0 * dt**3 for e, dt in zip(errors, timesteps, strict=True)], 1, 2)[0] == pytest.approx(
        0.0, abs=1e-12
    )
    assert ratio(np.array([4.0, 2.0]), np.array([2.0, 1.0])) == 2.0
    assert amplified(np.ones((3, 1)), 1, 1)[0] == pytest.approx(np.sqrt(5.0))


def test_errors_of_poses_are_undone():
    generator = np.random.default_rng(3)
    exact = generator.normal(size=(4, 2, 7))
    exact[..., 3:] /= np.linalg.norm(exact[..., 3:], axis=-1, keepdims=True)
    errors = 0.1 * generator.normal(size=(4, 2, 6))
    assert pose_errors(exact, with_errors(exact, errors)) == pytest.approx(errors, abs=1e-13)
