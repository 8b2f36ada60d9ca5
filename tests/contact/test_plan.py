"""The inversion of engines' combination rules, checked by combining again."""

from __future__ import annotations

import dataclasses
import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.contact import MOST_SPLIT_MATERIALS, Rules, combine, contact_plan, invert, pair_needs, parts
from simspec.language.vocabulary import COMBINED_QUANTITIES
from simspec.world.contact_pairs import meeting_laws, shape_pairs
from simspec.world.types import Contact, Hardness, Joint, Material, PairContact, Pose, Shape, Surface, World
from tests import worlds

ENGINE_RULES = {
    "max": Rules("max", "max", "max", "max", "same"),
    "product": Rules("product", "product", "cross", "cross", "same"),
    "min": Rules("min", "product"),
    "bounded": Rules("min", "product", most_restitution=1.0),
}
every_rule = pytest.mark.parametrize("rules", ENGINE_RULES.values(), ids=ENGINE_RULES)


def table_world(laws: dict[tuple[str, str], PairContact], excluded=()) -> World:
    """Two free spheres of each material, which all may touch one another."""
    names = sorted({name for pair in laws for name in pair})
    template = worlds.shapes_world(("sphere",)).bodies[1]
    bodies = []
    for name, count in itertools.product(names, range(2)):
        body = f"{name}{count}"
        joint = dataclasses.replace(template.joint, name=f"{body}_joint")
        shape = Shape(f"{body}_0", "sphere", (0.05,), Pose(), name)
        bodies.append(dataclasses.replace(template, name=body, model=body, joint=joint, shapes=(shape,)))
    pairs = tuple(laws.get(pair) or PairContact(*pair, 0.0, 0.0) for pair in _pairs(names))
    contact = Contact(materials=tuple(map(Material, names)), pairs=pairs, excluded_bodies=excluded)
    return World("table", tuple(bodies), contact=contact)


def _pairs(names):
    return itertools.combinations_with_replacement(sorted(names), 2)


def random_table(count: int, seed: int, hard: bool = False) -> World:
    generator = random.Random(seed)
    names = [f"m{index}" for index in range(count)]
    kinds = (Hardness(), Hardness("stiffness", stiffness=1e4, damping=10.0)) if hard else (Hardness(),)
    return table_world(
        {
            pair: PairContact(
                *pair,
                friction=generator.choice((0.0, generator.uniform(0.05, 1.5))),
                restitution=generator.choice((0.0, generator.uniform(0.1, 0.9))),
                hardness=generator.choice(kinds),
            )
            for pair in _pairs(names)
        }
    )


def check(world: World, rules: Rules) -> None:
    plan = contact_plan(world, rules, True)
    assert not plan.missed
    assert all(surface.restitution <= rules.most_restitution for surface in plan.numbers.values())
    assert set(plan.layer_of) == set(meeting_laws(world))
    for pair, law in meeting_laws(world).items():
        layer = plan.layer_of[pair]
        given_numbers = [plan.numbers[name, layer] for name in pair]
        found = combine(rules, *given_numbers)
        for quantity in COMBINED_QUANTITIES:
            if getattr(rules, quantity) != "none":
                assert found[quantity] == pytest.approx(getattr(law, quantity), rel=1e-12, abs=1e-12), (pair, quantity)
        if rules.hardness == "same":
            assert all(numbers.hardness == law.hardness for numbers in given_numbers)
        meetings = [
            (layer, other)
            for layer in plan.layers(pair[0])
            for other in plan.layers(pair[1])
            if plan.meet((pair[0], layer), (pair[1], other))
        ]
        assert meetings == [(layer, layer)]  # two shapes touch once, whatever their copies


@every_rule
@settings(max_examples=40, deadline=None)
@given(count=st.integers(1, 6), seed=st.integers(0, 10**6), hard=st.booleans())
def test_any_table_can_be_had_in_layers(rules, count, seed, hard):
    check(random_table(count, seed, hard), rules)


@every_rule
def test_torsional_and_rolling_friction_are_inverted(rules):
    laws = {
        ("a", "a"): PairContact("a", "a", 0.5, 0.0, 0.01, 0.002),
        ("a", "b"): PairContact("a", "b", 0.3, 0.0, 0.02, 0.001),
        ("b", "b"): PairContact("b", "b", 0.9, 0.0, 0.005, 0.004),
    }
    check(table_world(laws), rules)


@every_rule
def test_a_number_each_where_that_is_enough(rules):
    world = table_world({("a", "a"): PairContact("a", "a", 0.36, 0.25)})
    plan = contact_plan(world, rules, True)
    assert not plan.layered
    assert not pair_needs(world, rules)
    check(world, rules)


