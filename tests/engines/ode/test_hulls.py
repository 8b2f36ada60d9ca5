"""Convex hulls in ODE: overlaps compared with coal, points of contact, and a cube as a hull compared with a box."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.ode.engine import Ode
from simspec.errors import EngineError
from simspec.formats.kit.text import json_text
from simspec.formats.world import WORLD
from simspec.proof.comparator import compare
from simspec.proof.touch.geometry import gap, solids, transform
from simspec.world import frames
from simspec.world.hull import centred, corners, mesh_size
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Physics, Pose, Shape, World
from tests.engines.drake.scenes import boxes

pytestmark = pytest.mark.skipif(Ode.version() is None, reason="ODE or a C compiler is not installed")
FREE = (1.0, 0.0, 0.0, 0.0)
SIZES = {"sphere": (0.06,), "box": (0.1, 0.16, 0.05), "cylinder": (0.06, 0.12), "capsule": (0.04, 0.12), "plane": ()}
COAL = {"cylinder": 2e-6}
"""m: how far coal's distance may be off; of cylinders ODE's depths are those of the least support width to 1e-12."""


@pytest.fixture
def load(load_files):
    def of(world, change=lambda content: None):
        files = dict(compile_world(world, ["ode"])["ode"].files)
        content = json.loads(files[WORLD])
        change(content)
        return load_files(Ode, {WORLD: json_text(content), SIDECAR: files[SIDECAR]})

    return of


def stone(seed, count=20, half=(0.05, 0.08, 0.04)):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points *= np.array(half) / np.linalg.norm(points, axis=1, keepdims=True)
    return mesh_size(centred(points[corners(points)])[1])


def two(kind, size, hull):
    """A hull that is free, and another shape, free too unless it is a plane, without gravity."""
    bodies = []
    for name, local, numbers in (("one", "mesh", hull), ("other", kind, size)):
        joint = Joint(f"{name}_j", "free", position=(0.0, 0.0, 9.0, *FREE), velocity=(0.0,) * 6)
        joint = Joint(f"{name}_j", "fixed") if local == "plane" else joint
        inertial = Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0))
        bodies.append(Body(name, name, inertial, joint, (Shape(f"{name}_0", local, numbers, Pose(), "m"),)))
    contact = Contact("elliptic", (Material("m", 0.0),), (PairContact("m", "m", 0.0, 0.0),))
    return World("two", tuple(bodies), contact, Physics((0.0, 0.0, 0.0), 1e-3, 10))


def met(engine, *places):
    """The contacts of a step from these poses, at rest."""
    q = np.array([value for place in places for value in (*place.position, *place.quaternion)])
    engine.set_state(q, np.zeros(len(q) // 7 * 6))
    engine.step(1)
    return engine.contacts()


@pytest.mark.parametrize("kind", ["mesh", *SIZES])
def test_the_depth_of_an_overlap_agrees_with_coal_and_gaps_have_no_contact(kind, load):
    draw = np.random.default_rng(4)
    world = two(kind, SIZES.get(kind) if kind != "mesh" else stone(8), stone(7))
    solid, other = solids(world)
    engine = load(world)
    seen = 0
    for number in range(40):
        turns = [frames.normalise(tuple(draw.normal(size=4).tolist())) for _ in range(2)]
        way = np.array(frames.rotate(turns[0], (0.0, 0.0, 1.0)))
        if kind == "plane":
            way = np.array([0.0, 0.0, 1.0])
        pose = Pose() if kind == "plane" else Pose(tuple(draw.uniform(-3.0, 3.0, 3).tolist()), turns[1])
        wanted, low, high = (-1e-5, -1e-3, -1e-2, 1e-5)[number % 4], 0.0, 1.0
        for _ in range(50):
            middle = 0.5 * (low + high)
            place = Pose(tuple((np.array(pose.position) + middle * way).tolist()), turns[0])
            distance = gap(solid, transform(place), other, transform(pose)).distance
            low, high = (middle, high) if distance < wanted else (low, middle)
        if abs(distance - wanted) > 1e-9:  # coal jumps there
            continue
        seen += 1
        given = met(engine, place, *(() if kind == "plane" else (pose,)))
        if wanted > 0.0:
            assert not len(given["distance"])
            continue
        assert given["distance"].min() == pytest.approx(wanted, abs=COAL.get(kind, 1e-8))
        # moved out by the depth along the normal, they only touch
        sign = 1.0 if given["body"][0][0] == 0 else -1.0
        out = np.array(place.position) - given["distance"].min() * sign * given["normal"][0]
        after = gap(solid, transform(Pose(tuple(out.tolist()), turns[0])), other, transform(pose)).distance
        assert after == pytest.approx(0.0, abs=1e-6)
    assert seen >= 30
    assert engine.log() == []


CUBE = tuple(0.05 * x for corner in itertools.product((-1.0, 1.0), repeat=3) for x in corner)


def points_of(load, kind, size, hull, place, static):
    given = met(load(two(kind, size, hull)), place, static)
    return given["position"], -given["distance"]


def test_a_face_on_a_face_has_the_corners_of_their_intersection(load):
    """A cube reaches over the edge of a box; turned by 45° it shares an octagon."""
    half = Pose((0.05, 0.0, 0.099), FREE)
    position, depth = points_of(load, "box", (0.1, 0.2, 0.1), CUBE, half, Pose())
    assert depth == pytest.approx([1e-3] * 4)
    assert sorted(map(tuple, position.round(6).tolist())) == [
        (x, y, 0.0495) for x in (0.0, 0.05) for y in (-0.05, 0.05)
    ]
    turned = Pose((0.0, 0.0, 0.099), frames.from_axis_angle((0.0, 0.0, 1.0), math.pi / 4))
    position, depth = points_of(load, "mesh", CUBE, CUBE, turned, Pose())
    assert depth == pytest.approx([1e-3] * 8)
    reach = 0.05 * (math.sqrt(2.0) - 1.0)
    assert np.sort(np.abs(position[:, :2]), axis=1) == pytest.approx(np.array([[reach, 0.05]] * 8))


def test_an_edge_has_two_points_and_crossing_edges_have_a_single_point(load):
    edge = frames.from_axis_angle((1.0, 0.0, 0.0), math.pi / 4)
    high = 0.05 * math.sqrt(2.0) + 0.05 - 1e-3
    position, depth = points_of(load, "box", (0.2, 0.2, 0.1), CUBE, Pose((0.0, 0.0, high), edge), Pose())
    assert depth == pytest.approx([1e-3] * 2)
    assert np.sort(position[:, 0]) == pytest.approx([-0.05, 0.05])
    other = frames.from_axis_angle((0.0, 1.0, 0.0), math.pi / 4)
    high = 0.1 * math.sqrt(2.0) - 1e-3
    position, depth = points_of(load, "mesh", CUBE, CUBE, Pose((0.01, 0.02, high), edge), Pose((0.0, 0.0, 0.0), other))
    assert depth == pytest.approx([1e-3])
    assert position[0] == pytest.approx([0.0, 0.02, 0.05 * math.sqrt(2.0) - 5e-4])


def test_of_a_face_with_many_corners_sixteen_bear(load):
    turns = np.linspace(0.0, 2.0 * math.pi, 61)[:-1]
    rim = np.stack([0.1 * np.cos(turns), 0.1 * np.sin(turns)], axis=1)
    drum = mesh_size(np.concatenate([np.insert(rim, 2, z, axis=1) for z in (-0.05, 0.05)]))
    engine = load(two("plane", (), drum))
    given = met(engine, Pose((0.0, 0.0, 0.049), FREE))
    assert len(given["position"]) == 16
    assert np.hypot(*given["position"].T[:2]) == pytest.approx([0.1] * 16)
    around = np.sort(np.arctan2(*given["position"].T[:2]))
    assert np.diff(np.append(around, around[0] + 2.0 * math.pi)).max() < 0.7, "they are spread all around it"


def as_hulls(world, floor=False):
    def hull(shape):
        if shape.size[0] > 1.0 and not floor:
            return shape
        size = tuple(
            0.5 * x * side
            for corner in itertools.product((-1.0, 1.0), repeat=3)
            for x, side in zip(corner, shape.size, strict=True)
        )
        return dataclasses.replace(shape, kind="mesh", size=size)

    return dataclasses.replace(
        world,
        bodies=tuple(dataclasses.replace(body, shapes=tuple(map(hull, body.shapes))) for body in world.bodies),
    )


@pytest.mark.parametrize("floor", [False, True])
def test_a_cube_as_a_hull_slides_and_stops_as_a_box(floor, load):
    ends = {}
    for name, world in (("box", boxes(1)), ("hull", as_hulls(boxes(1), floor))):
        engine, ends[name] = load(world), []
        for turn in np.linspace(0.0, 2.0 * math.pi, 25)[:-1]:
            velocity = (0.5 * math.cos(turn), 0.5 * math.sin(turn), 0.0, 0.0, 0.0, 0.0)
            engine.set_state(np.array([0.0, 0.0, 0.05, *FREE]), np.array(velocity))
            engine.step(150)
            ends[name].append(np.concatenate(engine.get_state()))
    assert np.array(ends["hull"]) == pytest.approx(np.array(ends["box"]), abs=1e-9)


def test_a_tower_of_ten_cubes_stands(load):
    engine = load(as_hulls(boxes(10)))
    engine.step(1000)
    q, v = engine.get_state()
    assert q.reshape(10, 7)[:, 2] == pytest.approx(0.05 + 0.1 * np.arange(10), abs=1e-6)
    assert np.abs(v).max() < 1e-6
    assert len(engine.contacts()["normal"]) == 40
    assert not [line for line in engine.log() if "did not solve" in line]


def test_hulls_on_hulls_come_to_rest(load):
    """Of three stones let down on each other's places, none is left moving or beyond what lies below it."""
    below = Shape("floor_0", "mesh", stone(3, 30, (1.0, 1.0, 0.2)), Pose((0.0, 0.0, -0.2)), "a")
    world = as_hulls(boxes(3, tower=False))
    floor, *cubes = world.bodies
    shapes = [dataclasses.replace(body.shapes[0], size=stone(number)) for number, body in enumerate(cubes)]
    bodies = [dataclasses.replace(body, shapes=(shape,)) for body, shape in zip(cubes, shapes, strict=True)]
    engine = load(dataclasses.replace(world, bodies=(dataclasses.replace(floor, shapes=(below,)), *bodies)))
    engine.step(3000)
    _, v = engine.get_state()
    assert np.abs(v).max() < 0.05
    assert engine.contacts()["distance"].min() > -1e-4


def _moved(content):
    content["bodies"][0]["shapes"][0]["size"][4] += 1e-7


def _dropped(content):
    del content["bodies"][0]["shapes"][0]["size"][-3:]


@pytest.mark.parametrize("change", [_moved, _dropped])
def test_a_moved_or_missing_vertex_is_found_in_the_read_back_of_ode(change, load):
    world = two("box", SIZES["box"], stone(7))
    sound, other = load(world).read_back(), load(world, change).read_back()
    size = sound.bodies[0].shapes[0].size
    assert size == world.bodies[0].shapes[0].size, "every vertex to the last bit"

    def failed(actual):
        checks = compare(world, actual, Ode.RULES, Ode.LAYERS)
        return {check.name for check in checks if not check.passed}

    assert not failed(sound)
    assert failed(other) == {"shape hull"}


@pytest.mark.parametrize("size", [[0.0] * 9, [0.0] * 12, [0.1] * 10])
def test_invalid_hulls_are_rejected_on_load(size, load):
    with pytest.raises(EngineError, match="size"):
        load(two("box", SIZES["box"], stone(7)), lambda content: content["bodies"][0]["shapes"][0].update(size=size))
