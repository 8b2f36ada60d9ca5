"""Tolerances of a proof follow from the precision of an engine, and larger errors are still caught."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.contact import Rules
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import DOUBLE, SINGLE
from simspec.engines.kit.contract import Engine
from simspec.proof import forces, motion
from simspec.proof import forces as dry_friction
from simspec.proof import probes as control
from simspec.proof.checks import PRECISIONS, inventory_checks
from simspec.proof.comparator import compare
from simspec.proof.verify import prepare
from simspec.testing import worlds
from simspec.testing.bench import chain, driven
from simspec.world.actions import Force
from simspec.world.types import Body, PairContact, ReadBack, Surface, World

OF_SINGLES, OF_DOUBLES = PRECISIONS[SINGLE], PRECISIONS[DOUBLE]
RULES = Rules("table", "table", "table", "table", "table")
WORLD = worlds.ball_with_law(friction=0.6)


def single(value):
    """A value as an engine of single precision has it."""
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        return dataclasses.replace(value, **{name: single(getattr(value, name)) for name in names})
    if isinstance(value, tuple):
        return tuple(single(entry) for entry in value)
    return float(np.float32(value)) if isinstance(value, float) else value


def read_back_of(world: World) -> ReadBack:
    laws = tuple(law for law in world.contact.pairs if law.collide)
    bodies = tuple(
        dataclasses.replace(
            body,
            shapes=tuple(dataclasses.replace(shape, surfaces=(Surface(0.0, 0.0, 0.0, 0.0),)) for shape in body.shapes),
        )
        for body in world.bodies
    )
    return ReadBack(bodies, world.physics.gravity, world.physics.timestep, laws=laws)


def failed(world: World, found: ReadBack) -> set[str]:
    return {check.name for check in compare(world, found, RULES, False, precision=OF_SINGLES) if not check.passed}


def heavier(body: Body) -> Body:
    return dataclasses.replace(body, inertial=dataclasses.replace(body.inertial, mass=body.inertial.mass * (1 + 1e-5)))


def off_centre(body: Body) -> Body:
    x, y, z = body.inertial.centre_of_mass
    return dataclasses.replace(body, inertial=dataclasses.replace(body.inertial, centre_of_mass=(x + 1e-5, y, z)))


def rougher(law: PairContact) -> PairContact:
    return dataclasses.replace(law, friction=law.friction * 1.001)


def test_rounded_values_pass_and_wrong_values_fail():
    sound = read_back_of(WORLD)
    rounded = single(sound)
    assert rounded != sound
    assert failed(WORLD, rounded) == set()
    bodies = rounded.bodies
    for change, name in ((heavier, "mass"), (off_centre, "centre of mass")):
        wrong = dataclasses.replace(rounded, bodies=(*bodies[:-1], change(bodies[-1])))
        assert failed(WORLD, wrong) == {name}
    wrong = dataclasses.replace(rounded, laws=tuple(rougher(law) for law in rounded.laws))
    assert failed(WORLD, wrong) == {"friction"}
    (check,) = inventory_checks({"a": 1.0}, {"a": float(np.float32(1.1)) / 1.1}, OF_SINGLES)
    assert check.passed
    (check,) = inventory_checks({"a": 1.0}, {"a": 1.0 + 1e-5}, OF_SINGLES)
    assert not check.passed


def test_the_floor_of_single_precision_is_that_of_rounded_steps():
    """A state rounded after every step is well within the tolerance; a weight that is off by 1e-3 is not."""
    world = worlds.hinges()
    oracle = Oracle(world)
    plan = motion.plan(world, oracle, OF_SINGLES)
    assert plan.steps == motion.plan(world, oracle).steps
    assert 1e-6 < plan.floor < 1e-4
    assert plan.tolerance == 10.0 * plan.floor
    nearest = OF_SINGLES.rounding(0, np.random.default_rng())
    moved = oracle.motion(plan.q, plan.v, plan.effort, plan.steps, plan.every, nearest)[0]
    (check,) = plan.checks(world, {"pose": np.array([oracle.body_poses(q) for q in moved])})
    assert check.passed
    assert check.worst > 1e-7
    heavy = dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=(0.0, 0.0, -9.82)))
    moved = Oracle(heavy).motion(plan.q, plan.v, plan.effort, plan.steps, plan.every, nearest)[0]
    (check,) = plan.checks(world, {"pose": np.array([oracle.body_poses(q) for q in moved])})
    assert not check.passed


def test_every_probe_of_motion_goes_by_the_numbers():
    bodies = worlds.tree(["hinge", "slide"], 4)
    rough = dataclasses.replace(bodies[1], joint=dataclasses.replace(bodies[1].joint, dry_friction=0.5))
    world = driven(dataclasses.replace(chain(("hinge", "hinge")), name="arm"), "pd")
    response = control.plan(world, None, OF_SINGLES)
    assert response.tolerance == max(2e-6, 10.0 * response.floor)
    assert 1e-8 < response.floor < 1e-5
    pushed = forces.plan(
        dataclasses.replace(world, forces=(Force("link1", (1.0, 2.0, 3.0)),)), Oracle(world), OF_SINGLES
    )
    assert pushed.tolerance == max(2e-6, 10.0 * pushed.floor)
    friction = worlds.world((bodies[0], rough))
    (sliding,) = {
        trial.tolerance
        for trial in dry_friction.plan_friction(friction, Oracle(friction), OF_SINGLES).trials
        if trial.slides
    }
    assert 1e-5 <= sliding < 1e-2
    (sliding,) = {
        trial.tolerance for trial in dry_friction.plan_friction(friction, Oracle(friction)).trials if trial.slides
    }
    assert sliding == dry_friction.SLIDE_TOLERANCE == OF_DOUBLES.sliding


def test_probes_of_other_numbers_are_made_once():
    class Rough:
        PRECISION = SINGLE

        @staticmethod
        def method(world):
            return None

    probes = prepare(worlds.fall(), ["L6"])
    other = probes.of(Rough)
    assert other is probes.of(Rough)
    assert (probes.plans["motion"].precision, other.plans["motion"].precision) == (OF_DOUBLES, OF_SINGLES)
    assert np.array_equal(other.plans["motion"].poses, probes.plans["motion"].poses)
    assert other.of(Rough) is other


def test_an_engine_names_numbers_that_there_are():
    with pytest.raises(TypeError, match="PRECISION is 'half', allowed: double, single"):

        class Half(Engine):
            NAME = "half"
            PRECISION = "half"
