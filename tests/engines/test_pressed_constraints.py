"""Constraints that simspec computes outside an engine, in contact: their compliance, and their acceptance by name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.kit.registry import find_engine
from simspec.errors import UnsupportedError
from simspec.proof.building import fixed, single_material
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.testing import worlds
from simspec.world.types import Body, FollowConstraint, Inertial, Joint, Physics, Pose, Shape, World

LEADING, FOLLOWING, EFFORT = 2.0, 0.5, 20.0
"""Masses (kg), and the effort (N) on the leader."""


def pressed(timestep: float = 1e-3) -> World:
    """Two slides along x: the follower reaches a wall after 1 mm."""
    inertia = (0.01, 0.01, 0.01, 0.0, 0.0, 0.0)

    def slide(name: str, mass: float, y: float, *shapes: Shape) -> Body:
        joint = Joint(
            f"{name}_joint", "slide", None, Pose((0.0, y, 0.0)), (1.0, 0.0, 0.0), position=(0.0,), velocity=(0.0,)
        )
        return Body(name, name, Inertial(mass, (0.0, 0.0, 0.0), inertia), joint, shapes)

    wall = fixed("wall", Shape("wall_0", "box", (0.2, 1.0, 1.0), material="steel"), origin=Pose((0.201, 0.0, 0.0)))
    ball = Shape("ball_0", "sphere", (0.1,), material="steel")
    return World(
        "pressed",
        (wall, slide("leader", LEADING, 2.0), slide("follower", FOLLOWING, 0.0, ball)),
        contact=single_material("steel", 0.0),
        physics=Physics(timestep=timestep, steps=100, gravity=(0.0, 0.0, 0.0)),
        constraints=(FollowConstraint("gear", "follower_joint", "leader_joint", 1.0),),
    )


ENGINES = ("dart", "drake", "ode", "physx")


@pytest.mark.parametrize("timestep", [1e-3, 4e-3])
@pytest.mark.parametrize("name", ENGINES)
def test_a_coupling_yields_in_contact_by_its_compliance(name, timestep, loaded):
    """At rest the coupling carries the whole effort, and the wall bears it. The forces follow from the motion without the wall,
    in which the leader alone has the effort: −F dt/m₁ + φ/dt = −F dt (1/m₁ + 1/m₂), so that φ = −F dt²/m₂."""
    if find_engine(name).version() is None:
        pytest.skip(f"{name} is not installed")
    engine = loaded(pressed(timestep))
    engine.step(300, np.array([EFFORT, 0.0]))
    (leader, follower), v = engine.get_state()
    assert follower - leader == pytest.approx(-EFFORT * timestep**2 / FOLLOWING, rel=0.01, abs=2e-7)
    assert v == pytest.approx(0.0, abs=1e-4)  # the overlap of the impact is corrected slowly
    assert engine.contacts()["normal_force"].sum() == pytest.approx(EFFORT, rel=0.01)


@pytest.mark.parametrize("name", ENGINES)
def test_it_is_accepted_by_name(name):
    world, support = pressed(), find_engine(name).SUPPORT[Feature.CONSTRAINT_COUPLING]
    assert support.in_world(world).level is Level.APPROXIMATE
    with pytest.raises(UnsupportedError, match=r"accept: \[constraint.coupling\]"):
        compile_world(worlds.with_options(world, name, outside=("constraint.coupling",)), [name])
    without = dataclasses.replace(world.contact, excluded_bodies=(("follower", "wall"),))
    assert support.in_world(dataclasses.replace(world, contact=without)).level is Level.OUTSIDE
