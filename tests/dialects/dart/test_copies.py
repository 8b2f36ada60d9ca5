"""Copies of shapes on welded nodes: which nodes there are, what meets what, and what a reader notices."""

from __future__ import annotations

import dataclasses
import itertools
import json
import random

import pytest

from simspec.dialects.dart.contact import DartNodePlan
from simspec.dialects.dart.dialect import DartDialect
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.proof.selftest_worlds import surfaces
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Pose, Shape
from tests import worlds
from tests.dialects.dart.saying import drop_filter, edited, emit, failures, target, two_materials
from tests.files import write


def random_world(seed, passing=0.2):
    """Bodies of one to three materials each, with pair values drawn from few numbers, groups and exclusions."""
    generator = random.Random(seed)
    names = [f"m{index}" for index in range(generator.randrange(2, 6))]
    bodies = []
    for index in range(9):
        count = generator.randrange(1, min(4, len(names) + 1))
        shapes = tuple(
            Shape(f"b{index}_{number}", "sphere", (0.1,), Pose((0.3 * number, 0.0, 0.0)), material)
            for number, material in enumerate(generator.sample(names, count))
        )
        joint = (
            Joint(f"j{index}", "fixed", origin=Pose((0.0, 0.0, -2.0 * index)))
            if index < 3
            else Joint(f"j{index}", "free", position=(3.0 * index, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
        )
        inertial = Inertial(1.0, inertia=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
        bodies.append(Body(f"b{index}", f"b{index}", inertial, joint, shapes, generator.choice(("default", "g"))))
    pairs = []
    for entry, other in itertools.combinations_with_replacement(names, 2):
        collide = generator.random() >= passing
        friction = generator.choice((0.1, 0.3, 0.7, 0.9)) if collide else 0.0
        restitution = generator.choice((0.0, 0.5)) if collide else 0.0
        pairs.append(PairContact(entry, other, friction, restitution, collide=collide))
    contact = Contact(
        materials=tuple(Material(name, 0.5) for name in names),
        pairs=tuple(pairs),
        ignored_groups=(("g", "g"),) if seed % 2 else (),
        excluded_bodies=(("b3", "b4"),) if seed % 3 else (),
    )
    world = worlds.world(tuple(bodies), contact=contact)
    return worlds.with_options(world, "dart", accept=("material.restitution",))


def meetings(content, entry, other):
    """The numbers of the copies of two shapes that the sidecar lets meet, from its classes alone."""
    of = {node: name for name, class_ in content["filter"]["classes"].items() for node in class_}
    separate = {frozenset(pair) for pair in content["filter"]["apart"]}
    return [
        (a, b)
        for a in entry["surfaces"]
        for b in other["surfaces"]
        if frozenset((of.get(a["node"], ""), of.get(b["node"], ""))) not in separate
    ]


@pytest.mark.parametrize("seed", range(12))
def test_every_two_shapes_meet_once_with_the_numbers_of_their_pair(seed, tmp_path):
    world = random_world(seed)
    content = json.loads(emit(world)[SIDECAR])
    actual = {shape["name"]: shape for shape in content["shapes"]}
    laws = {frozenset((pair.first, pair.second)): pair for pair in world.contact.pairs}
    allowed = CollisionFilter(world)
    tried = 0
    for body, other in itertools.combinations(world.bodies, 2):
        if not allowed.may_touch(body.name, other.name):
            continue
        for a, b in itertools.product(body.shapes, other.shapes):
            law = laws[frozenset((a.material, b.material))]
            met = meetings(content, actual[a.name], actual[b.name])
            assert len(met) == law.collide, f"{a.name} with {b.name}"
            for entry, two in met:
                assert min(entry["friction"], two["friction"]) == pytest.approx(law.friction, abs=1e-15)
                assert entry["restitution"] * two["restitution"] == pytest.approx(law.restitution, abs=1e-15)
            tried += 1
    assert tried > 20
    read = DartDialect().read(write(emit(world), tmp_path))
    assert failures(world, read, text=True) == []


@pytest.mark.parametrize("seed", range(12))
def test_no_more_nodes_than_there_are_different_neighbours(seed):
    """Two nodes of one body differ in some other part that one of them meets and the other must not meet."""
    world = random_world(seed)
    nodes = DartNodePlan(world, target(world).plan)
    passing = {frozenset((pair.first, pair.second)) for pair in world.contact.pairs if not pair.collide}
    parts = {part for actual in nodes.of.values() for node in actual for part in node.parts}
    plan = target(world).plan

    def neighbours(node):
        """For all parts whether the node meets them; left out where no two bodies of the materials ever meet."""
        return {
            other: plan.meet(part, other)
            for part in node.parts
            for other in parts
            if frozenset((part[0], other[0])) in passing
            or (min(part[0], other[0]), max(part[0], other[0])) in plan.layer_of
        }

    for stored in nodes.of.values():
        for first, other in itertools.combinations(stored, 2):
            a, b = neighbours(first), neighbours(other)
            assert any(a[part] != b[part] for part in a.keys() & b.keys())


def test_a_plain_world_has_no_copies_and_no_filter():
    for world in (two_materials(), worlds.spheres(8)):
        content = json.loads(emit(world)[SIDECAR])
        assert content["copies"] == []
        assert content["filter"] == {"apart": [], "classes": {}, "layers": []}


def test_a_body_called_world_has_copies_too(tmp_path):
    world = surfaces("dart")
    renamed = dataclasses.replace(world.bodies[2], name="world", model="world")
    world = dataclasses.replace(world, bodies=(*world.bodies[:2], renamed, world.bodies[3]))
    assert failures(world, DartDialect().read(write(emit(world), tmp_path)), text=True) == []


def text_of(path, text):
    def change(root, content):
        root.find(path).text = text

    return change


def swap_filter(root, content):
    drop_filter(root, content)
    content["filter"]["apart"].append(["ice.1", "rubber.1"])


def drop_filter_and_its_reason(root, content):
    drop_filter(root, content)
    content["filter"]["layers"] = []


def drop_copy(root, content):
    world = root.find("world")
    for skeleton in world.iterfind("skeleton"):
        for body in skeleton.findall("body"):
            if body.get("name") == "ice_cube.1":
                skeleton.remove(body)


def second_shape(root, content):
    body = root.find(".//body[@name='ice_cube.1']")
    body.append(body.find("collision_shape"))


def no_weld(root, content):
    root.find(".//joint[@name='ice_cube.1']").set("type", "ball")


COPY = ".//body[@name='ice_cube.1']"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (text_of(f"{COPY}/collision_shape/geometry/box/size", "0.1 0.1 0.2"), "copies"),
        (text_of(f"{COPY}/collision_shape/transformation", "0 0 1e-9 0 0 0"), "copies"),
        (text_of(f"{COPY}/transformation", "0 0 1e-9 0 0 0"), "not where"),
        (text_of(f"{COPY}/inertia/mass", "1e-9"), "mass"),
        (text_of(f"{COPY}/inertia/moment_of_inertia/iyy", "1e-9"), "mass"),
        (text_of(".//joint[@name='ice_cube.1']/parent", "world"), "welded"),
        (no_weld, "init_pos"),
        (drop_copy, "differ from those"),
        (second_shape, "does not name"),
        (drop_filter, "touch, against"),
        (swap_filter, "touch, against"),
        (drop_filter_and_its_reason, "meet 2 times"),
    ],
)
def test_the_reader_rejects_an_inexact_copy(change, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        DartDialect().read(write(edited(change), tmp_path))


def test_the_reader_takes_the_untouched_files(tmp_path):
    world = surfaces("dart")
    assert failures(world, DartDialect().read(write(edited(lambda root, content: None), tmp_path)), text=True) == []


def test_ignored_groups_are_those_of_which_both_have_solid_shapes():
    ball = random_world(0).bodies[3:6]
    bodies = tuple(dataclasses.replace(body, collision_group=name) for body, name in zip(ball, "abc", strict=True))
    contact = dataclasses.replace(random_world(0).contact, ignored_groups=(("a", "b"), ("a", "nowhere"), ("d", "e")))
    world = dataclasses.replace(random_world(0), bodies=bodies, contact=contact)
    content = json.loads(emit(world)[SIDECAR])
    assert content["ignored_groups"] == [["a", "b"]]
    assert content["groups"] == {"a": [bodies[0].name], "b": [bodies[1].name]}
