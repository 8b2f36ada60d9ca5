"""The filter proof finds every defect of a filter, whatever shape, group, name or copy it concerns; sound filters pass."""

from __future__ import annotations

import dataclasses

import pytest

from simspec.compiler import compile_world, write_folder
from simspec.proof.verify import prepare, verify
from simspec.world.types import Body, Contact, EngineOptions, Inertial, Joint, Material, PairContact, Pose, Shape, World
from tests import filters, worlds
from tests.installed import JOINTED

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = sorted(JOINTED)


@pytest.fixture(scope="module", params=ENGINES)
def bench(request):
    world = filters.linked(request.param)
    return request.param, world, compile_world(world, [request.param])[request.param], prepare(world, ["L4"])


def matrix(certificate, engine):
    return next(check for check in certificate.engines[engine].checks if check.name == "collision matrix")


def test_the_sound_filter_passes_with_all_that_can_meet(bench):
    engine, world, _, probes = bench
    found = verify(world, [engine], levels=["L4"], probes=probes)
    assert found.failures() == []
    check = matrix(found, engine)
    assert check.count == 79
    assert "59 pairs of shapes touch, 20 do not; 2 the joints cannot bring together: " in check.detail
    assert "upper_rod – palm" in check.detail


def test_every_defect_of_the_filter_is_caught(bench, tmp_path):
    """By bringing shapes together, or by a refusal of the engine, in addition to the inventory of its masks."""
    engine, world, compiled, probes = bench
    missed = []
    for number, (name, plant) in enumerate(filters.DEFECTS[engine].items()):
        folder = tmp_path / f"{number}"
        write_folder(plant(compiled.files), folder)
        found = verify(world, [engine], levels=["L4"], artifacts={engine: folder}, probes=probes)
        if not {check.name for _, check in found.failures()} & {"collision matrix", "engine"}:
            missed.append(name)
    assert missed == []


def test_a_body_welded_to_the_first_link_of_an_arm_meets_the_ground():
    """PyBullet takes it for unmoved; contact must be found all the same."""
    upper = Joint("j", "hinge", None, Pose((0.0, 0.0, 0.3)), (0.0, 1.0, 0.0), position=(0.0,), velocity=(0.0,))
    arm = Body("arm", "arm", filters.SOLID, upper)
    tip = Body("tip", "arm", filters.SOLID, Joint("k", "fixed", "arm", Pose((0.3, 0.0, 0.0))), (box("x", "a"),))
    end = Body("end", "arm", filters.SOLID, Joint("l", "fixed", "tip", Pose((0.3, 0.0, 0.0))), (box("y", "a"),))
    ground = Body("ground", "ground", Inertial(0.0), Joint("m", "fixed"), (box("z", "a"),))
    for engine in ENGINES:
        world = materials(engine, arm, tip, end, ground)
        excluded = worlds.parent_pairs(world.bodies)
        world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, excluded_bodies=excluded))
        found = verify(world, [engine], levels=["L4"])
        assert found.failures() == []
        assert matrix(found, engine).detail.startswith("1 pairs of shapes touch")


def free(name: str, x: float, *shapes: Shape) -> Body:
    joint = Joint(f"{name}_joint", "free", position=(x, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
    return Body(name, name, filters.SOLID, joint, shapes)


def box(name: str, material: str, x: float = 0.0) -> Shape:
    return Shape(name, "box", (0.1, 0.1, 0.1), Pose((x, 0.0, 0.0)), material)


def materials(engine: str, *bodies: Body, passing: bool = False, friction: float = 0.0) -> World:
    """Bodies of materials a, b and c; a passes through b where requested."""
    names = "abc"
    pairs = tuple(
        PairContact(x, y, 0.0, 0.0, collide=False) if passing and x + y == "ab" else PairContact(x, y, friction, 0.0)
        for i, x in enumerate(names)
        for y in names[i:]
    )
    contact = Contact(materials=tuple(Material(name, friction) for name in names), pairs=pairs)
    return worlds.world(
        bodies, "materials", contact=contact, engines=(EngineOptions(engine, accept=(*worlds.FRICTION, "shape.box")),)
    )


@pytest.mark.parametrize("engine", ENGINES)
def test_shapes_of_the_same_body_never_touch(engine):
    """Two materials on one body, overlapping."""
    world = materials(engine, free("one", 0.0, box("x", "a"), box("y", "c", 0.05)), free("two", 2.0, box("z", "a")))
    found = verify(world, [engine], levels=["L4"])
    assert found.failures() == []
    assert matrix(found, engine).count == 2


@pytest.mark.parametrize("engine", ENGINES)
def test_materials_that_pass_are_judged_by_shape(engine):
    """Bodies of shapes [a, a] and [b, a]: of four pairs two touch."""
    body = free("one", 0.0, box("x", "a"), box("y", "a", 0.3))
    two = free("two", 2.0, box("z", "b"), box("w", "a", 0.3))
    found = verify(materials(engine, body, two, passing=True), [engine], levels=["L4"])
    assert found.failures() == []
    assert matrix(found, engine).count == 4
    assert matrix(found, engine).detail.startswith("2 pairs of shapes touch, 2 do not")


@pytest.mark.parametrize("engine", ENGINES)
def test_the_shapes_of_a_material_need_not_stand_side_by_side(engine):
    """Shapes c, a, c under laws that need copies: the own link holds both of c."""
    friction = {"aa": 0.1, "ac": 0.4, "cc": 0.4, "ab": 0.2, "bb": 0.2, "bc": 0.4}
    body = free("one", 0.0, box("x", "c"), box("y", "a", 0.3), box("z", "c", 0.6))
    two = free("two", 2.0, box("w", "a"), box("v", "c", 0.3))
    world = materials(engine, body, two)
    pairs = tuple(dataclasses.replace(p, friction=friction[p.first + p.second]) for p in world.contact.pairs)
    contact = dataclasses.replace(world.contact, pairs=pairs)
    options = (EngineOptions(engine, accept=("contact.cone.elliptic", *worlds.FRICTION, "shape.box")),)
    world = dataclasses.replace(world, contact=contact, engines=options)
    found = verify(world, [engine], levels=["L4"])
    assert found.failures() == []
    assert matrix(found, engine).count == 6
