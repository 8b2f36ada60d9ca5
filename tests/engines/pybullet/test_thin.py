"""Boxes and cylinders that are thinner than the margin that PyBullet keeps within them on links."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world
from simspec.errors import UnsupportedError
from simspec.world.types import Joint, Pose, World
from tests import worlds


def on_a_slide(kind: str, size: tuple[float, ...]) -> World:
    base = worlds.shapes_world((kind,), 0.0)
    floor, free = base.bodies
    shape = dataclasses.replace(free.shapes[0], size=size, pose=Pose())
    slide = Joint("slide", "slide", "floor", Pose((0.0, 0.0, 1.0)), (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    touch = dataclasses.replace(base.contact, excluded_bodies=((free.name, "floor"),))
    return dataclasses.replace(
        base, bodies=(floor, dataclasses.replace(free, joint=slide, shapes=(shape,))), contact=touch
    )


@pytest.mark.parametrize(
    ("kind", "size"), [("box", (0.1, 0.06, 0.0015)), ("cylinder", (0.03, 0.0015)), ("cylinder", (0.00075, 0.1))]
)
def test_what_is_thinner_than_the_margin_is_refused_on_a_link(kind, size):
    world = on_a_slide(kind, size)
    with pytest.raises(UnsupportedError, match=r"which is 0\.0015 m thick"):
        compile_world(world, ["pybullet"])
    thick = tuple(2.0 * value for value in size)
    assert compile_world(on_a_slide(kind, thick), ["pybullet"])


def test_on_the_base_of_a_tree_there_is_no_margin():
    base = worlds.shapes_world(("box",), 0.0)
    floor, free = base.bodies
    thin = dataclasses.replace(free, shapes=(dataclasses.replace(free.shapes[0], size=(0.1, 0.06, 0.0005)),))
    assert compile_world(dataclasses.replace(base, bodies=(floor, thin)), ["pybullet"])
