"""MuJoCo and the contact law, measured in the engine: friction, moments of friction, hardness, and what passes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.engines.mujoco.contact import CONTACT_DEVIATIONS
from simspec.engines.mujoco.engine import MuJoCo
from simspec.world.types import (
    Body,
    Contact,
    Hardness,
    Inertial,
    Joint,
    Material,
    PairContact,
    Physics,
    Pose,
    Shape,
    World,
)
from tests.dialects.mujoco.saying import emit

pytest.importorskip("mujoco")
G = 9.81
BALL = Shape("body_0", "sphere", (0.1,), Pose(), "m")
BOX = Shape("body_0", "box", (0.2, 0.2, 0.04), Pose(), "m")
HEIGHT = {"sphere": 0.1, "box": 0.02}


def on_floor(
    shape: Shape, mass: float = 1.0, velocity=(0.0,) * 6, timestep: float = 1e-3, gravity: float = G, **law: object
) -> World:
    """A body that touches a floor, both of one material with this law."""
    floor = Shape("floor_0", "box", (40.0, 40.0, 0.4), Pose((0.0, 0.0, -0.2)), "m")
    tensor = (0.004 * mass, 0.004 * mass, 0.004 * mass, 0.0, 0.0, 0.0)
    joint = Joint("body_joint", "free", position=(0, 0, HEIGHT[shape.kind], 1.0, 0, 0, 0), velocity=tuple(velocity))
    bodies = (
        Body("floor", "floor", Inertial(0.0), Joint("floor_joint", "fixed"), (floor,)),
        Body("body", "body", Inertial(mass, inertia=tensor), joint, (shape,)),
    )
    pair = PairContact("m", "m", **({"friction": 0.0, "restitution": 0.0} | law))
    contact = Contact(materials=(Material("m"),), pairs=(pair,))
    return World("on-floor", bodies, contact, Physics((0.0, 0.0, -gravity), timestep, 1))


@pytest.fixture
def load(load_files):
    """A function that emits and loads a world, whatever the engine accepts of it."""
    return lambda world: load_files(MuJoCo, emit(world))


# --- sliding ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("friction", "tolerance"), [(0.05, 1e-3), (0.2, 1e-3), (0.5, 1e-3), (1.0, 0.03)])
@pytest.mark.parametrize("degrees", [0.0, 22.5, 45.0, 105.0])
def test_pushed_friction_is_the_laws(friction, tolerance, degrees, load):
    """0.2 s at 1.6 times the limit, from rest: no hop and no direction shows. Without a cushion μ = 0.5 is 1 % off."""
    engine = load(on_floor(BOX, friction=friction))
    engine.step(50)
    push = 1.6 * friction * G * np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    _, before = engine.get_state()
    engine.step(200, np.array([*push, 0.0, 0.0, 0.0, 0.0]))
    _, after = engine.get_state()
    force = push - (after[:2] - before[:2]) / 0.2
    np.testing.assert_allclose(force, push / 1.6, atol=tolerance * friction * G)


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_slider_at_a_metre_per_second_never_leaves_the_floor(friction, load):
    engine = load(on_floor(BOX, friction=friction, velocity=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    for _ in range(int(1000.0 / (friction * G)) + 50):
        engine.step(1)
        assert -1e-4 <= engine.get_state()[0][2] - HEIGHT["box"] <= 0.0


@pytest.mark.parametrize("friction", [0.05, 0.2, 0.5, 1.0])
def test_stop_distance_is_the_laws(friction, load):
    speed = min(2.0, 250 * friction * G * 1e-3)
    engine = load(on_floor(BOX, friction=friction, velocity=(speed, 0.0, 0.0, 0.0, 0.0, 0.0)))
    engine.step(600)
    want = speed**2 / (2 * friction * G) - speed * 1e-3 / 2
    assert engine.get_state()[0][0] == pytest.approx(want, rel=0.015)


def test_below_the_limit_it_creeps_as_little_as_declared(load):
    engine = load(on_floor(BOX, friction=0.5))
    engine.step(1000, np.array([0.6 * 0.5 * G, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert abs(engine.get_state()[1][0]) < 2e-6


@pytest.mark.parametrize("shape", [BALL, BOX], ids=["ball", "box"])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_rest_depth_is_below_a_tenth_of_a_millimetre(shape, friction, load):
    engine = load(on_floor(shape, mass=10.0, friction=friction))
    engine.step(1000)
    depth = HEIGHT[shape.kind] - engine.get_state()[0][2]
    assert 0.0 < depth < (1e-4 if friction else 1.1e-6)


# --- moments of friction ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [0.001, 0.01])
def test_torsional_friction_is_a_length_times_the_normal_force(length, load):
    slowing = length * G / 0.004
    engine = load(on_floor(BALL, friction=0.5, torsional_friction=length, velocity=(0, 0, 0, 0, 0, slowing)))
    engine.step(100)
    start = engine.get_state()[1][5]
    engine.step(500)
    assert (start - engine.get_state()[1][5]) / 0.5 == pytest.approx(slowing, rel=1e-3)


@pytest.mark.parametrize("length", [0.001, 0.005])
def test_rolling_friction_is_a_length_times_the_normal_force(length, load):
    slowing = 5.0 / 7.0 * G * length / 0.1
    engine = load(on_floor(BALL, friction=0.5, rolling_friction=length, velocity=(slowing, 0, 0, 0, slowing / 0.1, 0)))
    engine.step(100)
    start = engine.get_state()[1][0]
    engine.step(500)
    assert (start - engine.get_state()[1][0]) / 0.5 == pytest.approx(slowing, rel=2e-3)
    engine.step(1400)
    assert abs(engine.get_state()[1][0]) < 1e-3 * slowing


def test_slip_and_spin_share_a_cone_as_declared(load):
    engine = load(on_floor(BALL, friction=0.5, torsional_friction=0.01, velocity=(1.0, 0, 0, 0, 0, 50.0)))
    engine.step(5)
    _, start = engine.get_state()
    engine.step(20)
    _, end = engine.get_state()
    slip, spin = (start[0] - end[0]) / (0.02 * 0.5 * G), (start[5] - end[5]) / (0.02 * 0.01 * G / 0.004)
    assert 0.4 < slip < 0.7
    assert 0.6 < spin < 0.9


# --- hardness -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("mass", [1.0, 10.0])
@pytest.mark.parametrize(("shape", "points"), [(BALL, 1), (BOX, 4)], ids=["ball", "box"])
def test_on_a_stiffness_each_point_bears_k_times_its_depth(shape, points, mass, friction, load):
    spring = Hardness("stiffness", stiffness=2e4, damping=80.0)
    engine = load(on_floor(shape, mass=mass, friction=friction, hardness=spring))
    engine.step(4000)
    depth = HEIGHT[shape.kind] - engine.get_state()[0][2]
    assert depth == pytest.approx(mass * G / (2e4 * points), rel=1e-5)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("mass", [1.0, 10.0])
def test_the_depth_of_a_ball_on_a_time_constant_is_independent_of_its_mass(mass, friction, load):
    spring = Hardness("time-constant", time_constant=0.02, damping_ratio=0.5)
    engine = load(on_floor(BALL, mass=mass, friction=friction, hardness=spring))
    engine.step(1000)
    depth = HEIGHT["sphere"] - engine.get_state()[0][2]
    assert depth == pytest.approx(G * 0.02**2 * 0.5**2, rel=2e-4)


SPRINGS = {
    "time-constant": (
        Hardness("time-constant", time_constant=0.03, damping_ratio=0.3),
        1 / (0.03 * 0.3) ** 2,
        2 / 0.03,
    ),
    "stiffness": (Hardness("stiffness", stiffness=3e4, damping=60.0), 3e4 / 2.0, 60.0 / 2.0),
}
"""Each with k/m and c/m for a body of 2 kg."""


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("kind", SPRINGS)
def test_compliant_contact_is_a_damped_oscillator_that_never_pulls(kind, friction, load):
    """Step by step against the semi-implicit steps of r̈ = max(0, −k r − c v) − g: sinking in, rebounding, flying."""
    hardness, stiffness, damping = SPRINGS[kind]
    engine = load(on_floor(BALL, mass=2.0, friction=friction, hardness=hardness, velocity=(0, 0, -1.0, 0, 0, 0)))
    gap, speed, left = 0.0, -1.0, False
    for _ in range(400):
        push = max(0.0, -stiffness * gap - damping * speed) if gap < 0.0 else 0.0
        speed += 1e-3 * (push - G)
        gap += 1e-3 * speed
        left = left or gap > 1e-3
        engine.step(1)
        assert engine.get_state()[0][2] - HEIGHT["sphere"] == pytest.approx(gap, abs=2e-5)
    assert left


@pytest.mark.parametrize("kind", SPRINGS)
def test_friction_on_springs_is_as_good_as_on_a_rigid_floor(kind, load):
    hardness = SPRINGS[kind][0]
    engine = load(on_floor(BOX, mass=2.0, friction=0.5, hardness=hardness))
    engine.step(500)
    start, _ = engine.get_state()
    engine.step(500, np.array([0.6 * 0.5 * 2.0 * G, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert abs(engine.get_state()[1][0]) < 1e-5
    _, before = engine.get_state()
    engine.step(100, np.array([1.6 * 0.5 * 2.0 * G, 0.0, 0.0, 0.0, 0.0, 0.0]))
    _, after = engine.get_state()
    assert 1.6 * 0.5 * G - (after[0] - before[0]) / 0.1 == pytest.approx(0.5 * G, rel=5e-3)
    assert start[2] < HEIGHT["box"]


def test_native_contact_has_the_defaults_of_mujoco(load):
    """A ball rests where MuJoCo's defaults put it: d k r = (1 − d) g with d = 0.9 and more, k of 20 ms."""
    engine = load(on_floor(BALL, friction=0.5, hardness=Hardness("native")))
    engine.step(2000)
    assert HEIGHT["sphere"] - engine.get_state()[0][2] == pytest.approx(3.67e-4, rel=0.01)


