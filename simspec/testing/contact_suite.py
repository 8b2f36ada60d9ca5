"""The contact law, the same for every engine: pair tables, several materials on a body, pairs that pass through each other."""

from __future__ import annotations

import dataclasses
import itertools
import random
from collections.abc import Collection

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.kit.process import Operation
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import SettingGroup, finer_settings, idle_settings, resolve_settings
from simspec.errors import UnsupportedError
from simspec.proof.contact.run import measure
from simspec.proof.selftest_worlds import surfaces
from simspec.proof.verify import read_back_checks
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.testing import worlds
from simspec.testing.bench import (
    Bench,
    Suite,
    drive_operation,
    failures,
    run_operation,
    touching_operation,
    windows_operation,
)
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Hardness, PairContact, Pose, Shape, World

MATERIALS = [f"m{index}" for index in range(6)]
GRAVITY = 9.81
SLIDING_PROBES = ("push", "stop")
OBLONG_PROBES = (*SLIDING_PROBES, "push-oblong", "stop-oblong")
"""The contact probes whose bodies slide as boxes do here."""
LIFTED = 0.3
"""Relative deviation of friction from which on a sliding box leaves the floor between steps (measured)."""


def as_accurate(bench: Bench, base: World) -> World:
    """The same world, solved as accurately as the engine's settings allow."""
    settings = resolve_settings(bench.kind, base)
    idle = idle_settings(bench.kind, settings)
    finer = {
        name: value
        for name, value in finer_settings(bench.kind, settings).items()
        if bench.kind.SETTINGS[name].group is SettingGroup.ACCURACY and name not in idle
    }
    name = bench.kind.NAME
    return worlds.with_options(
        base, name, settings=tuple(sorted({**dict(base.options(name).settings), **finer}.items()))
    )


def six_materials(seed: int = 0) -> World:
    """21 different values between 0.05 and 1, no rule's table."""
    generator = random.Random(seed)
    pairs = list(itertools.combinations_with_replacement(MATERIALS, 2))
    values = [round(0.05 + 0.95 * index / (len(pairs) - 1), 4) for index in range(len(pairs))]
    generator.shuffle(values)
    return worlds.table(dict(zip(pairs, values, strict=True)))


