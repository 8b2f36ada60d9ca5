"""Plain MJCF for any tool: MuJoCo, which shares nothing with the writer, finds the same model, and what is lost is listed."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.errors import UnsupportedError
from simspec.files import find_spec
from simspec.formats.kit.contract import LossFate
from simspec.formats.mjcf import format as plain_mjcf
from simspec.formats.mjcf.format import MODEL, SUPPORT, Mjcf
from simspec.language.load import load
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.support.negotiation import needs
from simspec.testing.bench import chain
from simspec.testing.control_suite import native
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import initial_state, poses
from simspec.world.types import Hardness
from tests import worlds


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
    "fixed root": lambda: worlds.world(worlds.tree(["fixed", "hinge", "ball", "slide"], 5)),
}


def loaded(world):
    plain = Mjcf().plain(world)
    model = mujoco.MjModel.from_xml_string(plain.files[MODEL])
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("initial").id)
    mujoco.mj_forward(model, data)
    return plain, model, data


@pytest.mark.parametrize("name", WORLDS)
def test_another_reader_finds_masses_places_joints_and_shapes(name):
    world = WORLDS[name]()
    _, model, data = loaded(world)
    assert model.nbody == len(world.bodies) + 1
    assert model.opt.timestep == world.physics.timestep
    assert tuple(model.opt.gravity) == world.physics.gravity
    for body in world.bodies:
        index = model.body(body.name).id
        pose = poses(world)[body.name]
        np.testing.assert_allclose(data.xpos[index], pose.position, atol=1e-12)
        np.testing.assert_allclose(data.xmat[index].reshape(3, 3), np.array(frames.matrix(pose.quaternion)), atol=1e-12)
        assert model.body_mass[index] == body.inertial.mass
        assert model.body_geomnum[index] == len(body.shapes)
        for shape in body.shapes:
            geom = model.geom(shape.name)
            assert bool(geom.contype[0] or geom.conaffinity[0]) is shape.collision
            assert bool(geom.group[0] <= 2) is shape.visual
            np.testing.assert_allclose(geom.rgba, shape.colour, atol=1e-7)
        joint = body.joint
        if joint.kind == "fixed":
            assert model.body_jntnum[index] == 0
            continue
        theirs = model.joint(joint.name)
        assert theirs.bodyid[0] == index
        assert bool(theirs.limited[0]) is (joint.position_limits is not None)
        if joint.position_limits is not None:
            assert tuple(theirs.range) == joint.position_limits
        assert theirs.frictionloss[0] == joint.dry_friction
        assert theirs.damping[0] == joint.damping
        assert theirs.armature[0] == joint.armature
        assert np.ravel(theirs.stiffness)[0] == joint.spring_stiffness


def in_order(world, model):
    """Where MuJoCo has the velocities of the world's joints, in the world's order."""
    moving = [body.joint.name for body in world.bodies if body.joint.kind != "fixed"]
    sizes = {0: 6, 1: 3, 2: 1, 3: 1}
    return [
        index
        for name in moving
        for start in [int(model.joint(name).dofadr[0])]
        for index in range(start, start + sizes[int(model.joint(name).type[0])])
    ]


@pytest.mark.parametrize("name", ["every joint", "springs", "armature", "double pendulum", "arm", "fixed root"])
def test_another_reader_finds_the_same_dynamics(name):
    """The mass matrix is the oracle's, and so are the velocities of the keyframe."""
    world = WORLDS[name]()
    _, model, data = loaded(world)
    mass = np.zeros((model.nv, model.nv))
    for index, unit in enumerate(np.eye(model.nv)):
        mujoco.mj_mulM(model, data, mass[index], unit)
    places = in_order(world, model)
    change = np.eye(model.nv)
    velocity = np.array(data.qvel)[places]
    start = 0
    for body in world.bodies:
        joint = body.joint
        size = len(joint.velocity)
        if joint.kind == "free":  # the world's coordinates are those of the centre of mass
            x, y, z = frames.rotate(joint.position[3:7], body.inertial.centre_of_mass)
            lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
            change[start : start + 3, start + 3 : start + 6] = lever @ np.array(frames.matrix(joint.position[3:7]))
        start += size
    q, v = initial_state(world)
    np.testing.assert_allclose(change @ velocity, v, atol=1e-12)
    ours = change.T @ Oracle(world).mass_matrix(q) @ change
    np.testing.assert_allclose(mass[np.ix_(places, places)], ours, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["gripper", "shapes", "spheres", "arm"])
