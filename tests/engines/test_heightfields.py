"""Height fields in every engine that has them: stored values, points of contact, and a ball that slides down a triangle."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.session import Session
from simspec.engines.pybullet.engine import PyBullet
from simspec.errors import UnsupportedError
from simspec.proof.comparator import FIELD
from simspec.proof.touch.geometry import gap, solids, transform
from simspec.proof.verify import read_back_checks
from simspec.testing.worlds import GROUND, accepting, ground
from simspec.world.shapes import HEIGHTFIELD_HEAD, field_of, heightfield_size
from simspec.world.types import Contact, Inertial, Material, PairContact, Pose, Shape, World

ENGINES = ("mujoco", "pybullet")
SLOPE = heightfield_size(2.0, 1.0, 0.3, np.array([[0.0, 0.8, 1.0], [0.0, 0.2, 0.5]]))


def session(world: World, engine: str, folder) -> Session:
    compile_world(world, [engine])[engine].artifacts.write(folder)
    return Session(engine, folder)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_surface_that_it_holds_is_the_worlds(engine, tmp_path):
    """And one height that is off by 1e-5 of the extent is noticed, whoever holds it."""
    world = accepting(ground(), engine)
    floor = world.bodies[0]
    seen = dataclasses.replace(floor.shapes[0], name="seen", collision=False, material="", pose=Pose((2.0, 0.0, 0.0)))
    world = dataclasses.replace(
        world, bodies=(dataclasses.replace(floor, shapes=(*floor.shapes, seen)), *world.bodies[1:])
    )
    world = accepting(world, engine)
    with session(world, engine, tmp_path / "files") as loaded:
        read_back = loaded.read_back()
    (check,) = [check for check in read_back_checks(world, find_engine(engine), read_back) if check.name == FIELD]
    assert check.passed
    assert check.count == 2
    heights = np.array(GROUND[HEIGHTFIELD_HEAD:]).reshape(3, 4)
    heights[1, 2] += 8e-6
    shape = dataclasses.replace(floor.shapes[0], size=heightfield_size(0.8, 0.6, 0.2, heights))
    other = dataclasses.replace(world, bodies=(dataclasses.replace(floor, shapes=(shape, seen)), *world.bodies[1:]))
    (check,) = [check for check in read_back_checks(other, find_engine(engine), read_back) if check.name == FIELD]
    assert not check.passed


@pytest.mark.parametrize("engine", ENGINES)
def test_a_ball_touches_it_where_its_triangles_are(engine, tmp_path):
    """Over cells, edges, rim and walls: at a gap of 10 µm it does not touch, at that depth it does."""
    world = accepting(ground(), engine)
    field, ball = solids(world)
    pose = transform(world.bodies[0].shapes[0].pose)
    generator = np.random.default_rng(4)
    touched = 0
    with session(world, engine, tmp_path / "files") as loaded:
        q, v = loaded.get_state()
        for _ in range(400):
            q[:3] = generator.uniform((-0.4, -0.4, -0.15), (0.6, 0.4, 0.15))
            loaded.set_state(q, v)
            poses, _ = loaded.body_states()
            at = transform(Pose(tuple(poses[1][:3]), tuple(poses[1][3:]))) @ ball.pose
            expected = gap(field, pose, ball, at).distance
            if abs(expected) < 1e-5 or expected < -0.03:  # deeper: which way out is shorter
                continue
            assert bool(len(loaded.detect_contacts())) == (expected < 0.0), q[:3]
            touched += expected < 0.0
    assert touched > 20


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("triangle", [0, 1])
def test_a_ball_slides_down_a_triangle_as_down_a_plane(engine, triangle, tmp_path):
    """Without friction: v = g sin α t down its slope, with the normal of that triangle and of no other of the cell."""
    base = ground()
    floor, ball = base.bodies
    shape = dataclasses.replace(floor.shapes[0], size=SLOPE, pose=Pose())
    field = field_of(SLOPE)
    normal = field.normals[triangle]
    at = field.points[field.triangles[triangle]].mean(axis=0) + 0.05 * normal
    joint = dataclasses.replace(ball.joint, position=(*at.tolist(), 1.0, 0.0, 0.0, 0.0))
    moment = 0.4 * 0.05**2
    ball = dataclasses.replace(
        ball,
        joint=joint,
        inertial=Inertial(1.0, inertia=(moment, moment, moment, 0.0, 0.0, 0.0)),
        shapes=(Shape("sphere_0", "sphere", (0.05,), material="default"),),
    )
    contact = Contact(materials=(Material("default"),), pairs=(PairContact("default", "default", 0.0, 0.0),))
    world = dataclasses.replace(base, bodies=(dataclasses.replace(floor, shapes=(shape,)), ball), contact=contact)
    world = accepting(world, engine)
    steps = 100
    with session(world, engine, tmp_path / "files") as loaded:
        loaded.step(steps)
        _, v = loaded.get_state()
    gravity = np.array(world.physics.gravity)
    along = gravity - normal * (gravity @ normal)
    time = steps * world.physics.timestep
    assert math.hypot(*along) > 1.5
    np.testing.assert_allclose(v[:3], along * time, atol=2e-3 * math.hypot(*along) * time)


def test_pybullet_has_none_with_a_margin():
    world = ground()
    floor = world.bodies[0]
    heavy = dataclasses.replace(floor, inertial=Inertial(1.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0)))
    with pytest.raises(UnsupportedError, match=r"PyBullet keeps 0\.001 m around the height field 'floor_0'"):
        compile_world(dataclasses.replace(world, bodies=(heavy, *world.bodies[1:])), [PyBullet.NAME])


@pytest.mark.parametrize("engine", ["dart", "drake"])
def test_others_refuse_it_by_name(engine):
    with pytest.raises(UnsupportedError, match=r"shape\.heightfield"):
        compile_world(ground(), [engine])
