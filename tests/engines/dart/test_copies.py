"""DART: pairs of materials that no combination gives, by copies of shapes; measured, and without any effect on the rest."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from simspec.engines.dart.engine import MOST_RECOVERY, Dart
from simspec.errors import EngineError
from simspec.formats.skel.format import WORLD
from simspec.proof.selftest_worlds import surfaces
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.types import Contact, Joint, Material, PairContact, Physics, Pose, Shape
from tests import worlds
from tests.dialects.dart.saying import drop_filter, edited, failures
from tests.engines.crowds import crowd
from tests.engines.dart.scenes import scene

pytestmark = pytest.mark.skipif(Dart.version() is None, reason="dartpy is not installed")

NAMES = "abc"
MIXED = dict(zip(itertools.combinations_with_replacement(NAMES, 2), (0.1, 0.9, 0.3, 0.2, 0.8, 0.4), strict=True))
"""Friction of three materials that the rule of the smaller number cannot give."""


def pairs_of(friction, **law):
    pairs = tuple(PairContact(entry, other, value, 0.0, **law) for (entry, other), value in friction.items())
    return Contact(materials=tuple(Material(name, friction[name, name]) for name in NAMES), pairs=pairs)


def shaped_tree(friction):
    """A tree with a small sphere on each body and three free spheres next to it, in three materials."""
    bodies = worlds.tree(["free", "hinge", "ball", "slide", "fixed", "hinge"], 11)
    alongside = [
        dataclasses.replace(
            body,
            joint=Joint(
                f"far{index}_joint",
                "free",
                position=(50.0 + 3.0 * index, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
                velocity=(0.1, 0.2, 0.0, 1.0, 2.0, 3.0),
            ),
            name=f"far{index}",
            model=f"far{index}",
        )
        for index, body in enumerate(worlds.tree(["free"], 12) * 3)
    ]
    shaped = tuple(
        dataclasses.replace(body, shapes=(Shape(f"{body.name}_0", "sphere", (0.01,), material=NAMES[index % 3]),))
        for index, body in enumerate((*bodies, *alongside))
    )
    contact = dataclasses.replace(pairs_of(friction), excluded_bodies=worlds.parent_pairs(shaped))
    return worlds.world(shaped, contact=contact)


def test_copies_change_nothing_but_contact(load_dart):
    plain, copied = shaped_tree(dict.fromkeys(MIXED, 0.5)), shaped_tree(MIXED)
    entry, two = load_dart(plain), load_dart(copied)
    nodes = [
        sum(engine.world.getSkeleton(index).getNumBodyNodes() for index in range(engine.world.getNumSkeletons()))
        for engine in (entry, two)
    ]
    assert nodes[0] == len(plain.bodies) < nodes[1]
    np.testing.assert_array_equal(entry.mass_matrix(), two.mass_matrix())
    np.testing.assert_array_equal(entry.bias_force(), two.bias_force())
    assert entry.energy() == two.energy()
    effort = np.random.default_rng(3).normal(size=entry.get_state()[1].shape) * 0.1
    for engine in (entry, two):
        engine.step(500)
        engine.step(500, effort)
    # not a bit differs (measured); 1e-12 would do
    for a, b in zip((*entry.get_state(), *entry.body_states()), (*two.get_state(), *two.body_states()), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)
    assert failures(copied, load_dart(copied).read_back()) == []


def test_six_materials_with_21_values_that_no_rule_gives(load_dart):
    """Every box is pushed over its tile at 1.6 times its limit, each in another direction."""
    names = "abcdef"
    order = np.random.default_rng(3).permutation(21)
    keys = itertools.combinations_with_replacement(names, 2)
    friction = {key: 0.05 + 0.0475 * float(number) for key, number in zip(keys, order, strict=True)}
    world = worlds.table(friction)
    at_rest = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=(0.0,) * 6))
        if body.joint.kind == "free"
        else body
        for body in world.bodies
    )
    world = dataclasses.replace(world, bodies=at_rest)
    engine = load_dart(world)
    engine.step(10)
    moving = [body.name for body in world.bodies if body.joint.kind == "free"]
    assert len(moving) == 36
    effort, start = np.zeros(6 * len(moving)), engine.get_state()[1]
    turns = np.arange(len(moving)) * 0.7
    value = np.array([friction[tuple(sorted((name[0], name[-1])))] for name in moving])
    push = 1.6 * value * 9.81
    effort[0::6], effort[1::6] = push * np.cos(turns), push * np.sin(turns)
    engine.step(50, effort)
    gained = (engine.get_state()[1] - start) / 0.05
    along = gained[0::6] * np.cos(turns) + gained[1::6] * np.sin(turns)
    measured = (push - along) / 9.81
    # 1 % is what is promised; measured 3e-5
    np.testing.assert_allclose(measured, value, rtol=1e-3)
    touched = {tuple(sorted(pair)) for pair in engine.contacts()["body"].tolist()}
    tiles = {body.name: index for index, body in enumerate(world.bodies)}
    assert touched == {(tiles[f"tile_{name[-1]}"], tiles[name]) for name in moving}, "indices of the world's bodies"


@pytest.mark.parametrize("detector", ["dart", "ode", "bullet", "fcl"])
def test_groups_and_exclusions_hold_for_every_copy(detector, load_dart):
    """Trees whose boxes all overlap, in three materials, of which two pass through each other."""
    base = crowd()
    bodies = tuple(
        dataclasses.replace(
            body, shapes=tuple(dataclasses.replace(shape, material=NAMES[index % 3]) for shape in body.shapes)
        )
        for index, body in enumerate(base.bodies)
    )
    mixed = pairs_of(MIXED)
    pairs = tuple(
        dataclasses.replace(pair, collide=False) if (pair.first, pair.second) == ("b", "c") else pair
        for pair in mixed.pairs
    )
    contact = dataclasses.replace(base.contact, materials=mixed.materials, pairs=pairs)
    world = dataclasses.replace(base, bodies=bodies, contact=contact)
    allowed = CollisionFilter(world)
    engine = load_dart(worlds.with_options(world, "dart", settings=(("collision_detector", detector),)))
    names = [body.name for body in bodies]
    wanted = [[i, j] for i, j in itertools.combinations(range(len(names)), 2) if allowed.may_touch(names[i], names[j])]
    assert engine.detect_contacts().tolist() == wanted


def test_a_body_does_not_touch_itself(load_dart):
    """Three overlapping shapes of three materials on one body: on nodes of their own, which DART would let touch."""
    base = shaped_tree(MIXED)
    shapes = tuple(
        Shape(f"s{name}", "sphere", (0.1,), Pose((0.05 * i, 0.0, 0.0)), name) for i, name in enumerate(NAMES)
    )
    bodies = (*base.bodies[:-1], dataclasses.replace(base.bodies[-1], shapes=shapes))
    engine = load_dart(dataclasses.replace(base, bodies=bodies))
    assert engine.detect_contacts().tolist() == []
    engine.step(1)
    assert len(engine.contacts()["distance"]) == 0


def test_restitution_of_pairs_that_no_product_gives(load_dart):
    """Three balls of one material each on a floor of three: e(a, a) e(b, b) ≠ e(a, b)²."""
    ratio = {("a", "a"): 0.9, ("a", "b"): 0.3, ("b", "b"): 0.6}
    base = scene(("sphere", (0.1,)), (0.0, 0.0, 0.12), (0.0, 0.0, -2.0))
    floor, ball = base.bodies
    bodies = []
    for index, (entry, other) in enumerate(ratio):
        at = (3.0 * index, 0.0, 0.12, 1.0, 0.0, 0.0, 0.0)
        tile = dataclasses.replace(
            floor,
            name=f"floor{index}",
            model=f"floor{index}",
            joint=Joint(f"floor{index}_joint", "fixed"),
            shapes=(
                Shape(
                    f"t{index}",
                    "box",
                    (2.0, 2.0, 0.2),
                    dataclasses.replace(floor.shapes[0].pose, position=(3.0 * index, 0.0, -0.1)),
                    entry,
                ),
            ),
        )
        moved = dataclasses.replace(
            ball,
            name=f"ball{index}",
            model=f"ball{index}",
            joint=Joint(f"ball{index}_joint", "free", position=at, velocity=(0.0, 0.0, -2.0, 0.0, 0.0, 0.0)),
            shapes=(Shape(f"s{index}", "sphere", (0.1,), material=other),),
        )
        bodies += [tile, moved]
    contact = Contact(
        materials=(Material("a"), Material("b")),
        pairs=tuple(PairContact(name, other, 0.0, value) for (name, other), value in ratio.items()),
    )
    world = dataclasses.replace(
        base, bodies=tuple(bodies), contact=contact, physics=Physics((0.0, 0.0, 0.0), 0.001, 100)
    )
    engine = load_dart(worlds.with_options(world, "dart", accept=("material.restitution",)))
    engine.step(30)
    # 4e-5: DART's constraint force mixing of 1e-5, which dartpy does not show
    np.testing.assert_allclose(engine.get_state()[1][2::6] / 2.0, list(ratio.values()), rtol=1e-4)


def test_excluded_pairs_fall_through_and_others_stand(load_dart):
    """In the self-test's world the ghost's cube passes through the tile of ice that it is above; ice stands on it."""
    base = surfaces("dart")
    engine = load_dart(dataclasses.replace(base, physics=dataclasses.replace(base.physics, gravity=(0.0, 0.0, -9.81))))
    q, v = engine.get_state()
    q[0:3], q[7:10], q[14:17] = (-1.5, 0.0, 0.06), (-0.5, 0.0, 0.06), (0.5, 0.0, 0.06)
    engine.set_state(q, v)
    engine.step(600)
    heights = engine.get_state()[0][2::7]
    np.testing.assert_allclose(heights[0], 0.06 - 9.81 * 0.6**2 / 2.0, rtol=1e-2)
    np.testing.assert_allclose(heights[1:], 0.05, atol=1e-3)


@pytest.mark.parametrize(
    ("old", "new"),
    [("<size>0.1 0.1 0.1</size>", "<size>0.1 0.1 0.100001</size>"), ("<mass>0</mass>", "<mass>1e-6</mass>")],
)
def test_the_read_back_reports_an_inexact_copy(old, new, load_dart):
    def change(files):
        head, tail = files[WORLD].split('<body name="ice_cube.1">')
        assert old in tail
        return {**files, WORLD: head + '<body name="ice_cube.1">' + tail.replace(old, new, 1)}

    world = surfaces("dart")
    assert failures(world, load_dart(world).read_back()) == []
    engine = load_dart(world, change)
    if "mass" in old:
        with pytest.raises(EngineError, match="mass"):
            engine.read_back()
    else:
        assert ("shape type", "bodies.ice_cube.shapes") in failures(world, engine.read_back())


def test_wrong_contacts_of_copies_are_found(load_dart):
    """Where ice and rubber touch by the copies of another layer, the engine says so as soon as they touch."""
    for files, wrong in ((edited(lambda root, content: None), False), (edited(drop_filter), True)):
        engine = load_dart(surfaces("dart"), lambda _, files=files: files)
        q, v = engine.get_state()
        q[14:17] = q[7:10] + np.array([0.09, 0.0, 0.0])
        engine.set_state(q, v)
        if wrong:
            with pytest.raises(EngineError, match="ice_cube_0"):
                engine.detect_contacts()
        else:
            assert engine.detect_contacts().tolist() == [[2, 3]]


@pytest.mark.parametrize("detector", ["dart", "ode"])
@pytest.mark.parametrize("timestep", [0.001, 0.016])
def test_an_overlap_is_taken_back_by_the_common_law_up_to_a_speed(timestep, detector, load_dart):
    for overlap in (1e-6, 5e-5, 1e-3, 2e-2):
        world = scene(("sphere", (0.1,)), (0.0, 0.0, 0.1 - overlap), (0.0, 0.0, 0.0))
        world = dataclasses.replace(world, physics=Physics((0.0, 0.0, 0.0), timestep, 10))
        engine = load_dart(worlds.with_options(world, "dart", settings=(("collision_detector", detector),)))
        engine.step(1)
        speed = engine.get_state()[1][2]
        # 1e-5: DART's constraint force mixing
        assert speed == pytest.approx(min(0.01 * overlap / timestep, MOST_RECOVERY), rel=2e-5)


@pytest.mark.parametrize(("speed", "bounces"), [(0.19, False), (0.21, True)])
def test_nothing_bounces_that_would_leave_slower_than_a_tenth(speed, bounces, load_dart):
    world = scene(("sphere", (0.1,)), (0.0, 0.0, 0.105), (0.0, 0.0, -speed), restitution=0.5)
    world = dataclasses.replace(world, physics=Physics((0.0, 0.0, 0.0), 0.001, 100))
    engine = load_dart(worlds.with_options(world, "dart", accept=("material.restitution",)))
    engine.step(60)
    assert engine.get_state()[1][2] == pytest.approx(0.5 * speed if bounces else 0.0, abs=2e-3)


def test_seven_cylinders_stand_under_the_elliptic_cone(load_dart):
    """A second at 4 ms, in which DART's own number of sweeps lets them fall."""
    base = scene(("cylinder", (0.02, 0.04)), (0.0, 0.0, 0.02), (0.0, 0.0, 0.0), friction=1.0)
    bodies, z = [base.bodies[0]], 0.0
    for index in range(7):
        height = 0.04 + 0.01 * index
        joint = Joint(
            f"c{index}_joint",
            "free",
            position=(0.0, 0.0, z + height / 2.0, 1.0, 0.0, 0.0, 0.0),
            velocity=(0.0,) * 6,
        )
        side = (3.0 * 0.02**2 + height**2) / 12.0
        inertial = dataclasses.replace(base.bodies[1].inertial, inertia=(side, side, 0.5 * 0.02**2, 0.0, 0.0, 0.0))
        shape = Shape(f"c{index}_0", "cylinder", (0.02, height), material="default")
        bodies.append(
            dataclasses.replace(
                base.bodies[1],
                name=f"c{index}",
                model=f"c{index}",
                inertial=inertial,
                joint=joint,
                shapes=(shape,),
            )
        )
        z += height
    world = dataclasses.replace(base, bodies=tuple(bodies), physics=Physics((0.0, 0.0, -9.81), 0.004, 250))
    engine = load_dart(world)
    start = engine.body_states()[0][:, :3]
    engine.step(250)
    assert math.sqrt(((engine.body_states()[0][:, :3] - start) ** 2).sum(axis=1).max()) < 2e-3
