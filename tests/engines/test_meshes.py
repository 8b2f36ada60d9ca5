"""Meshes in the engines that have them: where a hull begins to touch, and how deep it comes to rest."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dialects.pybullet.sidecar import LINK_MARGIN
from simspec.engines.kit.process import Operation, call
from simspec.engines.pybullet.engine import PyBullet
from simspec.errors import UnsupportedError
from simspec.proof.checks import extent
from simspec.proof.touch.geometry import gap, solids, transforms
from simspec.proof.verify import read_back_checks
from simspec.testing import worlds
from simspec.testing.bench import failures, run_operation, touching_operation
from simspec.world import frames
from simspec.world.hull import FlatError, hull_of, inset
from simspec.world.kinematics import initial_state
from simspec.world.shapes import SHAPES
from simspec.world.types import Contact, Inertial, Joint, Material, PairContact, Pose, Shape, World
from tests.installed import each

pytestmark = pytest.mark.usefixtures("warm_engines")

DEEPEST = {"mujoco": 6e-7, "pybullet": 1.5e-5, "drake": 1e-7, "ode": 1e-7, "physx": 1e-6, "rapier": 5e-6}
"""How deep (m) a hull rests beyond what its engine's own hull is off."""
HULLS_OFF = {"mujoco": 3e-7, "pybullet": 2e-4, "drake": 1e-5, "ode": 0.0, "physx": 1e-6, "rapier": 1e-6}
"""The same as shares of its extent. Drake's own hull is not off, but touches boxes from 2e-6 m of overlap on."""


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


@pytest.mark.parametrize("engine", each(DEEPEST))
def test_a_hull_rests_on_its_face(engine, tmp_path):
    world = dropped(engine, (0.9, 0.2, 0.3, 0.1))
    q = ask(world, engine, tmp_path / "files", run_operation(world, 4000, 4000)).arrays["q"][-1]
    solid, floor = solids(world)[1], solids(world)[0]
    at = transforms(np.array([q[:7]]))[0]
    depth = -gap(solid, at, floor, transforms(np.array([[0.0, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0]]))[0]).distance
    size = world.bodies[1].shapes[0].size
    assert abs(depth) <= DEEPEST[engine] + HULLS_OFF[engine] * extent(size)


@pytest.mark.parametrize("engine", each(DEEPEST))
def test_a_hull_touches_where_its_surface_is(engine, tmp_path):
    """In twelve poses: at a gap beyond the tolerance of the engine's hull it does not touch, at that depth it does."""
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


def test_two_meshes_do_not_meet_in_dart_even_when_accepted():
    base = worlds.shapes_world(("mesh",))
    floor, body = base.bodies
    joint = dataclasses.replace(body.joint, name="other_joint")
    shapes = tuple(dataclasses.replace(shape, name="other_0") for shape in body.shapes)
    other = dataclasses.replace(body, name="other", model="other", joint=joint, shapes=shapes)
    world = worlds.with_options(
        dataclasses.replace(base, bodies=(floor, body, other)), "dart", accept=("contact.cone.elliptic", "shape.mesh")
    )
    with pytest.raises(UnsupportedError, match="does not support contact between mesh and mesh"):
        compile_world(world, ["dart"])


def test_a_mesh_that_touches_is_accepted_by_name_in_dart():
    with pytest.raises(UnsupportedError, match=r"contact between box and mesh only approximately"):
        compile_world(worlds.shapes_world(("mesh",)), ["dart"])


def test_a_mesh_on_a_link_that_may_land_on_a_face_is_accepted_by_name_in_pybullet():
    free = worlds.with_options(worlds.shapes_world(("mesh",)), "pybullet", accept=("contact.cone.elliptic",))
    assert compile_world(free, ["pybullet"]), "it is on the base of its tree"
    base = worlds.with_options(on_a_link(), "pybullet", accept=("contact.cone.elliptic",))
    with pytest.raises(UnsupportedError, match=r"shape\.mesh.* only approximately.*lands on a face"):
        compile_world(base, ["pybullet"])
    floor, *others = base.bodies
    ball = dataclasses.replace(floor.shapes[0], kind="sphere", size=(0.5,), pose=Pose((0.0, 0.0, -0.5)))
    groups = (("hull", "hull"),)
    bodies = [dataclasses.replace(body, collision_group="hull") for body in others]
    on_a_ball = dataclasses.replace(
        base,
        bodies=(dataclasses.replace(floor, shapes=(ball,)), *bodies),
        contact=dataclasses.replace(base.contact, ignored_groups=groups),
    )
    assert compile_world(on_a_ball, ["pybullet"])


def on_a_link() -> World:
    """A mesh on a hinge of a fixed body with a mesh: on no link of their tree is there a base without mass."""
    base = worlds.shapes_world(("mesh",))
    floor, free = base.bodies
    root = dataclasses.replace(
        free,
        name="root",
        model="root",
        joint=Joint("root_joint", "fixed", None, Pose((2.0, 0.0, 0.6))),
        shapes=tuple(dataclasses.replace(shape, name="root_0") for shape in free.shapes),
    )
    arm = dataclasses.replace(
        free,
        name="arm",
        model="root",
        joint=Joint(
            "arm_joint", "hinge", "root", Pose((0.0, 0.0, 0.4)), (0.0, 1.0, 0.0), position=(0.0,), velocity=(0.0,)
        ),
        shapes=tuple(dataclasses.replace(shape, name="arm_0") for shape in free.shapes),
    )
    contact = dataclasses.replace(base.contact, excluded_bodies=(("arm", "root"),))
    return dataclasses.replace(base, bodies=(floor, free, root, arm), contact=contact)


