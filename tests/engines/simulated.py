"""Common parts of the tests of engines with a simulation: worlds, states, and tests that all must pass."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from simspec.world.kinematics import initial_state, layout_of
from simspec.world.types import Body, Inertial, Joint, Physics
from tests import worlds


def random_tree(seed):
    generator = random.Random(seed)
    kinds = [("fixed", "free", "ball", "hinge")[seed % 4]]
    kinds += [generator.choice(("hinge", "slide", "ball", "fixed")) for _ in range(6)]
    return worlds.world(worlds.tree(kinds, seed, [-1] + [generator.randrange(i) for i in range(1, 7)]))


MOVING = {
    "every-joint": worlds.every_joint,
    "damped": lambda: worlds.every_joint(damping=0.2),
    "damped-springs": worlds.damped_springs,
    "free-springs": lambda: worlds.world(worlds.tree(["free", "hinge", "ball"], 3, damping=0.1, spring_stiffness=2.0)),
    "three-trees": lambda: worlds.world(
        worlds.tree(["free", "hinge", "slide"], 5, prefix="a")
        + worlds.tree(["fixed", "hinge", "ball"], 6, prefix="b")
        + worlds.tree(["ball", "hinge"], 7, prefix="c")
    ),
    **{f"random-{seed}": lambda seed=seed: random_tree(seed) for seed in range(20, 24)},
}
"""Worlds that move without contact, in every such engine."""


def random_state(world, generator):
    q, _ = initial_state(world)
    places = layout_of(world)
    for body, place in zip(world.bodies, places.position, strict=True):
        if body.joint.kind in ("hinge", "slide"):
            q[place] = generator.uniform(-1.0, 1.0)
        elif body.joint.kind in ("ball", "free"):
            turn = generator.normal(size=4)
            q[place.stop - 4 : place.stop] = turn / np.linalg.norm(turn) * np.sign(turn[0])
    return q, generator.normal(size=places.nv)


def slider(**more):
    joint = Joint("j", "slide", None, axis=(1.0, 0.0, 0.0), **{"position": (0.0,), "velocity": (1.0,), **more})
    body = Body("a", "a", Inertial(2.0, inertia=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0)), joint)
    return worlds.world((body,), physics=Physics((0.0, 0.0, 0.0), 0.001, 1000))


def assert_same_dynamics(engine, oracle, q, v, tolerance):
    """Mass matrix and bias force at a state are the oracle's, relative to the largest entry."""
    engine.set_state(q, v)
    for found, wanted in (
        (engine.mass_matrix(), oracle.mass_matrix(q)),
        (engine.bias_force(), oracle.bias_force(q, v)),
    ):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * np.abs(wanted).max())


class SimulatedEngineTests:
    """Tests of one engine; the fixture ``load`` emits a world and loads it."""

    def test_a_state_set_again_gives_the_same_bits(self, load):
        engine = load(worlds.spheres(27))
        q, v = engine.get_state()
        engine.step(700)
        assert len(engine.contacts()["distance"]) > 5
        first = engine.get_state()
        engine.set_state(q, v)
        engine.step(700)
        again = engine.get_state()
        np.testing.assert_array_equal(first[0], again[0])
        np.testing.assert_array_equal(first[1], again[1])

    def test_an_effort_acts_over_all_steps_of_a_call_and_then_ends(self, load):
        engine = load(slider(velocity=(0.0,)))
        engine.step(50, np.array([3.0]))
        assert engine.get_state()[1][0] == pytest.approx(0.05 * 3.0 / 2.0, rel=1e-12)
        engine.step(50)
        assert engine.get_state()[1][0] == pytest.approx(0.05 * 3.0 / 2.0, rel=1e-12)

    def test_several_simulations_live_side_by_side(self, load):
        first, second = load(slider()), load(slider(velocity=(5.0,)))
        second.step(10)
        assert first.get_state()[0][0] == 0.0
        first.mass_matrix()
        first.close()
        assert second.get_state()[0][0] == pytest.approx(0.05)
        with pytest.raises(RuntimeError):
            first.get_state()

    def test_an_empty_world_runs(self, load):
        engine = load(worlds.world(()))
        engine.step(3, np.zeros(0))
        assert engine.read_back().bodies == ()
        assert engine.mass_matrix().shape == (0, 0)
        assert engine.body_states()[0].shape == (0, 7)

    def test_offsets_are_those_of_the_centre_of_mass(self, load):
        """A free body turning about its centre of mass: the origin of its frame circles at lever × rate."""
        body = Body(
            "a",
            "a",
            Inertial(1.0, (0.5, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)),
            Joint("j", "free", position=(0.0,) * 3 + (1.0,) + (0.0,) * 3, velocity=(0.0, -1.0, 0.0, 0.0, 0.0, 2.0)),
        )
        engine = load(worlds.world((body,), physics=Physics((0.0, 0.0, 0.0), 0.001, 1000)))
        engine.step(1000)
        pose, velocity = (rows[0] for rows in engine.body_states())
        np.testing.assert_allclose(pose[:3], [0.5 - 0.5 * math.cos(2.0), -0.5 * math.sin(2.0), 0.0], atol=1e-12)
        np.testing.assert_allclose(velocity[:3], [math.sin(2.0), -math.cos(2.0), 0.0], atol=1e-12)
