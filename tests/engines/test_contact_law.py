"""What the contact law means, the same for every engine: pair tables, several materials on a body, what passes through what."""

from __future__ import annotations

import dataclasses
import itertools
import random

import numpy as np
import pytest

from simspec.compiler import compile_world, write_folder
from simspec.contact.plan import contact_plan
from simspec.dialects.kit.contract import dialects
from simspec.engines.kit.registry import find_engine
from simspec.errors import UnsupportedError
from simspec.proof.comparator import compare
from simspec.proof.contact.run import measure
from simspec.proof.selftest_worlds import surfaces
from simspec.support.declarations import Level, combine
from simspec.support.features import Feature
from simspec.world.kinematics import CollisionFilter, initial_state
from simspec.world.types import Hardness, Shape, World
from tests import worlds

MATERIALS = [f"m{index}" for index in range(6)]


def six_materials(seed: int = 0) -> World:
    """21 different values between 0.05 and 1, no rule's table."""
    generator = random.Random(seed)
    pairs = list(itertools.combinations_with_replacement(MATERIALS, 2))
    values = [round(0.05 + 0.95 * index / (len(pairs) - 1), 4) for index in range(len(pairs))]
    generator.shuffle(values)
    return worlds.table(dict(zip(pairs, values, strict=True)))


def assert_held(world: World, engine) -> None:
    checks = compare(world, engine.read_back(), engine.RULES, engine.LAYERS)
    assert [check for check in checks if not check.passed] == []


def test_a_table_of_six_materials_is_held_and_measured(loaded):
    """Boxes slide at 1 m/s on tiles: the deceleration of each is its own pair's μ g."""
    world = six_materials()
    engine = loaded(world)
    assert (
        contact_plan(world, engine.RULES, engine.LAYERS).missed
        or contact_plan(world, engine.RULES, engine.LAYERS).layered
    )
    assert_held(world, engine)
    law = {(pair.first, pair.second): pair.friction for pair in world.contact.pairs}
    engine.step(20)  # a box set on a floor may take a few steps to rest on it
    _, start = engine.body_states()
    steps = 60
    engine.step(steps)
    _, end = engine.body_states()
    wrong = {}
    for index, body in enumerate(world.bodies):
        if not body.name.startswith("tile"):
            name, tile = body.name.split("_on_")
            wanted = law[min(name, tile), max(name, tile)]
            found = float(start[index, 1] - end[index, 1]) / (steps * world.physics.timestep * 9.81)
            if found != pytest.approx(wanted, rel=0.01):
                wrong[body.name] = (found, wanted)
    assert wrong == {}


