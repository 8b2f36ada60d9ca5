"""Stability as predicted, against what the laws do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.control.stability import unstable
from simspec.testing.bench import OracleJoints, chain, driven, wheel, with_targets
from simspec.world.actions import JointController


def growth(world, steps: int = 400) -> float:
    """By how much a small deviation from the target has grown after some steps, in the oracle."""
    control = Control(world, reference(world))
    start = np.array([body.joint.position[0] for body in world.bodies])
    with np.errstate(all="ignore"):
        rows = control.follow(OracleJoints(world, control), steps, 1)
    away = np.abs(rows - start).max(axis=1)
    return float(np.nan_to_num(away[-1], nan=np.inf) / away[1:20].max())


@pytest.mark.parametrize("ratio", [0.3, 1.0, 2.0])
def test_computed_torque_has_its_textbook_limit(ratio):
    """(ω dt)² + 4 ζ ω dt < 4."""
    omega = 20.0
    limit = (-2.0 * ratio + np.sqrt(4.0 * ratio**2 + 4.0)) / omega
    for share, stable in ((0.99, True), (1.01, False)):
        found = unstable(driven(chain(timestep=share * limit), damping_ratio=ratio))
        assert (not found) == stable
        if found:
            assert found[0].controller == "all"
            assert found[0].largest_stable_step == pytest.approx(limit, rel=2e-3)
            assert found[0].growth > 1.0


def test_a_wheel_s_pd_has_its_textbook_limit():
    """dt² kp/J + 2 dt kd/J < 4."""
    inertia, kp, kd = 0.02, 8.0, 0.5
    limit = (-2 * kd + np.sqrt(4 * kd**2 + 16 * kp * inertia)) / (2 * kp)
    world = driven(wheel(inertia, timestep=1.02 * limit), "pd", kp=(kp,), kd=(kd,))
    (found,) = unstable(world)
    assert found.largest_stable_step == pytest.approx(limit, rel=2e-3)


def test_the_prediction_for_a_coupled_chain_happens():
    """The prediction is of the chain as a whole, joints coupled by M, not of each joint by itself."""
    world = driven(chain(), "pd")
    far = dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=1.0))
    limit = unstable(far)[0].largest_stable_step
    for share, stable in ((0.9, True), (1.1, False)):
        at = dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=share * limit))
        start = np.array([body.joint.position[0] for body in at.bodies])
        at = dataclasses.replace(
            with_targets(at, start + 1e-6), physics=dataclasses.replace(at.physics, gravity=(0.0, 0.0, 0.0))
        )
        assert (not unstable(at)) == stable
        assert (growth(at) < 10.0) == stable


def test_implicit_laws_are_never_blamed():
    for law in ("pd", "computed-torque"):
        assert unstable(driven(chain(timestep=1.0), law, discretisation="implicit")) == []


def test_the_unstable_controller_of_two_is_named():
    world = chain(timestep=0.02)
    names = tuple(body.joint.name for body in world.bodies)
    laws = (
        JointController("calm", names[:2], "pd", kp=(1.0,) * 2, kd=(0.1,) * 2, effort_limits=(None,) * 2),
        JointController("wild", names[2:], "pd", kp=(1e5,) * 2, kd=(10.0,) * 2, effort_limits=(None,) * 2),
    )
    (found,) = unstable(dataclasses.replace(world, controllers=laws))
    assert found.controller == "wild"
    assert 0.0 < found.largest_stable_step < 0.02


def test_a_negative_damping_is_stable_at_no_step():
    world = driven(wheel(), "pd", kp=(1.0,), kd=(-1.0,))
    (found,) = unstable(world)
    assert found.largest_stable_step == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("holds", [(5, 5), (2, 2), (3, 4)])
def test_the_prediction_for_kept_efforts_happens(holds):
    """Of a coupled chain whose controllers act every few steps, in the oracle: below the limit errors die, above they grow."""
    base = driven(chain(("hinge", "hinge")), "pd")
    joints = base.controllers[0].joints
    controllers = tuple(
        JointController(name, (name,), kp=(40.0,), kd=(3.0,), effort_limits=(None,), every_steps=hold)
        for name, hold in zip(joints, holds, strict=True)
    )

    def at(timestep: float):
        physics = dataclasses.replace(base.physics, timestep=timestep, gravity=(0.0, 0.0, 0.0))
        return dataclasses.replace(base, controllers=controllers, physics=physics)

    limit = 1.0
    while found := unstable(at(limit)):  # of both, or of the one that is unstable alone
        limit = 0.999 * min(instability.largest_stable_step for instability in found)
        assert found[0].hold in holds
    start = np.array([body.joint.position[0] for body in base.bodies])
    for share, stable in ((0.9, True), (1.1, False)):
        assert (growth(with_targets(at(share * limit), start + 1e-6, joints), 2000) < 5.0) == stable
        assert bool(unstable(at(share * limit))) != stable


def test_efforts_kept_for_longer_are_less_stable():
    """A wheel under pd with efforts held for T: of the held double integrator kd T/J < 2 as kp vanishes, whatever the steps."""
    inertia, kd = 0.02, 0.5
    for hold in (2, 8, 32):
        control = {"kp": (0.0,), "kd": (kd,), "every_steps": hold}
        (far,) = unstable(driven(wheel(inertia, timestep=1.0), "pd", **control))
        assert far.largest_stable_step * hold == pytest.approx(2.0 * inertia / kd, rel=2e-3)
