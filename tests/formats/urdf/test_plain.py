"""Plain URDF for any tool: other readers find the same model, and what is not carried is listed."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pinocchio
import pytest
import yourdfpy

from simspec.dynamics.oracle import Oracle
from simspec.files import find_spec
from simspec.formats.kit.contract import LossFate, formats
from simspec.formats.urdf.format import PLACEMENT, SUPPORT, Urdf
from simspec.formats.urdf.reading import unknown_parts
from simspec.formats.urdf.robots import (
    UNLIMITED,
    UrdfExtension,
    UrdfGeometry,
    UrdfInertial,
    UrdfJoint,
    UrdfLink,
    UrdfOrigin,
    UrdfRobot,
    UrdfVisual,
    parts_of,
)
from simspec.language.load import load
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.world import frames
from simspec.world.types import Pose, Shape
from tests import robots, worlds
from tests.files import write


def library(name):
    return load(find_spec(name)).resolve()


WORLDS = {
    "chain": lambda: worlds.world(worlds.tree(["hinge", "slide", "hinge"], 3, velocity_limit=2.0)),
    "fixed root": lambda: worlds.world(worlds.tree(["fixed", "hinge", "hinge", "slide"], 5)),
    "double pendulum": lambda: library("double-pendulum"),
    "arm": lambda: library("ur10e"),
    "robot": lambda: robots.robot(6, ("hinge", "slide", "fixed"), loops=False, free=False),
}


def written(world, folder):
    plain = Urdf().plain(world)
    write(plain.files, folder)
    return plain


def test_the_table_is_of_every_feature():
    assert set(SUPPORT) == set(Feature)
    assert Urdf.SUPPORT is SUPPORT


@pytest.mark.parametrize("name", WORLDS)
def test_another_reader_finds_the_same_dynamics(name, tmp_path):
    """Pinocchio reads the file by its own parser; M and the joints' forces under gravity are the oracle's."""
    world = WORLDS[name]()
    written(world, tmp_path)
    (file,) = tmp_path.glob("*.urdf")
    model = pinocchio.buildModelFromUrdf(str(file))
    model.gravity.linear = np.array(world.physics.gravity)
    data = model.createData()
    oracle = Oracle(world)
    q = np.concatenate([body.joint.position for body in world.bodies]) + 0.3
    v = np.full(len(q), 0.7)
    moving = [body.joint for body in world.bodies if body.joint.kind != "fixed"]
    places = [model.joints[model.getJointId(joint.name)].idx_v for joint in moving]
    theirs = np.zeros(model.nq)
    for joint, value in zip(moving, q, strict=True):
        local = model.joints[model.getJointId(joint.name)]
        if local.nq == 2:  # a joint without limits: cosine and sine
            theirs[local.idx_q : local.idx_q + 2] = math.cos(value), math.sin(value)
        else:
            theirs[local.idx_q] = value
    rates = np.zeros(model.nv)
    rates[places] = v
    mass = pinocchio.crba(model, data, theirs)
    mass = np.triu(mass) + np.triu(mass, 1).T
    np.testing.assert_allclose(mass[np.ix_(places, places)], oracle.mass_matrix(q), rtol=1e-9, atol=1e-12)
    bias = pinocchio.rnea(model, data, theirs, rates, np.zeros(model.nv))
    damping = np.array([joint.damping for joint in moving])
    springs = np.array([joint.spring_stiffness for joint in moving])
    assert not springs.any()
    wanted = oracle.bias_force(q, v)
    assert np.allclose(bias[places], wanted, rtol=1e-9, atol=1e-9) or np.allclose(
        bias[places] + damping * v, wanted, rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("name", [*WORLDS, "gripper", "spheres", "shapes"])
def test_a_second_reader_sees_every_link_joint_and_shape(name, tmp_path):
    more = {"gripper": worlds.gripper, "spheres": lambda: worlds.spheres(3), "shapes": worlds.shapes_world}
    world = {**WORLDS, **more}[name]()
    plain = written(world, tmp_path)
    placed = json.loads(plain.files[PLACEMENT])["trees"]
    assert sorted(link["name"] for tree in placed for link in tree["links"]) == sorted(b.name for b in world.bodies)
    bodies = {body.name: body for body in world.bodies}
    joints = {body.joint.name: body.joint for body in world.bodies}
    for tree in placed:
        robot = yourdfpy.URDF.load(str(tmp_path / tree["file"]), build_scene_graph=False, load_meshes=False).robot
        links = {link.name: link for link in robot.links}
        for entry in tree["links"]:
            body, link = bodies[entry["name"]], links[entry["in_file"]]
            if body.inertial.mass:
                assert link.inertial.mass == body.inertial.mass
            parts = [part for shape in body.shapes for part in parts_of(shape)]
            assert len(link.collisions) == sum(part.collision for part in parts)
            assert len(link.visuals) == sum(part.visual for part in parts)
        for entry in tree["joints"]:
            assert tuple(entry["position"]) == joints[entry["name"]].position
            assert any(joint.name == entry["in_file"] for joint in robot.joints)
        root = bodies[tree["links"][0]["name"]].joint
        assert tree["free"] == (root.kind == "free")
        if tree["free"]:
            assert (*tree["position"], *tree["quaternion"]) == root.position


def every_feature():
    """Worlds that between them need every feature but those of engines."""
    contact = worlds.shapes_world().contact
    material = contact.materials[0].name
    pairs = tuple(dataclasses.replace(pair, friction=0.3, restitution=0.2) for pair in contact.pairs)
    yield dataclasses.replace(worlds.shapes_world(), contact=dataclasses.replace(contact, pairs=pairs))
    yield worlds.every_joint(damping=0.2)
    yield worlds.damped_springs()
    yield worlds.limits_and_armature(armature=0.2, dry_friction=0.3)
    yield worlds.gripper()
    assert material


def test_everything_that_a_world_needs_is_carried_or_listed():
    for world in every_feature():
        plain = Urdf().plain(world)
        listed = {loss.feature: loss for loss in plain.losses if loss.fate is not LossFate.PLACEHOLDER}
        for need in needs(world, world.contact.pairs):
            carried = SUPPORT[need.feature].level is Level.EXACT
            assert carried is (need.feature.value not in listed), need.feature
            if not carried:
                assert listed[need.feature.value].paths == need.paths
                assert listed[need.feature.value].how


def test_the_files_are_of_the_language_alone(tmp_path):
    for index, world in enumerate(every_feature()):
        folder = tmp_path / str(index)
        folder.mkdir()
        written(world, folder)
        for robot in Urdf().read(folder).robots.values():
            assert [unknown.path for unknown in unknown_parts(robot)] == [
                "robot/mujoco"
            ]  # an extension that others skip
            for joint in robot.joints:
                if joint.type in ("revolute", "prismatic"):
                    assert None not in (joint.limit.lower, joint.limit.upper, joint.limit.effort, joint.limit.velocity)


def test_limits_that_stand_for_none_are_listed():
    world = worlds.world(worlds.tree(["slide", "hinge"], 2))
    assert [body.joint.position_limits for body in world.bodies] == [None, None]
    plain = Urdf().plain(world)
    rows = {loss.feature: loss for loss in plain.losses if loss.fate is LossFate.PLACEHOLDER}
    slide = world.bodies[0].name
    assert set(rows) == {"joint.limits.position", "joint.limits.velocity", "joint.limits.effort"}
    assert all(row.paths == (f"bodies.{slide}.joint",) and not row.of_the_model for row in rows.values())
    text = next(text for name, text in plain.files.items() if name.endswith(".urdf"))
    assert text.count(f'lower="-{UNLIMITED:.0f}" upper="{UNLIMITED:.0f}"') == 1


def test_a_ball_joint_becomes_three_hinges_that_turn_as_it_does(tmp_path):
    world = worlds.world(worlds.tree(["ball"], 4))
    plain = written(world, tmp_path)
    (loss,) = [loss for loss in plain.losses if loss.feature == "joint.ball"]
    assert loss.fate is LossFate.APPROXIMATED
    assert loss.of_the_model
    (file,) = tmp_path.glob("*.urdf")
    model = pinocchio.buildModelFromUrdf(str(file))
    data = model.createData()
    turn = frames.normalise((0.8, 0.3, -0.4, 0.33))
    angles = frames.to_euler_xyz(turn)
    q = np.concatenate([[math.cos(angle), math.sin(angle)] for angle in angles])
    pinocchio.framesForwardKinematics(model, data, q)
    body = world.bodies[0]
    found = data.oMf[model.getFrameId(body.name)]
    wanted = frames.compose(body.joint.origin, Pose((0.0, 0.0, 0.0), turn))
    np.testing.assert_allclose(found.translation, wanted.position, atol=1e-12)
    np.testing.assert_allclose(found.rotation, np.array(frames.matrix(wanted.quaternion)), atol=1e-12)


@pytest.mark.parametrize("kind", ["capsule", "plane"])
def test_shapes_put_otherwise_are_the_same_solid(kind):
    pose = Pose((0.1, 0.2, 0.3), frames.normalise((0.9, 0.1, 0.3, -0.2)))
    shape = Shape("s", kind, (0.1, 0.4) if kind == "capsule" else (), pose)
    generator = np.random.default_rng(7)

    def inside(part, point):
        local = np.array(frames.rotate(frames.conjugate(part.pose.quaternion), tuple(point - part.pose.position)))
        if part.kind == "sphere":
            return np.linalg.norm(local) <= part.size[0]
        if part.kind == "cylinder":
            return math.hypot(*local[:2]) <= part.size[0] and abs(local[2]) <= part.size[1] / 2
        if part.kind == "box":
            return bool(np.all(np.abs(local) <= np.array(part.size) / 2))
        if part.kind == "plane":
            return local[2] <= 0.0
        core = np.array([0.0, 0.0, np.clip(local[2], -part.size[1] / 2, part.size[1] / 2)])
        return np.linalg.norm(local - core) <= part.size[0]

    points = np.array(pose.position) + generator.uniform(-0.4, 0.4, (2000, 3))
    insides = [inside(shape, point) for point in points]
    assert 0 < sum(insides) < len(insides)
    assert insides == [any(inside(part, point) for part in parts_of(shape)) for point in points]


def test_an_ellipsoid_is_left_out_and_listed():
    world = worlds.shapes_world(("ellipsoid",))
    plain = Urdf().plain(world)
    (loss,) = [loss for loss in plain.losses if loss.feature == "shape.ellipsoid"]
    assert (loss.fate, loss.of_the_model) == (LossFate.LEFT_OUT, True)


def test_the_same_world_gives_the_same_bytes():
    assert Urdf().plain(worlds.gripper()).files == Urdf().plain(worlds.gripper()).files


def test_a_format_without_plain_files_says_so_and_world_loses_nothing():
    assert formats()["world"].plain(worlds.gripper()).losses == ()


def test_extensions_are_printed_and_names_escaped(tmp_path):
    contact = UrdfExtension(
        "contact", (("kind", 'a<"b'),), (UrdfExtension("friction", (("value", 0.5),)), UrdfExtension("none"))
    )
    link = UrdfLink(
        'a<b>&"é',
        UrdfInertial(UrdfOrigin(), 1.0, (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)),
        (UrdfVisual("v", UrdfGeometry("plane", (("normal", (0.0, 0.0, 1.0)),))),),
        extensions=(contact,),
    )
    robot = UrdfRobot("r", (link, UrdfLink("b")), (UrdfJoint("j", "spherical", link.name, "b", UrdfOrigin()),))
    write(Urdf().write({"r.urdf": robot}), tmp_path)
    again = Urdf().read(tmp_path).robots["r.urdf"]
    assert again.links[0].name == link.name
    assert again.links[0].inertial.inertia == link.inertial.inertia
    read = again.links[0].node.need("contact")
    assert read.attributes == {"kind": 'a<"b'}
    assert [child.tag for child in read.children] == ["friction", "none"]
    assert again.joints[0].type == "spherical"
    assert again.joints[0].axis is None