def two_materials_on_one_body(first: str, second: str) -> World:
    """A long box of two shapes, one of each material, each resting on a tile of its own."""
    world = worlds.table({("a", "a"): 0.1, ("a", "b"): 0.8, ("b", "b"): 0.4})
    tiles = tuple(body for body in world.bodies if body.name.startswith("tile"))
    box = next(body for body in world.bodies if body.name == "a_on_a")
    joint = dataclasses.replace(
        box.joint, position=(0.0, 10.0, 0.02, 1.0, 0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    size = (0.2, 0.4, 0.04)

    def at(y: float):
        return dataclasses.replace(box.shapes[0].pose, position=(0.0, y, 0.0))

    shapes = (Shape("near", "box", size, at(-5.3), first), Shape("far", "box", size, at(5.3), second))
    wide = dataclasses.replace(box, joint=joint, shapes=shapes)
    heavy = dataclasses.replace(wide.inertial, inertia=(1e3, 1e3, 1e3, 0.0, 0.0, 0.0))
    return dataclasses.replace(world, bodies=(*tiles, dataclasses.replace(wide, inertial=heavy)))


@pytest.mark.parametrize(("first", "second"), [("a", "b"), ("b", "a")])
def test_shapes_of_one_body_have_materials_of_their_own(loaded, first, second):
    """Each end carries half the weight on its own tile: the deceleration is the mean of both pairs' μ g."""
    world = two_materials_on_one_body(first, second)
    engine = loaded(world)
    assert_held(world, engine)
    engine.step(20)
    _, start = engine.body_states()
    engine.step(60)
    _, end = engine.body_states()
    values = {("a", "a"): 0.1, ("a", "b"): 0.8, ("b", "b"): 0.4}
    wanted = (values[min(first, "a"), max(first, "a")] + values[min(second, "b"), max(second, "b")]) / 2
    found = float(start[-1, 0] - end[-1, 0]) / (60 * 0.001 * 9.81)
    assert found == pytest.approx(wanted, rel=0.02)


def test_copies_of_shapes_change_nothing_in_the_motion(loaded):
    """The same bodies with shapes of one material, and with copies in layers, move alike where nothing touches."""
    world = surfaces("none")
    lifted = tuple(
        dataclasses.replace(
            body,
            joint=dataclasses.replace(
                body.joint,
                position=(*body.joint.position[:2], 5.0, 0.6, 0.0, 0.8, 0.0),
                velocity=(0.3, 0.1, 2.0, 1.0, -2.0, 0.5),
            ),
        )
        if body.joint.kind == "free"
        else body
        for body in world.bodies
    )
    world = dataclasses.replace(world, bodies=lifted, engines=())
    plain = dataclasses.replace(
        world,
        bodies=tuple(
            dataclasses.replace(b, shapes=tuple(dataclasses.replace(s, material="ice") for s in b.shapes))
            for b in world.bodies
        ),
    )
    found = []
    for one in (world, plain):
        engine = loaded(one)
        engine.step(300)
        found.append((*engine.get_state(), engine.mass_matrix(), engine.bias_force()))
    for with_copies, without in zip(*found, strict=True):
        np.testing.assert_allclose(with_copies, without, rtol=0, atol=1e-12)


def test_materials_that_do_not_collide_pass_through_each_other(loaded):
    world = surfaces("none")
    engine = loaded(dataclasses.replace(world, engines=()))
    assert_held(world, engine)
    names = [body.name for body in world.bodies]
    rule = CollisionFilter(world)
    q, v = initial_state(world)
    for one, other in itertools.combinations(names[1:], 2):
        moved = q.copy()
        places = {name: 7 * (names.index(name) - 1) for name in names[1:]}
        for index, name in enumerate(names[1:]):
            moved[places[name] : places[name] + 3] = (10.0 * index, 50.0, 50.0)
        moved[places[other] : places[other] + 3] = moved[places[one] : places[one] + 3] + np.array([0.09, 0.0, 0.0])
        engine.set_state(moved, v)
        touching = {(names[a], names[b]) for a, b in engine.detect_contacts()}
        assert touching == ({(one, other)} if rule.may_touch(one, other) else set())
    # dropped on the floor's side of ice, the ghost falls through; on rubber it stays
    engine.set_state(q, v)
    engine.step(1000)
    poses, _ = engine.body_states()
    height = dict(zip(names, poses[:, 2], strict=True))
    assert height["ghost_cube"] < -1.0
    assert height["ice_cube"] == pytest.approx(0.05, abs=2e-3)
    assert height["rubber_cube"] == pytest.approx(0.05, abs=2e-3)


@pytest.mark.parametrize("feature", worlds.CONTACT_GAPS, ids=str)
def test_each_part_of_a_law_is_held_as_declared(name, loaded, feature):
    """What an engine declares for a part of the law, it holds; what it lacks, it refuses (see the other suite)."""
    kind = find_engine(name)
    level = combine(dialects()[kind.DIALECT].SUPPORT, kind.SUPPORT)[feature].level
    world = worlds.one_law(**worlds.CONTACT_GAPS[feature])
    if level is Level.UNSUPPORTED:
        with pytest.raises(UnsupportedError, match=feature.value):
            loaded(world)
        return
    accept = tuple(sorted({feature.value, *(one.value for one in worlds.CONTACT_GAPS)}))
    engine = loaded(world, accept=accept)
    assert_held(world, engine)


def test_pairs_with_different_hardness_are_held_or_refused_by_name(name, loaded):
    world = worlds.table({("a", "a"): 0.0, ("a", "b"): 0.0, ("b", "b"): 0.0})
    soft = Hardness("stiffness", stiffness=1e5, damping=100.0)
    pairs = tuple(
        dataclasses.replace(pair, hardness=soft if pair.first != pair.second else pair.hardness)
        for pair in world.contact.pairs
    )
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
    kind = find_engine(name)
    table = combine(dialects()[kind.DIALECT].SUPPORT, kind.SUPPORT)
    needed = (Feature.HARDNESS_STIFFNESS, Feature.HARDNESS_PAIRS)
    if any(table[feature].level is Level.UNSUPPORTED for feature in needed):
        with pytest.raises(UnsupportedError, match=r"contact\.hardness"):
            loaded(world)
        return
    assert_held(world, loaded(world, accept=tuple(sorted(feature.value for feature in needed))))


def test_a_threshold_that_is_accepted_as_approximate_is_a_declared_deviation(name, tmp_path):
    """Below the threshold nothing may bounce: an engine has that, or says by how much it has not."""
    law = {"restitution": 0.8, "restitution_threshold": 0.4, "friction": 0.0}
    accept = ("material.restitution", "material.restitution.threshold")
    world = worlds.with_options(worlds.one_law(**law), name, accept=accept)
    folder = tmp_path / "artifacts"
    write_folder(compile_world(world, [name])[name].files, folder)
    with measure(world, name, folder, None, 60.0, False) as measuring:
        figures, _ = measuring.wait()
    below = [figure for figure in figures if figure.probe == "threshold"]
    assert below
    assert all(figure.passed for figure in figures)
    kind = find_engine(name)
    level = combine(dialects()[kind.DIALECT].SUPPORT, kind.SUPPORT)[Feature.RESTITUTION_THRESHOLD].level
    assert any(figure.deviation for figure in below) == (level is Level.APPROXIMATE)
