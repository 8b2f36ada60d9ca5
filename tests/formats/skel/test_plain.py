"""Plain .skel for any tool: DART, which shares nothing with the writer, finds the same model, and what is lost is listed."""

from __future__ import annotations

import dataclasses

import dartpy
import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.files import find_spec
from simspec.formats.kit.contract import LossFate
from simspec.formats.skel.format import SUPPORT, WORLD, Skel
from simspec.language.load import load
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world import frames
from simspec.world.kinematics import initial_state, poses, trees
from tests import worlds
from tests.files import write
from tests.robots import robot


def library(name):
    return load(find_spec(name)).resolve()


WORLDS = {
    "every joint": lambda: worlds.every_joint(damping=0.2),
    "springs": worlds.damped_springs,
    "armature": lambda: worlds.limits_and_armature(armature=0.2, dry_friction=0.3),
    "gripper": worlds.gripper,
    "shapes": worlds.shapes_world,
    "spheres": lambda: worlds.spheres(3),
    "double pendulum": lambda: library("double-pendulum"),
    "arm": lambda: library("ur10e"),
    "robot": lambda: robot(6),
    "fixed root": lambda: worlds.world(worlds.tree(["fixed", "hinge", "ball", "slide"], 5)),
}
WORLDS["chain"] = lambda: worlds.world(worlds.tree(["hinge", "slide", "hinge"], 3))
TYPES = {
    "fixed": "WeldJoint",
    "hinge": "RevoluteJoint",
    "slide": "PrismaticJoint",
    "ball": "BallJoint",
    "free": "FreeJoint",
}


def loaded(world, folder):
    plain = Skel().plain(world)
    write(plain.files, folder)
    theirs = dartpy.utils.SkelParser.readWorld(str(folder / WORLD))
    assert theirs is not None
    return plain, theirs


@pytest.mark.parametrize("name", WORLDS)
def test_another_reader_finds_masses_places_joints_and_shapes(name, tmp_path):
    world = WORLDS[name]()
    _, theirs = loaded(world, tmp_path)
    assert theirs.getTimeStep() == world.physics.timestep
    assert tuple(theirs.getGravity()) == world.physics.gravity
    assert theirs.getNumSkeletons() == len(trees(world))
    for root, bodies in trees(world).items():
        skeleton = theirs.getSkeleton(root)
        assert skeleton.getNumBodyNodes() == len(bodies)
        for body in bodies:
            node = skeleton.getBodyNode(body.name)
            pose = poses(world)[body.name]
            at = node.getWorldTransform()
            np.testing.assert_allclose(at.translation(), pose.position, atol=1e-9)
            np.testing.assert_allclose(at.rotation(), np.array(frames.matrix(pose.quaternion)), atol=1e-9)
            if body.inertial.mass:
                assert node.getMass() == body.inertial.mass
                np.testing.assert_allclose(node.getLocalCOM(), body.inertial.centre_of_mass, atol=1e-15)
            assert node.getNumShapeNodes() == sum(shape.collision + shape.visual for shape in body.shapes)
            joint = node.getParentJoint()
            assert (joint.getName(), joint.getType()) == (body.joint.name, TYPES[body.joint.kind])
            if body.joint.kind in ("hinge", "slide"):
                assert joint.getDampingCoefficient(0) == body.joint.damping
                assert joint.getSpringStiffness(0) == body.joint.spring_stiffness
                assert joint.getRestPosition(0) == body.joint.spring_rest
                assert joint.getCoulombFriction(0) == body.joint.dry_friction
                if body.joint.position_limits is not None:
                    assert (
                        joint.getPositionLowerLimit(0),
                        joint.getPositionUpperLimit(0),
                    ) == body.joint.position_limits


@pytest.mark.parametrize("name", ["double pendulum", "arm", "chain"])
def test_another_reader_finds_the_same_dynamics(name, tmp_path):
    """The mass matrix is the oracle's, but for armature, which the language lacks."""
    world = WORLDS[name]()
    world = dataclasses.replace(
        world,
        bodies=tuple(
            dataclasses.replace(body, joint=dataclasses.replace(body.joint, armature=0.0)) for body in world.bodies
        ),
    )
    assert {body.joint.kind for body in world.bodies} <= {"fixed", "hinge", "slide"}
    _, theirs = loaded(world, tmp_path)
    (root,) = trees(world)
    skeleton = theirs.getSkeleton(root)
    moving = [body.joint.name for body in world.bodies if body.joint.kind != "fixed"]
    places = [skeleton.getJoint(joint).getIndexInSkeleton(0) for joint in moving]
    q, v = initial_state(world)
    np.testing.assert_allclose(skeleton.getPositions()[places], q, atol=1e-15)
    np.testing.assert_allclose(skeleton.getVelocities()[places], v, atol=1e-15)
    mass = skeleton.getMassMatrix()[np.ix_(places, places)]
    np.testing.assert_allclose(mass, Oracle(world).mass_matrix(q), rtol=1e-9, atol=1e-12)


def test_everything_that_a_world_needs_is_carried_or_listed():
    assert Skel.SUPPORT is SUPPORT
    assert set(SUPPORT) == set(Feature)
    for make in WORLDS.values():
        world = make()
        listed = {loss.feature: loss for loss in Skel().plain(world).losses}
        for need in needs(world, world.contact.pairs):
            assert (SUPPORT[need.feature].level is Level.EXACT) is (need.feature.value not in listed), need.feature
            if need.feature.value in listed:
                assert listed[need.feature.value].paths == need.paths
                assert listed[need.feature.value].how


def test_damping_is_approximated_and_a_balls_left_out():
    fates = {loss.feature: loss.fate for loss in Skel().plain(worlds.every_joint(damping=0.2)).losses}
    assert fates[Feature.DAMPING.value] is LossFate.APPROXIMATED
    assert fates[Feature.BALL_DAMPING.value] is LossFate.LEFT_OUT


def test_no_detector_is_named():
    assert "collision_detector" not in Skel().plain(worlds.spheres(2)).files[WORLD]


def test_a_body_called_world_is_renamed_and_listed(tmp_path):
    base = worlds.world(worlds.tree(["hinge"], 2))
    world = dataclasses.replace(base, bodies=(dataclasses.replace(base.bodies[0], name="world", model="world"),))
    plain, theirs = loaded(world, tmp_path)
    assert theirs.getSkeleton(0).getBodyNode("world.") is not None
    assert [loss.paths for loss in plain.losses if loss.feature == "body.name"] == [("bodies.world",)]


def test_the_same_world_gives_the_same_bytes():
    assert Skel().plain(worlds.gripper()).files == Skel().plain(worlds.gripper()).files