def test_bodies_that_may_touch_are_the_worlds(name):
    """By masks, exclusions and the reader's own rule of bodies joined rigidly."""
    world = WORLDS[name]()
    _, model, _ = loaded(world)
    allowed = CollisionFilter(world)
    excluded = set(map(int, model.exclude_signature))
    for first in world.bodies:
        for second in world.bodies:
            entry, two = model.body(first.name).id, model.body(second.name).id
            if entry >= two or model.body_weldid[entry] == model.body_weldid[two]:
                continue
            signature = (entry << 16) + two
            for a in (shape for shape in first.shapes if shape.collision):
                for b in (shape for shape in second.shapes if shape.collision):
                    ga, gb = model.geom(a.name), model.geom(b.name)
                    masks = ga.contype[0] & gb.conaffinity[0] or gb.contype[0] & ga.conaffinity[0]
                    meets = bool(masks) and signature not in excluded
                    wanted = allowed.may_touch(first.name, second.name)
                    wanted = wanted and allowed.may_materials_touch(a.material, b.material)
                    assert meets == wanted, (a.name, b.name)


FRICTIONS = {("a", "a"): 0.5, ("b", "b"): 0.9, ("a", "b"): 0.3}


def test_the_law_of_every_pair_has_the_friction_of_the_pair():
    """The parameter of a contact of two geoms: the larger value, or that of the explicit pair."""
    world = worlds.table(FRICTIONS)
    _, model, _ = loaded(world)
    laws = {(pair.first, pair.second): pair for pair in world.contact.pairs}
    explicit = {
        frozenset((int(entry), int(two))): friction[0]
        for entry, two, friction in zip(model.pair_geom1, model.pair_geom2, model.pair_friction, strict=True)
    }
    allowed = CollisionFilter(world)
    solid = [(body, shape) for body in world.bodies for shape in body.shapes if shape.collision]
    seen = set()
    for index, (first, a) in enumerate(solid):
        for second, b in solid[index + 1 :]:
            if not allowed.may_touch(first.name, second.name):
                continue
            entry, two = model.geom(a.name), model.geom(b.name)
            felt = explicit.get(frozenset((entry.id, two.id)), max(entry.friction[0], two.friction[0]))
            pair = (min(a.material, b.material), max(a.material, b.material))
            assert felt == laws[pair].friction
            seen.add(pair)
    assert seen
    assert explicit


def test_too_many_explicit_pairs_are_listed_and_not_written(monkeypatch):
    world = worlds.table(FRICTIONS)
    assert "<pair geom1" in Mjcf().plain(world).files[MODEL]
    monkeypatch.setattr(plain_mjcf, "MOST_PAIRS", 0)
    plain = Mjcf().plain(world)
    assert "<pair geom1" not in plain.files[MODEL]
    (loss,) = [loss for loss in plain.losses if loss.feature == Feature.FRICTION_PAIRS.value]
    assert loss.fate is LossFate.APPROXIMATED
    assert not loss.of_the_model


