"""How deep shapes are in each other: closed forms, and an independent library of distances."""

from __future__ import annotations

import dataclasses
import math

import coal
import numpy as np
import pytest

from simspec.language.load import Spec
from simspec.world import frames, overlap
from simspec.world.overlap import deep_overlaps
from simspec.world.shapes import SHAPES
from simspec.world.types import Body as WorldBody
from simspec.world.types import Contact, Inertial, Joint, Material, PairContact, Physics, Pose, Shape, World

SIZES = {
    "sphere": (0.11,),
    "box": (0.2, 0.3, 0.24),
    "cylinder": (0.1, 0.3),
    "capsule": (0.08, 0.2),
    "ellipsoid": (0.1, 0.14, 0.2),
}


def scene(*shapes: Shape, contact: Contact | None = None) -> World:
    """Free bodies at the world's origin, one for each shape; a plane's is fixed."""
    bodies = []
    for index, shape in enumerate(shapes):
        name = f"b{index}"
        static = shape.kind == "plane"
        joint = Joint(f"{name}_joint", "fixed") if static else Joint(
            f"{name}_joint", "free", position=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6
        )  # fmt: skip
        named = dataclasses.replace(shape, name=f"{name}_0", material="m")
        bodies.append(WorldBody(name, name, Inertial(1.0, inertia=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0)), joint, (named,)))
    law = contact or Contact(materials=(Material("m"),), pairs=(PairContact("m", "m", 0.0, 0.0),))
    return World("scene", tuple(bodies), contact=law, physics=Physics())


def at(kind: str, *place: float, turn=frames.IDENTITY) -> Shape:
    return Shape("s", kind, SIZES.get(kind, ()), Pose(place or (0.0, 0.0, 0.0), turn))


def depth(*shapes: Shape) -> float:
    found = deep_overlaps(scene(*shapes))
    return found[0].depth if found else 0.0


@pytest.mark.parametrize(
    ("kind", "low"), [("sphere", 0.11), ("box", 0.12), ("cylinder", 0.15), ("capsule", 0.18), ("ellipsoid", 0.2)]
)
def test_how_deep_a_shape_is_in_the_ground(kind, low):
    assert depth(at("plane"), at(kind, 0.3, 0.1, low - 0.05)) == pytest.approx(0.05, abs=1e-12)
    assert depth(at("plane"), at(kind, 0.3, 0.1, low)) == 0.0


def test_spheres_and_boxes_have_closed_forms():
    assert depth(at("sphere"), at("sphere", 0.1, 0.0, 0.0)) == pytest.approx(0.12)
    assert depth(at("box"), at("box", 0.15, 0.0, 0.0)) == pytest.approx(0.05)
    # corner to corner along x: half a diagonal of the turned one's x-y section
    turned = frames.from_axis_angle((0.0, 0.0, 1.0), math.pi / 4)
    reach = 0.5 * (0.2 + 0.3) / math.sqrt(2.0)
    assert depth(at("box"), at("box", 0.1 + reach - 0.03, 0.0, 0.0, turn=turned)) == pytest.approx(0.03)
    assert depth(at("sphere"), at("sphere", 0.2, 0.0, 0.0)) == pytest.approx(0.02)
    assert depth(at("sphere"), at("sphere", 0.215, 0.0, 0.0)) == 0.0  # 5 mm: less than a tenth of the radius


def random_turn(generator) -> tuple[float, ...]:
    q = generator.normal(size=4)
    return tuple(q / np.linalg.norm(q))


def library(shape: Shape):
    """The shape in coal, and its place."""
    size = shape.size
    makers = {
        "sphere": lambda: coal.Sphere(*size),
        "box": lambda: coal.Box(*size),
        "cylinder": lambda: coal.Cylinder(*size),
        "capsule": lambda: coal.Capsule(*size),
        "ellipsoid": lambda: coal.Ellipsoid(*size),
    }
    place = coal.Transform3s()
    place.setRotation(np.array(frames.matrix(shape.pose.quaternion)))
    place.setTranslation(np.array(shape.pose.position))
    return makers[shape.kind](), place


