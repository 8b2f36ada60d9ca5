"""The oracle against laws that hold for every tree, and textbook formulas; no engine and no file takes part."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.world import frames
from simspec.world.kinematics import initial_state, layout_of, poses
from simspec.world.rotations import logarithm
from simspec.world.types import Body, Inertial, Joint, Physics, Pose, World
from tests import worlds

ROUND_OFF = 1e-12
"""Relative; sums of some tens of products of numbers near 1 (measured: below 1e-14)."""


def branching() -> World:
    """Bodies whose order is not depth first: two trees and their branches, interleaved."""
    bodies = worlds.tree(["free", "hinge", "hinge", "ball", "slide", "hinge", "hinge"], 15, [-1, 0, 0, 1, 2, 3, 4])
    other = worlds.tree(["fixed", "ball", "hinge", "slide"], 16, [-1, 0, 0, 1], prefix="other_")
    mixed = [body for pair in zip(bodies, (*other, None, None, None), strict=True) for body in pair if body is not None]
    return worlds.world(tuple(mixed), "branching")


def skew_gravity() -> World:
    return dataclasses.replace(worlds.every_joint(), physics=Physics((1.0, -2.0, 3.0), 0.001, 1))


TREES = {
    "every joint": worlds.every_joint,
    "springs": lambda: worlds.every_joint(spring_stiffness=2.0),
    "armature": lambda: worlds.world(worlds.tree(["hinge", "slide", "hinge"], 9, armature=0.3)),
    "branching": branching,
    "skew gravity": skew_gravity,
}


def advance(world: World, q: np.ndarray, v: np.ndarray, dt: float) -> np.ndarray:
    """q ⊕ dt v, written out with plain quaternions."""
    found, places = q.copy(), layout_of(world)
    for body, at_q, at_v in zip(world.bodies, places.position, places.velocity, strict=True):
        kind = body.joint.kind
        if kind in ("hinge", "slide"):
            found[at_q] += dt * v[at_v]
        elif kind in ("ball", "free"):
            turn = v[at_v][-3:] * dt
            angle = float(np.linalg.norm(turn))
            axis = tuple(turn / angle) if angle else (1.0, 0.0, 0.0)
            step = (math.cos(angle / 2), *(math.sin(angle / 2) * x for x in axis))
            found[at_q.stop - 4 : at_q.stop] = frames.multiply(tuple(q[at_q][-4:]), step)
            if kind == "free":
                found[at_q.start : at_q.start + 3] += dt * v[at_v][:3]
    return found


def kinetic_energy(world: World, oracle: Oracle, q: np.ndarray, v: np.ndarray) -> float:
    """½ m u² + ½ ω·Iω over all bodies, and ½ A v² for armature: from velocities, not from M."""
    total = 0.0
    for body, pose, velocity, at_v in zip(
        world.bodies, oracle.body_poses(q), oracle.body_velocities(q, v), layout_of(world).velocity, strict=True
    ):
        turn = np.array(frames.matrix(tuple(pose[3:])))
        xx, yy, zz, xy, xz, yz = body.inertial.inertia
        tensor = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        spin = velocity[3:]
        centre = velocity[:3] + np.cross(spin, turn @ np.array(body.inertial.centre_of_mass))
        total += 0.5 * body.inertial.mass * float(centre @ centre) + 0.5 * float(spin @ tensor @ spin)
        total += 0.5 * body.joint.armature * float(np.sum(v[at_v] ** 2))
    return total


def potential_energy(world: World, oracle: Oracle, q: np.ndarray) -> float:
    """−Σ m g·c of the bodies that move, and of springs ½ k (q − rest)², ½ k angle²."""
    total = 0.0
    for body, pose, at_q in zip(world.bodies, oracle.body_poses(q), layout_of(world).position, strict=True):
        centre = pose[:3] + frames.rotate(tuple(pose[3:]), body.inertial.centre_of_mass)
        if body.joint.kind != "fixed" or body.joint.parent is not None:
            total -= body.inertial.mass * float(np.array(world.physics.gravity) @ centre)
        stiffness = body.joint.spring_stiffness
        if stiffness and body.joint.kind == "ball":
            total += 0.5 * stiffness * (2.0 * math.atan2(np.linalg.norm(q[at_q][1:]), abs(q[at_q][0]))) ** 2
        elif stiffness:
            total += 0.5 * stiffness * (q[at_q][0] - body.joint.spring_rest) ** 2
    return total


def random_state(world: World, seed: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    q, v = initial_state(world)
    return advance(world, q, generator.normal(size=len(v)), 1.0), generator.normal(size=len(v))


@pytest.mark.parametrize("name", TREES)
def test_poses_equal_those_of_the_kinematics_of_the_world(name):
    world = TREES[name]()
    q, _ = initial_state(world)
    for found, expected in zip(Oracle(world).body_poses(q), poses(world).values(), strict=True):
        assert found[:3] == pytest.approx(expected.position, abs=1e-14)
        assert abs(float(np.dot(found[3:], expected.quaternion))) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("name", TREES)
def test_velocities_are_how_poses_change(name):
    world = TREES[name]()
    oracle = Oracle(world)
    q, v = random_state(world, 1)
    h = 1e-5
    before, after = (oracle.body_poses(advance(world, q, v, sign * h)) for sign in (-1.0, 1.0))
    velocities = oracle.body_velocities(q, v)
    # central differences: error h² times a third derivative of up to 1e2, and round-off 1e-16 / h
    assert velocities[:, :3] == pytest.approx((after[:, :3] - before[:, :3]) / (2 * h), abs=1e-7)
    for entry, other, velocity in zip(before, after, velocities, strict=True):
        turn = frames.multiply(tuple(other[3:]), frames.conjugate(tuple(entry[3:])))
        assert velocity[3:] == pytest.approx(logarithm(np.array(turn)) / (2 * h), abs=1e-7)


@pytest.mark.parametrize("name", TREES)
@pytest.mark.parametrize("seed", [2, 3])
def test_the_mass_matrix_gives_the_bodies_kinetic_energy(name, seed):
    world = TREES[name]()
    oracle = Oracle(world)
    q, v = random_state(world, seed)
    mass = oracle.mass_matrix(q)
    assert mass == pytest.approx(mass.T, abs=1e-15)
    assert 0.5 * v @ mass @ v == pytest.approx(kinetic_energy(world, oracle, q, v), rel=ROUND_OFF)
    kinetic, potential = oracle.energy(q, v)
    assert kinetic == pytest.approx(kinetic_energy(world, oracle, q, v), rel=ROUND_OFF)
    assert potential == pytest.approx(potential_energy(world, oracle, q), rel=ROUND_OFF, abs=1e-12)


@pytest.mark.parametrize("name", TREES)
@pytest.mark.parametrize("seed", [4, 5])
def test_energy_changes_by_the_power_of_the_effort(name, seed):
    """d(T + V)/dt = τ·v along the oracle's acceleration, from energies that do not use the bias force."""
    world = TREES[name]()
    oracle = Oracle(world)
    q, v = random_state(world, seed)
    effort = np.random.default_rng(seed).normal(size=oracle.nv)
    acceleration = oracle.acceleration(q, v, effort)

    def total(h: float) -> float:
        at_q, at_v = advance(world, q, v, h), v + h * acceleration
        return kinetic_energy(world, oracle, at_q, at_v) + potential_energy(world, oracle, at_q)

    h = 1e-5
    power = (total(h) - total(-h)) / (2 * h)
    # round-off of energies near 1e2 J over 2e-5 s, and h² times third derivatives
    assert power == pytest.approx(float(effort @ v), abs=2e-7 * max(1.0, float(np.abs(acceleration).max())))