# --- what passes --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("lower", ["m", "ghost"])
def test_of_a_bodys_shapes_only_those_collide_that_may(lower, friction, load):
    """A dumbbell of a ball that touches the floor and one that does not stands on the one that does."""
    upper = "ghost" if lower == "m" else "m"
    world = on_floor(BALL, friction=friction)
    balls = (
        Shape("low", "sphere", (0.1,), Pose(), lower),
        Shape("high", "sphere", (0.1,), Pose((0.0, 0.0, 0.3)), upper),
    )
    pairs = (
        PairContact("ghost", "ghost", 0.0, 0.0),
        PairContact("ghost", "m", 0.0, 0.0, collide=False),
        PairContact("m", "m", friction, 0.0),
    )
    bodies = (world.bodies[0], dataclasses.replace(world.bodies[1], shapes=balls))
    contact = Contact(materials=(Material("ghost"), Material("m")), pairs=pairs)
    engine = load(dataclasses.replace(world, bodies=bodies, contact=contact))
    engine.step(1000)
    assert engine.get_state()[0][2] == pytest.approx(0.1 if lower == "m" else -0.2, abs=2e-4)


# --- declared deviations ------------------------------------------------------------------------------------------


def test_a_deviation_counts_only_where_it_was_measured():
    def sizes(probe: str, timestep: float, cone: str = "elliptic", mode: str = "native", **law: object) -> list[float]:
        pair = PairContact("m", "m", **({"friction": 0.5, "restitution": 0.0} | law))
        settings = {"friction": mode}
        return [d.size for d in CONTACT_DEVIATIONS if d.probe == probe and d.counts_for(pair, cone, timestep, settings)]

    for probe in ("push", "stop", "stick", "restitution", "torsional", "rolling", "compliance", "rest", "size"):
        assert sizes(probe, 1e-3) == []
    assert min(sizes("push", 1e-3, friction=1.0)) == 0.03
    assert max(sizes("push", 1e-3, friction=1.0)) < 0.05
    assert sizes("push", 1e-3, mode="coulomb", friction=1.0) == []
    assert max(sizes("push", 4e-3)) < 0.16
    assert sizes("push", 1e-3, restitution=0.5)
    assert sizes("push", 1e-3, hardness=Hardness("native"))
    assert sizes("push", 1e-3, cone="pyramid-inscribed")
    assert sizes("overlap", 1e-3, friction=0.0) == []


def rest_allowed(timestep: float) -> float:
    """The depth (m) that is declared of a pair without restitution, in addition to the promised 0.1 mm."""
    settings = {"friction": "native"}
    pair = PairContact("m", "m", 0.0, 0.0)
    return max(
        (
            d.size
            for d in CONTACT_DEVIATIONS
            if d.probe == "rest" and d.counts_for(pair, "elliptic", timestep, settings)
        ),
        default=0.0,
    )


@pytest.mark.parametrize("timestep", [0.0102, 0.013, 0.016, 0.02, 0.03])
def test_resting_bodies_at_long_timesteps_have_the_declared_depth(timestep, load):
    """g dt² (1 − d) / (d β) deep, which passes the 0.1 mm that is promised at 10.1 ms."""
    engine = load(on_floor(BALL, timestep=timestep))
    engine.step(1000)
    depth = HEIGHT["sphere"] - engine.get_state()[0][2]
    law = G * timestep**2 * 0.001 / (0.999 * 0.01)
    assert depth == pytest.approx(law, rel=5e-3)
    assert 1.0 < rest_allowed(timestep) / law < 1.9


def test_nothing_is_declared_where_the_promise_holds():
    assert rest_allowed(0.0099) == 0.0
