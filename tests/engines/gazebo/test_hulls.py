"""Convex hulls in the detector of Gazebo's DART, in place of the geoms of balls."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.gazebo.engine import Gazebo
from simspec.proof.touch.geometry import gap, solids, transform
from simspec.testing import worlds
from simspec.world import frames
from simspec.world.types import Inertial, Pose
from tests.engines.drake.scenes import boxes

pytestmark = pytest.mark.skipif(Gazebo.version() is None, reason="gz-physics or a C++ compiler is not installed")
FREE = (1.0, 0.0, 0.0, 0.0)
KINDS = ("mesh", "sphere", "box", "cylinder", "capsule")


@pytest.fixture
def load(load_files):
    def of(world):
        world = worlds.accepting(world, "gazebo")
        return load_files(Gazebo, compile_world(world, ["gazebo"])["gazebo"].files)

    return of


def as_hulls(world, floor=False):
    def hull(shape):
        if not shape.size or (shape.size[0] > 1.0 and not floor):
            return shape
        corners = itertools.product((-0.5, 0.5), repeat=3)
        size = tuple(x * side for corner in corners for x, side in zip(corner, shape.size, strict=True))
        return dataclasses.replace(shape, kind="mesh", size=size)

    bodies = (dataclasses.replace(body, shapes=tuple(map(hull, body.shapes))) for body in world.bodies)
    return dataclasses.replace(world, bodies=tuple(bodies))


def ends(engine):
    """Where a cube that slides comes to be, in 24 directions."""
    found = []
    for turn in np.linspace(0.0, 2.0 * math.pi, 25)[:-1]:
        velocity = (0.5 * math.cos(turn), 0.5 * math.sin(turn), 0.0, 0.0, 0.0, 0.0)
        engine.set_state(np.array([0.0, 0.0, 0.05, *FREE]), np.array(velocity))
        engine.step(150)
        found.append(np.concatenate(engine.get_state()))
    return np.array(found)


@pytest.mark.parametrize("floor", ["box", "hull", "plane"])
def test_a_cube_as_a_hull_slides_and_stops_as_a_box(floor, load):
    below = "plane" if floor == "plane" else "box"
    as_box = load(boxes(1, floor=below))
    as_hull = load(as_hulls(boxes(1, floor=below), floor == "hull"))
    assert ends(as_hull) == pytest.approx(ends(as_box), abs=1e-7 if floor == "plane" else 1e-9)
    assert len(as_hull.contacts()["normal"]) == 4
    assert as_hull.log() == []


def test_a_tower_of_ten_cubes_stands(load):
    engine = load(as_hulls(boxes(10)))
    engine.step(200)
    q, v = engine.get_state()
    assert q.reshape(10, 7)[:, 2] == pytest.approx(0.05 + 0.1 * np.arange(10), abs=1e-4)
    assert np.abs(v).max() < 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_hulls_overlap_where_they_do_in_coal(kind, load):
    world = worlds.shapes_world(("mesh", kind))
    floor, entry, other = world.bodies
    if kind == "mesh":  # of the same size as the first
        shapes = tuple(dataclasses.replace(shape, name=f"other_{shape.name}") for shape in other.shapes)
        other = dataclasses.replace(other, name="other", model="other", shapes=shapes)
        other = dataclasses.replace(other, joint=dataclasses.replace(other.joint, name="other_joint"))
    shapes = [dataclasses.replace(body.shapes[0], pose=Pose()) for body in (entry, other)]
    inertial = Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0))
    pairs = zip((entry, other), shapes, strict=True)
    moving = [dataclasses.replace(body, shapes=(shape,), inertial=inertial) for body, shape in pairs]
    world = dataclasses.replace(world, bodies=(floor, *moving))
    _, first, second = solids(world)
    engine, draw = load(world), np.random.default_rng(5)
    for _ in range(12):
        turns = [frames.normalise(tuple(draw.normal(size=4).tolist())) for _ in range(2)]
        low, high = 0.0, 1.0
        for _ in range(40):
            middle = 0.5 * (low + high)
            places = Pose((0.0, 0.0, 9.0), turns[0]), Pose((middle, 0.0, 9.0), turns[1])
            distance = gap(first, transform(places[0]), second, transform(places[1])).distance
            low, high = (middle, high) if distance < 0.0 else (low, middle)
        found = []
        for away in (middle - 1e-5, middle + 1e-5):
            q = np.array([0.0, 0.0, 9.0, *turns[0], away, 0.0, 9.0, *turns[1]])
            engine.set_state(q, np.zeros(12))
            found.append(len(engine.detect_units()))
        assert found == [1, 0]


def test_every_vertex_is_stored_exactly_and_contact_can_be_disabled(load):
    world = worlds.shapes_world(("mesh", "box"))
    engine = load(world)
    shape = engine.read_back().bodies[1].shapes[0]
    assert shape.kind == "mesh"
    assert shape.size == world.bodies[1].shapes[0].size
    engine.disable_contact()
    engine.step(2000)
    assert engine.get_state()[0][2] < -10.0, "it falls through the floor"
