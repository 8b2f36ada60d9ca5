"""PyBullet's inventory: it equals the expectation of the world, additional calls are found, and every member of PyBullet's
queries is named."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.engines.pybullet.bullet_file import COLLIDER, WORLD, dump, plain, read_blocks
from simspec.engines.pybullet.engine import PyBullet
from simspec.engines.pybullet.inventory import JOINT_INFO, PARAMETERS, SURFACE
from simspec.errors import EngineError
from simspec.proof.mutation_worlds import WORLDS as MUTATED
from simspec.proof.selftest_worlds import WORLDS
from simspec.world.types import Hardness
from tests.engines.inventories import inventory_check
from tests.planted import SHARED

pytestmark = pytest.mark.skipif(PyBullet.version() is None, reason="pybullet is not installed")


def contact(world, **changes):
    return dataclasses.replace(world, contact=dataclasses.replace(world.contact, **changes))


def pairs(world, **changes):
    return contact(world, pairs=tuple(dataclasses.replace(pair, **changes) for pair in world.contact.pairs))


def with_settings(world, **settings):
    given = dataclasses.replace(world.options("pybullet"), settings=tuple(sorted(settings.items())))
    return dataclasses.replace(world, engines=(given,))


SETTINGS = {
    "collision_margin": 0.002,
    "contact_breaking_threshold": 0.01,
    "contact_erp": 0.05,
    "contact_processing_threshold": 1e-5,
    "contact_slop": 1e-4,
    "deterministic_pairs": False,
    "friction_erp": 0.1,
    "iterations": 77,
    "joint_erp": 0.03,
    "residual_threshold": 1e-8,
    "sleeping": True,
}
"""None of them its default."""

SOUND = {
    **{name: lambda make=make: make("pybullet") for name, make in SHARED.items()},
    "settings": lambda: with_settings(WORLDS["model"]("pybullet"), **SETTINGS),
    "pyramid": lambda: contact(WORLDS["bouncing"]("pybullet"), friction_cone="pyramid-circumscribed"),
    "stiff": lambda: pairs(
        WORLDS["bouncing"]("pybullet"), restitution=0.0, hardness=Hardness("stiffness", stiffness=1e5, damping=100.0)
    ),
    "native": lambda: pairs(WORLDS["bouncing"]("pybullet"), hardness=Hardness("native")),
    "threshold": lambda: pairs(WORLDS["bouncing"]("pybullet"), restitution_threshold=0.3),
}


@pytest.fixture
def load(load_files):
    """A function that compiles and loads a world."""
    return lambda world: load_files(PyBullet, compile_world(world, ["pybullet"])["pybullet"].files)


@pytest.mark.parametrize("name", SOUND)
def test_the_inventory_equals_the_expectation_of_the_world(name, load):
    world = SOUND[name]()
    check = inventory_check(world, load(world))
    assert check.passed, check.detail
    assert check.count > 50


def test_every_setting_is_tried():
    assert set(SETTINGS) == set(PyBullet.SETTINGS)
    assert all(PyBullet.SETTINGS[name].default != value for name, value in SETTINGS.items())


def constraint(p, client, uid):
    p.createConstraint(uid, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 0], physicsClientId=client)


BESIDES = {
    "sub-steps": lambda p, c, u: p.setPhysicsEngineParameter(numSubSteps=3, physicsClientId=c),
    "contact_erp": lambda p, c, u: p.setPhysicsEngineParameter(contactERP=0.02, physicsClientId=c),
    "joint_erp": lambda p, c, u: p.setPhysicsEngineParameter(erp=0.02, physicsClientId=c),
    "softness": lambda p, c, u: p.setPhysicsEngineParameter(globalCFM=1e-4, physicsClientId=c),
    "iterations": lambda p, c, u: p.setPhysicsEngineParameter(numSolverIterations=201, physicsClientId=c),
    "cone": lambda p, c, u: p.setPhysicsEngineParameter(enableConeFriction=0, physicsClientId=c),
    "mask": lambda p, c, u: p.setCollisionFilterGroupMask(u, -1, 1, 0, physicsClientId=c),
    "anchor": lambda p, c, u: p.changeDynamics(u, -1, frictionAnchor=1, physicsClientId=c),
    "anisotropy": lambda p, c, u: p.changeDynamics(u, -1, anisotropicFriction=[1, 0.5, 1], physicsClientId=c),
    "threshold": lambda p, c, u: p.changeDynamics(u, -1, contactProcessingThreshold=0.01, physicsClientId=c),
    "margin": lambda p, c, u: p.changeDynamics(u, -1, collisionMargin=0.01, physicsClientId=c),
    "constraint": constraint,
}


@pytest.mark.parametrize("name", BESIDES)
def test_additional_calls_to_the_engine_are_found(name, load):
    world = WORLDS["model"]("pybullet")
    engine = load(world)
    sim = engine._sim
    cube = next(tree for tree in sim.trees if sim.names[tree.links[0].index] == "cube")
    BESIDES[name](sim.bullet, sim.client, cube.uid)
    assert not inventory_check(world, engine).passed


def test_a_body_that_the_sidecar_does_not_name_is_refused(load):
    engine = load(WORLDS["model"]("pybullet"))
    engine._sim.bullet.createMultiBody(1.0, physicsClientId=engine.client)
    with pytest.raises(EngineError, match="holds 6 bodies of links, 5 were loaded"):
        engine.read_back()


def test_arguments_of_load_calls_are_recorded(load):
    """Damping of free flight is in no answer of PyBullet's and not in its dump."""
    world = WORLDS["bouncing"]("pybullet")
    engine = load(world)
    calls = engine._sim.calls
    index = next(i for i, (name, _, given) in enumerate(calls) if "linearDamping" in given)
    name, positional, given = calls[index]
    calls[index] = (name, positional, {**given, "linearDamping": 0.04})
    assert inventory_check(world, engine).where.endswith(".linearDamping")