def test_cones_and_time_constants_are_the_languages():
    for cone, theirs in (
        ("elliptic", mujoco.mjtCone.mjCONE_ELLIPTIC),
        ("pyramid-inscribed", mujoco.mjtCone.mjCONE_PYRAMIDAL),
    ):
        assert loaded(worlds.with_cone(cone))[1].opt.cone == theirs
    world = worlds.ball_with_law(hardness=Hardness("time-constant", time_constant=0.03, damping_ratio=0.7))
    plain, model, _ = loaded(world)
    assert {tuple(solref) for solref in model.geom_solref} == {(0.03, 0.7)}
    assert Feature.HARDNESS_TIME_CONSTANT.value in {loss.feature for loss in plain.losses}


def test_everything_that_a_world_needs_is_carried_or_listed():
    assert Mjcf.SUPPORT is SUPPORT
    assert set(SUPPORT) == set(Feature)
    for make in WORLDS.values():
        world = make()
        listed = {loss.feature: loss for loss in Mjcf().plain(world).losses}
        for need in needs(world, world.contact.pairs):
            assert (SUPPORT[need.feature].level is Level.EXACT) is (need.feature.value not in listed), need.feature
            if need.feature.value in listed:
                assert listed[need.feature.value].paths == need.paths
                assert listed[need.feature.value].how


def test_restitution_and_the_common_law_are_listed():
    features = {
        loss.feature: loss.fate for loss in Mjcf().plain(worlds.ball_with_law(restitution=0.5, friction=0.2)).losses
    }
    assert features[Feature.RESTITUTION.value] is LossFate.LEFT_OUT
    assert features[Feature.HARDNESS_COMMON.value] is LossFate.APPROXIMATED
    assert Feature.FRICTION.value not in features


def single_joint(**more):
    base = worlds.world(worlds.tree(["hinge"], 2))
    body = base.bodies[0]
    return dataclasses.replace(
        base, bodies=(dataclasses.replace(body, joint=dataclasses.replace(body.joint, **more)), *base.bodies[1:])
    )


def test_effort_ratings_hold_for_actuators_and_a_rating_of_zero_is_listed():
    _, model, _ = loaded(single_joint(effort_limit=7.0))
    assert tuple(model.jnt_actfrcrange[0]) == (-7.0, 7.0)
    assert model.jnt_actfrclimited[0]
    plain, model, _ = loaded(single_joint(effort_limit=0.0))
    assert not model.jnt_actfrclimited[0]
    (loss,) = [loss for loss in plain.losses if loss.feature == Feature.LIMIT_EFFORT.value]
    assert loss.of_the_model


def test_equal_limits_are_refused():
    with pytest.raises(UnsupportedError, match="equal"):
        Mjcf().plain(single_joint(position_limits=(0.1, 0.1)))


def test_a_body_called_world_is_renamed_and_listed():
    base = worlds.world(worlds.tree(["hinge"], 2))
    body = base.bodies[0]
    world = dataclasses.replace(base, bodies=(dataclasses.replace(body, name="world"),))
    plain, model, _ = loaded(world)
    assert model.body("world.").id == 1
    assert [loss.paths for loss in plain.losses if loss.feature == "body.name"] == [("bodies.world",)]


@pytest.mark.parametrize("limit", [None, 5.0, 0.0])
def test_native_controllers_are_actuators(limit):
    world = native(chain(), limit=limit)
    plain, model, _ = loaded(world)
    assert model.nu == (0 if limit == 0.0 else len(world.controllers[0].joints))
    for index in range(model.nu):
        assert tuple(model.actuator_gainprm[index][:1]) == (40.0,)
        assert tuple(model.actuator_biasprm[index][:3]) == (0.0, -40.0, -3.0)
        assert bool(model.actuator_forcelimited[index]) is (limit is not None)
    fates = [loss.fate for loss in plain.losses if loss.feature == Feature.CONTROL_NATIVE.value]
    assert fates == [LossFate.APPROXIMATED, LossFate.LEFT_OUT] if limit == 0.0 else [LossFate.APPROXIMATED]


def test_the_same_world_gives_the_same_bytes():
    assert Mjcf().plain(worlds.gripper()).files == Mjcf().plain(worlds.gripper()).files
