"""Kinematic bodies: their fields in a spec, their values in the world, their poses at every time."""

# ruff: noqa: E501 (a case is a line)
from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.control.request import curve
from simspec.errors import SpecError
from simspec.runner.metrics import Masses
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world.actions import KINEMATIC_MASS_RATIO, KinematicMotion
from simspec.world.types import World

TOP = """simspec: 1
name: moved
physics: {timestep: 1 ms, duration: 1 s}
contact: {materials: {wood: {friction: 0.4}}}
bodies:
  floor: {fixed: true, shapes: [{plane: {}, material: wood}]}
  lift:
    kinematic: true
    pose: {xyz: [0, 0, 1], rpy: [0, 0, 90 deg]}
    shapes: [{box: {size: [6, 1, 0.2]}, material: wood}]
  other: {kinematic: true, pose: {xyz: [0, 5, 1]}, shapes: [{sphere: {radius: 0.1}, material: wood}]}
  arm: {parent: lift, mass: 2, inertia: {principal: [1, 1, 1]}, joint: {type: hinge, axis: [0, 1, 0]}}
  box: {pose: {xyz: [0, 0, 3]}, mass: 3, shapes: [{box: {size: [0.1, 0.1, 0.1]}, material: wood}]}
"""


def scenario(folder: Path, motion: str, top: str = TOP) -> World:
    path = folder / "moved.yaml"
    path.write_text(f"{top}{motion}\n", encoding="utf-8")
    return simspec.load(path).resolve()


def test_joints_without_points_stay_in_place(tmp_path):
    world = scenario(
        tmp_path,
        "motion: {lift: {points: [{at: 0.1}, {at: 0.5, xyz: [0, 0, 2]}, {at: 1, rpy: [0, 0, 0]}], interpolation: linear}}",
    )
    lift, other = world.motions
    half = math.sqrt(0.5)
    assert (lift.times, lift.positions) == ((0.1, 0.5, 1.0), ((0.0, 0.0, 1.0), (0.0, 0.0, 2.0), (0.0, 0.0, 2.0)))
    np.testing.assert_allclose(lift.quaternions, [[half, 0, 0, half], [half, 0, 0, half], [1, 0, 0, 0]], atol=1e-15)
    assert other == KinematicMotion("other", (0.0,), ((0.0, 5.0, 1.0),), ((1.0, 0.0, 0.0, 0.0),))
    bodies = {body.name: body for body in world.bodies}
    assert bodies["lift"].inertial.mass == KINEMATIC_MASS_RATIO * 5.0
    assert bodies["lift"].inertial.inertia[0] > 9.0 * bodies["lift"].inertial.mass  # as far out as it reaches
    assert bodies["lift"].joint.position[:3] == (0.0, 0.0, 1.0)
    assert {("floor", "lift"), ("floor", "other"), ("lift", "other")} <= set(world.contact.excluded_bodies)
    assert not any("box" in pair for pair in world.contact.excluded_bodies)
    (need,) = (need for need in needs(world) if need.feature is Feature.KINEMATIC)
    assert need.paths == ("bodies.lift.kinematic", "bodies.other.kinematic")
    assert Masses.of(world).mass.tolist() == [0.0, 0.0, 2.0, 0.0, 3.0]
    assert not simspec.load(tmp_path / "moved.yaml").source.document.problems


@pytest.mark.parametrize(("interpolation", "share"), [("linear", 0.25), ("cubic", 0.15625), ("quintic", 0.103515625)])
def test_a_motion_between_two_points(interpolation, share):
    motion = KinematicMotion(
        "a",
        (1.0, 3.0),
        ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0)),
        ((1.0, 0.0, 0.0, 0.0), (math.cos(1), 0.0, -math.sin(1), 0.0)),
        interpolation,
    )
    place, turn = curve(motion).at(np.array([0.0, 1.5, 3.0, 9.0]))
    np.testing.assert_allclose(place[:, 0], [0.0, 4.0 * share, 4.0, 4.0], atol=1e-12)
    np.testing.assert_allclose(2.0 * np.arctan2(turn[:, 2], turn[:, 0]), [0.0, -2.0 * share, -2.0, -2.0], atol=1e-12)
    static = curve(
        dataclasses.replace(motion, times=(1.0,), positions=motion.positions[1:], quaternions=motion.quaternions[1:])
    )
    assert static.at(np.array([0.0, 5.0]))[0].tolist() == [[4.0, 0.0, 0.0]] * 2


def test_a_placed_model_is_kinematic(tmp_path):
    arm = "simspec: 1\nname: arm\nmodel:\n  bodies:\n    palm: {fixed: true}\n    finger: {parent: palm, mass: 1, inertia: {principal: [1, 1, 1]}, joint: {type: slide, axis: [1, 0, 0]}}\n"
    (tmp_path / "arm.yaml").write_text(arm, encoding="utf-8")
    top = "simspec: 1\nname: moved\nphysics: {duration: 1 s}\nmodels:\n  hand: {use: arm.yaml, kinematic: true, pose: {xyz: [0, 0, 1]}}\n"
    world = scenario(tmp_path, "motion: {hand/palm: {points: [{at: 0.5}, {at: 1, xyz: [1, 0, 1]}]}}", top)
    (motion,) = world.motions
    assert (motion.body, motion.positions) == ("hand/palm", ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0)))
    assert world.bodies[0].joint.kind == "free"
    assert world.bodies[0].inertial.mass == KINEMATIC_MASS_RATIO


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ("motion: {lft: {points: [{at: 0}]}}", "there is no body 'lft'"),
        ("motion: {box: {points: [{at: 0}]}}", "box is not kinematic"),
        ("motion: {arm: {points: [{at: 0}]}}", "arm is not kinematic"),
        ("motion: {lift: {points: []}}", "no points"),
        ("motion: {lift: {points: [{at: 1}, {at: 1}]}}", "times must increase"),
        ("motion: {lift: {points: [{at: 1, rpy: [0, 0, 0], quat: [1, 0, 0, 0]}]}}", "quat"),
        ("motion: {lift: {points: [{at: 1}], interpolation: hold}}", "not an allowed word"),
        ("motion: {lift: {points: [{at: -1}]}}", "at"),
        ("forces: [{body: lift, force: [1, 0, 0]}]", "lift is kinematic: no force moves it"),
        ("expect: [{follows_oracle: {tolerance: 1 mm}}]\nmotion: {lift: {points: [{at: 0}]}}", "no kinematic ones"),
    ],
)
def test_errors_are_reported_at_their_location(tmp_path, motion, message):
    with pytest.raises(SpecError) as error:
        scenario(tmp_path, motion)
    assert message in str(error.value)
    assert all(
        problem.location is not None and problem.location.line > TOP.count("\n") for problem in error.value.problems
    )


@pytest.mark.parametrize(
    "more", ["fixed: true", "velocity: {linear: [1, 0, 0]}", "joint: {type: hinge, axis: [0, 0, 1]}"]
)
def test_a_kinematic_body_hangs_on_nothing(tmp_path, more):
    with pytest.raises(SpecError, match="exclude each other"):
        scenario(tmp_path, "", TOP.replace("    kinematic: true\n", f"    kinematic: true\n    {more}\n"))
    with pytest.raises(SpecError, match="only for roots"):
        scenario(tmp_path, "", TOP.replace("arm: {parent: lift", "arm: {kinematic: true, parent: lift"))
