"""Armature as inertia: the same dynamics by the oracle, the same contact, proofs of engines, and what is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import simspec
from simspec.compiler import compile_world
from simspec.dialects.kit.contract import dialects
from simspec.dynamics.oracle import Oracle, random_states
from simspec.engines.kit.registry import find_engine
from simspec.errors import UnsupportedError
from simspec.proof.building import free, single_material, slab
from simspec.proof.selftest_worlds import PHYSICS
from simspec.proof.verify import verify
from simspec.support.features import Feature
from simspec.testing import worlds
from simspec.world.armature import as_inertia, weightless
from simspec.world.inertia import lumped, lumped_inertial
from simspec.world.types import Inertial, Pose, Shape, World

pytestmark = pytest.mark.usefixtures("warm_engines")

LEVELS = ("L0", "L1", "L3")


def armed(world: World, linear: float = 0.7, angular: float = 0.02, ball: float = 0.05) -> World:
    """``world`` with armature of free joints and balls."""
    numbers = {"free": {"armature": linear, "angular_armature": angular}, "ball": {"armature": ball}}
    bodies = tuple(worlds.with_joint(body, **numbers.get(body.joint.kind, {})) for body in world.bodies)
    return dataclasses.replace(world, bodies=bodies)


TREE = armed(worlds.world(worlds.tree(["free", "hinge", "slide"], 5, armature=0.03), "tree"))
BALL = armed(worlds.world(worlds.tree(["fixed", "ball", "hinge"], 6), "ball"))
CARRIED = armed(worlds.world(worlds.tree(["fixed", "hinge", "ball"], 6), "carried"))


def gathered_base() -> World:
    """A free base with a tensor, with a point mass fixed to it, so that engines receive their inertia as one."""
    base, mass, arm = worlds.tree(["free", "fixed", "hinge"], 11, [-1, 0, 0])
    return armed(worlds.world((base, dataclasses.replace(mass, inertial=Inertial(0.4, (0.1, 0.0, 0.2))), arm)))


@pytest.mark.parametrize(
    "world", [TREE, BALL, gathered_base(), armed(worlds.lifted())], ids=["tree", "ball", "gathered", "lifted"]
)
def test_dynamics_are_the_same(world):
    """Mass matrix, bias force with weights, energies, and a motion under gravity."""
    oracle, other = Oracle(world), Oracle(as_inertia(world))
    assert as_inertia(world).bodies != world.bodies
    q, v = random_states(world, 3)
    for position, velocity in zip(q, v, strict=True):
        np.testing.assert_allclose(oracle.mass_matrix(position), other.mass_matrix(position), rtol=0, atol=1e-14)
        bias = oracle.bias_force(position, velocity)
        np.testing.assert_allclose(bias, other.bias_force(position, velocity), rtol=0, atol=1e-13)
        np.testing.assert_allclose(oracle.energy(position, velocity), other.energy(position, velocity), rtol=1e-13)
    ends = [each.motion(q[0], v[0], None, 100, 100)[0][-1] for each in (oracle, other)]
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-12)


def test_a_gathered_group_keeps_its_centre_of_mass():
    world = gathered_base()
    base, received = world.bodies[0], as_inertia(world)
    assert base.name in lumped(world)
    assert received.bodies[0].inertial.centre_of_mass == lumped_inertial(world, base).centre_of_mass
    assert not lumped(received)


def test_the_added_mass_has_no_weight():
    received = as_inertia(TREE)
    base, other = TREE.bodies[0], received.bodies[0]
    assert other.inertial.mass == pytest.approx(base.inertial.mass + 0.7)
    assert other.gravity_scale * other.inertial.mass == pytest.approx(base.inertial.mass, rel=1e-15)
    assert weightless(TREE, received) == (base.name,)
    floating = dataclasses.replace(TREE, physics=dataclasses.replace(TREE.physics, gravity=(0.0, 0.0, 0.0)))
    assert weightless(floating, as_inertia(floating)) == ()


def test_a_ball_on_a_body_that_moves_keeps_its_armature():
    assert as_inertia(CARRIED) is CARRIED
    assert as_inertia(worlds.every_joint()).bodies == worlds.every_joint().bodies


def test_a_single_number_of_a_language_is_the_smaller():
    """MJCF has one number for translation and rotation, and the body has the difference."""
    received = dialects()["mujoco"].received(TREE)
    base, before = received.bodies[0], TREE.bodies[0]
    assert (base.joint.armature, base.joint.angular_armature) == (0.02, 0.02)
    assert base.inertial.mass == pytest.approx(before.inertial.mass + 0.68)
    assert base.inertial.inertia == before.inertial.inertia
    equal = armed(worlds.jointed("free"), 0.1, 0.1)
    assert dialects()["mujoco"].received(equal) is equal


@pytest.mark.parametrize("engine", ["pybullet", "ode"])
def test_engines_have_it_in_their_mass_matrix(engine):
    """Proven against the oracle of the world as written; files without it are found by text, mass and mass matrix."""
    world = armed(worlds.world((*worlds.tree(["free", "hinge"], 5), *worlds.tree(["ball"], 6, prefix="ball-"))))
    proof = verify(world, [engine], levels=LEVELS).engines[engine]
    assert proof.valid, [check for check in proof.checks if not check.passed]
    bare = compile_world(armed(world, 0.7, 0.02, 0.0), [engine])
    found = verify(world, [engine], levels=LEVELS, compiled=bare).engines[engine]
    assert {check.level for check in found.checks if not check.passed} >= {"L0", "L3"}


def sphere(angular: float) -> World:
    """A sphere that falls and slides on a floor until it rolls."""
    solid = Inertial(1.0, inertia=(0.004, 0.004, 0.004, 0.0, 0.0, 0.0))
    shape = Shape("ball_0", "sphere", (0.1,), Pose(), "rubber")
    ball = free("ball", (0.0, 0.0, 0.11), solid, shape, velocity=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    bodies = (slab("floor", (6.0, 6.0, 0.4), "rubber"), ball)
    physics = dataclasses.replace(PHYSICS, gravity=(0.0, 0.0, -9.81), steps=600)
    world = World("sphere", bodies, single_material("rubber", 0.3), physics)
    return armed(worlds.with_options(world, "mujoco", accept=("contact.friction.impact",)), 2.0, angular)


def end_of(world: World, engine: str) -> np.ndarray:
    """The velocity of the last body at the end of a run, without recording more."""
    return np.asarray(simspec.run(world, engine).arrays["velocity"])[-1, -1]


def test_contact_meets_the_same_mass_matrix():
    """MuJoCo's field, the same as inertia, and the closed form of an engine: (m + a) v changes by the impulse that turns
    (I + b) ω, until v = ω r."""
    world = sphere(2.0)
    np.testing.assert_allclose(end_of(world, "mujoco"), end_of(as_inertia(world), "mujoco"), rtol=0, atol=1e-12)
    rolling = 3.0 * 0.1**2 / (3.0 * 0.1**2 + 0.004 + 0.01)
    assert end_of(sphere(0.01), "ode")[0] == pytest.approx(
        rolling, rel=3e-4
    )  # the overlap, 0.4 mm at first, is a part of r
    bare = armed(sphere(0.01), 0.0, 0.0)
    assert end_of(bare, "ode")[0] == pytest.approx(0.01 / 0.014, rel=3e-3)


def test_refusals_say_why():
    with pytest.raises(
        UnsupportedError, match=r"joint\.ball\.armature: the engine has no armature of ball joints, and the parent"
    ):
        compile_world(CARRIED, ["drake"])
    with pytest.raises(UnsupportedError, match=r"--accept joint\.ball\.armature"):
        compile_world(CARRIED, ["dart"])
    heavy = worlds.with_options(
        TREE, "drake", settings=(("integrator", "runge_kutta3"),), accept=("physics.integrator",)
    )
    decided = {decision.feature for decision in compile_world(heavy, ["drake"])["drake"].decisions}
    assert {Feature.FREE_ARMATURE, Feature.GRAVITY_SCALE} <= decided
    assert find_engine("drake").method(heavy).order == 3
