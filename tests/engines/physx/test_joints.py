"""Joints in PhysX: changes of its links and joints are found, the rates of balls, and trees that are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.physx.engine import PhysX
from simspec.engines.physx.trees import quadratic
from simspec.errors import UnsupportedError
from simspec.proof.checks import PRECISIONS, inventory_checks
from simspec.proof.selftest_worlds import WORLDS
from simspec.testing.worlds import accepting
from simspec.world.rotations import exponential, matrices
from simspec.world.types import Body, Inertial, Joint, Physics, Pose, World
from tests.engines.free_bodies import loader

installed = pytest.mark.skipif(PhysX.version() is None, reason="sapien is not installed")


@pytest.fixture
def load(load_files):
    return loader(PhysX, load_files)


def first(sim):
    return sim.trees.trees[0]


CHANGES = {
    "damping of a link": lambda sim: first(sim).links[0].set_linear_damping(0.05),
    "speed of a link": lambda sim: first(sim).links[0].set_max_angular_velocity(50.0),
    "weight of a link": lambda sim: first(sim).links[0].set_disable_gravity(True),
    "friction of a joint": lambda sim: first(sim).joints[0].set_friction(0.05),
    "speed of a joint": lambda sim: first(sim).joints[0].set_max_velocity(100.0),
    "drive of a joint": lambda sim: first(sim).joints[0].set_drive_properties(1.0, 0.0),
    "sleep": lambda sim: first(sim).articulation.set_sleep_threshold(0.005),
    "iterations": lambda sim: first(sim).articulation.set_solver_position_iterations(10),
}


@installed
@pytest.mark.parametrize("change", [None, *CHANGES])
def test_any_change_of_a_link_or_a_joint_is_found(change, load):
    world = accepting(WORLDS["ball joint"]("physx"), "physx")
    engine = load(world)
    if change is not None:
        CHANGES[change](engine._simulation)
    back = engine.read_back()
    (check,) = inventory_checks(PhysX.expected_inventory(world, back.neutral), back.inventory, PRECISIONS["single"])
    assert check.passed == (change is None), check.detail


def test_the_rates_of_three_hinges_differ_from_the_angular_velocity_in_the_second_order():
    """ω of three hinges at angles q, rates u: its change along a motion with constant rates is c."""
    rates = np.array([0.7, -1.1, 0.4])

    def angular(angles):
        x, y, z = np.eye(3)
        turn = matrices(exponential(np.array([angles[0] * x])))[0]
        second = turn @ y
        turn = turn @ matrices(exponential(np.array([angles[1] * y])))[0]
        return rates[0] * x + rates[1] * second + rates[2] * (turn @ z)

    step = 1e-6
    change = (angular(step * rates) - angular(-step * rates)) / (2.0 * step)
    assert change == pytest.approx(quadratic(rates[None])[0], abs=1e-9)


def chain(count, kind="hinge"):
    """Bodies in a row, on hinges or balls."""
    bodies = []
    for number in range(count):
        above = f"b{number - 1}" if number else None
        position = (0.1,) if kind == "hinge" else (1.0, 0.0, 0.0, 0.0)
        velocity = (0.0,) if kind == "hinge" else (0.0, 0.0, 0.0)
        origin = Pose((0.0, 0.0, -0.1))
        joint = Joint(f"j{number}", kind, above, origin, (1.0, 0.0, 0.0), position=position, velocity=velocity)
        bodies.append(Body(f"b{number}", "chain", Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)), joint))
    return World("chain", tuple(bodies), physics=Physics((0.0, 0.0, -9.81), 1e-3, 10))


@pytest.mark.parametrize(("kind", "most"), [("hinge", 254), ("ball", 84)])
def test_an_articulation_has_at_most_255_links(kind, most):
    assert compile_world(chain(most, kind), ["physx"])
    with pytest.raises(UnsupportedError, match="at most 255 links in an articulation"):
        compile_world(chain(most + 1, kind), ["physx"])


@installed
def test_a_ball_turns_through_a_pitch_of_a_right_angle(load):
    """A ball joint without weight turns at a constant rate about y, where three hinges alone would be singular."""
    world = chain(1, "ball")
    world = World("ball", world.bodies, physics=Physics((0.0, 0.0, 0.0), 1e-3, 10))
    engine = load(world)
    engine.set_state(np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, math.pi, 0.0]))
    engine.step(1500)
    q, v = engine.get_state()
    assert v == pytest.approx([0.0, math.pi, 0.0], abs=1e-5)
    assert np.abs(q) == pytest.approx([math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0], abs=1e-5)


@installed
def test_a_joint_that_arrives_at_its_limit_stops_there(load):
    body = chain(1).bodies[0]
    joint = Joint("j0", "hinge", None, Pose(), (1.0, 0.0, 0.0), (-0.5, 0.5), position=(0.45,), velocity=(3.0,))
    world = World("limit", (Body("b0", "chain", body.inertial, joint),), physics=Physics((0.0, 0.0, 0.0), 1e-3, 10))
    engine = load(world)
    engine.step(30)
    q, v = engine.get_state()
    assert (q[0], v[0]) == pytest.approx((0.5, 0.0), abs=1e-6)
