"""Cylinders in PhysX: prisms, accepted by name where they may touch something."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.physx.cylinders import SIDES, corner_radius, shortfall
from simspec.engines.physx.engine import PhysX
from simspec.errors import EngineError, UnsupportedError
from simspec.testing.worlds import accepting
from tests.engines.free_bodies import ball, loader, scene
from tests.engines.overlapping import overlaps

RADIUS, LENGTH = 0.08, 0.15
SIZES = {"sphere": (0.1,), "capsule": (0.06, 0.2)}
OFF = 6.1e-4
"""Share of the radius that is declared."""
CAN = ball("can", (0.0, 0.0, 1.0), kind="cylinder", size=(RADIUS, LENGTH))
installed = pytest.mark.skipif(PhysX.version() is None, reason="sapien is not installed")


@pytest.fixture
def load(load_files):
    return loader(PhysX, load_files)


def test_corners_are_as_far_outside_as_faces_are_inside():
    inside = 1.0 - corner_radius(SIDES) * np.cos(np.pi / SIDES)
    assert shortfall() == pytest.approx(inside, rel=1e-9)
    assert 0.9 * OFF < shortfall() < OFF


@installed
@pytest.mark.parametrize("size", [(0.02, 0.1), (0.06, 0.6), (0.5, 0.002), (0.001, 1.0)])
def test_a_cylinder_of_any_proportions_is_read_back(size, load):
    world = accepting(scene(ball("can", (0.0, 0.0, 1.0), kind="cylinder", size=size)), "physx")
    shape = load(world).read_back().bodies[1].shapes[0]
    assert (shape.kind, shape.size) == ("cylinder", pytest.approx(size, rel=2e-7))


@installed
@pytest.mark.parametrize("kind", ["plane", "sphere", "capsule"])
def test_none_is_missed_and_depths_are_off_as_declared(kind, load):
    others = [ball("two", (0.0, 0.0, 2.0), kind=kind, size=SIZES[kind])] if kind in SIZES else []
    world = accepting(scene(CAN, *others), "physx")
    found = list(overlaps(load(world), world, 25, seed=8))
    assert all(depth is not None for _, depth, _, _ in found)
    assert max(depth for _, depth, _, _ in found) < OFF * RADIUS + 1e-6
    assert max(turned for _, _, turned, _ in found) < (1e-5 if kind == "plane" else np.pi / SIDES)
    assert max(depth for _, depth, _, _ in found) > 0.5 * OFF * RADIUS, "were it exact, nothing had to be accepted"


@installed
def test_a_tower_stands(load):
    cans = [
        ball(f"c{level}", (0.0, 0.0, LENGTH * (level + 0.5)), kind="cylinder", size=(RADIUS, LENGTH))
        for level in range(3)
    ]
    engine = load(accepting(scene(*cans), "physx"))
    engine.step(500)
    moved = engine.get_state()[0].reshape(-1, 7)[:, :3] - [[0.0, 0.0, LENGTH * (level + 0.5)] for level in range(3)]
    assert np.abs(moved).max() < 2e-4


def test_it_is_accepted_by_name_where_it_may_touch_something():
    world = scene(CAN)
    with pytest.raises(UnsupportedError, match=r"shape\.cylinder.*prisms of 64 sides"):
        compile_world(world, ["physx"])
    visual = dataclasses.replace(CAN.shapes[0], collision=False)
    assert compile_world(scene(dataclasses.replace(CAN, shapes=(visual,))), ["physx"])


def test_large_radii_are_declared_to_the_size_probe():
    large = ball("large", (0.0, 0.0, 9.0), kind="cylinder", size=(0.4, 0.2))
    assert PhysX.thicker(scene(CAN, large)) == {"large": pytest.approx(shortfall() * 0.4)}


@installed
@pytest.mark.parametrize("size", [[0.0, 0.1], [0.1, 0.0], [-0.1, 0.1]])
def test_sizes_without_a_volume_are_refused(size, load):
    def edit(content, sidecar):
        content["bodies"][1]["shapes"][0]["size"] = size

    with pytest.raises(EngineError, match="no cylinder of the size"):
        load(accepting(scene(CAN), "physx"), edit)
