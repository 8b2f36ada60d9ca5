"""Bodies of a world without colours have colours of their own on pages; no other world is changed."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.files import find_spec
from simspec.language.load import load
from simspec.report.page.shapes import TINTS, painted
from simspec.world.canonical import sha256
from simspec.world.types import GREY


@pytest.fixture(scope="module")
def world():
    return load(find_spec("bouncing-row")).resolve()


def colours(world):
    return {body.name: {shape.colour for shape in body.shapes} for body in world.bodies}


def test_moving_bodies_are_painted_in_turn_and_fixed_bodies_are_not(world):
    found = colours(painted(world))
    fixed = {body.name for body in world.bodies if body.joint.kind == "fixed"}
    assert fixed
    assert all(found[name] == {GREY} for name in fixed)
    moving = [name for name in found if name not in fixed]
    assert [found[name] for name in moving] == [{TINTS[index % len(TINTS)]} for index in range(len(moving))]


def test_the_world_itself_stays(world):
    before = sha256(world)
    painted(world)
    assert sha256(world) == before


def test_a_world_with_a_colour_is_unchanged(world):
    first, *others = world.bodies
    shapes = tuple(dataclasses.replace(shape, colour=(1.0, 0.0, 0.0, 1.0)) for shape in first.shapes)
    coloured = dataclasses.replace(world, bodies=(dataclasses.replace(first, shapes=shapes), *others))
    assert painted(coloured) is coloured
