"""Free bodies over a floor, and tests that engines without joints have in common."""

from __future__ import annotations

import dataclasses
import json

import pytest

from simspec.compiler import compile_world
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.errors import UnsupportedError
from simspec.formats.kit.text import json_text
from simspec.formats.world import WORLD
from simspec.proof.checks import PRECISIONS, inventory_checks
from simspec.proof.selftest_worlds import WORLDS
from simspec.testing.worlds import accepting
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Physics, Pose, Shape, World
from tests.planted import SHARED
from tests.worlds import PHYSX, RAPIER

DT, GRAVITY = 0.001, 9.81


def loader(engine, load_files):
    """A function that compiles and loads a world in this class of engine, with its files changed on the way."""

    def of(world, change=lambda content, sidecar: None):
        files = dict(compile_world(world, [engine.NAME])[engine.NAME].files)
        content, sidecar = json.loads(files[WORLD]), json.loads(files[SIDECAR])
        change(content, sidecar)
        return load_files(engine, files | {WORLD: json_text(content), SIDECAR: json_text(sidecar)})

    return of


def ball(name, at, velocity=(0.0,) * 6, kind="sphere", size=(0.1,), material="m", turn=(1.0, 0.0, 0.0, 0.0)):
    joint = Joint(f"{name}_joint", "free", position=(*at, *turn), velocity=velocity)
    inertial = Inertial(2.0, inertia=(0.02, 0.02, 0.02, 0.0, 0.0, 0.0))
    return Body(name, name, inertial, joint, (Shape(name, kind, size, material=material),))


def scene(*bodies, law=(0.5, 0.0), timestep=DT, **more):
    """Bodies over a floor, of materials m and floor."""
    plate = Shape("floor", "plane", (), material="floor")
    floor = Body("floor", "floor", Inertial(0.0), Joint("floor_joint", "fixed"), (plate,))
    names = sorted({"floor", *(shape.material for body in bodies for shape in body.shapes)})
    pairs = tuple(PairContact(name, other, *law, **more) for index, name in enumerate(names) for other in names[index:])
    contact = Contact(materials=tuple(Material(name) for name in names), pairs=pairs)
    physics = Physics((0.0, 0.0, -GRAVITY), timestep, 100)
    return World("scene", (floor, *bodies), contact, physics, engines=(RAPIER, PHYSX))


def of(name):
    """The body of this name in a ``world.json``."""
    return lambda content: next(body for body in content["bodies"] if body["name"] == name)


def shared(engine):
    """Names of the worlds of the self-test that an engine supports."""
    for name in SHARED:
        try:
            compile_world(accepting(WORLDS[name](engine), engine), [engine])
        except UnsupportedError:
            continue
        yield name


def check_inventory(name, engine, load, least):
    """The inventory of a world of the self-test is what the world demands, in at least so many fields."""
    world = accepting(WORLDS[name](engine.NAME), engine.NAME)
    back = load(world).read_back()
    expected = engine.expected_inventory(world, back.neutral)
    (check,) = inventory_checks(expected, back.inventory, PRECISIONS[engine.PRECISION])
    assert check.passed, check.detail
    assert check.count > least


def check_parts(load):
    """Shapes of bodies without mass are parts of what carries them."""
    world = scene(ball("ball", (0.0, 0.0, 0.5)))
    shape = Shape("foot", "sphere", (0.05,), Pose((0.0, 0.0, -0.1)), "m")
    foot = Body("foot", "ball", Inertial(0.0), Joint("foot_joint", "fixed", "ball", Pose((0.0, 0.0, -0.2))), (shape,))
    engine = load(dataclasses.replace(world, bodies=(*world.bodies, foot)))
    actual = {body.name: body for body in engine.read_back().bodies}
    assert actual["foot"].joint.origin.position == pytest.approx((0.0, 0.0, -0.2))
    assert actual["foot"].shapes[0].pose.position == pytest.approx((0.0, 0.0, -0.1), abs=1e-7)
    engine.step(2000)
    assert engine.get_state()[0][2] == pytest.approx(0.35, abs=1e-3)  # it stands on its foot
    assert {tuple(sorted(pair)) for pair in engine.detect_contacts().tolist()} == {(0, 2)}


def heavy_foot(world):
    joint = Joint("foot_joint", "fixed", "ball", Pose((0.0, 0.0, -0.2)))
    foot = Body("foot", "ball", Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)), joint)
    return dataclasses.replace(world, bodies=(*world.bodies, foot))


def moving_plane(world):
    shape = Shape("plate", "plane", (), material="m")
    return dataclasses.replace(world, bodies=(world.bodies[0], dataclasses.replace(world.bodies[1], shapes=(shape,))))


def cylinder(world):
    shape = Shape("can", "cylinder", (0.1, 0.2), material="m")
    return dataclasses.replace(world, bodies=(world.bodies[0], dataclasses.replace(world.bodies[1], shapes=(shape,))))


NOT_WRITTEN = ((heavy_foot, "common centre of mass of 'foot'"), (moving_plane, "'plate' (does|moves)"))
"""Worlds that engines with free or fixed bodies only do not support, with the reason."""


def check_refused(change, why, engine):
    with pytest.raises(UnsupportedError, match=why):
        compile_world(change(scene(ball("ball", (0.0, 0.0, 0.5)))), [engine])