def two_materials_on_a_body(first: str, second: str) -> World:
    """A long box of two shapes, one of each material, each resting on a tile of its own."""
    world = worlds.table({("a", "a"): 0.1, ("a", "b"): 0.8, ("b", "b"): 0.4})
    tiles = tuple(body for body in world.bodies if body.name.startswith("tile"))
    box = next(body for body in world.bodies if body.name == "a_on_a")
    joint = dataclasses.replace(
        box.joint, position=(0.0, 10.0, 0.02, 1.0, 0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    size = (0.2, 0.4, 0.04)

    def at(y: float) -> Pose:
        return dataclasses.replace(box.shapes[0].pose, position=(0.0, y, 0.0))

    shapes = (Shape("near", "box", size, at(-5.3), first), Shape("far", "box", size, at(5.3), second))
    wide = dataclasses.replace(box, joint=joint, shapes=shapes)
    heavy = dataclasses.replace(wide.inertial, inertia=(1e3, 1e3, 1e3, 0.0, 0.0, 0.0))
    return dataclasses.replace(world, bodies=(*tiles, dataclasses.replace(wide, inertial=heavy)))


def lifted(body: Body) -> Body:
    """A free body turning in the air; others as they are."""
    if body.joint.kind != "free":
        return body
    position = (*body.joint.position[:2], 5.0, 0.6, 0.0, 0.8, 0.0)
    joint = dataclasses.replace(body.joint, position=position, velocity=(0.3, 0.1, 2.0, 1.0, -2.0, 0.5))
    return dataclasses.replace(body, joint=joint)


def of_material(body: Body, material: str) -> Body:
    """The body with all its shapes of one material."""
    return dataclasses.replace(
        body, shapes=tuple(dataclasses.replace(shape, material=material) for shape in body.shapes)
    )


def plain_surfaces() -> World:
    """The self-test's world of three materials, without a word to any engine."""
    return dataclasses.replace(surfaces("none"), engines=())


def declared_size(bench: Bench, world: World, law: PairContact, probes: Collection[str] = SLIDING_PROBES) -> float:
    """The declared relative deviation of the engine in the friction of a body that slides on a face under this law; 0: none."""
    settings = bench.kind.chosen_settings(world, resolve_settings(bench.kind, world))
    cone, timestep = world.contact.friction_cone, world.physics.timestep
    declared = [
        deviation.size if deviation.relative else deviation.size / law.friction
        for deviation in bench.kind.CONTACT_DEVIATIONS
        if deviation.probe in probes
        and deviation.counts_for(law, cone, timestep, settings, version=bench.kind.version())
    ]
    return max(declared, default=0.0)


def lifts(bench: Bench, world: World) -> bool:
    """Whether sliding boxes hop by what the engine declares: a deceleration over some steps says little then, and the proof's
    own probes hold it to the declared size (level L5)."""
    return any(declared_size(bench, world, law) >= LIFTED for law in world.contact.pairs)


def assert_read_back(bench: Bench, world: World) -> None:
    """The engine says that it holds ``world``."""
    (answer,) = bench.ask(world, Operation("read_back", world=world))
    assert answer.read_back is not None
    assert failures(read_back_checks(world, bench.kind, answer.read_back)) == []


class ContactSuite(Suite):
    """See the module."""

    def test_a_table_of_six_materials_is_stored_and_measured(self, bench: Bench) -> None:
        """Boxes slide at 1 m/s on tiles: the deceleration of each is its own pair's μ g."""
        world = bench.allowed(six_materials())
        if world is None:
            return
        assert_read_back(bench, world)
        if lifts(bench, world):
            return
        law = {(pair.first, pair.second): pair for pair in world.contact.pairs}
        settle, steps = 20, 60  # a box set on a floor may take a few steps to rest on it
        velocity = bench.drive(world, (settle, None), (steps, None))["velocity"]
        wrong = {}
        for index, body in enumerate(world.bodies):
            if not body.name.startswith("tile"):
                name, tile = body.name.split("_on_")
                pair = (min(name, tile), max(name, tile))
                slowed = float(velocity[1, index, 1] - velocity[2, index, 1])
                measured = slowed / (steps * world.physics.timestep * GRAVITY)
                tolerance = max(0.01, declared_size(bench, world, law[pair]))
                if measured != pytest.approx(law[pair].friction, rel=tolerance):
                    wrong[body.name] = (measured, law[pair].friction)
        assert wrong == {}

    @pytest.mark.parametrize(("first", "second"), [("a", "b"), ("b", "a")])
    def test_shapes_of_a_body_have_separate_materials(self, bench: Bench, first: str, second: str) -> None:
        """Each end carries half the weight on its own tile: the deceleration is the mean of both pairs' μ g."""
        world = bench.allowed(two_materials_on_a_body(first, second))
        if world is None:
            return
        assert_read_back(bench, world)
        if lifts(bench, world):
            return
        velocity = bench.drive(world, (20, None), (60, None))["velocity"]
        values = {("a", "a"): 0.1, ("a", "b"): 0.8, ("b", "b"): 0.4}
        ends = (min(first, "a"), max(first, "a")), (min(second, "b"), max(second, "b"))
        expected = (values[ends[0]] + values[ends[1]]) / 2
        measured = float(velocity[1, -1, 0] - velocity[2, -1, 0]) / (60 * 0.001 * GRAVITY)
        laws = [law for law in world.contact.pairs if (law.first, law.second) in ends]
        # a shape is 0.4 m wide and 5.3 m off the middle, so that statics leave 3.8 % of each end's weight open: 2.3 % of 0.25
        tolerance = max(0.025, *(declared_size(bench, world, law, OBLONG_PROBES) for law in laws))
        assert measured == pytest.approx(expected, rel=tolerance)

    @pytest.mark.parametrize(("first", "second"), [("a", "b"), ("a", "a")])
    def test_contacts_name_the_shapes_that_touch(self, bench: Bench, first: str, second: str) -> None:
        """Where an engine reports the units of contacts, each names the touching shape; several where it cannot distinguish
        them."""
        world = bench.allowed(two_materials_on_a_body(first, second))
        if world is None:
            return
        answer = bench.run(world, 100, 20, "contacts")
        if "contact.unit" not in answer.arrays:
            return  # contacts are then compared by bodies, and reports say so
        units, box = answer.result["contact_units"], len(world.bodies) - 1
        assert len(answer.arrays["contact.unit"]) > 0
        sides = [answer.arrays[f"contact.{name}"] for name in ("unit", "body", "position")]
        seen = set()
        for pair, bodies, position in zip(*sides, strict=True):
            assert [units[unit]["body"] for unit in pair] == bodies.tolist()
            near = "near" if position[1] < 10.0 else "far"
            assert near in units[pair[bodies.tolist().index(box)]]["shapes"]
            (tile,) = (units[unit]["shapes"] for unit, body in zip(pair, bodies, strict=True) if body != box)
            seen.add((near, *tile))
        assert {near for near, _ in seen} == {"near", "far"}
        assert len(seen) == 2

    def test_copies_of_shapes_change_nothing_in_the_motion(self, bench: Bench) -> None:
        """The same bodies with shapes of one material, and with copies in layers, move alike where nothing touches."""
        base = plain_surfaces()
        base = dataclasses.replace(base, bodies=tuple(lifted(body) for body in base.bodies))
        plain = dataclasses.replace(base, bodies=tuple(of_material(body, "ice") for body in base.bodies))
        ends = []
        for entry in (base, plain):
            world = bench.allowed(entry)
            if world is None:
                return
            arrays = bench.run(world, 300).arrays
            ends.append((arrays["q"][-1], arrays["v"][-1]))
        for with_copies, without in zip(*ends, strict=True):
            np.testing.assert_allclose(with_copies, without, rtol=0, atol=bench.near(1e-12))

    def test_materials_that_do_not_collide_pass_through_each_other(self, bench: Bench) -> None:
        world = bench.allowed(plain_surfaces())
        if world is None:
            return
        assert_read_back(bench, world)
        names = [body.name for body in world.bodies]
        rule = CollisionFilter(world)
        q, _ = initial_state(world)
        pairs = list(itertools.combinations(names[1:], 2))
        states = []
        for entry, other in pairs:
            moved = q.copy()
            places = {name: 7 * (names.index(name) - 1) for name in names[1:]}
            for index, name in enumerate(names[1:]):
                moved[places[name] : places[name] + 3] = (10.0 * index, 50.0, 50.0)
            here, there = places[entry], places[other]
            moved[there : there + 3] = moved[here : here + 3] + np.array([0.09, 0.0, 0.0])
            states.append(moved)
        operations = [drive_operation(world, (1000, None))]
        if not bench.lacks("pair_detection"):
            operations.append(touching_operation(world, np.array(states)))
        driven, *touched = bench.ask(world, *operations)
        for answer in touched:
            touching = {(int(row), names[a], names[b]) for row, a, b in answer.arrays["touching"]}
            assert touching == {(row, *pair) for row, pair in enumerate(pairs) if rule.may_touch(*pair)}
        # dropped on the floor's side of ice, the ghost falls through; on rubber it stays
        height = dict(zip(names, driven.arrays["pose"][-1, :, 2], strict=True))
        assert height["ghost_cube"] < -1.0
        assert height["ice_cube"] == pytest.approx(0.05, abs=2e-3)
        assert height["rubber_cube"] == pytest.approx(0.05, abs=2e-3)

    @pytest.mark.parametrize("feature", list(worlds.CONTACT_GAPS), ids=str)
    def test_each_part_of_a_law_is_stored_or_refused_as_declared(self, bench: Bench, feature: Feature) -> None:
        world = bench.allowed(worlds.ball_with_law(**worlds.CONTACT_GAPS[feature]))
        if world is not None:
            assert_read_back(bench, world)

    def test_pairs_with_different_hardness_are_stored_or_refused_by_name(self, bench: Bench) -> None:
        world = worlds.table({("a", "a"): 0.0, ("a", "b"): 0.0, ("b", "b"): 0.0})
        soft = Hardness("stiffness", stiffness=1e5, damping=100.0)
        pairs = tuple(
            dataclasses.replace(pair, hardness=soft if pair.first != pair.second else pair.hardness)
            for pair in world.contact.pairs
        )
        world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, pairs=pairs))
        needed = (Feature.HARDNESS_STIFFNESS, Feature.HARDNESS_PAIRS)
        if any(bench.support[feature].level is Level.UNSUPPORTED for feature in needed):
            with pytest.raises(UnsupportedError, match=r"contact\.hardness"):
                compile_world(world, [bench.engine])
            return
        allowed = bench.allowed(world)
        if allowed is not None:
            assert_read_back(bench, allowed)

    def test_a_threshold_that_is_approximate_is_a_declared_deviation(self, bench: Bench) -> None:
        """Below the threshold nothing may bounce: an engine has that, or says by how much it has not."""
        law = {"restitution": 0.8, "restitution_threshold": 0.4, "friction": 0.0}
        world = bench.allowed(worlds.ball_with_law(**law))
        if world is None:
            return
        seconds = 60.0 + find_engine(bench.engine).COMPILING
        with measure(world, bench.engine, bench.artifacts(world), bench.python, seconds, False) as measuring:
            figures, _ = measuring.wait()
        below = [figure for figure in figures if figure.probe == "threshold"]
        assert below
        assert failures(figures) == []
        level = bench.support[Feature.RESTITUTION_THRESHOLD].level
        assert any(figure.deviation for figure in below) == (level is Level.APPROXIMATE)

    def test_a_run_with_contact_gives_the_same_bits_twice(self, bench: Bench) -> None:
        world = bench.allowed(worlds.shapes_world())
        if world is None:
            return
        answer, other = bench.ask(world, run_operation(world, 500), run_operation(world, 500))
        for name in ("q", "v"):
            assert answer.arrays[name].tobytes() == other.arrays[name].tobytes()

    def test_windows_from_the_rows_of_a_run_end_in_the_next_rows(self, bench: Bench) -> None:
        """Warm starts and contact caches change no motion: 1e-9 is 1000 times what iterative solvers leave here, and below any
        difference between engines in contact. Solvers are as accurate as they can be made: where one stops, a warm start
        shows as much as its own tolerance allows (1.7e-5 m/s at 1e-6 in one step of this scene, 3e-23 at 1e-7, measured)."""
        world = bench.allowed(six_materials())
        if world is None:
            return
        world = as_accurate(bench, world)
        whole = bench.run(world, 100, 20, "contacts")
        (ends,) = bench.ask(world, windows_operation(world, whole, "contacts"))
        for name in ("q", "v", "pose", "velocity"):
            np.testing.assert_allclose(ends.arrays[name], whole.arrays[name][1:], rtol=0.0, atol=bench.near(1e-9, 1e-4))
        assert len(ends.arrays["contact.row"]) > 0
        np.testing.assert_array_equal(ends.arrays["contact.row"], whole.arrays["contact.row"] - 1)
        np.testing.assert_array_equal(ends.arrays["contact.body"], whole.arrays["contact.body"])