@pytest.mark.parametrize("first", SIZES)
@pytest.mark.parametrize("second", SIZES)
def test_depths_are_those_of_an_independent_library(first, second):
    generator = np.random.default_rng([*first.encode(), *second.encode()])
    number = close = 0
    for _ in range(12):
        normal = generator.normal(size=3)
        normal *= generator.uniform(0.05, 0.3) / np.linalg.norm(normal)
        entry = dataclasses.replace(at(first), pose=Pose((0.1, 0.2, 0.3), random_turn(generator)))
        other = dataclasses.replace(
            at(second), pose=Pose(tuple(np.array([0.1, 0.2, 0.3]) + normal), random_turn(generator))
        )
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        (a, place_a), (b, place_b) = library(entry), library(other)
        truth = -coal.distance(a, place_a, b, place_b, request, result)
        found = depth(entry, other)
        limit = overlap.DEEP * min(SHAPES[shape.kind].inner_radius(shape.size) for shape in (entry, other))
        if found:
            number += 1
            # the overlap along any direction is at least the depth: the smaller of two answers is the better one, and this
            # one may be above the truth by no more than its search leaves
            assert found <= 1.02 * truth
            close += found >= 0.999 * truth
        else:
            assert truth <= limit * 1.001
    assert number >= 3
    assert close >= number - 1  # the library's own search stops early at times


def test_pairs_excluded_from_contact_do_not_overlap():
    contact = Contact(materials=(Material("m"),), pairs=(PairContact("m", "m", 0.0, 0.0, collide=False),))
    shapes = at("sphere"), at("sphere", 0.05, 0.0, 0.0)
    assert deep_overlaps(scene(*shapes))
    assert not deep_overlaps(scene(*shapes, contact=contact))
    assert not deep_overlaps(
        scene(*shapes, contact=Contact(materials=(Material("m"),), excluded_bodies=(("b0", "b1"),)))
    )
    assert not deep_overlaps(scene(shapes[0], dataclasses.replace(shapes[1], collision=False)))


def crowd(count: int, spacing: float, **more):
    """A grid of balls of 50 mm over a floor."""
    ball = {
        "array": {"grid": [count] * 3, "spacing": spacing},
        "pose": {"xyz": [0, 0, 0.5]},
        "shapes": [{"sphere": {"radius": 0.05}, "density": 1000}],
    }
    floor = {"fixed": True, "shapes": [{"box": {"size": [90, 90, 0.5]}, "pose": {"xyz": [0, 0, -0.25]}}]}
    data = {"name": "crowd", "contact": {"materials": {"m": {}}}, "bodies": {"floor": floor, "ball": ball}, **more}
    return Spec.from_data(data).resolve()


def test_a_crowd_is_sought_with_a_tree_and_the_same_is_found(monkeypatch):
    near, far = crowd(4, 0.08), crowd(4, 0.11)
    found = deep_overlaps(near)
    assert len(found) == 3 * 4 * 4 * 3  # neighbours along each axis
    assert found[0].depth == pytest.approx(0.02)
    assert not deep_overlaps(far)
    monkeypatch.setattr(overlap, "MOST_AT_ONCE", 20)
    assert sorted(found, key=str) == sorted(deep_overlaps(near), key=str)
    sunk = crowd(
        6, 0.08, models={"b": {"bodies": {"deep": {"shapes": [{"box": {"size": [20, 20, 0.5]}, "density": 100}]}}}}
    )
    assert any("b/deep" in (deep_overlap.first_body, deep_overlap.second_body) for deep_overlap in deep_overlaps(sunk))


def test_the_overlaps_of_a_heap_are_bounded(monkeypatch):
    monkeypatch.setattr(overlap, "MOST_AT_ONCE", 20)
    monkeypatch.setattr(overlap, "MOST_NEIGHBOURS", 1_000)
    monkeypatch.setattr(overlap, "MOST_PAIRS", 100)
    found = deep_overlaps(crowd(4, 1e-6))
    assert 0 < len(found) <= 100
