"""The oracle against Simbody, a second and independent implementation of multibody dynamics: the same world, in both, must
have the same poses, M, bias forces, energies, accelerations and motion, to round-off. ``tools/second_oracle.py`` does so for
hundreds of worlds."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest

import simspec
from simspec.proof.selftest_worlds import WORLDS
from simspec.world import frames
from simspec.world.types import Physics, Pose
from tests import worlds
from tests.dynamics.agreement import QUANTITIES, deviations, random_tree
from tests.dynamics.simbody_model import MISSING

pytestmark = pytest.mark.skipif(MISSING is not None, reason=MISSING or "")

SPECS = Path(__file__).resolve().parents[2] / "specs"
ROUND_OFF = 1e-12
"""The largest of 510 worlds is 2.5e-13 (docs/records/proof-figures.md)."""
CONSTRAINED_MOTION = 1e-11
"""Of motion with constraints: the round-off of φ, 1e-16 m, is 1e-13 m/s at 1 ms (measured here: 8e-13)."""

SHIPPED = {
    "every joint": worlds.every_joint,
    "lifted": worlds.lifted,
    "immersed": worlds.immersed,
    "springs": worlds.damped_springs,
    "weightless": worlds.weightless,
    "point mass": worlds.point_mass,
    "tool frame": worlds.tool_frame,
    "several joints": worlds.several_joints,
    "armature": lambda: worlds.limits_and_armature(0.3),
    "skew gravity": lambda: dataclasses.replace(worlds.every_joint(), physics=Physics((1.0, -2.0, 3.0), 0.001, 1)),
    **{name: lambda name=name: WORLDS[name]("mujoco") for name in ("ball armature", "free armature", "held", "sums")},
}
"""Every word of the language that moves something without contact."""


def agree(world, states=2, steps=20):
    found = deviations(world, states, steps)
    assert set(found) == set(QUANTITIES) - (set() if world.constraints else {"constraints"})
    allowed = dict.fromkeys(found, ROUND_OFF) | ({"motion": CONSTRAINED_MOTION} if world.constraints else {})
    assert {name: share for name, share in found.items() if not share < allowed[name]} == {}


@pytest.mark.parametrize("name", SHIPPED)
def test_worlds_of_every_word(name):
    agree(SHIPPED[name]())


@pytest.mark.parametrize("seed", range(12))
def test_random_trees_of_every_joint(seed):
    agree(random_tree(seed))


LIBRARY = (
    "ball-pendulum",
    "double-pendulum",
    "spring-damper",
    "tumbling-body",
    "gripper",
    "ur10e-hand",
    "four-bar-push",
)


@pytest.mark.parametrize("name", LIBRARY)
def test_the_library(name):
    agree(simspec.load(SPECS / f"{name}.yaml").resolve())


LITTLE = 1e-10


def changed(world, kind, part, change):
    """The world with one body's joint or inertia changed: the last one with a joint of this kind."""
    index = max(index for index, body in enumerate(world.bodies) if body.joint.kind == kind)
    body = world.bodies[index]
    body = dataclasses.replace(body, **{part: dataclasses.replace(getattr(body, part), **change(getattr(body, part)))})
    return dataclasses.replace(world, bodies=(*world.bodies[:index], body, *world.bodies[index + 1 :]))


def shifted(place):
    return (place[0] + LITTLE, *place[1:])


def tilted(axis):
    x, y, _ = axis
    return frames.rotate(frames.from_axis_angle((y / math.hypot(x, y), -x / math.hypot(x, y), 0.0), LITTLE), axis)


CHANGES = {
    "mass": ("fixed", "inertial", lambda local: {"mass": local.mass * (1 + LITTLE)}),
    "centre of mass": ("ball", "inertial", lambda local: {"centre_of_mass": shifted(local.centre_of_mass)}),
    "product of inertia": (
        "fixed",
        "inertial",
        lambda local: {"inertia": (*local.inertia[:5], local.inertia[5] + LITTLE)},
    ),
    "origin": (
        "hinge",
        "joint",
        lambda local: {"origin": Pose(shifted(local.origin.position), local.origin.quaternion)},
    ),
    "axis": ("slide", "joint", lambda local: {"axis": tilted(local.axis)}),
    "armature": ("ball", "joint", lambda local: {"armature": local.armature + LITTLE}),
    "damping": ("ball", "joint", lambda local: {"damping": local.damping + 1e-8}),
    "stiffness": ("hinge", "joint", lambda local: {"spring_stiffness": local.spring_stiffness + 1e-8}),
    "rest": ("slide", "joint", lambda local: {"spring_rest": local.spring_rest + 1e-8}),
}
"""Of one body, by so little that no picture would show it."""


@pytest.mark.parametrize("name", CHANGES)
def test_differences_are_found(name):
    world = worlds.every_joint(spring_stiffness=2.0, damping=0.1)
    found = deviations(world, 2, 20, given=changed(world, *CHANGES[name]))
    assert max(found.values()) > 3 * ROUND_OFF