@pytest.mark.parametrize("name", TREES)
def test_the_equation_of_motion_holds(name):
    """M a + h = τ + damping and springs: CRBA and RNEA against ABA, which share no recursion."""
    world = TREES[name]()
    oracle = Oracle(world)
    q, v = random_state(world, 6)
    effort = np.linspace(-1.0, 1.0, oracle.nv)
    left = oracle.mass_matrix(q) @ oracle.acceleration(q, v, effort) + oracle.bias_force(q, v)
    assert left == pytest.approx(effort + oracle.joint_effort(q, v), abs=1e-10)


def test_a_step_is_semi_implicit_euler():
    world = worlds.every_joint(damping=0.2, spring_stiffness=1.0)
    oracle = Oracle(world)
    q, v = random_state(world, 7)
    effort = np.linspace(-1.0, 1.0, oracle.nv)
    new_q, new_v = oracle.step(q, v, effort)
    assert new_v == pytest.approx(v + 0.001 * oracle.acceleration(q, v, effort), abs=1e-15)
    moved = advance(world, q, new_v, 0.001)
    for body, at in zip(world.bodies, oracle.layout.position, strict=True):
        turned = body.joint.kind in ("ball", "free")
        sign = np.sign(moved[at][-4:] @ new_q[at][-4:]) if turned else 1.0
        signs = np.array([1.0] * (len(new_q[at]) - 4) + [sign] * 4) if turned else 1.0
        assert new_q[at] * signs == pytest.approx(moved[at], abs=1e-14)


def test_motion_is_made_of_steps():
    """Trees are integrated separately; their states land in the world's order, every so many steps and at the end."""
    world = branching()
    oracle = Oracle(world)
    q, v = random_state(world, 8)
    effort = np.linspace(-1.0, 1.0, oracle.nv)
    states, speeds = oracle.motion(q, v, effort, 10, 4)
    rows = {0: 0, 4: 1, 8: 2, 10: 3}
    assert len(states) == len(speeds) == len(rows)
    for step in range(11):
        if step in rows:
            np.testing.assert_array_equal(states[rows[step]], q)
            np.testing.assert_array_equal(speeds[rows[step]], v)
        q, v = oracle.step(q, v, effort)