def test_on_links_where_pybullet_keeps_a_margin_faces_are_that_much_further_in(tmp_path):
    world = worlds.accepting(on_a_link(), "pybullet")
    answer = ask(world, "pybullet", tmp_path / "files", Operation("read_back", world=world))
    bodies = {body.name: body for body in answer.read_back.bodies}
    (whole,), (given,) = bodies["mesh"].shapes, bodies["arm"].shapes
    assert whole.rounding == 0.0
    assert given.rounding == pytest.approx(LINK_MARGIN, rel=1e-6)
    directions = hull_of(world.bodies[1].shapes[0].size).normals
    reach, inner = (SHAPES["mesh"].support(shape.size, directions) for shape in (whole, given))
    np.testing.assert_allclose(inner + LINK_MARGIN, reach, atol=2e-4 * extent(whole.size))
    assert failures(read_back_checks(world, PyBullet, answer.read_back)) == []


def test_a_mesh_within_the_margin_is_approximate_on_a_link():
    world = on_a_link()
    arm = world.bodies[-1]
    thin = tuple(0.01 * value for value in arm.shapes[0].size)
    arm = dataclasses.replace(arm, shapes=(dataclasses.replace(arm.shapes[0], size=thin),))
    with pytest.raises(UnsupportedError, match=r"faces of 'arm_0' are 0\.67 mm too far outside"):
        compile_world(dataclasses.replace(world, bodies=(*world.bodies[:-1], arm)), ["pybullet"])


@pytest.mark.parametrize("depth", [0.0, 1e-3, 0.01])
def test_the_faces_of_an_inset_hull_are_that_much_further_in(depth):
    size = worlds.SIZES["mesh"]
    directions = hull_of(size).normals
    outer, inner = (SHAPES["mesh"].support(each, directions) for each in (size, inset(size, depth)))
    np.testing.assert_allclose(inner, outer - depth, atol=1e-11)
    with pytest.raises(FlatError, match="from the centre"):
        inset(size, 0.05)


def corners_of(sides: tuple[float, float, float]) -> tuple[float, ...]:
    """A box as a hull."""
    signs = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    return tuple(sign * side for row in signs for sign, side in zip(row, sides, strict=True))


def of_two_hulls(engine: str, fall: float) -> World:
    """A leg of 10 x 10 x 10 cm under one end of a beam of 20 x 10 x 10 cm: its centre of mass is 17 mm within the edge."""
    world = dropped(engine, (1.0, 0.0, 0.0, 0.0))
    floor, body = world.bodies
    leg = Shape("leg", "mesh", corners_of((0.1, 0.1, 0.1)), Pose((-1 / 30, 0.0, -1 / 15)), material="default")
    beam = Shape("beam", "mesh", corners_of((0.2, 0.1, 0.1)), Pose((1 / 60, 0.0, 1 / 30)), material="default")
    inertial = Inertial(2.0, inertia=(0.0078, 0.0122, 0.0078, 0.0, 0.0022, 0.0))
    joint = dataclasses.replace(body.joint, position=(0.0, 0.0, 7 / 60 + fall, 1.0, 0.0, 0.0, 0.0))
    body = dataclasses.replace(body, joint=joint, inertial=inertial, shapes=(leg, beam))
    return dataclasses.replace(world, bodies=(floor, body))


def tilt(world: World, engine: str, folder) -> float:
    """The angle (degrees) from upright after 0.4 s."""
    steps = round(0.4 / world.physics.timestep)
    _, x, y, _ = ask(world, engine, folder, run_operation(world, steps, steps)).arrays["q"][-1][3:7]
    return float(np.degrees(np.arccos(1 - 2 * (x * x + y * y))))


@pytest.mark.parametrize("engine", each(DEEPEST))
def test_a_body_of_two_hulls_stands(engine, tmp_path):
    assert tilt(of_two_hulls(engine, 0.0), engine, tmp_path / "files") < 0.1


@pytest.mark.parametrize("engine", each(DEEPEST))
def test_a_body_of_two_hulls_lands_flat(engine, tmp_path):
    """PyBullet finds one point of a hull in a step, and tumbles by more than 5 degrees, unless it has features of the hulls."""
    world = of_two_hulls(engine, 0.1)
    assert tilt(world, engine, tmp_path / "files") < 0.1
    other = dataclasses.replace(world, bodies=world.bodies[::-1])
    assert tilt(other, engine, tmp_path / "other") < 0.1, "in any order of the bodies"


def test_a_hull_on_a_link_is_loaded_without_features_of_faces(tmp_path):
    """With them PyBullet would forget the link's margin."""
    world = worlds.accepting(on_a_link(), "pybullet")
    actual = ask(world, "pybullet", tmp_path / "files", Operation("read_back", world=world)).read_back
    flags = {name: value for name, value in actual.inventory.items() if name.endswith(".flags") and "loadURDF" in name}
    assert flags
    assert not any(int(value) & 4096 for value in flags.values())


def test_each_hull_of_a_body_is_read_back_where_it_is(tmp_path):
    world = of_two_hulls("pybullet", 0.0)
    actual = ask(world, "pybullet", tmp_path / "files", Operation("read_back", world=world)).read_back
    assert failures(read_back_checks(world, PyBullet, actual)) == []
    floor, body = world.bodies
    leg, beam = body.shapes
    moved = dataclasses.replace(beam, pose=Pose((1 / 60, 0.0, 1 / 30 + 1e-3)))
    other = dataclasses.replace(world, bodies=(floor, dataclasses.replace(body, shapes=(leg, moved))))
    assert failures(read_back_checks(other, PyBullet, actual))