def test_every_member_of_pybullets_queries_is_named(load):
    engine = load(WORLDS["model"]("pybullet"))
    sim = engine._sim
    p, client = sim.bullet, sim.client
    blocks = {block.code: block.rows[0] for block in dump(sim.bullet)}
    collider = blocks["MBLC"]["m_colObjData"]
    short = {name.removeprefix("m_") for name in collider.dtype.names}
    addresses = {"broadphaseHandle", "collisionShape", "rootCollisionShape", "name"}
    assert short - addresses - {"padding"} == set(COLLIDER)
    world = plain(blocks["DWLD"])
    assert set(WORLD) <= set(world)
    inventory = engine.read_back().inventory
    assert {f"world.{name}" for name in world} - {f"world.{name}" for name in WORLD} <= set(inventory)
    parameters = p.getPhysicsEngineParameters(physicsClientId=client)
    assert {f"parameter.{name}" for name in parameters if name not in PARAMETERS} <= set(inventory)
    uid = sim.trees[1].uid
    # mass, friction, inertia, its place and turn, restitution, rolling, spinning, damping, stiffness, type, margin
    assert len(p.getDynamicsInfo(uid, 0, physicsClientId=client)) == 12
    surface = {key: read(range(12)) for key, (read, _) in SURFACE.table.items()}
    assert set(surface.values()) | {0, 2, 3, 4, 10, 11} == set(range(12))
    # index, name, type, places of q and v, flags, then numbers; the link's name, axis, place, turn, parent
    assert len(p.getJointInfo(uid, 0, physicsClientId=client)) == 17
    assert set(JOINT_INFO.values()) | {0, 1, 2, 3, 4, 5, 12, 13, 14, 15, 16} == set(range(17))


def test_invalid_dumps_are_rejected():
    for content in (b"", b"BULLETf_v326" + b"\0" * 100, b"BULLETd-v326", b"BULLETd-v326DNA1" + b"\xff" * 20):
        with pytest.raises(ValueError, match=r"\.bullet file"):
            read_blocks(content)


def test_invisible_shapes_are_read_back_as_invisible(load):
    world = WORLDS["surfaces"]("pybullet")
    hidden = dataclasses.replace(
        world,
        bodies=tuple(
            dataclasses.replace(body, shapes=tuple(dataclasses.replace(s, visual=False) for s in body.shapes))
            for body in world.bodies
        ),
    )
    seen = [shape.visual for body in load(hidden).read_back().bodies for shape in body.shapes]
    assert seen
    assert not any(seen)
    assert all(shape.visual for body in load(world).read_back().bodies for shape in body.shapes)


@pytest.mark.parametrize("normal", ["0 0 -1", "0 1 0", "0 0", "0.01 0 1"])
def test_a_plane_rotated_in_its_body_frame_is_rejected(normal, tmp_path):
    world = MUTATED["shapes"]("pybullet")
    files = dict(compile_world(world, ["pybullet"])["pybullet"].files)
    head, found, tail = files["ground.urdf"].rpartition('normal="0 0 1"')
    assert found
    write_folder({**files, "ground.urdf": f'{head}normal="{normal}"{tail}'}, tmp_path / "turned")
    engine = PyBullet()
    engine.load(tmp_path / "turned", read_sidecar(tmp_path / "turned"))
    with pytest.raises(EngineError, match="holds a plane of link -1 with the normal"):
        engine.read_back()
    engine.close()


def test_a_world_without_bodies_that_touch_has_an_inventory_too(load):
    world = WORLDS["ball joint"]("pybullet")
    assert not any(name.startswith(("collider.", "apart.")) for name in load(world).read_back().inventory)