def test_a_spring_swings_at_the_discrete_frequency():
    """Semi-implicit Euler of ẍ = −ω² (x − rest) is x = rest + A cos nφ + B sin nφ with cos φ = 1 − ω² dt² / 2, exactly."""
    mass, stiffness, rest, first, dt = 2.0, 300.0, 0.2, 0.15, 0.004
    joint = Joint("j", "slide", axis=(0.6, 0.0, 0.8), spring_stiffness=stiffness, spring_rest=rest)
    world = World("spring", (Body("b", "b", Inertial(mass), joint),), physics=Physics((0.0, 0.0, 0.0), dt, 1))
    states, _ = Oracle(world).motion(np.array([rest + first]), np.zeros(1), np.zeros(1), 2000, 1)
    phi = math.acos(1.0 - stiffness / mass * dt * dt / 2.0)
    # v0 = 0 makes x1 = x0 (1 − ω² dt²) = x0 (2 cos φ − 1), which fixes B
    along = first * (math.cos(phi) - 1.0) / math.sin(phi)
    n = np.arange(2001)
    assert states[:, 0] - rest == pytest.approx(first * np.cos(n * phi) + along * np.sin(n * phi), abs=1e-10)


def test_a_ball_in_a_plane_is_a_hinge():
    inertial = Inertial(1.5, (0.0, 0.0, -0.7), (0.03, 0.02, 0.01, 0.0, 0.0, 0.0))
    more = {"damping": 0.3, "spring_stiffness": 2.0}
    hinge, ball = (
        Oracle(worlds.world((Body("b", "b", inertial, Joint("j", kind, axis=axis, **more)),)))
        for kind, axis in (("hinge", (0.0, 1.0, 0.0)), ("ball", (0.0, 0.0, 0.0)))
    )
    turn = np.array([math.cos(0.4), 0.0, math.sin(0.4), 0.0])
    angles, rates = hinge.motion(np.array([0.8]), np.array([1.2]), np.array([0.1]), 2000, 2000)
    turns, spins = ball.motion(turn, np.array([0.0, 1.2, 0.0]), np.array([0.0, 0.1, 0.0]), 2000, 2000)
    assert logarithm(turns[-1]) == pytest.approx([0.0, angles[-1][0], 0.0], abs=1e-11)
    assert spins[-1] == pytest.approx([0.0, rates[-1][0], 0.0], abs=1e-11)


def test_two_links_in_a_plane_have_the_textbook_mass_matrix():
    """M11 = I1 + I2 + m1 c1² + m2 (l² + c2² + 2 l c2 cos θ2), M12 = I2 + m2 (c2² + l c2 cos θ2), M22 = I2 + m2 c2²."""
    (m1, c1, i1), (m2, c2, i2), length = (1.3, 0.2, 0.01), (0.8, 0.25, 0.02), 0.5
    z = (0.0, 0.0, 1.0)
    inertial = Inertial(m1, (c1, 0.0, 0.0), (0.01, 0.01, i1, 0.0, 0.0, 0.0))
    two = Inertial(m2, (c2, 0.0, 0.0), (0.02, 0.02, i2, 0.0, 0.0, 0.0))
    bodies = (
        Body("one", "one", inertial, Joint("a", "hinge", None, axis=z)),
        Body("two", "one", two, Joint("b", "hinge", "one", Pose((length, 0.0, 0.0)), z, armature=0.07)),
    )
    q, v = np.array([0.4, 0.9]), np.array([1.1, -0.6])
    coupling = length * c2 * math.cos(q[1])
    expected = [
        [i1 + i2 + m1 * c1**2 + m2 * (length**2 + c2**2 + 2 * coupling), i2 + m2 * (c2**2 + coupling)],
        [i2 + m2 * (c2**2 + coupling), i2 + m2 * c2**2 + 0.07],
    ]
    oracle = Oracle(worlds.world(bodies, physics=Physics((0.0, 0.0, 0.0), 0.001, 1)))
    assert oracle.mass_matrix(q) == pytest.approx(np.array(expected), rel=ROUND_OFF)
    # Coriolis: h1 = −m2 l c2 sin θ2 (2 v1 v2 + v2²), h2 = m2 l c2 sin θ2 v1²
    strength = m2 * length * c2 * math.sin(q[1])
    wanted = [-strength * (2 * v[0] * v[1] + v[1] ** 2), strength * v[0] ** 2]
    assert oracle.bias_force(q, v) == pytest.approx(wanted, rel=ROUND_OFF)


def test_a_world_without_moving_bodies():
    world = worlds.world(worlds.tree(["fixed", "fixed"], 3))
    oracle = Oracle(world)
    q, v = np.zeros(0), np.zeros(0)
    assert oracle.mass_matrix(q).shape == (0, 0)
    assert oracle.bias_force(q, v).shape == (0,)
    assert oracle.motion(q, v, None, 5, 2)[0].shape == (4, 0)
    assert oracle.energy(q, v) == (0.0, 0.0)
    assert len(oracle.body_poses(q)) == 2


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.0])
def test_rotation_vector(angle):
    axis = np.array([0.6, 0.0, -0.8])
    turn = np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
    for sign in (1.0, -1.0):
        assert logarithm(sign * turn) == pytest.approx(angle * axis, rel=1e-12, abs=1e-300)