@every_rule
def test_only_pairs_that_can_meet_bind_the_numbers(rules):
    laws = {
        ("ramp", "rough"): PairContact("ramp", "rough", 0.6, 0.0),
        ("ramp", "slick"): PairContact("ramp", "slick", 0.2, 0.0),
        ("rough", "slick"): PairContact("rough", "slick", 0.9, 0.0),
    }
    world = table_world(laws)
    floor = dataclasses.replace(world.bodies[0], joint=Joint("ramp0_joint", "fixed"))
    single_each = (floor, *(body for body in world.bodies if body.name in ("rough0", "slick0")))
    met = dataclasses.replace(world, bodies=single_each)
    assert [need.feature.value for need in pair_needs(met, rules)] == ["material.friction.pairs"]
    contact = dataclasses.replace(world.contact, excluded_bodies=(("rough0", "slick0"),))
    separate = dataclasses.replace(met, contact=contact)
    assert not pair_needs(separate, rules)
    assert not contact_plan(separate, rules, True).layered


def test_values_that_no_number_gives_are_named_with_their_quantity():
    rules = ENGINE_RULES["max"]
    laws = {
        ("a", "a"): PairContact("a", "a", 0.5, 0.0),
        ("a", "b"): PairContact("a", "b", 0.2, 0.3),
        ("b", "b"): PairContact("b", "b", 0.5, 0.0, hardness=Hardness("native")),
    }
    found = {need.feature.value: need.paths for need in pair_needs(table_world(laws), rules)}
    assert found["material.friction.pairs"] == ("contact.pairs.a.a.friction", "contact.pairs.b.b.friction")
    assert found["material.restitution.pairs"] == ("contact.pairs.a.b.restitution",)
    assert found["contact.hardness.pairs"] == ("contact.pairs.b.b.hardness",)


@every_rule
def test_without_layers_missed_pairs_stay_missed(rules):
    world = random_table(4, 3)
    plan = contact_plan(world, rules, False)
    assert plan.missed
    assert not plan.layered
    listed = set(shape_pairs(world, plan.missed))
    first, second = plan.missed[0]
    assert (min(f"{first}0_0", f"{second}1_0"), max(f"{first}0_0", f"{second}1_0")) in listed


def test_rolling_friction_without_sliding_friction_cannot_be_had_under_the_cross_rule():
    laws = {("a", "a"): PairContact("a", "a", 0.0, 0.0, rolling_friction=0.01)}
    assert contact_plan(table_world(laws), ENGINE_RULES["product"], True).missed == (("a", "a"),)


def test_very_many_materials_are_not_split():
    names = [f"m{index:02}" for index in range(MOST_SPLIT_MATERIALS + 1)]
    laws = {
        pair: PairContact(*pair, 0.1 + 0.01 * index, 0.0) for index, pair in enumerate(_pairs(names)) if pair[0] != ""
    }
    assert contact_plan(table_world(laws), ENGINE_RULES["min"], True).missed


def test_pairs_that_do_not_collide_bind_nothing_and_touch_nothing():
    laws = {
        ("a", "a"): PairContact("a", "a", 0.5, 0.0),
        ("a", "b"): PairContact("a", "b", 0.0, 0.0, collide=False),
        ("b", "b"): PairContact("b", "b", 0.5, 0.0),
    }
    world = table_world(laws)
    assert set(meeting_laws(world)) == {("a", "a"), ("b", "b")}
    plan = contact_plan(world, ENGINE_RULES["product"], True)
    assert not plan.meet(("a", 0), ("b", 0))
    assert plan.meet(("a", 0), ("a", 0))


def test_bodies_are_split_by_material_and_layer():
    world = random_table(3, 1)
    plan = contact_plan(world, ENGINE_RULES["min"], True)
    assert plan.layered
    body = world.bodies[0]
    two = dataclasses.replace(body, shapes=(*body.shapes, dataclasses.replace(world.bodies[2].shapes[0], name="more")))
    found = parts(two, plan)
    assert {(part.material, part.layer) for part in found} == {
        (material, layer) for material in ("m0", "m1") for layer in plan.layers(material)
    }
    assert all(part.surface == plan.numbers[part.material, part.layer] for part in found)


def test_a_number_above_an_engines_bound_is_none_and_is_not_needed_where_others_give_the_same():
    """DART takes a shape's restitution above 1 for 0: the hardest of three balls did not bounce at all."""
    rules = ENGINE_RULES["bounded"]
    assert combine(rules, Surface(0.5, restitution=0.5), Surface(0.5, restitution=1.4))["restitution"] == 0.0
    laws = {("dull", "floor"): 0.3, ("floor", "hard"): 0.8, ("floor", "lively"): 0.5}
    numbers = invert(
        table_world({pair: PairContact(*pair, 0.5, value) for pair, value in laws.items()}),
        rules,
        {pair: PairContact(*pair, 0.5, value) for pair, value in laws.items()},
    )
    for (name, other), value in laws.items():
        assert combine(rules, numbers[name], numbers[other])["restitution"] == pytest.approx(value)
    assert max(surface.restitution for surface in numbers.values()) < 1.0


def test_laws_that_no_numbers_within_the_bound_give_are_in_layers():
    """A material that hardly bounces off itself would need a number of 5 to bounce off another."""
    laws = {("a", "a"): 0.01, ("a", "b"): 0.5, ("b", "b"): 0.9}
    world = table_world({pair: PairContact(*pair, 0.5, value) for pair, value in laws.items()})
    check(world, ENGINE_RULES["bounded"])
    assert contact_plan(world, ENGINE_RULES["bounded"], True).layered
