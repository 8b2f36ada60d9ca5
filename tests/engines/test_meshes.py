"""Meshes in the engines that have them: where a hull begins to touch, and how deep it comes to rest."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.engines.kit.process import Operation, call
from simspec.errors import UnsupportedError
from simspec.proof.hulls import extent
from simspec.proof.touch.geometry import gap, solids, transforms
from simspec.testing import worlds
from simspec.testing.bench import run_operation, touching_operation
from simspec.world import frames
from simspec.world.kinematics import initial_state
from simspec.world.shapes import SHAPES
from simspec.world.types import Contact, Inertial, Material, PairContact, Shape, World

DEEPEST = {"mujoco": 6e-7, "pybullet": 1.5e-5}
"""How deep (m) a hull rests beyond what its engine's own hull is off."""
HULLS_OFF = {"mujoco": 3e-7, "pybullet": 2e-4}
"""The same as shares of its extent."""


def dropped(engine: str, turn: tuple[float, float, float, float]) -> World:
    """A hull just above a floor without friction."""
    base = worlds.shapes_world(("mesh",), 0.0)
    floor, body = base.bodies
    size = body.shapes[0].size
    moments = SHAPES["mesh"].moments(size, 1.0)
    turned = frames.normalise(turn)
    down = np.array([[0.0, 0.0, -1.0]]) @ np.array(frames.matrix(turned))
    at = (0.0, 0.0, 0.001 + float(SHAPES["mesh"].support(size, down)[0]), *turned)
    joint = dataclasses.replace(body.joint, position=at, velocity=(0.0,) * 6)
    shape = Shape("mesh_0", "mesh", size, material="default")
    body = dataclasses.replace(
        body, joint=joint, inertial=Inertial(1.0, inertia=(*moments, 0.0, 0.0, 0.0)), shapes=(shape,)
    )
    contact = Contact(materials=(Material("default"),), pairs=(PairContact("default", "default", 0.0, 0.0),))
    return worlds.accepting(dataclasses.replace(base, bodies=(floor, body), contact=contact), engine)


def ask(world: World, engine: str, folder, operation: Operation):
    compile_world(world, [engine])[engine].artifacts.write(folder)
    return call(engine, folder, [operation]).answers[0]


@pytest.mark.parametrize("engine", list(DEEPEST))
def test_a_hull_rests_on_its_face(engine, tmp_path):
    world = dropped(engine, (0.9, 0.2, 0.3, 0.1))
    q = ask(world, engine, tmp_path / "files", run_operation(world, 4000, 4000)).arrays["q"][-1]
    solid, floor = solids(world)[1], solids(world)[0]
    at = transforms(np.array([q[:7]]))[0]
    depth = -gap(solid, at, floor, transforms(np.array([[0.0, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0]]))[0]).distance
    size = world.bodies[1].shapes[0].size
    assert abs(depth) <= DEEPEST[engine] + HULLS_OFF[engine] * extent(size)


@pytest.mark.parametrize("engine", list(DEEPEST))
def test_a_hull_touches_where_its_surface_is(engine, tmp_path):
    """In twelve poses: apart by more than the engine's hull may be off it does not touch, as deep it does."""
    world = dropped(engine, (1.0, 0.0, 0.0, 0.0))
    size = world.bodies[1].shapes[0].size
    off = 1e-6 + HULLS_OFF[engine] * extent(size)
    draw, states, wanted = np.random.default_rng(3), [], []
    for _ in range(12):
        turn = frames.normalise(tuple(draw.normal(size=4).tolist()))
        low = float(SHAPES["mesh"].support(size, np.array([[0.0, 0.0, -1.0]]) @ np.array(frames.matrix(turn)))[0])
        for height, touches in ((low + off, False), (low - off, True)):
            q, _ = initial_state(world)
            q[:7] = (0.0, 0.0, height, *turn)
            states.append(q)
            wanted.append(touches)
    answer = ask(world, engine, tmp_path / "files", touching_operation(world, np.array(states)))
    seen = {int(row[0]) for row in answer.arrays["touching"]}
    assert [index in seen for index in range(len(states))] == wanted


def test_two_meshes_do_not_meet_in_dart_whoever_accepts_them():
    base = worlds.shapes_world(("mesh",))
    floor, one = base.bodies
    joint = dataclasses.replace(one.joint, name="other_joint")
    shapes = tuple(dataclasses.replace(shape, name="other_0") for shape in one.shapes)
    other = dataclasses.replace(one, name="other", model="other", joint=joint, shapes=shapes)
    world = worlds.with_options(
        dataclasses.replace(base, bodies=(floor, one, other)), "dart", accept=("contact.cone.elliptic", "shape.mesh")
    )
    with pytest.raises(UnsupportedError, match="does not support contact between mesh and mesh"):
        compile_world(world, ["dart"])


def test_a_mesh_that_touches_is_accepted_by_name_in_dart():
    with pytest.raises(UnsupportedError, match=r"contact between box and mesh only approximately"):
        compile_world(worlds.shapes_world(("mesh",)), ["dart"])
